# SPDX-License-Identifier: GPL-3.0-or-later
"""A small Cycles picture of a baked scene: every mesh with a surface shows its colour attribute and nothing else.

It is rendered in a copy of the scene with a material, a view layer override and, where needed, a camera of its own;
all of that is removed again.
"""

from __future__ import annotations

import errno
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from fmm_core import Error

from .materials import is_air

if TYPE_CHECKING:
    import bpy

SIZE = 512
SAMPLES = 16
_PNG_END = b"IEND\xaeB`\x82"


def render(scene: bpy.types.Scene, layer: bpy.types.ViewLayer, corners: np.ndarray, name: str, path: Path) -> None:
    """Render the baked scene to a PNG file, from its camera or, without one, from where everything is in view.

    corners (C,3): positions in m that a camera of its own has to see; name: the attribute to show. Raises
    fmm_core.Error where Blender cannot render, OSError where the file is not whole.
    """
    import bpy

    material = _attribute_material(name, _white(scene))
    images = set(bpy.data.images)
    unseen = [obj for obj in scene.objects if not obj.hide_render and _is_air(obj)]
    copy = scene.copy()
    camera = None
    try:
        for other in copy.view_layers:
            other.material_override = material
        if copy.camera is None:
            camera = _fitted_camera(copy, corners)
        _set_up(copy, path)
        for obj in unseen:
            obj.hide_render = True
        bpy.ops.render.render(write_still=True, scene=copy.name, layer=layer.name)
    except RuntimeError as error:
        raise Error(f"the preview could not be rendered: {' '.join(str(error).split())}") from None
    finally:
        for obj in unseen:
            obj.hide_render = False
        bpy.data.scenes.remove(copy)
        if camera is not None:
            bpy.data.cameras.remove(camera)
        bpy.data.materials.remove(material)
        for image in set(bpy.data.images) - images:
            bpy.data.images.remove(image)
    # Blender does not mind a disk that is full.
    if not path.is_file() or not path.read_bytes().endswith(_PNG_END):
        raise OSError(errno.EIO, "Blender could not save it, is the disk full?")


def _is_air(obj: bpy.types.Object) -> bool:
    """Whether an object is a mesh that only holds a volume."""
    return obj.type == "MESH" and bool(obj.material_slots) and all(is_air(slot.material) for slot in obj.material_slots)


def _white(scene: bpy.types.Scene) -> float:
    """Radiance that the exposure of a scene shows as white."""
    return 2.0**-scene.view_settings.exposure / scene.cycles.film_exposure


def _attribute_material(name: str, white: float) -> bpy.types.Material:
    """Emission from the attribute, cut at white: a lamp as it is would outshine the other samples of a pixel."""
    import bpy

    material = bpy.data.materials.new("Radiosity preview")
    if material.node_tree is None:
        material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    attribute = nodes.new("ShaderNodeAttribute")
    attribute.attribute_name = name
    emission = nodes.new("ShaderNodeEmission")
    output = nodes.new("ShaderNodeOutputMaterial")
    shown = nodes.new("ShaderNodeVectorMath")
    shown.operation = "MINIMUM"
    shown.inputs[1].default_value = (white, white, white)
    links.new(attribute.outputs["Color"], shown.inputs[0])
    links.new(shown.outputs["Vector"], emission.inputs["Color"])
    links.new(emission.outputs["Emission"], output.inputs["Surface"])
    return material


def _set_up(scene: bpy.types.Scene, path: Path) -> None:
    scene.world = None
    render = scene.render
    render.engine = "CYCLES"
    render.resolution_x = render.resolution_y = SIZE
    render.resolution_percentage = 100
    render.pixel_aspect_x = render.pixel_aspect_y = 1.0
    render.use_border = render.use_compositing = render.use_sequencer = render.film_transparent = False
    render.use_motion_blur = render.use_multiview = render.use_file_extension = False
    render.filepath = str(path)
    render.image_settings.file_format = "PNG"
    render.image_settings.color_mode = "RGB"
    scene.view_settings.view_transform = "Standard"
    scene.view_settings.look = "None"
    scene.cycles.device = "CPU"
    scene.cycles.samples = SAMPLES
    scene.cycles.max_bounces = 0
    scene.cycles.use_denoising = scene.cycles.use_adaptive_sampling = False


def _fitted_camera(scene: bpy.types.Scene, corners: np.ndarray) -> bpy.types.Camera:
    """A camera that sees the bounding sphere of the corners, from the front, somewhat from the right and above."""
    import bpy
    from mathutils import Vector

    low, high = corners.min(axis=0), corners.max(axis=0)
    radius = max(float(np.linalg.norm(high - low)) / 2, 1e-6)
    data = bpy.data.cameras.new("Radiosity preview")
    camera = bpy.data.objects.new("Radiosity preview", data)
    direction = Vector((0.5, -1.0, 0.4)).normalized()
    distance = radius / np.sin(data.angle / 2)
    camera.location = Vector((low + high) / 2) + direction * distance
    camera.rotation_euler = direction.to_track_quat("Z", "Y").to_euler()
    data.clip_start, data.clip_end = distance / 1000, distance * 3
    scene.collection.objects.link(camera)
    scene.camera = camera
    return data
