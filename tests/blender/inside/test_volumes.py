# SPDX-License-Identifier: GPL-3.0-or-later
"""Volumes of worlds and materials: what is read, and what is named."""

import bpy
import numpy as np
import pytest
from fmm_core import Error


@pytest.fixture
def fill(build):
    """Gives a world or a material a volume shader: `fill(owner, output, shader, **inputs)`."""

    def fill(owner, output, shader, **inputs):
        if owner.node_tree is None:
            owner.use_nodes = True
        nodes = owner.node_tree.nodes
        node = nodes.new(shader)
        for name, value in inputs.items():
            node.inputs[name.replace("_", " ")].default_value = value
        end = next((one for one in nodes if one.bl_idname == output), None) or nodes.new(output)
        owner.node_tree.links.new(node.outputs[0], end.inputs["Volume"])
        return node

    build.room()
    bpy.context.scene.world = bpy.data.worlds.new("Fog")
    return fill


WORLD = "ShaderNodeOutputWorld", "ShaderNodeVolumeScatter"


def world(fill, shader, **inputs):
    return fill(bpy.context.scene.world, "ShaderNodeOutputWorld", shader, **inputs)


def test_absorption_is_density_times_what_the_colour_lacks(fill, read):
    assert (read().medium == 0).all()
    world(fill, "ShaderNodeVolumeAbsorption", Color=(1.0, 0.75, 0.2, 1.0), Density=2.0)
    arrays = read()
    assert arrays.medium == pytest.approx([0.0, 0.5, 1.6])
    assert arrays.warnings == ()


def test_principled_volume_absorbs_what_it_does_not_scatter(fill, read):
    black = {"Color": (0, 0, 0, 1), "Density": 2.0, "Absorption_Color": (0.25, 0.0, 1.0, 1.0)}
    node = world(fill, "ShaderNodeVolumePrincipled", **black)
    assert read().medium == pytest.approx([1.0, 2.0, 0.0])
    assert read().warnings == ()
    node.inputs["Color"].default_value = (0.5, 0.5, 0.5, 1.0)
    assert read().medium == pytest.approx([0.5, 1.0, 0.0])
    assert read().warnings == ("world 'Fog': its volume scatters light, which is not simulated",)


def test_what_cannot_be_simulated_is_named(fill, read):
    node = world(fill, "ShaderNodeVolumeAbsorption", Density=2.0)
    tree = bpy.context.scene.world.node_tree
    tree.links.new(tree.nodes.new("ShaderNodeTexNoise").outputs["Fac"], node.inputs["Density"])
    arrays = read()
    assert (arrays.medium == 0).all()
    assert arrays.warnings == (
        "world 'Fog': its volume 'Volume Absorption' is not the same everywhere (Density): left out",
    )
    world(fill, "ShaderNodeVolumeScatter")
    assert read().warnings == ("world 'Fog': its volume 'Volume Scatter' is not simulated: left out",)


def jelly(build, fill, shader="ShaderNodeVolumeAbsorption", **inputs):
    """A material that has nothing but a volume."""
    material = build.material("Jelly")
    material.node_tree.nodes.clear()
    fill(material, "ShaderNodeOutputMaterial", shader, **inputs)
    return material


def test_a_closed_mesh_with_nothing_but_a_volume_absorbs_inside_and_blocks_no_light(fill, read, build):
    fill(bpy.data.materials["Blue"], "ShaderNodeOutputMaterial", "ShaderNodeVolumeAbsorption")
    build.cube("Pudding", jelly(build, fill, Color=(1.0, 0.75, 0.2, 1.0), Density=2.0)).scale = (-1, 1, 1)
    arrays = read()
    assert np.count_nonzero(arrays.opacity.mean == 0) == 12
    # Nothing gets into the box, whose material has a volume too.
    (volume,) = arrays.volumes
    assert volume.absorption == pytest.approx([0.0, 0.5, 1.6])
    a, b, c = volume.triangles.transpose(1, 0, 2)
    assert (a * np.cross(b, c)).sum() / 6 == pytest.approx(1.0)
    assert arrays.warnings == ()


def test_volumes_of_meshes_that_cannot_be_simulated_are_named(fill, read, build):
    cube = build.cube("Pudding", jelly(build, fill, "ShaderNodeVolumeScatter"))
    assert read().volumes == ()
    text = "material 'Jelly' on object 'Pudding': its volume 'Volume Scatter' is not simulated: left out"
    assert read().warnings == (text,)
    bpy.data.objects.remove(cube)
    build.object("Sheet", [(0, 0, 1), (1, 0, 1), (1, 1, 1)], [(0, 1, 2)], jelly(build, fill))
    assert read().volumes == ()
    assert read().warnings == ("object 'Sheet': its mesh is not closed, its volume is left out",)


def test_a_bake_in_fog_is_darker_and_says_why(fill, fmm):
    bpy.context.scene.fmm_radiosity.particles = 300
    settings = fmm.properties.settings_of(bpy.context.scene)
    clear = fmm.bake.compute(fmm.bake.read(bpy.context), settings)
    world(fill, "ShaderNodeVolumeAbsorption", Color=(0.0, 0.0, 0.0, 1.0), Density=1.0)
    foggy = fmm.bake.compute(fmm.bake.read(bpy.context), settings)
    assert foggy.solution.report["effects"]["medium"]["used"]
    rows = next(receiver.rows for receiver in foggy.arrays.receivers if receiver.object == "Floor")
    # The lamp is 2 m above.
    share = foggy.colours[rows].sum() / clear.colours[rows].sum()
    assert np.exp(-3.0) < share < np.exp(-1.5)


def test_what_is_muted_absorbs_nothing_and_reroutes_are_passed(fill, read):
    node = world(fill, "ShaderNodeVolumeAbsorption", Color=(0.0, 0.0, 0.0, 1.0), Density=2.0)
    tree = bpy.context.scene.world.node_tree
    end = tree.nodes["World Output"].inputs["Volume"]
    node.mute = True
    assert (read().medium == 0).all()
    node.mute = False
    end.links[0].is_muted = True
    assert (read().medium == 0).all()
    reroute = tree.nodes.new("NodeReroute")
    tree.links.new(node.outputs[0], reroute.inputs[0])
    tree.links.new(reroute.outputs[0], end)
    assert read().medium == pytest.approx(2.0)


def test_a_volume_far_from_the_origin_absorbs(fill, read, build):
    cube = build.cube("Pudding", jelly(build, fill))
    cube.rotation_euler = (0.1, 0.2, 0.3)
    for far in (1e7, -1e7, 3e7, -3e7):
        cube.location = (far, -2 * far, 0.5 * far)
        arrays = read()
        (volume,) = arrays.volumes
        a, b, c = (volume.triangles - volume.triangles[0, 0]).transpose(1, 0, 2)
        assert (a * np.cross(b, c)).sum() / 6 == pytest.approx(1.0)
        assert arrays.warnings == ()


def test_nothing_but_volumes_stops_no_light(fill, read, build):
    for obj in list(bpy.data.objects):
        bpy.data.objects.remove(obj)
    build.cube("Pudding", jelly(build, fill))
    lamp = bpy.data.objects.new("Point", bpy.data.lights.new("Point", "POINT"))
    bpy.context.scene.collection.objects.link(lamp)
    with pytest.raises(Error, match=r"^no mesh of scene 'Scene' has a face that stops light of surfaces"):
        read()


def test_a_volume_does_not_hide_the_picture_of_the_sky(fill, read):
    tree = bpy.context.scene.world.node_tree or fill(bpy.context.scene.world, *WORLD).id_data
    sky = tree.nodes.new("ShaderNodeTexSky")
    sky.sky_type = bpy.types.ShaderNodeTexSky.bl_rna.properties["sky_type"].enum_items[0].identifier
    background = tree.nodes.get("Background") or tree.nodes.new("ShaderNodeBackground")
    tree.links.new(sky.outputs[0], background.inputs["Color"])
    tree.links.new(background.outputs[0], tree.nodes["World Output"].inputs["Surface"])
    for link in tree.nodes["World Output"].inputs["Volume"].links:
        tree.links.remove(link)
    images = list(bpy.data.images)
    clear = read().sky.radiance
    world(fill, "ShaderNodeVolumeScatter")
    assert read().sky.radiance == pytest.approx(clear, rel=1e-4)
    assert list(bpy.data.images) == images


def test_numbers_that_come_from_other_nodes_count_where_they_are_the_same_everywhere(fill, read):
    node = world(fill, "ShaderNodeVolumePrincipled", Color=(0, 0, 0, 1))
    tree = bpy.context.scene.world.node_tree
    value, noise = tree.nodes.new("ShaderNodeValue"), tree.nodes.new("ShaderNodeTexNoise")
    tree.links.new(value.outputs[0], node.inputs["Density"])
    tree.links.new(noise.outputs[0], node.inputs["Anisotropy"])
    for density, absorbs in ((2.0, 2.0), (-1.0, 0.0)):
        value.outputs[0].default_value = density
        arrays = read()
        assert arrays.medium == pytest.approx(absorbs)
        assert arrays.warnings == ()


@pytest.mark.parametrize(
    ("kind", "what"), [("volumes", "a volume"), ("hair_curves", "hair"), ("pointclouds", "points")]
)
def test_objects_that_are_neither_meshes_nor_lamps_are_named(fill, read, kind, what):
    obj = bpy.data.objects.new("Smoke", getattr(bpy.data, kind).new("Smoke"))
    bpy.context.scene.collection.objects.link(obj)
    assert read().warnings == (f"object 'Smoke' ({what}) is not simulated: left out",)


def test_preview_looks_through_a_mesh_that_only_holds_a_volume(build, fill, command, tmp_path):
    build.camera((0.5, 0.5, 1.5))
    haze = bpy.data.materials.new("Haze")
    fill(haze, "ShaderNodeOutputMaterial", "ShaderNodeVolumeAbsorption", Density=1e-6)
    haze.node_tree.links.remove(haze.node_tree.nodes["Material Output"].inputs["Surface"].links[0])
    pictures = []
    for name in ("clear", "hazy"):
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / f"{name}.blend"))
        path = tmp_path / f"{name}.png"
        assert command("bake", "-o", tmp_path / "out.blend", "--preview", path) == (0, [])
        pictures.append(np.array(bpy.data.images.load(str(path)).pixels))
        box = build.cube("Haze", bpy.data.materials["Haze"])
        box.location = (0.5, 0.5, 1.1)
    assert pictures[0].max() > 0.1
    assert np.abs(pictures[0] - pictures[1]).mean() < 0.005
    assert not bpy.data.objects["Haze"].hide_render
