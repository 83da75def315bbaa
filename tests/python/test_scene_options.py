# SPDX-License-Identifier: Apache-2.0
"""`options` of a scene: read, kept, refused by name, and overridden by the caller."""

import inspect
import json
from pathlib import Path

import jsonschema
import pytest

import cama
from cama import shipped

SHEET = {"cloth": [{"grid": {"size": [1, 1], "cells": [2, 2]}, "material": "cotton"}]}


def test_options_are_used_and_survive_saving(tmp_path):
    scene = cama.Scene.parse(
        dict(SHEET, options={"accuracy": "paper", "tolerance": 1e-4, "max_impact_passes": 3, "precision": "single"})
    )
    scene.save(tmp_path / "scene.json")
    again = cama.Scene.load(tmp_path / "scene.json")
    assert (
        again.options
        == scene.options
        == {"accuracy": "paper", "tolerance": 1e-4, "max_impact_passes": 3, "precision": "single"}
    )
    assert again.to_json() == scene.to_json() == again.copy().to_json()
    options = cama.Simulation(again).options
    assert (options["accuracy"], options["tolerance"], options["max_impact_passes"], options["precision"]) == (
        "paper",
        1e-4,
        3,
        "single",
    )
    assert options["paper.search"] == "fronts"  # of the preset


def test_the_caller_overrides():
    scene = cama.Scene.parse(dict(SHEET, options={"tolerance": 1e-1, "precision": "single"}))
    one = cama.Simulation(scene, tolerance=1e-5).options
    assert one["tolerance"] == 1e-5 and one["precision"] == "single"
    assert cama.Simulation(scene, precision="double").options["precision"] == "double"
    preset = cama.Simulation(scene, accuracy="paper").options
    assert preset["tolerance"] == 1e-6 and preset["precision"] == "double"
    assert cama.Simulation(scene, accuracy="production").options["tolerance"] == 1e-2


@pytest.mark.parametrize(
    "options, text",
    [
        ({"tolerence": 1e-2}, "tolerence.*tolerance"),
        ({"backend": "cpu"}, "backend"),
        ({"pinch": "release"}, "pinch"),
        ({"accuracy": "best"}, "best"),
        ({"tolerance": "small"}, "tolerance"),
        ({"tolerance": [1]}, "options.tolerance"),
        ({"paper": {"search": "luck"}}, "luck"),
        ([1], "options"),
        ({"accuracy": 3}, "accuracy"),
    ],
)
def test_bad_options_are_named(options, text):
    with pytest.raises(cama.SceneError, match=text):
        cama.Scene.parse(dict(SHEET, options=options))


def test_no_options_leave_no_trace():
    scene = cama.Scene.parse(SHEET)
    assert scene.options == {} and '"options"' not in scene.to_json()
    scene.options = {"tolerance": 1e-2}
    assert scene.options == {"tolerance": 1e-2}
    scene.options = {}
    assert '"options"' not in scene.to_json()


def test_a_scene_file_comes_out_as_in_c_plus_plus():
    """tests/unit/test_options.cpp reads the same file, whose expected values are written by hand."""
    file = Path(__file__).parents[1] / "shared_scenes" / "options.json"
    expected = json.loads(file.read_text())["_expected"]

    def check(simulation, values):
        assert values and {name: simulation.options[name] for name in values} == values

    simulation = cama.Simulation(file)
    check(simulation, expected["scene"])
    assert simulation.time_step == 0.0025  # two fill the frame of 5 ms: one would be longer than 1/240 s
    origins = {row["name"]: row["origin"] for row in simulation.chosen_options}
    assert {name: origins[name] for name in expected["origins"]} == expected["origins"]
    check(cama.Simulation(file, tolerance=0.25), expected["with tolerance 0.25 of the user"])
    check(cama.Simulation(file, accuracy="paper"), expected["with accuracy paper of the user"])


def test_the_schema_knows_the_options_of_the_table():
    schema = json.loads((shipped.folder() / "schema.json").read_text())
    options = schema["properties"]["options"]["properties"]
    flat = {**{k: v for k, v in options.items() if k != "paper"}}
    flat.update({f"paper.{k}": v for k, v in options["paper"]["properties"].items()})
    table = {row["name"]: row for row in cama.option_table() if row["set_by"] == "scene"}
    assert set(flat) == set(table)
    assert all(flat[name].get("enum", []) == row["words"] for name, row in table.items())
    for bad in ({"tolerence": 1}, {"integrator": "rk4"}, {"pinch": "release"}, {"paper": {"tolerance": 1}}):
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(dict(SHEET, options=bad), schema)
    jsonschema.validate(dict(SHEET, options={"tolerance": 1e-2, "paper": {"search": "tree"}}), schema)


def test_every_option_is_a_keyword_of_a_simulation():
    names = set(inspect.signature(cama.Simulation).parameters) - {"scene"}
    assert names == {row["name"].partition(".")[0] for row in cama.option_table()}
