# SPDX-License-Identifier: GPL-3.0-or-later
"""What single shader nodes make of their inputs; each reader answers None where it cannot tell.

Values are arrays: (S,) for numbers, (S, 3) for colours and vectors, where S is 1 for what is the same everywhere.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

import numpy as np

from . import node_math
from .meshes import Asked
from .textures import Image, MissingImage, box

if TYPE_CHECKING:
    import bpy

    from .node_values import Values

Array = np.ndarray

#: Curves and colour ramps are read at so many places, as in Cycles.
STEPS = 256
#: What the node Light Path says of all that looks at a surface or a world here, diffuse light; of the rest it says no.
DIFFUSE_RAY = ("Is Diffuse Ray", "Is Reflection Ray")


def plain(socket: bpy.types.NodeSocket) -> Array:
    """The value of an input without a link."""
    value = getattr(socket, "default_value", 0.0)
    return np.array([value], float) if np.isscalar(value) else np.array([list(value)[:3]], float)


def asked(materials: Iterable[bpy.types.Material | None]) -> Asked:
    """What the nodes of materials, and of the groups among them, may ask of a mesh by name."""
    uv, attributes, seen = set(), set(), set()
    trees = [material.node_tree for material in materials if material is not None]
    while trees:
        tree = trees.pop()
        if tree is None or tree in seen:
            continue
        seen.add(tree)
        for node in tree.nodes:
            if node.bl_idname in ("ShaderNodeTexImage", "ShaderNodeTexCoord"):
                uv.add("")
            elif node.bl_idname == "ShaderNodeUVMap":
                uv.add(node.uv_map)
            elif node.bl_idname == "ShaderNodeAttribute":
                attributes.add((node.attribute_name, False))
            elif node.bl_idname == "ShaderNodeVertexColor":
                attributes.add((node.layer_name, True))
            elif node.bl_idname == "ShaderNodeGroup":
                trees.append(node.node_tree)
    return Asked(frozenset(uv), frozenset(attributes))


def _image(values: Values, node: bpy.types.Node, socket: bpy.types.NodeSocket) -> Array | None:
    image = node.image
    if image is None:
        raise MissingImage(f"texture '{node.name}' has no image")
    if node.projection not in ("FLAT", "BOX") or image.source not in ("FILE", "GENERATED"):
        return None
    if image not in values.images:
        values.images[image] = Image(image)
    pixels, points = values.images[image], values.points
    if pixels.strange_space:
        values.remarks.append(f"image '{image.name}' is in the colour space {pixels.strange_space}: read as linear")
    vector = node.inputs["Vector"]
    places = put(node, values.colour(vector) if vector.is_linked else _uv(values, ""))
    sides = [(np.ones(1), places)]
    if node.projection == "BOX":
        sides = box(places, points.mean(points.layers.normal), node.projection_blend)
    found = np.zeros((1, 4))
    for weight, on_side in sides:
        if len(on_side) == len(points.corners):
            points.texels.append(on_side[:, :2] * pixels.size)
        seen = pixels.at(on_side, node.interpolation, node.extension, node.outputs["Alpha"].is_linked)
        found = found + weight[:, None] * seen
    return found[:, 3] if socket.name == "Alpha" else found[:, :3]


def _uv(values: Values, name: str) -> Array:
    layer = values.points.layers.uv(name)
    if layer is None:
        values.points.of_object = True
        return np.zeros((1, 3))
    return values.points.mean(layer)


def _attribute(values: Values, node: bpy.types.Node, socket: bpy.types.NodeSocket) -> Array | None:
    of_colours = node.bl_idname == "ShaderNodeVertexColor"
    if not of_colours and node.attribute_type != "GEOMETRY":
        return None
    name = node.layer_name if of_colours else node.attribute_name
    layer = values.points.layers.attribute(name, of_colours)
    if layer is None:
        # Another mesh may have it.
        values.points.of_object = True
        values.remarks.append(f"attribute '{name}' is not there: 0 is used")
        return np.zeros(1) if socket.type == "VALUE" else np.zeros((1, 3))
    found = values.points.mean(layer)
    if socket.name == "Alpha":
        return found[:, 3] if found.shape[1] == 4 else np.ones(1)
    colour = np.repeat(found, 3, axis=1) if found.shape[1] == 1 else found[:, :3]
    return colour.mean(axis=1) if socket.name == "Fac" else colour


def _coordinates(values: Values, node: bpy.types.Node, socket: bpy.types.NodeSocket) -> Array | None:
    if node.bl_idname == "ShaderNodeUVMap":
        return None if node.from_instancer else _uv(values, node.uv_map)
    if node.from_instancer or (socket.name == "Object" and node.object is not None):
        return None
    layers = values.points.layers
    if socket.name == "UV":
        return _uv(values, "")
    if socket.name not in ("Generated", "Object"):
        return None
    return values.points.mean(layers.generated if socket.name == "Generated" else layers.position)


def _geometry(values: Values, node: bpy.types.Node, socket: bpy.types.NodeSocket) -> Array | None:
    if socket.name == "Backfacing":
        values.points.sided = True
        return np.array([float(values.points.back)])
    return values.points.mean(values.points.layers.world) if socket.name == "Position" else None


def _object_info(values: Values, node: bpy.types.Node, socket: bpy.types.NodeSocket) -> Array | None:
    name = {"Object Index": "index", "Color": "colour"}.get(socket.name, socket.name.lower())
    values.points.of_object = True
    return getattr(values.points.layers.about, name, None)


def _light_path(values: Values, node: bpy.types.Node, socket: bpy.types.NodeSocket) -> Array | None:
    return np.array([float(socket.name in DIFFUSE_RAY)]) if socket.name.startswith("Is ") else None


def _mapping(values: Values, node: bpy.types.Node, socket: bpy.types.NodeSocket) -> Array | None:
    vector, scale = values.colour(node.inputs["Vector"]), values.colour(node.inputs["Scale"])
    turned = node_math.rotation(values.colour(node.inputs["Rotation"]))
    moves = node.vector_type in ("POINT", "TEXTURE")
    shift = values.colour(node.inputs["Location"]) if moves else np.zeros((1, 3))
    return node_math.mapped(node.vector_type, vector, shift, turned, scale)


def put(node: bpy.types.Node, places: Array) -> Array:
    """Places (S, 3) where the panel Texture Mapping of a texture puts them, as in Cycles, which has no bounds."""
    own = node.texture_mapping
    axes = ["NONE", "X", "Y", "Z"]
    places = np.column_stack([np.zeros(len(places)), places])
    places = places[:, [axes.index(axis) for axis in (own.mapping_x, own.mapping_y, own.mapping_z)]]
    shift, angles, scale = (np.array([part[:]], float) for part in (own.translation, own.rotation, own.scale))
    return node_math.mapped(own.vector_type, places, shift, node_math.rotation(angles), scale)


def _mix(values: Values, node: bpy.types.Node, socket: bpy.types.NodeSocket) -> Array | None:
    if node.bl_idname == "ShaderNodeMixRGB":
        factor = np.clip(values.number(node.inputs[0]), 0, 1)[:, None]
        mixed = node_math.blend(node.blend_type, factor, values.colour(node.inputs[1]), values.colour(node.inputs[2]))
        return np.clip(mixed, 0, 1) if mixed is not None and node.use_clamp else mixed
    inputs = {each.identifier: each for each in node.inputs}
    kind = {"FLOAT": "Float", "VECTOR": "Vector", "RGBA": "Color"}.get(node.data_type)
    if kind is None:
        return None
    each = kind == "Vector" and node.factor_mode == "NON_UNIFORM"
    factor = values.colour(inputs["Factor_Vector"]) if each else values.number(inputs["Factor_Float"])[:, None]
    factor = np.clip(factor, 0, 1) if node.clamp_factor else factor
    a, b = values.colour(inputs[f"A_{kind}"]), values.colour(inputs[f"B_{kind}"])
    mixed = node_math.blend(node.blend_type if kind == "Color" else "MIX", factor, a, b)
    if mixed is None:
        return None
    mixed = np.clip(mixed, 0, 1) if kind == "Color" and node.clamp_result else mixed
    return mixed[:, 0] if kind == "Float" else mixed


def _curves(values: Values, node: bpy.types.Node, socket: bpy.types.NodeSocket) -> Array:
    factor, mapping = values.number(node.inputs[0])[:, None], node.mapping
    of_numbers = node.bl_idname == "ShaderNodeFloatCurve"
    before = values.number(node.inputs[1])[:, None] if of_numbers else values.colour(node.inputs[1])
    mapping.initialize()
    after = before
    # The curve for all colours comes first, and is the last in Blender's list.
    for curve in [[0]] if of_numbers else [[3, 3, 3], [0, 1, 2]]:
        after = np.column_stack([_curved(mapping, i, column) for i, column in zip(curve, after.T, strict=True)])
    mixed = (1 - factor) * before + factor * after
    return mixed[:, 0] if of_numbers else mixed


def _curved(mapping: bpy.types.CurveMapping, index: int, values: Array) -> Array:
    curve = mapping.curves[index]
    low, high = (min(0.0, curve.points[0].location.x), max(1.0, curve.points[-1].location.x))
    places = np.linspace(low, high, STEPS)
    table = np.array([mapping.evaluate(curve, place) for place in places])
    found = np.interp(values, places, table)
    if mapping.extend == "EXTRAPOLATED":
        step = places[1] - places[0]
        below, above = (table[1] - table[0]) / step, (table[-1] - table[-2]) / step
        found = found + below * np.minimum(values - low, 0) + above * np.maximum(values - high, 0)
    return found


def _ramp(values: Values, node: bpy.types.Node, socket: bpy.types.NodeSocket) -> Array:
    factor, ramp = np.clip(values.number(node.inputs[0]), 0, 1), node.color_ramp
    places = np.linspace(0, 1, STEPS)
    table = np.array([list(ramp.evaluate(place)) for place in places])
    if ramp.interpolation == "CONSTANT" and ramp.color_mode == "RGB":
        found = table[(factor * (STEPS - 1)).astype(int)]
    else:
        found = np.column_stack([np.interp(factor, places, column) for column in table.T])
    return found[:, 3] if socket.name == "Alpha" else found[:, :3]


def _hue_saturation(values: Values, node: bpy.types.Node, socket: bpy.types.NodeSocket) -> Array:
    hue, saturation, value, factor = (values.number(node.inputs[i]) for i in range(4))
    before = values.colour(node.inputs[4])
    h, s, v = node_math.rgb_to_hsv(before).T
    parts = np.broadcast_arrays((h + hue + 0.5) % 1.0, np.clip(s * saturation, 0, 1), v * value)
    after = np.maximum(node_math.hsv_to_rgb(np.column_stack(parts)), 0.0)
    return (1 - factor)[:, None] * before + factor[:, None] * after


def _invert(values: Values, node: bpy.types.Node, socket: bpy.types.NodeSocket) -> Array:
    factor, before = values.number(node.inputs[0])[:, None], values.colour(node.inputs[1])
    return (1 - factor) * before + factor * (1 - before)


def _bright_contrast(values: Values, node: bpy.types.Node, socket: bpy.types.NodeSocket) -> Array:
    bright, contrast = values.number(node.inputs["Bright"])[:, None], values.number(node.inputs["Contrast"])[:, None]
    return np.maximum((1 + contrast) * values.colour(node.inputs["Color"]) + bright - contrast / 2, 0.0)


def _gamma(values: Values, node: bpy.types.Node, socket: bpy.types.NodeSocket) -> Array:
    before, gamma = values.colour(node.inputs["Color"]), values.number(node.inputs["Gamma"])[:, None]
    return np.where(before > 0, np.power(np.maximum(before, 1e-300), gamma), before)


def _math(values: Values, node: bpy.types.Node, socket: bpy.types.NodeSocket) -> Array | None:
    operation = node_math.OPERATIONS.get(node.operation)
    if operation is None:
        return None
    with np.errstate(all="ignore"):
        found = np.nan_to_num(operation(*np.broadcast_arrays(*(values.number(each) for each in node.inputs))))
    return np.clip(found, 0, 1) if node.use_clamp else found


def _vector_math(values: Values, node: bpy.types.Node, socket: bpy.types.NodeSocket) -> Array | None:
    a, b, c = (values.colour(each) for each in node.inputs[:3])
    if node.operation in node_math.VECTOR_OPERATIONS:
        with np.errstate(all="ignore"):
            return np.nan_to_num(node_math.OPERATIONS[node.operation](*np.broadcast_arrays(a, b, c)))
    if node.operation == "FRACTION":
        return a - np.floor(a)
    if node.operation == "SCALE":
        return a * values.number(node.inputs["Scale"])[:, None]
    if node.operation == "DOT_PRODUCT":
        return (a * b).sum(axis=1)
    if node.operation in ("LENGTH", "DISTANCE"):
        return np.linalg.norm(a - (b if node.operation == "DISTANCE" else 0.0), axis=1)
    return None


def _map_range(values: Values, node: bpy.types.Node, socket: bpy.types.NodeSocket) -> Array | None:
    if node.data_type != "FLOAT" or node.interpolation_type not in ("LINEAR", "STEPPED", "SMOOTHSTEP"):
        return None
    value, low, high, to_low, to_high, steps = (values.number(each) for each in node.inputs[:6])
    share = (value - low) / np.where(high != low, high - low, np.inf)
    if node.interpolation_type == "SMOOTHSTEP":
        share = np.clip(share, 0, 1)
        share = share * share * (3 - 2 * share)
    elif node.interpolation_type == "STEPPED":
        share = np.floor(share * (steps + 1)) / np.where(steps > 0, steps, np.inf)
    found = to_low + share * (to_high - to_low)
    return np.clip(found, np.minimum(to_low, to_high), np.maximum(to_low, to_high)) if node.clamp else found


def _clamp(values: Values, node: bpy.types.Node, socket: bpy.types.NodeSocket) -> Array:
    value, low, high = (values.number(each) for each in node.inputs)
    if node.clamp_type == "RANGE":
        low, high = np.minimum(low, high), np.maximum(low, high)
    return np.minimum(np.maximum(value, low), high)


def _separate(values: Values, node: bpy.types.Node, socket: bpy.types.NodeSocket) -> Array | None:
    index = [each.identifier for each in node.outputs].index(socket.identifier)
    whole, mode = values.colour(node.inputs[0]), getattr(node, "mode", "RGB")
    if mode == "HSL":
        return None
    return (node_math.rgb_to_hsv(whole) if mode == "HSV" else whole)[:, index]


def _combine(values: Values, node: bpy.types.Node, socket: bpy.types.NodeSocket) -> Array | None:
    parts = np.column_stack(np.broadcast_arrays(*(values.number(each) for each in node.inputs[:3])))
    mode = getattr(node, "mode", "RGB")
    if mode == "HSL":
        return None
    return node_math.hsv_to_rgb(parts) if mode == "HSV" else parts


def _checker(values: Values, node: bpy.types.Node, socket: bpy.types.NodeSocket) -> Array:
    vector, scale = node.inputs["Vector"], values.number(node.inputs["Scale"])[:, None]
    places = values.colour(vector) if vector.is_linked else values.points.mean(values.points.layers.generated)
    places = put(node, places)
    values.points.fine = True
    # As Cycles, which keeps places on a border on one side.
    first = np.floor((places * scale + 1e-6) * 0.999999).sum(axis=1) % 2 == 1
    if socket.name == "Fac":
        return first.astype(float)
    return np.where(first[:, None], values.colour(node.inputs["Color1"]), values.colour(node.inputs["Color2"]))


def _grey(values: Values, node: bpy.types.Node, socket: bpy.types.NodeSocket) -> Array:
    return values.colour(node.inputs[0]) @ node_math.LUMINANCE


def _constant(values: Values, node: bpy.types.Node, socket: bpy.types.NodeSocket) -> Array:
    return plain(node.outputs[0])


READERS: dict[str, Callable[[Values, bpy.types.Node, bpy.types.NodeSocket], Array | None]] = {
    "ShaderNodeTexImage": _image,
    "ShaderNodeUVMap": _coordinates,
    "ShaderNodeTexCoord": _coordinates,
    "ShaderNodeNewGeometry": _geometry,
    "ShaderNodeLightPath": _light_path,
    "ShaderNodeObjectInfo": _object_info,
    "ShaderNodeAttribute": _attribute,
    "ShaderNodeVertexColor": _attribute,
    "ShaderNodeMapping": _mapping,
    "ShaderNodeRGB": _constant,
    "ShaderNodeValue": _constant,
    "ShaderNodeMix": _mix,
    "ShaderNodeMixRGB": _mix,
    "ShaderNodeRGBCurve": _curves,
    "ShaderNodeFloatCurve": _curves,
    "ShaderNodeValToRGB": _ramp,
    "ShaderNodeHueSaturation": _hue_saturation,
    "ShaderNodeInvert": _invert,
    "ShaderNodeBrightContrast": _bright_contrast,
    "ShaderNodeGamma": _gamma,
    "ShaderNodeMath": _math,
    "ShaderNodeVectorMath": _vector_math,
    "ShaderNodeMapRange": _map_range,
    "ShaderNodeClamp": _clamp,
    "ShaderNodeSeparateColor": _separate,
    "ShaderNodeSeparateXYZ": _separate,
    "ShaderNodeCombineColor": _combine,
    "ShaderNodeCombineXYZ": _combine,
    "ShaderNodeRGBToBW": _grey,
    "ShaderNodeTexChecker": _checker,
}
