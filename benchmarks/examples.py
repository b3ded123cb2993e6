# SPDX-License-Identifier: GPL-3.0-or-later
"""The scenes that are shipped, as Blender has them."""

import sys
from pathlib import Path

import fmm_core
from common import Array, in_child

ROOT = Path(__file__).parents[1]
#: Files of `examples/`, without their ending.
NAMES = tuple(sorted(path.stem for path in (ROOT / "examples").glob("*.blend")))


def example(name: str) -> tuple[fmm_core.Scene, tuple[Array, Array]]:
    """A shipped scene, and the output points with normals (M, 3) of its meshes."""
    return in_child(_read, name)


def _read(name: str) -> tuple[fmm_core.Scene, tuple[Array, Array]]:
    # Blender has a module of its own that is called as a benchmark here.
    sys.path[:] = [str(ROOT), *(path for path in sys.path if Path(path).resolve() != Path(__file__).parent)]
    import bpy

    from addon import properties
    from addon.export import read_scene
    from addon.solving import points_of, scene_of

    # Materials are asked for what they have there.
    for kind in (properties.FMM_RADIOSITY_settings, properties.FMM_RADIOSITY_material):
        bpy.utils.register_class(kind)
    properties.register()
    bpy.ops.wm.open_mainfile(filepath=str(ROOT / "examples" / f"{name}.blend"), load_ui=False, use_scripts=False)
    arrays = read_scene(bpy.context.evaluated_depsgraph_get()).arrays()
    output = points_of(arrays)
    return scene_of(arrays), (output.points, output.normals)
