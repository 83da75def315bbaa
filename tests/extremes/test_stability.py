# SPDX-License-Identifier: Apache-2.0
"""The table of torture cases is whole; each small case comes out as expected on cpu and opencl; failures are seen.

Scenes among them are tested in test_extremes.py on the CPU; here they are long.
"""

import csv
import dataclasses
import io
import json
import math
import os
import re
import time
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from typer.testing import CliRunner

import cama
from cama.cli import app
from cama.cli.stability import outcome_table
from cama.torture import judge, meshes, stability, table
from cama.torture.probe import Probe, Wrong
from cama.torture.scene_cases import CASES

OPENCL = next(b for b in cama.backends() if b["name"] == "opencl")["available"]
SLOW = {
    "swinging_slivers",
    "collapsed_to_a_point",
    "same_centroid",
    "thread_counts",
    "out_of_memory",
    "confetti",
    "far_away",
    "slivers",
    "graded_edges",
}


def small(check):
    return check.body is not None and not check.long and check.name not in CASES


def mode(check, backend):
    """The rotation of precisions over the checks that the default suite takes; every one is in the long suite."""
    return check.precisions[table.CHECKS.index(check) % len(check.precisions)] if backend == "cpu" else "mixed"


def runs():
    for check in table.CHECKS:
        for backend in ("cpu", "opencl"):
            for precision in table.PRECISIONS:
                if check.applies(backend, precision):
                    quick = (
                        small(check)
                        and precision == mode(check, backend)
                        and not (check.name in SLOW and backend == "opencl")
                    )
                    yield pytest.param(
                        check,
                        backend,
                        precision,
                        id=f"{check.number}-{check.name}-{backend}-{precision}",
                        marks=[] if quick else [pytest.mark.long],
                    )


@pytest.mark.parametrize("check, backend, precision", list(runs()))
def test_check(check, backend, precision):
    if backend == "opencl" and not OPENCL:
        assert "opencl" not in os.environ.get("CAMA_REQUIRE_BACKENDS", ""), "no OpenCL device"
        pytest.skip("no OpenCL device")
    if check.alone:
        (outcome,) = stability.run([check], [backend], [precision], long=True)
    else:
        outcome = stability.perform(check, backend, precision)
    if outcome.known:
        pytest.xfail(f"{outcome.known}: {outcome.outcome}")
    assert outcome.good, outcome.outcome
    assert outcome.outcome in ("ok", f"ok: {check.error}")


def test_the_table_is_whole():
    assert sorted({c.number for c in table.CHECKS}) == sorted(table.NUMBERS) == list(range(1, 46))
    assert [c.number for c in table.CHECKS] == sorted(c.number for c in table.CHECKS)
    names = [c.name for c in table.CHECKS]
    assert len(set(names)) == len(names) and not any(n.isdigit() for n in names)
    for check in table.CHECKS:
        assert check.expected
        assert (check.body is None) == bool(check.reason), check.name
        assert set(check.backends) <= set(table.BACKENDS) and set(check.precisions) <= set(table.PRECISIONS)
        assert not check.error or issubclass(getattr(cama, check.error), cama.Error)
        assert bool(check.fault) == bool(check.seen_as)


ROOT = Path(__file__).parents[2]


def test_the_reference_page_has_every_check_and_what_is_expected():
    page = (ROOT / "docs" / "reference" / "stability.md").read_text(encoding="utf-8")
    for check in table.CHECKS:
        assert f"`{check.name}` | {stability._plain(check.expected)} |" in page
    for number, about in table.NUMBERS.items():
        assert f"| {number} | {about} |" in page


def test_the_newest_results_have_every_check_and_no_failure_that_is_not_known():
    newest = max((ROOT / "results").glob("stability-*.md"))
    page = newest.read_text(encoding="utf-8")
    for check in table.CHECKS:
        assert f"| {check.number} | `{check.name}` |" in page
    assert "**fails**" not in page.split("| | check |")[1] and " 0 failed otherwise" in page
    assert newest.name in (ROOT / "results" / "README.md").read_text(encoding="utf-8")


def test_every_scene_case_is_in_the_table_or_shipped():
    assert set(CASES) - {c.name for c in table.CHECKS} == {"sphere", "drape"}


def test_selection_by_number_and_name():
    assert {c.name for c in table.select(["4", "at_rest"])} == {
        "degenerate_triangles",
        "duplicate_triangles",
        "at_rest",
    }
    assert table.select() == table.CHECKS
    with pytest.raises(KeyError, match="46"):
        table.select(["46"])


@pytest.mark.parametrize("width", [80, 110])
def test_what_came_of_a_run_is_printed_on_narrow_terminals_too(width):
    outcome = stability.Outcome(
        21,
        "restart_in_contact_block_jacobi",
        "opencl",
        "single",
        "production",
        outcome="ok: CollisionError",
        good=True,
        steps=100000,
        strain=0.123,
    )
    out = io.StringIO()
    Console(file=out, width=width).print(outcome_table([outcome], width))
    words = out.getvalue().split()
    assert {"restart_in_contact_block_jacobi", "opencl", "single", "ok:", "CollisionError"} <= set(
        words
    ) and "…" not in out.getvalue()
    assert ("100000" in words) == (width >= 110)


# Failures are seen.


def check_of(name, **changes):
    return dataclasses.replace(table.select([name])[0], **changes)


def test_another_error_than_the_expected_fails():
    def refused(p):
        p.simulation(cama.Scene())

    good = stability.perform(check_of("empty_scene", body=refused, error="SceneError", words="cloth"))
    assert good.good and good.outcome == "ok: SceneError"
    for changes in (dict(error="MeshError"), dict(error="SceneError", words="nowhere to be read"), dict(error="")):
        outcome = stability.perform(check_of("empty_scene", body=refused, **changes))
        assert not outcome.good and not outcome.excused and "SceneError" in outcome.outcome
    silent = stability.perform(check_of("single_triangle", error="SolverError"))
    assert not silent.good and "nothing was thrown" in silent.outcome


def test_an_error_without_a_name_fails():
    def broken(p):
        raise ZeroDivisionError("planted")

    outcome = stability.perform(check_of("empty_scene", body=broken))
    assert not outcome.good and "ZeroDivisionError" in outcome.outcome


def test_a_known_fault_excuses_only_its_own_outcome():
    def broken(p):
        raise Wrong("step 3: intersections: 1 by audit")

    for name in ("teleport", "swinging_slivers", "scale_error"):
        outcome = stability.perform(check_of(name, body=broken))
        assert not outcome.good and outcome.known == "" and not outcome.excused

    def moves(p):
        raise Wrong("not bitwise still: moved by 1e-14 m in 1000 steps")

    still = check_of("at_rest_any_mesh", body=moves)
    assert (
        stability.perform(still, precision="double").excused
        and not stability.perform(still, precision="single").excused
    )


@pytest.mark.parametrize("array", ["positions", "velocities"])
def test_nan_in_an_array_is_seen(array, monkeypatch):
    scene, _ = meshes.cloth_scene([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    probe = Probe()
    simulation = probe.run(scene, 1)
    bad = np.zeros((3, 3))
    bad[1, 2] = math.nan
    monkeypatch.setattr(cama.Simulation, array, property(lambda s: bad))
    with pytest.raises(Wrong, match=f"step 1: not finite: {array}"):
        probe.watch(simulation)


@pytest.mark.parametrize(
    "name",
    ["moebius_strip", "restart", "lists_from_nothing", "huge_friction", "same_as_cpu", "needle_shot", "rotation"],
)
def test_every_step_is_looked_at(name, monkeypatch):
    steps, looks = [], []
    step, finite = cama.Simulation.step, judge.finite
    monkeypatch.setattr(cama.Simulation, "step", lambda s, n=1: steps.extend([s] * n) or step(s, n))
    monkeypatch.setattr(judge, "finite", lambda s: looks.append(s) or finite(s))
    outcome = stability.perform(table.select([name])[0])
    assert outcome.good, outcome.outcome
    assert steps == looks and len(steps) == outcome.steps > 0


@pytest.mark.parametrize("field, value", [("residual", math.nan), ("lost_motion", math.inf)])
def test_nan_in_the_report_is_seen(field, value, monkeypatch):
    scene, _ = meshes.cloth_scene([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    probe = Probe()
    simulation = probe.run(scene, 1)
    report = dict(simulation.report, **{field: value})
    monkeypatch.setattr(cama.Simulation, "report", property(lambda s: report))
    assert judge.finite(simulation) == [f"report['{field}']"]


def test_an_intersection_is_seen_by_both_judges():
    scene = cama.Scene(gravity=(0, 0, 0))
    for turn in ([0, 1, 2], [2, 0, 1]):
        vertices = np.array([[-1, -1, 0.01], [1, -0.9, -0.02], [0, 1.1, 0.03]])[:, turn]
        scene.add_cloth(vertices, [[0, 1, 2]])
    with pytest.raises(Wrong, match="by audit, . by ipctk"):
        Probe().run(scene, 1, intersections="exempt")


def test_free_fall_of_another_gravity_is_seen(monkeypatch):
    monkeypatch.setattr(meshes, "GRAVITY", 9.8)
    outcome = stability.perform(table.select(["single_triangle"])[0])
    assert not outcome.good and re.search("fall against (backward Euler|BDF2)", outcome.outcome)


def test_the_exact_audit_judges_alone_without_ipctk(monkeypatch):
    monkeypatch.setattr(judge, "ipctk", None)
    outcome = stability.perform(table.select(["coplanar"])[0])
    assert outcome.good and outcome.steps == 40


# Processes.


def hang(p):
    time.sleep(60)


def die(p):
    os._exit(7)


def test_what_hangs_or_dies_is_an_outcome(monkeypatch):
    checks = [check_of("empty_scene", body=hang), check_of("single_triangle", body=die), table.select(["indices"])[0]]
    monkeypatch.setattr(table, "CHECKS", tuple(checks))
    monkeypatch.setattr(stability, "_context", lambda: stability.multiprocessing.get_context("fork"))
    begin = time.perf_counter()
    hung, died, good = stability.run(checks, precisions=("double",), limit=3.0)
    assert time.perf_counter() - begin < 30
    assert not hung.good and hung.outcome == "did not end within 3 s"
    assert not died.good and died.outcome == "ended with code 7"
    assert good.good


# The command.


def call(*words):
    return CliRunner().invoke(app, ["stability", *map(str, words)], env={"COLUMNS": "200"})


def test_command_writes_what_was_seen(tmp_path):
    result = call(
        2,
        "single_triangle",
        "at_rest_any_mesh",
        "twenty_million",
        "--backend",
        "cpu",
        "--precision",
        "double",
        "--precision",
        "single",
        "-o",
        tmp_path,
        "--page",
        tmp_path / "page.md",
    )
    assert result.exit_code == 0, result.output
    with open(tmp_path / "stability.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == list(stability.COLUMNS)
    assert [(r["check"], r["precision"]) for r in rows] == [
        (n, p)
        for p in ("double", "single")
        for n in ("single_triangle", "empty_scene", "no_triangles", "at_rest_any_mesh")
    ]
    described = json.loads((tmp_path / "stability.json").read_text())
    assert [c["outcome"] for c in described["checks"]][:3] == ["ok"] * 3 and described["checks"][0]["steps"] == 100
    assert described["not_run"] == [
        {"number": 45, "check": "twenty_million", "reason": table.select(["twenty_million"])[0].reason}
    ]
    page = (tmp_path / "page.md").read_text()
    assert page == (tmp_path / "stability.md").read_text()
    assert "| 1 | `single_triangle` | ok | ok | 100 | 0 |" in page and "| 45 | `twenty_million` | not run |" in page


def test_command_shows_results_of_another_machine(tmp_path):
    there = [
        stability.Outcome(1, "single_triangle", "cuda", "double", "production", "ok", True, steps=100),
        stability.Outcome(1, "single_triangle", "cpu", "double", "production", "moved", steps=100),
    ]
    stability.write(there, tmp_path / "there")
    assert stability.read(tmp_path / "there" / "stability.json") == there
    result = call(
        "single_triangle",
        "--backend",
        "cpu",
        "--precision",
        "double",
        "-o",
        tmp_path / "here",
        "--join",
        tmp_path / "there" / "stability.json",
    )
    assert result.exit_code == 0, result.output
    page = (tmp_path / "here" / "stability.md").read_text()
    assert (
        "| cpu double | cuda double |" in page and "| 1 | `single_triangle` | ok | ok | 100 | 0 |" in page
    )  # what was run here counts


def test_joined_results_count_once_and_have_the_faults_of_the_table(tmp_path):
    """Of two runs of the same the last counts; a fault that the table of then knew of, or did not, is that of now."""
    fault = table.select(["at_rest_any_mesh"])[0]
    first = [
        stability.Outcome(1, "single_triangle", "cuda", "double", "production", "did not end within 9 s"),
        stability.Outcome(29, "at_rest_any_mesh", "cuda", "double", "production", fault.seen_as),
        stability.Outcome(29, "at_rest_any_mesh", "cuda", "single", "production", fault.seen_as, known="old"),
    ]
    last = [stability.Outcome(1, "single_triangle", "cuda", "double", "production", "ok", True, steps=100)]
    for name, outcomes in (("first", first), ("last", last)):
        stability.write(outcomes, tmp_path / name)
    assert [o.known for o in stability.read(tmp_path / "first" / "stability.json")] == ["", fault.fault, ""]
    joins = [word for name in ("first", "last") for word in ("--join", tmp_path / name / "stability.json")]
    call("single_triangle", "at_rest_any_mesh", "--backend", "cpu", "--precision", "single", "-o", tmp_path, *joins)
    page = (tmp_path / "stability.md").read_text()
    assert "3 of 5 as expected, 1 known to fail, 0 cut off, 1 failed otherwise" in page


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        '{"checks": [{}]}',
        '{"checks": [7]}',
        "\xff",
        '{"checks": [{"number": "1", "check": "x", "backend": "cpu", "precision": "double", "accuracy": "paper"}]}',
    ],
)
def test_results_that_are_none_are_refused(tmp_path, text):
    (tmp_path / "stability.json").write_text(text, encoding="latin-1")
    with pytest.raises(cama.FileError, match="stability.json: not the results"):
        stability.read(tmp_path / "stability.json")
    assert call("single_triangle", "--join", tmp_path / "stability.json", "-o", tmp_path / "out").exit_code == 2
    assert not (tmp_path / "out").exists()


def test_command_fails_where_a_check_does(tmp_path, monkeypatch):
    monkeypatch.setattr(
        stability,
        "run",
        lambda checks, *rest: [stability.Outcome(1, "single_triangle", "cpu", "double", "production", "no")],
    )
    assert call("single_triangle", "--backend", "cpu", "--precision", "double", "-o", tmp_path).exit_code == 1
    assert "**fails**" in (tmp_path / "stability.md").read_text()


def test_command_refuses_what_it_does_not_know(tmp_path):
    assert call("46").exit_code == 2
    assert call("1", "--backend", "abacus").exit_code == 2
    assert call("1", "--accuracy", "perfect").exit_code == 2
    listed = call("--list")
    assert listed.exit_code == 0 and "twenty_million" in listed.output and "60 GB" in listed.output
