# SPDX-License-Identifier: Apache-2.0
"""The commands that a newcomer begins with: `cama new` and `cama doctor`."""

import json
import subprocess
import sys

import jsonschema
import pytest
from typer.testing import CliRunner

import cama
from cama import shipped
from cama.cli import app, doctor
from cama.cli.templates import TEMPLATES
from cama.hints import without_comments

RUNNER = CliRunner()


def call(*words):
    return RUNNER.invoke(app, [str(word) for word in words], catch_exceptions=False)


@pytest.mark.parametrize("template", TEMPLATES)
def test_a_template_runs_unchanged(tmp_path, monkeypatch, template):
    monkeypatch.chdir(tmp_path)
    assert call("new", "a place", "--template", template).exit_code == 0
    text = (tmp_path / "a place" / "scene.json").read_text()
    assert "//" in text
    schema = json.loads((shipped.folder() / "schema.json").read_text())
    jsonschema.validate(json.loads(without_comments(text)), schema)
    assert json.loads((tmp_path / "a place" / "schema.json").read_text()) == schema
    check = call("check", "a place")
    assert check.exit_code == 0 and check.output.splitlines()[-1].startswith("ready"), check.output
    run = call("run", "a place", "--frames", 1, "--resolution", 150, "--accuracy", "preview", "--threads", 1)
    assert run.exit_code == 0 and (tmp_path / "out" / "a place" / "frames.h5").is_file(), run.output
    # progress, and no warning
    assert all(line.startswith(("frame ", "loading the scene")) for line in run.stderr.splitlines()), run.stderr


def test_new_keeps_what_is_there(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert call("new").exit_code == 0 and (tmp_path / "my-scene" / "scene.json").is_file()
    (tmp_path / "my-scene" / "scene.json").write_text("mine")
    again = call("new")
    assert again.exit_code == 2 and "is there already" in again.output
    assert (tmp_path / "my-scene" / "scene.json").read_text() == "mine"
    (tmp_path / "file").write_text("")
    under = call("new", tmp_path / "file" / "scene")
    assert under.exit_code == 2 and under.output.startswith("FileError: ")
    assert not list(tmp_path.rglob("*.partial"))


def test_python_runs_the_package():
    done = subprocess.run([sys.executable, "-m", "cama", "--version"], capture_output=True, text=True)
    assert done.returncode == 0 and done.stdout.strip() == f"cama {cama.__version__}"


def test_doctor_says_what_is_here():
    done = call("doctor")
    assert done.exit_code == 0
    for word in ("backend cpu", "OpenCL loader", "CUDA driver", "assimp", "reader process", "extra render", "threads"):
        assert word in done.output
    assert "cama works here, with cpu" in done.output.splitlines()[-1]


def test_doctor_says_what_to_do(monkeypatch):
    absent = {"pyvista"}
    found = doctor.importlib.util.find_spec
    monkeypatch.setattr(doctor.importlib.util, "find_spec", lambda name: None if name in absent else found(name))
    monkeypatch.setattr(doctor.reading, "works", lambda: False)
    monkeypatch.setattr(doctor.ctypes.util, "find_library", lambda name: None)
    cuda = {"name": "cuda", "available": False, "devices": [], "note": "not in this build"}
    monkeypatch.setattr(doctor, "_core", Core([{**cuda, "name": "cpu", "available": True, "devices": ["x"]}, cuda]))
    done = call("doctor")
    said = " ".join(done.output.split())
    assert done.exit_code == 0
    for words in ("pip install pyvista`, for cama render", "ocl-icd-libopencl1", "cannot start a Python process"):
        assert words in said
    assert "backend cuda: this build of cama has no cuda" in said


class Core:
    """The compiled module with other backends."""

    def __init__(self, backends):
        self.list_backends = lambda: backends

    def __getattr__(self, name):
        return getattr(cama._core, name)


@pytest.mark.parametrize(
    "files, expected",
    [
        ({"cpu.max": "150000 100000\n"}, 1.5),
        ({"cpu.max": "max 100000\n"}, None),
        ({"cpu/cpu.cfs_quota_us": "200000\n", "cpu/cpu.cfs_period_us": "100000\n"}, 2.0),
        ({"cpu/cpu.cfs_quota_us": "-1\n", "cpu/cpu.cfs_period_us": "100000\n"}, None),
        ({}, None),
    ],
)
def test_the_quota_of_a_container(tmp_path, files, expected):
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    assert doctor.processor_quota(tmp_path) == expected
