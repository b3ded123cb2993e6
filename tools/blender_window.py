# SPDX-License-Identifier: GPL-3.0-or-later
"""Hands and eyes for a script that drives the real program: mouse, keys, pictures of the screen, colours of meshes.

What takes time is a generator: it yields the seconds that the program shall go on by itself.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import bpy
import numpy as np

if TYPE_CHECKING:
    from stalls import Stalls

ROOT = Path(__file__).resolve().parent.parent
MODULE = "bl_ext.user_default.fmm_radiosity"
ARCHIVE, OUT = map(Path, sys.argv[sys.argv.index("--") + 1 :])
#: Seconds between two looks at what a bake does.
LOOK = 0.02
Steps = Iterator[float]


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
    """Take the mouse away from buttons, whose hints would be in the picture, and let every panel be drawn."""
    for found in window().screen.areas:
        found.tag_redraw()
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


def drawing(stalls: Stalls) -> Steps:
    """Say how long the whole window takes to be drawn."""
    yield 1.0
    stalls.forget()
    for _ in range(5):
        for each in window().screen.areas:
            each.tag_redraw()
        yield 0.1
    say(f"the window is drawn in {1000 * stalls.turn:.0f} ms")
    stalls.forget()


def select(name: str) -> bpy.types.Object:
    """Select one object only."""
    for obj in bpy.context.view_layer.objects:
        obj.select_set(obj.name == name)
    bpy.context.view_layer.objects.active = bpy.data.objects[name]
    return bpy.data.objects[name]
