# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender operators, one in a file."""
