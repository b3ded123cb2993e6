# SPDX-License-Identifier: GPL-3.0-or-later
"""What materials become: shaders, alpha, sides, and means over triangles."""

import math

import bpy
import numpy as np
import pytest
from fmm_core import Error

PRINCIPLED, MIX, CLEAR = "ShaderNodeBsdfPrincipled", "ShaderNodeMixShader", "ShaderNodeBsdfTransparent"


@pytest.fixture
def lamp(build):
    return build.quad("Lamp", build.light(), z=5, down=True)


def image(pixels, name="Picture", space="Non-Color"):
    """An image of (H, W, 4) values, the lowest row first."""
    height, width = np.shape(pixels)[:2]
    made = bpy.data.images.new(name, width, height, alpha=True)
    made.colorspace_settings.name = space
    made.pixels.foreach_set(np.asarray(pixels, np.float32).ravel())
    made.pack()
    return made


def mapped(obj):
    """A UV map over the whole image."""
    obj.data.uv_layers.new(name="UVMap").uv.foreach_set("vector", [0, 0, 1, 0, 1, 1, 0, 1])
    return obj


def textured(material, name, pixels, alpha=None, **settings):
    """Puts an image at a socket of a material's shader, and its alpha at another."""
    tree = material.node_tree
    shader = next(node for node in tree.nodes if name in node.inputs)
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image = image(pixels)
    for key, value in settings.items():
        setattr(node, key, value)
    tree.links.new(node.outputs["Color"], shader.inputs[name])
    if alpha:
        tree.links.new(node.outputs["Alpha"], shader.inputs[alpha])
    return material


def mixed(material, first, second, factor, kind=MIX):
    """Puts a mix of two shaders, each a type and its inputs, at the output of a material."""
    tree = material.node_tree
    node = tree.nodes.new(kind)
    for socket, (shader, inputs) in zip(list(node.inputs)[-2:], (first, second), strict=True):
        part = tree.nodes.new(shader)
        for name, value in inputs.items():
            part.inputs[name].default_value = value
        tree.links.new(part.outputs[0], socket)
    if factor is not None:
        node.inputs[0].default_value = factor
    tree.links.new(node.outputs[0], next(n for n in tree.nodes if n.type == "OUTPUT_MATERIAL").inputs["Surface"])
    return node


def of(arrays, z):
    """Rows of the triangles at a height."""
    return np.flatnonzero(np.abs(arrays.triangles[:, :, 2] - z).max(axis=1) < 1e-6)


def test_shaders_are_mixed_and_added(build, lamp, read):
    red, light = ("ShaderNodeBsdfDiffuse", {"Color": (0.8, 0, 0, 1)}), ("ShaderNodeEmission", {"Strength": 2.0})
    mixed_one, added = build.material("Mixed"), build.material("Added")
    mixed(mixed_one, red, light, 0.25)
    mixed(added, red, light, None, "ShaderNodeAddShader")
    build.quad("Mixed", mixed_one)
    build.quad("Added", added, z=1)
    arrays = read()
    assert arrays.albedo[of(arrays, 0)] == pytest.approx(np.tile([0.6, 0, 0], (2, 1)), abs=1e-5)
    assert arrays.emission[of(arrays, 0)] == pytest.approx(0.5 * math.pi, rel=1e-5)
    assert arrays.albedo[of(arrays, 1)] == pytest.approx(np.tile([0.8, 0, 0], (2, 1)), abs=1e-5)
    assert arrays.emission[of(arrays, 1)] == pytest.approx(2 * math.pi, rel=1e-5)
    assert (arrays.opacity.mean == 1).all()
    assert not arrays.warnings


def test_the_output_is_that_of_cycles(build, lamp, read):
    material = build.material("Two")
    tree = material.node_tree
    own = next(node for node in tree.nodes if node.type == "OUTPUT_MATERIAL")
    glow = tree.nodes.new("ShaderNodeEmission")
    other = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(glow.outputs[0], other.inputs["Surface"])
    build.quad("Wall", material)
    for target, shines in (("EEVEE", False), ("CYCLES", True)):
        other.target = target
        assert (read().emission[2:] > 0).any() == shines
    own.is_active_output = True
    assert (read().emission[2:] > 0).any()


def test_what_is_transparent_keeps_the_colour_of_the_rest(build, lamp, read):
    red, clear = ("ShaderNodeBsdfDiffuse", {"Color": (0.8, 0, 0, 1)}), (CLEAR, {})
    veil = build.material("Veil")
    mixed(veil, clear, red, 0.25)
    build.quad("Veil", veil)
    build.quad("Ghost", build.material("Ghost", PRINCIPLED, Base_Color=(0.1, 0.2, 0.3), Alpha=0.0), z=1)
    arrays = read()
    assert arrays.opacity.mean[of(arrays, 0)] == pytest.approx(0.25)
    assert arrays.albedo[of(arrays, 0)] == pytest.approx(np.tile([0.8, 0, 0], (2, 1)), abs=1e-5)
    assert (arrays.opacity.mean[of(arrays, 1)] == 0).all()
    ghost = next(receiver for receiver in arrays.receivers if receiver.mesh == "Ghost")
    assert arrays.corner_albedo[ghost.rows] == pytest.approx(np.tile([0.1, 0.2, 0.3], (4, 1)), abs=1e-4)


def test_plastic_and_metal_reflect_more_than_their_base_colour(build, lamp, read):
    for z, inputs in enumerate(({}, {"Roughness": 0.0}, {"Metallic": 1.0}, {"Specular IOR Level": 0.0})):
        material = build.material(f"M{z}", PRINCIPLED, Base_Color=(0.5, 0.5, 0.5))
        for name, value in {"IOR": 1.5, **inputs}.items():
            next(iter(material.node_tree.nodes)).inputs[name].default_value = value
        build.quad(f"Q{z}", material, z=z)
    arrays = read()
    # Directional albedo of Cycles 4.2 under an even sky, averaged by cosine.
    for z, cycles in enumerate((0.5291, 0.5435, 0.4799, 0.5)):
        assert arrays.albedo[of(arrays, z)] == pytest.approx(cycles, abs=0.003)
    for receiver in arrays.receivers:
        if receiver.mesh != "Lamp":
            assert arrays.corner_albedo[receiver.rows] == pytest.approx(0.5, abs=1e-5)


def test_a_texture_counts_by_its_mean_and_a_large_triangle_is_cut(build, lamp, read):
    pixels = np.random.default_rng(0).random((16, 16, 4))
    pixels[..., 3] = 1.0
    mapped(build.quad("Wall", textured(build.material("Paint"), "Color", pixels, interpolation="Closest")))
    arrays = read()
    rows = of(arrays, 0)
    assert 100 < len(rows) <= 2 * 32 * 32
    areas = np.linalg.norm(np.cross(*(arrays.triangles[rows, i] - arrays.triangles[rows, 0] for i in (1, 2))), axis=1)
    assert areas.sum() / 2 == pytest.approx(1.0, rel=1e-6)
    kept = np.round(pixels[..., :3] * 255) / 255
    assert areas @ arrays.albedo[rows] / 2 == pytest.approx(kept.mean(axis=(0, 1)), rel=0.01)
    # Each part has the colour of its place.
    centres = arrays.triangles[rows].mean(axis=1)
    left = centres[:, 0] < 0.5
    halves = [kept[:, :8].mean(axis=(0, 1)), kept[:, 8:].mean(axis=(0, 1))]
    for half, expected in zip((left, ~left), halves, strict=True):
        assert areas[half] @ arrays.albedo[rows][half] / areas[half].sum() == pytest.approx(expected, rel=0.03)


def test_parts_of_a_wall_meet_exactly(build, lamp, read):
    """Else they would count as meshes of their own that touch."""
    pixels = np.random.default_rng(0).random((8, 8, 4))
    wall = mapped(build.quad("Wall", textured(build.material("Paint"), "Color", pixels)))
    wall.rotation_euler, wall.location = (0.3, 0.4, 0.5), (0.1, 0.2, 0.3)
    arrays = read()
    rows = np.flatnonzero(arrays.triangles[:, :, 2].max(axis=1) < 4)
    corners = np.unique(arrays.triangles[rows].reshape(-1, 3), axis=0)
    close = np.unique(arrays.triangles[rows].reshape(-1, 3).round(4), axis=0)
    assert len(rows) > 100
    assert len(corners) == len(close)


def test_an_even_texture_cuts_nothing(build, lamp, read):
    pixels = np.full((8, 8, 4), 1.0)
    mapped(build.quad("Wall", textured(build.material("Paint"), "Color", pixels * 0.5)))
    arrays = read()
    assert len(of(arrays, 0)) == 2


def test_small_triangles_are_not_cut(build, lamp, read):
    pixels = np.random.default_rng(0).random((16, 16, 4))
    mapped(build.quad("Stamp", textured(build.material("Paint"), "Color", pixels))).scale = (0.05, 0.05, 1)
    arrays = read()
    assert len(of(arrays, 0)) == 2


@pytest.mark.parametrize("mirrored", [False, True])
def test_alpha_is_kept_in_cells_where_it_lies(build, lamp, read, mirrored):
    pixels = np.ones((64, 64, 4))
    pixels[:, :32, 3] = 0.0
    pixels[:16, :, 3] = 0.0
    leaf = build.material("Leaf", PRINCIPLED, Roughness=1.0)
    leaf = mapped(build.quad("Leaf", textured(leaf, "Base Color", pixels, "Alpha", interpolation="Closest")))
    leaf.scale = (-1 if mirrored else 1, 1, 1)
    arrays = read()
    rows, rng = of(arrays, 0), np.random.default_rng(1)
    areas = np.linalg.norm(np.cross(*(arrays.triangles[rows, i] - arrays.triangles[rows, 0] for i in (1, 2))), axis=1)
    assert arrays.opacity.mean[rows] @ areas / 2 == pytest.approx(0.5 * 0.75, abs=0.005)
    chosen = rows[rng.integers(len(rows), size=4000)]
    u, v = rng.random((2, 4000))
    u, v = np.where(u + v > 1, (1 - u, 1 - v), (u, v))
    a, b, c = np.moveaxis(arrays.triangles[chosen], 1, 0)
    x, y, _ = np.abs((a + u[:, None] * (b - a) + v[:, None] * (c - a)).T)
    there = (x > 0.5) & (y > 0.25)
    edge = (np.abs(x - 0.5) < 0.02) | (np.abs(y - 0.25) < 0.02)
    found = arrays.opacity.at(chosen, u, v)
    assert (found[~edge] == there[~edge]).all()


def test_a_light_with_a_dark_back_shines_one_way(build, read):
    material = build.light("One way")
    tree = material.node_tree
    emission = next(node for node in tree.nodes if node.type == "EMISSION")
    node = mixed(material, ("ShaderNodeEmission", {}), ("ShaderNodeBsdfDiffuse", {"Color": (0, 0, 0, 1)}), 0.0)
    tree.links.new(tree.nodes.new("ShaderNodeNewGeometry").outputs["Backfacing"], node.inputs[0])
    tree.links.new(emission.outputs[0], node.inputs[1])
    build.quad("Lamp", material)
    build.quad("Other", build.light(), z=1)
    arrays = read()
    assert not arrays.two_sided[of(arrays, 0)].any()
    assert arrays.two_sided[of(arrays, 1)].all()
    assert arrays.emission[of(arrays, 0)] == pytest.approx(math.pi, rel=1e-5)
    node.inputs[2].links[0].from_node.inputs["Color"].default_value = (1, 0, 0, 1)
    assert any("its back differs" in text for text in read().warnings)


def test_noise_is_evaluated_and_leaves_nothing_behind(build, lamp, read):
    """Also where it is finer than samples, and as even: bricks whose joints would all fall between two of them."""
    material = build.material("Bricks")
    tree = material.node_tree
    node, place = tree.nodes.new("ShaderNodeTexBrick"), tree.nodes.new("ShaderNodeTexCoord")
    for name in ("Color1", "Color2"):
        node.inputs[name].default_value = (0.8, 0.8, 0.8, 1.0)
    node.inputs["Mortar"].default_value, node.inputs["Mortar Smooth"].default_value = (0.0, 0.0, 0.0, 1.0), 0.0
    node.inputs["Scale"].default_value, node.inputs["Mortar Size"].default_value = 32.0, 0.02
    tree.links.new(place.outputs["Object"], node.inputs["Vector"])
    shader = next(each for each in tree.nodes if each.type == "BSDF_DIFFUSE")
    tree.links.new(node.outputs["Color"], shader.inputs["Color"])
    build.quad("Wall", material)
    kinds = "scenes", "meshes", "objects", "node_groups", "materials"
    before = [getattr(bpy.data, kind).keys() for kind in kinds]
    arrays = read()
    assert before == [getattr(bpy.data, kind).keys() for kind in kinds]
    assert not arrays.warnings
    rows = of(arrays, 0)
    areas = np.linalg.norm(np.cross(*(arrays.triangles[rows, i] - arrays.triangles[rows, 0] for i in (1, 2))), axis=1)
    # Bricks of 0.5 by 0.25, with joints of twice their size in all.
    expected = 0.8 * (1 - 0.04 / 0.5) * (1 - 0.04 / 0.25)
    assert areas @ arrays.albedo[rows, 0] / areas.sum() == pytest.approx(expected, rel=0.01)


def test_a_lost_image_is_named(build, lamp, read):
    material = textured(build.material("Paint", Color=(0.1, 0.2, 0.3)), "Color", np.ones((2, 2, 4)))
    next(node for node in material.node_tree.nodes if node.type == "TEX_IMAGE").image = lost = bpy.data.images.new(
        "L", 2, 2
    )
    lost.source, lost.filepath = "FILE", "/nowhere/lost.png"
    mapped(build.quad("Wall", material))
    arrays = read()
    assert any("'Paint'" in text and "image 'L' is missing" in text for text in arrays.warnings)
    assert arrays.albedo[of(arrays, 0)] == pytest.approx(np.tile([0.1, 0.2, 0.3], (2, 1)))


def test_a_texture_without_numbers_is_an_error(build, lamp, read):
    pixels = np.ones((2, 2, 4))
    material = textured(build.material("Paint"), "Color", pixels)
    node = next(node for node in material.node_tree.nodes if node.type == "TEX_IMAGE")
    node.image = bpy.data.images.new("Broken", 2, 2, float_buffer=True)
    node.image.pixels.foreach_set(np.full(16, np.nan, np.float32))
    mapped(build.quad("Wall", material))
    with pytest.raises(Error, match="material 'Paint': Color is nan"):
        read()


def test_what_shines_where_it_is_transparent_is_kept(build, read):
    glow = build.material("Flame")
    mixed(glow, (CLEAR, {}), ("ShaderNodeEmission", {"Strength": 2.0}), None, "ShaderNodeAddShader")
    build.quad("Flame", glow)
    arrays = read()
    assert arrays.emission * arrays.opacity.mean[:, None] == pytest.approx(np.full((2, 3), 2 * math.pi))
    assert arrays.opacity.mean == pytest.approx(1 / 16)
    assert any("'Flame'" in text and "shines where it is transparent" in text for text in arrays.warnings)


def test_nodes_that_are_made_of_themselves_are_named(build, read):
    build.room()
    tree = bpy.data.materials["Red"].node_tree
    noise, shader = tree.nodes.new("ShaderNodeTexNoise"), tree.nodes["Diffuse BSDF"]
    tree.links.new(noise.outputs["Color"], noise.inputs["Vector"])
    tree.links.new(noise.outputs["Color"], shader.inputs["Color"])
    (text,) = read().warnings
    assert text.startswith("material 'Red' on object 'Floor': Color comes from 'Noise Texture', which is not read")
    mix = tree.nodes.new("ShaderNodeMixShader")
    shader.inputs["Color"].default_value = (0.4, 0.4, 0.4, 1.0)
    tree.links.remove(shader.inputs["Color"].links[0])
    tree.links.new(shader.outputs[0], mix.inputs[1])
    tree.links.new(mix.outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    (text,) = read().warnings
    assert text == "material 'Red' on object 'Floor': shader 'Mix Shader' is made of itself: left out there"


def test_a_group_that_only_passes_itself_on_is_named(build, read):
    build.room()
    group = bpy.data.node_groups.new("Passes", "ShaderNodeTree")
    for way in ("INPUT", "OUTPUT"):
        group.interface.new_socket("Color", in_out=way, socket_type="NodeSocketColor")
    group.links.new(group.nodes.new("NodeGroupInput").outputs[0], group.nodes.new("NodeGroupOutput").inputs[0])
    tree = bpy.data.materials["Red"].node_tree
    node = tree.nodes.new("ShaderNodeGroup")
    node.node_tree = group
    tree.links.new(node.outputs[0], node.inputs[0])
    tree.links.new(node.outputs[0], tree.nodes["Diffuse BSDF"].inputs["Color"])
    tree.links.new(node.outputs[0], tree.nodes["Material Output"].inputs["Volume"])
    (text,) = read().warnings
    assert text.startswith("material 'Red' on object 'Floor': Color comes from")


@pytest.mark.parametrize(
    ("output", "said"),
    [("Is Camera Ray", 0), ("Is Shadow Ray", 0), ("Is Diffuse Ray", 1), ("Is Glossy Ray", 0), ("Is Reflection Ray", 1)],
)
def test_light_path_says_what_it_does_to_diffuse_light(build, read, lamp, output, said):
    material = build.light("Trick")
    tree = material.node_tree
    shader = next(node for node in tree.nodes if node.type == "EMISSION")
    tree.links.new(tree.nodes.new("ShaderNodeLightPath").outputs[output], shader.inputs["Strength"])
    build.quad("Sheet", material)
    arrays = read()
    assert arrays.emission[2:] == pytest.approx(np.full((2, 3), math.pi * said))
    assert arrays.warnings == ()


@pytest.mark.parametrize(
    ("inputs", "size", "told"),
    [
        ({"Metallic": 1.0}, 1.0, True),
        ({"Metallic": 0.9, "Roughness": 0.9}, 1.0, True),
        ({"Metallic": 1.0}, 0.03, False),
        ({"Metallic": 0.3}, 1.0, False),
        ({"Roughness": 0.0}, 1.0, False),
    ],
)
def test_metal_that_lights_others_is_named(build, read, lamp, inputs, size, told):
    steel = build.material("Steel", PRINCIPLED)
    for name, value in inputs.items():
        steel.node_tree.nodes[0].inputs[name].default_value = value
    build.quad("Floor", build.material())
    build.quad("Sheet", steel, z=1).scale = (size, size, 1)
    bpy.context.view_layer.update()
    text = "what metal and gloss of material 'Steel' reflect is taken as diffuse: light around may be some percent off"
    assert read().warnings == (text,) * told
