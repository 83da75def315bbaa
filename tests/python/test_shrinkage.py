# SPDX-License-Identifier: Apache-2.0
"""Cloth that shrinks: lengths and tensions of strips in closed form, masses, triangles, panels, files and errors."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

import cama
from cama.cli import app
from cama.sewing.meshing import mesh_pattern
from conftest import grid

pytestmark = pytest.mark.filterwarnings("ignore::cama.PlausibilityWarning")  # cloth that is to carry nothing

STIFFNESS, LENGTH, WIDTH = 200.0, 0.2, 0.1  # N/m, m, m; without a Poisson ratio, so that a strip keeps its width


def strip(shrinkage=0.0, **scene):
    made = cama.Scene(gravity=(0, 0, 0), contact=False, **scene)
    material = cama.Material.isotropic(STIFFNESS, 0.0, 0.0, 0.1)
    material.mass_damping = 15.0
    shape = {"grid": {"size": [LENGTH, WIDTH], "cells": [8, 4]}}
    made.add_cloth(shape=shape, material=material, name="strip", shrinkage=shrinkage)
    return made


def settled(scene, **more):
    simulation = cama.Simulation(scene, error="", time_step=1 / 200, backend="cpu", threads=1, **more)
    simulation.step(400)
    return simulation


@pytest.mark.parametrize("shrinkage", [0.05, [0.05, 0.02], [0.0, 0.1], -0.1])
def test_a_free_strip_takes_its_shrunk_size(shrinkage):
    warp, weft = np.broadcast_to(shrinkage, 2)
    scene = strip(shrinkage)
    start, now = scene.cloths[0].vertices, settled(scene).positions  # it may have turned in its plane
    corner, *ends = (np.linalg.norm(start - [x, y, 0], axis=1).argmin() for x, y in ((-1, -1), (1, -1), (-1, 1)))
    sides = [np.linalg.norm(now[end] - now[corner]) for end in ends]
    assert sides == pytest.approx([(1 - warp) * LENGTH, (1 - weft) * WIDTH], rel=1e-5)


@pytest.mark.parametrize("axis", [0, 1])
def test_a_strip_that_is_held_pulls_with_its_stiffness_times_its_strain(axis):
    """Held at 1 / (1 - s) of its rest length it has the Green strain E and the tension stretch k E per width."""
    shares = [0.0, 0.0]
    shares[axis] = 0.05
    scene = strip(shares)
    along = scene.cloths[0].vertices[:, axis]
    low, high = np.flatnonzero(along < along.min() + 1e-9), np.flatnonzero(along > along.max() - 1e-9)
    scene.pin("strip", low)
    scene.pin("strip", high)
    simulation = settled(scene, forces=True, precision="double")
    stretch = 1 / (1 - 0.05)
    expected = STIFFNESS * stretch * (stretch**2 - 1) / 2 * (LENGTH, WIDTH)[1 - axis]
    force = np.asarray(simulation.forces)[low].sum(axis=0)
    assert abs(force[axis]) == pytest.approx(expected, rel=1e-4)
    assert abs(force[axis]) == pytest.approx(STIFFNESS * 0.05 * (LENGTH, WIDTH)[1 - axis], rel=0.15)  # linear


def test_mass_stays():
    before, after = strip(), strip([0.1, 0.3])
    assert after.cloths[0].rest_area == pytest.approx(0.9 * 0.7 * LENGTH * WIDTH, rel=1e-12)
    assert after.cloths[0].mass == pytest.approx(0.1 * LENGTH * WIDTH, rel=1e-12)
    masses = [cama.Simulation(scene, backend="cpu", threads=1).masses for scene in (before, after)]
    assert masses[1] == pytest.approx(masses[0], rel=1e-12)
    assert np.sum(masses[1]) == pytest.approx(0.1 * LENGTH * WIDTH, rel=1e-12)


def test_no_shrinkage_changes_no_bit():
    hashes = set()
    for shrinkage in (0.0, [0.0, 0.0]):
        scene = strip(shrinkage)
        scene.gravity = (0, 0, -9.81)
        scene.pin("strip", [0])
        simulation = cama.Simulation(scene, backend="cpu", threads=1)
        simulation.step(5)
        hashes.add(simulation.state_hash)
    assert len(hashes) == 1


def test_triangles_shrink_each_for_itself():
    """The right half shrinks along warp, the left one stays."""
    scene = strip()
    vertices, faces = scene.cloths[0].vertices, scene.cloths[0].faces
    right = vertices[faces].mean(axis=1)[:, 0] > vertices[:, 0].mean()
    shrinkage = np.where(right[:, None], [0.1, 0.0], [0.0, 0.0])
    made = cama.Scene(gravity=(0, 0, 0), contact=False)
    cloth = made.add_cloth(vertices, faces, material=scene.cloths[0].material, name="strip", shrinkage=shrinkage)
    assert cloth.shrinkage.tolist() == shrinkage.tolist()
    now = settled(made).positions
    left, middle, end = (now[np.abs(vertices[:, 0] - x) < 1e-9].mean(axis=0) for x in np.array([-1, 0, 1]) * LENGTH / 2)
    assert np.linalg.norm(middle - left) == pytest.approx(LENGTH / 2, rel=1e-3)
    assert np.linalg.norm(end - middle) == pytest.approx(0.9 * LENGTH / 2, rel=1e-3)


def test_bending_takes_the_shrunk_lengths():
    """A hinge's energy is k l^2 / A theta^2: the same angles with both sides at 0.8 have the same energy."""
    vertices, faces = grid(6, 0.3)
    vertices = np.stack([np.sin(vertices[:, 0]), vertices[:, 1], np.cos(vertices[:, 0])], axis=1)
    flat = grid(6, 0.3)[0][:, :2]
    material = cama.Material.isotropic(0.001, 0.0, 1e-3, 0.1)
    energies = []
    for rest, shrinkage in ((0.8 * flat, 0.0), (flat, 0.2), (flat, [0.2, 0.2])):
        scene = cama.Scene(gravity=(0, 0, 0), contact=False)
        scene.add_cloth(vertices, faces, material_vertices=rest, material=material, shrinkage=shrinkage)
        energies.append(cama.Simulation(scene, backend="cpu", threads=1, precision="double").energy()["bending"])
    assert energies[0] > 0 and energies == pytest.approx([energies[0]] * 3, rel=1e-9)


@pytest.mark.parametrize(
    ("given", "rows"), [(0.05, [[0.05, 0.05]]), ([0.05, 0.02], [[0.05, 0.02]]), ([[0.1, 0]] * 64, [[0.1, 0]] * 64)]
)
def test_scene_files_have_shrinkage(given, rows):
    cloth = {"name": "strip", "grid": {"size": [LENGTH, WIDTH], "cells": [8, 4]}, "shrinkage": given}
    scene = cama.Scene.parse({"cloth": [cloth]})
    again = cama.Scene.parse(scene.to_json())
    for one in (scene, again):
        assert one.cloths[0].shrinkage.tolist() == rows
    assert "shrinkage" not in strip().to_json()


@pytest.mark.parametrize(
    ("given", "text"),
    [
        (0.95, r'cloth "strip": shrinkage\[0\]: is 0.95.*; give a share from -1'),
        ([0.1, -1.5], r"shrinkage\[0\]: is -1.5"),
        ([[0.1, 0.1]] * 3, r"shrinkage: is 3 pairs; give one for warp and weft, or one for each of the 64 triangles"),
    ],
)
def test_bad_shrinkage_is_named(given, text):
    with pytest.raises(cama.SceneError, match=text):
        strip(given).validate()


def test_bad_kinds_of_shrinkage_are_named():
    with pytest.raises(cama.ArrayError, match="strip: shrinkage"):
        strip([0.1, 0.2, 0.3])
    with pytest.raises(cama.ArrayError, match="strip: shrinkage"):
        strip(float("nan"))
    for given in ("much", [], [0.1], [[0.1, 0.2, 0.3]], {}):
        with pytest.raises(cama.SceneError, match=r"cloth\[0\].shrinkage"):
            cama.Scene.parse({"cloth": [{"grid": {"size": [1, 1]}, "shrinkage": given}]})


def test_a_panel_of_a_pattern_shrinks(tmp_path):
    rectangle = [[0, 0], [0.2, 0], [0.2, 0.1], [0, 0.1]]
    panels = {"front": {"corners": rectangle, "shrinkage": [0.05, 0.02]}, "back": {"corners": rectangle}}
    pattern = cama.SewingPattern.parse({"panels": panels})
    assert [panel.shrinkage for panel in pattern.panels] == [(0.05, 0.02), (0.0, 0.0)]
    assert [panel.shrinkage for panel in pattern.scaled(2).panels] == [(0.05, 0.02), (0.0, 0.0)]
    mesh = mesh_pattern(pattern, 0.03)
    scene = cama.Scene()
    cloth = scene.add_cloth(
        mesh.positions, mesh.faces, material_vertices=mesh.material, material_faces=mesh.faces, shrinkage=mesh.shrinkage
    )
    assert cloth.rest_area == pytest.approx((0.95 * 0.98 + 1) * 0.2 * 0.1, rel=1e-6)
    assert len(mesh_pattern(pattern.shrunk({"front": 0.0}), 0.03).shrinkage) == 0
    with pytest.raises(cama.SceneError, match="shrinkage: there is no panel 'frnt'.*front"):
        pattern.shrunk({"frnt": 0.1})
    with pytest.raises(cama.SceneError, match="panel 'back': shrinkage: 2 is out of range"):
        pattern.shrunk({"back": 2})
    with pytest.raises(cama.SceneError, match="panel 'front': shrinkage: 5 % is not a finite number"):
        cama.SewingPattern.parse({"panels": {"front": {"corners": rectangle, "shrinkage": "5 %"}}})


def test_dress_shrinks_panels(tmp_path):
    """The waist of the skirt is drawn around the body; the scene that is written has the shares of each triangle."""
    skirt = cama.SewingPattern.load("skirt")
    name = skirt.panels[0].name
    run = CliRunner().invoke(
        app,
        ["dress", "skirt", "--body", "walker", "--resolution", "300", "--shrinkage", f"{name}=0.03,0.01"]
        + ["--backend", "cpu", "-o", str(tmp_path / "out")],
    )
    assert run.exit_code == 0, run.output
    scene = cama.Scene.load(tmp_path / "out")
    shares = scene.cloths[0].shrinkage
    assert len(shares) == len(scene.cloths[0].faces)
    cut = scene.cloths[0].material_vertices[scene.cloths[0].material_faces]
    first, second = cut[:, 1] - cut[:, 0], cut[:, 2] - cut[:, 0]
    areas = 0.5 * np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])
    shrunk = shares.any(axis=1)
    assert np.unique(shares[shrunk], axis=0).tolist() == [[0.03, 0.01]]
    assert areas[shrunk].sum() == pytest.approx(abs(skirt.panels[0].area), rel=0.01)
    for text in ("front", f"{name}=much", "=0.1", "frnt=0.1"):
        run = CliRunner().invoke(app, ["dress", "skirt", "--body", "walker", "--shrinkage", text])
        assert run.exit_code == 2 and "--shrinkage" in run.output, run.output
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["good"]
