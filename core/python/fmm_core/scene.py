# SPDX-License-Identifier: GPL-3.0-or-later
"""The scene: triangles with albedo and emission, checked once."""

import copy
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _binding
from .arrays import LARGEST, bounds, largest, lengths, numbers
from .errors import Error
from .lights import Light, checked_lights
from .medium import Volume, absorption, checked_volumes
from .opacity import Opacity
from .sky import Sky

#: Artists set albedo to 1 all the time; light would then never die out.
MAX_ALBEDO = 0.999
#: Below this products of coordinates vanish.
SMALLEST = 1e-60
#: Scenes whose centre is this many times their size away from the origin are moved there.
FAR = 10.0
#: Tells the corners of triangles apart by one number each.
_SPREAD = np.random.default_rng(0).random(9)


class Shade(NamedTuple):
    """What stands in the way of lamps and sky: triangles (S, 3, 3), and their opacity, None where all of it is 1."""

    triangles: NDArray[np.float64]
    opacity: Opacity | None


class Scene:
    """Triangles in world space with their materials, validated; arrays are read-only float64.

    triangles   (T, 3, 3) corners, counter-clockwise seen from the front
    albedo      (T, 3) or (T,) or a constant, share of light reflected, in [0, 1); larger is clamped with a warning
    emission    (T, 3) or (T,) or a constant, radiant exitance, W/m^2
    two_sided   (T,) or a constant bool: the back reflects and emits like the front
    opacity     (T,) or a constant in [0, 1], or an `Opacity`: the share of the light that a triangle stops, of which it
                reflects its albedo; emission is that of the part which is there. None once all of it is 1.
    lights      lamps, see `lights.py`
    sky         what shines from all around, or None
    glossy      how many places an eye is to see the gloss of, by `Solution.radiance`
    shade       as opacity: the share of the light of lamps and sky that a triangle stops, where that is not its
                opacity, which then is for light of surfaces alone; afterwards a `Shade`, or None where none is given
    medium      (3,) or a constant, 1/m: how much of each colour is absorbed by what fills all space between the
                surfaces; it lets nothing through that comes from infinitely far away
    volumes     closed meshes that absorb light inside, besides, see `medium.py`; they block none
    warnings    what was changed or left out, one line each
    origin      (3,) where the coordinates of the triangles count from, 0 as given

    Triangles without area are left out with a warning, wholly transparent ones without, and of those that are there
    twice, and would shine twice, all but the most opaque and brightest with one; `triangle_indices` (T',) says which
    ones remain.
    Raises `Error` naming the array, the row and the value.
    """

    def __init__(
        self,
        triangles: ArrayLike,
        albedo: ArrayLike = 0.8,
        emission: ArrayLike = 0.0,
        two_sided: ArrayLike = False,
        opacity: ArrayLike | Opacity = 1.0,
        lights: Sequence[Light] = (),
        sky: Sky | None = None,
        glossy: int = 0,
        shade: ArrayLike | Opacity | None = None,
        medium: ArrayLike = 0.0,
        volumes: Sequence[Volume] = (),
    ) -> None:
        corners = numbers("triangles", triangles)
        if corners.ndim != 3 or corners.shape[1:] != (3, 3):
            raise Error(f"triangles: expected shape (T, 3, 3), got {corners.shape}")
        if len(corners) == 0:
            raise Error("triangles: the scene is empty")
        _check_finite("triangles", corners)
        reflected = _colours("albedo", albedo, len(corners))
        emitted = _colours("emission", emission, len(corners))
        sides = _flags("two_sided", two_sided, len(corners))
        stopped = _opacity("opacity", opacity, len(corners))

        self.warnings: list[str] = []
        self._given = len(corners)
        kept = self._with_area(corners)
        self.shade = None if shade is None else _shade(corners, kept, _opacity("shade", shade, len(corners)))
        kept &= stopped.mean > 0
        if not kept.any():
            raise Error("opacity: no triangle with an area stops any light")
        kept[kept] = self._once(corners[kept], [stopped.mean[kept], emitted[kept].sum(axis=1)], sides[kept])
        self.triangle_indices = _frozen(np.flatnonzero(kept))
        self.triangles = _frozen(corners[kept])
        self.albedo = _frozen(self._clamped(reflected[kept]))
        self.emission = _frozen(emitted[kept])
        self.two_sided = _frozen(sides[kept])
        self.opacity = None if stopped.of(kept).is_whole else stopped.of(kept)
        self.centre, self.size = _bounds(np.concatenate([self.triangles, self.shading.triangles]))
        if self.size < SMALLEST:
            raise Error(f"triangles: the scene is {self.size:g} across, expected at least {SMALLEST:g}")
        self.origin = np.zeros(3)
        self.lights, self.sky = checked_lights(lights), _checked_sky(sky)
        self.glossy = glossy
        self.medium, self.volumes = absorption("medium", medium), checked_volumes(volumes)
        self._check_lit()

    @property
    def shading(self) -> Shade:
        """What stands in the way of lamps and sky."""
        return self.shade or Shade(self.triangles, self.opacity)

    @property
    def is_grey(self) -> bool:
        """Whether all light and all surfaces have the same value in each colour."""
        colours = [self.albedo, self.emission, *(light.colour for light in self.lights)]
        colours += [] if self.sky is None else [self.sky.radiance]
        return self.absorbs_grey and all((values == values[..., :1]).all() for values in colours)

    @property
    def absorbs(self) -> bool:
        """Whether anything absorbs light on its way."""
        return bool(self.medium.any()) or len(self.volumes) > 0

    @property
    def absorbs_grey(self) -> bool:
        """Whether that takes the same share of each colour."""
        return all((one == one[0]).all() for one in (self.medium, *(volume.absorption for volume in self.volumes)))

    def what_absorbs(self) -> _binding.Medium:
        """What is asked how much light is left after its way."""
        volumes = [(volume.triangles, tuple(volume.absorption.tolist())) for volume in self.volumes]
        return _binding.Medium(tuple(self.medium.tolist()), volumes)

    def grey(self) -> "Scene":
        """The same scene with the mean over the colours in place of each."""
        scene = copy.copy(self)
        scene.albedo, scene.emission = _frozen(_mean(self.albedo)), _frozen(_mean(self.emission))
        scene.lights = tuple(light.with_colour(_mean(light.colour)) for light in self.lights)
        scene.sky = None if self.sky is None else Sky(_mean(self.sky.radiance))
        scene.medium = _frozen(_mean(self.medium))
        scene.volumes = tuple(volume.with_absorption(_mean(volume.absorption)) for volume in self.volumes)
        return scene

    def within_medium(self) -> "Scene":
        """The same scene with what is left of the light from infinitely far away."""
        scene, passes = copy.copy(self), self.medium == 0
        if passes.all():
            return scene
        suns = (light.with_colour(light.colour * passes) if light.is_far else light for light in self.lights)
        scene.lights = tuple(suns)
        scene.sky = None if self.sky is None else _checked_sky(Sky(self.sky.radiance * passes))
        return scene

    def only(self, rows: NDArray) -> "Scene":
        """The same with some of its triangles (T,), by number or by whether they are among them; opacity is to be 1."""
        scene = copy.copy(self)
        for name in ("triangle_indices", "triangles", "albedo", "emission", "two_sided"):
            setattr(scene, name, _frozen(np.ascontiguousarray(getattr(self, name)[rows])))
        return scene

    def near_origin(self) -> "Scene":
        """The scene, moved to the origin if it is so far away that its coordinates are coarse against its size."""
        if np.abs(self.centre).max() <= FAR * self.size:
            return self
        scene = copy.copy(self)
        scene.triangles = _frozen(np.ascontiguousarray(self.triangles - self.centre))
        if self.shade is not None:
            scene.shade = self.shade._replace(triangles=_frozen(self.shade.triangles - self.centre))
        scene.origin, scene.centre = self.origin + self.centre, np.zeros(3)
        scene.lights = tuple(light.moved(-self.centre) for light in self.lights)
        scene.volumes = tuple(volume.moved(-self.centre) for volume in self.volumes)
        return scene

    def relit(
        self,
        emission: ArrayLike | None = None,
        albedo: ArrayLike | None = None,
        lights: Sequence[Light] | None = None,
        sky: Sky | None = None,
        glossy: int | None = None,
    ) -> "Scene":
        """The same triangles with other light or albedo, given for the same rows; None keeps what there is."""
        scene = copy.copy(self)
        scene.glossy = self.glossy if glossy is None else glossy
        scene.warnings = list(self.warnings)
        if lights is not None:
            scene.lights = tuple(light.moved(-self.origin) for light in checked_lights(lights))
        if sky is not None:
            scene.sky = _checked_sky(sky)
        if emission is not None:
            scene.emission = _frozen(_colours("emission", emission, self._given)[self.triangle_indices])
        scene._check_lit()
        if albedo is not None:
            scene.warnings = [text for text in scene.warnings if not text.startswith("albedo ")]
            scene.albedo = _frozen(scene._clamped(_colours("albedo", albedo, self._given)[self.triangle_indices]))
        return scene

    def same_geometry(self, other: "Scene") -> bool:
        """Whether another scene was given the same triangles with the same sides and opacity, in the same medium."""
        names = "triangles", "origin", "triangle_indices", "two_sided", "medium"
        same = all(np.array_equal(getattr(self, name), getattr(other, name)) for name in names)
        same &= len(self.volumes) == len(other.volumes)
        same &= all(mine.same(yours) for mine, yours in zip(self.volumes, other.volumes, strict=False))
        if (self.shade is None) != (other.shade is None):
            return False
        same &= self.shade is None or np.array_equal(self.shade.triangles, other.shade.triangles)
        opacities = (self.opacity, other.opacity), (self.shading.opacity, other.shading.opacity)
        return same and self._given == other._given and all(_same(*pair) for pair in opacities)

    def _check_lit(self) -> None:
        if not self.emission.any() and not any(light.colour.any() for light in self.lights) and self.sky is None:
            raise Error(
                "emission: the scene has no emitter, every triangle's emission is 0, and no lamp and no sky that shines"
            )
        if 0 < self.emission.max() < SMALLEST:
            raise Error(f"emission: the brightest triangle's is {self.emission.max():g}, expected {SMALLEST:g} or more")

    def _with_area(self, corners: NDArray[np.float64]) -> NDArray[np.bool_]:
        edges = corners - np.roll(corners, 1, axis=1)
        longest = largest(lengths(edges))
        double_area = lengths(np.cross(edges[:, 1], edges[:, 2]))
        # A height of 1e-12 of the longest edge or of the distance from the origin is rounding, not geometry.
        height_floor = 1e-12 * np.maximum(longest, largest(np.abs(corners).reshape(-1, 9)))
        kept = double_area > longest * height_floor
        if not kept.any():
            raise Error(f"triangles: all {len(corners)} have no area")
        if not kept.all():
            count = len(kept) - np.count_nonzero(kept)
            self.warnings.append(f"{count} of {len(kept)} triangles have no area and are left out")
        return kept

    def _once(
        self, corners: NDArray[np.float64], ranks: list[NDArray[np.float64]], two_sided: NDArray[np.bool_]
    ) -> NDArray[np.bool_]:
        """(T,) without those that have the corners of another one, higher in rank, and no side that this has not."""
        order = np.lexsort(corners.transpose(2, 0, 1), axis=1)
        # Adding 0 makes -0 equal to 0.
        places = np.take_along_axis(corners, order[:, :, None], axis=1).reshape(-1, 9) + 0.0
        turned = (order[:, 1] - order[:, 0]) % 3 == 2
        # Few are there twice: single numbers sort faster than rows, and tell most of them apart.
        _, number, count = np.unique((places * _SPREAD).sum(axis=1), return_inverse=True, return_counts=True)
        several = np.flatnonzero(count[number] > 1)
        _, place = np.unique(places[several], axis=0, return_inverse=True)
        place = place.reshape(-1)
        ranked = np.lexsort([*(-rank[several] for rank in reversed(ranks)), ~two_sided[several], place])
        both = np.zeros(len(several), bool)
        both[place[two_sided[several]]] = True
        side = np.where(both[place], 0, 1 + turned[several])
        _, first = np.unique(np.column_stack([place, side])[ranked], axis=0, return_index=True)
        kept = np.ones(len(corners), bool)
        kept[several] = False
        kept[several[ranked[first]]] = True
        if not kept.all():
            count = len(kept) - np.count_nonzero(kept)
            self.warnings.append(f"{count} of {self._given} triangles are there twice and are left out once")
        return kept

    def _clamped(self, albedo: NDArray[np.float64]) -> NDArray[np.float64]:
        if albedo.max() > MAX_ALBEDO:
            self.warnings.append(f"albedo {albedo.max():g} is clamped to {MAX_ALBEDO}")
        return np.minimum(albedo, MAX_ALBEDO)


def _colours(name: str, values: ArrayLike, count: int) -> NDArray[np.float64]:
    colours = numbers(name, values)
    if colours.shape in ((), (count,)):
        colours = colours[..., None]
    elif colours.shape != (count, 3):
        raise Error(f"{name}: expected shape ({count}, 3), ({count},) or a constant, got {colours.shape}")
    colours = np.ascontiguousarray(np.broadcast_to(colours, (count, 3)))
    _check_finite(name, colours)
    if colours.min() < 0:
        row = int(np.flatnonzero((colours < 0).any(axis=1))[0])
        raise Error(f"{name}: triangle {row} has a negative value, {colours[row].min():g}")
    return colours


def _opacity(name: str, values: ArrayLike | Opacity, count: int) -> Opacity:
    if not isinstance(values, Opacity):
        shares = numbers(name, values)
        values = Opacity(np.broadcast_to(shares, (count,)) if shares.ndim == 0 else shares)
    if len(values.mean) != count:
        raise Error(f"{name}: expected {count} rows like triangles, got {len(values.mean)}")
    return values


def _shade(corners: NDArray[np.float64], kept: NDArray[np.bool_], stopped: Opacity) -> Shade:
    """Of triangles (T, 3, 3) of which some (T,) have an area."""
    stops = kept & (stopped.mean > 0)
    left = stopped.of(stops)
    return Shade(_frozen(corners[stops]), None if left.is_whole else left)


def _same(one: Opacity | None, other: Opacity | None) -> bool:
    return one is other is None or (one is not None and other is not None and one.same(other))


def _checked_sky(sky: Sky | None) -> Sky | None:
    """A sky that shines, or None."""
    if not isinstance(sky, Sky | None):
        raise Error(f"sky: expected a Sky or None, got {type(sky).__name__}")
    return None if sky is None or sky.is_black else sky


def _mean(colours: NDArray[np.float64]) -> NDArray[np.float64]:
    """The mean over the colours, which are last, as a grey of the same shape."""
    return np.repeat(colours.mean(axis=-1, keepdims=True), 3, axis=-1)


def _flags(name: str, values: ArrayLike, count: int) -> NDArray[np.bool_]:
    flags = numbers(name, values)
    if not np.isin(flags, (0.0, 1.0)).all():
        raise Error(f"{name}: expected True or False, got {flags[~np.isin(flags, (0.0, 1.0))][0]}")
    flags = flags.astype(bool)
    if flags.shape not in ((), (count,)):
        raise Error(f"{name}: expected shape ({count},) or a constant, got {flags.shape}")
    return np.array(np.broadcast_to(flags, (count,)))


def _check_finite(name: str, values: NDArray[np.float64]) -> None:
    wrong = ~(np.abs(values) <= LARGEST)
    if wrong.any():
        where = tuple(int(i) for i in np.argwhere(wrong)[0])
        raise Error(f"{name}: triangle {where[0]} has the value {values[where]}")


def _bounds(triangles: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    low, high = bounds(triangles)
    return (low + high) / 2, float((high - low).max())


def _frozen(array: NDArray) -> NDArray:
    array.flags.writeable = False
    return array
