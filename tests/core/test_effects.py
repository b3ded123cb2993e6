# SPDX-License-Identifier: GPL-3.0-or-later
"""Only the effects that a scene calls for: what is left out is not done, and what is needed is missed without."""

import sys

import fmm_core
import numpy as np
import pytest
import shapes
from fmm_core import Gloss, PointLight, Sky, SunLight
from fmm_core.effects import plan
from fmm_core.settings import EFFECTS
from test_visibility import LAMP, block

ROOM = shapes.room()
FLOOR = shapes.quad([0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0])
BOX = block([0.3, 0.3, 0.1], [0.6, 0.6, 0.4])
FURNISHED = np.concatenate([ROOM, LAMP, BOX])
LIT = np.where(np.arange(len(FURNISHED)) // 2 == 6, 10.0, 0.0)
AWAY = np.where(np.arange(len(FURNISHED))[:, None] < 4, [0.8, 0.2, 0.1], 0.5)


def scenes():
    """Scenes by name, with the effects that each calls for."""
    leaf = fmm_core.Opacity(np.where(np.arange(len(FURNISHED)) < 14, 1.0, 0.1))
    lamp, sun = PointLight((0.5, 0.5, 0.8), 1.0), SunLight((0, 0, -1), 1.0)
    dark = PointLight((0.5, 0.5, 0.8), 0.0)
    reflecting, blocked = {"interreflection"}, {"interreflection", "occlusion"}
    return {
        "grey furnace": (fmm_core.Scene(ROOM, 0.5, 1.0), reflecting),
        "red furnace": (fmm_core.Scene(ROOM, [[0.5, 0.1, 0.1]] * 12, 1.0), reflecting | {"colour"}),
        "black room": (fmm_core.Scene(FURNISHED, 0.0, LIT), {"occlusion"}),
        "furnished room": (fmm_core.Scene(FURNISHED, AWAY, LIT), blocked | {"colour"}),
        "body in the sun": (fmm_core.Scene(BOX, 0.5, lights=[sun]), {"lamps", "occlusion"}),
        "floor under the sky": (fmm_core.Scene(FLOOR, 0.5, sky=Sky(1.0)), {"sky"}),
        "floor and box under the sky": (fmm_core.Scene([*FLOOR, *BOX], 0.5, sky=Sky(1.0)), blocked | {"sky"}),
        "lamp in a bare room": (fmm_core.Scene(ROOM, 0.5, lights=[lamp]), reflecting | {"lamps"}),
        "sealed room": (fmm_core.Scene(FURNISHED, 0.5, LIT, sky=Sky(1.0)), blocked),
        "room with a window": (fmm_core.Scene(FURNISHED[1:], 0.5, LIT[1:], sky=Sky(1.0)), blocked | {"sky"}),
        "glass box": (fmm_core.Scene(FURNISHED, 0.5, LIT, opacity=leaf), blocked | {"transparency"}),
        "room with a lamp": (fmm_core.Scene(FURNISHED, 0.5, LIT, lights=[lamp]), blocked | {"lamps"}),
        "room with a dark lamp": (fmm_core.Scene(FURNISHED, 0.5, LIT, lights=[dark]), blocked),
        "smoky room": (fmm_core.Scene(FURNISHED, 0.5, LIT, medium=1.0), blocked | {"medium"}),
        "shining floor": (fmm_core.Scene(FLOOR, 0.5, lights=[lamp], glossy=4), {"lamps", "glossy"}),
        "open mesh": (fmm_core.Scene([*FLOOR, *(FLOOR + [0, 0, 1])], 0.5, 1.0, True), reflecting | {"two_sided"}),
    }


SCENES = scenes()


def solved(scene, **effects):
    """A solution, and the irradiance at some points, or the radiance of metal there towards an eye."""
    settings = fmm_core.Settings(particles=800, probes=0, method="fmm", effects=effects)
    solution, points = fmm_core.solve(scene, settings), shapes.random_points(scene.triangles, 8)
    found = solution.irradiance(*points)
    if scene.glossy:
        metal = Gloss(np.broadcast_to([0.6, 0.0, 0.8], found.shape), 0.0, 0.5, 1.0, roughness=0.3)
        found = solution.radiance(*points, metal, found)
    return solution, found


@pytest.mark.parametrize("name", SCENES)
def test_a_scene_gets_the_effects_that_it_calls_for(name):
    scene, wanted = SCENES[name]
    effects = plan(scene, fmm_core.Settings())
    assert list(effects) == list(EFFECTS)
    assert {effect for effect, found in effects.items() if found.used} == wanted
    solution, _ = solved(scene)
    assert solution.report["effects"] == {
        effect: {"used": found.used, "why": found.why} for effect, found in effects.items()
    }


@pytest.mark.parametrize("name", [name for name, (_, wanted) in SCENES.items() if "occlusion" not in wanted])
def test_where_nothing_is_in_the_way_no_ray_is_traced(name):
    solution, found = solved(SCENES[name][0])
    counts = solution.report["counts"]
    assert counts["rays"] == 0 or "sky" in SCENES[name][1]
    forced = solved(SCENES[name][0], occlusion=True)[1]
    assert found == pytest.approx(forced, rel=2e-2, abs=1e-9)


def test_black_surfaces_reflect_nothing():
    solution, found = solved(SCENES["black room"][0])
    assert solution.report["residuals"] == []
    assert solution.report["counts"]["boxes"] == 0
    other, nearly = solved(fmm_core.Scene(FURNISHED, 1e-4, LIT))
    assert len(other.report["residuals"]) > 0
    assert np.linalg.norm(found - nearly) < 1e-2 * np.linalg.norm(nearly)
    assert solution.report["counts"]["rays"] < 0.8 * other.report["counts"]["rays"]


def test_no_ray_of_the_sky_goes_into_a_sealed_room():
    solution, found = solved(SCENES["sealed room"][0])
    forced, same = solved(SCENES["sealed room"][0], sky=True)
    assert found == pytest.approx(same, rel=1e-9)
    assert solution.report["counts"]["rays"] < forced.report["counts"]["rays"]


#: For each effect a scene that needs it, one that does not, and what is done for it, which is counted.
NEEDED = {
    "occlusion": ("furnished room", "red furnace", "rays"),
    "interreflection": ("furnished room", "black room", "boxes"),
    "colour": ("furnished room", "sealed room", "channels"),
    "lamps": ("room with a lamp", "room with a dark lamp", "rays"),
    "sky": ("room with a window", "sealed room", "rays"),
    "transparency": ("glass box", "furnished room", "rays"),
    "two_sided": ("open mesh", "grey furnace", "particles"),
    "glossy": ("shining floor", "lamp in a bare room", "tables"),
    # It makes the same sums slower, which no counter tells.
    "medium": ("smoky room", "furnished room", None),
}


def test_every_effect_is_in_the_table():
    assert list(NEEDED) == list(EFFECTS)


@pytest.mark.parametrize("effect", NEEDED)
def test_a_scene_that_needs_an_effect_is_wrong_without(effect):
    scene = SCENES[NEEDED[effect][0]][0]
    _, right = solved(scene)
    solution, wrong = solved(scene, **{effect: False})
    assert not solution.report["effects"][effect]["used"]
    assert solution.report["effects"][effect]["why"].startswith("switched off")
    error = np.linalg.norm(wrong - right) / np.linalg.norm(right)
    sys.stdout.write(f"{NEEDED[effect][0]} without {effect}: {100 * error:.0f} % off\n")
    assert error > 0.05


@pytest.mark.parametrize("effect", [effect for effect, (_, _, counter) in NEEDED.items() if counter])
def test_what_is_left_out_is_not_done(effect):
    """A scene that does not call for it costs what it costs without, and one that does costs more."""
    needing, sparing, counter = NEEDED[effect]
    assert effect in SCENES[needing][1]
    assert effect not in SCENES[sparing][1]
    with_it, without, spared, forced_off = (
        solved(SCENES[name][0], **forced)[0].report["counts"][counter]
        for name in (needing, sparing)
        for forced in ({}, {effect: False})
    )
    assert with_it > without
    assert spared == forced_off


def test_what_a_scene_does_not_have_cannot_be_forced_on():
    effects = plan(SCENES["grey furnace"][0], fmm_core.Settings(effects={"sky": True, "lamps": True}))
    assert not effects["sky"].used
    assert not effects["lamps"].used
    assert effects["sky"].why == "cannot be switched on: no light comes from the sky"
    same = plan(SCENES["grey furnace"][0], fmm_core.Settings(effects={"sky": False}))
    assert same["sky"].why == "no light comes from the sky"


def test_effects_that_there_are_not_are_refused():
    with pytest.raises(fmm_core.Error, match=r"effects: expected one of occlusion, .*, got 'fog'"):
        fmm_core.Settings(effects={"fog": True})
    with pytest.raises(fmm_core.Error, match="effects: expected True or False for sky, got 1"):
        fmm_core.Settings(effects={"sky": 1})
    with pytest.raises(fmm_core.Error, match="effects: expected names"):
        fmm_core.Settings(effects=["sky"])


def test_relight_takes_up_effects_that_the_first_lights_did_not_call_for():
    points = shapes.random_points(FURNISHED, 8)
    settings = fmm_core.Settings(particles=800, probes=0, method="fmm")
    black = fmm_core.solve(fmm_core.Scene(FURNISHED, 0.0, LIT), settings)
    fresh = fmm_core.solve(fmm_core.Scene(FURNISHED, AWAY, LIT), settings)
    assert black.relight(albedo=AWAY).irradiance(*points) == pytest.approx(fresh.irradiance(*points), rel=1e-6)

    # A lamp outside of a room shines through no wall, which an open room had no rays for.
    open_room = fmm_core.solve(fmm_core.Scene(ROOM, 0.5, 1.0), settings)
    lamp = PointLight((0.5, 0.5, 3.0), 100.0)
    dark = open_room.relight(emission=0.0, lights=[lamp]).irradiance(*shapes.random_points(ROOM, 8))
    assert dark.max() < 1e-6
