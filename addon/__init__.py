# SPDX-License-Identifier: GPL-3.0-or-later
"""The Blender side: scene export, colour attributes, panel and command line around the package `fmm_core`."""
