# SPDX-License-Identifier: GPL-3.0-or-later
"""What the sockets of a shader tree are worth at places on a mesh, all places at once.

Values are arrays: (S,) for numbers, (S, 3) for colours and vectors, where S is 1 for what is the same everywhere.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from . import node_fields, node_math
from .node_readers import READERS, plain, put

if TYPE_CHECKING:
    import bpy

    from .meshes import Layers
    from .textures import Image

Array = np.ndarray


class Unreadable(Exception):
    """A node whose value cannot be found here; the text names it."""


@dataclass
class Points:
    """S places on a mesh: each a mean, by weights (S, K), of its corners (S, K).

    back: seen from the back; texels: places (S, 2) among the pixels of each image that was asked for
    varies, sided: whether anything was asked for that differs from place to place, or from front to back
    fine: whether anything was that may differ a lot, and comes from no image; of_object: or from object to object
    """

    layers: Layers
    corners: Array
    weights: Array
    back: bool = False
    varies: bool = False
    sided: bool = False
    fine: bool = False
    of_object: bool = False
    texels: list[Array] = field(default_factory=list)

    def mean(self, of_corners: Array) -> Array:
        """(S, D) of what the corners (C, D) of the mesh carry."""
        self.varies = True
        return np.einsum("sk,skd->sd", self.weights, of_corners[self.corners])


class Values:
    """Evaluates sockets of one shader tree; `images` holds what was read before."""

    def __init__(self, points: Points, images: dict[bpy.types.Image, Image]) -> None:
        self.points, self.images = points, images
        self.remarks: list[str] = []
        self._known: dict[tuple[int, ...], Array] = {}
        # The group nodes that are being looked into, the outermost first, and the inputs that are.
        self._groups: list[bpy.types.Node] = []
        self._inputs: set[tuple[int, ...]] = set()

    def number(self, socket: bpy.types.NodeSocket) -> Array:
        """(S,) of an input; raises Unreadable."""
        return as_number(self._input(socket), socket)

    def colour(self, socket: bpy.types.NodeSocket) -> Array:
        """(S, 3) of an input, colour or vector; raises Unreadable."""
        value = self._input(socket)
        return np.repeat(value[:, None], 3, axis=1) if value.ndim == 1 else value

    def source(self, socket: bpy.types.NodeSocket) -> bpy.types.NodeSocket | None:
        """The output, or the input of a group node, that an input gets its value from; None where nothing is linked.

        Reroutes, muted nodes and the bounds of groups are passed: see `within`. Raises Unreadable where they go round.
        """
        passed = set()
        while True:
            if self._key(socket) in passed:
                raise Unreadable(socket.node.name)
            passed.add(self._key(socket))
            link = next((link for link in socket.links if link.is_valid and not link.is_muted), None)
            if link is None:
                return None
            output, node = link.from_socket, link.from_node
            if node.mute:
                inner = next((each for each in node.internal_links if each.to_socket == output), None)
                if inner is None:
                    return None
                socket = inner.from_socket
            elif node.bl_idname == "NodeReroute":
                socket = node.inputs[0]
            elif node.bl_idname == "ShaderNodeGroup" and node.node_tree is not None:
                ends = [each for each in node.node_tree.nodes if each.bl_idname == "NodeGroupOutput"]
                end = next((each for each in ends if each.is_active_output), None)
                if end is None:
                    return None
                self._groups.append(node)
                socket = _twin(end.inputs, output)
            elif node.bl_idname == "NodeGroupInput" and self._groups:
                socket = _twin(self._groups.pop().inputs, output)
            else:
                return output
            if not socket.is_linked:
                return socket

    def within(self, socket: bpy.types.NodeSocket, use: Callable[[bpy.types.NodeSocket | None], object]) -> object:
        """What `use` makes of the source of an input, inside of the groups that it lies in.

        Raises Unreadable where an input gets its value from itself.
        """
        before, key = list(self._groups), self._key(socket)
        if key in self._inputs:
            raise Unreadable(socket.node.name)
        self._inputs.add(key)
        try:
            return use(self.source(socket) if socket.is_linked else None)
        finally:
            self._groups = before
            self._inputs.remove(key)

    def _key(self, socket: bpy.types.NodeSocket) -> tuple[int, ...]:
        return *(group.as_pointer() for group in self._groups), socket.as_pointer()

    def _input(self, socket: bpy.types.NodeSocket) -> Array:
        return self.within(socket, lambda source: self._output(source) if source is not None else plain(socket))

    def _output(self, socket: bpy.types.NodeSocket) -> Array:
        if not socket.is_output:
            return plain(socket)
        key = self._key(socket)
        if key not in self._known:
            node = socket.node
            reader = READERS.get(node.bl_idname)
            found = reader(self, node, socket) if reader else None
            if found is None and node.bl_idname in node_fields.FIELDS:
                found = self._field(node, socket)
            if found is None:
                raise Unreadable(node.name)
            self._known[key] = found
        return self._known[key]

    def _field(self, node: bpy.types.Node, socket: bpy.types.NodeSocket) -> Array:
        given = {}
        for each in node.inputs:
            of_texture = each.name == "Vector" and node.bl_idname in node_fields.GENERATED
            if each.enabled and each.is_linked:
                given[each.identifier] = self.number(each) if each.type == "VALUE" else self.colour(each)
            elif of_texture:
                given[each.identifier] = self.points.mean(self.points.layers.generated)
            if of_texture:
                given[each.identifier] = put(node, given[each.identifier])
        self.points.fine |= any(len(values) > 1 for values in given.values())
        return node_fields.evaluate(node, socket, given)


def output_of(tree: bpy.types.NodeTree) -> bpy.types.Node | None:
    """The output that Cycles uses of the nodes of a material, a world or a lamp, or None."""
    return tree.get_output_node("CYCLES")


def nowhere() -> Values:
    """For trees that belong to no mesh: what a node asks of one is unreadable."""
    return Values(Points(_Nowhere(), np.zeros((1, 1), int), np.ones((1, 1))), {})


class _Nowhere:
    def __getattr__(self, name: str) -> None:
        raise Unreadable(name)


def _twin(sockets: bpy.types.bpy_prop_collection, of: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    return next(each for each in sockets if each.identifier == of.identifier)


def as_number(value: Array, socket: bpy.types.NodeSocket | None = None) -> Array:
    """(S,) of a value; colours become grey, vectors the mean of their components."""
    if value.ndim == 1:
        return value
    of_vector = socket is not None and socket.links and socket.links[0].from_socket.type == "VECTOR"
    return value.mean(axis=1) if of_vector else value @ node_math.LUMINANCE
