# SPDX-License-Identifier: GPL-3.0-or-later
"""Lamps and world as they are read from a scene, and bakes by them; tests/cycles compares their numbers."""

import math

import bpy
import fmm_core
import numpy as np
import pytest
from scenes import baked


@pytest.fixture(autouse=True)
def few_particles(empty):
    bpy.context.scene.fmm_radiosity.particles = 300


def lamp(kind="POINT", name="Lamp", **fields):
    data = bpy.data.lights.new(name, kind)
    for field, value in fields.items():
        setattr(data, field, value)
    obj = bpy.data.objects.new(name, data)
    obj.location = (0.5, 0.5, 2)
    bpy.context.scene.collection.objects.link(obj)
    return obj


def world(colour=(0.1, 0.2, 0.3, 1.0), strength=2.0):
    made = bpy.data.worlds.new("Sky")
    if made.node_tree is None:
        made.use_nodes = True
    background = next(node for node in made.node_tree.nodes if node.type == "BACKGROUND")
    background.inputs["Color"].default_value, background.inputs["Strength"].default_value = colour, strength
    bpy.context.scene.world = made
    return made.node_tree, background


def test_every_kind_of_lamp_is_read(build, read):
    build.quad("Floor")
    lamp("POINT", "a", energy=4 * math.pi, color=(1, 0.5, 0), shadow_soft_size=0.2, use_soft_falloff=False)
    lamp("SPOT", "b", energy=4 * math.pi, spot_size=1.0, spot_blend=0.3, use_soft_falloff=True).rotation_euler.x = 0.5
    lamp("SUN", "c", energy=3, angle=0.1).scale = (2, 2, 2)
    lamp("AREA", "d", energy=10, shape="ELLIPSE", size=2, size_y=0.5, spread=1.0).scale = (1, 2, -1)
    point, spot, sun, area = read().lights
    assert (point.position, point.intensity, point.disc) == ((0.5, 0.5, 2.0), pytest.approx((1, 0.5, 0)), False)
    assert (point.radius, spot.blend) == (pytest.approx(0.2), pytest.approx(0.3))
    assert spot.direction == pytest.approx((0, math.sin(0.5), -math.cos(0.5)), abs=1e-6)
    assert (spot.disc, spot.angle) == (True, pytest.approx(1.0))
    assert (sun.direction, sun.irradiance) == (pytest.approx((0, 0, -1)), pytest.approx((3, 3, 3)))
    assert np.cross(area.u, area.v)[2] == pytest.approx(1 * 0.5)
    assert area.radiance == pytest.approx([10 / math.pi / (math.pi * 0.5)] * 3, rel=1e-5)
    assert (area.ellipse, area.spread) == (True, pytest.approx(1.0))


def test_instanced_lamps_shine_where_they_are_shown(build, read):
    build.quad("Floor")
    group, source = bpy.data.collections.new("Group"), lamp(energy=5)
    bpy.context.scene.collection.objects.unlink(source)
    group.objects.link(source)
    for x in (1.0, 3.0):
        holder = bpy.data.objects.new("Holder", None)
        holder.instance_type, holder.instance_collection, holder.location = "COLLECTION", group, (x, 0, 0)
        bpy.context.scene.collection.objects.link(holder)
    assert [light.position for light in read().lights] == [(1.5, 0.5, 2.0), (3.5, 0.5, 2.0)]


def test_the_scale_of_a_spot_stretches_its_cone(build, read):
    build.quad("Floor")
    lamp("SPOT").scale = (2, 1, 0.5)
    (spot,) = read().lights
    assert spot.stretch == ((2, 0, 0), (0, 1, 0), (0, 0, 0.5))


@pytest.mark.parametrize(("kind", "told"), [("AREA", 1), ("SPOT", 0), ("SUN", 0)])
def test_a_sheared_area_lamp_is_named(build, read, kind, told):
    build.quad("Floor")
    parent = bpy.data.objects.new("Parent", None)
    bpy.context.scene.collection.objects.link(parent)
    parent.scale.z = 2
    obj = lamp(kind)
    obj.rotation_euler.x, obj.scale = 0.5, (1, 2, 1)
    assert read().warnings == ()
    obj.parent = parent
    bpy.context.view_layer.update()
    found = "light 'Lamp' is sheared: it shines at right angles to its shape, other than in Cycles"
    assert read().warnings == (found,) * told


@pytest.mark.parametrize("kind", ["AREA", "SUN", "SPOT"])
def test_lamps_without_size_or_direction_are_left_out(build, read, kind):
    build.room()
    data = bpy.data.lights.new("flat", kind)
    lamp = bpy.data.objects.new("flat", data)
    lamp.scale = (0, 0, 0) if kind == "SUN" else (0, 1, 1)
    bpy.context.scene.collection.objects.link(lamp)
    bpy.context.view_layer.update()
    arrays = read()
    assert arrays.lights == ()
    assert arrays.warnings == ("light 'flat' has a size or scale of 0: left out",)


def test_lamps_that_light_nothing_are_left_out(build, read):
    build.quad("Floor", build.light())
    lamp(name="hidden").hide_render = True
    lamp(name="not for diffuse").visible_diffuse = False
    lamp(name="off", energy=0)
    lamp(name="black", color=(0, 0, 0))
    lamp("AREA", "portal").data.cycles.is_portal = True
    lamp(name="minus", energy=-3)
    arrays = read()
    assert arrays.lights == ()
    assert arrays.warnings == ("light 'minus' has negative power, which is not simulated: left out",)


@pytest.mark.parametrize("how", ["eye", "switch", "eye of the collection", "switch of the collection"])
def test_lamps_that_only_the_viewport_hides_are_named(build, read, how):
    build.quad("Floor", build.light())
    group = bpy.data.collections.new("Group")
    bpy.context.scene.collection.children.link(group)
    for name in ("shown", "not rendered"):
        obj = lamp(name=name)
        bpy.context.scene.collection.objects.unlink(obj)
        group.objects.link(obj)
    bpy.data.objects["not rendered"].hide_render = True
    bpy.context.view_layer.update()
    assert len(read().lights) == 1
    if how == "eye":
        bpy.data.objects["shown"].hide_set(True)
    elif how == "switch":
        bpy.data.objects["shown"].hide_viewport = True
    elif how == "eye of the collection":
        bpy.context.view_layer.layer_collection.children["Group"].hide_viewport = True
    else:
        group.hide_viewport = True
    arrays = read()
    assert arrays.lights == ()
    assert arrays.warnings == ("light 'shown' is hidden in the viewport: left out",)


def test_nodes_of_a_lamp_multiply_its_power_or_are_named(build, read):
    build.quad("Floor")
    obj = lamp(energy=4 * math.pi)
    obj.data.use_nodes = True
    tree = obj.data.node_tree
    emission = next(node for node in tree.nodes if node.type == "EMISSION")
    emission.inputs["Color"].default_value, emission.inputs["Strength"].default_value = (1, 0.5, 0, 1), 3.0
    arrays = read()
    assert arrays.lights[0].intensity == pytest.approx((3, 1.5, 0))
    assert arrays.warnings == ()
    paint, double = tree.nodes.new("ShaderNodeRGB"), tree.nodes.new("ShaderNodeMath")
    paint.outputs[0].default_value, double.operation = (0.2, 0.4, 0.6, 1), "ADD"
    double.inputs[0].default_value = double.inputs[1].default_value = 1.0
    tree.links.new(paint.outputs[0], emission.inputs["Color"])
    tree.links.new(double.outputs[0], emission.inputs["Strength"])
    arrays = read()
    assert arrays.lights[0].intensity == pytest.approx((0.4, 0.8, 1.2))
    fire = tree.nodes.new("ShaderNodeBlackbody")
    fire.inputs[0].default_value = 2000
    tree.links.new(fire.outputs[0], emission.inputs["Color"])
    arrays = read()
    red, _, blue = arrays.lights[0].intensity
    assert red > 10 * blue >= 0
    assert arrays.warnings == ()
    tree.links.new(tree.nodes.new("ShaderNodeTexImage").outputs[0], emission.inputs["Color"])
    tree.links.new(tree.nodes.new("ShaderNodeTexNoise").outputs[0], double.inputs[0])
    assert [text.split(" of ")[0] for text in read().warnings] == ["light 'Lamp' Strength", "light 'Lamp' Color"]
    tree.links.remove(emission.inputs["Color"].links[0])
    tree.links.new(tree.nodes.new("ShaderNodeLightFalloff").outputs[0], emission.inputs["Strength"])
    (warning,) = read().warnings
    assert "light 'Lamp' Strength of its node 'Emission'" in warning


def test_what_is_not_simulated_is_named(build, read):
    build.quad("Floor")
    build.quad("Catcher", z=-1).is_shadow_catcher = True
    build.quad("Hole", z=-2).is_holdout = True
    obj = lamp()
    for shines in obj, build.quad("Panel", build.light(), z=1):
        shines.light_linking.receiver_collection = bpy.data.collections.new("Only these")
        shines.light_linking.blocker_collection = bpy.data.collections.new("Trees")
    obj.data.cycles.max_bounces = 1
    arrays = read()
    assert arrays.warnings == (
        "object 'Catcher' is a shadow catcher, which is not simulated: it gets colours as others do",
        "object 'Hole' is a holdout, which is not simulated: it gets colours as others do",
        "light 'Lamp' has a limit of 1 bounces, which is not simulated",
        "light 'Lamp' is linked to light collection 'Only these', which is not simulated: it lights everything",
        "light 'Lamp' is linked to be shaded by collection 'Trees', which is not simulated: everything shades it",
        "object 'Panel' is linked to light collection 'Only these.001', which is not simulated: it lights everything",
        "object 'Panel' is linked to be shaded by collection 'Trees.001', which is not simulated: everything shades it",
    )


def test_objects_hidden_from_rays_are_lit_all_the_same(build, read):
    """Without diffuse rays they meet no light of surfaces, without shadow rays none of lamps, and without both none."""
    build.quad("Floor", z=-1)
    lamp()
    hidden = build.quad("Hidden", build.light())
    assert read().shade is None
    for ray, other in (("diffuse", "of lamps and the sky, but"), ("shadow", "of surfaces")):
        hidden.visible_diffuse, hidden.visible_shadow = ray != "diffuse", ray != "shadow"
        arrays = read()
        assert arrays.opacity.mean.tolist() == [1, 1, *[float(ray != "diffuse")] * 2]
        assert arrays.shade.mean.tolist() == [1, 1, *[float(ray != "shadow")] * 2]
        (warning,) = arrays.warnings
        assert f"object 'Hidden' is hidden from {ray} rays alone: it" in warning
        assert other in warning
    hidden.visible_diffuse = hidden.visible_camera = hidden.visible_glossy = False
    arrays = read()
    assert arrays.triangles[:, 0, 2].tolist() == [-1, -1]
    assert arrays.shade is None
    assert [receiver.object for receiver in arrays.receivers] == ["Floor", "Hidden"]
    assert arrays.corner_emission[4:] == pytest.approx(math.pi)
    assert arrays.warnings == ()


def test_a_veil_hidden_from_diffuse_rays_shades_by_its_alpha(build, read):
    build.quad("Floor", z=-1)
    lamp()
    alpha = build.material("Veil", "ShaderNodeBsdfPrincipled", Alpha=0.25)
    build.quad("Veil", alpha).visible_diffuse = False
    arrays = read()
    assert arrays.opacity.mean.tolist() == [1, 1, 0, 0]
    assert arrays.shade.mean == pytest.approx([1, 1, 0.25, 0.25])


def test_copies_are_hidden_from_the_rays_that_their_instancer_is(build, read):
    build.quad("Floor", build.light())
    group = bpy.data.collections.new("Group")
    group.objects.link(build.quad("Copied", z=1, link=False))
    holder = bpy.data.objects.new("Holder", None)
    holder.instance_type, holder.instance_collection = "COLLECTION", group
    holder.visible_diffuse = holder.visible_shadow = False
    bpy.context.scene.collection.objects.link(holder)
    assert not read().triangles[..., 2].any()


def test_lamp_without_shadow_has_none(build, read):
    build.quad("Floor")
    lamp(use_shadow=False)
    assert not read().lights[0].shadows


def test_even_world_is_read_and_a_dark_one_is_none(build, read):
    build.quad("Floor", build.light())
    assert read().sky is None
    _, background = world()
    assert read().sky.radiance.ravel() == pytest.approx((0.2, 0.4, 0.6))
    bpy.context.scene.world.cycles_visibility.diffuse = False
    assert read().sky is None
    bpy.context.scene.world.cycles_visibility.diffuse = True
    background.inputs["Strength"].default_value = 0
    assert read().sky is None


def test_world_of_any_nodes_is_a_picture_and_nothing_is_left_behind(build, read):
    build.quad("Floor")
    tree, background = world(strength=1.0)
    place, mix = tree.nodes.new("ShaderNodeTexCoord"), tree.nodes.new("ShaderNodeVectorMath")
    mix.operation = "MAXIMUM"
    mix.inputs[1].default_value = (0, 0, 0)
    tree.links.new(place.outputs["Generated"], mix.inputs[0])
    tree.links.new(mix.outputs[0], background.inputs["Color"])
    kinds = "scenes", "worlds", "cameras", "objects", "images"
    before = [len(getattr(bpy.data, kind)) for kind in kinds]
    arrays = read()
    assert before == [len(getattr(bpy.data, kind)) for kind in kinds]
    assert bpy.context.scene.world.cycles.sampling_method == "AUTOMATIC"
    assert arrays.warnings == ()
    # Red from +x, green from +y, blue from above: a surface that looks there gets 2/3 pi of it, its colour alone.
    floor = fmm_core.solve(fmm_core.Scene(arrays.triangles - [0.5, 0.5, 50], 0.0, sky=arrays.sky))
    found = floor.irradiance(np.zeros((3, 3)), np.eye(3))
    assert np.diag(found) == pytest.approx([2 * math.pi / 3] * 3, rel=0.01)


def test_a_world_whose_picture_is_black_gives_no_light(build, read):
    build.room()
    tree, background = world(strength=1.0)
    picture = tree.nodes.new("ShaderNodeTexEnvironment")
    picture.image = bpy.data.images.new("Night", 8, 4)
    tree.links.new(picture.outputs["Color"], background.inputs["Color"])
    arrays = read()
    assert (arrays.sky, arrays.warnings) == (None, ())


def test_default_scene_bakes():
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    bpy.context.scene.fmm_radiosity.particles = 300
    assert bpy.ops.fmm_radiosity.bake() == {"FINISHED"}
    colours = baked(bpy.data.meshes["Cube"])[:, :3]
    # The grey world alone gives 0.05 * 0.8; with the lamp the middle of the top has 0.41.
    assert colours.min() == pytest.approx(0.04, rel=0.05)
    assert 0.41 < colours.max() < 0.6


@pytest.mark.parametrize("grouped", [False, True])
def test_the_world_shines_as_rays_of_diffuse_light_see_it(build, read, grouped):
    build.quad("Floor")
    tree, background = world()
    path, bright = tree.nodes.new("ShaderNodeLightPath"), tree.nodes.new("ShaderNodeBackground")
    bright.inputs["Strength"].default_value = 9.0
    seen = path.outputs["Is Camera Ray"]
    if grouped:
        inner = bpy.data.node_groups.new("Inner", "ShaderNodeTree")
        inner.interface.new_socket("Seen", in_out="OUTPUT", socket_type="NodeSocketFloat")
        result = inner.nodes.new("NodeGroupOutput")
        inner.links.new(inner.nodes.new("ShaderNodeLightPath").outputs["Is Camera Ray"], result.inputs[0])
        group = tree.nodes.new("ShaderNodeGroup")
        group.node_tree = inner
        seen = group.outputs[0]
    mixed = tree.nodes.new("ShaderNodeMixShader")
    tree.links.new(seen, mixed.inputs["Fac"])
    tree.links.new(background.outputs[0], mixed.inputs[1])
    tree.links.new(bright.outputs[0], mixed.inputs[2])
    tree.links.new(mixed.outputs[0], tree.get_output_node("CYCLES").inputs["Surface"])
    before = len(tree.nodes), len(bpy.data.node_groups), len(tree.links)
    arrays = read()
    assert arrays.sky.radiance.reshape(-1, 3).mean(axis=0) == pytest.approx((0.2, 0.4, 0.6), rel=1e-5)
    assert (len(tree.nodes), len(bpy.data.node_groups), len(tree.links)) == before
    assert arrays.warnings == ()
    tree.links.new(path.outputs["Is Diffuse Ray"], mixed.inputs["Fac"])
    assert read().sky.radiance.reshape(-1, 3).mean(axis=0) == pytest.approx([9 * 0.8] * 3, rel=1e-5)
    tree.links.new(path.outputs["Diffuse Depth"], mixed.inputs["Fac"])
    assert read().warnings == ("world 'Sky': its Light Path node counts bounces: the first one is taken for all",)
    # What Cycles bakes onto a plane under a world of these strengths.
    for name, strength in (("Diffuse Depth", 1.0), ("Ray Depth", 2.0)):
        tree.links.new(path.outputs[name], bright.inputs["Strength"])
        tree.links.new(bright.outputs[0], tree.get_output_node("CYCLES").inputs["Surface"])
        assert read().sky.radiance.reshape(-1, 3).mean(axis=0) == pytest.approx([0.8 * strength] * 3, rel=1e-5)


def test_other_power_and_sky_trace_no_ray(build, fmm):
    build.room()
    obj, (_, background) = lamp(energy=50), world()
    bpy.data.objects["Box"].location.z = 0.9

    def bake():
        assert bpy.ops.fmm_radiosity.bake() == {"FINISHED"}
        return baked(bpy.data.meshes["Floor"]), fmm.session.session.report["counts"]["rays"]

    before, rays = bake()
    assert rays > 0
    obj.data.energy, obj.data.color = 500, (1, 0.2, 0.1)
    background.inputs["Color"].default_value = (0.0, 1.0, 0.0, 1.0)
    after, rays = bake()
    assert rays == 0
    assert after[:, 0].mean() > 2 * before[:, 0].mean()
    background.inputs["Strength"].default_value = 0
    without_sky, rays = bake()
    assert rays == 0
    fmm.session.session.solution = None
    fresh, rays = bake()
    assert rays > 0
    assert without_sky == pytest.approx(fresh, rel=1e-3)
    obj.location.x += 0.2
    moved, rays_of_lamp = bake()
    assert 0 < rays_of_lamp < rays
    fmm.session.session.solution = None
    assert moved == pytest.approx(bake()[0], rel=1e-3)
