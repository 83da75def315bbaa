# SPDX-License-Identifier: Apache-2.0
"""The command `cama`: what it writes, and how it fails."""

import json
import os
import signal
import subprocess
import sys
import time

import h5py
import numpy as np
import pytest
from typer.testing import CliRunner

import cama
from cama.cli import app
from conftest import judge

RUNNER = CliRunner()
FIELDS = {
    "obstacles",
    "scene",
    "backend",
    "device",
    "precision",
    "accuracy",
    "triangles",
    "vertices",
    "steps",
    "error",
    "dt",
    "time_steps",
    "rejected",
    "over_error",
    "ms_per_step",
    "stages",
    "pcg",
    "contacts",
    "impacts",
    "intersections",
    "min_gap",
    "max_strain",
    "energy",
    "peak_memory_bytes",
    "truncated",
    "lost_motion",
    "released",
    "rest_shapes",
    "resumed_at",
    "counted_from",
    "wall_time",
    "retries",
    "state_hash",
}


def call(*words):
    return RUNNER.invoke(app, [str(w) for w in words], catch_exceptions=False)


@pytest.fixture(scope="module")
def drape(tmp_path_factory):
    """A short run of the drape scene."""
    folder = tmp_path_factory.mktemp("drape")
    result = call("run", "drape", "--resolution", 600, "--frames", 12, "-o", folder)
    assert result.exit_code == 0, result.output
    return folder


def no_constant(word):
    raise AssertionError(f"{word} in JSON")


def test_summary_has_exactly_its_fields(drape):
    s = json.loads((drape / "summary.json").read_text(), parse_constant=no_constant)
    assert set(s) == FIELDS
    assert s["scene"] == "drape" and s["error"] == pytest.approx(0.002)  # 0.2 % of 1 m
    assert s["steps"] >= 12 and s["dt"] == pytest.approx(12 * 0.025 / s["steps"])
    assert 0 < s["time_steps"]["min"] <= s["dt"] <= s["time_steps"]["max"] <= 0.025 * (1 + 1e-9)
    assert (
        set(s["ms_per_step"]) == {"mean", "median", "max"} and 0 < s["ms_per_step"]["median"] <= s["ms_per_step"]["max"]
    )
    assert s["stages"] and all(ms >= 0 for ms in s["stages"].values())
    assert s["pcg"]["iterations"]["max"] >= s["pcg"]["iterations"]["mean"] > 0
    assert s["intersections"] == 0 and s["contacts"]["max"] >= 0 and s["impacts"]["max"] >= 0
    assert int(s["state_hash"], 16) >= 0 and s["peak_memory_bytes"] > 0
    assert not list(drape.glob("*.partial"))


def test_frames_hold_the_clip(drape):
    with h5py.File(drape / "frames.h5") as f:
        assert f["positions"].shape == (13, f["cloth_ranges"][-1, 1] + np.ptp(f["obstacle_ranges"][0]), 3)
        np.testing.assert_allclose(f["times"], np.arange(13) * 0.025, atol=1e-12)
        assert [n.decode() for n in f["cloth_ranges"].attrs["names"].astype("S")] == ["lower", "middle", "upper"]
        assert (
            f["faces"].shape[1] == 3
            and f.attrs["scene"] == "drape"
            and f.attrs["error"] == pytest.approx(0.002)
            and f.attrs["time_step"] == f.attrs["steps_per_frame"] == 0  # chosen by the error
        )
        assert f["positions"].chunks[0] == 1 and f["positions"].maxshape[0] is None
    assert judge(drape) == 0


def test_run_twice_gives_the_same_hash_and_leaves_other_files(drape, tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    for _ in range(2):
        assert (
            call(
                "run", "drape", "--resolution", 600, "--frames", 12, "-o", tmp_path, "--threads", 1, "--store", "single"
            ).exit_code
            == 0
        )
    first, second = (json.loads((f / "summary.json").read_text())["state_hash"] for f in (drape, tmp_path))
    assert first == second and (tmp_path / "notes.txt").read_text() == "mine"


def test_info_explain_check():
    info = call("info")
    assert info.exit_code == 0 and "cpu" in info.output and cama.__version__ in info.output and "cotton" in info.output
    explain = call("explain", "drape", "--resolution", 300)
    assert explain.exit_code == 0 and "position" in explain.output and "KiB" in explain.output
    check = call("check", "drape", "--resolution", 300)
    assert check.exit_code == 0 and "intersections at the start: 0" in check.output
    assert "starts far" not in check.output and "metres" not in check.output


def test_check_asks_about_centimetres(tmp_path):
    """A skirt of 60 by 90 in centimetres."""
    (tmp_path / "scene.json").write_text(
        json.dumps({"cloth": [{"grid": {"size": [60, 90]}, "name": "skirt", "material": "cotton"}]})
    )
    said = " ".join(call("check", tmp_path, "--resolution", 100).output.split())
    assert "cloth 'skirt': vertices: 90 m across; lengths are metres" in said


def test_check_shows_sizes_and_a_rest_shape_that_is_no_rest_shape(tmp_path):
    """A sheet of 2 m x 0.6 m with texture coordinates from 0 to 1: at rest it is a square of 1 m, 120 g of cotton."""
    x, y = np.meshgrid(np.linspace(0, 1, 6), np.linspace(0, 1, 6))
    lines = [f"v {2 * a} {0.6 * b} 0\nvt {a} {b}" for a, b in zip(x.ravel(), y.ravel())]
    lines += [
        f"f {k + 1}/{k + 1} {k + 2}/{k + 2} {k + 8}/{k + 8} {k + 7}/{k + 7}"
        for j in range(5)
        for k in range(6 * j, 6 * j + 5)
    ]
    (tmp_path / "sheet.obj").write_text("\n".join(lines))
    (tmp_path / "scene.json").write_text(
        json.dumps({"cloth": [{"file": {"path": "sheet.obj", "rest": "uv"}, "name": "sheet", "material": "cotton"}]})
    )
    said = " ".join(call("check", tmp_path).output.split())
    assert "2 x 0.6 x 0 1 0.12 -40 to 100" in said and "sheet: starts far from its rest shape" in said
    assert "with strains of -40 to 100 %" in said and '"rest": "start", or leave them out, if the start is it' in said
    cloth = cama.Scene.load(tmp_path).cloths[0]
    assert cloth.rest_area == pytest.approx(1, rel=1e-12) and cloth.mass == pytest.approx(
        cloth.material.density, rel=1e-12
    )
    assert cloth.start_strain == pytest.approx((-0.4, 1.0), rel=1e-9)


@pytest.mark.parametrize(
    "words, expected",
    [
        (["run", "no_such_scene"], "no_such_scene"),
        (["check", "broken.json"], "gravitas"),
        (["run", "drape", "--backend", "cuda", "--device", "97"], "cuda"),
        (["render", "no_such_folder"], "no_such_folder"),
        (["run", "drape", "--resolution", "200", "--frames", "1", "-o", "broken.json"], "broken.json"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(words, expected, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "broken.json").write_text('{"gravitas": 1}')
    result = call(*words)
    assert result.exit_code == 2
    assert expected in result.output and "Error:" in result.output and "Traceback" not in result.output
    assert len(result.output.strip().splitlines()) == 1


def test_debug_shows_the_exception():
    with pytest.raises(cama.FileError):
        call("run", "no_such_scene", "--debug")


def wait_for_frames(path, count, process):
    for _ in range(600):
        try:
            with h5py.File(path, "r", locking=False) as f:
                if len(f["times"]) >= count:
                    return
        except (OSError, KeyError, RuntimeError):
            pass
        assert process.poll() is None
        time.sleep(0.1)
    raise AssertionError("no frames came")


def test_interrupt_keeps_what_was_computed(tmp_path):
    process = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "cama",
            "run",
            "drape",
            "--resolution",
            "600",
            "--frames",
            "100000",
            "--time-step",
            str(0.025 / 6),
            "-o",
            str(tmp_path),
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        cwd=tmp_path,
        env=dict(os.environ, COLUMNS="120"),
    )
    wait_for_frames(tmp_path / "frames.h5", 4, process)
    process.send_signal(signal.SIGINT)
    output = process.communicate(timeout=60)[0]
    assert process.returncode == 130 and "Traceback" not in output, output
    s = json.loads((tmp_path / "summary.json").read_text())
    with h5py.File(tmp_path / "frames.h5") as f:
        assert len(f["times"]) == len(f["positions"]) >= 4
        assert 0 <= s["steps"] - 6 * (len(f["times"]) - 1) <= 6
        assert np.isfinite(f["positions"][-1]).all()


def test_sigterm_stops_a_run_as_ctrl_c_does(tmp_path):
    process = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "cama",
            "run",
            "drape",
            "--resolution",
            "300",
            "--frames",
            "100000",
            "-o",
            str(tmp_path),
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    wait_for_frames(tmp_path / "frames.h5", 2, process)
    process.terminate()
    output = process.communicate(timeout=60)[0]
    assert process.returncode == 143 and "Traceback" not in output, output
    assert (tmp_path / "checkpoint.h5").is_file() and (tmp_path / "summary.json").is_file()


def test_a_summary_that_cannot_be_written_is_a_named_error(tmp_path):
    (tmp_path / "summary.json.partial").mkdir()
    done = call("run", "drape", "--resolution", 300, "--frames", 1, "-o", tmp_path)
    assert done.exit_code == 1 and "summary.json: writing failed" in " ".join(done.output.split())
    assert (tmp_path / "checkpoint.h5").is_file()


def test_frames_that_steps_do_not_fill_are_said(tmp_path):
    (tmp_path / "scene.json").write_text(
        json.dumps(
            {
                "time_step": 0.003,
                "frame_time": 0.01,
                "frames": 2,
                "cloth": [{"grid": {"size": [1, 1]}, "triangles": 50}],
            }
        )
    )
    said = " ".join(call("run", tmp_path, "-o", tmp_path / "out").output.split())
    assert "frames are 9 ms apart, not 10: 3 steps of 3 ms" in said
    assert "apart, not" not in call("run", tmp_path, "--time-step", "0.0025", "-o", tmp_path / "out").output


def test_cloth_that_is_pulled_too_far_is_said(tmp_path):
    """One end is held, the other moves 0.5 m in half a second: a sheet of 0.2 m ends at 0.7 m, a strain of 250 % in the
    mean.
    """
    ends = [{"cloth": "strip", "edge": "right", "motion": {"velocity": [1, 0, 0]}}, {"cloth": "strip", "edge": "left"}]
    scene = {
        "gravity": [0, 0, 0],
        "frame_time": 0.1,
        "cloth": [{"name": "strip", "grid": {"size": [0.2, 0.1]}, "material": "cotton"}],
        "pins": ends,
    }
    (tmp_path / "scene.json").write_text(json.dumps(scene))
    result = call("run", tmp_path, "--resolution", 40, "--frames", 5, "--accuracy", "preview", "-o", tmp_path / "out")
    strain = json.loads((tmp_path / "out" / "summary.json").read_text())["max_strain"]
    assert result.exit_code == 0 and strain > 2.4 and "no fabric is like that" in result.output


def test_options_that_have_a_word_of_their_own_are_not_set_twice():
    done = call("run", "drape", "--set", "threads=1")
    assert done.exit_code == 2 and "use --threads" in done.output


def test_interrupt_in_python_keeps_the_state():
    code = (
        "import cama, os, signal, threading\n"
        "s = cama.Simulation(cama.Scene.load('drape', 300))\n"
        "threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT)).start()\n"
        "try:\n    s.step(10**6)\n"
        "except KeyboardInterrupt:\n    n = s.step_count; s.step(); print('kept', n > 0, s.step_count - n)\n"
    )
    output = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert output.stdout.split() == ["kept", "True", "1"], output


def test_pinched_cloth_stops_the_run_or_is_let_go_of(tmp_path):
    """Two balls pass into each other with a sheet between them: there is no way out."""
    line = np.linspace(-0.1, 0.1, 4)
    x, y = np.meshgrid(line, line)
    k = np.array([4 * j + i for j in range(3) for i in range(3)])
    scene = cama.Scene(gravity=(0, 0, 0), time_step=0.02, frame_time=0.02, frames=10, thickness=2e-3)
    scene.add_cloth(
        np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], 1),
        np.concatenate([np.stack([k, k + 1, k + 5], 1), np.stack([k, k + 5, k + 4], 1)]),
        material="cotton",
    )
    for name, sign in (("lower", -1), ("upper", 1)):
        scene.add_obstacle(
            shape={"sphere": {"radius": 0.3}},
            translate=(0, 0, sign * 0.305),
            name=name,
            motion=cama.Motion(velocity=(0, 0, -0.05 * sign)),
        )
    path = tmp_path / "pinched.json"
    path.write_text(scene.to_json())
    stopped = call("run", path, "-o", tmp_path / "a")
    assert stopped.exit_code == 1 and "pinches cloth" in stopped.output and "obstacle '" in stopped.output
    free = call("run", path, "-o", tmp_path / "b", "--pinch", "release")
    assert free.exit_code == 0 and "let go of" in free.output
    assert json.loads((tmp_path / "b" / "summary.json").read_text())["released"] > 0
