# SPDX-License-Identifier: Apache-2.0
"""Checkpoints: files that a run goes on from bit by bit, and files that are refused."""

import json
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

import cama
from cama.io.recording import Recording
from conftest import grid


def falling(**options):
    """Two sheets that fall on a ball: contact from the first steps on."""
    scene = cama.Scene(thickness=4e-3, time_step=0.004, frame_time=0.012)
    for k in range(2):
        vertices, faces = grid(8)
        scene.add_cloth(
            vertices * 0.3 + [-0.15, -0.15 - 0.003 * k, 0.005 + 0.005 * k],
            faces,
            velocity=(0.1, 0, -1),
            name=f"sheet {k}",
        )
    scene.add_obstacle(shape={"sphere": {"radius": 0.1}}, name="ball", translate=(0, 0, -0.101))
    return cama.Simulation(scene, threads=1, **options)


@pytest.fixture
def kept(tmp_path):
    """A checkpoint after 8 steps, and the hash 14 steps later."""
    simulation = falling()
    simulation.step(8)
    assert simulation.report["contacts"] > 0
    path = tmp_path / "checkpoint.h5"
    simulation.save_checkpoint(path)
    simulation.step(14)
    return path, simulation.state_hash


def test_a_run_goes_on_bit_by_bit(kept):
    path, end = kept
    simulation = falling()
    assert simulation.load_checkpoint(path) == []
    assert (simulation.step_count, simulation.time) == (8, 8 * 0.004)
    simulation.step(14)
    assert simulation.state_hash == end
    # Positions and velocities alone are not all of it: the check above can fail.
    with h5py.File(path, "r") as file:
        count = simulation.cloth_vertex_count
        bare = falling()
        bare.set_state(file["vectors/position"][:count], file["vectors/velocity"][:count])
    bare.step(2)
    soon = falling()
    soon.load_checkpoint(path)
    soon.step(2)
    np.testing.assert_allclose(bare.positions, soon.positions, atol=2e-3)
    bare.step(12)
    assert bare.state_hash != end


def test_other_options_are_named_and_the_folder_will_do(kept):
    path, _ = kept
    simulation = falling(tolerance=1e-3, time_step=0.001)
    different = simulation.load_checkpoint(path.parent)
    assert different == ["time_step 0.001 instead of 0.004", "tolerance 0.001 instead of 0.01"]
    simulation.step()
    assert simulation.time == pytest.approx(0.033, abs=1e-15)


def test_a_file_is_written_whole_or_not_at_all(kept):
    path, _ = kept
    before = path.read_bytes()
    simulation = falling()
    (path.parent / "no").write_text("")
    with pytest.raises(cama.FileError, match="no/checkpoint.h5: writing failed"):
        simulation.save_checkpoint(path.parent / "no" / "checkpoint.h5")
    assert path.read_bytes() == before
    assert sorted(p.name for p in path.parent.iterdir()) == ["checkpoint.h5", "no"]


def damage(path, name, value=None, attribute=False):
    with h5py.File(path, "r+") as file:
        group, _, last = name.rpartition("/")
        place = file[group] if group else file
        where, name = place.attrs if attribute else place, last
        del where[name]
        if value is not None:
            where[name] = value


@pytest.mark.parametrize(
    "name, value, attribute, error, text",
    [
        ("format", "cama checkpoint 99", True, cama.FileError, "format is 'cama checkpoint 99'"),
        ("step", None, True, cama.FileError, "step"),
        ("step", 2**40, True, cama.FileError, "32 bits"),
        ("scene", "zz", True, cama.FileError, "not a checkpoint"),
        ("scene", "00", True, cama.SceneError, "another scene"),
        ("numbers/time", np.nan, True, cama.SceneError, "time"),
        ("options", "[1]", True, cama.FileError, "table"),
        ("options", "{", True, cama.FileError, "not a checkpoint"),
        ("vectors/position", None, False, cama.SceneError, "no position"),
        ("vectors/position", np.zeros(5), False, cama.FileError, "shape"),
        ("vectors/position", np.full((169, 3), np.nan), False, cama.SceneError, "another scene"),
        ("vectors/velocity", np.zeros((3, 3)), False, cama.SceneError, "velocity has 3 rows"),
        ("tangled", np.zeros((1, 2)), False, cama.FileError, "integers"),
        ("let_go", np.array([[0, 7]]), False, cama.SceneError, "let_go"),
        ("friction_pair", np.zeros((1, 2), int), False, cama.FileError, "shape"),
        ("friction_pair", np.full((1, 3), 7), False, cama.SceneError, "friction_pair has 1 rows"),
        ("matching_order", np.zeros(162, int), False, cama.SceneError, "twice"),
        ("matching_parent_0", np.zeros(3, int), False, cama.SceneError, "level 0"),
        ("matching_start_0", None, False, cama.FileError, "matching_start_0"),
    ],
)
def test_damaged_files_are_refused_by_name_and_nothing_changes(kept, name, value, attribute, error, text):
    path, _ = kept
    damage(path, name, value, attribute)
    simulation = falling()
    before = simulation.state_hash
    with pytest.raises(error, match=text):
        simulation.load_checkpoint(path)
    assert (simulation.state_hash, simulation.step_count) == (before, 0)


def test_what_is_no_checkpoint_is_refused(tmp_path):
    (tmp_path / "text.h5").write_text("hello")
    for path, text in (
        (tmp_path / "none.h5", "no such file"),
        (tmp_path, "no such file"),
        (tmp_path / "text.h5", "not a checkpoint"),
    ):
        with pytest.raises(cama.FileError, match=text):
            falling().load_checkpoint(path)


def command(*words):
    return subprocess.run(
        [
            str(Path(sys.executable).parent / "cama"),
            "run",
            "drape",
            "--resolution",
            "300",
            "--threads",
            "1",
            *map(str, words),
        ],
        capture_output=True,
        text=True,
        timeout=120,
    )


def test_the_command_resumes_as_if_it_had_never_stopped(tmp_path):
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    assert command("--frames", 14, "-o", whole).returncode == 0
    assert command("--frames", 8, "-o", parts, "--checkpoint", 3).returncode == 0
    (parts / "checkpoint.h5").unlink()
    # As a run that was killed after frame 8: the checkpoint is of frame 6, and what came after it is computed anew.
    simulation = cama.Simulation(cama.Scene.load("drape", 300), threads=1)
    simulation.load_checkpoint(parts / "checkpoint-before.h5")
    assert simulation.time == pytest.approx(6 * 0.025, rel=1e-12)
    done = command("--frames", 14, "-o", parts, "--resume")
    assert done.returncode == 0 and "resumed at step" in done.stdout, done.stderr
    with Recording(whole) as a, Recording(parts) as b:
        assert len(a) == len(b) == 15
        np.testing.assert_array_equal(a.times, b.times)
        np.testing.assert_array_equal(a.positions[:], b.positions[:])
    first, second = (json.loads((folder / "summary.json").read_text()) for folder in (whole, parts))
    assert first["state_hash"] == second["state_hash"] and first["steps"] == second["steps"]
    assert first["resumed_at"] is None and second["resumed_at"] == simulation.step_count
    other = command("--frames", 20, "-o", parts, "--resume", "--set", "tolerance=1e-3")
    assert other.returncode == 0 and "not bit by bit as before: tolerance 0.001 instead of 0.01" in " ".join(
        other.stdout.split()
    )


@pytest.mark.parametrize(
    "edit, part",
    [
        (lambda s: setattr(s, "gravity", (0, 0, 9.81)), "gravity"),
        (lambda s: setattr(s, "friction", 0.9), "contact"),
        (lambda s: s.add_obstacle(shape={"plane": {"size": [1, 1]}}, name="floor", translate=(0, 0, -1)), "floor"),
        (lambda s: s.pin("sheet 0", [3]), "pins"),
        (lambda s: setattr(s.cloths[1], "material", cama.Material.fabric("denim")), "sheet 1"),
        (lambda s: setattr(s, "wind", {"velocity": (1, 0, 0)}), "wind"),
    ],
)
def test_a_checkpoint_of_another_scene_is_refused_by_what_differs(kept, edit, part):
    path, _ = kept
    scene = falling().scene.copy()
    edit(scene)
    changed = cama.Simulation(scene, threads=1)
    before = changed.state_hash
    with pytest.raises(cama.SceneError, match=part):
        changed.load_checkpoint(path)
    assert (changed.state_hash, changed.step_count) == (before, 0)


def test_a_changed_scene_may_go_on_where_it_is_asked_for_and_frames_are_counted_from_the_start(kept):
    path, _ = kept
    scene = falling().scene.copy()
    scene.gravity, scene.frames = (0, 0, -1), 3
    simulation = cama.Simulation(scene, threads=1)
    assert simulation.load_checkpoint(path, changed_scene=True) == []
    assert [frame.index for frame in simulation.frames()] == [3, 4, 5]  # 8 steps of 3 a frame are two frames


def test_resuming_otherwise_than_the_frames_are_is_refused_and_loses_nothing(tmp_path):
    assert command("--frames", 4, "-o", tmp_path, "--store", "single").returncode == 0
    summary = (tmp_path / "summary.json").read_text()
    for words, text in (
        (("--frames", 4), "has 4 frames"),
        (("--frames", 6, "--store", "double"), "float32"),
        (("--frames", 6, "--time-step", "0.003"), "frame every"),
    ):
        refused = command("-o", tmp_path, "--resume", *words)
        assert refused.returncode == 2 and text in " ".join(refused.stderr.split()), refused
        assert (tmp_path / "summary.json").read_text() == summary and len(Recording(tmp_path)) == 5
    assert command("-o", tmp_path, "--resume", "--frames", 6).returncode == 0
    with Recording(tmp_path) as done:
        assert len(done) == 7 and done.positions.dtype == np.float32


def test_what_an_earlier_checkpoint_does_not_say_is_not_left_from_the_run_before(tmp_path):
    """The limit of the next step that stretched edges have left: 1 ms, where the run takes more."""
    scene = cama.Scene.load("drape", 300)
    whole = cama.Simulation(scene, backend="cpu")
    whole.step(3)
    whole.save_checkpoint(tmp_path / "a.h5")
    for name, limit in (("short", 1e-3), ("earlier", None)):
        (tmp_path / f"{name}.h5").write_bytes((tmp_path / "a.h5").read_bytes())
        with h5py.File(tmp_path / f"{name}.h5", "a") as file:
            numbers = file["numbers"].attrs
            if limit is None:
                del numbers["max_step_by_stretch"]
            else:
                numbers["max_step_by_stretch"] = limit
    whole.step()
    used = cama.Simulation(scene, backend="cpu")
    used.load_checkpoint(tmp_path / "short.h5")
    used.step()
    assert used.report["time_step"] <= 1e-3 < whole.report["time_step"]
    used.load_checkpoint(tmp_path / "earlier.h5")
    used.step()
    assert used.state_hash == whole.state_hash
