# SPDX-License-Identifier: GPL-3.0-or-later
"""Shader nodes that Geometry Nodes have as well, noise above all: Blender itself evaluates them at many places at once.

That takes milliseconds, and gives what Cycles gives. It is done on a scene of its own, which is gone afterwards.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np

from .meshes import get

if TYPE_CHECKING:
    import bpy

Array = np.ndarray

#: What the scene and all that is in it is called.
SCRATCH = ".FMM Radiosity"
#: Textures that are mapped by generated coordinates where nothing is linked.
GENERATED = {f"ShaderNodeTex{name}" for name in
             ("Noise", "Musgrave", "Voronoi", "Wave", "Magic", "Brick", "Gradient", "Gabor")}  # fmt: skip
#: All that can be evaluated here.
FIELDS = GENERATED | {f"ShaderNode{name}" for name in
                      ("TexWhiteNoise", "VectorRotate", "VectorMath", "Mix", "MapRange", "Blackbody")}  # fmt: skip
_RESULT = "result"


def evaluate(node: bpy.types.Node, output: bpy.types.NodeSocket, inputs: dict[str, Array]) -> Array:
    """What an output of one of FIELDS is worth, (S,) or (S, 3), for values of some of its inputs, by identifier, each
    (S,) or (S, 3) or one for all; the others have their plain values.
    """
    count = max((len(value) for value in inputs.values()), default=1)
    with _scratch() as (scene, mesh, tree):
        mesh.vertices.add(count)
        field = _copied(tree, node)
        for socket in field.inputs:
            if socket.identifier in inputs:
                tree.links.new(_given(mesh, tree, socket.identifier, inputs[socket.identifier]), socket)
        found = next(each for each in field.outputs if each.identifier == output.identifier)
        _store(tree, found)
        layer = scene.view_layers[0]
        layer.update()
        values = _mesh_of(scene, layer).attributes[_RESULT].data
        result = get(values, "vector", np.float32, 3).astype(np.float64)
    if node.bl_idname == "ShaderNodeTexGradient":
        # Cycles does so.
        result = np.clip(result, 0, 1)
    return result[:, 0] if output.type == "VALUE" else result


@contextmanager
def _scratch() -> Iterator[tuple[bpy.types.Scene, bpy.types.Mesh, bpy.types.NodeTree]]:
    """A scene with one object, its mesh, and the tree of its geometry nodes."""
    import bpy

    data, made = bpy.data, []
    try:
        for kind, more in (("scenes", ()), ("meshes", ()), ("node_groups", ("GeometryNodeTree",))):
            made.append((kind, getattr(data, kind).new(SCRATCH, *more)))
        (_, scene), (_, mesh), (_, tree) = made
        obj = data.objects.new(SCRATCH, mesh)
        made.append(("objects", obj))
        scene.collection.objects.link(obj)
        obj.modifiers.new(SCRATCH, "NODES").node_group = tree
        yield scene, mesh, tree
    finally:
        for kind, block in reversed(made):
            getattr(data, kind).remove(block)


def _mesh_of(scene: bpy.types.Scene, layer: bpy.types.ViewLayer) -> bpy.types.Mesh:
    """The evaluated mesh of the only object."""
    return scene.collection.objects[0].evaluated_get(layer.depsgraph).data


def _copied(tree: bpy.types.NodeTree, node: bpy.types.Node) -> bpy.types.Node:
    """The same node in another tree, without its links."""
    import bpy

    copy, common = tree.nodes.new(node.bl_idname), bpy.types.ShaderNode.bl_rna.properties
    for name, field in node.bl_rna.properties.items():
        if name not in common and not field.is_readonly:
            setattr(copy, name, getattr(node, name))
    for own, other in zip(copy.inputs, node.inputs, strict=True):
        if hasattr(other, "default_value"):
            own.default_value = other.default_value
    return copy


def _given(mesh: bpy.types.Mesh, tree: bpy.types.NodeTree, name: str, values: Array) -> bpy.types.NodeSocket:
    """An output that has these values at the vertices of the mesh."""
    width = 3 if values.ndim == 2 else 1
    kind, of = ("FLOAT_VECTOR", "vector") if width == 3 else ("FLOAT", "value")
    values = np.broadcast_to(values, (len(mesh.vertices), *values.shape[1:]))
    mesh.attributes.new(name, kind, "POINT").data.foreach_set(of, values.astype(np.float32).ravel())
    node = tree.nodes.new("GeometryNodeInputNamedAttribute")
    node.data_type, node.inputs["Name"].default_value = kind, name
    return next(each for each in node.outputs if each.enabled and each.name == "Attribute")


def _store(tree: bpy.types.NodeTree, found: bpy.types.NodeSocket) -> None:
    """Let the geometry nodes write an output to the attribute _RESULT."""
    for way in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    start, end = tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput")
    store = tree.nodes.new("GeometryNodeStoreNamedAttribute")
    store.data_type, store.inputs["Name"].default_value = "FLOAT_VECTOR", _RESULT
    tree.links.new(start.outputs[0], store.inputs["Geometry"])
    tree.links.new(found, next(each for each in store.inputs if each.enabled and each.name == "Value"))
    tree.links.new(store.outputs[0], end.inputs[0])
