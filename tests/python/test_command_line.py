# SPDX-License-Identifier: Apache-2.0
"""What the command `cama` says to people who are new to it: mistakes, progress, folders with earlier results."""

import errno
import io
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import pytest
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn
from typer.testing import CliRunner

import cama
from cama.cli import app
from cama.cli.check import intersection_lines
from cama.cli.info import note_of
from cama.io import progress
from cama.io.lock import NAME as LOCK
from cama.io.lock import locked

ROOT = Path(__file__).parents[2]
RUNNER = CliRunner()
QUICK = ["--resolution", 96, "--accuracy", "preview"]


def call(*words):
    return RUNNER.invoke(app, [str(w) for w in words], catch_exceptions=False)


def said(result):
    return " ".join(result.output.split())


def frames_in(file):
    with h5py.File(file) as f:
        return len(f["times"]) - 1


@pytest.fixture
def here(tmp_path, monkeypatch):
    """An empty working folder with a mesh of one triangle."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "skirt.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    return tmp_path


def test_version():
    result = call("--version")
    assert result.exit_code == 0 and result.output.strip() == f"cama {cama.__version__}"


@pytest.mark.parametrize(
    ("note", "expected"),
    [
        ("cudaErrorInsufficientDriver: CUDA driver version is insufficient", "no NVIDIA GPU with a current driver"),
        ("cudaErrorNoDevice: no CUDA-capable device is detected", "no NVIDIA GPU with a current driver"),
        ("not in this build: nvcc was not found", "cama computes on the other backends"),
        ("CUDA 12.4", "CUDA 12.4"),
    ],
)
def test_info_without_a_gpu_is_no_alarm(note, expected):
    assert expected in note_of({"name": "cuda", "note": note})
    assert note in note_of({"name": "cuda", "note": note})


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["run", "drape", "--accuracy", "fast"], "'fast' is not one of 'preview'"),
        (["run", "drape", "--to", "abc"], "No such option: --to"),
        (["run"], "Missing argument 'SCENE'"),
        (["dance"], "No such command 'dance'; see "),
    ],
)
def test_a_mistake_on_the_command_line_is_one_line(words, expected):
    done = subprocess.run([sys.executable, "-m", "cama", *words], capture_output=True, text=True)
    assert done.returncode == 2 and not done.stdout
    assert done.stderr.startswith("Error: ") and done.stderr.count("\n") == 1 and expected in done.stderr


def test_tables_in_a_pipe_are_not_cut():
    words = [sys.executable, "-m", "cama", "explain", "drape", "--resolution", "300"]
    environment = {name: value for name, value in os.environ.items() if name != "COLUMNS"}
    done = subprocess.run(words, capture_output=True, text=True, env=environment, check=True)
    simulation = cama.Simulation(cama.Scene.load("drape", 300), backend="cpu")
    names = [option["name"] for option in simulation.chosen_options] + [name for name, _ in simulation.explain()]
    assert [name for name in names if f"{name}  " not in done.stdout] == [] and "…" not in done.stdout


# --- Scenes -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", ["run", "check", "explain"])
def test_a_mesh_is_not_a_scene_and_the_error_shows_a_scene(here, command):
    result = call(command, "skirt.obj")
    assert result.exit_code == 2
    assert "skirt.obj: is a mesh, not a scene" in said(result)
    example = re.search(r'(\{"cloth".*\})', said(result))[1]  # what the error shows is a scene
    (here / "scene.json").write_text(example)
    assert cama.Scene.load(here).triangle_count == 1


def test_a_missing_file_names_the_scene_file_and_the_part(here):
    cloths = [
        {"name": "belt", "file": "skirt.obj", "material": "cotton"},
        {"name": "skirt", "file": "gone.obj", "material": "cotton"},
    ]
    (here / "evening.json").write_text("// comments are allowed\n" + json.dumps({"cloth": cloths}))
    result = call("run", "evening.json")
    assert result.exit_code == 2 and "evening.json: cloth 'skirt': gone.obj: no such file" in said(result)
    (here / "evening.json").write_text(
        json.dumps({"cloth": cloths[:1], "obstacles": [{"character": {"file": "walk.glb"}}]})
    )
    assert "evening.json: obstacles[0]: walk.glb" in said(call("check", "evening.json"))


def test_a_bad_vertex_names_its_file_and_a_bad_thickness_its_field(here):
    (here / "torn.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv nan 1 0\nf 1 2 3\nf 2 4 3\n")
    cloth = {"name": "sheet", "file": "torn.obj", "material": "cotton"}
    (here / "scene.json").write_text(json.dumps({"cloth": [cloth]}))
    result = call("check", here)
    assert result.exit_code == 2 and 'cloth "sheet" from torn.obj: vertex 3 has a coordinate' in said(result)
    (here / "scene.json").write_text(json.dumps({"cloth": [{**cloth, "file": "skirt.obj", "thickness": -1}]}))
    assert "cloth[0].thickness: must be 0 or more" in said(call("check", here))


def test_a_material_says_what_it_is():
    material = cama.Material.orthotropic(100, 60, 0, 30, 2e-5, 1e-5, 0.2)  # what was given, without contraction
    assert repr(material) == (
        "<cama.Material 'orthotropic': 0.2 kg/m², stretching 100 (warp) and 60 (weft) N/m, plate bending 1e-05 to "
        "2e-05 N m>"
    )


def test_names_that_are_nearly_right(here):
    (here / "scene.json").write_text(json.dumps({"cloth": [{"file": "skirt.obj", "material": "Cotton"}]}))
    assert "did you mean 'cotton'?" in said(call("check", here))
    assert "did you mean 'drape'?" in said(call("run", "drap"))
    assert "did you mean" not in said(call("run", "no_such_scene"))
    with pytest.raises(cama.MaterialError, match="did you mean 'denim'"):
        cama.Material.fabric("denin")
    with pytest.raises(cama.MaterialError, match="did you mean 'silk'"):
        cama.Scene().add_cloth("skirt.obj", material="Silk")
    with pytest.raises(cama.MaterialError, match="wool$"):
        cama.Material.fabric("concrete")


def test_numbers_agree_with_their_nouns():
    scene = cama.Scene(name="one")
    scene.add_cloth([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    scene.add_obstacle(shape={"sphere": {"radius": 0.1}}, translate=(0, 0, -1))
    assert repr(scene) == "<cama.Scene 'one': 1 cloth with 1 triangle, 1 obstacle>"
    assert repr(cama.Scene()).endswith("0 cloths with 0 triangles, 0 obstacles>")


def test_places_of_intersections_are_whole_on_a_narrow_terminal(here):
    scene = cama.Scene()
    for name, z in (("lower", 0.0), ("upper", 1.23456e-4)):
        scene.add_cloth(
            shape={"grid": {"size": [1, 1], "cells": [2, 2]}},
            rotate=(1, 0, 0, 0) if name == "lower" else (0.9238795325112867, 0.3826834323650898, 0, 0),
            translate=(-0.123456, 0, z),
            name=name,
        )
    found = scene.intersections()
    assert found
    out = io.StringIO()
    console = Console(file=out, width=80, soft_wrap=True)
    for line in intersection_lines(found):
        console.print(line)
    number = r"-?\d+(?:\.\d+)?(?:e[+-]\d+)?"
    assert len(re.findall(rf"\({number}, {number}, {number}\)", out.getvalue())) == 3 * len(found)
    assert (
        "cloth 'lower' with cloth 'upper'" in out.getvalue()
        and "..." not in out.getvalue()
        and "…" not in out.getvalue()
    )
    scene.save(here / "crossed.json")
    assert "cloth 'lower' with cloth 'upper'" in said(call("check", "crossed.json"))


# --- Values of options ------------------------------------------------------------------------------------------------


def test_seconds_are_also_fractions(here):
    result = call("run", "drape", *QUICK, "--frames", 1, "--time-step", "1/200", "-o", "a")
    assert result.exit_code == 0, result.output
    assert json.loads((here / "a" / "summary.json").read_text())["dt"] == 1 / 200
    for wrong in ("1/0", "half", "-1/200", "inf", "nan"):
        result = call("run", "drape", "--time-step", wrong)
        assert result.exit_code == 2 and "such as 0.005 or 1/200" in re.sub(r"[\s│]+", " ", result.output)
    for command in ("tradeoff", "tune"):
        for option in ("--window", "--reference-step", "--limit"):
            result = call(command, "drape", option, "few")
            assert result.exit_code == 2 and "such as 0.005 or 1/200" in re.sub(r"[\s│]+", " ", result.output)
            assert "is not above 0" in re.sub(r"[\s│]+", " ", call(command, "drape", option, "0").output)


def test_tune_without_a_budget_names_the_options(here):
    result = call("tune", "drape")
    assert result.exit_code == 2 and "--error 1mm" in said(result) and "--time 16ms" in said(result)


@pytest.mark.parametrize(
    ("words", "module"),
    [
        (["tradeoff", "drape"], "scipy"),
        (["tradeoff", "drape"], "matplotlib"),
        (["tune", "drape", "--error", "8%"], "scipy"),
        (["render", "out/drape"], "pyvista"),
        (["tradeoff", "drape", "--cluster", "auto"], "ray"),
    ],
)
def test_what_is_missing_is_said_before_anything_is_computed(here, monkeypatch, words, module):
    monkeypatch.setitem(sys.modules, module, None)  # Python's own way to make a module look absent
    monkeypatch.setattr(cama.Simulation, "step", lambda *_: pytest.fail("computed"))
    result = call(*words)
    assert result.exit_code == 2
    assert f"{sys.executable} -m pip install {module}`" in said(result)
    assert not (here / "out").exists() or not list((here / "out").rglob("*.npz"))


def test_the_demo_installs_what_all_commands_need():
    """The lists of pyproject.toml that script/demo installs have every library that a command of cama asks for."""
    names = subprocess.run(
        ["bash", "-c", 'source script/setup.sh && requirements "${PYTHON_LISTS[@]}"'],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    ).stdout.split()
    listed = {re.match(r"[\w-]+", name)[0] for name in names}
    needed = {"numpy", "h5py", "typer", "rich", "pyvista", "imageio", "imageio-ffmpeg", "viser", "scipy", "matplotlib"}
    assert needed <= listed
    demo = (ROOT / "script" / "demo").read_text(encoding="utf-8")
    assert 'python_packages "${PYTHON_LISTS[@]}"' in demo and "--accuracy interactive" in demo


# --- Progress ---------------------------------------------------------------------------------------------------------


def test_progress_is_said_where_there_is_no_terminal(monkeypatch):
    clock = iter(range(0, 10**6, 3))  # 3 s between two looks at the clock
    monkeypatch.setattr(progress.time, "monotonic", lambda: next(clock))
    out = io.StringIO()
    with progress.Bar("frame", MofNCompleteColumn(), BarColumn(), console=Console(file=out, width=80)) as bar:
        task = bar.add_task("", total=10)
        for _ in range(10):
            bar.update(task, advance=1)
    lines = out.getvalue().split("\n")
    assert [line.split() for line in lines if line] == [["frame", "4/10"], ["frame", "8/10"], ["frame", "10/10"]]


def test_what_takes_long_is_said_where_there_is_no_terminal(monkeypatch):
    monkeypatch.setattr(progress, "SOON", 0.05)
    out = io.StringIO()
    with progress.during("loading", Console(file=out)):
        pass
    with progress.during("untangling", Console(file=out)):
        for _ in range(200):
            if out.getvalue():
                break
            time.sleep(0.05)
    assert out.getvalue() == "untangling ...\n"


def test_a_run_in_a_pipe_says_its_last_frame(here):
    words = [sys.executable, "-m", "cama", "run", "drape", *map(str, QUICK), "--frames", "2", "-o", "a"]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 0 and "drape: 96 triangles, 75 vertices; accuracy preview, single" in done.stdout
    assert "2 frames of 25 ms, 0.05 s, to a" in done.stdout
    last = r"frame\s+2/2 96 triangles .* contacts gap \S+ mm 0 intersections"
    assert re.search(last, done.stderr), done.stderr


# --- Folders of results -----------------------------------------------------------------------------------------------


def test_an_earlier_run_is_kept_and_the_run_says_where(here):
    run = ["run", "drape", *QUICK, "-o", "a"]
    assert "earlier" not in said(call(*run, "--frames", 3))
    first = json.loads((here / "a" / "summary.json").read_text())["state_hash"]
    second = call(*run, "--frames", 2)
    assert second.exit_code == 0
    assert "the results of an earlier run, 3 frames, are now in a/previous" in said(second)
    assert frames_in(here / "a" / "frames.h5") == 2 and frames_in(here / "a" / "previous" / "frames.h5") == 3
    assert json.loads((here / "a" / "previous" / "summary.json").read_text())["state_hash"] == first
    assert (here / "a" / "previous" / "checkpoint.h5").is_file()
    third = call(*run, "--frames", 1, "--overwrite")
    assert third.exit_code == 0 and "earlier" not in said(third)
    assert frames_in(here / "a" / "frames.h5") == 1 and frames_in(here / "a" / "previous" / "frames.h5") == 3


def test_an_earlier_start_without_frames_is_not_kept(here):
    for _ in range(2):
        assert call("run", "drape", *QUICK, "--frames", 0, "-o", "a").exit_code == 0
    assert not (here / "a" / "previous").exists()


def hold(folder):
    """A process that holds the lock of a folder until it is killed."""
    code = (
        "import sys, pathlib, cama.io.lock as lock\n"
        "with lock.locked(pathlib.Path(sys.argv[1])):\n    print('locked', flush=True)\n    sys.stdin.read()\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code, str(folder)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout.readline() == "locked\n"
    return process


def test_a_second_run_in_a_folder_is_refused_while_the_first_goes_on(here):
    assert call("run", "drape", *QUICK, "--frames", 2, "-o", "a").exit_code == 0
    process = hold(here / "a")
    try:
        for more in ([], ["--overwrite"], ["--resume", "--frames", 4]):
            result = call("run", "drape", *QUICK, "--frames", 1, "-o", "a", *more)
            assert result.exit_code == 2 and "FileError" in result.output
            assert f"a: another run (process {process.pid} on " in said(result)
            assert "choose another folder (--output)" in said(result)
        assert frames_in(here / "a" / "frames.h5") == 2  # nothing was touched
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
    assert (here / "a" / LOCK).exists()  # a killed process leaves its file, which locks nothing
    result = call("run", "drape", *QUICK, "--frames", 1, "-o", "a")
    assert result.exit_code == 0 and not (here / "a" / LOCK).exists()


def test_a_lock_is_given_back_and_works_within_a_process(tmp_path):
    here, said_so = tmp_path / "a", pytest.raises(cama.FileError, match=f"process {os.getpid()}")
    with locked(here), said_so, locked(here):
        pass
    with locked(tmp_path / "a"):
        pass
    (tmp_path / "file").touch()
    with pytest.raises(cama.FileError, match=os.strerror(errno.EEXIST)), locked(tmp_path / "file"):
        pass


def test_resume_of_an_edited_scene_names_the_option_of_the_command(here):
    scene = {"cloth": [{"grid": {"size": [1, 1], "cells": [2, 2]}, "material": "cotton"}], "frames": 1}
    (here / "scene.json").write_text(json.dumps(scene))
    assert call("run", "scene.json", "-o", "a").exit_code == 0
    (here / "scene.json").write_text(json.dumps({**scene, "gravity": [0, 0, -1]}))
    refused = call("run", "scene.json", "-o", "a", "--resume", "--frames", 2)
    assert refused.exit_code == 2 and "differs in gravity" in said(refused)
    assert "--changed-scene" in said(refused) and "load_checkpoint" not in refused.output
    done = call("run", "scene.json", "-o", "a", "--resume", "--changed-scene", "--frames", 2)
    assert done.exit_code == 0 and frames_in(here / "a" / "frames.h5") == 2
    simulation = cama.Simulation("scene.json")
    (here / "scene.json").write_text(json.dumps(scene))
    with pytest.raises(cama.SceneError, match="changed_scene=True"):
        cama.Simulation("scene.json").load_checkpoint("a")
    assert simulation.step_count == 0
