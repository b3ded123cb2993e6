# SPDX-License-Identifier: GPL-3.0-or-later
import bpy

settings = bpy.context.scene.fmm_radiosity
settings.truncation = 6
settings.grouping = 0
settings.particles = 0
settings.rays = 1500
settings.target_error = 0.0
