# SPDX-License-Identifier: Apache-2.0
"""Runs that survive: killed at any moment, on a full disk, in a folder that is gone."""

import io
import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest

import cama
from cama.io import checkpoint, journal
from cama.io.recording import NAME, Recorder, Recording
from conftest import grid

POINTS = 5


# --- frames.h5 that is killed at every single write ---------------------------------------------------------------------


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
    scene = SimpleNamespace(cloths=[SimpleNamespace(name="sheet")], obstacles=[])
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
        with Recording(path) as recording:  # as it was left
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
        with Recording(path) as recording:
            found = [int(frame[0, 0]) for frame in recording.positions[:]]
        outcomes.add(tuple(found))
        assert found in ([[0, 1, 2, 3]] * (added == 0)) + [[0, 1, 102, 103, 104][:n] for n in (added + 2, added + 3)]
    assert len(outcomes) == 5
