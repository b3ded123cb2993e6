# SPDX-License-Identifier: GPL-3.0-or-later
"""Steps of `drive_blender.py` in a hall of many vertices."""

from __future__ import annotations

import time

import bpy
import hall
from blender_window import (
    LOOK,
    Steps,
    drawing,
    escape,
    operate,
    say,
    select_tab,
    session,
    set_up_view,
    shoot,
    show,
    until_done,
    until_half_way,
    window,
)
from stalls import Stalls


def many_vertices(stalls: Stalls) -> Steps:
    """A hall of pillars with some 100,000 vertices."""
    with bpy.context.temp_override(window=window()):
        bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True, load_ui=False)
    yield 1.0
    hall.build()
    yield 1.0
    set_up_view()
    yield 1.0
    select_tab()
    for obj in bpy.context.view_layer.objects:
        obj.select_set(obj.type == "MESH" and obj.name != "Lamp")
    yield 0.5
    assert operate("fmm_radiosity.subdivide", invoke=False, edge_length=0.11) == {"FINISHED"}
    vertices = sum(len(mesh.vertices) for mesh in bpy.data.meshes)
    say(f"hall: {vertices} vertices")
    assert 80_000 < vertices < 160_000
    for obj in bpy.context.view_layer.objects:
        obj.select_set(False)
    yield 1.0
    yield from drawing(stalls)
    assert operate("fmm_radiosity.bake") == {"RUNNING_MODAL"}
    yield LOOK
    stalls.check("while the hall is read")
    yield from until_half_way(0.3)
    yield from escape()
    stalls.check("while the hall is solved, and at Escape")
    assert operate("fmm_radiosity.bake") == {"RUNNING_MODAL"}
    yield from until_half_way(0.8)
    stalls.check("while the hall is read and solved")
    yield from until_done()
    stalls.check("while the hall is written")
    say(f"hall: measured error {session().report['error']['measured_rms']:.4f}")
    show()
    yield 2.0
    shoot("hall_in_blender")
    strength = bpy.data.materials["Lamp"].node_tree.nodes["Emission"].inputs["Strength"]
    strength.default_value *= 0.5
    yield 0.5
    began = time.perf_counter()
    assert operate("fmm_radiosity.relight") == {"RUNNING_MODAL"}
    yield from until_done()
    say(f"hall: relit in {time.perf_counter() - began:.2f} s")
    stalls.check("while the hall is lit anew")


def noise(stalls: Stalls) -> Steps:
    """Read walls and floor of noise, which takes seconds: Escape half way, and again to the end."""
    for name in ("Floor", "Wall"):
        tree = bpy.data.materials[name].node_tree
        shader = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeBsdfDiffuse")
        tree.links.new(tree.nodes.new("ShaderNodeTexNoise").outputs["Color"], shader.inputs["Color"])
    yield 1.0
    reading = "Reading the scene"
    assert operate("fmm_radiosity.bake") == {"RUNNING_MODAL"}
    yield 0.5
    assert session().running.text == reading
    yield from escape()
    stalls.forget()
    began = time.perf_counter()
    assert operate("fmm_radiosity.bake") == {"RUNNING_MODAL"}
    while session().running.text == reading:
        yield LOOK
    say(f"hall: noise is read in {time.perf_counter() - began:.2f} s")
    stalls.check("while noise is read")
    yield from escape()
