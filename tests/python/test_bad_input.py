# SPDX-License-Identifier: Apache-2.0
"""Whatever cannot be simulated is refused before any kernel runs, by a named error that says where."""

import inspect
import subprocess
import sys

import numpy as np
import pytest

import cama
from cama import motion
from conftest import grid


def cloth(change_vertices=None, change_faces=None, **options):
    """Builds a simulation of one sheet named "sheet", changed in place."""
    vertices, faces = grid(4)
    vertices = vertices if change_vertices is None else change_vertices(vertices)
    faces = faces if change_faces is None else change_faces(faces)
    scene = cama.Scene()
    scene.add_cloth(vertices, faces, name="sheet", **options)
    return cama.Simulation(scene)


def put(row, value):
    def change(array):
        array = array.copy()
        array[row] = value
        return array

    return change


def material(**changes):
    made = cama.Material.isotropic(1000, 0.3, 1e-5, 0.2)
    for name, value in changes.items():
        setattr(made, name, value)
    return made


def sheet_scene():
    scene = cama.Scene()
    scene.add_cloth(*grid(4), name="sheet")
    return scene


CASES = {
    "NaN": (cama.MeshError, ["sheet", "7"], lambda: cloth(put(7, np.nan))),
    "infinity": (cama.MeshError, ["sheet", "7"], lambda: cloth(put(7, np.inf))),
    "index out of range": (cama.MeshError, ["sheet", "3", "25"], lambda: cloth(None, put((3, 0), 25))),
    "negative index": (cama.MeshError, ["sheet", "3", "-1"], lambda: cloth(None, put((3, 0), -1))),
    "index beyond 32 bits": (cama.ArrayError, ["sheet", "faces", "row 3"], lambda: cloth(None, put((3, 0), 2**40))),
    "repeated index": (cama.MeshError, ["sheet", "3"], lambda: cloth(None, lambda f: put((3, 0), f[3, 1])(f))),
    "zero area": (cama.MeshError, ["sheet", "0"], lambda: cloth(lambda v: put(1, v[0])(v))),
    "isolated vertex": (cama.MeshError, ["sheet", "25"], lambda: cloth(lambda v: np.vstack([v, [[9, 9, 9]]]))),
    "duplicate face": (cama.MeshError, ["sheet", "32"], lambda: cloth(None, lambda f: np.vstack([f, f[5][[1, 2, 0]]]))),
    "empty mesh": (cama.MeshError, ["sheet"], lambda: cloth(lambda v: v[:0], lambda f: f[:0])),
    "no face": (cama.MeshError, ["sheet"], lambda: cloth(None, lambda f: f[:0])),
    "negative density": (
        cama.MaterialError,
        ["sheet", "density", "-0.1"],
        lambda: cloth(material=material(density=-0.1)),
    ),
    "NaN stiffness": (
        cama.MaterialError,
        ["sheet", "stretching"],
        lambda: cloth(material=material(stretching=[[np.nan] * 4] * 6)),
    ),
    "unknown fabric": (cama.MaterialError, ["tweed", "cotton"], lambda: cloth(material="tweed")),
    "flat vertices": (cama.ArrayError, ["sheet", "vertices", "[25, 2]"], lambda: cloth(lambda v: v[:, :2])),
    "quads": (cama.ArrayError, ["sheet", "faces", "[32, 4]"], lambda: cloth(None, lambda f: np.hstack([f, f[:, :1]]))),
    "text vertices": (cama.ArrayError, ["sheet", "vertices", "U"], lambda: cloth(lambda v: v.astype(str))),
    "complex vertices": (cama.ArrayError, ["sheet", "vertices", "complex"], lambda: cloth(lambda v: v + 0j)),
    "floating-point faces": (
        cama.ArrayError,
        ["sheet", "faces", "float64"],
        lambda: cloth(None, lambda f: f.astype(float)),
    ),
    "ragged faces": (cama.ArrayError, ["sheet", "faces"], lambda: cloth(None, lambda f: [[0, 1, 2], [3, 4]])),
    "material faces of another length": (
        cama.ArrayError,
        ["sheet", "material_faces"],
        lambda: cloth(material_vertices=np.zeros((3, 2)), material_faces=[[0, 1, 2]]),
    ),
    "missing mesh": (cama.FileError, ["nowhere.obj"], lambda: cama.Scene().add_cloth("nowhere.obj")),
    "missing scene": (cama.FileError, ["nowhere", "sphere"], lambda: cama.Scene.load("nowhere")),
    "unknown key": (
        cama.SceneError,
        ["gravitas"],
        lambda: cama.Scene.parse({"gravitas": 1, "cloth": [{"grid": {"size": [1, 1]}}]}),
    ),
    "unknown key of a cloth": (
        cama.SceneError,
        ["cloth[0]", "colour"],
        lambda: cama.Scene.parse({"cloth": [{"grid": {"size": [1, 1]}, "colour": "red"}]}),
    ),
    "not JSON": (cama.SceneError, ["JSON"], lambda: cama.Scene.parse("{")),
    "a key twice": (cama.SceneError, ["frames", "twice"], lambda: cama.Scene.parse('{"frames": 1, "frames": 2}')),
    "a number beyond double": (cama.SceneError, ["JSON"], lambda: cama.Scene.parse('{"frame_time": 1e400}')),
    "what JSON has not": (cama.SceneError, ["JSON", "object"], lambda: cama.Scene.parse({"cloth": object()})),
    "resolution beyond 32 bits": (cama.ArrayError, ["resolution"], lambda: cama.Scene.load("drape", 10**12)),
    "half a step": (cama.ArrayError, ["step", "1.5"], lambda: cama.Simulation(sheet_scene()).step(1.5)),
    "frames below none": (cama.ArrayError, ["frames", "-1"], lambda: list(cama.Simulation(sheet_scene()).frames(-1))),
    "no cloth": (cama.SceneError, ["cloth"], lambda: cama.Simulation(cama.Scene())),
    "negative time step": (cama.SceneError, ["time_step"], lambda: cama.Simulation(_with(time_step=-0.01))),
    "NaN gravity": (cama.ArrayError, ["gravity"], lambda: cama.Scene(gravity=(0, 0, np.nan))),
    "negative thickness": (cama.SceneError, ["thickness"], lambda: cama.Simulation(_with(thickness=-1e-3))),
    "pinned vertex out of range": (cama.SceneError, ["sheet", "99"], lambda: sheet_scene().pin("sheet", [0, 99])),
    "pin of no cloth": (cama.SceneError, ["curtain", "sheet"], lambda: sheet_scene().pin("curtain", [0])),
    "unknown wind key": (cama.SceneError, ["gust"], lambda: cama.Scene(wind={"gust": 1})),
    "unknown option": (cama.SceneError, ["speed", "tolerance"], lambda: cama.Simulation(sheet_scene(), speed=3)),
    "unknown preconditioner": (
        cama.SceneError,
        ["preconditioner", "magic", "block_jacobi"],
        lambda: cama.Simulation(sheet_scene(), preconditioner="magic"),
    ),
    "option of wrong type": (cama.SceneError, ["tolerance"], lambda: cama.Simulation(sheet_scene(), tolerance="low")),
    "unknown backend": (cama.BackendError, ["abacus", "cpu"], lambda: cama.Simulation(sheet_scene(), backend="abacus")),
    "unknown precision": (
        cama.SceneError,
        ["precision", "half"],
        lambda: cama.Simulation(sheet_scene(), precision="half"),
    ),
    "unknown accuracy": (
        cama.SceneError,
        ["accuracy", "perfect", "production"],
        lambda: cama.Simulation(sheet_scene(), accuracy="perfect"),
    ),
    "state of wrong shape": (
        cama.ArrayError,
        ["positions", "[3, 3]", "25"],
        lambda: cama.Simulation(sheet_scene()).set_state(np.zeros((3, 3)), np.zeros((3, 3))),
    ),
    "state with NaN": (
        cama.ArrayError,
        ["velocities", "row 4"],
        lambda: cama.Simulation(sheet_scene()).set_state(grid(4)[0], put(4, np.nan)(grid(4)[0])),
    ),
    "ccd of wrong shape": (
        cama.ArrayError,
        ["start", "[2, 3]"],
        lambda: cama.collision.vertex_face_ccd(np.zeros((2, 3)), np.zeros((2, 4, 3))),
    ),
    "ccd of two lengths": (
        cama.ArrayError,
        ["2", "3"],
        lambda: cama.collision.edge_edge_ccd(np.zeros((2, 4, 3)), np.zeros((3, 4, 3))),
    ),
    "ccd with NaN": (
        cama.ArrayError,
        ["end", "row 1"],
        lambda: cama.collision.vertex_face_ccd(np.zeros((2, 4, 3)), put(1, np.nan)(np.zeros((2, 4, 3)))),
    ),
    "ccd by magic": (
        cama.ArrayError,
        ["magic", "additive"],
        lambda: cama.collision.edge_edge_ccd([], [], method="magic"),
    ),
    "intersections out of range": (
        cama.MeshError,
        ["face 1", "9"],
        lambda: cama.collision.intersections(np.zeros((3, 3)), [[0, 1, 2], [0, 1, 9]]),
    ),
}


def _with(**fields):
    scene = sheet_scene()
    for name, value in fields.items():
        setattr(scene, name, value)
    return scene


@pytest.mark.parametrize("case", CASES)
def test_is_refused_by_name(case):
    error, words, attempt = CASES[case]
    with pytest.raises(error) as caught:
        attempt()
    assert isinstance(caught.value, cama.Error)
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize(
    "thing, field", [(cama.Material.fabric("silk"), "dampign"), (cama.Scene(), "gravitas"), (cama.Motion(), "speed")]
)
def test_a_field_that_is_not_there_is_no_new_one(thing, field):
    with pytest.raises(AttributeError, match=field):
        setattr(thing, field, 3)


def test_a_process_may_fork_after_simulating_on_one_thread():
    """As multiprocessing does by default: with threads of OpenMP's the child would wait for them for ever."""
    code = (
        "import os, cama\nscene = cama.Scene.load('drape', 1000)\n"
        "def run(**options):\n    s = cama.Simulation(scene, **options)\n    s.step(2)\n    return "
        "s.state_hash, s.count_intersections()\n"
        "before = run(backend='cpu')\nif os.fork() == 0:\n    print(run(backend='cpu', threads=1) == before, "
        "flush=True)\n    os._exit(0)\nos.wait()\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.stdout == "True\n", done


def test_every_error_is_one_family():
    for name in (
        "ArrayError",
        "BackendError",
        "CollisionError",
        "DeviceMemoryError",
        "FileError",
        "MaterialError",
        "MeshError",
        "SceneError",
        "SolverError",
    ):
        assert issubclass(getattr(cama, name), cama.Error)
        assert getattr(cama, name).__module__ == "cama"
    assert issubclass(cama.DeviceMemoryError, cama.BackendError) and issubclass(cama.ArrayError, ValueError)


@pytest.mark.parametrize(
    ("make", "error", "text"),
    [
        (lambda: cama.Simulation(None), cama.SceneError, "scene: None is neither a cama.Scene, a file"),
        (lambda: cama.Scene.load(3), cama.SceneError, "scene: 3 is neither"),
        (lambda: cama.Motion(keys=[{"t": 1}]), cama.SceneError, "key 0: 't' is not known; there are time, translation"),
        (lambda: cama.Motion(keys=[{"time": 0}, {"scale": 1}]), cama.SceneError, "key 1: has no time"),
        (lambda: cama.Motion(keys=[{"tme": 1}]), cama.SceneError, "did you mean 'time'"),
        (lambda: cama.Motion(keys=[1.0]), cama.SceneError, "key 0: 1.0 is not a dict with time"),
        (lambda: cama.Motion(keys=2), cama.SceneError, "keys: 2 is not a list of dicts"),
        (lambda: cama.Motion.of({"velocty": (1, 0, 0)}), cama.SceneError, "did you mean 'velocity'"),
        (lambda: cama.Motion.of({"keys": [{"t": 1}]}), cama.SceneError, "key 0: 't' is not known"),
        (lambda: cama.Material.fabric(3), cama.MaterialError, "3 is not the name of a fabric"),
        (lambda: cama.Material.load(3), cama.MaterialError, "3 is not the name of a file"),
    ],
)
def test_things_of_a_wrong_kind(make, error, text):
    with pytest.raises(error, match=text) as seen:
        make()
    assert "argument" not in str(seen.value)


def test_the_arguments_of_a_motion_are_all_known():
    """The list in error texts is that of the constructor."""
    names = tuple(inspect.signature(cama.Motion.__init__).parameters)[1:]
    assert names == motion.ARGUMENTS
    assert tuple(inspect.signature(cama.Motion._add_key).parameters)[2:] == motion.KEY


@pytest.mark.filterwarnings("ignore::cama.PlausibilityWarning")
def test_cloth_that_goes_astray_is_an_error_and_not_infinity():
    scene = cama.Scene(time_step=1 / 200)
    scene.add_cloth(shape={"grid": {"size": [0.2, 0.2], "cells": [3, 3]}}, velocity=(0, 0, 3e5), name="rocket")
    simulation = cama.Simulation(scene, accuracy="interactive", time_step=1 / 200)
    before = simulation.state_hash
    with pytest.raises(cama.SolverError, match=r"step 1: cloth 'rocket', vertex 15 moves at 3e\+05 m/s"):
        simulation.step()
    assert simulation.state_hash == before and simulation.step_count == 0


@pytest.mark.parametrize("name", ["contact", "self_contact"])
@pytest.mark.parametrize("value", [{"stiffness": 1e3}, {}, None, "off", 0])
def test_switches_of_a_scene_are_true_or_false(name, value):
    """Not the object that scene.json has at this key: it would be taken for True, and what it says ignored."""
    with pytest.raises(cama.SceneError, match=f"{name}: .* is not True or False; thickness, stiffness"):
        cama.Scene(**{name: value})
