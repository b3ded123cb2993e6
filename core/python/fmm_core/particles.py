# SPDX-License-Identifier: GPL-3.0-or-later
"""Triangles to patches and Gaussian quadrature points (section 3 of the paper, eq 12)."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import _binding
from .arrays import ROUNDING, centroids, largest, lengths
from .quadrature import triangle_rule
from .scene import Scene

#: Share of the particles that goes to what emits strongly; the rest follows area.
EMITTER_SHARE = 0.1
#: Share of the area of a scene that weak lamps have together at most.
LAMPS = 0.1
#: Patches are cut until their longest edge fits, but not where they are this many times smaller than they may be.
SLIVER = 50.0
#: Softening of the point kernel, in patch radii: far below any distance at which it is used unreplaced.
SOFTENING = 1e-5
#: Triangles whose albedos are the same to so many steps of 1 may share a particle, which has their mean.
ALBEDO_STEPS = 16
#: Surfaces closer than this share of the scene are in one place: rays cannot tell them apart.
SAME_PLACE = 1e-6
#: The share of its place that a surface has which others that emit lie in front of.
HIDDEN = 1e-6
#: Tells rows of surface properties apart by one number each.
_SPREAD = np.random.default_rng(0).random(7)
#: What a leaf of the bisection names where there is no patch.
NO_PATCH = np.uint32(0xFFFFFFFF)


Buried = Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.bool_]]


@dataclass(frozen=True)
class Particles:
    """Quadrature points, `per_patch` consecutive ones a patch; two-sided triangles have patches on both sides.

    positions, normals (N, 3); weights (N,) area of what is there: less where it is partly transparent, or shares its
    place with other surfaces, and next to none where it is hidden
    hidden (N,) whether one of those emits and it does not
    triangle (N,) row of the scene; emits (N,) whether that emits strongly; per_patch int
    patches (P, 3, 3) corners; areas (P,); radii (P,) from centroid to farthest corner
    whole (P,) whether the patch is all that its points stand for: where a mesh is finer than the light needs, a
    patch is one triangle of a group of them, and areas and radii are those of the group
    rule (per_patch, 3) barycentric coordinates of the points of a patch, shares (per_patch,) of its area
    edges (K,), fractions (K,), parts (K, 2) the bisection of the scene's triangles, as the core's `Surface` takes it
    solid (T,) area of what is there of each triangle of the scene
    origin (P,) the patch that each is a small part of, if patches were cut again later
    """

    positions: NDArray[np.float64]
    normals: NDArray[np.float64]
    weights: NDArray[np.float64]
    hidden: NDArray[np.bool_]
    triangle: NDArray[np.int64]
    emits: NDArray[np.bool_]
    per_patch: int
    patches: NDArray[np.float64]
    areas: NDArray[np.float64]
    radii: NDArray[np.float64]
    whole: NDArray[np.bool_]
    rule: NDArray[np.float64]
    shares: NDArray[np.float64]
    edges: NDArray[np.int8]
    fractions: NDArray[np.float64]
    parts: NDArray[np.uint32]
    solid: NDArray[np.float64]
    origin: NDArray[np.int64]

    def of_triangles(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N, 3) what is given for each triangle (T, 3), for each particle; the mean where it stands for several."""
        found = values[self.triangle]
        uncut = np.flatnonzero(self.edges[: len(values)] < 0)
        grouped = uncut[~self.whole[self.parts[uncut, 0]]]
        if len(grouped):
            patch, solid = self.parts[grouped], self.solid[grouped]
            for side in (0, 1):
                there = patch[:, side] != NO_PATCH
                rows, share = patch[there, side], solid[there]
                total = np.bincount(rows, share, len(self.areas))
                of_patches = [np.bincount(rows, share * values[grouped[there], k], len(self.areas)) for k in range(3)]
                chosen = np.repeat(total > 0, self.per_patch)
                means = np.stack(of_patches, axis=1)[total > 0] / total[total > 0, None]
                found[chosen] = np.repeat(means, self.per_patch, axis=0)
        return found

    @property
    def visibility_weights(self) -> NDArray[np.float64]:
        """(N,) what each particle may send, as a share of what a point in the open receives, in units of area.

        Emitters count for half of all light and everything else for the other half, whatever their power is now.
        """
        emitting = self.weights[self.emits].sum()
        return 0.5 * self.weights * np.where(self.emits, self.weights.sum() / (emitting or 1.0), 1.0)

    def __len__(self) -> int:
        return len(self.positions)

    @property
    def softening(self) -> NDArray[np.float64]:
        """(N,) squared distance below which a particle's kernel stops growing."""
        return np.repeat((SOFTENING * self.radii) ** 2, self.per_patch)

    def only(self, chosen: NDArray[np.bool_]) -> "Particles":
        """The particles (N,) that are chosen, patch by patch."""
        patches = chosen.reshape(-1, self.per_patch)[:, 0]
        of_points = ("positions", "normals", "weights", "hidden", "triangle", "emits")
        of_patches = ("patches", "areas", "radii", "whole", "origin")
        parts = {name: getattr(self, name)[chosen] for name in of_points}
        return replace(self, **parts, **{name: getattr(self, name)[patches] for name in of_patches})

    def of_points(self, of_patches: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N,) what is given for each patch (P,), for each of its points."""
        return np.repeat(of_patches, self.per_patch)


def make_particles(scene: Scene, count: int, degree: int, buried: Buried | None = None) -> Particles:
    """About `count` quadrature points of the given degree.

    At least one patch a triangle, unless `buried` is given: then triangles finer than patches have to be share one,
    that of a triangle which is not buried in an object. buried: from points and unit normals (M, 3) to bool (M,).
    """
    barycentric, shares = triangle_rule(degree)
    wanted = count / len(shares)
    contacts, emits = Contacts(*_binding.contacts(scene.triangles)), strong_emitters(scene)
    cut = _cut(scene, _edge_limits(scene, emits, wanted), contacts)
    if buried is not None and len(cut.patches) > 2 * wanted:
        cut = _grouped(scene, cut, emits | contacts.touched, wanted, buried)
    front, triangle = cut.patches, cut.triangle
    back = np.flatnonzero(scene.two_sided[triangle])
    patches = np.concatenate([front, front[back][:, [0, 2, 1]]])
    # Those of whole triangles: the parts of a sliver are thinner than their rounding.
    normals = _normals(scene.triangles)[triangle]
    normals = np.concatenate([normals, -normals[back]])
    triangle = np.concatenate([triangle, triangle[back]])
    of_patches = cut.areas, cut.solid, cut.radii, cut.whole
    areas, solid, radii, whole = (np.concatenate([values, values[back]]) for values in of_patches)

    per_patch = len(shares)
    positions, normals = (
        np.einsum("kc,pcx->pkx", barycentric, patches).reshape(-1, 3),
        np.repeat(normals, per_patch, axis=0),
    )
    # Surfaces in one place are one surface: what arrives there is not there twice.
    shining = scene.emission.any(axis=1) & (True if scene.opacity is None else scene.opacity.mean == 1)
    points = positions, normals, np.repeat(shining[triangle], per_patch)
    place = _binding.coincident(points, (scene.triangles, scene.two_sided, shining), SAME_PLACE * scene.size)
    return Particles(
        positions=positions,
        normals=normals,
        weights=(solid[:, None] * shares).ravel() * np.maximum(place, HIDDEN),
        hidden=place == 0,
        triangle=np.repeat(triangle, per_patch),
        emits=np.repeat(emits[triangle], per_patch),
        per_patch=per_patch,
        patches=np.ascontiguousarray(patches),
        areas=areas,
        radii=radii,
        whole=whole,
        rule=barycentric,
        shares=shares,
        edges=cut.edges,
        fractions=cut.fractions,
        parts=_with_backs(cut, back),
        solid=_solid(scene),
        origin=np.arange(len(patches)),
    )


def strong_emitters(scene: Scene) -> NDArray[np.bool_]:
    """(T,) which triangles emit more than the mean over the scene: where all surfaces emit, none stands out; and weak
    lamps, which a strong one hides from that.
    """
    areas, emission = triangle_areas(scene.triangles), scene.emission.sum(axis=1)
    bright = emission > 1.5 * (emission * areas).sum() / areas.sum()
    return bright if (emission[~bright] == 0).all() else bright | _weak_lamps(areas, emission)


def _weak_lamps(areas: NDArray[np.float64], emission: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(T,) which triangles lie on little of the scene's area, but emit much more than the mean over all that are no
    brighter.
    """
    found = np.zeros(len(emission), bool)
    order = np.argsort(emission, kind="stable")
    brightness, areas = emission[order], areas[order]
    # Of equally bright ones all count, or none.
    before, last = (np.searchsorted(brightness, brightness, side=side) for side in ("left", "right"))
    upto = np.append(0.0, np.cumsum(areas))
    mean = np.cumsum(brightness * areas)[last - 1] / upto[last]
    found[order] = (brightness > 3 * mean) & (upto[before] > (1 - LAMPS) * upto[-1])
    return found


def serve(particles: Particles, first: Scene, scene: Scene) -> bool:
    """Whether particles made for the lights and albedo of `first` do as well for those of `scene`, the same triangles.

    They do not where other triangles emit, or stand out as emitters, nor where a group has got albedos too far apart.
    """
    if (first.emission.any(axis=1) != scene.emission.any(axis=1)).any():
        return False
    # Each triangle that emits strongly has particles of its own.
    strong = np.zeros(len(scene.triangles), bool)
    strong[particles.triangle[particles.emits]] = True
    if (strong != strong_emitters(scene)).any():
        return False
    uncut = np.flatnonzero(particles.edges[: len(scene.triangles)] < 0)
    stand_in = particles.triangle[particles.per_patch * particles.parts[uncut, 0].astype(np.int64)]
    kinds = _kinds(scene)
    return bool((kinds[uncut] == kinds[stand_in]).all())


def _kinds(scene: Scene) -> NDArray[np.float64]:
    """(T,) a number for the surface of each triangle: only triangles of one kind are put together."""
    albedo = np.rint(ALBEDO_STEPS * scene.albedo)
    return (np.column_stack([albedo, scene.emission, scene.two_sided]) * _SPREAD).sum(axis=1)


def _solid(scene: Scene) -> NDArray[np.float64]:
    areas = triangle_areas(scene.triangles)
    return areas if scene.opacity is None else areas * scene.opacity.mean


class Contacts(NamedTuple):
    """Bisections of triangles along the lines where other meshes meet them, the first T nodes being the triangles.

    edges (K,), fractions (K,), parts (K, 2) as in `Particles`; touched (T,) whether another mesh touches at all
    """

    edges: NDArray[np.int8]
    fractions: NDArray[np.float64]
    parts: NDArray[np.uint32]
    touched: NDArray[np.bool_]


@dataclass(frozen=True)
class _Cut:
    """Patches (P, 3, 3) of the front sides, the triangle of each (P,), and the rest as in `Particles`."""

    patches: NDArray[np.float64]
    triangle: NDArray[np.int64]
    areas: NDArray[np.float64]
    solid: NDArray[np.float64]
    radii: NDArray[np.float64]
    whole: NDArray[np.bool_]
    edges: NDArray[np.int8]
    fractions: NDArray[np.float64]
    parts: NDArray[np.uint32]


def _normals(triangles: NDArray[np.float64]) -> NDArray[np.float64]:
    cross = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    return cross / lengths(cross)[:, None]


def triangle_areas(triangles: NDArray[np.float64]) -> NDArray[np.float64]:
    cross = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    return lengths(cross) / 2


def _with_backs(cut: _Cut, back: NDArray[np.int64]) -> NDArray[np.uint32]:
    """The parts of a bisection, with the patches at the backs where there are any."""
    backs = np.full(len(cut.patches), NO_PATCH, np.uint32)
    backs[back] = len(cut.patches) + np.arange(len(back))
    leaves = cut.edges < 0
    parts = cut.parts.copy()
    parts[leaves, 1] = backs[parts[leaves, 0]]
    return parts


def _grouped(scene: Scene, cut: _Cut, single: NDArray[np.bool_], wanted: float, buried: Buried) -> _Cut:
    """The same with one patch for each group of uncut triangles, but for those (T,) that have to stay single."""
    count = len(scene.triangles)
    fine = np.flatnonzero((cut.edges[:count] < 0) & ~single)
    if len(fine) == 0:
        return cut
    area = triangle_areas(scene.triangles[fine])
    kinds = np.unique(_kinds(scene)[fine], return_inverse=True)[1].astype(np.uint32)
    share = area.sum() / triangle_areas(scene.triangles).sum()
    group = _binding.group(np.ascontiguousarray(scene.triangles[fine]), kinds, max(1, round(wanted * share)))

    areas = np.bincount(group, area)
    centres = centroids(scene.triangles[fine])
    means = np.stack([np.bincount(group, area * centres[:, axis]) for axis in range(3)], axis=1) / areas[:, None]
    off_centre = lengths(centres - means[group])
    # The triangle nearest to the mean stands for its group, of those that are not inside another object if there are
    # any: what is inside is seen by nobody.
    several, inside = np.bincount(group)[group] > 1, np.zeros(len(fine), bool)
    inside[several] = buried(centres[several], _normals(scene.triangles[fine[several]]))
    order = np.lexsort([off_centre, inside, group])
    chosen = order[np.unique(group[order], return_index=True)[1]]
    spread = largest(lengths(scene.triangles[fine] - centres[chosen][group][:, None]))
    radii = np.zeros(len(areas))
    np.maximum.at(radii, group, spread)

    kept = np.ones(len(cut.patches), bool)
    kept[cut.parts[fine, 0]] = False
    number = np.cumsum(kept) - 1
    parts, leaves = cut.parts.copy(), cut.edges < 0
    parts[leaves, 0] = number[parts[leaves, 0]]
    parts[fine, 0] = np.count_nonzero(kept) + group
    members = np.bincount(group)
    return _Cut(
        patches=np.concatenate([cut.patches[kept], scene.triangles[fine[chosen]]]),
        triangle=np.concatenate([cut.triangle[kept], fine[chosen]]),
        areas=np.concatenate([cut.areas[kept], areas]),
        solid=np.concatenate([cut.solid[kept], np.bincount(group, _solid(scene)[fine])]),
        radii=np.concatenate([cut.radii[kept], radii]),
        whole=np.concatenate([cut.whole[kept], members == 1]),
        edges=cut.edges,
        fractions=cut.fractions,
        parts=parts,
    )


def _edge_limits(scene: Scene, emits: NDArray[np.bool_], patch_count: float) -> NDArray[np.float64]:
    """(T,) longest edge that a patch of each triangle may have, so that about `patch_count` patches come out, more of
    them on those (T,) that emit strongly: by area, so that other power of lamps calls for no other patches.
    """
    areas = triangle_areas(scene.triangles)
    lamps = areas * emits
    share = (1 - EMITTER_SHARE) * areas / areas.sum() + EMITTER_SHARE * lamps / (lamps.sum() or 1.0)
    # A right isosceles triangle of longest edge h has the area h^2 / 4; bisection makes them half as large on average.
    return np.sqrt(4 * 1.5 * areas / (share * patch_count))


def _cut(scene: Scene, limits: NDArray[np.float64], contacts: Contacts) -> _Cut:
    """Cuts triangles where they are met by others, then bisects longest edges until each patch fits."""
    todo, owner = scene.triangles, np.arange(len(scene.triangles))
    # Where each one stands in the bisection by contacts, below which -1 is.
    contact = owner
    patches, owners, edges_of_nodes, fractions, parts = [], [], [], [], []
    nodes = patch_count = 0
    while len(todo):
        met = (contact >= 0) & (contacts.edges[contact] >= 0)
        edge = np.where(met, contacts.edges[contact], _edge_to_cut(todo, limits[owner]))
        fraction = np.where(met, contacts.fractions[contact], 0.5)
        large = edge >= 0
        patches.append(todo[~large])
        owners.append(owner[~large])
        edges_of_nodes.append(edge.astype(np.int8))
        fractions.append(fraction)
        parts.append(_numbered(large, nodes + len(todo), patch_count))
        nodes, patch_count = nodes + len(todo), patch_count + len(patches[-1])
        below = np.where(met[:, None], contacts.parts[contact].astype(np.int64), -1)
        contact = below[large].T.ravel()
        todo, owner = bisect(todo[large], edge[large], fraction[large]), np.tile(owner[large], 2)
    patches = np.concatenate(patches)
    triangle, areas = np.concatenate(owners), triangle_areas(patches)
    return _Cut(
        patches=patches,
        triangle=triangle,
        areas=areas,
        solid=areas if scene.opacity is None else areas * scene.opacity.mean[triangle],
        radii=largest(lengths(patches - centroids(patches)[:, None])),
        whole=np.ones(len(patches), bool),
        edges=np.concatenate(edges_of_nodes),
        fractions=np.concatenate(fractions),
        parts=np.concatenate(parts),
    )


def _edge_to_cut(triangles: NDArray[np.float64], limits: NDArray[np.float64]) -> NDArray[np.int64]:
    """(T,) the longest edge of each triangle that is too large, -1 for one whose edges fit their limit (T,)."""
    edges = np.roll(triangles, -1, axis=1) - triangles
    squared = np.einsum("tex,tex->te", edges, edges)
    most = largest(squared)
    longest = (squared > (1 - ROUNDING) * most[:, None]).argmax(axis=1)
    areas = triangle_areas(triangles)
    large = (most > (1 + ROUNDING) * limits**2) & (areas > limits**2 / SLIVER)
    return np.where(large, longest, -1)


def _numbered(large: NDArray[np.bool_], nodes: int, patches: int) -> NDArray[np.uint32]:
    """(n, 2) both halves of the nodes that are cut, from number `nodes` on; the others' patch, and none behind."""
    parts = np.empty((len(large), 2), np.uint32)
    count = np.count_nonzero(large)
    parts[large] = nodes + np.arange(count)[:, None] + [0, count]
    parts[~large] = np.column_stack([patches + np.arange(len(large) - count), np.full(len(large) - count, NO_PATCH)])
    return parts


def bisect(
    triangles: NDArray[np.float64], edge: NDArray[np.int64], fraction: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Both halves (2T, 3, 3) of each triangle, cut at the given share of the given edge."""
    rows = np.arange(len(triangles))
    a, b, c = (triangles[rows, (edge + i) % 3] for i in range(3))
    middle = a + fraction[:, None] * (b - a)
    return np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
