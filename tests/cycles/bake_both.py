# SPDX-License-Identifier: GPL-3.0-or-later
"""Run in a process of its own: bakes a .blend with this project and with Cycles, and saves both irradiances.

python bake_both.py SCENE.blend SAMPLES SEEDS OUT.npz: ours (C, 3), cycles (SEEDS, C, 3), W/m^2 at every corner of the
receivers, and inside (C,) bool: the corner's vertex is surrounded by faces of one plane, so that both agree on what
is asked for.
"""

import importlib
import sys
from collections.abc import Set

import bpy
import numpy as np

from addon import standalone
from addon.cycles import unbiased


def main(scene: str, samples: int, seeds: int, out: str) -> None:
    package = standalone._load_extension()
    package.register()
    bpy.ops.wm.open_mainfile(filepath=scene)
    bake = importlib.import_module("fmm_radiosity.addon.bake")
    settings = importlib.import_module("fmm_core").Settings()
    data = bake.read(bpy.context, colours="POINTS")
    result = bake.compute(data, settings)
    reflected = np.pi * result.colours - result.arrays.corner_emission
    ours = reflected / np.maximum(result.arrays.corner_albedo, 1e-9)
    prepare_cycles(samples)
    cycles = np.array([cycles_bake(result.arrays, seed) for seed in range(seeds)])
    np.savez(out, ours=ours, cycles=cycles, inside=inside(result.arrays))
    package.unregister()


def prepare_cycles(samples: int) -> None:
    """Cycles without any bias, as the study and the benchmark against it have it."""
    unbiased(bpy.context.scene)
    bpy.context.scene.cycles.samples = samples


def cycles_bake(arrays: object, seed: int, passes: Set[str] = frozenset({"DIRECT", "INDIRECT"})) -> np.ndarray:
    """Irradiance (C, 3) in W/m^2."""
    bpy.context.scene.cycles.seed = seed
    objects = [bpy.data.objects[receiver.object] for receiver in arrays.receivers]
    for obj in bpy.context.view_layer.objects:
        obj.select_set(obj in objects)
    bpy.context.view_layer.objects.active = objects[0]
    for obj in objects:
        attribute = obj.data.color_attributes.get("Cycles") or obj.data.color_attributes.new(
            "Cycles", "FLOAT_COLOR", "CORNER"
        )
        obj.data.color_attributes.active_color = attribute
    bpy.ops.object.bake(type="DIFFUSE", pass_filter=set(passes))
    colours = np.zeros((len(arrays.corner_position), 3))
    for receiver, obj in zip(arrays.receivers, objects, strict=True):
        values = np.empty(4 * (receiver.rows.stop - receiver.rows.start), np.float32)
        obj.data.color_attributes["Cycles"].data.foreach_get("color", values)
        colours[receiver.rows] = values.reshape(-1, 4)[:, :3]
    return np.pi * colours


def face_centres(arrays: object) -> np.ndarray:
    """(C, 3) m: mean of the corners of each corner's face."""
    sizes = [len(face.vertices) for receiver in arrays.receivers for face in bpy.data.meshes[receiver.mesh].polygons]
    face = np.repeat(np.arange(len(sizes)), sizes)
    sums = np.stack([np.bincount(face, arrays.corner_position[:, k]) for k in range(3)], axis=1)
    return (sums / np.array(sizes)[:, None])[face]


def inside(arrays: object) -> np.ndarray:
    """(C,) bool: all corners of the vertex share one normal and its faces close around it."""
    vertex = arrays.corner_vertex
    count = vertex.max() + 1
    faces = np.bincount(vertex, minlength=count)
    spread = np.zeros(count)
    offset = np.zeros((count, 3))
    mean = np.stack([np.bincount(vertex, arrays.corner_normal[:, k], count) for k in range(3)], axis=1)
    mean /= np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-30)
    np.maximum.at(spread, vertex, np.linalg.norm(arrays.corner_normal - mean[vertex], axis=1))
    step = face_centres(arrays) - arrays.corner_position
    for k in range(3):
        offset[:, k] = np.bincount(vertex, step[:, k], count) / np.maximum(faces, 1)
    size = np.bincount(vertex, np.linalg.norm(step, axis=1), count) / np.maximum(faces, 1)
    good = (spread < 1e-3) & (np.linalg.norm(offset, axis=1) < 0.2 * size)
    return good[vertex] & (arrays.corner_albedo.min(axis=1) > 0) & (arrays.corner_emission.max(axis=1) == 0)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), sys.argv[4])
