# SPDX-License-Identifier: GPL-3.0-or-later
"""A node group for materials: base colour times baked light."""

from __future__ import annotations

import bpy

GROUP = "Radiosity Light"
#: The input of a shader that holds its base colour.
_BASE = ("Base Color", "Color")
_WHITE = (1.0, 1.0, 1.0, 1.0)


def add(material: bpy.types.Material, attribute: str, multiply: bool) -> bpy.types.Node:
    """Add the group to a material, beside what it has, or set up the one that is there already; returns its node.

    attribute: the name of the baked colours; multiply: whether they are light alone, which the base colour of the
    material is then linked to
    """
    tree, group = material.node_tree, _group(attribute)
    shader = next((other for other in tree.nodes if other.type.startswith("BSDF") and _base_of(other)), None)
    node = next((other for other in tree.nodes if other.type == "GROUP" and other.node_tree == group), None)
    if node is None:
        node = tree.nodes.new("ShaderNodeGroup")
        node.node_tree = group
        if shader is not None:
            node.location = shader.location[0], shader.location[1] + 200
    own = node.inputs["Base Color"]
    for link in own.links:
        tree.links.remove(link)
    own.default_value = _WHITE
    if shader is not None and multiply:
        _share(tree, _base_of(shader), own)
    return node


def _group(attribute: str) -> bpy.types.NodeTree:
    """The group for an attribute, made on first use."""
    name = GROUP if attribute == "Radiosity" else f"{GROUP} ({attribute})"
    found = bpy.data.node_groups.get(name)
    if found is not None and found.bl_idname == "ShaderNodeTree":
        return found
    tree = bpy.data.node_groups.new(name, "ShaderNodeTree")
    base = tree.interface.new_socket("Base Color", in_out="INPUT", socket_type="NodeSocketColor")
    base.default_value = _WHITE
    tree.interface.new_socket("Color", in_out="OUTPUT", socket_type="NodeSocketColor")
    tree.interface.new_socket("Shader", in_out="OUTPUT", socket_type="NodeSocketShader")
    kinds = ("NodeGroupInput", "ShaderNodeAttribute", "ShaderNodeVectorMath", "ShaderNodeEmission", "NodeGroupOutput")
    given, baked, product, shines, result = (tree.nodes.new(kind) for kind in kinds)
    baked.attribute_name, product.operation = attribute, "MULTIPLY"
    for node, place in ((given, (0, 0)), (baked, (0, -150)), (product, (200, 0)), (shines, (400, -100)),
                        (result, (600, 0))):  # fmt: skip
        node.location = place
    tree.links.new(given.outputs["Base Color"], product.inputs[0])
    tree.links.new(baked.outputs["Color"], product.inputs[1])
    tree.links.new(product.outputs["Vector"], result.inputs["Color"])
    tree.links.new(product.outputs["Vector"], shines.inputs["Color"])
    tree.links.new(shines.outputs["Emission"], result.inputs["Shader"])
    return tree


def _base_of(shader: bpy.types.Node) -> bpy.types.NodeSocket | None:
    return next((shader.inputs[name] for name in _BASE if name in shader.inputs), None)


def _share(tree: bpy.types.NodeTree, base: bpy.types.NodeSocket, socket: bpy.types.NodeSocket) -> None:
    """Give a socket what the base colour has: the same link, or else the same value."""
    if base.is_linked:
        tree.links.new(base.links[0].from_socket, socket)
    else:
        socket.default_value = base.default_value[:]
