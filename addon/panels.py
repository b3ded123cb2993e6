# SPDX-License-Identifier: GPL-3.0-or-later
"""The tab "Radiosity" in the sidebar of the 3D view, and the settings in the scene's properties."""

from __future__ import annotations

from typing import ClassVar

import bpy
from bl_ui.utils import PresetPanel
from bpy.app.translations import pgettext_iface as translated

from . import error_map, estimate, properties, shading, wrapped
from .messages import told
from .report import PHASES, percent, typical
from .session import Running, session

#: Warnings that are shown; the Info editor and the report have them all.
_SHOWN_WARNINGS = 5


class FMM_RADIOSITY_PT_presets(PresetPanel, bpy.types.Panel):
    """Saved settings of the panel Quality."""

    bl_label = "Radiosity Presets"
    preset_subdir = "fmm_radiosity"
    preset_operator = "script.execute_preset"
    preset_add_operator = "fmm_radiosity.preset_add"


class _InSidebar:
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Radiosity"


class _InScene:
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "scene"


class _Bake:
    bl_label = "FMM Radiosity"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the button, or how far the bake is, and what it came to or will cost."""
        layout, running = self.layout, session.running
        row = layout.row()
        row.scale_y = 1.4
        if running is None:
            row.operator("fmm_radiosity.bake", icon="RENDER_STILL")
            _draw_after(layout, context)
            _draw_summary(layout, context)
        else:
            row.progress(factor=running.fraction, text=label(running))
            layout.label(text="Esc cancels")


class _Quality:
    bl_label = "Quality"

    def draw_header_preset(self, _context: bpy.types.Context) -> None:
        """Draw the menu of presets."""
        FMM_RADIOSITY_PT_presets.draw_panel_header(self.layout)

    def draw(self, context: bpy.types.Context) -> None:
        """Draw what decides over error and time."""
        chosen = "truncation", "grouping", "rays", "particles", "measure"
        if properties.target_of(context.scene):
            # It chooses the others.
            chosen = "grouping", "particles"
        _draw_settings(self.layout, context, "target_error", *chosen)


class _Output:
    bl_label = "Output"
    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw what is baked, and what is written."""
        _draw_settings(self.layout, context, "scope", "content", "colours", "attribute_name", "domain", "byte")
        if context.scene.fmm_radiosity.byte:
            _draw_settings(self.layout, context, "exposure")
        _draw_settings(self.layout, context, "directional", "view", "keep_visibility")
        frames = properties.frames_of(context.scene)
        _draw_pair(self.layout.column(), "Frames", f"{frames.start} – {frames.stop - 1}")
        self.layout.operator("fmm_radiosity.bake_frames", icon="RENDER_ANIMATION")


class FMM_RADIOSITY_PT_bake(_InSidebar, _Bake, bpy.types.Panel):
    """The bake button, and what the last bake came to."""


class FMM_RADIOSITY_PT_quality(_InSidebar, _Quality, bpy.types.Panel):
    """Error and time."""

    bl_parent_id = "FMM_RADIOSITY_PT_bake"


class FMM_RADIOSITY_PT_output(_InSidebar, _Output, bpy.types.Panel):
    """What is baked and written."""

    bl_parent_id = "FMM_RADIOSITY_PT_bake"


class FMM_RADIOSITY_PT_result(_InSidebar, bpy.types.Panel):
    """What the last bake of this session did."""

    bl_label = "Last Bake"
    bl_parent_id = "FMM_RADIOSITY_PT_bake"

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        """There was one."""
        return session.report is not None

    def draw(self, context: bpy.types.Context) -> None:
        """Draw its error, rays, seconds and warnings."""
        report = session.report
        column = self.layout.column(align=True)
        error = report["error"]
        if error["measured_rms"] is not None:
            _draw_pair(column, "Measured Error", _typical(error))
            if error["low"]:
                _draw_pair(column, "Between", f"{percent(error['low'])}, {percent(error['high'])}")
            _draw_pair(column, "Largest Error", percent(error["measured_max"]))
        self._draw_map(context)
        column = self.layout.column(align=True)
        if report["rounds"]:
            _draw_pair(column, "Rounds", str(len(report["rounds"])))
        _draw_pair(column, "Rays", f"{report['counts']['rays']:,}")
        for phase, name in PHASES.items():
            if report["seconds"][phase] >= 0.005:
                _draw_pair(column, name, f"{report['seconds'][phase]:.2f} s")
        for warning in report["warnings"][:_SHOWN_WARNINGS]:
            wrapped.draw(self.layout, context, told(warning), "ERROR")
        self.layout.operator("fmm_radiosity.show_report", icon="TEXT")
        self.layout.operator("fmm_radiosity.study", icon="GRAPH")

    def _draw_map(self, context: bpy.types.Context) -> None:
        shown = error_map.shown(context.scene, context.view_layer)
        text = "Hide Error Map" if shown else "Error Map"
        self.layout.operator("fmm_radiosity.error_map", text=text, icon="COLOR", depress=shown)
        if shown and session.map_top is not None:
            _draw_pair(self.layout.column(), "Yellow", translated("{:s} or more").format(percent(session.map_top)))


class FMM_RADIOSITY_PT_effects(_InSidebar, bpy.types.Panel):
    """Which effects the scene calls for, and which ones the next bake shall leave out."""

    bl_label = "Effects"
    bl_parent_id = "FMM_RADIOSITY_PT_bake"
    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the effects with their reasons, and what is to be left out."""
        self.layout.operator("fmm_radiosity.check", icon="VIEWZOOM")
        if session.effects is not None:
            column = self.layout.column(align=True)
            for item in context.scene.fmm_radiosity.bl_rna.properties["without"].enum_items:
                effect = session.effects[item.identifier]
                column.label(text=item.name, icon="CHECKMARK" if effect["used"] else "X")
                wrapped.draw(column, context, told(effect["why"]), "BLANK1")
        self.layout.label(text="Leave Out")
        column = self.layout.column(align=True)
        column.enabled = session.running is None
        column.prop(context.scene.fmm_radiosity, "without")


class FMM_RADIOSITY_PT_meshes(_InSidebar, bpy.types.Panel):
    """Work on meshes before a bake, and on materials after it."""

    bl_label = "Meshes and Materials"
    bl_parent_id = "FMM_RADIOSITY_PT_bake"
    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}

    def draw(self, _context: bpy.types.Context) -> None:
        """Draw the buttons."""
        column = self.layout.column(align=True)
        column.operator("fmm_radiosity.subdivide", icon="MOD_SUBSURF")
        column.operator("fmm_radiosity.refine", icon="MOD_MULTIRES")
        self.layout.operator("fmm_radiosity.add_nodes", icon="NODE_MATERIAL")


class FMM_RADIOSITY_PT_scene(_InScene, _Bake, bpy.types.Panel):
    """The bake button in the scene's properties."""

    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}


class FMM_RADIOSITY_PT_scene_quality(_InScene, _Quality, bpy.types.Panel):
    """Error and time, in the scene's properties."""

    bl_parent_id = "FMM_RADIOSITY_PT_scene"


class FMM_RADIOSITY_PT_scene_output(_InScene, _Output, bpy.types.Panel):
    """What is baked and written, in the scene's properties."""

    bl_parent_id = "FMM_RADIOSITY_PT_scene"


def label(running: Running) -> str:
    """Phase and remaining seconds of a bake under way."""
    left = running.seconds_left()
    text = translated(running.text)
    return text if left is None else translated("{:s}, {:s} left").format(text, estimate.spoken(left))


def draw_status(header: bpy.types.Header, _context: bpy.types.Context) -> None:
    """Draw the status bar while a bake is under way."""
    if session.running is not None:
        header.layout.label(text="Cancel", icon="EVENT_ESC")
        row = header.layout.row()
        row.ui_units_x = 20
        row.progress(factor=session.running.fraction, text=label(session.running))


def _draw_settings(layout: bpy.types.UILayout, context: bpy.types.Context, *names: str) -> None:
    layout.use_property_split = True
    layout.use_property_decorate = False
    column = layout.column()
    column.enabled = session.running is None
    for name in names:
        column.prop(context.scene.fmm_radiosity, name)


def _draw_pair(column: bpy.types.UILayout, name: str, value: str) -> None:
    split = column.split(factor=0.6)
    split.label(text=name)
    split.label(text=value, translate=False)


def _draw_after(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """What one does after a bake: look at it, and change the lights."""
    views = shading.views(context)
    shown = bool(views) and all(map(shading.shows, views))
    text = "Hide Result" if shown else "Show Result"
    layout.operator("fmm_radiosity.show", text=text, icon="HIDE_OFF", depress=shown)
    row = layout.row(align=True)
    row.operator("fmm_radiosity.relight", icon="LIGHT")
    row.prop(context.window_manager, "fmm_radiosity_live", toggle=True)
    if session.problem is not None:
        wrapped.draw(layout, context, session.problem, "INFO")


def _draw_summary(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    cost = estimate.of_scene(context.scene, context.view_layer)
    column = layout.column(align=True)
    _draw_pair(column, "Vertices", f"{cost.colours:,}")
    _draw_pair(column, "Expected Time", estimate.spoken(cost.seconds))
    _draw_pair(column, "Expected Memory", f"{cost.memory_mib:,} MiB")
    if session.report is not None:
        error, seconds = session.report["error"], session.report["seconds"]["total"]
        done = translated("Baked in {:.1f} s").format(seconds)
        if error["measured_rms"] is not None:
            done = translated("{:s}, error {:s}").format(done, _typical(error))
        column.label(text=done, icon="CHECKMARK", translate=False)


def _typical(error: dict) -> str:
    return typical(error, translated)


class FMM_RADIOSITY_PT_material(bpy.types.Panel):
    """What the bake takes of a material beside its nodes."""

    bl_label = "FMM Radiosity"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "material"
    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """There is a material."""
        return context.material is not None

    def draw(self, context: bpy.types.Context) -> None:
        """Draw its file."""
        self.layout.use_property_split = True
        self.layout.prop(context.material.fmm_radiosity, "brdf")


CLASSES = (
    FMM_RADIOSITY_PT_presets,
    FMM_RADIOSITY_PT_bake,
    FMM_RADIOSITY_PT_quality,
    FMM_RADIOSITY_PT_output,
    FMM_RADIOSITY_PT_result,
    FMM_RADIOSITY_PT_effects,
    FMM_RADIOSITY_PT_meshes,
    FMM_RADIOSITY_PT_scene,
    FMM_RADIOSITY_PT_scene_quality,
    FMM_RADIOSITY_PT_scene_output,
    FMM_RADIOSITY_PT_material,
)
