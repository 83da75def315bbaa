# SPDX-License-Identifier: Apache-2.0
"""Values that are hardly meant are said, once and at the caller's line; what is usual is not."""

import json
import sys
import time
import warnings

import numpy as np
import pytest
from typer.testing import CliRunner

import cama
from cama import plausibility
from cama.cli import app
from conftest import grid


def apart(vertices, faces):
    """The same triangles, each with three vertices of its own."""
    return vertices[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3)


def material(**changes):
    given = {"youngs_modulus": 1000, "poisson_ratio": 0.3, "bending": 1e-5, "density": 0.2, **changes}
    return cama.Material.isotropic(**given)


def scene(size=1.0, mesh=None, obstacle=None, contact=True, **cloth):
    made = cama.Scene(contact=contact)
    vertices, faces = mesh or grid(8)
    made.add_cloth(vertices * size, faces, name="sheet", **cloth)
    if obstacle is not None:
        made.add_obstacle(name="ball", **obstacle)
    return made


def with_fields(made, **fields):
    for name, value in fields.items():
        setattr(made, name, value)
    return made


def ball(radius=0.25, **more):
    return {"shape": {"sphere": {"radius": radius, "triangles": 320}}, "translate": (0, 0, -2 * radius), **more}


def container():
    """A ball that is turned inward."""
    made = cama.Scene().add_obstacle(shape={"sphere": {"radius": 2, "triangles": 320}})
    return {"mesh": made.vertices, "faces": made.faces[:, ::-1]}


UV = grid(8)[0][:, :2]

# Each: what is said of which object, which words, and the scene.
CASES = {
    "a sheet of 1 m in centimetres": ("sheet", ["100 m", "centimetres", "0.01"], lambda: scene(100)),
    "a sheet of 1 m in millimetres": ("sheet", ["1000 m", "millimetres", "0.001"], lambda: scene(1000)),
    "a sheet of 1 m in kilometres": ("sheet", ["0.0005 m"], lambda: scene(0.0005, thickness=1e-7)),
    "a body of 1.7 m in centimetres": ("ball", ["170 m", "0.01"], lambda: scene(obstacle=ball(85))),
    "120 g/m^2": ("sheet", ["density", "120", "1000"], lambda: scene(material=material(density=120))),
    "density by volume": ("sheet", ["density", "400"], lambda: scene(material=material(density=400))),
    "grams per square millimetre": ("sheet", ["density"], lambda: scene(material=material(density=2e-4))),
    "Young's modulus in Pa": ("sheet", ["stretching", "Pa"], lambda: scene(material=material(youngs_modulus=1e9))),
    "stiffness in kN/mm": ("sheet", ["stretching", "MPa"], lambda: scene(material=material(youngs_modulus=0.001))),
    "bending in gf cm^2/cm": ("sheet", ["bending", "gf"], lambda: scene(material=material(bending=0.05))),
    "damping in ms": ("sheet", ["damping", "0.5 s"], lambda: scene(material=with_fields(material(), damping=0.5))),
    "mass damping in 1/minute": (
        "sheet",
        ["mass_damping", "60 1/s"],
        lambda: scene(material=with_fields(material(), mass_damping=60.0)),
    ),
    "a thickness of 1 m": ("sheet", ["thickness", "1 m"], lambda: scene(thickness=1.0)),
    "a thickness of 1 m of the scene": ("sheet", ["thickness", "scene"], lambda: with_fields(scene(), thickness=1.0)),
    "a thickness of 1 m of an obstacle": ("ball", ["thickness", "1 m"], lambda: scene(obstacle=ball(thickness=1.0))),
    "thicker than its edges are long": (
        "sheet",
        ["thickness", "edges", "0.0125"],
        lambda: scene(mesh=grid(80), thickness=0.09),
    ),
    "a start at 1e5 m/s": ("sheet", ["velocity", "1e+05 m/s"], lambda: scene(velocity=(0, 0, 1e5))),
    "an obstacle at 1000 mm/s": (
        "ball",
        ["motion", "1000 m/s"],
        lambda: scene(obstacle=ball(motion={"velocity": (1e3, 0, 0)})),
    ),
    "a turn in degrees per second": (
        "ball",
        ["motion", "radians"],
        lambda: scene(obstacle=ball(radius=1.0, motion={"rotation_rate": (0, 0, 720), "center": (0, 0, 0)})),
    ),
    "keys in millimetres": (
        "ball",
        ["motion", "1000 m/s"],
        lambda: scene(
            obstacle=ball(motion={"keys": [{"time": 0}, {"time": 2, "translation": (2000, 0, 0)}]}, friction=0.2)
        ),
    ),
    "a time step of 10 s": ("the scene", ["time_step", "10 s"], lambda: with_fields(scene(), time_step=10)),
    "a frame time in ms": ("the scene", ["frame_time", "16.67 s"], lambda: with_fields(scene(), frame_time=16.67)),
    "gravity in mm/s^2": ("the scene", ["gravity", "9810"], lambda: with_fields(scene(), gravity=(0, 0, -9810))),
    "wind in mm/s": (
        "the scene",
        ["wind.velocity", "6000"],
        lambda: with_fields(scene(), wind={"velocity": (6000, 0, 0), "density": 1.2}),
    ),
    "air in g/m^3": (
        "the scene",
        ["wind.density", "1200"],
        lambda: with_fields(scene(), wind={"velocity": (6, 0, 0), "density": 1200}),
    ),
    "inside a closed ball": (
        "sheet",
        ["inside", "obstacle 'ball'"],
        lambda: scene(obstacle={"shape": {"sphere": {"radius": 2, "triangles": 320}}}),
    ),
    "unwelded": (  # 128 triangles on 9 x 9 places
        "sheet",
        ["303 of 384", "coincide", "weld"],
        lambda: scene(mesh=apart(*grid(8)), contact=False),
    ),
    "an unwelded obstacle": (
        "ball",
        ["303 of 384", "coincide", "weld"],
        lambda: scene(obstacle=dict(zip(("mesh", "faces"), apart(*grid(8))), translate=(0, 0, -1))),
    ),
    "material vertices of twice the size": (  # edges twice as long, areas four times as large
        "sheet",
        ["material_vertices", "2 times", "4 times", "multiply them by 0.5"],
        lambda: scene(0.5, material_vertices=UV),
    ),
    "material vertices of half the size": (
        "sheet",
        ["0.5 times", "0.25 times", "multiply them by 2"],
        lambda: scene(material_vertices=0.5 * UV),
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_is_said_of_its_object(case):
    who, words, build = CASES[case]
    made = build()
    with pytest.warns(cama.PlausibilityWarning) as caught:
        cama.Simulation(made, backend="cpu", threads=1)
    assert len(caught) == 1, [str(w.message) for w in caught]
    text = str(caught[0].message)
    assert text.startswith(who if who == "the scene" else ("cloth" if who == "sheet" else "obstacle") + f" '{who}'")
    for word in words:
        assert word in text, text
    assert [str(f) for f in plausibility.findings(made)] == [text]


@pytest.mark.parametrize(
    "made",
    [
        lambda: scene(),
        lambda: scene(obstacle=ball()),
        lambda: scene(obstacle=ball(motion={"oscillation": (0, 0.2, 0), "period": 2})),
        lambda: scene(obstacle=container()),
        lambda: scene(obstacle={"shape": {"plane": {"size": [200, 200]}}, "translate": (0, 0, -1)}),  # a ground
        lambda: scene(obstacle={"shape": {"shape": {"plane": {}}}, "translate": (0, 0, -1)}),
        lambda: scene(
            obstacle={"shape": {"shape": {"capsule": {"radius": 0.1, "length": 1}}}, "translate": (0, 0, -1)}
        ),
        lambda: scene(material_vertices=1.3 * UV),
        lambda: scene(velocity=(0, 0, -30)),
        lambda: scene(material=material(density=0.02)),
        lambda: scene(material=material(density=2)),
        lambda: scene(material=material(youngs_modulus=4e4, bending=2e-4)),
        lambda: scene(material=material(bending=0)),
        lambda: with_fields(scene(), gravity=(0, 0, -24.8)),  # Jupiter's
        lambda: with_fields(scene(), gravity=(0, 0, 0), time_step=1 / 30),
        lambda: with_fields(scene(), wind={"velocity": (50, 0, 0), "density": 1.2}),
    ],
)
def test_what_is_usual_is_not_said(made):
    with warnings.catch_warnings():
        warnings.simplefilter("error", cama.PlausibilityWarning)
        cama.Simulation(made(), backend="cpu", threads=1)


@pytest.mark.parametrize("name", cama.scenes())
@pytest.mark.parametrize("resolution", [200, 0])
def test_shipped_scenes_are_plausible(name, resolution):
    assert plausibility.findings(cama.Scene.load(name, resolution)) == []


@pytest.mark.parametrize("fabric", cama.fabrics())
def test_shipped_fabrics_are_plausible(fabric):
    assert plausibility.findings(scene(material=fabric)) == []


def test_every_level_has_a_plausible_time_step():
    for level in cama.accuracy_levels():
        with warnings.catch_warnings():
            warnings.simplefilter("error", cama.PlausibilityWarning)
            cama.Simulation(scene(), backend="cpu", threads=1, accuracy=level)


def test_the_option_time_step_counts_too():
    with pytest.warns(cama.PlausibilityWarning, match="time_step: 10 s"):
        cama.Simulation(scene(), backend="cpu", threads=1, time_step=10)


def test_points_at_the_line_of_the_caller():
    with pytest.warns(cama.PlausibilityWarning) as caught:
        line = sys._getframe().f_lineno + 1
        cama.Simulation(scene(100), backend="cpu", threads=1)
    assert caught[0].filename == __file__ and caught[0].lineno == line


def test_python_filters_decide():
    assert issubclass(cama.PlausibilityWarning, Warning) and cama.PlausibilityWarning.__module__ == "cama"
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("ignore", cama.PlausibilityWarning)
        cama.Simulation(scene(100), backend="cpu", threads=1)
    assert caught == []
    with warnings.catch_warnings(), pytest.raises(cama.PlausibilityWarning):
        warnings.simplefilter("error", cama.PlausibilityWarning)
        cama.Simulation(scene(100), backend="cpu", threads=1)


def test_many_objects_are_one_warning():
    made = cama.Scene()
    for k in range(5):
        made.add_cloth(*grid(2, 100, z=10.0 * k))
    with pytest.warns(cama.PlausibilityWarning) as caught:
        cama.Simulation(made, backend="cpu", threads=1)
    assert len(caught) == 1 and "cloth 'cloth 0' (and 4 objects like it): vertices" in str(caught[0].message)


def test_vertices_that_stitches_join_may_coincide():
    """Two halves of a sheet, sewn at five places along the middle."""
    vertices, faces = grid(4)
    left = (vertices[faces].mean(axis=1)[:, 0] < 0).nonzero()[0]
    right = np.setdiff1d(np.arange(len(faces)), left)
    halves, joined, first = [], [], 0
    for part in (left, right):
        used, index = np.unique(faces[part], return_inverse=True)
        halves.append(vertices[used])
        joined.append(index.reshape(-1, 3) + first)
        first += len(used)
    mesh = np.concatenate(halves), np.concatenate(joined)
    made = scene(mesh=mesh, contact=False)
    assert [f.kind for f in plausibility.findings(made)] == ["unwelded cloth"]
    seam = np.flatnonzero(np.abs(mesh[0][:, 0]) < 1e-12)
    made.stitch("sheet", seam[:5], "sheet", seam[5:])
    assert plausibility.findings(made) == []


def test_a_start_refused_for_an_unwelded_mesh_says_so():
    made = scene(mesh=apart(*grid(8)))
    with pytest.raises(cama.CollisionError, match="303 of 384 vertices coincide.*weld=True.*starts with intersections"):
        cama.Simulation(made, backend="cpu", threads=1)
    crossing = scene()
    crossing.add_cloth(*grid(4), rotate=(0.7, 0.7, 0, 0), translate=(0.01, 0.02, 0.03))
    with pytest.raises(cama.CollisionError, match="^the scene starts with intersections"):
        cama.Simulation(crossing, backend="cpu", threads=1)


def write(tmp_path, **cloth):
    path = tmp_path / "skirt.json"
    given = {"name": "skirt", "grid": {"size": [60, 90], "cells": [4, 4]}, "material": "cotton", **cloth}
    path.write_text(json.dumps({"frames": 1, "cloth": [given]}))
    return path


def test_run_and_check_print_a_line_once(tmp_path, monkeypatch):
    monkeypatch.setenv("COLUMNS", "400")
    line = "cloth 'skirt': vertices: 90 m across; lengths are metres"
    for command in (["run", "-o", str(tmp_path / "out")], ["check"], ["explain"]):
        done = CliRunner().invoke(app, [*command, str(write(tmp_path))])
        said = done.output if command == ["check"] else done.stderr
        assert done.exit_code == 0 and said.count(line) == 1, done.output
        assert "PlausibilityWarning" not in done.output and "Traceback" not in done.output
        fine = CliRunner().invoke(app, [*command, str(write(tmp_path, grid={"size": [0.6, 0.9], "cells": [4, 4]}))])
        assert fine.exit_code == 0 and "metres" not in fine.output and "metres" not in fine.stderr


def test_costs_little():
    """20,000 triangles: at most a tenth of what it takes to build the simulation."""
    made = scene(mesh=grid(100), obstacle=ball())
    best = {}
    for name, work in (
        ("findings", lambda: plausibility.findings(made)),
        ("simulation", lambda: cama.Simulation(made, backend="cpu", threads=1)),
    ):
        times = []
        for _ in range(3):
            begin = time.perf_counter()
            work()
            times.append(time.perf_counter() - begin)
        best[name] = min(times)
    assert best["findings"] < 0.1 * best["simulation"], best


@pytest.mark.parametrize("options", [{"time_step": 0.005}, {"error": "1 mm"}])
@pytest.mark.filterwarnings("ignore::cama.PlausibilityWarning")
def test_a_frame_that_would_not_end_is_refused(options, tmp_path):
    """Steps alone are computed all the same."""
    simulation = cama.Simulation(with_fields(scene(), frame_time=1e9), accuracy="preview", **options)
    simulation.step()
    for begin in (simulation.step_frame, lambda: cama.record(simulation, tmp_path / "out")):
        with pytest.raises(cama.SceneError, match="frame_time: a frame of 1e.09 s takes"):
            begin()


def test_a_start_whose_energy_is_no_number_is_refused():
    """In single precision the stretching energy of this one was infinite."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 1.2e8]])
    scene = cama.Scene()
    scene.add_cloth(corners, [[0, 1, 2], [1, 3, 2]], material_vertices=corners[:, :2], name="sail")
    with pytest.raises(cama.MeshError, match="cloth 'sail': vertex 3 starts 1.2e.08 m from the others"):
        cama.Simulation(scene, accuracy="preview")
