# SPDX-License-Identifier: Apache-2.0
"""Tuning: budgets with known answers, the judge, scene files that are written."""

import json

import numpy as np
import pytest

import cama
from cama.measuring import tradeoff, tune
from conftest import EULER, FALL, grid
from test_tradeoff import ONE, G, call, point


def test_lengths_and_times():
    assert (
        tune.parse_error("1mm") == ("m", 1e-3)
        and tune.parse_error("0.5 cm") == ("m", 5e-3)
        and tune.parse_error("1%") == ("edges", 0.01)
    )
    assert tune.parse_time("16ms") == 0.016 and tune.parse_time("2 s") == 2.0
    for text in ("1", "mm", "-1mm", "0%", "1lb", "", "nanmm", "1e999mm"):
        with pytest.raises(cama.ArrayError):
            tune.parse_error(text)
    for text in ("16", "0ms", "ms"):
        with pytest.raises(cama.ArrayError):
            tune.parse_time(text)


def test_the_choice_among_points_made_by_hand():
    points = [
        point(10, 0.5),
        point(20, 0.2),
        point(30, 0.1),
        point(5, 0.01, failed="no"),
        point(6, 0.01, intersections=2),
        point(None, 0.01),
    ]

    def best(safety=1.0, edge=0.01, **budget):
        return tune.Budget(**budget).best(points, edge, safety)

    assert best(error=2e-3)["ms_per_second"] == 20 and best(edges=0.2)["ms_per_second"] == 20
    assert best(edges=0.2, safety=1.5)["ms_per_second"] == 30 and best(edges=0.2, safety=3) is None
    assert best(edges=0.4, measure="max")["ms_per_second"] == 30
    assert (
        best(frame=20.5e-3 / 60)["ms_per_second"] == 20 and best(frame=1e-6) is None
    )  # the most accurate that is fast enough
    assert best(edges=0.6, frame=1.0)["ms_per_second"] == 10


def test_tune_finds_the_cheapest_time_step_and_run_uses_it(fall, tmp_path):
    # g dt w / 2 with w = 0.05 s: 1/80 s gives 3.07 mm, 1/160 1.53 mm, 1/320 0.77 mm. With a factor of 1.5 to spare, 2.5
    # mm needs 1/160.
    scene = tmp_path / "tuned" / "scene.json"
    result = call(
        "tune",
        fall,
        "--error",
        "2.5mm",
        "--vary",
        "time_step=1/80,1/160,1/320",
        "--vary",
        "integrator=backward_euler",
        "--vary",
        "newton_iterations=1",
        "--windows",
        3,
        "--reference-step",
        0.05 / 64,
        "--results",
        tmp_path / "points",
        "-o",
        scene,
        *ONE,
    )
    assert result.exit_code == 0, result.output
    data = json.loads(scene.read_text())
    assert data["time_step"] in (1 / 160, 1 / 320) and "judge" in data["$tuned"]
    assert set(data["options"]) <= {"time_step", "integrator", "newton_iterations"}
    tuned = cama.Scene.load(scene)
    assert tuned.frames * tuned.frame_time == pytest.approx(40 * 0.005, rel=0.05)
    assert call("run", scene, "--frames", 2, "-o", tmp_path / "run").exit_code == 0
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["dt"] == data["time_step"]


def test_the_judge_has_other_states_and_a_finer_reference(tmp_path):
    scene = cama.Scene.parse(FALL)
    tuned = tune.tune(
        scene,
        tmp_path,
        error=2.5e-3,
        plan=tradeoff.product({"time_step": [1 / 80, 1 / 160], "tolerance": [1e-2], **EULER}),
        windows=3,
        reference_step=0.05 / 64,
        setup=tradeoff.Setup(threads=1, jobs=0),
    )
    assert tuned.settings["time_step"] == 1 / 160 and tuned.settings["tolerance"] == 1e-2 and tuned.rounds == 1
    seen, judged = tuned.search.reference, tuned.judge.reference
    assert (
        not set(np.round(seen.starts, 9)) & set(np.round(judged.starts, 9)) and judged.time_step == seen.time_step / 2
    )
    assert tuned.judged["restart_rms"] == pytest.approx(G / 160 * 0.05 / 2, rel=1e-3)
    with_options = tuned.scene()
    assert with_options.time_step == 1 / 160 and with_options.options["tolerance"] == 1e-2
    assert cama.Simulation(with_options).options["tolerance"] == 1e-2


def test_budgets_that_cannot_be_kept_say_what_can(tmp_path, falling):
    arguments = dict(
        plan=tradeoff.product({"time_step": [1 / 80], **EULER}),
        windows=1,
        reference_step=0.05 / 64,
        setup=tradeoff.Setup(threads=1, jobs=0),
    )
    with pytest.raises(tune.BudgetError, match=r"most accurate: dt 1/80 s, .*\(3.07 mm rms"):
        tune.tune(cama.Scene.parse(FALL), tmp_path, error=1e-6, **arguments)
    with pytest.raises(tune.BudgetError, match="reference may be off"):
        tune.tune(falling, tmp_path, error=1e-7, **arguments)
    with pytest.raises(tune.BudgetError, match="fastest"):
        tune.tune(cama.Scene.parse(FALL), tmp_path, frame=1e-12, **arguments)
    for bad in (
        dict(),
        dict(error=1e-3, edges=0.1),
        dict(error=-1.0),
        dict(error=1e-3, measure="mean"),
        dict(error=1e-3, safety=0.5),
    ):
        with pytest.raises(cama.ArrayError):
            tune.tune(cama.Scene.parse(FALL), tmp_path, **{**arguments, **bad})


def test_a_judge_that_refuses_makes_the_search_stricter(tmp_path, monkeypatch):
    # The judge is made to see nearly twice the error: the first choice fails, the next has a larger factor to spare.
    # Costs are made to go with steps.
    real = tune.tradeoff

    def unfair(scene, output, plan, first=1, **rest):
        result = real(scene, output, plan, first=first, **rest)
        for p in result.points:
            p["ms_per_second"] = 1 / p["dt"]
            p["restart_rms_edges"] *= 1.9 if first > 1 else 1.0
        return result

    monkeypatch.setattr(tune, "tradeoff", unfair)
    tuned = tune.tune(
        cama.Scene.parse(FALL),
        tmp_path,
        error=2.5e-3,
        plan=tradeoff.product({"time_step": [1 / 160, 1 / 320], **EULER}),
        windows=1,
        safety=1.5,
        reference_step=0.05 / 64,
        setup=tradeoff.Setup(threads=1, jobs=0),
    )
    assert tuned.rounds == 2 and tuned.settings["time_step"] == 1 / 320 and tuned.safety == 2.25


def test_written_scenes_keep_their_files_and_lose_only_comments(tmp_path):
    folder, other = tmp_path / "here", tmp_path / "there"
    folder.mkdir()
    vertices, faces = grid(2)
    (folder / "sheet.obj").write_text(
        "".join(f"v {x} {y} {z}\n" for x, y, z in vertices)
        + "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in faces)
    )
    (folder / "scene.json").write_text(
        '{ // a remark\n "name": "sheet.obj // no remark", /* more */ "cloth": [{"file": "sheet.obj", '
        '"material": "cotton"}],\n'
        ' "time_step": 0.01, "frame_time": 0.04, "frames": 50}'
    )
    settings = {"accuracy": "production", "tolerance": 0.1, "time_step": 0.005}
    for path in (folder / "tuned.json", other / "scene.json"):
        tune.write_scene(folder, settings, path, "as asked")
        scene = cama.Scene.load(path)
        assert scene.triangle_count == 8 and scene.name == "sheet.obj // no remark"
        assert {**scene.options, "time_step": 0.005} == {
            "accuracy": "production",
            "tolerance": 0.1,
            "time_step": 0.005,
        } and scene.time_step == 0.005
        assert (scene.frame_time, scene.frames, scene.seconds_per_frame) == (0.04, 50, 0.04)
    assert json.loads((folder / "tuned.json").read_text())["cloth"][0]["file"] == "sheet.obj"
    with pytest.raises(cama.SceneError, match="pinch"):
        tune.write_scene(folder, {"pinch": "release"}, other / "bad.json")
