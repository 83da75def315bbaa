# SPDX-License-Identifier: Apache-2.0
"""Data sets: the same seed gives the same bits, in any batch and after any kill; what is in the file; errors."""

import os
import signal
import subprocess
import sys
import time

import h5py
import numpy as np
import pytest

import cama
from conftest import count_intersections

FABRICS = ("cotton", "silk", "wool")


def draped(random):
    """A square of one of three fabrics, turned and shifted, above a ball."""
    scene = cama.Scene(thickness=1.5e-3, time_step=1 / 200, frame_time=0.05)
    fabric = int(random.integers(len(FABRICS)))
    turn, shift = random.uniform(0, np.pi / 2), random.uniform(-0.02, 0.02)
    scene.add_cloth(
        shape={"grid": {"size": [0.3, 0.3], "cells": [6, 6]}},
        material=FABRICS[fabric],
        rotate=(np.cos(turn / 2), 0, 0, np.sin(turn / 2)),
        translate=(shift, 0, 0.105),
    )
    scene.add_obstacle(shape={"shape": {"sphere": {"radius": 0.1}}}, friction=0.4)
    return scene, {"fabric": fabric, "turn": turn, "shift": shift}


def contents(path):
    """{dataset: array} of a file."""
    found = {}
    with h5py.File(path) as file:
        file.visititems(lambda name, item: found.update({name: item[()]}) if isinstance(item, h5py.Dataset) else None)
    return found


def same(one, other):
    assert one.keys() == other.keys()
    for name in one:
        np.testing.assert_array_equal(one[name], other[name], err_msg=name)


def test_a_sample_is_a_simulation_of_its_own_scene(tmp_path):
    cama.dataset.generate(tmp_path / "a.h5", draped, 5, seed=3, frames=4, batch=2, store="double", backend="cpu")
    found = contents(tmp_path / "a.h5")
    assert found["positions"].shape == (5, 5, 49 + 1, 3) and (found["sample"] == np.arange(5)).all()
    np.testing.assert_allclose(found["times"], [0, 0.05, 0.1, 0.15, 0.2])
    assert len(set(found["parameters/turn"])) == 5 and (found["intersections"] == 0).all()
    assert (found["error"] == b"").all()
    for k in range(5):
        own = np.random.Generator(np.random.PCG64(np.random.SeedSequence((3, k))))
        scene, parameters = draped(own)
        assert {name: found[f"parameters/{name}"][k] for name in parameters} == parameters
        alone = cama.Simulation(scene, backend="cpu")
        np.testing.assert_array_equal(found["positions"][k, 0], alone.positions)
        alone.step(40)
        np.testing.assert_array_equal(found["positions"][k, 4], alone.positions)
        assert count_intersections(found["positions"][k, 4], found["faces"][:72], 49) == 0
    assert os.listdir(tmp_path) == ["a.h5"]
    with h5py.File(tmp_path / "a.h5") as file:
        assert (file.attrs["seed"], file.attrs["cloth_vertices"], file.attrs["cloth_triangles"]) == (3, 49, 72)


def test_batches_and_ranges_change_no_bit(tmp_path):
    for name, samples, batch in (("a", 6, 1), ("b", 6, 6), ("c", range(4, 6), 64)):
        cama.dataset.generate(tmp_path / f"{name}.h5", draped, samples, seed=1, batch=batch, backend="cpu")
    a, b, c = (contents(tmp_path / f"{name}.h5") for name in "abc")
    same(a, b)
    assert (c["sample"] == [4, 5]).all()
    np.testing.assert_array_equal(c["positions"], a["positions"][4:])
    cama.dataset.generate(tmp_path / "d.h5", draped, 6, seed=2, backend="cpu")
    assert (contents(tmp_path / "d.h5")["parameters/turn"] != a["parameters/turn"]).all()


KILLED = """
import sys
sys.path.insert(0, sys.argv[2])
import cama, test_dataset
cama.dataset.generate(sys.argv[1], test_dataset.draped, 24, seed=5, frames=4, batch=2, backend="cpu", threads=1)
"""


def test_a_kill_loses_no_batch_and_halves_nothing(tmp_path):
    cama.dataset.generate(tmp_path / "whole.h5", draped, 24, seed=5, frames=4, backend="cpu")
    target = tmp_path / "killed.h5"
    call = [sys.executable, "-c", KILLED, str(target), os.path.dirname(__file__)]
    parts, most, kills = tmp_path / "killed.h5.parts", 0, 0
    for wait in (1, 2, 4, 7):  # batches that are there when the process is killed
        process = subprocess.Popen(call)
        while len(list(parts.glob("*.h5"))) < wait and process.poll() is None:
            time.sleep(0.002)
        if process.poll() is None:
            process.send_signal(signal.SIGKILL)
            kills += 1
        process.wait()
        there = len(list(parts.glob("*.h5")))
        assert there >= most, "a batch that was there is gone"
        most = there
    assert kills >= 2 and not target.exists()
    subprocess.run(call, check=True)
    same(contents(tmp_path / "whole.h5"), contents(target))
    assert not parts.exists()


def test_a_sample_that_fails_says_so_and_stops_no_other(tmp_path):
    def make(random):
        scene, parameters = draped(random)
        if parameters["fabric"] == 1:
            scene.cloths[0].velocity = (1e9, 0, 0)
        return scene, parameters

    cama.dataset.generate(tmp_path / "a.h5", draped, 8, backend="cpu")
    cama.dataset.generate(tmp_path / "b.h5", make, 8, backend="cpu")
    good, found = contents(tmp_path / "a.h5"), contents(tmp_path / "b.h5")
    failed = found["error"] != b""
    assert (failed == (found["parameters/fabric"] == 1)).all() and 0 < failed.sum() < 8
    assert np.isnan(found["positions"][failed, 1]).all()
    np.testing.assert_array_equal(found["positions"][~failed], good["positions"][~failed])


def test_the_example_writes_cloths_that_lie_on_a_ball(tmp_path):
    example = os.path.join(os.path.dirname(__file__), "..", "..", "examples", "08_dataset.py")
    subprocess.run([sys.executable, example, str(tmp_path / "a.h5"), "--samples", "4"], check=True, timeout=120)
    found = contents(tmp_path / "a.h5")
    cloth = found["positions"][:, 1, : 17 * 17].astype(float)
    assert (found["times"] == [0, 1]).all() and (found["intersections"] == 0).all()
    assert (np.linalg.norm(cloth, axis=2).min(axis=1) > 0.12).all(), "no vertex is in the ball"
    start = found["positions"][:, 0, : 17 * 17].astype(float).mean(axis=1)
    np.testing.assert_allclose(start[:, 0], found["parameters/x"], atol=1e-6)
    np.testing.assert_allclose(start[:, 1], found["parameters/y"], atol=1e-6)


def test_what_does_not_fit_is_an_error(tmp_path):
    def sizes(random):
        scene = cama.Scene()
        scene.add_cloth(shape={"grid": {"size": [0.3, 0.3], "cells": [int(random.integers(2, 9)), 2]}})
        return scene

    path = tmp_path / "a.h5"
    with pytest.raises(cama.ArrayError, match="sample 1: has other triangles than sample 0"):
        cama.dataset.generate(path, sizes, 4, backend="cpu")
    with pytest.raises(cama.ArrayError, match="same"):
        cama.dataset.generate(tmp_path / "b.h5", sizes, 4, batch=1, backend="cpu")
    with pytest.raises(cama.SceneError, match="was begun with other arguments .*seed"):
        cama.dataset.generate(path, sizes, 4, seed=1, backend="cpu")
    with pytest.raises(cama.SceneError, match="make returned int"):
        cama.dataset.generate(tmp_path / "c.h5", lambda random: 3, 4)
    with pytest.raises(cama.Error, match="sample 0: depth"):
        cama.dataset.generate(tmp_path / "c.h5", lambda random: (cama.Scene(), {"depth": "x"}), 4)
    for samples in (0, range(3, 3), range(-1, 3), range(0, 8, 2)):
        with pytest.raises(cama.SceneError, match="samples"):
            cama.dataset.generate(tmp_path / "d.h5", draped, samples)
    with pytest.raises(cama.SceneError, match="store"):
        cama.dataset.generate(tmp_path / "d.h5", draped, 1, store="half")
    (tmp_path / "e.h5").write_text("mine")
    with pytest.raises(cama.FileError, match=r"e\.h5: is there already"):
        cama.dataset.generate(tmp_path / "e.h5", draped, 1)
    assert (tmp_path / "e.h5").read_text() == "mine"


class Always:
    """Random numbers that are all 1."""

    def integers(self, end):
        return 1


def test_a_sample_that_starts_with_intersections_is_named_and_leaves_the_others(tmp_path):
    def make(random):
        fabric = int(random.integers(2))
        scene = cama.Scene(thickness=1.5e-3, time_step=1 / 200, frame_time=0.05)
        height = (0.105, 0.06)[fabric]  # the second through the ball
        scene.add_cloth(shape={"grid": {"size": [0.3, 0.3], "cells": [6, 6]}}, translate=(0, 0, height))
        scene.add_obstacle(shape={"shape": {"sphere": {"radius": 0.1}}})
        return scene, {"fabric": fabric}

    cama.dataset.generate(tmp_path / "a.h5", make, 8, seed=5, batch=8, backend="cpu")
    found = contents(tmp_path / "a.h5")
    crossing = np.array([int(cama.dataset.random(5, k).integers(2)) for k in range(8)], bool)
    assert 0 < crossing.sum() < 8
    assert [bool(text) for text in found["error"]] == crossing.tolist()
    assert (np.isnan(found["positions"]).any(axis=(1, 2, 3)) == crossing).all()
    assert ((found["intersections"] == -1) == crossing).all()
    with pytest.raises(cama.CollisionError, match="sample 0, and every other of its batch of 2: .*`make`"):
        cama.dataset.generate(tmp_path / "b.h5", lambda random: make(Always()), 2, backend="cpu")
    assert not (tmp_path / "b.h5").exists()
