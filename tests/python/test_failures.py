# SPDX-License-Identifier: Apache-2.0
"""Absent drivers and memory that runs out, in processes of their own: named exceptions, and the state of before."""

import os
import subprocess
import sys

import numpy as np
import pytest

import cama
from cama.io.recording import Recording


def run(code, **environment):
    """Standard output of a Python process."""
    done = subprocess.run(
        [sys.executable, "-c", code], env={**os.environ, **environment}, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def scene(cells):
    return f"""
import sys; sys.path.insert(0, {os.path.dirname(__file__)!r})
from conftest import grid
import cama, numpy, resource
scene = cama.Scene()
scene.add_cloth(*grid({cells}), name="sheet")
scene.add_cloth(*grid({cells}, z=0.01), name="other")
"""


LIMIT = """
def limit(extra):
    pages = int(open("/proc/self/statm").read().split()[0])
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + extra if extra else resource.RLIM_INFINITY, resource.RLIM_INFINITY))
"""


def backend(name):
    return next(row for row in cama.backends() if row["name"] == name)


@pytest.fixture
def opencl_in_build():
    note = backend("opencl")["note"]
    if "not in this build" in note:
        pytest.skip("this build has no OpenCL: " + note)


def test_without_an_opencl_driver_the_error_says_what_to_install(opencl_in_build):
    out = run(
        scene(4)
        + """
try:
    cama.Simulation(scene, backend="opencl")
except cama.BackendError as error:
    print("caught", type(error).__name__, error)
print("cpu", cama.Simulation(scene, backend="cpu").step_count)
""",
        OCL_ICD_VENDORS="/nonexistent",
        OCL_ICD_FILENAMES="",
    )
    assert "caught BackendError backend opencl: no OpenCL device; install a driver (pocl" in out
    assert "cpu 0" in out


def test_the_command_line_ends_with_the_error_and_no_trace(tmp_path, opencl_in_build):
    words = ["run", "drape", "--backend", "opencl", "--frames", "1", "--resolution", "100", "-o", str(tmp_path)]
    done = subprocess.run(
        [sys.executable, "-c", f"from cama.cli import app; app({words!r})"],
        capture_output=True,
        text=True,
        timeout=120,
        env={**os.environ, "OCL_ICD_VENDORS": "/nonexistent"},
    )
    said = " ".join((done.stdout + done.stderr).split())
    assert done.returncode > 0
    assert "Traceback" not in said
    assert "no OpenCL device; install a driver" in said


def test_without_a_cuda_driver_the_error_has_the_drivers_code():
    cuda = backend("cuda")
    if cuda["available"]:
        pytest.skip("there is a CUDA device")
    with pytest.raises(cama.BackendError) as error:
        made = cama.Scene()
        made.add_cloth([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], name="sheet")
        cama.Simulation(made, backend="cuda")
    if "not in this build" in cuda["note"]:
        assert "'cuda' is not in this build" in str(error.value)
    else:
        assert "cudaError" in str(error.value) and "driver" in str(error.value)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="limits memory by RLIMIT_AS and /proc")
def test_memory_that_runs_out_while_a_simulation_is_made_is_a_named_error():
    out = run(
        scene(150)
        + LIMIT
        + """
limit(16 << 20)
try:
    cama.Simulation(scene, backend="cpu", threads=1)
except cama.BackendError as error:
    print("caught", type(error).__name__, error)
"""
    )
    assert "caught DeviceMemoryError" in out
    assert "lower the resolution" in out


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="limits memory by RLIMIT_AS and /proc")
def test_memory_that_runs_out_in_a_step_leaves_the_state_and_a_later_step_works():
    out = run(
        scene(60)
        + LIMIT
        + """
whole = cama.Simulation(scene, backend="cpu", threads=1)
for _ in range(3):
    whole.step()
simulation = cama.Simulation(scene, backend="cpu", threads=1)
before = simulation.state_hash
limit(1 << 20)
try:
    simulation.step()
except cama.DeviceMemoryError as error:
    limit(0)
    print("caught", error)
assert simulation.state_hash == before and simulation.step_count == 0
for _ in range(3):
    simulation.step()
assert simulation.state_hash == whole.state_hash
print("same")
"""
    )
    assert "caught out of memory" in out or "caught step 1: out of memory" in out
    assert "same" in out


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="limits files by RLIMIT_FSIZE")
def test_a_disk_that_is_full_is_a_named_error_and_earlier_frames_stay(tmp_path):
    out = run(
        scene(20)
        + f"""
import resource, signal
from cama.io.recording import Recorder
simulation = cama.Simulation(scene, backend="cpu", threads=1)
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, resource.RLIM_INFINITY))
frames = 0
try:
    with Recorder({str(tmp_path / "frames.h5")!r}, simulation) as recorder:
        while frames < 100:
            recorder.add(0.1 * frames, simulation.positions, 0, 0)
            frames += 1
except cama.FileError as error:
    print("caught", frames, error)
"""
    )
    assert "caught" in out and "frames.h5: writing failed" in out and "disk full" in out
    frames = int(out.split("caught ")[1].split()[0])
    assert 2 <= frames < 100
    with Recording(tmp_path / "frames.h5") as recording:
        assert len(recording) == frames and np.isfinite(recording.frame(frames - 1)).all()
