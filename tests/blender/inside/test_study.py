# SPDX-License-Identifier: GPL-3.0-or-later
"""The study as an operator and as a command."""

import csv
import importlib

import bpy
import pytest
from fmm_core import study as studies


@pytest.fixture
def chart(fmm):
    return importlib.import_module(fmm.command_line.__name__.replace("command_line", "chart"))


@pytest.fixture
def room(build, monkeypatch):
    """A small scene and few bakes."""
    tried = {"ALL_RAYS": (20, 100), "ALL_TRUNCATIONS": (1, 4), "ALL_GROUPINGS": (64,), "PAPER_RAYS": (50,),
             "TRUTH_RAYS": 256, "TRUTH_PARTICLE_RAYS": 100_000}  # fmt: skip
    for name, values in tried.items():
        monkeypatch.setattr(studies, name, values)
    build.room()
    bpy.context.scene.fmm_radiosity.particles = 600
    bpy.context.scene.fmm_radiosity.target_error = 0.05


def test_operator_shows_picture_and_table_and_changes_nothing_else(room):
    for _ in range(2):
        assert bpy.ops.fmm_radiosity.study() == {"FINISHED"}
    images = [image for image in bpy.data.images if image.source == "FILE"]
    assert [image.name for image in images] == ["Radiosity Study"]
    assert tuple(images[0].size) == (1600, 1000)
    assert images[0].packed_file is not None
    lines = bpy.data.texts["Radiosity Study"].as_string().splitlines()
    assert len(lines) == 9
    assert lines[-1].startswith("recommended: ")
    assert not any(mesh.color_attributes for mesh in bpy.data.meshes)


def test_command_writes_table_and_picture(room, command, fmm, tmp_path, capfd):
    blend = tmp_path / "room.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    saved, out = blend.read_bytes(), tmp_path / "new" / "folder"
    assert fmm.command_line.main(["study", str(blend), "--out", str(out), "--cycles", "1", "64"]) == 0
    told = capfd.readouterr().out
    rows = list(csv.DictReader((out / "study.csv").read_text().splitlines()))
    assert [row["series"] for row in rows] == [*2 * ["rays"], *2 * ["p"], "s", "paper", "brute force", *2 * ["Cycles"]]
    assert sum(int(row["recommended"]) for row in rows) == 1
    assert float(rows[8]["error"]) < 0.3 * float(rows[7]["error"])
    assert "recommended: " in told
    assert (out / "study.png").read_bytes().startswith(b"\x89PNG")
    assert sorted(path.name for path in out.iterdir()) == ["study.csv", "study.png"]
    assert blend.read_bytes() == saved


def test_a_crowd_of_points_has_a_label_each(chart):
    paper = chart._Paper()
    places = [(500 + 9 * number, 500 + 5 * (number % 2)) for number in range(12)]
    for place in places:
        paper.keep_free(place, 4)
    for number, place in enumerate(places):
        paper.label(place, f"p {number}", "#000000")
    taken = paper._taken
    assert len(taken) == 2 * len(places)
    for label in taken[len(places) :]:
        others = [other for other in taken if other is not label]
        assert not any(a < label[2] and label[0] < c and b < label[3] and label[1] < d for a, b, c, d in others)


def test_command_leaves_nothing_where_it_cannot_write(room, command, tmp_path):
    blend = tmp_path / "room.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    (tmp_path / "file").write_text("no folder")
    status, lines = command("study", blend, "--out", tmp_path / "file")
    assert status == 1
    assert lines == [f"fmm-radiosity: error: cannot write '{tmp_path / 'file' / 'study.csv'}': Not a directory"]
