# SPDX-License-Identifier: GPL-3.0-or-later
"""Drives the real program through a day of an artist, asserts every step and takes pictures of the screen.

blender --enable-event-simulate --window-geometry 0 0 1280 800 --python tools/drive_blender.py -- dist/*.zip out

Needs a display (Xvfb will do) and ImageMagick's `import`. Pictures go to the folder `out`, and what was measured is
printed. The exit status is 0 when every step passed.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
import traceback
from collections.abc import Iterator
from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector

ROOT = Path(__file__).resolve().parent.parent
MODULE = "bl_ext.user_default.fmm_radiosity"
ARCHIVE, OUT = map(Path, sys.argv[sys.argv.index("--") + 1 :])
#: Seconds between two looks at what a bake does.
LOOK = 0.02
#: Seconds that nothing may hold up the program, beside drawing: other programs may run as well.
LONGEST_STALL = 0.5
Steps = Iterator[float]


class Stalls:
    """Longest time between two turns of the main loop while it is watched, s."""

    def __init__(self) -> None:
        self.longest, self._last = 0.0, time.perf_counter()
        bpy.app.timers.register(self._turn, persistent=True)

    def _turn(self) -> float:
        now = time.perf_counter()
        self.longest, self._last = max(self.longest, now - self._last), now
        return 0.005

    def forget(self) -> None:
        """Begin anew."""
        self.longest, self._last = 0.0, time.perf_counter()

    def check(self, when: str, drawing: float = 0.0) -> None:
        """Say the longest one, which must not be long, and begin anew; drawing: s that the view takes to be drawn."""
        say(f"longest stall {when}: {1000 * self.longest:.0f} ms")
        assert self.longest < LONGEST_STALL + drawing
        self.forget()


def say(text: str) -> None:
    """Write a line to the log."""
    print(f"drive: {text}", flush=True)


def window() -> bpy.types.Window:
    """The window of the program."""
    return bpy.context.window_manager.windows[0]


def area(kind: str) -> bpy.types.Area:
    """The first area of a kind."""
    return next(found for found in window().screen.areas if found.type == kind)


def operate(name: str, invoke: bool = True, **options: object) -> set[str]:
    """Call an operator as a button of the 3D view does, with a step of undo."""
    view = area("VIEW_3D")
    region = next(found for found in view.regions if found.type == "WINDOW")
    group, name = name.split(".")
    with bpy.context.temp_override(window=window(), area=view, region=region):
        how = "INVOKE_DEFAULT" if invoke else "EXEC_DEFAULT"
        return getattr(getattr(bpy.ops, group), name)(how, True, **options)


def press(key: str, **modifiers: bool) -> None:
    """Press and release a key over the 3D view."""
    view = area("VIEW_3D")
    x, y = view.x + view.width // 3, view.y + view.height // 2
    window().event_simulate("MOUSEMOVE", "NOTHING", x=x, y=y)
    for value in ("PRESS", "RELEASE"):
        window().event_simulate(key, value, x=x, y=y, **modifiers)


def session() -> object:
    """What the extension remembers."""
    return sys.modules[f"{MODULE}.addon.session"].session


def click(x: int, y: int) -> Steps:
    """Click with the left mouse button."""
    for kind, value in (("MOUSEMOVE", "NOTHING"), ("LEFTMOUSE", "PRESS"), ("LEFTMOUSE", "RELEASE")):
        window().event_simulate(kind, value, x=x, y=y)
        yield 0.1
    yield 0.3


def shoot(name: str, panel: bool = False) -> None:
    """Take a picture of the screen, or only of the sidebar, after `rest`."""
    part = ("-resize", "1024x", "-depth", "8")
    if panel:
        side = sidebar()
        # Of all rows the window has; those above the area are menus.
        top = window().height - side.y - side.height
        part = ("-crop", f"{side.width}x{side.height}+{side.x}+{top}", "+repage")
    path = str(OUT / f"{name}.png")
    subprocess.run(["import", "-silent", "-window", "root", *part, path], check=True)


def rest() -> Steps:
    """Take the mouse away from buttons, whose hints would be in the picture."""
    view = area("VIEW_3D")
    window().event_simulate("MOUSEMOVE", "NOTHING", x=view.x + 40, y=view.y + 40)
    yield 1.0


def sidebar() -> bpy.types.Region:
    """The sidebar of the 3D view."""
    return next(region for region in area("VIEW_3D").regions if region.type == "UI")


def colours(mesh: str, name: str = "Radiosity") -> np.ndarray | None:
    """Values of the attribute (N,3), None where there is none."""
    attribute = bpy.data.meshes[mesh].color_attributes.get(name)
    if attribute is None:
        return None
    values = np.empty(4 * len(attribute.data), np.float32)
    attribute.data.foreach_get("color", values)
    return values.reshape(-1, 4)[:, :3]


def all_colours() -> dict[str, np.ndarray | None]:
    """Values of every mesh."""
    return {mesh.name: colours(mesh.name) for mesh in bpy.data.meshes}


def same(a: dict, b: dict) -> bool:
    """Whether two sets of values are the same to the last bit."""
    return a.keys() == b.keys() and all(
        (a[name] is None) == (b[name] is None) and (a[name] is None or np.array_equal(a[name], b[name])) for name in a
    )


def set_up_view() -> None:
    """Sidebar open at the tab, looking through the camera where there is one."""
    view = area("VIEW_3D")
    space = view.spaces.active
    space.show_region_ui = True
    space.show_gizmo = False
    space.overlay.show_overlays = False
    if bpy.context.scene.camera is not None:
        bpy.context.scene.camera.data.show_passepartout = False
        space.region_3d.view_perspective = "CAMERA"
        # Beside the sidebar, which covers the right of the view.
        space.region_3d.view_camera_offset = (0.12, 0.0)


def select_tab() -> None:
    """The tab "Radiosity" in front."""
    side = sidebar()
    if hasattr(side, "active_panel_category"):
        side.active_panel_category = "Radiosity"


def install() -> Steps:
    """Install the zip and switch it on."""
    bpy.ops.extensions.package_install_files(filepath=str(ARCHIVE), repo="user_default", enable_on_install=True)
    import addon_utils

    assert MODULE in bpy.context.preferences.addons
    assert addon_utils._extensions_warnings_get() == {}
    yield 0.5


def open_file(path: Path) -> Steps:
    """Open a file as a double click on it does."""
    with bpy.context.temp_override(window=window()):
        bpy.ops.wm.open_mainfile(filepath=str(path), load_ui=False)
    yield 1.0


def open_scene(path: Path) -> Steps:
    """Open a file and look at its scene and the panels."""
    yield from open_file(path)
    set_up_view()
    yield 1.0
    select_tab()
    yield 1.0


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


def until_done(limit: float = 300.0) -> Steps:
    """Wait for the end of a bake."""
    began = time.perf_counter()
    while session().running is not None:
        assert time.perf_counter() - began < limit, "the bake does not end"
        yield LOOK
    yield LOOK


def until_half_way(least: float = 0.4) -> Steps:
    """Wait until a good part of a bake is done."""
    while session().running is not None and session().running.fraction < least:
        yield LOOK
    assert session().running is not None, "the bake ended before it was half done"


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

    yield 1.0
    stalls.forget()
    assert operate("fmm_radiosity.bake") == {"RUNNING_MODAL"}
    yield LOOK
    stalls.check("while the scene is read")
    yield from until_half_way(0.85)
    stalls.check("while it is solved")
    shoot("panel_during", panel=True)
    yield from until_done()
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


def show() -> None:
    """Show the baked colours, by the button."""
    space = area("VIEW_3D").spaces.active
    if (space.shading.light, space.shading.color_type) != ("FLAT", "VERTEX"):
        assert operate("fmm_radiosity.show", invoke=False) == {"FINISHED"}
    assert (space.shading.light, space.shading.color_type) == ("FLAT", "VERTEX")


def escape() -> Steps:
    """Press Escape, and wait for the end of the bake."""
    pressed = time.perf_counter()
    press("ESC")
    while session().running is not None:
        yield LOOK
    took = time.perf_counter() - pressed
    say(f"Escape to the end of the bake: {took:.2f} s")
    assert took < 0.5


def change_lights() -> Steps:
    """Relight by the button, then live."""
    lamp = bpy.data.materials["Light"].node_tree.nodes["Shader"].inputs["Strength"]
    before, strength = colours("Room").copy(), lamp.default_value
    lamp.default_value = 2 * strength
    yield 0.5
    assert operate("fmm_radiosity.relight") == {"RUNNING_MODAL"}
    yield from until_done()
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
    bpy.context.window_manager.fmm_radiosity_live = False


def select(name: str) -> bpy.types.Object:
    """Select one object only."""
    for obj in bpy.context.view_layer.objects:
        obj.select_set(obj.name == name)
    bpy.context.view_layer.objects.active = bpy.data.objects[name]
    return bpy.data.objects[name]


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


def many_vertices(stalls: Stalls) -> Steps:
    """A hall of pillars with some 100,000 vertices."""
    with bpy.context.temp_override(window=window()):
        bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True, load_ui=False)
    yield 1.0
    build_hall()
    yield 1.0
    set_up_view()
    yield 1.0
    select_tab()
    for obj in bpy.context.view_layer.objects:
        obj.select_set(obj.type == "MESH" and obj.name != "Lamp")
    yield 0.5
    assert operate("fmm_radiosity.subdivide", invoke=False, edge_length=0.11) == {"FINISHED"}
    vertices = sum(len(mesh.vertices) for mesh in bpy.data.meshes)
    say(f"hall: {vertices} vertices")
    assert 80_000 < vertices < 160_000
    for obj in bpy.context.view_layer.objects:
        obj.select_set(False)
    yield 1.0
    stalls.forget()
    area("VIEW_3D").tag_redraw()
    yield 1.0
    drawing = stalls.longest
    say(f"hall: the view is drawn in {1000 * drawing:.0f} ms")
    began = time.perf_counter()
    assert operate("fmm_radiosity.bake") == {"RUNNING_MODAL"}
    say(f"hall: read in {1000 * (time.perf_counter() - began):.0f} ms")
    yield 0.1
    stalls.check("while the hall is read", drawing)
    yield from until_half_way(0.3)
    yield from escape()
    stalls.forget()
    assert operate("fmm_radiosity.bake") == {"RUNNING_MODAL"}
    yield from until_half_way(0.8)
    stalls.check("while the hall is read and solved", drawing)
    yield from until_done()
    say(f"hall: measured error {session().report['error']['measured_rms']:.4f}")
    show()
    yield 2.0
    shoot("hall_in_blender")
    strength = bpy.data.materials["Lamp"].node_tree.nodes["Emission"].inputs["Strength"]
    strength.default_value *= 0.5
    yield 0.5
    began = time.perf_counter()
    assert operate("fmm_radiosity.relight") == {"RUNNING_MODAL"}
    yield from until_done()
    say(f"hall: relit in {time.perf_counter() - began:.2f} s")


def build_hall() -> None:
    """Two rows of pillars with arches of light between them, under a ceiling with lamps."""
    materials = {
        name: material(name, colour)
        for name, colour in {"Floor": (0.5, 0.42, 0.35), "Wall": (0.75, 0.72, 0.66), "Cloth": (0.6, 0.08, 0.06)}.items()
    }
    bpy.ops.mesh.primitive_cube_add(size=1, location=(0, 6, 2), scale=(8, 16, 4))
    room = bpy.context.object
    room.data.flip_normals()
    room.data.materials.append(materials["Wall"])
    room.data.materials.append(materials["Floor"])
    for face in room.data.polygons:
        face.material_index = int(face.normal.z > 0.9)
    for row in range(5):
        for x in (-2.2, 2.2):
            bpy.ops.mesh.primitive_cylinder_add(vertices=24, radius=0.35, depth=3.9, location=(x, 3 * row, 1.97))
            for face in bpy.context.object.data.polygons:
                face.use_smooth = abs(face.normal.z) < 0.5
            bpy.context.object.data.materials.append(materials["Wall"])
    bpy.ops.mesh.primitive_cube_add(size=1, location=(0, 6, 0.02), scale=(1.6, 14, 0.03))
    bpy.context.object.data.materials.append(materials["Cloth"])
    for row in range(4):
        bpy.ops.mesh.primitive_plane_add(size=1, location=(0, 1.5 + 3 * row, 3.95), scale=(1.2, 1.2, 1))
        bpy.context.object.name = "Lamp"
        bpy.context.object.rotation_euler.x = np.pi
        bpy.context.object.data.materials.append(material("Lamp", (1.0, 0.85, 0.6), 6.0))
    data = bpy.data.cameras.new("Camera")
    camera = bpy.data.objects.new("Camera", data)
    data.lens = 22
    camera.location = (0.9, -1.6, 1.6)
    camera.rotation_euler = (Vector((-0.4, 6, 1.5)) - camera.location).to_track_quat("-Z", "Y").to_euler()
    bpy.context.scene.collection.objects.link(camera)
    bpy.context.scene.camera = camera


def material(name: str, colour: tuple[float, float, float], strength: float | None = None) -> bpy.types.Material:
    """A matt material, or one that gives off light."""
    found = bpy.data.materials.get(name)
    if found is not None:
        return found
    made = bpy.data.materials.new(name)
    if made.node_tree is None:
        made.use_nodes = True
    nodes = made.node_tree.nodes
    nodes.clear()
    shader = nodes.new("ShaderNodeBsdfDiffuse" if strength is None else "ShaderNodeEmission")
    shader.inputs["Color"].default_value = (*colour, 1.0)
    if strength is not None:
        shader.inputs["Strength"].default_value = strength
    made.node_tree.links.new(shader.outputs[0], nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    return made


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
    texts = sys.modules[f"{MODULE}.addon.translations"].GERMAN
    translations = bpy.app.translations
    wrong = [text for text, german in texts.items() if translations.pgettext_tip(text) == text != german]
    assert not wrong, wrong
    yield 1.0
    shoot("german")
    view.language = "en_US"


def day(stalls: Stalls) -> Steps:
    """All steps."""
    yield 1.0
    yield from install()
    yield from first_clicks()
    yield from bake_cornell_box(stalls)
    yield from change_lights()
    yield from subdivide_and_refine()
    yield from save_and_reopen()
    yield from many_vertices(stalls)
    yield from first_bake()
    yield from speak_german()
    yield from study()


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
