# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings of a bake that are saved with the scene and its materials."""

from __future__ import annotations

import bpy
import fmm_core
from fmm_core.settings import PROBES, RAYS, TRUNCATION

from . import attributes


class FMM_RADIOSITY_settings(bpy.types.PropertyGroup):
    """Saved in the scene as `scene.fmm_radiosity`; 0 stands for "let the solver choose"."""

    truncation: bpy.props.IntProperty(
        name="Truncation p",
        description="How finely light from far away is summed up: 2 is quick, 4 is right for most scenes, 8 is exact "
        "beyond what is seen. A number, the order at which the expansions are cut",
        default=TRUNCATION,
        min=0,
        soft_min=2,
        soft_max=10,
        max=20,
    )
    grouping: bpy.props.IntProperty(
        name="Grouping s",
        description="At most this many light points are put together in one box. It changes the time, hardly the "
        "picture; 0 chooses it from the scene",
        default=0,
        min=0,
        soft_max=1024,
        max=4096,
    )
    particles: bpy.props.IntProperty(
        name="Light Points",
        description="About how many points the surfaces are cut into to pass light on. More give finer bounced light; "
        "0 chooses the number from the scene",
        default=0,
        min=0,
        soft_max=1_000_000,
    )
    rays: bpy.props.IntProperty(
        name="Rays per Colour",
        description="About how many shadow rays each colour is found with. Four times as many take about three times "
        "as long and halve the grain",
        default=RAYS,
        min=10,
        soft_min=50,
        soft_max=5000,
        max=100_000,
    )
    target_error: bpy.props.FloatProperty(
        name="Target Error",
        description="Error that is good enough, as a share of the light: 0.01 is one percent. It chooses truncation, "
        "rays and light points, and may bake several times to meet it. 0 uses the other settings as they are",
        default=0.0,
        min=0.0,
        soft_max=0.1,
        max=1.0,
        step=0.1,
        precision=4,
    )
    measure: bpy.props.BoolProperty(
        name="Measure Error",
        description="Find the light at a few hundred random points once more, to tell how exact the colours are. It "
        "takes about a quarter of the time of a bake, and of a short one at least some tenths of a second",
        default=True,
    )
    keep_visibility: bpy.props.BoolProperty(
        name="Keep Visibility",
        description="Save what sees what in a file beside the .blend, so that the next bake is faster, also after "
        "Blender was closed, as long as only lights and colours have changed",
        default=False,
    )
    without: bpy.props.EnumProperty(
        name="Leave Out",
        description="Effects that are not simulated although the scene calls for them. What a scene does not call for "
        "is left out by itself",
        options={"ENUM_FLAG"},
        items=(
            ("occlusion", "Shadows", ""),
            ("interreflection", "Bounces", ""),
            ("colour", "Colour", ""),
            ("lamps", "Lamps", ""),
            ("sky", "Sky", ""),
            ("transparency", "Transparency", ""),
            ("two_sided", "Backs of Open Meshes", ""),
            ("glossy", "Gloss", ""),
            ("medium", "Absorption", ""),
        ),
        default=set(),
    )
    scope: bpy.props.EnumProperty(
        name="Bake",
        description="Which objects take part, and which of them get colours",
        items=(
            ("VISIBLE", "Visible", "What the viewport and a render both show"),
            ("SCENE", "Whole Scene", "All that a render shows, also where it is hidden in the viewport"),
            ("SELECTED", "Selected", "Only selected meshes get colours; all that is visible casts shadows and light"),
        ),
        default="VISIBLE",
    )
    attribute_name: bpy.props.StringProperty(
        name="Attribute",
        description="Name of the colour attribute that is written. That of an earlier bake is replaced",
        default=attributes.NAME,
        maxlen=60,
    )
    content: bpy.props.EnumProperty(
        name="Write",
        description="What the colours are",
        items=(
            ("FULL", "Full", "What a camera sees: base colour times light, and the glow of lamps (radiance, W/m²/sr)"),
            ("LIGHTING", "Lighting Only", "All light that arrives, without the base colour, to be multiplied with it "
             "in a material or a game engine (irradiance / pi)"),
            ("INDIRECT", "Indirect Only", "Light that arrives after at least one bounce, without the base colour, "
             "for scenes that keep their lamps (irradiance / pi)"),
        ),
        default="FULL",
    )  # fmt: skip
    colours: bpy.props.EnumProperty(
        name="Colours",
        description="How the light becomes colours",
        items=(
            ("FIT", "Fitted", "Colours that match the light on the faces best: clean edges along contacts and shadows"),
            ("POINTS", "At Vertices", "The light exactly where each vertex is, as Cycles bakes it"),
        ),
        default="FIT",
    )
    directional: bpy.props.BoolProperty(
        name="Directional",
        description="Also write where the light comes from, as four spherical harmonics in the attributes SH 0 to SH "
        "3, for engines that light normal maps with it",
        default=False,
    )
    view: bpy.props.BoolProperty(
        name="Camera View",
        description="Also write what the active camera sees, with the gloss and metal of the materials, in the "
        "attribute View",
        default=False,
    )
    domain: bpy.props.EnumProperty(
        name="Domain",
        description="Where the colours are kept",
        items=(
            ("AUTO", "Automatic", "One colour a vertex where nothing is lost by it, else one a face corner"),
            ("POINT", "Vertex", "One colour a vertex: small, but hard edges are smoothed over"),
            ("CORNER", "Face Corner", "One colour for each corner of each face: hard edges stay hard"),
        ),
        default="AUTO",
    )
    byte: bpy.props.BoolProperty(
        name="8 Bit",
        description="Keep colours in 8 bits a channel, a quarter of the size. What is brighter than white is cut off",
        default=False,
    )
    exposure: bpy.props.FloatProperty(
        name="Exposure",
        description="Make 8 bit colours brighter by so many stops (one stop doubles) before they are cut off at white",
        default=0.0,
        soft_min=-8.0,
        soft_max=8.0,
        min=-32.0,
        max=32.0,
    )


class FMM_RADIOSITY_material(bpy.types.PropertyGroup):
    """Saved in a material as `material.fmm_radiosity`."""

    brdf: bpy.props.StringProperty(
        name="BRDF File",
        description="A measured reflection in the format of the MERL database (.binary), which replaces how the shader "
        "reflects: its albedo in every bake, and its gloss where Camera View is on",
        subtype="FILE_PATH",
    )


def target_of(scene: bpy.types.Scene) -> float | None:
    """The target error of a scene, None for none. What the panel shows as 0 is."""
    return round(scene.fmm_radiosity.target_error, 4) or None


def frames_of(scene: bpy.types.Scene) -> range:
    """The frames that the timeline plays: those of the preview range where that is on, else of the scene."""
    first, last = scene.frame_start, scene.frame_end
    if scene.use_preview_range:
        first, last = scene.frame_preview_start, scene.frame_preview_end
    return range(first, last + 1, scene.frame_step)


def settings_of(scene: bpy.types.Scene, **overrides: object) -> fmm_core.Settings:
    """Settings of a scene; keyword arguments go first. Raises fmm_core.Error naming a wrong value."""
    own = scene.fmm_radiosity
    values = {
        "truncation": own.truncation,
        "grouping": own.grouping or None,
        "particles": own.particles or None,
        "rays": own.rays,
        "target_error": target_of(scene),
        "probes": PROBES if own.measure else 0,
        "effects": dict.fromkeys(own.without, False),
    }
    if overrides.get("target_error", target_of(scene)):
        values |= {"truncation": None, "rays": None}
    return fmm_core.Settings(**(values | overrides))


def output_of(scene: bpy.types.Scene, **overrides: object) -> attributes.Output:
    """What a bake of a scene writes; keyword arguments go first."""
    own = scene.fmm_radiosity
    values = {
        "name": own.attribute_name,
        "content": own.content,
        "domain": own.domain,
        "byte": own.byte,
        "exposure": own.exposure,
        "colours": own.colours,
        "directional": own.directional,
        "view": own.view,
    }
    return attributes.Output(**(values | overrides))


def register() -> None:
    """Add the settings to every scene and material."""
    bpy.types.Scene.fmm_radiosity = bpy.props.PointerProperty(type=FMM_RADIOSITY_settings)
    bpy.types.Material.fmm_radiosity = bpy.props.PointerProperty(type=FMM_RADIOSITY_material)


def unregister() -> None:
    """Take the settings away."""
    del bpy.types.Material.fmm_radiosity
    del bpy.types.Scene.fmm_radiosity
