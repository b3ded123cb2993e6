# SPDX-License-Identifier: GPL-3.0-or-later
"""Baked colours through files of other programs and back."""

import json
from pathlib import Path

import numpy as np
import pytest

SCRIPT = """
import os, sys, json
import bpy
sys.path.insert(0, {inside!r})
from scenes import Build
import addon_utils

def corners(obj):
    mesh, attribute = obj.data, obj.data.color_attributes.active_color
    rows = []
    for face in mesh.polygons:
        normal = (obj.matrix_world.to_3x3() @ face.normal).normalized()
        for corner in face.loop_indices:
            vertex = mesh.loops[corner].vertex_index
            colour = attribute.data[corner if attribute.domain == "CORNER" else vertex].color
            rows.append([*(obj.matrix_world @ mesh.vertices[vertex].co), *normal, *colour[:3]])
    return rows

addon_utils.enable("bl_ext.user_default.fmm_radiosity")
bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
Build().room()
bpy.context.scene.fmm_radiosity.particles = 300
bpy.ops.fmm_radiosity.bake()
before = corners(bpy.data.objects["Box"])
{export}
bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
{load}
after = corners(next(obj for obj in bpy.data.objects if obj.name.startswith("Box")))
print("\\n" + json.dumps([before, after]), flush=True)
# Blender's own exporter may crash while a process ends.
os._exit(0)
"""
#: Of glTF.
UNSIGNED_SHORT = 5123
WAYS = {
    "glb": (
        "export_scene.gltf(filepath={path!r}, export_vertex_color='ACTIVE')",
        "import_scene.gltf(filepath={path!r})",
    ),
    "fbx": (
        "export_scene.fbx(filepath={path!r}, colors_type='LINEAR', prioritize_active_color=True)",
        "import_scene.fbx(filepath={path!r}, colors_type='LINEAR')",
    ),
}


def colour_by_place(rows):
    """Colours (N,3) by rounded position and normal; corners of one face that were cut apart count once."""
    found = {}
    for row in np.array(rows):
        found.setdefault(tuple(np.round(row[:6], 2) + 0.0), []).append(row[6:])
    return found


def srgb(linear):
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)


def colour_types(path):
    """Component types of every COLOR_0 in a glTF file."""
    content = path.read_bytes()
    scene = json.loads(content[20 : 20 + int.from_bytes(content[12:16], "little")])
    primitives = [primitive for mesh in scene["meshes"] for primitive in mesh["primitives"]]
    return {scene["accessors"][primitive["attributes"]["COLOR_0"]]["componentType"] for primitive in primitives}


@pytest.mark.parametrize("kind", WAYS)
def test_colours_go_through_a_file_and_back(blender, root, tmp_path, kind):
    """FBX keeps floats, glTF 16 bits, which Blender itself rounds to 8 bits of sRGB when it reads them."""
    path = str(tmp_path / f"room.{kind}")
    export, load = ("bpy.ops." + way.format(path=path) for way in WAYS[kind])
    inside = str(root / "tests" / "blender" / "inside")
    printed = blender.code(SCRIPT.format(inside=inside, export=export, load=load))
    before, after = (colour_by_place(rows) for rows in json.loads(printed.splitlines()[-1]))
    assert len(before) == 24
    assert before.keys() == after.keys()
    assert max(np.max(values) for values in before.values()) > 0.01
    for place, values in before.items():
        for value in after[place]:
            if kind == "fbx":
                assert np.abs(value - values[0]).max() < 1e-5
            else:
                # Half a step of each, the first at the steepest slope of sRGB.
                assert np.abs(srgb(value) - srgb(values[0])).max() < 12.92 * 0.5 / 65535 + 0.5 / 255 + 1e-6
    if kind == "glb":
        assert colour_types(Path(path)) == {UNSIGNED_SHORT}
