# SPDX-License-Identifier: Apache-2.0
"""Damaged mesh files cannot hurt: what crashes, hangs or takes all memory in their reader is a FileError."""

import json
import os
import time
from pathlib import Path

import h5py
import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

import cama
from cama.cli import app
from cama.io import reading
from cama.io.exporting import export
from cama.io.recording import NAME, Recorder, Recording
from cama.viewing.player import Player
from conftest import grid
from test_characters import write_gltf

PLY = """ply
format ascii 1.0
element vertex {vertices}
property float x
property float y
property float z
element face {faces}
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
0 1 0
3 0 1 2
"""


CRASH = "os.abort()"


@pytest.fixture(autouse=True)
def nothing_known(monkeypatch):
    monkeypatch.setattr(reading, "_known", {})


def without_bind_matrices(path):
    """A skin that glTF allows, and assimp 5.2.5 crashes on."""
    data = json.loads(write_gltf(path).read_text())
    del data["skins"][0]["inverseBindMatrices"]
    path.write_text(json.dumps(data))
    return path


def pretend(monkeypatch, tmp_path, statement):
    """Puts a statement in the place of the compiled module's readers, in the process only."""
    program = reading.Path(reading.__file__).with_name("reader_process.py").read_text()
    stub = f"class Stub:\n    class Error(Exception): pass\n    def load_mesh(self, *_): {statement}\n"
    stub += "    load_character = load_mesh\n\n\n"
    program = program.replace("core = compiled(sys.argv[1])", "core = Stub()").replace("def main", stub + "def main")
    folder = tmp_path / "program"
    folder.mkdir()
    (folder / "reader_process.py").write_text(program)
    monkeypatch.setattr(reading, "__file__", str(folder / "reading.py"))


def refused(make, *words):
    with pytest.raises(cama.FileError) as caught:
        make()
    for word in words:
        assert word in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_mesh_that_is_whole_is_read(tmp_path):
    path = tmp_path / "one.ply"
    path.write_text(PLY.format(vertices=3, faces=1))
    np.testing.assert_array_equal(cama.Scene().add_obstacle(path).vertices, [[0, 0, 0], [1, 0, 0], [0, 1, 0]])


@pytest.mark.parametrize("file", [5, [], None, {"path": 5}, {"path": ""}])
def test_a_file_that_is_no_name(file):
    with pytest.raises(cama.Error):
        cama.Scene.parse({"cloth": [{"file": file}]})
    with pytest.raises(cama.Error):
        cama.Scene.parse({"obstacles": [{"character": {"file": file}}]})


@pytest.mark.parametrize("vertices, faces", [(4_000_000_000, 1), (3, 800_000_000)])
def test_counts_beyond_all_memory(tmp_path, vertices, faces):
    path = tmp_path / "huge.ply"
    path.write_text(PLY.format(vertices=vertices, faces=faces))
    refused(lambda: cama.Scene().add_cloth(path), "huge.ply: needs more than 2 GiB", "CAMA_READ_MEMORY=4")


def test_a_crash_names_file_reason_and_remedy(tmp_path, monkeypatch):
    pretend(monkeypatch, tmp_path, CRASH)
    path = without_bind_matrices(tmp_path / "body.gltf")
    words = ("body.gltf: ", "assimp", "SIGABRT", "no inverseBindMatrices", "export")
    refused(lambda: cama.Scene().add_obstacle(path), *words)


def test_a_skin_without_bind_matrices_ends_no_process(tmp_path):
    """Some versions of assimp crash on it: then it is refused; others read it."""
    path = without_bind_matrices(tmp_path / "body.gltf")
    try:
        assert len(cama.Scene().add_obstacle(path).faces) == 4
    except cama.FileError as problem:
        assert "no inverseBindMatrices" in str(problem)


def test_a_crash_within_a_scene_names_its_part(tmp_path, monkeypatch):
    pretend(monkeypatch, tmp_path, CRASH)
    without_bind_matrices(tmp_path / "body.gltf")
    scene = {"cloth": [{"grid": {"size": [1, 1]}}], "obstacles": [{"name": "Ann", "character": {"file": "body.gltf"}}]}
    text = "\ufeff// with a byte order mark and a comment\n" + json.dumps(scene)
    (tmp_path / "scene.json").write_text(text)
    refused(lambda: cama.Scene.load(tmp_path), "scene.json: obstacles 'Ann': ", "body.gltf: its reader")
    refused(lambda: cama.Scene.parse(text, tmp_path), "body.gltf: its reader")
    body = {"character": {"file": str(tmp_path / "body.gltf")}}
    refused(lambda: cama.Scene().add_obstacle(shape=body), "body.gltf: its reader")


def test_the_command_ends_with_one_line(tmp_path, monkeypatch):
    pretend(monkeypatch, tmp_path, CRASH)
    without_bind_matrices(tmp_path / "body.gltf")
    (tmp_path / "scene.json").write_text(json.dumps({"obstacles": [{"character": {"file": "body.gltf"}}]}))
    done = CliRunner().invoke(app, ["check", str(tmp_path)])
    assert done.exit_code == 2 and done.stdout == ""
    assert done.stderr.startswith("will not run: FileError: ") and len(done.stderr.splitlines()) == 1


def test_a_hang_ends(tmp_path, monkeypatch):
    pretend(monkeypatch, tmp_path, "exec('while True: pass')")
    monkeypatch.setenv(reading.SECONDS, "0.5")
    path = tmp_path / "one.ply"
    path.write_text(PLY.format(vertices=3, faces=1))
    begin = time.monotonic()
    refused(lambda: cama.Scene().add_cloth(path), "one.ply: takes longer than 0.5 s", "CAMA_READ_SECONDS=5")
    assert time.monotonic() - begin < 60


def test_an_assert_is_quoted(tmp_path, monkeypatch):
    text = 'sys.stderr.write("x: Assertion `size > 0\' failed.\\n"); sys.stderr.flush(); os.abort()'
    pretend(monkeypatch, tmp_path, text)
    path = tmp_path / "one.stl"
    path.write_bytes(b"solid")
    refused(lambda: cama.Scene().add_cloth(path), "one.stl: ", "SIGABRT, size > 0", "damaged", "OBJ")


def test_answers_are_kept_until_the_file_changes(tmp_path, monkeypatch):
    asked = []
    real = reading._talk
    monkeypatch.setattr(reading, "_talk", lambda *how: asked.append(how) or real(*how))
    path = tmp_path / "one.ply"
    path.write_text(PLY.format(vertices=3, faces=1))
    for _ in range(3):
        cama.Scene().add_obstacle(path)
    assert len(asked) == 1
    os.utime(path, ns=(1, 1))
    cama.Scene().add_obstacle(path)
    assert len(asked) == 2


def test_obj_files_and_arrays_need_no_process(tmp_path, monkeypatch):
    monkeypatch.setattr(reading, "_talk", lambda *_: pytest.fail("a process was started"))
    path = tmp_path / "one.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    cama.Scene().add_cloth(path)
    cama.Scene().add_cloth(*grid(2))
    cama.Scene.parse({"cloth": [{"file": str(path)}]})


def test_a_limit_that_is_no_number_is_named(tmp_path, monkeypatch):
    path = tmp_path / "one.ply"
    path.write_text(PLY.format(vertices=3, faces=1))
    monkeypatch.setenv(reading.MEMORY, "lots")
    with pytest.raises(cama.SceneError, match="CAMA_READ_MEMORY=lots"):
        cama.Scene().add_cloth(path)


def test_bytes_that_are_no_text(tmp_path):
    path = tmp_path / "one.obj"
    path.write_bytes(b"v 0 0 0\nf 1 2 \xff\xfe\n")
    refused(lambda: cama.Scene().add_cloth(path), "one.obj:2: expected a vertex index")


@pytest.mark.parametrize(
    "scene, word",
    [
        ("[" * 100_000, "nested"),
        ('{"cloth": ' * 100_000, "nested"),
        ({"cloth": [{"grid": {"size": [1, 1], "cells": [100_000, 100_000]}}]}, "20,000,000 triangles"),
        ({"cloth": [{"grid": {"size": [1e300, 1e-300]}}]}, "20,000,000 triangles"),
        ({"cloth": [{"grid": {"size": [1, 1]}}], "resolution": 2_000_000_000}, "20,000,000 triangles"),
        ({"obstacles": [{"sphere": {"triangles": 2_000_000_000}}]}, "20,000,000 triangles"),
        ({"obstacles": [{"walker": {"duration": 1e300}}]}, "samples_per_second"),
    ],
)
def test_a_scene_cannot_ask_for_too_much(scene, word):
    text = scene if isinstance(scene, str) else json.dumps(scene)
    with pytest.raises(cama.Error, match=word):
        cama.Scene.parse(text)


@pytest.fixture
def recorded(tmp_path, falling):
    simulation = cama.Simulation(falling, backend="cpu", threads=1, accuracy="preview")
    with Recorder(tmp_path / NAME, simulation) as recorder:
        for _ in range(2):
            recorder.add(simulation.time, simulation.positions, 0, 0)
            simulation.step()
    return tmp_path / NAME


@pytest.mark.parametrize(
    "name, row, value, words",
    [
        ("positions", (1, 3, 2), np.nan, "frame 1 is damaged"),
        ("times", 1, np.inf, "times"),
        ("faces", (0, 0), 10**6, "faces name vertices"),
        ("cloth_ranges", (0, 1), -5, "vertices that are not there"),
    ],
)
def test_a_recording_with_impossible_numbers(recorded, name, row, value, words):
    with Recording(recorded) as whole:
        assert len(whole) == 2 and np.isfinite(whole.frame(1)).all()
    with h5py.File(recorded, "r+") as file:
        file[name][row] = value

    def read():
        with Recording(recorded) as recording:
            recording.frame(1)

    refused(read, words)


def test_a_garment_may_reach_below_the_feet():
    """There the body has no outline; that was a crash."""
    body = {"name": "body", "walker": {"cell": 0.06, "duration": 0.1}}
    skirt = {"garment": {"skirt": {"body": "body", "waist": 0.96, "length": 1.0, "panels": 4}}, "triangles": 100}
    cloth = cama.Scene.parse({"obstacles": [body], "cloth": [skirt]}).cloths[0]
    assert cloth.vertices[:, 2].min() == pytest.approx(-0.04) and np.isfinite(cloth.vertices).all()


def test_a_checkpoint_that_crashes_hdf5_is_refused(tmp_path, falling, monkeypatch):
    """One with its digest needs no process; any change makes one look first."""
    simulation = cama.Simulation(falling, backend="cpu", threads=1, accuracy="preview")
    path = tmp_path / "checkpoint.h5"
    simulation.save_checkpoint(path)
    asked = []
    monkeypatch.setattr(reading.subprocess, "run", lambda words, **_: asked.append(words) or Ended())
    simulation.load_checkpoint(path)
    assert not asked
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    refused(lambda: simulation.load_checkpoint(path), "checkpoint.h5: is damaged: HDF5 crashes")
    assert len(asked) == 1


class Ended:
    """A process that ended by a signal."""

    returncode = -11


def test_a_recording_that_crashes_hdf5_is_refused(recorded, monkeypatch):
    """In Python as by the commands: whatever reads a recording has it read in another process first, once."""
    monkeypatch.setattr(reading.subprocess, "run", lambda *_, **__: Ended())
    for _ in range(2):
        refused(lambda: Recording(recorded), "is damaged: HDF5 crashes")
    refused(lambda: export(recorded, "obj"), "is damaged: HDF5 crashes")
    refused(lambda: Player(recorded), "is damaged: HDF5 crashes")
    Recording(recorded, checked=True).close()


def test_a_mesh_that_nobody_read_first_is_not_read_here(tmp_path, monkeypatch):
    """On a busy machine the process may give no answer in time; a second attempt asks it again."""
    path = tmp_path / "sheet.ply"
    trimesh.Trimesh(*grid(2)).export(path)
    monkeypatch.setattr(reading, "_talk", lambda *_: ([], "", None))
    for _ in range(2):
        refused(lambda: cama.Scene().add_cloth(path), "gave no answer within", "try again")
    monkeypatch.undo()
    assert len(cama.Scene().add_cloth(path).faces) == 8


def test_a_busy_machine_does_not_make_a_recording_a_damaged_one(recorded, monkeypatch):
    def late(words, **_):
        raise reading.subprocess.TimeoutExpired(words, 1)

    monkeypatch.setattr(reading.subprocess, "run", late)
    Recording(recorded).close()


def test_a_file_that_keeps_hdf5_busy_is_refused(recorded, monkeypatch):
    """The system ends its process by the limit of processor time."""
    busy = recorded.with_name("busy.py")
    program = Path(reading.__file__).with_name("hdf5_process.py").read_text("utf-8")
    busy.write_text(program.replace("read(file)", "while True: pass"))
    run = reading.subprocess.run
    monkeypatch.setattr(
        reading.subprocess, "run", lambda words, **how: run([*words[:2], str(busy), words[3], "1", *words[5:]], **how)
    )
    refused(lambda: Recording(recorded), "is damaged: HDF5 crashes or hangs")


def test_the_process_for_hdf5_reads_what_is_whole(recorded):
    reading.check_hdf5(recorded)
    assert list(reading._known.values()) == [""]
    reading.check_hdf5(recorded.with_name("missing.h5"))
