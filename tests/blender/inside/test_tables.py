# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials whose reflection comes from a file of the MERL database."""

import re

import bpy
import numpy as np
import pytest
from fmm_core import Brdf, Error
from fmm_core.brdf import MERL_SCALE, SHAPE
from scenes import of_corners

COLOUR = np.array([0.8, 0.5, 0.2])


def saved(path, table):
    """A file of a table (90, 90, 180, 3)."""
    with open(path, "wb") as file:
        np.array(SHAPE, "<i4").tofile(file)
        np.moveaxis(table / MERL_SCALE, 3, 0).astype("<f8").tofile(file)
    return path


@pytest.fixture(scope="module")
def metal(tmp_path_factory):
    """A file of the metal that Blender makes of COLOUR and a roughness of 0.4."""
    lobes = Brdf.ggx(0.4, 0.0).table
    table = lobes[..., :1] * COLOUR + lobes[..., 1:2]
    return saved(tmp_path_factory.mktemp("tables") / "metal.binary", table)


@pytest.fixture
def plate(build):
    """A plate before a camera, under a lamp, with a material that reflects nothing by itself."""
    build.quad("Lamp", build.light("Glow", (5.0, 4.0, 3.0)), z=1.5, down=True)
    material = build.material("Plate", "ShaderNodeBsdfPrincipled", Base_Color=(0.0, 0.0, 0.0), Specular_IOR_Level=0.0)
    places = [(x / 8, y / 8, 0.0) for y in range(-4, 13) for x in range(-4, 13)]
    faces = [(17 * j + i, 17 * j + i + 1, 17 * j + i + 18, 17 * j + i + 17) for j in range(16) for i in range(16)]
    build.object("Plate", places, faces, material)
    build.camera((2.0, 0.5, 1.5))
    bpy.context.scene.fmm_radiosity.view = True
    return material


def view():
    assert bpy.ops.fmm_radiosity.bake() == {"FINISHED"}
    return of_corners(bpy.data.meshes["Plate"], "Radiosity View")[:, :3]


def test_a_file_reflects_as_the_shader_that_it_is_of(plate, metal, read, fmm):
    plate.fmm_radiosity.brdf = str(metal)
    table = Brdf.load(metal)
    assert read().albedo[-1] == pytest.approx(np.minimum(table.mean_albedo, 1))
    found = view()
    assert fmm.session.session.report["counts"]["tables"] == 1
    plate.fmm_radiosity.brdf = ""
    shader = plate.node_tree.nodes["Principled BSDF"].inputs
    shader["Base Color"].default_value, shader["Metallic"].default_value = (*COLOUR, 1.0), 1.0
    shader["Roughness"].default_value, shader["Specular IOR Level"].default_value = 0.4, 0.5
    expected = view()
    # The shader adds the light that facets send on to each other, which single facets of this roughness lose.
    assert not np.array_equal(found, expected)
    assert np.linalg.norm(found - expected) < 0.04 * np.linalg.norm(expected)
    assert found.max() > 2 * np.median(found, axis=0).max()


def test_a_file_beside_the_blend_is_found_and_even_reflection_is_diffuse(plate, tmp_path):
    saved(tmp_path / "even.binary", np.full((*SHAPE, 3), COLOUR / np.pi))
    plate.fmm_radiosity.brdf = "//even.binary"
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "plate.blend"))
    found = view()
    even = of_corners(bpy.data.meshes["Plate"], "Radiosity")[:, :3]
    # Its light is found by rays, the other one is fitted.
    assert np.linalg.norm(found - even) < 0.04 * np.linalg.norm(even)
    assert found.mean(axis=0) == pytest.approx(even.mean(axis=0), rel=0.01)


def test_a_file_that_reflects_nothing_is_black(plate, read, tmp_path):
    plate.fmm_radiosity.brdf = str(saved(tmp_path / "black.binary", np.zeros((*SHAPE, 3))))
    # What counts as nothing is 1e-12 per steradian.
    assert read().albedo[-1].max() < 1e-11
    assert view().max() < 1e-11


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (np.append(np.array(SHAPE, "<i4").view("<f4"), np.full(6 * np.prod(SHAPE), 1e38, "<f4")).tobytes(), "reflects"),
        (None, "cannot be read: No such file"),
        (b"\0" * 50, "is no BRDF"),
        (np.array(SHAPE, "<i4").tobytes(), "is no BRDF"),
    ],
)
def test_what_is_no_table_is_named_with_its_material(plate, read, tmp_path, content, message):
    path = tmp_path / "wrong.binary"
    if content is not None:
        path.write_bytes(content)
    plate.fmm_radiosity.brdf = str(path)
    with pytest.raises(Error, match=rf"^material 'Plate': '{re.escape(str(path))}' {message}"):
        read()
    with pytest.raises(RuntimeError, match="material 'Plate'"):
        bpy.ops.fmm_radiosity.bake()
    assert "Radiosity" not in bpy.data.meshes["Plate"].attributes
