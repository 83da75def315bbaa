# SPDX-License-Identifier: Apache-2.0
"""`options` of a scene: read, kept, refused by name, and overridden by the caller."""

import pytest

import cama

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
    assert options["search"] == "fronts"  # of the preset


def test_the_caller_overrides():
    scene = cama.Scene.parse(dict(SHEET, options={"tolerance": 1e-2, "precision": "single"}))
    one = cama.Simulation(scene, tolerance=1e-5).options
    assert one["tolerance"] == 1e-5 and one["precision"] == "single"
    assert cama.Simulation(scene, precision="double").options["precision"] == "double"
    preset = cama.Simulation(scene, accuracy="paper").options
    assert preset["tolerance"] == 1e-6 and preset["precision"] == "double"
    assert cama.Simulation(scene, accuracy="production").options["tolerance"] == 1e-3


@pytest.mark.parametrize(
    "options, text",
    [
        ({"tolerence": 1e-2}, "tolerence.*tolerance"),
        ({"backend": "cpu"}, "backend"),
        ({"pinch": "release"}, "pinch"),
        ({"accuracy": "best"}, "best"),
        ({"tolerance": "small"}, "tolerance"),
        ({"tolerance": [1]}, "options.tolerance"),
        ({"search": "luck"}, "luck"),
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
