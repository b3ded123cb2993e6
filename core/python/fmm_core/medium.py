# SPDX-License-Identifier: GPL-3.0-or-later
"""What a medium that absorbs light leaves of it."""

import numpy as np
from numpy.typing import NDArray


def left(medium: NDArray[np.float64], distances: NDArray[np.float64]) -> NDArray[np.float64]:
    """(..., 3) shares of light that are left after so many metres (...), for an absorption (3,) in 1/m."""
    if not medium.any():
        return np.ones((*np.shape(distances), 3))
    with np.errstate(invalid="ignore"):
        return np.where(medium > 0, np.exp(-medium * np.asarray(distances)[..., None]), 1.0)
