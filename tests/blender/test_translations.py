# SPDX-License-Identifier: GPL-3.0-or-later
"""Every text of the user interface has its German translation, and no translation is left without a text."""

import ast
import re

import pytest

MODULES = "operators/*.py", "addon/panels.py", "addon/properties.py", "addon/preferences.py", "addon/live.py"
#: Keywords and class attributes whose texts Blender shows.
SHOWN = {"name", "description", "text", "bl_label"}


def literal(node):
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else None


def shown(tree):
    """Texts that a module shows."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef) and any(ast.unparse(base) == "bpy.types.Operator" for base in node.bases):
            yield re.sub(r"\s+", " ", ast.get_docstring(node))
        elif isinstance(node, ast.keyword) and node.arg in SHOWN:
            yield literal(node.value)
        elif isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) in {"bl_label", "why", "text"}:
            yield literal(node.value)
            if isinstance(node.value, ast.IfExp):
                yield from (literal(node.value.body), literal(node.value.orelse))
        elif isinstance(node, ast.keyword) and node.arg == "items":
            for item in node.value.elts:
                yield from (literal(part) for part in item.elts[1:])
        elif isinstance(node, ast.Call) and ast.unparse(node.func).split(".")[-1] in {"translated", "poll_message_set"}:
            yield literal(node.args[0])
        elif isinstance(node, ast.Call) and ast.unparse(node.func) == "_draw_pair":
            yield literal(node.args[1])


def phases_of(tree):
    """What a module of the core tells of its progress."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "ticker":
            yield literal(node.args[3])


@pytest.fixture(scope="module")
def texts(root):
    found = {"Reading the scene"}
    for path in root.glob("core/python/fmm_core/*.py"):
        found |= set(phases_of(ast.parse(path.read_text(encoding="utf-8"))))
    for pattern in MODULES:
        for path in root.glob(pattern):
            found |= set(shown(ast.parse(path.read_text(encoding="utf-8"))))
    report = ast.parse((root / "addon" / "report.py").read_text(encoding="utf-8"))
    phases = next(node for node in report.body if isinstance(node, ast.Assign) and node.targets[0].id == "PHASES")
    found |= {literal(value) for value in phases.value.values}
    # Names of the attribute and of the extension stay what they are.
    return found - {None, "", "Radiosity", "FMM Radiosity"}


@pytest.fixture(scope="module")
def german(root):
    tree = ast.parse((root / "addon" / "translations.py").read_text(encoding="utf-8"))
    node = next(node for node in tree.body if isinstance(node, ast.Assign) and node.targets[0].id == "GERMAN")
    return ast.literal_eval(node.value)


def test_everything_is_translated_and_nothing_else(texts, german):
    assert len(texts) > 60
    assert texts - german.keys() == set()
    assert german.keys() - texts == set()


def test_translations_keep_the_places_of_values(german):
    for text, translation in german.items():
        assert translation
        assert re.findall(r"{[^}]*}", translation) == re.findall(r"{[^}]*}", text), text


def test_translations_are_others_than_the_texts(german):
    same = {text for text, translation in german.items() if text == translation}
    assert same <= {"Live", "8 Bit", "Absorption"}
