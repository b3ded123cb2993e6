# SPDX-License-Identifier: GPL-3.0-or-later
"""The zip, and everything that is tested inside of an installed extension."""

import os
import re
import zipfile
from pathlib import Path

import pytest
from conftest import Blender

INSIDE = Path(__file__).parent / "inside"
MODULE = "bl_ext.user_default.fmm_radiosity"


def test_zip_holds_code_and_native_wheels_only(archive):
    names = zipfile.ZipFile(archive).namelist()
    wheels = [name for name in names if name.startswith("wheels/")]
    assert any(re.fullmatch(r"wheels/fmm_core-[^-]+-cp311-abi3-.*\.whl", name) for name in wheels)
    for tag in ("cp311", "cp313", "cp314"):
        assert any(re.fullmatch(rf"wheels/embreex-[^-]+-{tag}-.*\.whl", name) for name in wheels)
    others = set(names) - set(wheels)
    assert {"__init__.py", "blender_manifest.toml", "LICENSE"} <= others
    assert all(name.startswith(("addon/", "operators/")) for name in others if "/" in name.rstrip("/"))
    assert not any("__pycache__" in name or "test" in name for name in names)


def test_wheel_holds_the_compiled_core(archive, tmp_path):
    with zipfile.ZipFile(archive) as opened:
        wheel = next(name for name in opened.namelist() if "fmm_core" in name)
        opened.extract(wheel, tmp_path)
    names = zipfile.ZipFile(tmp_path / wheel).namelist()
    assert any(name.startswith("fmm_core/_binding") and name.endswith((".so", ".pyd")) for name in names)


def test_switching_on_prints_nothing(blender):
    done = blender.run("-c", f"import bpy, addon_utils; addon_utils.enable('{MODULE}')")
    assert done.returncode == 0
    assert "Traceback" not in done.stdout + done.stderr
    assert "Error: Python" not in done.stdout + done.stderr


#: What an extension can leave behind in Blender.
LEFT = f"""
import bpy
import addon_utils, sys, threading
def left():
    handlers = sum(len(found) for name in dir(bpy.app.handlers)
                   if isinstance(found := getattr(bpy.app.handlers, name), list))
    live = sys.modules.get("{MODULE}.addon.live")
    timer = live is not None and bpy.app.timers.is_registered(live._turn)
    # Blender keeps the types of operators and property groups by name.
    types = sorted(name for name in dir(bpy.types) if "fmm_radiosity" in name.lower())
    where = bpy.types.Scene, bpy.types.WindowManager, bpy.ops
    names = [name for holder in where for name in dir(holder) if "fmm_radiosity" in name]
    presets = bpy.utils.preset_paths("fmm_radiosity")
    keys = [item.idname for config in bpy.context.window_manager.keyconfigs for keymap in config.keymaps
            for item in keymap.keymap_items if "fmm_radiosity" in item.idname]
    return handlers, threading.active_count(), timer, types, names, presets, keys
def used():
    bpy.context.window_manager.fmm_radiosity_live = True
    sys.modules["{MODULE}.addon.session"].session.submit(len, "")
NOTHING = [], [], [], []
"""


def test_switched_on_and_off_twenty_times_leaves_nothing_behind(blender):
    shown = blender.code(f"""{LEFT}
addon_utils.enable("{MODULE}")
addon_utils.disable("{MODULE}")
before = left()
for turn in range(20):
    addon_utils.enable("{MODULE}")
    assert "bake" in dir(bpy.ops.fmm_radiosity)
    assert len(bpy.utils.preset_paths("fmm_radiosity")) == 1
    used()
    addon_utils.disable("{MODULE}")
    assert left() == before, (left(), before)
assert before[2:] == (False, *NOTHING), before
addon_utils.enable("{MODULE}")
print(addon_utils._extensions_warnings_get())
""")
    assert shown.splitlines()[-1] == "{}"


def test_uninstalling_leaves_nothing_behind(archive, tmp_path):
    # Without it Blender takes the folder of whoever runs this.
    (tmp_path / "user").mkdir()
    done = Blender(tmp_path / "user").run(
        "-c",
        f"""{LEFT}
before = left()
bpy.ops.extensions.package_install_files(filepath={str(archive)!r}, repo="user_default", enable_on_install=True)
assert left()[3:] != NOTHING
used()
repos = bpy.context.preferences.extensions.repos
index = next(i for i, repo in enumerate(repos) if repo.module == "user_default")
assert bpy.ops.extensions.package_uninstall(repo_index=index, pkg_id="fmm_radiosity") == {{"FINISHED"}}
assert left() == before, (left(), before)
assert before[2:] == (False, *NOTHING), before
assert "{MODULE}" not in bpy.context.preferences.addons
print(addon_utils._extensions_warnings_get())
""",
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.splitlines()[-1] == "{}"
    assert "Traceback" not in done.stderr
    # Folders, and what Blender itself keeps there about what is installed, are no files of the extension.
    files = [path for path in (tmp_path / "user").rglob("*") if path.is_file()]
    assert not [path for path in files if "radiosity" in str(path) or "fmm" in str(path) or "embree" in str(path)]


@pytest.mark.parametrize("lost", ["fmm_core", "PIL"])
def test_copy_for_another_system_says_so(archive, tmp_path, lost):
    """Without its wheels the extension shows a panel with the reason, whatever its width, and no traceback."""
    sources = tmp_path / "sources"
    with zipfile.ZipFile(archive) as opened:
        opened.extractall(sources)
    manifest = sources / "blender_manifest.toml"
    text = manifest.read_text(encoding="utf-8")
    manifest.write_text(re.sub(r"^(wheels|platforms) = .*\n", "", text, flags=re.MULTILINE), encoding="utf-8")
    without = tmp_path / "without.zip"
    with zipfile.ZipFile(without, "w") as packed:
        for path in sources.rglob("*"):
            if "wheels" not in path.parts:
                packed.write(path, path.relative_to(sources))
    done = Blender(tmp_path / "user").run(
        "-c",
        f"""
import bpy
class Hidden:
    # This repository's own environment has the core.
    def find_spec(self, name, path=None, target=None):
        if name == "{lost}":
            raise ImportError("No module named '{lost}'")
import sys, types
sys.meta_path.insert(0, Hidden())
bpy.ops.extensions.package_install_files(filepath={str(without)!r}, repo="user_default", enable_on_install=True)
print([name for name in dir(bpy.types) if name.startswith("FMM_RADIOSITY_PT")])
drawn = []
layout = types.SimpleNamespace(column=lambda align: layout, label=lambda text, icon, translate: drawn.append(text))
panel = types.SimpleNamespace(layout=layout)
system = types.SimpleNamespace(ui_scale=1.0)
context = types.SimpleNamespace(region=types.SimpleNamespace(width=280),
                                preferences=types.SimpleNamespace(system=system))
from {MODULE}.addon import missing
missing.FMM_RADIOSITY_PT_missing.draw(panel, context)
assert " ".join(drawn) == " ".join(missing.lines()), drawn
assert max(map(len, drawn)) <= 32, drawn
bpy.ops.preferences.addon_disable(module="{MODULE}")
print([name for name in dir(bpy.types) if name.startswith("FMM_RADIOSITY_PT")])
""",
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "Traceback" not in done.stdout + done.stderr
    assert "native part is missing" in done.stderr
    assert "['FMM_RADIOSITY_PT_missing']\n" in done.stdout
    assert done.stdout.splitlines()[-1] == "[]"


def test_names_of_the_extension(root):
    text = (root / "blender_manifest.toml").read_text(encoding="utf-8")
    assert 'id = "fmm_radiosity"' in text
    assert 'blender_version_min = "4.2.0"' in text


@pytest.mark.parametrize("module", sorted(path.name for path in INSIDE.glob("test_*.py")))
def test_inside_blender(blender, module):
    """Each file runs in one Blender process of its own; its output is shown when something fails."""
    done = blender.run(
        "-m", "pytest", "-q", "-p", "no:cacheprovider", "-c", str(INSIDE / "pytest.ini"), str(INSIDE / module)
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert " passed" in done.stdout


@pytest.mark.skipif("FMM_RADIOSITY_PYTHON" not in os.environ, reason="wants another Blender than the repository's own")
def test_colours_are_the_same_in_every_blender(blender, run, colours, root, tmp_path):
    """Rounding differs from one numpy to the next, and nothing else may come of it."""
    scene, here, there = root / "examples" / "cornell_box.blend", tmp_path / "here.blend", tmp_path / "there.blend"
    assert run("bake", scene, "-o", here).returncode == 0
    blender.code(f"""
import bpy, addon_utils
addon_utils.enable("{MODULE}")
from {MODULE}.addon.command_line import main
assert main(["bake", {str(scene)!r}, "-o", {str(there)!r}]) == 0
""")
    expected, found = colours(here), colours(there, blender.python)
    assert list(found) == list(expected)
    for name, values in expected.items():
        assert found[name] == pytest.approx(values, abs=1e-6, rel=0)
