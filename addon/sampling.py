# SPDX-License-Identifier: GPL-3.0-or-later
"""The materials of one mesh, taken as means over its triangles and at its corners.

Where colour, light or alpha changes over a triangle, it is sampled as finely as its texture; and where that triangle
is large, it is cut, so that light of several colours leaves it.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np
from fmm_core.opacity import cell_centres

from .materials import GLOSS, Name, Surface, find, read_material, shines
from .meshes import Layers, Mesh, with_area
from .node_values import Points
from .tables import Tables

if TYPE_CHECKING:
    import bpy

    from .textures import Image

Array = np.ndarray
#: Triangles, some in parts: positions, albedo, emission, opacity and its cells.
_Sampled = tuple[Array, Array, Array, Array, list[Array | None]]

#: Samples along the edge of a triangle at most: of images, whose mean is wanted, and of alpha, whose edges are, and
#: of noise.
MOST_COLOURS, MOST_FINE = 64, 128
#: Samples along an edge for each pixel of an image there.
SAMPLES_A_PIXEL = 4
#: And pixels that are assumed where values come from no image.
UNKNOWN = 8
#: Samples along the edge of a triangle of the size of a part at most, of images and of noise: what is small is seen
#: from afar, but for four.
SAMPLES_A_PART, FEW = 16, 4
#: Samples of one material on one mesh at most.
MOST_SAMPLES = 1 << 21
#: Parts that the edge of a triangle is cut into at most.
MOST_PARTS = 32
#: Parts of a triangle that differ by less are not worth a triangle each; alpha that differs by less is a constant.
SAME, SAME_ALPHA = 0.02, 1 / 512
#: What is less of light counts as nothing.
DARK = 1e-4
#: Samples that are evaluated at a time: bounds memory, and how long Blender is held up.
CHUNK = 1 << 13
_ARRAYS = "albedo", "emission", "opacity", "colour"
_DULL = np.zeros((1, GLOSS))


@dataclass
class Painted:
    """A mesh with its materials.

    triangles (T', 3, 3): those of the mesh that have an area, in world space, some of them in parts
    shiny (T',): the number of the material, counted from 1, where it shines more than it scatters, else 0
    albedo (T', 3), emission (T', 3) W/m^2, opacity (T',), one_sided (T',): as `fmm_core.Scene` and `Opacity` have
    them; opacity_cells: one array of n * n cells for each triangle, or None where it has a constant
    corner_albedo, corner_emission (C, 3): colour and emission at the corners of the mesh; corner_gloss (C, GLOSS), or
    no rows
    """

    triangles: Array
    albedo: Array
    emission: Array
    opacity: Array
    opacity_cells: list[Array | None]
    one_sided: Array
    shiny: Array
    corner_albedo: Array
    corner_emission: Array
    corner_gloss: Array


class Slots:
    """The slots of a mesh, of which there are `count`, and what has each of them."""

    def __init__(self, mesh: Mesh, layers: Layers, mirrored: bool, count: int) -> None:
        self.mesh, self.layers, self._mirrored = mesh, layers, mirrored
        self._of_faces = np.minimum(mesh.face_material, count - 1)
        self._triangles: Array | None = None

    def first(self, slot: int) -> int | None:
        """A corner that has a slot, if any has."""
        faces = self._of_faces == slot
        return self.mesh.face_start[np.argmax(faces)] if faces.any() else None

    def of(self, slot: int) -> tuple[Array, Array]:
        """Corners (K, 3) of the triangles that have a slot and an area, and all corners of the mesh that have it."""
        for _ in self.prepare():
            pass
        own = self._triangles
        return own[self._of_corners[own[:, 0]] == slot], np.flatnonzero(self._of_corners == slot)

    def prepare(self) -> Iterator[None]:
        """What `of` needs, in turns."""
        if self._triangles is None:
            corners = self.mesh.triangle_corners[:, ::-1] if self._mirrored else self.mesh.triangle_corners
            parts = [corners[:0]]
            for start in range(0, len(corners), CHUNK):
                part = corners[start : start + CHUNK]
                parts.append(part[with_area(self.layers.world[part])])
                yield
            self._triangles = np.concatenate(parts)

    @cached_property
    def _of_corners(self) -> Array:
        return np.repeat(self._of_faces, self.mesh.face_corners)


@dataclass
class Coat:
    """One material on one mesh: a constant, or what was found on its triangles and corners.

    slot: of the mesh; surface: everywhere, or at the corners that have it; found: as `_sampled` has it, None for a
    constant; shiny: as `Painted` has it
    """

    slot: int
    surface: Surface
    one_sided: bool
    found: list[_Sampled] | None
    shiny: int = 0


@dataclass
class Painter:
    """Reads materials on meshes.

    detail: parts of triangles are about this large, m; images: what was read already; constants: materials that are
    the same everywhere; tables: those of measured ones; gloss: whether it is wanted; shiny: numbers of materials that
    shine more than they scatter, counted from 1

    What takes long is done in steps, between which Blender may do what it likes: a material is looked up by its name
    in each of them.
    """

    detail: float
    images: dict[bpy.types.Image, Image]
    constants: dict[Name | None, tuple[Surface, bool, tuple[str, ...]]]
    tables: Tables
    gloss: bool
    shiny: dict[Name, int] = field(default_factory=dict)

    def coats(
        self, slots: Slots, materials: Sequence[Name | None]
    ) -> Generator[None, None, tuple[list[Coat], list[tuple[Name, str]]]]:
        """The materials of a mesh whose slots have these, and remarks by material; raises fmm_core.Error as
        `read_material`, and where a material is gone.
        """
        coats, remarks = [], []
        for slot, material in enumerate(materials):
            corner = slots.first(slot)
            if corner is not None:
                coat, texts = yield from self._coat(slots, slot, material, corner)
                coat.shiny = self.shiny.get(material, 0)
                coats.append(coat)
                remarks += [(material, text) for text in texts]
                yield
        return coats, remarks

    def _coat(
        self, slots: Slots, slot: int, material: Name | None, corner: int
    ) -> Generator[None, None, tuple[Coat, tuple[str, ...]]]:
        """One material, which the corner has."""
        if material in self.constants:
            surface, one_sided, remarks = self.constants[material]
            return Coat(slot, surface, one_sided, None), remarks
        layers = slots.layers
        one_sided, first = False, Points(layers, np.array([[corner]]), np.ones((1, 1)))
        surface = self._read(material, first)
        remarks = surface.remarks
        if first.sided:
            one_sided, more = self._sides(material, surface, first)
            remarks += more
        if not first.varies:
            if not first.of_object:
                self.constants[material] = surface, one_sided, remarks
            return Coat(slot, surface, one_sided, None), remarks
        yield
        yield from slots.prepare()
        own, at = slots.of(slot)
        points = Points(layers, at[:, None], np.ones((len(at), 1)))
        at_corners = yield from self._read_many(material, points)
        most = MOST_COLOURS if len(at_corners.opacity) == 1 and not points.fine else MOST_FINE
        found = yield from _sampled(partial(self._read, material), points, own, self.detail, most)
        return Coat(slot, at_corners, one_sided, found), remarks

    def _read_many(self, material: Name, points: Points) -> Generator[None, None, Surface]:
        """`_read` of many places, so many at a time."""
        parts, surfaces = [], []
        for start in range(0, len(points.corners), CHUNK):
            yield
            rows = slice(start, start + CHUNK)
            parts.append(Points(points.layers, points.corners[rows], points.weights[rows]))
            surfaces.append(self._read(material, parts[-1]))
        yield
        points.fine = any(part.fine for part in parts)
        # An image that shows nowhere in some part, as light of strength 0, tells nothing of how fine it is there.
        points.texels = [np.concatenate(places) for places in zip(*(part.texels for part in parts), strict=False)]
        counts = [len(part.corners) for part in parts]
        found = {name: _joined([getattr(each, name) for each in surfaces], counts) for name in _ARRAYS}
        return Surface(**found, gloss=_joined([each.gloss for each in surfaces], counts) if self.gloss else _DULL)

    def _read(self, material: Name | None, points: Points) -> Surface:
        surface = read_material(find(material), points, self.images, self.tables)
        if shines(surface):
            self.shiny.setdefault(material, len(self.shiny) + 1)
        return surface

    def _sides(self, material: Name, front: Surface, points: Points) -> tuple[bool, tuple[str, ...]]:
        """Whether a material that asks which side it is seen from is dark at its back; and a remark if it cannot be."""
        back = self._read(material, Points(points.layers, points.corners, points.weights, back=True))
        dark = back.albedo.max() < DARK and back.emission.max() <= DARK * front.emission.max()
        if dark and np.allclose(back.opacity, front.opacity):
            return True, ()
        names = "albedo", "emission", "opacity"
        same = all(np.allclose(getattr(front, name), getattr(back, name), rtol=DARK) for name in names)
        return False, () if same else ("its back differs from its front, which is used on both sides",)


def _joined(parts: list[Array], counts: list[int]) -> Array:
    """Rows of parts with so many each, or the one row that all of them have."""
    if all(len(part) == 1 and np.array_equal(part, parts[0]) for part in parts):
        return parts[0]
    return np.concatenate(
        [np.broadcast_to(part, (count, *part.shape[1:])) for part, count in zip(parts, counts, strict=True)]
    )


def paint(slots: Slots, coats: Sequence[Coat], gloss: bool) -> Painted:
    """A mesh with its coats, and the gloss of its corners if wanted; asks nothing of Blender."""
    corners = len(slots.mesh.corner_vertex)
    shine = np.zeros((corners if gloss else 0, GLOSS), np.float32)
    painted = Painted(*([] for _ in range(7)), *np.zeros((2, corners, 3)), shine)
    for coat in coats:
        own, at = slots.of(coat.slot)
        painted.corner_albedo[at], painted.corner_emission[at] = coat.surface.colour, coat.surface.emission
        if gloss:
            shine[at] = coat.surface.gloss
        found = coat.found
        if found is None:
            of_surface = (coat.surface.albedo, coat.surface.emission, coat.surface.opacity)
            constant = (np.repeat(part, len(own), axis=0) for part in of_surface)
            found = [(slots.layers.world[own], *constant, [None] * len(own))]
        for triangles, albedo, emission, opacity, cells in found:
            painted.triangles.append(triangles)
            painted.albedo.append(albedo)
            painted.emission.append(emission)
            painted.opacity.append(opacity)
            painted.opacity_cells += cells
            painted.one_sided.append(np.full(len(triangles), coat.one_sided))
            painted.shiny.append(np.full(len(triangles), coat.shiny))
    for name in ("triangles", "albedo", "emission", "opacity", "one_sided", "shiny"):
        parts = getattr(painted, name)
        setattr(painted, name, np.concatenate(parts) if parts else np.zeros((0, *_SHAPES.get(name, ()))))
    return painted


_SHAPES = {"triangles": (3, 3), "albedo": (3,), "emission": (3,)}


def _sampled(
    read: Callable[[Points], Surface], at: Points, corners: Array, detail: float, most: int
) -> Generator[None, None, list[_Sampled]]:
    """Triangles with corners (K, 3), some in parts: positions, albedo, emission, opacity and its cells, in turns.

    at: what was asked for at the corners, in their order, which tells how fine textures are on each triangle; most:
    samples along an edge
    """
    layers = at.layers
    if not len(corners):
        return []
    wanted = np.full(len(corners), np.inf if at.fine else SAMPLES_A_PIXEL * UNKNOWN)
    if at.texels and not at.fine:
        among = np.searchsorted(at.corners[:, 0], corners)
        texels = np.max([_longest(places[among]) for places in at.texels], axis=0)
        wanted = SAMPLES_A_PIXEL * texels
    lengths = []
    for start in range(0, len(corners), CHUNK):
        lengths.append(_longest(layers.world[corners[start : start + CHUNK]]))
        yield
    sizes = np.concatenate(lengths) / detail
    parts = _power_of_two(np.clip(sizes, 1, MOST_PARTS) / np.sqrt(2))
    # Noise on small triangles evens out among those of a part; there is no telling how coarse an image is.
    a_part, least = (FEW, 1) if at.fine else (SAMPLES_A_PART, FEW)
    most = np.clip(a_part * sizes, least, most)
    steps = _power_of_two(np.clip(wanted, 1, most))
    while (steps**2).sum() > MOST_SAMPLES and steps.max() > 1:
        steps = np.minimum(steps, steps.max() // 2)
    parts, coarse = np.minimum(parts, steps), steps < wanted
    found = []
    alike = (parts * 2 * MOST_FINE + steps) * 2 + coarse
    for kind in np.unique(alike):
        rows = np.flatnonzero(alike == kind)
        part, step, shifted = parts[rows[0]], steps[rows[0]], coarse[rows[0]]
        size = max(1, CHUNK // (step * step))
        for start in range(0, len(rows), size):
            yield
            chosen = corners[rows[start : start + size]]
            found.append(_parts(read, layers, chosen, part, step // part, shifted, 2.0**-20 * detail))
    return found


def _parts(
    read: Callable[[Points], Surface],
    layers: Layers,
    corners: Array,
    parts: int,
    steps: int,
    shifted: bool,
    grid: float,
) -> _Sampled:
    """Triangles (K, 3), cut along their edges into so many parts, each with the mean of steps * steps samples.

    shifted: samples are not in the middles of their cells but anywhere, as what they shall find is finer than cells,
    and might be as even; grid: new corners have multiples of this as coordinates, m
    """
    bounds = _cell_corners(parts)
    count, pieces, samples = len(corners), len(bounds), steps * steps
    if shifted:
        inside = np.random.default_rng(0).dirichlet(np.ones(3), (count, pieces, samples))
        places = np.einsum("kpnb,nbc->kpnc", inside, _cell_corners(steps))
    else:
        uv = cell_centres(steps)
        places = np.broadcast_to(np.column_stack([1 - uv.sum(axis=1), uv]), (count, pieces, samples, 3))
    weights = np.einsum("kpnc,pcx->kpnx", places, bounds)
    points = Points(layers, np.repeat(corners, pieces * samples, axis=0), weights.reshape(-1, 3))
    surface = read(points)
    shape = count, pieces, samples
    opacity = np.broadcast_to(surface.opacity, count * pieces * samples).reshape(shape)
    albedo, emission = (
        np.broadcast_to(part, (count * pieces * samples, 3)).reshape(*shape, 3) * opacity[..., None]
        for part in (surface.albedo, surface.emission)
    )
    albedo, emission, mean = albedo.mean(axis=2), emission.mean(axis=2), opacity.mean(axis=2)
    whole = _is_one(albedo) & _is_one(emission) & (np.ptp(opacity, axis=(1, 2)) < SAME_ALPHA)
    world = layers.world[corners]
    cut = np.einsum("pcx,kxd->kpcd", bounds, world[~whole])
    # Parts of neighbours have to meet exactly, or they would count as other meshes.
    between = bounds.max(axis=2) < 1
    cut[:, between] = np.round(cut[:, between] / grid) * grid
    cut = cut.reshape(-1, 3, 3)
    varies = np.ptp(opacity[~whole], axis=2).reshape(-1) >= SAME_ALPHA
    own = opacity[~whole].reshape(-1, samples).astype(np.float32)
    cells = [None] * np.count_nonzero(whole) + [
        each if has_own else None for each, has_own in zip(own, varies, strict=True)
    ]
    albedo, emission, mean = (
        np.concatenate([part[whole].mean(axis=1), part[~whole].reshape(-1, *part.shape[2:])])
        for part in (albedo, emission, mean)
    )
    solid = np.where(mean > 0, mean, np.inf)[:, None]
    return np.concatenate([world[whole], cut]), albedo / solid, emission / solid, mean, cells


def _is_one(means: Array) -> Array:
    """(K,) whether the parts (K, P, 3) of a triangle hardly differ."""
    return (np.ptp(means, axis=1) <= SAME * means.max(axis=(1, 2))[:, None]).all(axis=1)


def _cell_corners(steps: int) -> Array:
    """(steps * steps, 3, 3) barycentric coordinates of the corners of equal parts of a triangle, in Opacity's order."""
    third = np.rint(cell_centres(steps) * 3 * steps).astype(int)
    cell, upright = third // 3, (third[:, :1] % 3 == 1).astype(int)
    around = np.array([[0, 0], [1, 0], [0, 1]])
    # The others are turned by half a circle.
    uv = (cell[:, None] + np.where(upright[:, None] == 1, around, 1 - around)) / steps
    return np.concatenate([1 - uv.sum(axis=2, keepdims=True), uv], axis=2)


def _longest(triangles: Array) -> Array:
    return np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2).max(axis=1)


def _power_of_two(values: Array) -> Array:
    return (2 ** np.ceil(np.log2(np.maximum(values, 1)))).astype(int)
