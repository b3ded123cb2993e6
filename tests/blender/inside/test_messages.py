# SPDX-License-Identifier: GPL-3.0-or-later
"""What a bake says, in German."""

import importlib

import bpy
import pytest
from conftest import MODULE


@pytest.fixture
def messages(fmm):
    return importlib.import_module(f"{MODULE}.addon.messages")


@pytest.fixture
def told(messages):
    return messages.told


@pytest.fixture
def german(messages, monkeypatch):
    """The language that the bpy module lacks; tools/drive_blender.py switches it on in the program."""
    monkeypatch.setattr(messages, "translated", lambda text: messages.GERMAN.get(text, text))


MESSAGES = {
    "object 'Hollow' has no faces: left out": "Objekt 'Hollow' hat keine Flächen: weggelassen",
    "material 'Red' on object 'A', 'B', 'C' and 2 more: shader 'Toon' is not simulated, grey 0.8 is used":
        "Material 'Red' an Objekt 'A', 'B', 'C' und 2 weitere: Shader 'Toon' wird nicht simuliert, Grau 0,8 gilt "
        "stattdessen",
    "material 'm' on object 'o': Alpha comes from 'Noise', which is not read: its plain value 1 is used":
        "Material 'm' an Objekt 'o': Alpha kommt aus 'Noise', was nicht gelesen wird: Sein einfacher Wert 1 gilt",
    "no mesh of scene 'S' can take colours (object 'a' has no faces: left out; object 'b' is hidden in the viewport: "
    "left out)":
        "kein Mesh der Szene 'S' kann Farben aufnehmen (Objekt 'a' hat keine Flächen: weggelassen; Objekt 'b' ist in "
        "der Ansicht verborgen: weggelassen)",
    "switched off (surfaces reflect up to 81% of the light)": "ausgeschaltet (Flächen reflektieren bis zu 81% des "
        "Lichts)",
    "frame 3: mesh 'Box' of object '{0}' is gone": "Bild 3: Mesh 'Box' von Objekt '{0}' ist nicht mehr da",
    "what nobody has ever said": "what nobody has ever said",
}  # fmt: skip


def test_messages_are_told_in_the_language_of_the_interface(told, german):
    assert {text: told(text) for text in MESSAGES} == MESSAGES


def test_messages_stay_what_they_are_in_english(told):
    assert [told(text) for text in MESSAGES] == list(MESSAGES)


def test_the_button_speaks_german_and_the_command_line_does_not(build, german, command, tmp_path):
    build.quad("Unlit")
    with pytest.raises(RuntimeError, match="nichts in Szene 'Scene' gibt Licht"):
        bpy.ops.fmm_radiosity.bake()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "dark.blend"))
    status, lines = command("bake", "-o", tmp_path / "out.blend")
    assert status == 1
    assert "nothing in scene 'Scene' gives off light" in lines[0]
