# SPDX-License-Identifier: Apache-2.0
"""The shipped scenes: valid by the published schema, free of intersections as ipctk sees it."""

import json

import jsonschema
import pytest
from typer.testing import CliRunner

import cama
from cama import shipped
from cama.cli import app
from conftest import judge

SCENES = ["drape", "flag", "funnel", "garment", "pile", "sphere", "twisting"]


def test_all_are_there():
    assert set(SCENES) <= set(cama.scenes())


@pytest.mark.parametrize("name", SCENES)
def test_agrees_with_the_schema(name):
    schema = json.loads((shipped.folder() / "schema.json").read_text())
    jsonschema.validators.validator_for(schema).check_schema(schema)
    jsonschema.validate(json.loads((shipped.folder() / name / "scene.json").read_text()), schema)


@pytest.mark.parametrize("name", SCENES)
def test_has_the_size_asked_for(name):
    scene = cama.Scene.load(name, 1500)
    scene.validate()
    assert scene.name == name and scene.description
    assert 0.6 * 1500 < scene.triangle_count < 1.6 * 1500


def run(name, resolution, frames, folder):
    words = ["run", name, "--resolution", str(resolution), "-o", str(folder)] + (
        ["--frames", str(frames)] if frames else []
    )
    result = CliRunner().invoke(app, words, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return json.loads((folder / "summary.json").read_text())


@pytest.mark.parametrize("name", SCENES)
def test_starts_without_intersections_and_keeps_so(name, tmp_path):
    summary = run(name, 800, 40, tmp_path)
    assert judge(tmp_path, every=4) == 0
    assert summary["intersections"] == 0


@pytest.mark.long
@pytest.mark.parametrize(
    "name, resolution",
    [("sphere", 20000), ("drape", 20000), ("funnel", 5000), ("twisting", 5000), ("garment", 8000), ("flag", 4000)],
)
def test_keeps_free_of_intersections_for_its_whole_length(name, resolution, tmp_path):
    summary = run(name, resolution, 0, tmp_path)
    assert judge(tmp_path, every=5) == 0
    assert summary["intersections"] == 0
