# SPDX-License-Identifier: GPL-3.0-or-later
"""The zip, and everything that is tested inside of an installed extension."""

import os
import re
import zipfile
from pathlib import Path

import pytest

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


def test_can_be_switched_off_and_on_again(blender):
    shown = blender.code(f"""
import bpy, addon_utils
def there(): return hasattr(bpy.types.Scene, "fmm_radiosity"), "bake" in dir(bpy.ops.fmm_radiosity)
for _ in range(2):
    addon_utils.enable("{MODULE}")
    print(there())
    addon_utils.disable("{MODULE}")
    print(there())
print(addon_utils._extensions_warnings_get())
""")
    assert shown.split("\n")[-6:-1] == ["(True, True)", "(False, False)"] * 2 + ["{}"]


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
