# SPDX-License-Identifier: GPL-3.0-or-later
"""Imports point one way, and each kind of access to Blender and to rays has one module."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
CORE = sorted((ROOT / "core" / "python" / "fmm_core").rglob("*.py"))
EXTENSION = sorted([ROOT / "__init__.py", *(ROOT / "addon").glob("*.py"), *(ROOT / "operators").glob("*.py")])
BLENDER = {"bpy", "bmesh", "mathutils", "addon_utils"}

MESH_READS = {"foreach_get", "vertices", "loops", "polygons", "loop_triangles", "corner_normals", "object_instances"}
READERS = {"cycles.py", "export.py", "meshes.py", "node_fields.py", "subdivision.py", "textures.py"}
# The second one writes a mesh of its own, which is gone afterwards.
WRITERS = {"attributes.py", "node_fields.py"}
MESH_WRITES = {"foreach_set", "active_color_index", "render_color_index"}
# Asking how many vertices and corners a mesh has is how the writer checks that it still fits.
COUNTS_ONLY = {"vertices", "loops"}


def relative(path):
    return path.relative_to(ROOT).as_posix()


def imports(path):
    """Absolute modules that a file imports, and the names it takes from them."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            found |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return found


def packages(path):
    return {name.split(".")[0] for name in imports(path)}


def attributes(path):
    return {
        node.attr for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(node, ast.Attribute)
    }


def test_there_is_something_to_check():
    assert len(CORE) > 5
    assert len(EXTENSION) > 10


@pytest.mark.parametrize("path", CORE, ids=relative)
def test_core_knows_no_blender_and_traces_rays_in_one_module(path):
    assert not packages(path) & (BLENDER | {"addon", "operators", "fmm_radiosity"})
    assert path.name == "visibility.py" or "embreex" not in packages(path)


@pytest.mark.parametrize("path", EXTENSION, ids=relative)
def test_extension_uses_the_public_core_only(path):
    assert not packages(path) & {"embreex", "addon", "operators"}
    assert not any(name.startswith("fmm_core._") for name in imports(path))


@pytest.mark.parametrize("path", EXTENSION, ids=relative)
def test_few_modules_read_meshes_and_one_writes_them(path):
    used, name = attributes(path), relative(path)
    if path.name not in READERS:
        assert not used & (MESH_READS - (COUNTS_ONLY if name == "addon/attributes.py" else set()))
    if path.name not in WRITERS:
        assert not used & MESH_WRITES


@pytest.mark.parametrize("path", EXTENSION, ids=relative)
def test_one_module_changes_geometry(path):
    assert path.name == "subdivision.py" or "bmesh" not in packages(path)


def test_package_can_be_imported_without_blender():
    tree = ast.parse((ROOT / "__init__.py").read_text(encoding="utf-8"))
    assert not any(isinstance(node, ast.Import | ast.ImportFrom) for node in tree.body)


@pytest.mark.parametrize(
    "name", ["__init__.py", "command_line.py", "standalone.py", "bake.py", "export.py", "meshes.py"]
)
def test_command_line_parses_without_blender(name):
    tree = ast.parse((ROOT / "addon" / name).read_text(encoding="utf-8"))
    loaded = {alias.name for node in tree.body if isinstance(node, ast.Import) for alias in node.names}
    assert not loaded & BLENDER
