# SPDX-License-Identifier: Apache-2.0
"""Trade-offs and executors: fronts made by hand, errors that are known, runs that are killed, a real Ray."""

import csv
import html.parser
import importlib.util
import io
import json
import math
import multiprocessing
import os
import re
import secrets
import signal
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console
from typer.testing import CliRunner

import cama
from cama.cli import app
from cama.cli.tradeoff import front_table
from cama.measuring import executor, report, tradeoff
from cama.measuring import grid as plans
from cama.processes import submit, terminate
from conftest import EULER, FALL

G, ROOT = 9.81, Path(__file__).parents[2]
ONE = ["--threads", 1, "--error-jobs", 1]


def call(*words):
    return CliRunner().invoke(app, [str(w) for w in words], catch_exceptions=False)


def point(cost, error, **other):
    return dict(
        {
            "failed": None,
            "intersections": 0,
            "ms_per_second": cost,
            "restart_rms_edges": error,
            "restart_max_edges": 3 * error,
            "label": f"{cost}",
        },
        **other,
    )


def test_results_of_another_machine_are_shown_beside_these(fall, tmp_path):
    words = ["tradeoff", fall, "--backend", "cpu", "--vary", "time_step=1/100,1/200", "--windows", 2, *ONE]
    assert call(*words, "-o", tmp_path / "here", "--no-plots").exit_code == 0
    there = json.loads((tmp_path / "here" / "tradeoff.json").read_text())
    scene = there["scenes"][0]
    for p in scene["points"]:
        p.update(backend="cuda", ms_per_second=p["ms_per_second"] / 10)
    scene["devices"] = {"cuda": "a card"}
    scene["fronts"] = {"cuda": [0]}
    (tmp_path / "card.json").write_text(json.dumps(there))
    joined = call(*words, "-o", tmp_path / "here", "--join", tmp_path / "card.json")
    assert joined.exit_code == 0, joined.output
    both = json.loads((tmp_path / "here" / "tradeoff.json").read_text())["scenes"][0]
    assert [p["backend"] for p in both["points"]] == ["cpu"] * 2 + ["cuda"] * 2 and set(both["fronts"]) == {
        "cpu",
        "cuda",
    }
    assert both["devices"]["cuda"] == "a card" and (tmp_path / "here" / "tradeoff.csv").read_text().count(",cuda,") == 2
    for change, text in (
        ({"window": 0.1}, "another window"),
        ({"scene": "other"}, "has none of fall"),
        ({"points": [3]}, "not a tradeoff.json"),
    ):
        (tmp_path / "bad.json").write_text(json.dumps({"scenes": [{**scene, **change}]}))
        bad = call(*words, "-o", tmp_path / "here", "--join", tmp_path / "bad.json", "--no-plots")
        assert bad.exit_code == 2 and text in " ".join((bad.output + bad.stderr).split())
    assert call(*words, "-o", tmp_path / "here", "--join", tmp_path / "none.json", "--no-plots").exit_code == 2


# Fronts and grids


@pytest.mark.parametrize(
    "points, front",
    [
        ([], []),
        ([(1, 1)], [0]),
        ([(1, 3), (2, 2), (3, 1)], [0, 1, 2]),
        ([(1, 3), (2, 4), (3, 1)], [0, 2]),
        ([(1, 1), (2, 2), (3, 3)], [0]),
        ([(2, 1), (1, 1)], [1]),
        ([(1, 2), (1, 1)], [1]),
        ([(1, 1), (1, 1)], [0]),
        ([(3, 1), (2, 2), (1, 3)], [2, 1, 0]),
        ([(1, math.nan), (math.inf, 1), (2, None), (None, 2), (5, 5)], [4]),
    ],
)
def test_pareto_fronts_by_hand(points, front):
    assert tradeoff.pareto(points) == front


def test_pareto_is_what_brute_force_finds():
    points = [tuple(p) for p in np.random.default_rng(4).integers(0, 12, (80, 2)).tolist()]

    def dominated(p):
        return any(q[0] <= p[0] and q[1] <= p[1] and q != p for q in points)

    found = tradeoff.pareto(points)
    assert {points[i] for i in found} == {p for p in points if not dominated(p)}
    assert [points[i][0] for i in found] == sorted(points[i][0] for i in found)


def test_options_that_vary_are_those_of_the_installed_version():
    known = plans.variable_options()
    assert {"tolerance", "precision", "preconditioner", "time_step", "resolution", "accuracy"} <= set(known)
    assert not {"backend", "threads", "audit", "pinch"} & set(known)
    assert {"production", "paper"} <= set(plans.levels())
    assert plans.parse_values("time_step=1/60, 1/200") == ("time_step", [1 / 60, 1 / 200])
    assert plans.parse_values("commit=true,false") == ("commit", [True, False])
    assert plans.parse_values("max_iterations=50") == ("max_iterations", [50])
    assert len(plans.product({"time_step": [0.01, 0.02], "tolerance": [0.1], "precision": ["double", "mixed"]})) == 4
    plan = plans.default_plan(cama.Scene.parse(FALL), 0.05)
    assert {"accuracy": "paper"} in plan and len(plan) == len(plans.unique(plan)) > 10
    plans.check_plan(plan, 0.05)


@pytest.mark.parametrize(
    "text, words",
    [
        ("tollerance=1", "tollerance.*tolerance"),
        ("tolerance", "name=value"),
        ("tolerance=", "name=value"),
        ("tolerance=-1", "positive"),
        ("tolerance=small", "positive"),
        ("max_iterations=1.5", "int"),
        ("commit=maybe", "bool"),
        ("time_step=1/0", "positive"),
        ("backend=cpu", "backend"),
    ],
)
def test_bad_options_are_named(text, words):
    with pytest.raises(cama.SceneError, match=words):
        plans.parse_values(text)


@pytest.mark.parametrize(
    "settings, words",
    [
        ({"time_step": 0.03}, "whole number of steps"),
        ({"precision": "half"}, "half"),
        ({"accuracy": "best"}, "best"),
        ({"tolerance": 2.0}, "tolerance"),
        ({"resolution": 0}, "resolution"),
        ({"preconditioner": "magic"}, "magic"),
    ],
)
def test_settings_that_cannot_be_are_refused_before_anything_runs(tmp_path, settings, words):
    with pytest.raises(cama.Error, match=words):
        tradeoff.tradeoff(cama.Scene.parse(FALL), tmp_path / "out", [settings], windows=1)
    assert not list((tmp_path / "out").glob("points/*"))


# Executors


def square(task, shared):
    if task == "die":
        os._exit(3)
    if task == "raise":
        raise ValueError("as asked")
    return task * task + shared


@pytest.mark.parametrize("jobs", [0, 1, 2])
def test_a_pool_gives_every_result_once(jobs):
    assert dict(executor.Local(jobs).run(square, list(range(5)), 100)) == {i: i * i + 100 for i in range(5)}


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_task_that_dies_takes_no_other_with_it(jobs):
    found = dict(executor.Local(jobs).run(square, [1, "die", 2, "raise", 3], 0))
    assert {k: v for k, v in found.items() if k in (0, 2, 4)} == {0: 1, 2: 4, 4: 9}
    assert "ProcessDied" in found[1].text and found[3].text == "ValueError: as asked"


def broken(pool, seconds=20):
    """Kills the processes of a pool and waits until it has closed its pipes."""
    for process in pool._processes.values():
        process.kill()
    end = time.monotonic() + seconds
    while not pool._call_queue._reader.closed and time.monotonic() < end:
        time.sleep(0.01)


def test_a_process_that_ends_while_another_starts_breaks_the_pool(monkeypatch):
    pool = ProcessPoolExecutor(2, multiprocessing.get_context("spawn"))
    submit(pool, math.sqrt, 4.0).result()
    spawn = pool._spawn_process

    def late():
        broken(pool, 3)  # later versions than 3.11 wait for this start before they close
        spawn()

    monkeypatch.setattr(pool, "_spawn_process", late)
    with pytest.raises(BrokenProcessPool):
        for _ in range(100):  # the first goes to the process that has nothing to do
            submit(pool, time.sleep, 60.0)
            time.sleep(0.1)
    terminate(pool)
    pool.shutdown(wait=True, cancel_futures=True)


def test_another_error_of_a_start_is_not_hidden(monkeypatch):
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        monkeypatch.setattr(pool, "_spawn_process", lambda: os.open("/no such folder/file", os.O_RDONLY))
        with pytest.raises(FileNotFoundError):
            submit(pool, math.sqrt, 4.0)


def test_a_process_that_ends_between_tasks_costs_no_result(monkeypatch):
    results = executor.Local(1).run(square, [1, 2, 3], 0)
    pools, started = [], ProcessPoolExecutor.submit

    def seen(pool, *task):
        pools.append(pool)
        return started(pool, *task)

    monkeypatch.setattr(ProcessPoolExecutor, "submit", seen)
    found = dict([next(results)])
    broken(pools[0])
    found.update(results)
    assert found == {0: 1, 1: 4, 2: 9} and len(set(pools)) == 2


@pytest.mark.skipif(sys.platform == "win32", reason="no process groups")
@pytest.mark.parametrize("after", [0.0, 0.1, 0.3])
def test_ctrl_c_while_processes_start_is_the_parents_alone(after, tmp_path):
    script = tmp_path / "starts.py"  # a child imports this file again, which takes a while
    script.write_text(
        "import math, time\nfrom cama.measuring import executor\nif __name__ == '__main__':\n    print('go', "
        "flush=True)\n"
        "    dict(executor.Local(2).run(math.copysign, [1.0] * 4, 1.0))\nelse:\n    time.sleep(0.6)\n"
    )
    process = subprocess.Popen(
        [sys.executable, script], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    assert process.stdout.readline() == "go\n"
    time.sleep(after)
    os.killpg(process.pid, signal.SIGINT)
    said = process.communicate(timeout=60)[1]
    assert process.returncode != 0 and said.count("Traceback") <= 1 and "spawn_main" not in said


def test_an_abandoned_pool_ends_its_processes():
    run = executor.Local(1).run(square, [1, 2, 3], 0)
    assert next(run) == (0, 1)
    run.close()  # would wait for ever, were a process left


@pytest.fixture(scope="module")
def ray_address(tmp_path_factory):
    """A Ray that this test starts, in a process of its own."""
    if importlib.util.find_spec("ray") is None:
        pytest.skip("Ray is not installed: pip install ray")
    script = (
        "import ray, sys\ncontext = ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False, "
        "logging_level='error')\n"
        "print(context.address_info['gcs_address'], flush=True)\nsys.stdin.read()\n"
    )
    patch = pytest.MonkeyPatch()
    patch.setenv(
        "RAY_AUTH_MODE", "token"
    )  # a token of this test's own, set before Ray is imported: Ray of late asks for one
    patch.setenv("RAY_AUTH_TOKEN", secrets.token_hex(32))
    environment = dict(
        os.environ, RAY_USAGE_STATS_ENABLED="0", PYTHONPATH=os.pathsep.join([str(Path(__file__).parent), *sys.path])
    )
    head = subprocess.Popen(
        [sys.executable, "-c", script],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env=environment,
    )
    address = head.stdout.readline().strip().splitlines()[-1:]
    if not address:
        head.kill()
        patch.undo()
        pytest.skip("Ray does not start on this machine")
    yield address[0]
    head.stdin.close()
    head.wait(30)
    patch.undo()


def test_a_ray_cluster_gives_the_same_results(ray_address, tmp_path):
    pool = executor.make(ray_address, gpu=True)
    try:
        assert pool.gpus == 0 and pool.jobs == 2
        found = dict(pool.run(square, [1, 2, "raise", 3], 10))
        assert {k: v for k, v in found.items() if k != 2} == {0: 11, 1: 14, 3: 19} and found[
            2
        ].text == "ValueError: as asked"
        assert "died" in dict(pool.run(square, ["die"], 0))[0].text.lower()
    finally:
        pool.close()
    scene, plan = cama.Scene.parse(FALL), [{"time_step": 0.01}, {"time_step": 0.005}]
    there = tradeoff.tradeoff(
        scene,
        tmp_path / "ray",
        plan,
        windows=2,
        reference_step=0.05 / 16,
        setup=tradeoff.Setup(threads=1, cluster=ray_address),
    )
    here = tradeoff.tradeoff(
        scene, tmp_path / "here", plan, windows=2, reference_step=0.05 / 16, setup=tradeoff.Setup(threads=1, jobs=0)
    )
    for a, b in zip(there.points, here.points):
        assert a["restart_rms"] == b["restart_rms"] and a["state_hash"] == b["state_hash"] and not a["failed"]


def test_no_cluster_is_a_named_error(monkeypatch):
    pytest.importorskip("ray", reason="Ray is not installed: pip install ray")
    with pytest.raises(cama.BackendError, match="127.0.0.1:1"):
        executor.make("127.0.0.1:1")
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(cama.BackendError, match="pip install ray"):
        executor.make("auto")


# Trade-offs


def test_the_error_of_a_free_fall_is_the_known_one(tmp_path):
    plan = tradeoff.product({"time_step": [0.025, 0.01, 0.005], "precision": ["double", "mixed", "single"], **EULER})
    result = tradeoff.tradeoff(
        cama.Scene.parse(FALL),
        tmp_path,
        plan,
        windows=3,
        reference_step=0.05 / 64,
        setup=tradeoff.Setup(threads=1, jobs=0, warm_up=1),
    )
    for p in result.points:
        dt = p["settings"]["time_step"]
        assert not p["failed"] and p["dt"] == pytest.approx(dt, rel=1e-9)
        assert p["restart_rms"] == pytest.approx(G * dt * 0.05 / 2, rel=1e-4)
        assert p["restart_max_edges"] == pytest.approx(p["restart_rms_edges"], rel=1e-4)
        # At the last start, 0.15 s: from the start on, g dt t / 2 below the exact fall; the reference's own run has its
        # step's error.
        assert p["surface_mean"] == pytest.approx(
            G * dt * 0.15 / 2, abs=1.01 * G * result.reference.time_step * 0.15 / 2
        )
        assert p["hausdorff"] == pytest.approx(p["surface_mean"], rel=1e-5)
        mass = result.reference.masses.sum()
        assert p["energy_drift"] == pytest.approx(-0.5 * mass * G**2 * dt, rel=1e-3)
        assert (
            p["nonlinear_residual"] < 1e-3
            and p["intersections"] == 0
            and p["strain_max"] < 1e-5
            and p["lost_motion"] == 0
        )
        assert p["ms_per_second"] == pytest.approx(p["ms_per_step"] / dt) and p["ms_per_step"] > 0
    assert result.facts["converged"] and result.facts["uncertainty_edges"] < 1e-6
    front = [result.points[i] for i in result.fronts["cpu"]]
    errors = [p["restart_rms_edges"] for p in front]
    assert errors == sorted(errors, reverse=True) and len(front) >= 1


def test_settings_that_intersect_are_on_no_front():
    points = [
        dict(point(1, 0.1, intersections=3), backend="cpu"),
        dict(point(2, 0.2), backend="cpu"),
        dict(point(3, 0.1), backend="cpu"),
    ]
    assert tradeoff.Tradeoff("", 0, points, {}, None, {}).front("cpu") == [1, 2]


def test_coarser_meshes_are_compared_by_surface(tmp_path):
    path = tmp_path / "scene.json"
    path.write_text(
        json.dumps(dict(FALL, cloth=[{"name": "sheet", "grid": {"size": [0.3, 0.3]}, "material": "cotton"}]))
    )
    result = tradeoff.tradeoff(
        str(path),
        tmp_path,
        tradeoff.product({"resolution": [16, 64]}),
        windows=1,
        reference_step=0.05 / 16,
        setup=tradeoff.Setup(threads=1, jobs=0),
    )
    coarse, fine = result.points
    assert coarse["triangles"] < fine["triangles"] == result.triangles
    assert coarse["restart_rms"] is None and fine["restart_rms"] > 0
    assert coarse["surface_mean"] == pytest.approx(fine["surface_mean"], rel=1e-6) and coarse["strain_error"] is None
    with pytest.raises(cama.ArrayError, match="resolution"):
        tradeoff.tradeoff(cama.Scene.parse(FALL), tmp_path, [{"resolution": 9}], windows=1)


def test_what_fails_is_a_point_that_says_why(tmp_path):
    result = tradeoff.tradeoff(
        cama.Scene.parse(FALL),
        tmp_path,
        [{"time_step": 0.005}],
        windows=4,
        reference_step=0.05 / 16,
        setup=tradeoff.Setup(threads=1, jobs=0, limit=1e-9),
    )
    assert "limit" in result.points[0]["failed"] and result.fronts == {"cpu": []}
    report.write([result], tmp_path / "report")
    page = (tmp_path / "report" / "index.html").read_text()
    assert "limit" in page
    assert not [word for word in ("Newton ", "libuipc", "ppf", "ARCSim", "others", "K40") if word in page]
    assert report.figure(result).axes[5].get_title() in ("", "times, triangles")


def test_the_memory_tells_scenes_and_settings_apart(tmp_path):
    setup, seen = tradeoff.Setup(threads=1, jobs=0), []

    def run(scene, plan):
        seen.clear()
        tradeoff.tradeoff(
            scene,
            tmp_path,
            plan,
            windows=1,
            reference_step=0.05 / 16,
            setup=setup,
            progress=lambda done, of, words: seen.append(words),
        )
        return [w for w in seen if "," in w or w == "reference"]

    scene = cama.Scene.parse(FALL)
    assert len(run(scene, [{"time_step": 0.01}])) == 3  # reference, error, time
    assert len(run(scene, [{"time_step": 0.01}])) == 0
    assert len(run(scene, [{"time_step": 0.005}])) == 2
    scene.gravity = (0, 0, -1)
    assert len(run(scene, [{"time_step": 0.01}])) == 3


def test_a_killed_run_goes_on_where_it_was(fall, tmp_path):
    out = tmp_path / "out"
    command = [
        sys.executable,
        "-m",
        "cama",
        "tradeoff",
        fall,
        "--vary",
        "time_step=1/20,1/40,1/60,1/80,1/100,1/120,1/140,1/160",
        "--vary",
        "integrator=backward_euler",
        "--vary",
        "newton_iterations=1",
        "--window",
        "0.05",
        "--windows",
        "40",
        "--reference-step",
        "0.003125",
        "-o",
        out,
        "--no-plots",
        *ONE,
    ]
    process = subprocess.Popen(
        [str(w) for w in command], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )

    def finished():
        return {p: p.stat().st_mtime_ns for p in (out / "points").glob("*.json")} if out.exists() else {}

    end = time.time() + 120
    while len(finished()) < 3 and time.time() < end:
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    process.wait()
    before = finished()
    assert 3 <= len(before) < 16
    done = subprocess.run([str(w) for w in command], capture_output=True, text=True, timeout=200, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    after = finished()
    assert len(after) == 16 and all(after[p] == t for p, t in before.items())
    assert not list((out / "points").glob("*.partial"))
    points = json.loads((out / "tradeoff.json").read_text())["scenes"][0]["points"]
    assert [p["settings"]["time_step"] for p in points] == [1 / n for n in (20, 40, 60, 80, 100, 120, 140, 160)]
    for p in points:
        assert p["restart_rms"] == pytest.approx(G * p["settings"]["time_step"] * 0.05 / 2, rel=1e-3)


def no_constant(word):
    raise AssertionError(f"{word} in JSON")


class Page(html.parser.HTMLParser):
    """Counts of tags, and everything that would be fetched."""

    VOID = {"meta", "br", "img", "path", "use"}

    def __init__(self, text):
        super().__init__()
        self.tags, self.fetched, self._open, self.unclosed = {}, [], [], 0
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.tags[tag] = self.tags.get(tag, 0) + 1
        self.fetched += [v for k, v in attributes if k in ("src", "href", "xlink:href") and not str(v).startswith("#")]
        if tag not in self.VOID:
            self._open.append(tag)

    def handle_endtag(self, tag):
        if tag in self.VOID:
            return
        while self._open and self._open.pop() != tag:
            self.unclosed += 1


def test_the_command_writes_table_plots_and_page(fall, tmp_path):
    out = tmp_path / "out"
    result = call(
        "tradeoff",
        fall,
        "--vary",
        "time_step=1/100,1/200",
        "--vary",
        "tolerance=1e-1,1e-3",
        "--also",
        "accuracy=paper",
        "--windows",
        2,
        "--reference-step",
        0.003125,
        "-o",
        out,
        *ONE,
    )
    assert result.exit_code == 0, result.output
    data = json.loads((out / "tradeoff.json").read_text(), parse_constant=no_constant)
    scene = data["scenes"][0]
    assert len(scene["points"]) == 5 and scene["scene"] == "fall" and set(tradeoff.MEASURES) <= set(scene["points"][0])
    assert [p["settings"].get("accuracy") for p in scene["points"]].count("paper") == 1
    table = list(csv.DictReader((out / "tradeoff.csv").open()))
    assert len(table) == 5 and {
        "scene",
        "backend",
        "time_step",
        "tolerance",
        "accuracy",
        "ms_per_second",
        "restart_rms",
        "front",
    } <= set(table[0])
    assert "nan" not in (out / "tradeoff.csv").read_text().lower()
    assert sum(row["front"] == "True" for row in table) == len(scene["fronts"]["cpu"]) >= 1
    assert (out / "fall.png").stat().st_size > 10_000 and (out / "fall.svg").stat().st_size < 200_000
    page = Page((out / "index.html").read_text())
    assert page.tags["table"] == 1 and page.tags["svg"] == 1 and page.tags["tr"] == 6 and page.unclosed == 0
    assert page.fetched == [] and not re.search(r"(src|href)=\"http", (out / "index.html").read_text())
    import xml.etree.ElementTree

    xml.etree.ElementTree.parse(out / "fall.svg")
    document = tmp_path / "page.md"
    document.write_text("before\n<!-- section fronts -->\nold\n<!-- end fronts -->\nafter\n")
    subprocess.run(
        [sys.executable, ROOT / "benchmarks" / "accuracy_page.py", out, "--page", document],
        check=True,
    )
    text = document.read_text()
    assert (
        text.startswith("before\n")
        and text.endswith("after\n")
        and "old" not in text
        and "### fall, 8 triangles" in text
    )
    assert (
        "tolerance 0.1" in text
        and f"{100 * scene['points'][scene['fronts']['cpu'][0]]['restart_rms_edges']:.2f} %" in text
        and "(../docs/images/generated/page-fall.svg)" in text
    )
    assert (tmp_path / "page.csv").read_text() == (out / "tradeoff.csv").read_text()
    references = list(csv.DictReader((tmp_path / "page-references.csv").open()))
    assert len(references) == 1 and references[0]["scene"] == "fall" and references[0]["triangles"] == "8"
    sys.path.insert(0, str(ROOT / "benchmarks"))
    import plot_results

    (tmp_path / "page.csv").rename(tmp_path / "accuracy-fronts-page.csv")
    (tmp_path / "page-references.csv").rename(tmp_path / "accuracy-fronts-page-references.csv")
    assert plot_results.plot_all(tmp_path, tmp_path) == [tmp_path / "accuracy-fronts-page-fall.svg"]
    xml.etree.ElementTree.parse(tmp_path / "accuracy-fronts-page-fall.svg")
    document.write_text("<!-- section levels -->\nold\n<!-- end levels -->\n")
    subprocess.run(
        [sys.executable, ROOT / "benchmarks" / "accuracy_page.py", out, "--page", document, "--section", "levels"],
        check=True,
    )
    # g dt w / 2 = 1.23 mm, of edges of 0.15 and 0.21 m
    assert (
        "| fall, 8 |" in document.read_text()
        and "| paper |" in document.read_text()
        and "0.74 %" in document.read_text()
    )


@pytest.mark.parametrize(
    "words, text",
    [
        (["nowhere", "--vary", "time_step=1/60"], "nowhere"),
        (["flag", "--vary", "tollerance=1"], "tollerance"),
        (["flag", "--backend", "tpu"], "tpu"),
        (["flag", "--vary", "time_step=1/7"], "whole number"),
        (["flag", "--also", "tolerance=1,2"], "one value"),
        (["flag", "--device", 9], "number 9"),
        (["flag", "--cluster", "127.0.0.1:1"], "cluster"),
    ],
)
def test_the_command_names_bad_input(tmp_path, words, text):
    result = call("tradeoff", *words, "-o", tmp_path)
    assert result.exit_code == 2 and text in result.output


def test_files_have_names_that_a_file_may_have():
    names = report.file_names(
        [tradeoff.Tradeoff(n, 0, [], {}, None, {}) for n in ("a/b c", "drape", "drape", "../..", "")]
    )
    assert names == ["a_b_c", "drape", "drape-3", "scene", "scene-5"]


def test_the_table_of_fronts_keeps_its_numbers_where_there_is_little_room(monkeypatch):
    monkeypatch.setattr(
        report,
        "summary_rows",
        lambda r: [
            ("opencl", "production, dt 1/120 s, tolerance 0.01, mixed, newton_iterations 4", 12345.6, 0.0123, 1.234)
        ],
    )
    out = io.StringIO()
    Console(file=out, width=60).print(front_table([SimpleNamespace(scene="twisting")]))
    assert "…" not in out.getvalue() and {"twisting", "opencl", "1.235e+04", "0.0123", "1.23"} <= set(
        out.getvalue().split()
    )
    assert "".join(out.getvalue().split()).count("newton") == 1
