# SPDX-License-Identifier: GPL-3.0-or-later
"""What Cycles bakes and this does not is named in the warnings, and nothing else is."""

import pytest


@pytest.fixture
def warnings(build, read):
    """Those of a scene that has a lamp besides."""
    build.quad("Lamp", build.light(), z=5, down=True)
    return lambda: read().warnings


@pytest.fixture
def said(build, warnings):
    """What is said of a material."""

    def said(material):
        build.quad("Sheet", material)
        return [text.removeprefix("material 'Odd' on object 'Sheet': ") for text in warnings()]

    return said


ROUGH = "Roughness of shader 'Diffuse BSDF' is not simulated, it scatters as a matt one"


@pytest.mark.parametrize(
    ("shader", "inputs", "text"),
    [
        ("ShaderNodeBsdfDiffuse", {}, None),
        ("ShaderNodeBsdfDiffuse", {"Roughness": 0.5}, ROUGH),
        ("ShaderNodeBsdfSheen", {}, "shader 'Sheen BSDF' is taken as diffuse reflection"),
        ("ShaderNodeBsdfToon", {}, "shader 'Toon BSDF' is taken as diffuse reflection"),
        ("ShaderNodeBsdfTranslucent", {}, "shader 'Translucent BSDF' is taken as diffuse reflection"),
    ],
)
def test_what_scatters_otherwise_is_named(build, said, shader, inputs, text):
    assert said(build.material("Odd", shader, **inputs)) == [text] * (text is not None)


def linked(material, node, output, shader, socket, **inputs):
    """Puts a node at an input of a material's shader or output; returns the node."""
    tree = material.node_tree
    node = tree.nodes.new(node)
    for name, value in inputs.items():
        node.inputs[name].default_value = value
    tree.links.new(node.outputs[output], tree.nodes[shader].inputs[socket])
    return node


@pytest.mark.parametrize(
    ("node", "output", "inputs", "told"),
    [
        ("ShaderNodeNormalMap", "Normal", {}, True),
        ("ShaderNodeBump", "Normal", {}, True),
        ("ShaderNodeBump", "Normal", {"Strength": 0.0}, False),
        ("ShaderNodeNewGeometry", "Normal", {}, False),
    ],
)
def test_normals_of_a_material_are_named(build, said, node, output, inputs, told):
    material = build.material("Odd")
    name = linked(material, node, output, "Diffuse BSDF", "Normal", **inputs).name
    text = f"Normal comes from '{name}', which is not simulated: the mesh's own is used"
    assert said(material) == [text] * told


def test_a_muted_normal_map_is_not_named(build, said):
    material = build.material("Odd")
    linked(material, "ShaderNodeBump", "Normal", "Diffuse BSDF", "Normal").mute = True
    assert said(material) == []


@pytest.mark.parametrize("method", ["BUMP", "DISPLACEMENT", "BOTH"])
def test_displacement_is_named(build, said, method):
    material = build.material("Odd")
    material.displacement_method = method
    linked(material, "ShaderNodeDisplacement", "Displacement", "Material Output", "Displacement")
    assert said(material) == ["its displacement is not simulated, the mesh's own shape is used"]


@pytest.mark.parametrize(("colour", "told"), [((0.5, 0.5, 0.5), False), ((0.9, 0.5, 0.1), True)])
def test_coloured_transparency_is_named(build, said, colour, told):
    text = "the colour of shader 'Transparent BSDF' is not simulated, its mean is used"
    assert said(build.material("Odd", "ShaderNodeBsdfTransparent", Color=colour)) == [text] * told
