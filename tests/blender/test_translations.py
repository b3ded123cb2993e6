# SPDX-License-Identifier: GPL-3.0-or-later
"""Every text of the user interface has its German translation, and no translation is left without a text."""

import ast
import re

import pytest

MODULES = (
    "operators/*.py",
    *(f"addon/{name}.py" for name in ("panels", "properties", "preferences", "live", "report")),
)
#: Modules whose texts are about the scene, in the extension and in the core.
SPEAKING = [
    *("animation", "attributes", "bake", "error_map", "export", "lights", "materials", "memory", "meshes"),
    *("node_readers", "not_simulated", "ray_flags", "remarks", "sampling", "solving", "tables", "textures"),
    *("volumes", "world"),
]
SPEAKING_CORE = ["effects", "errors", "report", "solution", "target"]
#: Texts in them that are not shown, or are shown elsewhere, and short ones that are.
SILENT = {
    "Is Diffuse Ray", "Is Reflection Ray", "Radiosity (being written)", "Specular IOR Level", "{} SH {}",
    "Finding where light comes from", "Measuring the error",
    "gloss: expected {} rows like points, got {}", "normals: expected {} rows like points, got {}",
}  # fmt: skip
SHORT = {"1 face", "{} faces", "1 mesh", "{} meshes", "a volume", "hair", "points", "holdout", "shadow catcher",
         "scatters light", "glows", "burns", "left out", "on", "off"}  # fmt: skip
#: Keywords and class attributes whose texts Blender shows.
TRANSLATED = {"translated", "translate", "poll_message_set"}
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
        elif isinstance(node, ast.Call) and ast.unparse(node.func).split(".")[-1] in TRANSLATED:
            yield literal(node.args[0])
        elif isinstance(node, ast.Call) and ast.unparse(node.func) == "_draw_pair":
            yield literal(node.args[1])


def phases_of(tree):
    """What a module of the core tells of its progress."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "ticker":
            yield literal(node.args[3])


def template(node):
    """A text with {} for what is put into it."""
    if isinstance(node, ast.JoinedStr):
        return "".join("{}" if isinstance(part, ast.FormattedValue) else part.value for part in node.values)
    return literal(node) or ""


def spoken(tree):
    """Texts of three words or more that a module says."""
    documented = (ast.FunctionDef, ast.ClassDef, ast.Module)
    nodes = list(ast.walk(tree))
    beside = {id(node.body[0].value) for node in nodes
              if isinstance(node, documented) and isinstance(node.body[0], ast.Expr)}  # fmt: skip
    beside |= {id(part) for node in nodes if isinstance(node, ast.JoinedStr) for part in node.values}
    return {template(node) for node in nodes if id(node) not in beside and len(template(node).split()) >= 3}


def appended(tree):
    """Texts that a module adds to a list."""
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call)]
    return {template(node.args[0]) for node in calls if ast.unparse(node.func).endswith("warnings.append")}


@pytest.fixture(scope="module")
def messages(root):
    """All that a bake says of a scene."""

    def tree(*parts):
        return ast.parse(root.joinpath(*parts).read_text(encoding="utf-8"))

    core = "core", "python", "fmm_core"
    found = set().union(*(spoken(tree("addon", f"{name}.py")) for name in SPEAKING))
    found |= set().union(*(spoken(tree(*core, f"{name}.py")) for name in SPEAKING_CORE))
    assert found >= SILENT
    return found - SILENT | SHORT | appended(tree(*core, "scene.py"))


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


def dictionary(root, name):
    tree = ast.parse((root / "addon" / f"{name}.py").read_text(encoding="utf-8"))
    node = next(node for node in tree.body if isinstance(node, ast.Assign) and node.targets[0].id == "GERMAN")
    return ast.literal_eval(node.value)


@pytest.fixture(scope="module")
def german(root):
    return dictionary(root, "translations")


@pytest.fixture(scope="module")
def german_messages(root):
    return dictionary(root, "messages_german")


def test_everything_is_translated_and_nothing_else(texts, german):
    assert len(texts) > 60
    assert texts - german.keys() == set()
    assert german.keys() - texts == set()


def test_every_message_is_translated_and_nothing_else(messages, german_messages):
    assert len(messages) > 100
    assert messages - german_messages.keys() == set()
    assert german_messages.keys() - messages == set()


def test_translations_keep_the_places_of_values(german, german_messages):
    for text, translation in [*german.items(), *german_messages.items()]:
        assert translation
        assert re.findall(r"{[^}]*}", translation) == re.findall(r"{[^}]*}", text), text


def test_translations_are_others_than_the_texts(german):
    same = {text for text, translation in german.items() if text == translation}
    assert same <= {"Live", "8 Bit", "Absorption"}
