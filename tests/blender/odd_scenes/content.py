# SPDX-License-Identifier: GPL-3.0-or-later
"""All that is in a file, as plain values that can be compared: every datablock, but for the attribute "Radiosity"."""

import hashlib

import bpy
import numpy as np

# What changes by looking at it or by undo, or is compared as arrays below.
SKIPPED = {
    "rna_type", "original", "users", "is_evaluated", "is_runtime_data", "session_uid", "depsgraph", "preview",
    "id_data", "bl_rna", "is_updated", "is_updated_data", "fmm_radiosity", "statistics", "is_dirty", "bindcode",
    "has_data", "pixels", "view_layers", "tool_settings", "sequence_editor",
}  # fmt: skip
ARRAYS = {"vertices", "edges", "loops", "polygons", "loop_triangles", "attributes", "color_attributes", "uv_layers",
          "vertex_normals", "polygon_normals", "corner_normals", "loop_triangle_polygons", "vertex_colors",
          "loop_triangle_polygon_indices", "skin_vertices", "vertex_paint_masks"}  # fmt: skip
WIDTHS = {"FLOAT": ("value", 1, np.float32), "INT": ("value", 1, np.int32), "BOOLEAN": ("value", 1, bool),
          "FLOAT2": ("vector", 2, np.float32), "FLOAT_VECTOR": ("vector", 3, np.float32),
          "FLOAT_COLOR": ("color", 4, np.float32), "BYTE_COLOR": ("color", 4, np.float32),
          "INT32_2D": ("value", 2, np.int32)}  # fmt: skip
OF_THE_WINDOW = {"screens", "window_managers", "workspaces", "brushes", "palettes"}
DEPTH = 4


def content():
    """Every datablock by its collection and name, library included."""
    found = {}
    for collection in bpy.data.bl_rna.properties:
        if collection.type == "COLLECTION" and collection.identifier not in OF_THE_WINDOW:
            for block in getattr(bpy.data, collection.identifier):
                key = collection.identifier, block.name_full
                found[key] = _struct(block, 0) | (_mesh(block) if isinstance(block, bpy.types.Mesh) else {})
    return found


def _struct(struct, depth):
    skipped = SKIPPED | ARRAYS if isinstance(struct, bpy.types.Mesh) else SKIPPED
    names = [prop.identifier for prop in struct.bl_rna.properties if prop.identifier not in skipped]
    return {name: _value(struct, name, depth) for name in names}


def _value(struct, name, depth):
    prop, value = struct.bl_rna.properties[name], getattr(struct, name, None)
    if prop.type == "POINTER":
        return _pointed(value, depth)
    if prop.type == "COLLECTION":
        return [_pointed(each, depth) for each in value]
    if getattr(prop, "is_array", False):
        return repr(list(value))
    return repr(value)


def _pointed(value, depth):
    if value is None or depth >= DEPTH:
        return value is not None
    if isinstance(value, bpy.types.ID) and not (depth == 0 and value.is_embedded_data):
        return value.name_full
    return _struct(value, depth + 1)


def _mesh(mesh):
    """The attributes of a mesh, as digests."""
    found = {"counts": [len(mesh.vertices), len(mesh.edges), len(mesh.loops), len(mesh.polygons)]}
    for attribute in mesh.attributes:
        if attribute.name != "Radiosity" and attribute.data_type in WIDTHS:
            name, width, dtype = WIDTHS[attribute.data_type]
            values = np.zeros(width * len(attribute.data), dtype)
            attribute.data.foreach_get(name, values)
            digest = hashlib.sha1(values.tobytes()).hexdigest()
            found[attribute.name] = attribute.domain, attribute.data_type, digest
    return found
