# SPDX-License-Identifier: GPL-3.0-or-later
"""Odd files: each bakes, or says in one line why not, and nothing in it is changed but for its colours."""

import importlib
import subprocess
import sys
from pathlib import Path

import bpy
import numpy as np
import pytest

ODD = Path(__file__).parents[1] / "odd_scenes"
sys.path.insert(0, str(ODD))
content = importlib.import_module("content").content

#: Why some cannot be baked.
REFUSED = {
    "nothing": "scene 'Scene' has no mesh that a render would show",
    "only_empties_and_cameras": "scene 'Scene' has no mesh that a render would show",
    "everything_hidden": "scene 'Scene' has no mesh that a render would show",
    "no_light": "nothing in scene 'Scene' gives off light",
    "not_finite": "object 'Broken': vertex 2 is at (nan, 1, 0.5)",
    "name_taken": "mesh 'Floor' has an attribute 'Radiosity' of type FLOAT for each POINT: rename it",
}
#: What the report of others says.
WARNED = {
    "missing_image": ["image 'Lost' is missing"],
    "hidden_objects": ["object 'Hidden' is hidden in the viewport", "object 'Off' is hidden in the viewport"],
    "no_materials": ["material 'Empty tree'", "has no shader at its Surface output"],
    "curves": ["object 'Tube' (CURVE) blocks and reflects light"],
    "surfaces": ["(SURFACE) blocks and reflects light"],
    "text": ["object 'Text' (FONT) blocks and reflects light"],
    "metaballs": ["'Blob' (META) blocks and reflects light"],
    "linked_library": ["mesh 'Part' of object 'Part' is linked from a library"],
    "library_override": ["mesh 'Part' of object 'Part' is linked from a library"],
    "instances_of_instances": ["mesh 'Stone' is shared by"],
    "geometry_nodes": ["object 'Floor': modifier 'Scatter' changes the mesh"],
    "zero_scale": ["object 'Line': 6 faces without area", "object 'Point': 6 faces without area"],
    "loose_geometry": ["object 'Points' has no faces", "object 'No vertices' has no faces"],
    "degenerate_faces": ["object 'Bad'", "without area left out"],
    "armature": ["object 'Skin': modifier", "changes the mesh"],
    "shared_meshes": ["mesh 'Floor' is shared by 'Floor', 'Copy 0', 'Copy 1' and 1 more"],
}
BAKED = [
    "empty_collections", "linked_library", "missing_library", "library_override", "missing_image", "hidden_objects",
    "no_materials", "node_loops", "curves", "surfaces", "text", "metaballs", "instances_of_instances",
    "geometry_nodes", "shape_keys", "huge_ngon", "zero_scale", "drivers", "loose_geometry", "degenerate_faces",
    "far_and_huge", "armature", "hair", "names", "shared_meshes", "sheared_and_mirrored", "dense_mesh",
]  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("odd")
    done = subprocess.run(
        [sys.executable, str(ODD / "make.py"), str(made)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return made


def opened(folder, name):
    bpy.ops.wm.open_mainfile(filepath=str(folder / f"{name}.blend"))
    bpy.context.view_layer.update()
    return content()


def test_every_scene_is_tested(folder):
    names = {path.stem for path in folder.glob("*.blend")} - {"parts", "overridden"}
    assert names == {*BAKED, *REFUSED}
    assert len(names) >= 20


@pytest.mark.parametrize("name", BAKED)
def test_it_bakes_and_nothing_else_changes(fmm, folder, name):
    before = opened(folder, name)
    report = fmm.bake.bake(bpy.context, fmm.bake.fmm_core.Settings(particles=300, probes=0))
    assert content() == before
    assert bpy.data.meshes["Floor"].color_attributes["Radiosity"]
    for mesh in bpy.data.meshes:
        if "Radiosity" in mesh.color_attributes:
            values = np.zeros(4 * len(mesh.color_attributes["Radiosity"].data), np.float32)
            mesh.color_attributes["Radiosity"].data.foreach_get("color", values)
            assert np.isfinite(values).all()
            assert values.min() >= 0
    for part in WARNED.get(name, []):
        assert any(part in text for text in report["warnings"]), report["warnings"]
    assert not any("\n" in text for text in report["warnings"])


@pytest.mark.parametrize("name", REFUSED)
def test_it_is_refused_in_one_line_and_nothing_changes(fmm, folder, name):
    before = opened(folder, name)
    with pytest.raises(fmm.bake.FAILURES) as raised:
        fmm.bake.bake(bpy.context, fmm.bake.fmm_core.Settings(particles=300))
    assert REFUSED[name] in fmm.bake.reason(raised.value)
    assert "\n" not in fmm.bake.reason(raised.value)
    assert content() == before
