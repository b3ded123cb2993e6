# SPDX-License-Identifier: GPL-3.0-or-later
"""Drives the real program through a day of an artist, asserts every step and takes pictures of the screen.

blender --enable-event-simulate --window-geometry 0 0 1280 800 --python tools/drive_blender.py -- dist/*.zip out

Needs a display (Xvfb will do) and ImageMagick's `import`. Pictures go to the folder `out`, and what was measured is
printed. The exit status is 0 when every step passed.
"""

from __future__ import annotations

import os
import sys
import time
import traceback
from pathlib import Path

import bpy
import numpy as np

# Blender runs this file as a text: its neighbours are not found by themselves.
sys.path.insert(0, str(Path(__file__).resolve().parent))

from blender_window import (
    ARCHIVE,
    LOOK,
    MODULE,
    OUT,
    ROOT,
    Steps,
    all_colours,
    area,
    click,
    colours,
    drawing,
    escape,
    open_file,
    open_scene,
    operate,
    press,
    rest,
    same,
    say,
    select,
    select_tab,
    session,
    set_up_view,
    shoot,
    show,
    sidebar,
    until_done,
    until_half_way,
    window,
)
from drive_hall import many_vertices, noise
from drive_mishaps import mishaps
from stalls import Stalls


def install(stalls: Stalls) -> Steps:
    """Install the zip and switch it on."""
    bpy.ops.extensions.package_install_files(filepath=str(ARCHIVE), repo="user_default", enable_on_install=True)
    import addon_utils

    assert MODULE in bpy.context.preferences.addons
    assert addon_utils._extensions_warnings_get() == {}
    stalls.watch(MODULE)
    yield 0.5


def first_clicks() -> Steps:
    """From a file that was opened to its colours with a key and three clicks, all where a hand would make them."""
    yield from open_file(ROOT / "examples" / "cornell_box.blend")
    area("VIEW_3D").spaces.active.show_region_ui = False
    yield 0.5
    press("N")
    yield 1.0
    side, scale = sidebar(), bpy.context.preferences.system.ui_scale
    assert area("VIEW_3D").spaces.active.show_region_ui, "N opens the sidebar"
    right, top = side.x + side.width, side.y + side.height
    # Tabs hang one under the other; how long they are depends on their names.
    for below in range(20, side.height, 20):
        yield from click(round(right - 10 * scale), round(top - below * scale))
        if side.active_panel_category == "Radiosity":
            break
    assert side.active_panel_category == "Radiosity", "the tab is there to be clicked"
    shoot("tab")
    middle = side.x + side.width // 2
    yield from click(middle, round(top - 48 * scale))
    assert session().running is not None or session().report is not None, "the button Bake starts a bake"
    yield from until_done()
    yield 0.5
    yield from click(middle, round(top - 80 * scale))
    shading = area("VIEW_3D").spaces.active.shading
    assert (shading.light, shading.color_type) == ("FLAT", "VERTEX"), "the button Show Result shows the colours"
    assert session().report["error"]["measured_rms"] < 0.02
    shoot("clicked")
    yield from click(middle, round(top - 80 * scale))
    assert shading.light != "FLAT", "the same button goes back"


def bake_cornell_box(stalls: Stalls) -> Steps:
    """Bake, Escape half way, bake again, undo, redo."""
    yield from open_scene(ROOT / "examples" / "cornell_box.blend")
    bpy.context.scene.fmm_radiosity.rays = 1000
    before = all_colours()
    assert operate("fmm_radiosity.check", invoke=False) == {"FINISHED"}
    assert session().effects["occlusion"]["used"]
    yield from rest()
    shoot("panel_before", panel=True)

    assert operate("fmm_radiosity.bake") == {"RUNNING_MODAL"}
    yield from until_half_way()
    yield from escape()
    assert same(all_colours(), before)
    assert session().report is None

    yield from drawing(stalls)
    assert operate("fmm_radiosity.bake") == {"RUNNING_MODAL"}
    yield LOOK
    stalls.check("while the scene is read")
    yield from until_half_way(0.85)
    stalls.check("while it is solved")
    shoot("panel_during", panel=True)
    stalls.forget()
    yield from until_done()
    stalls.check("while it is written")
    baked = all_colours()
    assert all(values is not None and np.isfinite(values).all() and values.max() > 0.01 for values in baked.values())
    say(f"measured error {session().report['error']['measured_rms']:.4f}")
    yield 1.0
    show()
    yield 1.0
    shoot("cornell_in_blender")
    shoot("panel_after", panel=True)

    press("Z", ctrl=True)
    yield 1.0
    assert same(all_colours(), before), "one undo takes the bake back"
    press("Z", ctrl=True, shift=True)
    yield 1.0
    assert same(all_colours(), baked), "one redo brings it back"
    yield from map_errors(stalls)
    assert same(all_colours(), baked)


def map_errors(stalls: Stalls) -> Steps:
    """Show where the colours are off, go back, and undo both."""
    view = bpy.data.meshes["Room"]
    stalls.forget()
    assert operate("fmm_radiosity.error_map") == {"RUNNING_MODAL"}
    yield from until_done()
    stalls.check("while errors are mapped")
    assert view.attributes.active_color_name == "Radiosity Error"
    yield from rest()
    shoot("error_map")
    assert operate("fmm_radiosity.error_map") == {"FINISHED"}
    assert bpy.data.meshes["Room"].attributes.active_color_name == "Radiosity"
    yield 0.5
    for _ in range(2):
        press("Z", ctrl=True)
        yield 1.0
    assert "Radiosity Error" not in bpy.data.meshes["Room"].attributes, "two undos take map and way back away"


def change_lights(stalls: Stalls) -> Steps:
    """Relight by the button, then live."""
    lamp = bpy.data.materials["Light"].node_tree.nodes["Shader"].inputs["Strength"]
    before, strength = colours("Room").copy(), lamp.default_value
    lamp.default_value = 2 * strength
    yield 0.5
    stalls.forget()
    began = time.perf_counter()
    assert operate("fmm_radiosity.relight") == {"RUNNING_MODAL"}
    yield from until_done()
    say(f"relit in {time.perf_counter() - began:.2f} s")
    assert session().report["counts"]["rays"] == 0
    assert np.allclose(colours("Room"), 2 * before, rtol=1e-3)

    bpy.context.window_manager.fmm_radiosity_live = True
    yield 0.5
    lamp.default_value = strength
    changed = time.perf_counter()
    while not np.allclose(colours("Room"), before, rtol=1e-3):
        assert time.perf_counter() - changed < 10, session().problem
        yield LOOK
    say(f"live: from a change of the lamp to other colours {time.perf_counter() - changed:.2f} s")
    stalls.check("while lights follow")
    bpy.context.window_manager.fmm_radiosity_live = False


def subdivide_and_refine() -> Steps:
    """Subdivide, undo it, refine where the light changes, bake again."""
    block = select("Short block")
    yield 0.5
    count = len(block.data.vertices)
    assert operate("fmm_radiosity.subdivide", invoke=False, edge_length=0.04) == {"FINISHED"}
    assert len(bpy.data.meshes[block.data.name].vertices) > 2 * count
    yield 0.5
    press("Z", ctrl=True)
    yield 1.0
    block = select("Short block")
    yield 0.5
    assert len(block.data.vertices) == count, "one undo takes the subdivision back"
    assert operate("fmm_radiosity.refine", invoke=False, contrast=0.02, edge_length=0.01) == {"FINISHED"}
    assert len(block.data.vertices) > count
    yield 0.5
    bpy.context.scene.fmm_radiosity.rays = 200
    assert operate("fmm_radiosity.bake") == {"RUNNING_MODAL"}
    yield from until_done()
    assert len(colours(block.data.name)) > 4 * count


def save_and_reopen() -> Steps:
    """Save, open, and find the same."""
    path, kept = OUT / "baked.blend", all_colours()
    with bpy.context.temp_override(window=window()):
        bpy.ops.wm.save_as_mainfile(filepath=str(path))
    yield from open_scene(path)
    assert same(all_colours(), kept)
    assert bpy.context.scene.fmm_radiosity.rays == 200
    assert session().report is None


def study() -> Steps:
    """Study the Cornell box, and find the picture in an image editor."""
    yield from open_scene(ROOT / "examples" / "cornell_box.blend")
    area("PROPERTIES").type = "IMAGE_EDITOR"
    yield 0.5
    assert operate("fmm_radiosity.study") == {"RUNNING_MODAL"}
    yield from until_done()
    space = area("IMAGE_EDITOR").spaces.active
    assert min(space.image.size) > 100
    # A wide editor for the picture.
    area("VIEW_3D").type = "IMAGE_EDITOR"
    yield 0.5
    widest = max((found for found in window().screen.areas if found.type == "IMAGE_EDITOR"), key=lambda a: a.width)
    widest.spaces.active.image = space.image
    yield 0.5
    with bpy.context.temp_override(window=window(), area=widest, region=widest.regions[-1]):
        bpy.ops.image.view_all(fit_view=True)
    yield 1.0
    shoot("study_in_blender")


def first_bake() -> Steps:
    """The scene that Blender starts with, untouched: it is baked, or a sentence says what is missing."""
    with bpy.context.temp_override(window=window()):
        bpy.ops.wm.read_homefile(use_factory_startup=True, load_ui=False)
    yield 1.0
    set_up_view()
    yield 1.0
    select_tab()
    try:
        operate("fmm_radiosity.bake")
        yield from until_done()
        assert session().report is not None
        show()
    except RuntimeError as error:
        say(f"the first scene: {error}")
    yield 1.0
    shoot("first")


def speak_german() -> Steps:
    """Panels and messages in German."""
    view = bpy.context.preferences.view
    view.language = "de_DE"
    view.use_translate_interface = view.use_translate_tooltips = True
    texts = {}
    for name in ("translations", "messages_german"):
        texts |= sys.modules[f"{MODULE}.addon.{name}"].GERMAN
    translations = bpy.app.translations
    wrong = [text for text, german in texts.items() if translations.pgettext_tip(text) == text != german]
    assert not wrong, wrong
    yield 1.0
    shoot("german")
    view.language = "en_US"


def uninstall() -> Steps:
    """Uninstall by the button of Blender's preferences: nothing is left, of translations either."""
    view, pgettext = bpy.context.preferences.view, bpy.app.translations.pgettext_iface
    view.language, view.use_translate_interface = "de_DE", True
    assert pgettext("Bake Radiosity") == "Radiosity backen"
    repos = bpy.context.preferences.extensions.repos
    index = next(i for i, repo in enumerate(repos) if repo.module == "user_default")
    assert bpy.ops.extensions.package_uninstall(repo_index=index, pkg_id="fmm_radiosity") == {"FINISHED"}
    yield 1.0
    assert pgettext("Bake Radiosity") == "Bake Radiosity"
    assert not [name for name in dir(bpy.types) if "fmm_radiosity" in name.lower()]
    assert not hasattr(bpy.context.scene, "fmm_radiosity")
    assert not bpy.utils.preset_paths("fmm_radiosity")
    view.language = "en_US"


def day(stalls: Stalls) -> Steps:
    """All steps."""
    yield 1.0
    yield from install(stalls)
    yield from first_clicks()
    yield from bake_cornell_box(stalls)
    yield from change_lights(stalls)
    yield from subdivide_and_refine()
    yield from save_and_reopen()
    yield from many_vertices(stalls)
    yield from noise(stalls)
    yield from first_bake()
    yield from speak_german()
    yield from mishaps()
    yield from study()
    yield from uninstall()


def drive() -> None:
    """Take one step after the other from Blender's main loop, and end the program."""
    steps = day(Stalls())

    def step() -> float | None:
        try:
            return next(steps)
        except StopIteration:
            say("passed")
            status = 0
        except BaseException:
            traceback.print_exc()
            shoot("failed")
            status = 1
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)

    bpy.app.timers.register(step, persistent=True)


OUT.mkdir(parents=True, exist_ok=True)
drive()
