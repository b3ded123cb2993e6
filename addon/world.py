# SPDX-License-Identifier: GPL-3.0-or-later
"""The world as the sky of the core: a constant, or a picture of it that Cycles takes once, whatever its nodes are."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import fmm_core
import numpy as np

from .node_readers import DIFFUSE_RAY
from .node_values import output_of
from .volumes import without_nodes

if TYPE_CHECKING:
    import bpy

_WIDTH, _HEIGHT = 1024, 512
_SAMPLES = 4
# Parts of the picture that are so bright against the brightest pixel are taken again with some pixels around them, with
# so many samples in all and at most so many a pixel: a small sun must have its right power.
_BRIGHT, _AROUND = 0.02, 3
_BRIGHT_SAMPLES = 500_000
_MOST_SAMPLES = 4096
_OUTPUT, _PATH = "ShaderNodeOutputWorld", "ShaderNodeLightPath"
# What the node Light Path counts for light that goes straight to a surface, as Cycles bakes it.
_BOUNCES = {"Ray Depth": 2.0, "Diffuse Depth": 1.0}


def read_world(scene: bpy.types.Scene) -> tuple[fmm_core.Sky | None, list[str]]:
    """The sky of a scene, or None where it gives no light; and what was left out or replaced, in words.

    Raises fmm_core.Error naming the world where it cannot be read.
    """
    world = scene.world
    if world is None or not getattr(getattr(world, "cycles_visibility", None), "diffuse", True):
        return None, []
    constant, remarks = _constant(world), []
    if constant is None and not hasattr(scene, "cycles"):
        return None, ["its nodes are evaluated by Cycles, which is switched off: left out"]
    try:
        if constant is not None:
            sky = fmm_core.Sky(constant)
        else:
            sky, remarks = fmm_core.Sky(_picture(scene)), _remarks(world)
    except (fmm_core.Error, RuntimeError) as error:
        raise fmm_core.Error(f"world '{world.name}': {' '.join(str(error).split())}") from None
    return (None if sky.is_black else sky), remarks


def _constant(world: bpy.types.World) -> np.ndarray | None:
    """Radiance (3,) where that is the same all around, and plain to see."""
    if without_nodes(world):
        return np.array(world.color[:], np.float64)
    output = output_of(world.node_tree)
    links = output.inputs["Surface"].links if output is not None else ()
    if not links:
        return np.zeros(3)
    shader = links[0].from_node
    if shader.bl_idname != "ShaderNodeBackground":
        return None
    colour, strength = shader.inputs["Color"], shader.inputs["Strength"]
    if not strength.is_linked and strength.default_value == 0:
        return np.zeros(3)
    if colour.is_linked or strength.is_linked:
        return None
    return strength.default_value * np.array(colour.default_value[:3], np.float64)


def _remarks(world: bpy.types.World) -> list[str]:
    paths = [node for tree in _trees(world.node_tree) for node in tree.nodes if node.bl_idname == _PATH]
    if any(output.is_linked for node in paths for output in node.outputs if output.name in _BOUNCES):
        return ["its Light Path node counts bounces: the first one is taken for all"]
    return []


def _trees(tree: bpy.types.NodeTree, copied: bool = False) -> Iterator[bpy.types.NodeTree]:
    """A tree and those of the groups in it; copied: these are made its own first."""
    yield tree
    for node in tree.nodes:
        if node.bl_idname == "ShaderNodeGroup" and node.node_tree is not None:
            if copied:
                node.node_tree = node.node_tree.copy()
            yield from _trees(node.node_tree, copied)


def _show_as_to_surfaces(tree: bpy.types.NodeTree) -> None:
    """Let a tree tell the rays of a camera what it tells those of diffuse light."""
    for node in [node for node in tree.nodes if node.bl_idname == _PATH]:
        for output in node.outputs:
            for link in list(output.links):
                value = tree.nodes.new("ShaderNodeValue")
                value.outputs[0].default_value = _BOUNCES.get(output.name, float(output.name in DIFFUSE_RAY))
                tree.links.new(value.outputs[0], link.to_socket)


def _picture(scene: bpy.types.Scene) -> np.ndarray:
    """Radiance (H,W,3), rows from the top and columns as `fmm_core.Sky` has them."""
    import bpy

    before, groups = set(bpy.data.images), []
    copy = bpy.data.scenes.new("Radiosity world")
    camera = bpy.data.cameras.new("Radiosity world")
    eye = bpy.data.objects.new("Radiosity world", camera)
    try:
        copy.collection.objects.link(eye)
        _set_up(copy, scene, eye)
        for tree in _trees(copy.world.node_tree, copied=True):
            groups.append(tree)
            _show_as_to_surfaces(tree)
        with tempfile.TemporaryDirectory() as folder:
            copy.render.filepath = str(Path(folder, "world.exr"))
            image = _rendered(copy)
            brightness = image.sum(axis=2)
            if fmm_core.Sky(image).bright is not None:
                _take_again(copy, image, np.argwhere(brightness > _BRIGHT * brightness.max()))
    finally:
        bpy.data.worlds.remove(copy.world)
        for group in groups[1:]:
            bpy.data.node_groups.remove(group)
        bpy.data.objects.remove(eye)
        bpy.data.cameras.remove(camera)
        bpy.data.scenes.remove(copy)
        # Blender makes one for the result of its first render.
        for made in set(bpy.data.images) - before:
            bpy.data.images.remove(made)
    return image


def _set_up(copy: bpy.types.Scene, scene: bpy.types.Scene, eye: bpy.types.Object) -> None:
    """A scene with nothing but the world of another one, and a camera that sees all of it."""
    camera = eye.data
    camera.type = "PANO"
    owner = camera if hasattr(camera, "panorama_type") else camera.cycles
    owner.panorama_type = "EQUIRECTANGULAR"
    eye.rotation_euler = (np.pi / 2, 0.0, -np.pi / 2)
    copy.camera, copy.world = eye, scene.world.copy()
    # What is in the way of the sky is not part of it.
    tree = copy.world.node_tree
    for link in [link for link in tree.links if link.to_socket.name == "Volume" and link.to_node.bl_idname == _OUTPUT]:
        tree.links.remove(link)
    # Nothing is lit, so that nothing must be known of where the world is bright.
    copy.world.cycles.sampling_method = "NONE"
    copy.frame_set(scene.frame_current)
    render, cycles = copy.render, copy.cycles
    render.engine = "CYCLES"
    render.resolution_x, render.resolution_y, render.resolution_percentage = _WIDTH, _HEIGHT, 100
    render.image_settings.file_format, render.image_settings.color_depth = "OPEN_EXR", "32"
    cycles.device, cycles.samples = "CPU", _SAMPLES
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.pixel_filter_type, cycles.filter_width = "BOX", 1.0


def _take_again(copy: bpy.types.Scene, image: np.ndarray, pixels: np.ndarray) -> None:
    """Replace the part of the picture with the given (K,2) rows and columns by one of many samples."""
    top, left = np.maximum(pixels.min(axis=0) - _AROUND, 0)
    bottom, right = np.minimum(pixels.max(axis=0) + 1 + _AROUND, (_HEIGHT, _WIDTH))
    render = copy.render
    render.use_border = render.use_crop_to_border = True
    render.border_min_x, render.border_max_x = left / _WIDTH, right / _WIDTH
    render.border_min_y, render.border_max_y = 1 - bottom / _HEIGHT, 1 - top / _HEIGHT
    samples = _BRIGHT_SAMPLES // ((bottom - top) * (right - left))
    copy.cycles.samples = int(min(max(samples, _SAMPLES), _MOST_SAMPLES))
    part = _rendered(copy)
    if part.shape == (bottom - top, right - left, 3):
        image[top:bottom, left:right] = part


def _rendered(copy: bpy.types.Scene) -> np.ndarray:
    """Render; the picture (H,W,3), rows from the top."""
    import bpy

    bpy.ops.render.render(write_still=True, scene=copy.name)
    image = bpy.data.images.load(copy.render.filepath)
    try:
        width, height = image.size
        pixels = np.array(image.pixels[:], np.float64).reshape(height, width, -1)[::-1, :, :3]
    finally:
        bpy.data.images.remove(image)
    return np.maximum(np.nan_to_num(pixels, nan=0.0, posinf=0.0), 0.0)
