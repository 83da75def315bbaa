# SPDX-License-Identifier: Apache-2.0
"""Elastics: a band under a load and a ring around a cylinder in closed form, slack ones, backends, files, patterns."""

import json
import math

import numpy as np
import pytest

import cama

pytestmark = pytest.mark.filterwarnings("ignore::cama.PlausibilityWarning")  # cloth that is to carry nothing

STIFFNESS, LENGTH, WIDTH = 20.0, 0.4, 0.05  # N, m, m
SOFT = 0.1  # N/m, of the cloth, which is to carry nothing


def band(cells=8, **scene):
    """A narrow upright band that hangs by its upper edge, without gravity."""
    made = cama.Scene(gravity=(0, 0, 0), contact=False, **scene)
    material = cama.Material.isotropic(SOFT, 0.0, 0.0, 0.1)
    material.mass_damping = 15.0
    shape = {"grid": {"size": [WIDTH, LENGTH], "cells": [1, cells], "plane": "xz"}}
    cloth = made.add_cloth(shape=shape, material=material, name="band")
    height = cloth.vertices[:, 2]
    made.pin("band", np.flatnonzero(height > height.max() - 1e-9))
    return made


def sides(scene):
    """The two long sides of the band, each a line of vertices from the top."""
    x = scene.cloths[0].vertices
    lines = [np.flatnonzero(np.abs(x[:, 0] - value) < 1e-9) for value in (x[:, 0].min(), x[:, 0].max())]
    return [line[np.argsort(-x[line, 2])] for line in lines]


def length_of(simulation, line):
    return float(np.linalg.norm(np.diff(simulation.positions[line], axis=0), axis=1).sum())


@pytest.mark.parametrize("share", [1.0, 0.8])
@pytest.mark.parametrize("load", [0.5, 4.0])
@pytest.mark.parametrize("options", [{}, {"integrator": "backward_euler", "newton_iterations": 1}])
def test_a_band_stretches_by_force_times_length_over_stiffness(share, load, options):
    scene = band()
    lines = sides(scene)
    for line in lines:
        scene.elastic("band", line, length=share, stiffness=STIFFNESS)
    simulation = cama.Simulation(scene, error="", time_step=1 / 200, backend="cpu", threads=1, **options)
    simulation.set_force([line[-1] for line in lines], (0, 0, -load))
    simulation.step(600)
    for line in lines:
        assert length_of(simulation, line) == pytest.approx(share * LENGTH * (1 + load / STIFFNESS), rel=2e-3)


def test_a_ring_presses_a_cylinder_with_its_tension_over_the_radius():
    """The normal forces of the whole ring are T/R times its length 2 pi R: 2 pi T.

    The contact is stiff enough to carry them within its thickness.
    """
    share, radius = 0.8, 0.1
    material = cama.Material.isotropic(SOFT, 0.0, 0.0, 0.1)
    material.mass_damping = 15.0
    tube = {"radius": radius + 0.004, "height": 0.02}
    pole = {"capsule": {"points": [[0, 0, -1], [0, 0, 1]], "radius": radius}}
    elastic = {"cloth": "ring", "edge": "top", "length": share, "stiffness": STIFFNESS}
    scene = cama.Scene.parse(
        {
            "gravity": [0, 0, 0],
            "contact": {"thickness": 1e-3, "stiffness": 1e8, "friction": 0.0, "self": False},
            "obstacles": [{"name": "pole", "friction": 0.0, "shape": pole}],
            "cloth": [{"name": "ring", "tube": tube, "triangles": 160}],
            "elastics": [elastic],
        }
    )
    scene.cloths[0].material = material
    top = np.flatnonzero(scene.cloths[0].vertices[:, 2] > 0.02 - 1e-9)
    assert scene.stitch_count == len(top)
    line = top[np.argsort(np.arctan2(*scene.cloths[0].vertices[top, :2].T[::-1]))]
    line = np.r_[line, line[:1]]
    rest = share * 2 * math.pi * tube["radius"]  # of the cloth's rest shape, which is unrolled
    simulation = cama.Simulation(scene, error="", time_step=1 / 200, backend="cpu", threads=1, forces=True)
    simulation.step(300)
    tension = STIFFNESS * (length_of(simulation, line) / rest - 1)
    assert radius < length_of(simulation, line) / (2 * math.pi) < radius + 1.2e-3  # it lies on the cylinder
    contacts = simulation.contacts
    assert contacts["normal_force"].sum() == pytest.approx(2 * math.pi * tension, rel=0.02)


def test_a_slack_elastic_does_not_push():
    """Its rest length is 1.5 times the line's: the cloth stays at rest."""
    scene = band()
    for line in sides(scene):
        scene.elastic("band", line, length=1.5, stiffness=STIFFNESS)
    simulation = cama.Simulation(scene, time_step=1 / 200, backend="cpu", threads=1)
    simulation.step(20)
    np.testing.assert_allclose(simulation.positions, scene.cloths[0].vertices, atol=1e-9)


@pytest.mark.parametrize("precision", ["double", "mixed", "single"])
def test_an_elastic_has_the_same_bits_on_every_backend(precision):
    states = []
    for backend in ("cpu", "opencl"):
        scene = band()
        for line in sides(scene):
            scene.elastic("band", line, length=0.8, stiffness=STIFFNESS)
        scene.gravity = (0, 1, -9.81)
        simulation = cama.Simulation(scene, time_step=1 / 200, backend=backend, precision=precision)
        simulation.step(10)
        states.append(simulation.positions.copy())
    assert np.array_equal(*states)
    assert np.ptp(states[0][:, 2]) < 0.99 * LENGTH


def test_elastics_are_in_scene_files():
    cloth = {"name": "sheet", "grid": {"size": [0.2, 0.1], "cells": [4, 2]}, "shrinkage": [0.1, 0]}
    by_edge = {"cloth": "sheet", "edge": "bottom", "length": 0.5, "stiffness": 3}
    scene = cama.Scene.parse({"cloth": [cloth], "elastics": [by_edge]})
    stitches = json.loads(scene.to_json())["stitches"]
    assert [s["length"] for s in stitches] == pytest.approx([0.5 * 0.9 * 0.05] * 4)  # an open edge, shrunk
    assert [s["stiffness"] for s in stitches] == pytest.approx([3 / (0.5 * 0.9 * 0.05)] * 4)
    again = cama.Scene.parse(scene.to_json())
    assert json.loads(again.to_json())["stitches"] == stitches
    bottom = np.flatnonzero(scene.cloths[0].vertices[:, 1] < -0.05 + 1e-9)
    bottom = bottom[np.argsort(scene.cloths[0].vertices[bottom, 0])]
    given = {"cloth": 0, "vertices": bottom.tolist(), "length": 0.5, "stiffness": 3}
    assert json.loads(cama.Scene.parse({"cloth": [cloth], "elastics": [given]}).to_json())["stitches"] == stitches


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"edge": "waist"}, r"elastics\[0\].edge: cloth \"sheet\" has no vertices of that name; it has: bottom"),
        ({"edge": None, "vertices": [0, 14]}, "vertices 0 and 14, one after the other, have no edge between them"),
        ({"edge": None, "vertices": [0, 99]}, "vertices 0 and 99, one after the other, have no edge between them"),
        ({"edge": "top_left"}, "a line needs two vertices at least"),
        ({"edge": None}, r"elastics\[0\]: needs one of edge and vertices"),
        ({"length": 0}, "length is 0.*; give a share of the line's, greater than 0"),
        ({"stiffness": -1}, "stiffness is -1.*; give N, greater than 0"),
        ({"cloth": "shirt"}, r"elastics\[0\].cloth: no cloth \"shirt\""),
        ({"tension": 1}, r"elastics\[0\]: unknown key \"tension\""),
    ],
)
def test_bad_elastics_are_named(change, text):
    cloth = {"name": "sheet", "grid": {"size": [0.2, 0.1], "cells": [4, 2]}}
    elastic = {"cloth": "sheet", "edge": "bottom", "length": 0.5, "stiffness": 3, **change}
    with pytest.raises(cama.SceneError, match=text):
        cama.Scene.parse({"cloth": [cloth], "elastics": [{k: v for k, v in elastic.items() if v is not None}]})


def test_python_names_what_is_wrong():
    scene = band()
    with pytest.raises(cama.ArrayError, match="elastic: stiffness"):
        scene.elastic("band", [0, 1], length=1, stiffness=float("nan"))
    with pytest.raises(cama.SceneError, match="elastic: band: vertex 99"):
        scene.elastic("band", [0, 99], length=1, stiffness=1)
    with pytest.raises(cama.SceneError, match="have no edge between them"):
        scene.elastic("band", [0, 17], length=1, stiffness=1)
    assert scene.stitch_count == 0


def pattern(**more):
    skirt = json.loads((cama.shipped.folder() / "patterns" / "skirt.json").read_text())
    return cama.SewingPattern.parse({**skirt, **more})


def test_patterns_have_elastics(tmp_path):
    hem = {"edge": "front.hem", "length": 0.6, "stiffness": 20}
    made = cama.dress(pattern(elastics=[hem]), {"walker": {}}, triangles=300, output=tmp_path, backend="cpu")
    plain = cama.dress(pattern(), {"walker": {}}, triangles=300, backend="cpu")
    assert made.verdict.good and plain.verdict.good, (made.verdict, plain.verdict)
    lengths = []
    for each in (made, plain):
        line = each.vertex_of[made.mesh.elastic_lines[0]]
        lengths.append(np.linalg.norm(np.diff(each.positions[line], axis=0), axis=1).sum())
    assert 0.6 * lengths[1] < lengths[0] < 0.95 * lengths[1]
    edges = len(made.mesh.elastic_lines[0]) - 1
    assert made.scene.stitch_count == edges and plain.scene.stitch_count == 0
    assert cama.Scene.load(tmp_path).stitch_count == edges


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"edge": "front.wais"}, "elastic 0: panel 'front' has no edge 'wais'"),
        ({"length": 0}, "elastic 0: length: 0 must be greater than 0"),
        ({"stiffness": "much"}, "elastic 0: stiffness: much is not a finite number"),
        ({"width": 1}, "elastic 0: unknown key 'width'"),
    ],
)
def test_bad_elastics_of_patterns_are_named(change, text):
    with pytest.raises(cama.SceneError, match=text):
        pattern(elastics=[{"edge": "front.waist", "length": 0.8, "stiffness": 20, **change}])
