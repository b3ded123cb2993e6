# SPDX-License-Identifier: GPL-3.0-or-later
"""The compiled core. Arrays are C-contiguous; float64 unless said otherwise; wrong shapes raise ValueError."""

import numpy as np
from numpy.typing import NDArray

class Medium:
    def __init__(
        self,
        absorption: tuple[float, float, float],
        volumes: list[tuple[NDArray[np.float64], tuple[float, float, float]]],
    ) -> None: ...
    @property
    def is_clear(self) -> bool: ...
    def left(
        self, points: NDArray[np.float64], directions: NDArray[np.float64], distances: NDArray[np.float64]
    ) -> NDArray[np.float64]: ...

class Sources:
    def __init__(
        self,
        positions: NDArray[np.float64],
        normals: NDArray[np.float64],
        softening: NDArray[np.float64],
        areas: NDArray[np.float64],
        shares: NDArray[np.float64],
        medium: Medium | None = None,
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
        clear: bool = False,
    ) -> NDArray[np.float64]: ...

class NearField:
    def __init__(
        self,
        points: NDArray[np.float64],
        normals: NDArray[np.float64],
        patches: NDArray[np.float64],
        reach: NDArray[np.float64],
        rule: NDArray[np.float64],
    ) -> None: ...
    def __len__(self) -> int: ...
    def starts(self) -> NDArray[np.uint64]: ...
    def patches(self) -> NDArray[np.uint32]: ...
    def form_factors(self) -> NDArray[np.float64]: ...
    def targets(self) -> NDArray[np.float64]: ...

class Correction:
    def __init__(
        self,
        near: NearField,
        points: NDArray[np.float64],
        normals: NDArray[np.float64],
        sources: Sources,
        fractions: NDArray[np.float64],
        visible: NDArray[np.uint64] | None = None,
        counted: tuple[NDArray[np.bool_], NDArray[np.bool_]] | None = None,
    ) -> None: ...
    def __len__(self) -> int: ...
    def add(self, strengths: NDArray[np.float64], irradiance: NDArray[np.float64], clear: bool = False) -> None: ...
    def sent(self, areas: NDArray[np.float64]) -> NDArray[np.float64]: ...

class Fmm:
    def __init__(
        self,
        sources: tuple[NDArray[np.float64], NDArray[np.float64]],
        softening: NDArray[np.float64],
        targets: tuple[NDArray[np.float64], NDArray[np.float64]] | None,
        truncation: int,
        grouping: int,
        level: int | None,
        separation: int,
        expansion: str,
        share: float = 1.0,
        emitters: NDArray[np.bool_] | None = None,
        scene: NDArray[np.float64] | None = None,
        medium: Medium | None = None,
    ) -> None: ...
    def n_blockers(self) -> int: ...
    def occlude(
        self,
        sources: list[NDArray[np.float64]],
        patches: tuple[NDArray[np.float64], NDArray[np.float64]],
        frame: tuple[tuple[float, float, float], float, float],
        effort: tuple[float, float, float, float, int],
        moving: list[NDArray[np.float64]] = ...,
    ) -> None: ...
    def near_field(
        self,
        points: NDArray[np.float64],
        normals: NDArray[np.float64],
        patches: NDArray[np.float64],
        reach: NDArray[np.float64],
        rule: NDArray[np.float64],
    ) -> NearField: ...
    def open_leaves(self) -> int: ...
    def gather_rays(
        self, start: int, stop: int
    ) -> tuple[NDArray[np.uint32], NDArray[np.float32], NDArray[np.float32]]: ...
    def take_hits(
        self,
        surface: Surface,
        leaves: tuple[int, int],
        points: NDArray[np.uint32],
        directions: NDArray[np.float32],
        triangles: NDArray[np.int32],
        u: NDArray[np.float32],
        v: NDArray[np.float32],
    ) -> None: ...
    def move_to(self, boxes: list[NDArray[np.float64]], areas: NDArray[np.float64]) -> None: ...
    def moved_link_rays(
        self, start: int, stop: int
    ) -> tuple[NDArray[np.uint64], NDArray[np.float32], NDArray[np.float32]]: ...
    def moved_gather_rays(
        self, start: int, stop: int
    ) -> tuple[NDArray[np.uint32], NDArray[np.uint32], NDArray[np.float32], NDArray[np.float32]]: ...
    def take_moved_hits(
        self,
        surface: Surface,
        leaves: tuple[int, int],
        rays: tuple[NDArray[np.uint32], NDArray[np.uint32], NDArray[np.float32]],
        triangles: NDArray[np.int32],
        u: NDArray[np.float32],
        v: NDArray[np.float32],
    ) -> None: ...
    def linked_leaves(self) -> int: ...
    def outcomes(self) -> tuple[int, int, int]: ...
    def link_rays(
        self, start: int, stop: int, second: bool
    ) -> tuple[NDArray[np.uint64], NDArray[np.float32], NDArray[np.float32]]: ...
    def block(self, slots: NDArray[np.uint64], occluded: NDArray[np.bool_]) -> None: ...
    def find_cells(self, frame: tuple[tuple[float, float, float], float, float]) -> int: ...
    def shoot(self, start: int, stop: int) -> tuple[NDArray[np.uint64], NDArray[np.float32], NDArray[np.float32]]: ...
    def detect(self, slots: NDArray[np.uint64], occluded: NDArray[np.bool_]) -> None: ...
    def generate(self) -> None: ...
    def near_seen(self, near: NearField, points_per_patch: int) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]: ...
    def apply(
        self, strengths: NDArray[np.float64], clear: bool = False
    ) -> tuple[NDArray[np.float64], list[tuple[str, float]]]: ...
    def sent(self, areas: NDArray[np.float64]) -> NDArray[np.float64]: ...
    def counts(self) -> dict[str, int]: ...

class Surface:
    def __init__(
        self,
        scene: NDArray[np.float64],
        bisections: tuple[NDArray[np.int8], NDArray[np.float64], NDArray[np.uint32]],
        rule: NDArray[np.float64],
        hidden: NDArray[np.bool_],
        slack: float,
    ) -> None: ...
    def met(
        self,
        triangles: NDArray[np.int32],
        u: NDArray[np.float32],
        v: NDArray[np.float32],
        directions: NDArray[np.float32],
    ) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]: ...

def group(scene: NDArray[np.float64], kinds: NDArray[np.uint32], count: int) -> NDArray[np.uint32]: ...
def coincident(
    points: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]],
    sheets: tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_]],
    slack: float,
) -> NDArray[np.float64]: ...
def contacts(
    scene: NDArray[np.float64],
) -> tuple[NDArray[np.int8], NDArray[np.float64], NDArray[np.uint32], NDArray[np.bool_]]: ...
def is_sealed(scene: NDArray[np.float64]) -> bool: ...
def inward(
    corners: NDArray[np.uint32], scene: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], bool]: ...
def volume(scene: NDArray[np.float64]) -> float: ...
def planes(
    scene: NDArray[np.float64], points: NDArray[np.float64], size: float, margin: float, most: int
) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_]] | None: ...
def error_bound(truncation: int, strength: float, source_radius: float, receiver_distance: float) -> float: ...
def tree_order(points: NDArray[np.float64], normals: NDArray[np.float64]) -> NDArray[np.uint32]: ...
def rays_between(
    start: tuple[NDArray[np.float64], NDArray[np.float64]],
    targets: tuple[NDArray[np.float64], NDArray[np.float64]],
    frame: tuple[tuple[float, ...], float, float],
) -> tuple[NDArray[np.float32], NDArray[np.float32]]: ...
def facing_rays(
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    sources: Sources,
    after: int | None,
    centre: tuple[float, float, float],
    scale: float,
    offset: float,
) -> tuple[NDArray[np.uint64], NDArray[np.float32], NDArray[np.float32]]: ...
def mark_visible(
    bits: NDArray[np.uint64], count: int, pairs: NDArray[np.uint64], occluded: NDArray[np.bool_]
) -> None: ...
def symmetrise(bits: NDArray[np.uint64], count: int) -> None: ...
def around(
    axes: NDArray[np.float64], cosines: NDArray[np.float64], angles: NDArray[np.float64]
) -> NDArray[np.float64]: ...

Choosing = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.uint32], NDArray[np.float64]]

class Emitters:
    def __init__(
        self,
        patches: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]],
        emission: NDArray[np.float64],
        opacity: NDArray[np.float64],
        numbers: NDArray[np.uint32],
    ) -> None: ...
    def __len__(self) -> int: ...
    def anywhere(self) -> NDArray[np.float64]: ...
    def around(self, points: NDArray[np.float64], normals: NDArray[np.float64] | None) -> NDArray[np.float64]: ...
    def met(
        self,
        start: Choosing,
        met: tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]],
        radiosity: NDArray[np.float64],
    ) -> NDArray[np.float64]: ...
    def aim(
        self, start: Choosing, numbers: NDArray[np.float64], frame: tuple[tuple[float, ...], float, float]
    ) -> tuple[NDArray[np.uint32], NDArray[np.float32], NDArray[np.float32], NDArray[np.float64]]: ...
