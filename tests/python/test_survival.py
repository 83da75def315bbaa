# SPDX-License-Identifier: Apache-2.0
"""Runs that survive: killed at any moment, on a full disk, in a folder that is gone."""

import contextlib
import errno
import fcntl
import functools
import io
import json
import os
import random
import re
import resource
import signal
import subprocess
import sys
import termios
import time
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
from typer.testing import CliRunner

import cama
from cama.cli import app
from cama.io import checkpoint, journal
from cama.io.recording import NAME, Recorder, Recording
from cama.io.summary import Summary
from conftest import grid

POINTS = 5


# --- frames.h5 that is killed at every single write -------------------------------------------------------------------


class Counted(io.FileIO):
    """A file whose process is killed in the middle of a write, or before a change of its length."""

    left = None  # writes until then; None: never

    def _count(self):
        Counted.left -= 1
        return Counted.left < 0

    def write(self, data):
        if self._count():
            super().write(memoryview(data)[: len(data) // 2])
            os._exit(9)
        return super().write(data)

    def truncate(self, size=None):
        if self._count():
            os._exit(9)
        return super().truncate(size)


def moment(number, again=False):
    """Positions [POINTS, 3] of a frame; again: as another run computes them."""
    return np.full((POINTS, 3), number + 100 * again, float)


def record(path, numbers, until=None, said=lambda: None):
    """Records frames of a simulation that is only sizes and names."""
    sheet = SimpleNamespace(
        name="sheet",
        material=SimpleNamespace(name="cotton"),
        source="arrays",
        rest_shape="start",
        material_vertices=np.zeros((0, 2)),
        material_faces=np.zeros((0, 3), int),
        rest_corners=np.zeros((1, 3, 2)),
    )
    scene = SimpleNamespace(cloths=[sheet], obstacles=[], folder=Path())
    simulation = SimpleNamespace(
        vertex_count=POINTS, faces=np.array([[0, 1, 2]]), scene=scene, cloth_ranges=[(0, POINTS)], obstacle_ranges=[]
    )
    with Recorder(path, simulation, {"frame_time": 1.0}, until=until) as recorder:
        for number in numbers:
            recorder.add(float(number), moment(number, until is not None), number, 0)
            said()


def killed(after, work):
    """Does the work in a process that is killed at that write; returns whether it came to its end, and what it said."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        Counted.left = after
        journal.open = lambda path, mode, buffering: Counted(path, mode.replace("b", ""))
        try:
            work(lambda: os.write(writing, b"."))
            os._exit(0)
        except BaseException:
            os._exit(1)
    os.close(writing)
    with os.fdopen(reading, "rb") as pipe:
        said = len(pipe.read())
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    assert code in (0, 9)
    return code == 0, said


@pytest.mark.skipif(not hasattr(os, "fork"), reason="kills forked processes")
def test_a_recording_that_is_killed_at_any_write_holds_whole_frames(tmp_path):
    path, after, done, interrupted = tmp_path / NAME, 0, False, 0
    while not done:
        for file in tmp_path.iterdir():
            file.unlink()
        done, added = killed(after, lambda said: record(path, range(3), said=said))
        after += 1
        if not path.exists():
            assert added == 0
            continue
        interrupted += not done
        with Recording(path, checked=True) as recording:  # as it was left
            frames = len(recording)
            assert added <= frames <= added + 1
            assert np.array_equal(recording.positions[:], [moment(k) for k in range(frames)])
        journal.recover(path)
        with h5py.File(path) as file:
            assert np.array_equal(file["times"], np.arange(frames)) and len(file["contacts"]) == frames
    assert interrupted > 20 and not journal.journal_of(path).exists()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="kills forked processes")
def test_a_recording_that_goes_on_and_is_killed_at_any_write_holds_whole_frames(tmp_path):
    path, after, done = tmp_path / NAME, 0, False
    record(path, range(4))
    begun = path.read_bytes()
    outcomes = set()
    while not done:
        journal.journal_of(path).unlink(missing_ok=True)
        path.write_bytes(begun)
        done, added = killed(after, lambda said: record(path, range(2, 5), until=1.0, said=said))
        after += 1
        with Recording(path, checked=True) as recording:
            found = [int(frame[0, 0]) for frame in recording.positions[:]]
        outcomes.add(tuple(found))
        assert found in ([[0, 1, 2, 3]] * (added == 0)) + [[0, 1, 102, 103, 104][:n] for n in (added + 2, added + 3)]
    assert len(outcomes) == 5


# --- Checkpoints ------------------------------------------------------------------------------------------------------


def sheet_on_ball():
    scene = cama.Scene(thickness=4e-3, time_step=0.004, frame_time=0.012)
    scene.add_cloth(*grid(4, size=0.3, z=0.005), velocity=(0, 0, -1), name="sheet")
    scene.add_obstacle(shape={"sphere": {"radius": 0.1}}, name="ball", translate=(0, 0, -0.101))
    return cama.Simulation(scene, threads=1, backend="cpu")


@pytest.mark.skipif(not hasattr(os, "fork"), reason="kills forked processes")
def test_a_checkpoint_that_is_killed_while_it_is_written_leaves_one_that_loads(tmp_path, monkeypatch):
    """The write itself and both changes of names are killed, before and after."""
    simulation, files, hashes = sheet_on_ball(), [tmp_path / checkpoint.NAME, tmp_path / checkpoint.BEFORE], {}
    for _ in range(3):
        simulation.step()
        checkpoint.write(files[0], simulation, before=checkpoint.BEFORE)
        hashes[simulation.step_count] = simulation.state_hash
    kept = [file.read_bytes() for file in files]
    simulation.step()
    hashes[4] = simulation.state_hash
    whole = os.replace

    def replace(*paths):
        for kill in (True, False):
            Counted.left -= 1
            if Counted.left < 0:
                os._exit(9)
            if kill:
                whole(*paths)

    monkeypatch.setattr(checkpoint, "open", lambda path, mode: Counted(path, "w"), raising=False)
    monkeypatch.setattr(checkpoint.os, "replace", replace)
    after, done, newest = 0, False, []
    while not done:
        for file, text in zip(files, kept):
            file.write_bytes(text)
        done, _ = killed(after, lambda said: checkpoint.write(files[0], simulation, before=checkpoint.BEFORE))
        after += 1
        loads = []
        for file in files:
            if file.exists():
                again = sheet_on_ball()
                assert again.load_checkpoint(file) == [] and again.state_hash == hashes[again.step_count]
                loads.append(again.step_count)
        newest.append(loads[0])
        assert loads in ([3, 2], [3], [4, 3])
    assert newest == [3, 3, 3, 3, 3, 4, 4]  # write, its digest, two times two changes of names, the end


# --- The command ------------------------------------------------------------------------------------------------------

DRAPE = ["drape", "--resolution", "96", "--threads", "1", "--backend", "cpu"]
COUNTED = (  # fields of summary.json that do not depend on the clock, and so are those of a run that never stopped
    "steps",
    "error",
    "dt",
    "time_steps",
    "rejected",
    "over_error",
    "pcg",
    "contacts",
    "impacts",
    "intersections",
    "min_gap",
    "max_strain",
    "energy",
    "truncated",
    "lost_motion",
    "released",
    "retries",
    "counted_from",
    "state_hash",
)


def start(folder, *words, **how):
    """Starts `cama run` in a process of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", "cama", "run", *DRAPE, "-o", str(folder), *map(str, words)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "COLUMNS": "200"},
        **how,
    )


def finish(process, code=0):
    """Returns what a process has printed."""
    out, err = process.communicate(timeout=300)
    assert process.returncode == code and "Traceback" not in err, out + err
    return out + err


def run(folder, *words, code=0):
    """Returns what `cama run` prints, called within this process."""
    result = CliRunner().invoke(
        app, ["run", *DRAPE, "-o", str(folder), *map(str, words)], env={"COLUMNS": "200"}, catch_exceptions=False
    )
    assert result.exit_code == code, result.output
    return " ".join(result.output.split())


def summary_of(folder):
    return json.loads((folder / "summary.json").read_text())


def assert_same(whole, parts):
    """Frames and counts of two folders are equal to the bit."""
    with h5py.File(whole / NAME) as a, h5py.File(parts / NAME) as b:
        for name in ("positions", "times", "contacts", "intersections"):
            assert np.array_equal(a[name][:], b[name][:]), name
    one, other = (summary_of(folder) for folder in (whole, parts))
    assert {name: one[name] for name in COUNTED} == {name: other[name] for name in COUNTED}


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A run of 12 frames that nothing disturbed, by the default level, whose steps an error chooses."""
    folder = tmp_path_factory.mktemp("whole")
    run(folder, "--frames", 12)
    assert summary_of(folder)["error"] > 0
    return folder


def identity(file):
    with contextlib.suppress(FileNotFoundError):
        return file.stat().st_ino, file.stat().st_mtime_ns


def run_and_kill(folder, times, frames):
    """Runs with `kill -9` at random moments, that many times, and then to the end; returns the lines of resuming.

    Checkpoints are written all the time, so that many moments are within one of them.
    """
    lines, newest = [], folder / checkpoint.NAME
    for left in reversed(range(times + 1)):
        before = identity(newest)
        process = start(folder, "--frames", frames, "--resume", "--checkpoint-every", "0.001")
        lines.append(process.stdout.readline().strip())
        if left:
            # Later kills come after at least one checkpoint more than before, if the run does not end first.
            while left != times and process.poll() is None and identity(newest) == before:
                time.sleep(0.001)
            time.sleep(random.uniform(0, 0.2))
            process.kill()
            process.communicate()
            if process.returncode == 0:
                return lines
        else:
            finish(process)
    return lines


def wait_for(condition, process):
    for _ in range(1200):
        if condition():
            return
        assert process.poll() is None, process.communicate()
        time.sleep(0.05)
    raise AssertionError("it did not come")


def test_a_run_that_is_killed_three_times_is_that_of_one_that_was_not(whole, tmp_path):
    lines = run_and_kill(tmp_path, 3, 12)
    assert "starting from frame 0" in lines[0] and "resumed at step" in lines[-1]
    assert_same(whole, tmp_path)
    assert not list(tmp_path.glob("*.partial")) and not list(tmp_path.glob("*.journal"))


@pytest.mark.long
def test_a_run_that_is_killed_twenty_times_is_that_of_one_that_was_not(tmp_path):
    run(tmp_path / "whole", "--frames", 80)
    lines = run_and_kill(tmp_path / "parts", 20, 80)
    assert sum("resumed at step" in line for line in lines) > 10
    assert_same(tmp_path / "whole", tmp_path / "parts")


def test_what_the_checkpoint_counted_goes_on_and_what_it_did_not_is_said(whole, tmp_path):
    """Over one resume within the run, and one after a checkpoint that `Simulation.save_checkpoint` wrote."""
    run(tmp_path, "--frames", 5)
    run(tmp_path, "--frames", 8, "--resume")
    before = summary_of(tmp_path)
    said = run(tmp_path, "--frames", 12, "--resume")
    assert_same(whole, tmp_path)
    after = summary_of(tmp_path)
    assert after["resumed_at"] == before["steps"] and after["wall_time"] > before["wall_time"] > 0
    assert f"with the parts before step {before['steps']}" in said
    simulation = cama.Simulation(cama.Scene.load("drape", 96), backend="cpu", threads=1)
    simulation.load_checkpoint(tmp_path)
    simulation.save_checkpoint(tmp_path / checkpoint.NAME)
    said = run(tmp_path, "--frames", 13, "--resume")
    last = summary_of(tmp_path)
    assert last["counted_from"] == last["resumed_at"] == after["steps"]
    assert f"counted from step {after['steps']} on" in said


def test_the_gap_of_a_frame_that_could_not_be_recorded_is_that_of_its_step(tmp_path):
    simulation, again = sheet_on_ball(), sheet_on_ball()
    counted = Summary(simulation)
    for _ in range(6):
        simulation.step()
        counted.add_step()
    assert simulation.min_gap < 4e-3
    simulation.save_checkpoint(tmp_path / checkpoint.NAME)
    again.load_checkpoint(tmp_path)
    summary = Summary(again)
    summary.resume(counted.state(), frames=1, intersections=0)
    summary.add_frame(0)
    assert summary.min_gap == simulation.min_gap and summary.contacts == simulation.report["contacts"] > 0


@pytest.mark.parametrize("name, value", [("frames", np.nan), ("frames", 0.0), ("wall_time", np.inf), ("frames", None)])
def test_damaged_counts_are_refused(tmp_path, name, value):
    simulation, path = sheet_on_ball(), tmp_path / checkpoint.NAME
    summary = Summary(simulation)
    summary.add_frame(0)
    checkpoint.write(path, simulation, summary.state())
    assert checkpoint.read_run(path)["numbers"]["frames"] == 1
    with h5py.File(path, "r+") as file:
        del file["run"].attrs[name]
        if value is not None:
            file["run"].attrs[name] = value
    with pytest.raises(cama.FileError, match=name):
        checkpoint.read_run(path)


def test_the_time_between_checkpoints_is_said(tmp_path):
    run(tmp_path, "--frames", 2, "--checkpoint-every", 0)
    assert (tmp_path / checkpoint.NAME).exists() and not (tmp_path / checkpoint.BEFORE).exists()
    run(tmp_path, "--frames", 2, "--checkpoint-every", "1/1000", "--overwrite")
    assert (tmp_path / checkpoint.BEFORE).exists()
    run(tmp_path, "--frames", 2, "--overwrite")  # a minute
    assert not (tmp_path / checkpoint.BEFORE).exists()


def test_the_checkpoint_before_is_taken_where_the_newest_cannot_be_read(whole, tmp_path):
    run(tmp_path, "--frames", 9, "--checkpoint", 3)
    newest, before = (tmp_path / name for name in (checkpoint.NAME, checkpoint.BEFORE))
    good = before.read_bytes()
    newest.write_bytes(newest.read_bytes()[:1000])
    said = run(tmp_path, "--frames", 7, "--resume")
    assert "checkpoint.h5: not a checkpoint of cama" in said and "going on from the checkpoint before it" in said
    assert "resumed at step" in said and "checkpoint-before.h5" in said
    assert before.read_bytes() == good  # the one that cannot be read did not replace it
    run(tmp_path, "--frames", 12, "--resume")
    assert_same(whole, tmp_path)


def test_a_checkpoint_that_is_ahead_of_the_frames_is_not_taken(whole, tmp_path):
    """As after a power cut that lost the last frames."""
    run(tmp_path, "--frames", 4, "--checkpoint", 2)
    before = (tmp_path / NAME).read_bytes()
    run(tmp_path, "--frames", 8, "--resume")
    (tmp_path / NAME).write_bytes(before)
    said = run(tmp_path, "--frames", 12, "--resume")
    assert "comes after 9 recorded frames with the start, but" in said and "has 5" in said
    assert_same(whole, tmp_path)
    (tmp_path / NAME).unlink()
    assert "frames.h5, which is not there" in run(tmp_path, "--frames", 13, "--resume", code=2)


def test_without_a_checkpoint_a_run_begins_anew_and_keeps_the_frames(tmp_path):
    run(tmp_path, "--frames", 2)
    for name in (checkpoint.NAME, checkpoint.BEFORE):
        (tmp_path / name).unlink(missing_ok=True)
    said = run(tmp_path, "--frames", 1, "--resume")
    assert "has no checkpoint to go on from: starting from frame 0" in said and "2 frames, are now in" in said
    with Recording(tmp_path) as recording:
        assert len(recording) == 2


# --- A disk that is full, a folder that is gone, a terminal that is closed --------------------------------------------


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="limits files by RLIMIT_FSIZE")
def test_a_run_goes_on_after_a_disk_was_full(whole, tmp_path):
    most = (whole / NAME).stat().st_size * 2 // 3
    assert most > (whole / checkpoint.NAME).stat().st_size
    limit = functools.partial(resource.setrlimit, resource.RLIMIT_FSIZE, (most, most))
    said = finish(start(tmp_path, "--frames", 12, preexec_fn=limit), code=1)
    assert "FileError" in said and "frames.h5: writing failed" in said and "is the disk full?" in said
    with Recording(tmp_path) as recording:
        assert 2 < len(recording) < 12
    assert not list(tmp_path.glob("*.partial")) and not list(tmp_path.glob("*.journal"))
    run(tmp_path, "--frames", 12, "--resume")
    assert_same(whole, tmp_path)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="limits files by RLIMIT_FSIZE")
def test_a_disk_that_is_full_from_the_start_gets_nothing_half_written(tmp_path):
    limit = functools.partial(resource.setrlimit, resource.RLIMIT_FSIZE, (1000, 1000))
    said = finish(start(tmp_path, "--frames", 2, preexec_fn=limit), code=2)
    assert "FileError" in said and "frames.h5: writing failed" in said and not list(tmp_path.iterdir())


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="writes to /dev/full, which Linux has")
def test_a_checkpoint_that_finds_no_space_leaves_the_last_ones(whole, tmp_path):
    run(tmp_path, "--frames", 6, "--checkpoint", 2)
    kept = {name: (tmp_path / name).read_bytes() for name in (checkpoint.NAME, checkpoint.BEFORE)}
    partial = tmp_path / f"{checkpoint.NAME}.partial"
    partial.symlink_to("/dev/full")
    said = run(tmp_path, "--frames", 12, "--resume", "--checkpoint", 1, code=1)
    assert "FileError" in said and "checkpoint.h5: writing failed" in said and os.strerror(errno.ENOSPC) in said
    # The first attempt is after the next frame. It took the link away, so that the last attempt, at the end, wrote.
    assert (tmp_path / checkpoint.BEFORE).read_bytes() == kept[checkpoint.NAME]
    assert not list(tmp_path.glob("*.partial"))
    run(tmp_path, "--frames", 12, "--resume")
    assert_same(whole, tmp_path)


def test_a_folder_that_is_gone_is_a_named_error(tmp_path):
    process = start(tmp_path / "a", "--frames", 100000)
    wait_for(lambda: (tmp_path / "a" / NAME).exists(), process)
    (tmp_path / "a").rename(tmp_path / "b")
    said = finish(process, code=1)
    assert "FileError" in said and "a/frames.h5: was moved, deleted or replaced while the run" in said
    with Recording(tmp_path / "b") as recording:
        assert len(recording) >= 1


def test_a_terminal_that_is_closed_stops_a_run_as_ctrl_c_does(tmp_path):
    """Its terminal sends SIGHUP, and every write to it fails from then on."""
    ours, theirs = os.openpty()
    process = subprocess.Popen(
        [sys.executable, "-m", "cama", "run", *DRAPE, "-o", str(tmp_path), "--frames", "100000"],
        stdin=theirs,
        stdout=theirs,
        stderr=theirs,
        start_new_session=True,
        preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
    )
    os.close(theirs)
    os.set_blocking(ours, False)

    def bar_shows_a_frame():
        with contextlib.suppress(BlockingIOError):
            return re.search(rb"[1-9]/1", os.read(ours, 10**6))

    wait_for(bar_shows_a_frame, process)
    os.close(ours)
    assert process.wait(60) == 128 + signal.SIGHUP
    assert (tmp_path / checkpoint.NAME).is_file() and summary_of(tmp_path)["steps"] > 0
