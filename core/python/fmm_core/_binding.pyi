# SPDX-License-Identifier: GPL-3.0-or-later
"""The compiled core. Arrays are C-contiguous; float64 unless said otherwise; wrong shapes raise ValueError."""

import numpy as np
from numpy.typing import NDArray

class Sources:
    def __init__(
        self,
        positions: NDArray[np.float64],
        normals: NDArray[np.float64],
        softening: NDArray[np.float64],
        areas: NDArray[np.float64],
        points_per_patch: int,
    ) -> None: ...
    def __len__(self) -> int: ...
    @property
    def words(self) -> int: ...
    def irradiance(
        self,
        points: NDArray[np.float64],
        normals: NDArray[np.float64],
        strengths: NDArray[np.float64],
        visible: NDArray[np.uint64] | None = None,
    ) -> NDArray[np.float64]: ...

class NearField:
    def __init__(
        self,
        points: NDArray[np.float64],
        normals: NDArray[np.float64],
        patches: NDArray[np.float64],
        reach: NDArray[np.float64],
    ) -> None: ...
    def __len__(self) -> int: ...
    def starts(self) -> NDArray[np.uint64]: ...
    def patches(self) -> NDArray[np.uint32]: ...
