# SPDX-License-Identifier: GPL-3.0-or-later
"""Which effects a scene calls for, decided from its arrays before any work starts; the others cost nothing."""

import copy
from dataclasses import dataclass
from functools import partial

import numpy as np

from . import _binding
from .convexity import Planes
from .scene import Scene
from .settings import EFFECTS, Settings


@dataclass(frozen=True)
class Effect:
    """Whether an effect is simulated, and why it is or is not, in words for the user."""

    used: bool
    why: str


def plan(scene: Scene, settings: Settings) -> dict[str, Effect]:
    """The effects of a scene by name, those of `settings.EFFECTS`.

    Where the settings force one, its reason says so; what the scene does not have at all cannot be forced on.
    """
    # Both ask the same planes.
    planes = Planes(scene.triangles, scene.size, scene.triangles.reshape(-1, 3))
    geometric = partial(_occlusion, planes), partial(_interreflection, planes)
    decisions = (*geometric, _colour, _lamps, _sky, _transparency, _two_sided, _glossy, _medium)
    # The paper's own algorithm asks rays in any scene.
    forced = {"occlusion": True} if settings.visibility == "cells" else {}
    forced |= settings.effects
    inside = _within(scene, forced.get("medium") is not False)
    named = zip(EFFECTS, decisions, strict=True)
    found = {name: _forced(decide(scene if name == "medium" else inside), forced.get(name)) for name, decide in named}
    if scene.sky is not None and inside.sky is None:
        found["sky"] = Effect(False, "no light of the sky gets through the medium")
    if _lamps(scene).used and not _lamps(inside).used:
        found["lamps"] = Effect(False, "no lamp's light gets through the medium: suns are infinitely far away")
    return found


def planned(scene: Scene, effects: dict[str, Effect]) -> Scene:
    """The scene without what is not simulated."""
    unused = {name for name, effect in effects.items() if not effect.used}
    left = _within(scene, "medium" not in unused)
    if "interreflection" in unused:
        left.albedo = np.zeros_like(scene.albedo)
    if "lamps" in unused:
        left.lights = ()
    if "sky" in unused:
        left.sky = None
    if "transparency" in unused:
        left.opacity = None
    if "two_sided" in unused:
        left.two_sided = np.zeros_like(scene.two_sided)
    if "glossy" in unused:
        left.glossy = 0
    if "colour" in unused and not scene.is_grey:
        left = left.grey()
    return left


def _within(scene: Scene, medium: bool) -> Scene:
    """The scene with what its medium lets in, or without it."""
    if medium:
        return scene.within_medium()
    left = copy.copy(scene)
    left.medium, left.volumes = np.zeros(3), ()
    return left


def _forced(effect: Effect, wanted: bool | None) -> Effect:
    if wanted is None or effect.used == wanted:
        return effect
    if effect.why.startswith("no "):
        return Effect(False, f"cannot be switched on: {effect.why}")
    return Effect(wanted, f"switched {'on' if wanted else 'off'} ({effect.why})")


def _occlusion(planes: Planes, scene: Scene) -> Effect:
    if planes.some_stand_between():
        return Effect(True, "a surface can stand between two others")
    shading = planes
    if scene.shade is not None:
        shading = Planes(scene.shade.triangles, scene.size, scene.triangles.reshape(-1, 3))
    for light in scene.lights:
        if light.shadows and not shading.nothing_between(*light.extent):
            return Effect(True, "a surface can stand between a lamp and another one")
    if scene.sky is not None and (scene.shade is not None or _some_face(planes, scene)):
        return Effect(True, "surfaces hide parts of the sky from each other")
    return Effect(False, "nothing can be in the way: no surface has others on both sides of its plane")


def _interreflection(planes: Planes, scene: Scene) -> Effect:
    if not scene.albedo.any():
        return Effect(False, "no surface reflects anything: all are black")
    if not _some_face(planes, scene):
        return Effect(False, "no surface faces another one")
    return Effect(True, f"surfaces reflect up to {scene.albedo.max():.0%} of the light")


def _some_face(planes: Planes, scene: Scene) -> bool:
    """Whether a surface may face another one, with its back if it has two sides."""
    backs = scene.triangles[scene.two_sided][:, ::-1]
    return planes.some_face() or Planes(backs, scene.size, scene.triangles.reshape(-1, 3)).some_face()


def _colour(scene: Scene) -> Effect:
    if scene.is_grey:
        return Effect(False, "all light and all surfaces are grey: one channel is solved for three")
    return Effect(True, "light or surfaces have colours")


def _lamps(scene: Scene) -> Effect:
    count = sum(bool(light.colour.any()) for light in scene.lights)
    return Effect(True, f"{count} of them") if count else Effect(False, "no lamp gives light")


def _sky(scene: Scene) -> Effect:
    if scene.sky is None:
        return Effect(False, "no light comes from the sky")
    if (
        scene.shade is None
        and scene.opacity is None
        and not scene.two_sided.any()
        and _binding.is_sealed(scene.triangles)
    ):
        return Effect(False, "everything is inside a mesh without openings")
    return Effect(True, "light comes from outside of the scene")


def _transparency(scene: Scene) -> Effect:
    if scene.opacity is None:
        return Effect(False, "no surface lets light through")
    return Effect(True, f"{np.count_nonzero(scene.opacity.mean < 1)} triangles let light through")


def _two_sided(scene: Scene) -> Effect:
    count = np.count_nonzero(scene.two_sided)
    if not count:
        return Effect(False, "no triangle is seen from both sides")
    return Effect(True, f"{count} triangles are seen from both sides")


def _glossy(scene: Scene) -> Effect:
    if not scene.glossy:
        return Effect(False, "no gloss is to be seen by an eye")
    return Effect(True, f"{scene.glossy} places shine towards an eye")


def _medium(scene: Scene) -> Effect:
    if not scene.absorbs:
        return Effect(False, "no medium absorbs light")
    if not scene.medium.any():
        meshes = "1 mesh" if len(scene.volumes) == 1 else f"{len(scene.volumes)} meshes"
        return Effect(True, f"light is absorbed inside {meshes}")
    return Effect(True, f"a medium takes half of the light on {np.log(2) / scene.medium.max():.3g} m")
