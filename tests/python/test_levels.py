# SPDX-License-Identifier: Apache-2.0
"""Accuracy levels from Python and the command line."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import cama
from cama.cli import app

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
import frame_error  # noqa: E402

RUNNER = CliRunner()


def falling(time_step=0.005, **more):
    scene = cama.Scene(time_step=time_step, frames=3, contact=False, **more)
    scene.add_cloth(shape={"grid": {"size": [0.2, 0.2]}, "triangles": 50}, material="cotton")
    return scene


def test_levels_set_the_time_step_and_frames_stay_the_same_in_time():
    assert cama.accuracy_levels() == ["preview", "interactive", "production", "accurate", "reference", "paper"]
    steps = {
        level: cama.Simulation(falling(frame_time=0.02), accuracy=level).time_step for level in cama.accuracy_levels()
    }
    assert steps["production"] == steps["paper"] == 0.005
    assert steps["preview"] == pytest.approx(0.02 / 3) and steps["interactive"] == pytest.approx(0.004)
    assert steps["accurate"] == pytest.approx(1 / 1200) and steps["reference"] == pytest.approx(1 / 4800)
    for level, own in (("preview", 0.005), ("production", 0.005), ("accurate", 0.005), ("production", 0)):
        simulation = cama.Simulation(falling(own, frame_time=0.02), accuracy=level)
        times = [frame.time for frame in simulation.frames(audit=False)]
        np.testing.assert_allclose(times, [0.02, 0.04, 0.06], rtol=1e-12)


def test_what_neither_scene_nor_user_says_the_level_does():
    scene = falling(0)
    assert (scene.time_step, scene.frame_time, scene.seconds_per_frame) == (0, 0, 1 / 60)
    simulation = cama.Simulation(scene)
    chosen = {s["name"]: (s["value"], s["origin"]) for s in simulation.chosen_options}
    assert simulation.error == pytest.approx(4e-4) and "time_step" not in chosen  # of 0.2 m
    assert chosen["error"] == ("0.2 %, 0.4 mm in 1/60 s", "level") and simulation.steps_per_frame == 0
    simulation = cama.Simulation(scene, error="")
    assert simulation.time_step == pytest.approx(1 / 240) and simulation.steps_per_frame == 4
    chosen = {s["name"]: s["origin"] for s in simulation.chosen_options}
    assert chosen["time_step"] == "level" and "error" not in chosen
    for level, error in (("preview", 2e-3), ("interactive", 8e-4), ("accurate", 0), ("reference", 0), ("paper", 0)):
        assert cama.Simulation(scene, accuracy=level).error == pytest.approx(error)
    assert cama.Simulation(scene, accuracy="paper").time_step == pytest.approx(1 / 240)  # 1/200 s is 3.3 in a frame
    assert "time_step" not in json.loads(scene.to_json()) and cama.Scene.parse(scene.to_json()).time_step == 0


def test_interactive_solves_twice_in_steps_by_an_error_and_once_in_those_of_a_control_loop():
    def of(scene, **options):
        simulation = cama.Simulation(scene, accuracy="interactive", **options)
        chosen = {s["name"]: (s["value"], s["origin"]) for s in simulation.chosen_options}
        return simulation.options["newton_iterations"], chosen["newton_iterations"], simulation.error > 0

    assert of(falling(0)) == (2, ("2", "level"), True)
    for scene, options in ((falling(0), {"time_step": 0.005}), (falling(0.005), {}), (falling(0), {"error": ""})):
        assert of(scene, **options) == (1, ("1", "level"), False)
    assert of(falling(0), time_step=0.005, newton_iterations=2) == (2, ("2", "user"), False)
    assert of(falling(0.005), error="1 mm") == (2, ("2", "level"), True)
    scene = falling(0)
    scene.options = {"accuracy": "interactive", "newton_iterations": 3}
    assert cama.Simulation(scene, time_step=0.005).options["newton_iterations"] == 3


def test_free_fall_follows_the_closed_form_of_each_integrator():
    """Below g t^2 / 2: g dt t / 2 by backward Euler; by BDF2, whose first step is one of backward Euler, 3/4 g dt^2 (1
    - 3^-n).
    """
    euler = {"integrator": "backward_euler", "newton_iterations": 1}
    for level, more in (("production", euler), ("production", {}), ("accurate", {})):
        simulation = cama.Simulation(falling(), accuracy=level, **more)
        start, dt = simulation.positions, simulation.time_step
        while simulation.time < 0.1 - 1e-9:
            simulation.step()
        n = simulation.step_count
        error = 9.81 * dt * 0.1 / 2 if more else 0.75 * 9.81 * dt**2 * (1 - 3.0**-n)
        np.testing.assert_allclose(start[:, 2] - 9.81 * 0.1**2 / 2 - simulation.positions[:, 2], error, rtol=1e-6)


def test_every_option_can_be_overridden_and_says_so():
    simulation = cama.Simulation(
        falling(), accuracy="accurate", time_step=1e-3, newton_iterations=2, integrator="backward_euler"
    )
    chosen = {s["name"]: (s["value"], s["origin"]) for s in simulation.chosen_options}
    assert chosen["time_step"] == ("0.001 s", "user") and chosen["newton_iterations"] == ("2", "user")
    assert chosen["integrator"] == ("backward_euler", "user") and chosen["newton_tolerance"][1] == "level"
    assert {s["name"]: s["origin"] for s in cama.Simulation(falling()).chosen_options}["time_step"] == "scene"
    scene = falling()
    scene.options = {"accuracy": "accurate", "tolerance": 1e-5, "newton_iterations": 3}
    chosen = {s["name"]: (s["value"], s["origin"]) for s in cama.Simulation(scene, newton_iterations=2).chosen_options}
    assert (
        chosen["tolerance"] == ("1e-05", "scene")
        and chosen["newton_iterations"] == ("2", "user")
        and chosen["integrator"] == ("bdf2", "level")
    )
    simulation.step()
    report = simulation.report
    assert report["retries"] == 0 and report["newton_iterations"] >= 1 and report["newton_residual"] >= 0
    with pytest.raises(cama.SceneError, match="backward_euler or bdf2"):
        cama.Simulation(falling(), integrator="rk4")
    with pytest.raises(cama.SceneError, match="preview, interactive, production, accurate, reference or paper"):
        cama.Simulation(falling(), accuracy="best")


def test_command_line(tmp_path):
    path = tmp_path / "falling.json"
    path.write_text(falling(frame_time=0.01).to_json())
    result = RUNNER.invoke(
        app,
        [
            "run",
            str(path),
            "--accuracy",
            "accurate",
            "--set",
            "newton_iterations=2",
            "--set",
            "tolerance=1e-5",
            "--frames",
            "2",
            "-o",
            str(tmp_path / "out"),
        ],
        catch_exceptions=False,
    )
    assert result.exit_code == 0, result.output
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["steps"] == 2 * 12 and summary["dt"] == pytest.approx(1 / 1200) and summary["retries"] == 0
    shown = RUNNER.invoke(
        app,
        ["explain", str(path), "--accuracy", "accurate", "--time-step", "0.001", "--set", "commit=false"],
        catch_exceptions=False,
    )
    lines = {line.split()[0]: line for line in shown.output.splitlines() if line.strip()}
    assert "0.001 s" in lines["time_step"] and "user" in lines["time_step"]
    assert "bdf2" in lines["integrator"] and "level accurate" in lines["integrator"]
    assert "false" in lines["commit"] and "user" in lines["commit"]
    for words, expected in (
        (["--set", "tolerance"], "NAME=VALUE"),
        (["--set", "tolerance=much"], "much"),
        (["--set", "tolerence=1"], "tolerence"),
    ):
        failed = RUNNER.invoke(app, ["run", str(path), *words, "-o", str(tmp_path / "no")])
        assert failed.exit_code == 2 and expected in failed.output


@pytest.mark.parametrize("name, bound", [("drape", 1e-3), ("shapes", 1e-3), ("flag", 2e-3)])
def test_a_frame_of_production_has_the_error_it_asks_for(name, bound):
    """Of the converged motion: of the level `reference`, its own error added. One of `preview` has more than one of
    `interactive`, that more than one of `production`, and no more than the level asks for.
    """
    asked = {"preview": 1e-2, "interactive": 4e-3, "production": bound}
    levels = {level: {"accuracy": level} for level in asked}
    triangles, size, errors, uncertainty = frame_error.measure(name, 200, levels, times=(0.25, 0.55))
    assert all(errors[level] + uncertainty < asked[level] for level in asked), (triangles, size, errors)
    assert errors["preview"] > errors["interactive"] > errors["production"], (triangles, size, errors)
