# SPDX-License-Identifier: GPL-3.0-or-later
"""Drives the real program through a day of an artist, asserts every step and takes pictures of the screen.

blender --enable-event-simulate --window-geometry 0 0 1280 800 --python tools/drive_blender.py -- fmm_radiosity.zip out

Needs a display (Xvfb will do) and ImageMagick's `import`. Pictures and a log go to the folder `out`. The exit status is
0 when every step passed.
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

ROOT = Path(__file__).resolve().parent.parent
MODULE = "bl_ext.user_default.fmm_radiosity"
ARCHIVE, OUT = map(Path, sys.argv[sys.argv.index("--") + 1 :])
#: Seconds between two looks at what a bake does.
LOOK = 0.02
Steps = Iterator[float]


class Stalls:
    """Longest time between two turns of the main loop while it is watched, s."""

    def __init__(self) -> None:
        self.longest, self._last = 0.0, time.perf_counter()
        bpy.app.timers.register(self._turn)

    def _turn(self) -> float:
        now = time.perf_counter()
        self.longest, self._last = max(self.longest, now - self._last), now
        return 0.005

    def take(self) -> float:
        """The longest one since the last call."""
        longest, self.longest, self._last = self.longest, 0.0, time.perf_counter()
        return longest


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


def shoot(name: str) -> None:
    """Take a picture of the screen."""
    subprocess.run(["import", "-silent", "-window", "root", str(OUT / f"{name}.png")], check=True)


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
        space.region_3d.view_perspective = "CAMERA"


def select_tab() -> None:
    """The tab "Radiosity" in front."""
    for region in area("VIEW_3D").regions:
        if region.type == "UI" and hasattr(region, "active_panel_category"):
            region.active_panel_category = "Radiosity"


def install() -> Steps:
    """Install the zip and switch it on."""
    bpy.ops.extensions.package_install_files(filepath=str(ARCHIVE), repo="user_default", enable_on_install=True)
    import addon_utils

    assert MODULE in bpy.context.preferences.addons
    assert addon_utils._extensions_warnings_get() == {}
    yield 0.5


def open_scene(path: Path) -> Steps:
    """Open a file and look at its scene and the panels."""
    with bpy.context.temp_override(window=window()):
        bpy.ops.wm.open_mainfile(filepath=str(path), load_ui=False)
    yield 1.0
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


def bake_cornell_box(stalls: Stalls) -> Steps:
    """Bake, Escape half way, bake again, undo, redo."""
    yield from open_scene(ROOT / "examples" / "cornell_box.blend")
    bpy.context.scene.fmm_radiosity.rays = 1000
    before = all_colours()
    yield 1.0
    shoot("before")

    assert operate("fmm_radiosity.bake") == {"RUNNING_MODAL"}
    yield from until_half_way()
    pressed = time.perf_counter()
    press("ESC")
    while session().running is not None:
        yield LOOK
    took = time.perf_counter() - pressed
    say(f"Escape to the end of the bake: {took:.2f} s")
    assert took < 0.5
    assert same(all_colours(), before)
    assert session().report is None

    yield 1.0
    stalls.take()
    assert operate("fmm_radiosity.bake") == {"RUNNING_MODAL"}
    say(f"longest stall while the scene is read: {1000 * stalls.take():.0f} ms")
    yield from until_half_way(0.85)
    say(f"longest stall while it is solved: {1000 * stalls.take():.0f} ms")
    shoot("during")
    yield from until_done()
    baked = all_colours()
    assert all(values is not None and np.isfinite(values).all() and values.max() > 0.01 for values in baked.values())
    error = session().report["error"]["measured_rms"]
    say(f"measured error {error}")
    yield 1.0
    shoot("after")

    press("Z", ctrl=True)
    yield 1.0
    assert same(all_colours(), before), "one undo takes the bake back"
    press("Z", ctrl=True, shift=True)
    yield 1.0
    assert same(all_colours(), baked), "one redo brings it back"


def day(stalls: Stalls) -> Steps:
    """All steps."""
    yield 1.0
    yield from install()
    yield from bake_cornell_box(stalls)


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
