# SPDX-License-Identifier: Apache-2.0
"""Units and axes of meshes, and what is said of obstacles and of starts that are hardly meant."""

import json
from typing import get_args

import numpy as np
import pytest
from typer.testing import CliRunner

import cama
from cama import plausibility, shipped, types, units
from cama.cli import app
from cama.io.exporting import export
from conftest import grid
from test_characters import CORNERS, write_gltf

SYMBOLS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 2.54e-2, "ft": 0.3048}  # of NIST SP 811
NAMES = {"metre": 1.0, "centimetre": 1e-2, "millimetre": 1e-3, "inch": 2.54e-2, "foot": 0.3048}
METRES = {**SYMBOLS, **NAMES}


@pytest.fixture
def triangle(tmp_path):
    """A file with one triangle, and texture coordinates of 2 units."""
    path = tmp_path / "one.obj"
    path.write_text("v 0 0 0\nv 3 0 0\nv 0 5 7\nvt 0 0\nvt 2 0\nvt 0 2\nf 1/1 2/2 3/3\n")
    return path


def test_units_have_the_same_names_everywhere(tmp_path):
    """In scene files (their schema), patterns, `cama export`, `cama dress` and the types of Python."""
    assert set(units.UNITS) == set(METRES) == set(get_args(types.Unit))

    def of(node):
        if isinstance(node, dict):
            if "m" in node.get("enum", []):
                yield node["enum"]
            for value in node.values():
                yield from of(value)
        elif isinstance(node, list):
            for value in node:
                yield from of(value)

    found = list(of(json.loads((shipped.folder() / "schema.json").read_text())))
    assert len(found) == 3 and all(set(enum) == set(METRES) for enum in found)
    for command in ("export", "dress"):
        said = CliRunner().invoke(app, [command, "none", "none", "--units", "furlong"]).output
        assert all(f"'{unit}'" in said.replace("\n", " ") for unit in ("metre", "ft")), said
    panel = {"corners": [[0, 0], [8, 0], [0, 8]]}
    for unit, length in METRES.items():
        pattern = cama.SewingPattern.parse({"units": unit, "panels": {"front": panel}})
        assert pattern.panels[0].area == pytest.approx(8**2 * length**2 / 2)


@pytest.mark.parametrize("unit", METRES)
def test_units_of_exports(tmp_path, unit):
    scene = cama.Scene()
    scene.add_cloth([[0, 0, 0], [3, 0, 0], [0, 5, 7]], [[0, 1, 2]])
    cama.record(cama.Simulation(scene, accuracy="preview"), tmp_path / "out", frames=0)
    lines = export(tmp_path / "out", "obj", tmp_path, units=unit).files[1].read_text().splitlines()
    points = [[float(x) for x in line.split()[1:]] for line in lines if line.startswith("v ")]
    np.testing.assert_allclose(points, np.array([[0, 0, 0], [3, 0, 0], [0, 5, 7]]) / METRES[unit], rtol=1e-8)


@pytest.mark.parametrize("unit", METRES)
def test_units_of_files_and_arrays(triangle, unit):
    corners = METRES[unit] * np.array([[0, 0, 0], [3, 0, 0], [0, 5, 7]])
    scene = cama.Scene()
    cloth = scene.add_cloth(triangle, units=unit, translate=(1, 0, 0))
    np.testing.assert_allclose(cloth.vertices, corners + [1, 0, 0], rtol=1e-15)
    body = scene.add_obstacle(corners / METRES[unit], [[0, 1, 2]], units=unit, scale=2)
    np.testing.assert_allclose(body.vertices, 2 * corners, rtol=1e-15)
    written = {"file": {"path": str(triangle), "units": unit, "scale": 3}}
    loaded = cama.Scene.parse({"cloth": [written], "obstacles": [written]})
    for part in (loaded.cloths[0], loaded.obstacles[0]):
        np.testing.assert_allclose(part.vertices, 3 * corners, rtol=1e-15)


def test_the_axis_that_points_up(triangle):
    upright = [[0, 0, 0], [3, 0, 0], [0, -7, 5]]  # y becomes z, and z becomes -y: right-handed still
    scene = cama.Scene()
    np.testing.assert_array_equal(scene.add_cloth(triangle, up="y").vertices, upright)
    np.testing.assert_array_equal(scene.add_obstacle(triangle, up="z").vertices[2], [0, 5, 7])
    loaded = cama.Scene.parse({"cloth": [{"file": {"path": str(triangle), "up": "y", "units": "cm"}}]})
    np.testing.assert_allclose(loaded.cloths[0].vertices, 0.01 * np.array(upright), rtol=1e-15)


def test_rest_shapes_have_the_units_that_are_theirs(triangle):
    """Texture coordinates keep `material_scale`; material vertices in arrays are in the units of the mesh."""
    scene = cama.Scene()
    pattern = scene.add_cloth(triangle, units="cm", rest="uv", material_scale=0.1)
    np.testing.assert_allclose(pattern.material_vertices, [[0, 0], [0.2, 0], [0, 0.2]], rtol=1e-15)
    flat = scene.add_cloth(*grid(2), material_vertices=grid(2)[0][:, :2], units="mm")
    np.testing.assert_allclose(flat.material_vertices, 1e-3 * grid(2)[0][:, :2], rtol=1e-15)


def test_characters_have_units_too(tmp_path):
    file = write_gltf(tmp_path / "rising.gltf")
    expected = 0.01 * CORNERS[:, [0, 2, 1]].astype(float) * [1, -1, 1]
    written = {"character": {"file": str(file), "units": "cm"}}
    loaded = cama.Scene.parse({"obstacles": [written]}).obstacles[0]
    for body in (cama.Scene().add_obstacle(file, units="cm"), loaded):
        np.testing.assert_allclose(sorted(map(tuple, body.vertices)), sorted(map(tuple, expected)), atol=1e-9)
        lifted = body.motion.evaluate(2.0, body.vertices) - body.vertices
        np.testing.assert_allclose(lifted, np.tile([0, 0, 0.04], (4, 1)), atol=1e-9)


@pytest.mark.parametrize(
    "given, words",
    [
        ({"units": "km"}, ["sheet", "units", "inch"]),
        ({"units": "meter"}, ["sheet", "units", "metre"]),
        ({"up": "x"}, ["sheet", "up"]),
    ],
)
def test_what_is_not_known_is_named(triangle, given, words):
    with pytest.raises(cama.SceneError) as python:
        cama.Scene().add_cloth(triangle, name="sheet", **given)
    with pytest.raises(cama.SceneError) as file:
        cama.Scene.parse({"cloth": [{"name": "sheet", "file": {"path": str(triangle), **given}}]})
    assert all(word in str(python.value) for word in words) and all(word in str(file.value) for word in words[1:])


def test_units_are_for_meshes_and_up_for_files_without_one(tmp_path):
    with pytest.raises(cama.SceneError, match="generated shape is in metres"):
        cama.Scene().add_cloth(shape={"grid": {"size": [1, 1]}}, units="cm")
    with pytest.raises(cama.SceneError, match="y is up, and it is turned already"):
        cama.Scene().add_obstacle(write_gltf(tmp_path / "rising.gltf"), up="y")
    with pytest.raises(cama.SceneError, match="y is up, and it is turned already"):
        cama.Scene.parse({"obstacles": [{"file": {"path": str(tmp_path / "rising.gltf"), "up": "y"}}]})


def ball(radius=0.25, **more):
    made = cama.Scene().add_obstacle(shape={"sphere": {"radius": radius, "triangles": 320}})
    return {"mesh": made.vertices, "faces": made.faces, "translate": (0, 0, -2 * radius), "name": "ball", **more}


def kinds(**obstacle):
    scene = cama.Scene()
    scene.add_cloth(*grid(8), name="sheet")
    scene.add_obstacle(**obstacle)
    return {finding.kind: str(finding) for finding in plausibility.findings(scene)}


def test_normals_that_point_inward_are_said():
    assert kinds(**ball()) == {}
    turned = ball()
    turned["faces"] = turned["faces"][:, ::-1]
    assert "obstacle 'ball': faces: it is closed, and its faces are turned inward" in kinds(**turned)["turned"]
    some = ball()
    some["faces"] = some["faces"].copy()
    some["faces"][7] = some["faces"][7][::-1]  # its three edges are now taken alike by two faces each
    assert "3 edges join faces that are turned against each other" in kinds(**some)["turned"]


def test_a_start_far_from_the_body_is_said():
    """The gap between the sheet, 1 m across and at z = 0, and the top of a ball of 0.5 m."""
    assert kinds(**ball(translate=(0, 0, -3))) == {}
    assert "cloth 'sheet': vertices: 7.75 m from the nearest obstacle" in kinds(**ball(translate=(0, 0, -8)))["far"]


def test_a_mesh_in_centimetres_names_the_argument():
    said = kinds(**ball(85, translate=(0, 0, -90)))["large"]
    assert "170 m across" in said and 'in centimetres (1.7 m across), give units="cm"' in said


def check(tmp_path, scene):
    (tmp_path / "scene.json").write_text(json.dumps(scene))
    done = CliRunner().invoke(app, ["check", str(tmp_path)])
    return done.exit_code, done.output.strip().splitlines()[-1], done.output


SHEET = {"name": "sheet", "grid": {"size": [1, 1], "cells": [4, 4]}}
OTHER = {**SHEET, "name": "other", "transform": {"rotate": {"axis": [1, 0, 0], "angle_deg": 90}}}


@pytest.mark.parametrize(
    "scene, code, words",
    [
        ({"cloth": [SHEET]}, 0, "ready: `cama run "),
        ({"cloth": [{**SHEET, "grid": {"size": [60, 90]}}]}, 0, "will run, but look at cloth 'sheet' (large)"),
        ({"cloth": [SHEET, OTHER]}, 1, "will not run: 8 intersections at the start"),
        ({"cloth": [{**SHEET, "grid": {"size": [0, 1]}}]}, 2, "will not run: SceneError: "),
        ({}, 2, "will not run: SceneError: "),
    ],
)
def test_check_ends_with_a_verdict(tmp_path, scene, code, words):
    got, last, output = check(tmp_path, scene)
    if code == 1:  # the number of intersections depends on the grids' diagonals
        words = words.replace("8", last.split()[3])
    assert (got, last[: len(words)]) == (code, words), output


def test_check_says_that_a_body_is_open(tmp_path):
    made = ball()
    faces = made["faces"][(made["mesh"][made["faces"]][:, :, 2] < 0.2).all(axis=1)]
    used, faces = np.unique(faces, return_inverse=True)
    mesh = {"position": made["mesh"][used].tolist(), "face": faces.reshape(-1, 3).tolist()}
    bowl = {"name": "bowl", "mesh": mesh, "transform": {"translate": [0, 0, -1]}}
    code, last, output = check(tmp_path, {"cloth": [SHEET], "obstacles": [bowl]})
    assert code == 0 and "obstacle 'bowl': is open" in output and last.startswith("ready")
    floor = {"name": "floor", "plane": {"size": [2, 2]}, "transform": {"translate": [0, 0, -1]}}
    assert "is open" not in check(tmp_path, {"cloth": [SHEET], "obstacles": [floor]})[2]
