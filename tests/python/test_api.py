# SPDX-License-Identifier: Apache-2.0
"""Scene, Simulation and their arrays."""

import copy
import pickle
import sys
import threading

import numpy as np
import pytest

import cama
from conftest import grid


def test_falls_freely(sheet):
    scene = cama.Scene(time_step=0.01, gravity=(0, 0, -10))
    scene.add_cloth(*sheet)
    simulation = cama.Simulation(scene, integrator="backward_euler", newton_iterations=1)
    simulation.step(20)
    # implicit Euler: v = g t, x = g dt^2 n (n + 1) / 2
    np.testing.assert_allclose(simulation.velocities, np.broadcast_to([0, 0, -2.0], (81, 3)), atol=1e-9)
    np.testing.assert_allclose(
        simulation.positions - sheet[0], np.broadcast_to([0, 0, -10 * 1e-4 * 210], (81, 3)), atol=1e-9
    )


def test_arrays_have_stated_shapes(falling):
    simulation = cama.Simulation(falling, threads=2)
    simulation.step(3)
    cloth, every = simulation.cloth_vertex_count, simulation.vertex_count
    assert cloth == 81 and every > cloth
    assert simulation.positions.shape == simulation.velocities.shape == (every, 3)
    assert simulation.positions.dtype == np.float64
    assert simulation.masses.shape == (cloth,)
    assert simulation.faces.dtype == np.int32 and simulation.faces.max() == every - 1
    assert simulation.cloth_triangle_count == 128 and (simulation.faces[:128] < cloth).all()
    assert simulation.cloth_ranges == [(0, cloth)] and simulation.obstacle_ranges == [(cloth, every)]
    assert simulation.step_count == 3 and simulation.time == pytest.approx(0.015)
    assert len(simulation.state_hash) == 16 and int(simulation.state_hash, 16) >= 0
    assert set(simulation.energy()) == {"kinetic", "stretching", "bending", "gravity", "gas"}
    assert (
        simulation.report["step"] == 3 and simulation.report["milliseconds"] > 0 and simulation.report["launches"] > 0
    )
    assert simulation.timings and all(ms >= 0 for ms in simulation.timings.values())
    assert simulation.explain() and all(len(row) == 2 for row in simulation.explain())
    assert simulation.streams and simulation.streams[0].keys() == {"name", "element", "size", "bytes"}
    assert simulation.peak_memory_bytes > 0 and simulation.backend and simulation.device


def test_contacts_describe_pairs(falling):
    simulation = cama.Simulation(falling)
    for _ in range(60):
        simulation.step()
        if len(simulation.contacts):
            break
    rows = simulation.contacts
    assert len(rows) == simulation.report["contacts"] > 0
    assert rows["vertices"].min() >= 0 and rows["vertices"].max() < simulation.vertex_count
    assert set(np.unique(rows["kind"])) <= {0, 1}
    np.testing.assert_allclose(np.linalg.norm(rows["normal"], axis=1), 1, atol=1e-6)
    np.testing.assert_allclose(rows["weights"].sum(axis=1), 0, atol=1e-6)


def test_frames_yields_what_it_says(falling):
    falling.frame_time = 0.01
    frames = list(cama.Simulation(falling).frames(3))
    assert [f.index for f in frames] == [1, 2, 3]
    assert [f.time for f in frames] == pytest.approx([0.01, 0.02, 0.03])
    assert all(f.intersections == 0 and f.positions.shape[1] == 3 for f in frames)
    assert frames[0].report["step"] == 2


def test_pins_take_numbers_one_number_and_masks(sheet):
    scene = cama.Scene()
    cloth = scene.add_cloth(*sheet)
    ball = scene.add_obstacle(shape={"sphere": {"radius": 0.1}})
    left = sheet[0][:, 0] == -0.5  # a sheet of 9 x 9 vertices, x first: its first nine
    scene.pin(cloth, left)
    scene.pin(cloth, 80)
    scene.pin(cloth, np.int64(3))
    scene.attach(cloth, list(left), ball)
    scene.pin(cloth, np.zeros(81, bool))
    assert [p["vertices"].tolist() for p in scene.pins] == [[*range(9)], [80], [3], [*range(9)], []]
    with pytest.raises(cama.ArrayError, match=r"cloth 0: vertices: a mask of shape \[80\], expected \[81\]"):
        scene.pin(cloth, left[:80])
    with pytest.raises(cama.SceneError, match="vertex 81"):
        scene.pin(cloth, 81)
    with pytest.raises(cama.ArrayError, match="float64"):
        scene.pin(cloth, 0.5)


def test_pins_hold_and_move_and_let_go(sheet):
    scene = cama.Scene(time_step=0.01)
    cloth = scene.add_cloth(*sheet)
    scene.pin(cloth, [0])
    scene.pin(cloth, [8], motion=cama.Motion(velocity=(0, 0, 0.5)))
    scene.pin(cloth, np.array([72]), release=0.05)
    simulation = cama.Simulation(scene)
    simulation.step(20)
    moved = simulation.positions - sheet[0]
    np.testing.assert_array_equal(moved[0], 0)
    np.testing.assert_allclose(moved[8], [0, 0, 0.1], atol=1e-12)
    assert moved[72, 2] < -1e-4
    assert [len(p["vertices"]) for p in scene.pins] == [1, 1, 1]


def test_attached_vertices_follow_the_obstacle(sheet):
    scene = cama.Scene(time_step=0.01)
    cloth = scene.add_cloth(*grid(6, 0.5, z=0.12))
    bar = scene.add_obstacle(shape={"box": {"size": [0.2, 0.2, 0.2]}}, motion={"velocity": (0.3, 0, 0)})
    scene.attach(cloth, [24], bar)
    simulation = cama.Simulation(scene)
    before = simulation.positions[24]
    simulation.step(10)
    np.testing.assert_allclose(simulation.positions[24] - before, [0.03, 0, 0], atol=1e-9)


def test_stitches_pull_together(sheet):
    scene = cama.Scene(gravity=(0, 0, 0), time_step=0.01, contact=False)
    a, b = scene.add_cloth(*sheet), scene.add_cloth(sheet[0] + [1.02, 0, 0], sheet[1])
    right = np.flatnonzero(sheet[0][:, 0] > 0.499)
    left = np.flatnonzero(sheet[0][:, 0] < -0.499)
    scene.stitch(a, right, b, left)
    assert scene.stitch_count == len(right)
    simulation = cama.Simulation(scene)
    simulation.step(100)
    x = simulation.positions
    assert np.linalg.norm(x[right] - x[81 + left], axis=1).max() < 0.01


def test_set_state_is_read_back(sheet):
    scene = cama.Scene()
    scene.add_cloth(*sheet)
    simulation = cama.Simulation(scene)
    x, v = sheet[0] + [0, 0, 1], np.full_like(sheet[0], 0.25)
    simulation.set_state(x, v)
    np.testing.assert_array_equal(simulation.positions, x)
    np.testing.assert_array_equal(simulation.velocities, v)


def test_set_state_refuses_positions_that_intersect(sheet):
    scene = cama.Scene()
    scene.add_cloth(*sheet, name="low")
    scene.add_cloth(sheet[0] + [0, 0, 0.1], *sheet[1:], name="high")
    simulation = cama.Simulation(scene)
    n, before = len(sheet[0]), simulation.state_hash
    crossed = simulation.positions.copy()
    crossed[n] -= [0, 0, 0.2]  # a corner of the upper sheet goes through the lower one
    with pytest.raises(
        cama.CollisionError, match="intersection.* 'low'.* 'high'|intersection.* 'high'.* 'low'"
    ) as error:
        simulation.set_state(crossed, np.zeros_like(crossed))
    assert "exempt" in str(error.value) and simulation.state_hash == before
    free = cama.Simulation(scene, intersections="exempt")
    free.set_state(crossed, np.zeros_like(crossed))
    np.testing.assert_array_equal(free.positions, crossed)
    alone = cama.Scene(self_contact=False)
    alone.add_cloth(*sheet)
    folded = sheet[0] * [1, 0, 1]  # nothing can touch
    cama.Simulation(alone).set_state(folded, np.zeros_like(folded))


def test_set_state_refuses_cloth_below_a_plane(sheet):
    scene = cama.Scene()
    scene.add_cloth(sheet[0] + [0, 0, 1], *sheet[1:], name="sheet")
    scene.add_obstacle(shape={"shape": {"plane": {}}}, name="floor")
    simulation = cama.Simulation(scene)
    below = simulation.positions[: simulation.cloth_vertex_count] - [0, 0, 2]
    with pytest.raises(cama.CollisionError, match="vertex 0 of cloth 'sheet' is below obstacle 'floor'"):
        simulation.set_state(below, np.zeros_like(below))


def test_same_hash_twice_and_on_more_threads(falling):
    hashes = set()
    for threads in (1, 1, 2):
        simulation = cama.Simulation(falling, backend="cpu", threads=threads)
        simulation.step(20)
        hashes.add(simulation.state_hash)
    assert len(hashes) == 1


def test_save_and_load_give_the_same_scene(falling, tmp_path):
    falling.wind = {"velocity": (1, 0, 0), "drag": 0.1}
    falling.pin("sheet", [0, 80])
    falling.save(tmp_path / "scene.json")
    again = cama.Scene.load(tmp_path / "scene.json")
    assert again.to_json() == falling.to_json()
    assert again.wind == {"velocity": (1, 0, 0), "density": 1.2, "drag": 0.1}
    a, b = cama.Simulation(falling), cama.Simulation(again)
    a.step(5), b.step(5)
    assert a.state_hash == b.state_hash


def test_a_scene_is_copied_and_pickled_whole(falling):
    scene, hashes = falling, set()
    for again in (scene, scene.copy(), copy.copy(scene), copy.deepcopy(scene), pickle.loads(pickle.dumps(scene))):
        simulation = cama.Simulation(again, threads=1)
        simulation.step(5)
        hashes.add(simulation.state_hash)
    assert len(hashes) == 1
    other = copy.copy(scene)
    other.gravity = (0, 0, 1)
    assert tuple(scene.gravity) != (0, 0, 1)
    for way in (pickle.dumps, copy.copy, copy.deepcopy):
        with pytest.raises(TypeError, match="save_checkpoint"):
            way(simulation)


def test_material_space_is_the_rest_state(sheet):
    vertices, faces = sheet
    scene = cama.Scene(gravity=(0, 0, 0), time_step=1 / 240)
    cloth = scene.add_cloth(vertices * [1.1, 1, 1], faces, material_vertices=vertices[:, :2])
    np.testing.assert_allclose(cloth.material_vertices, vertices[:, :2])
    simulation = cama.Simulation(scene)
    assert simulation.max_strain == pytest.approx(0.1)
    simulation.step(3)
    assert simulation.max_strain < 0.09


def test_obj_files_load(sheet, tmp_path):
    lines = [f"v {x} {y} {z}" for x, y, z in sheet[0]] + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in sheet[1]]
    (tmp_path / "sheet.obj").write_text("\n".join(lines))
    scene = cama.Scene()
    cloth = scene.add_cloth(tmp_path / "sheet.obj", material="denim", thickness=2e-3, translate=(0, 0, 1))
    assert cloth.material.name == "denim" and cloth.material.thickness == 2e-3
    np.testing.assert_allclose(cloth.vertices, sheet[0] + [0, 0, 1], atol=1e-6)


def test_placement_rotates_then_translates(sheet):
    scene = cama.Scene()
    cloth = scene.add_cloth(*sheet, rotate=(np.sqrt(0.5), np.sqrt(0.5), 0, 0), translate=(0, 0, 2))
    expected = np.stack([sheet[0][:, 0], 0 * sheet[0][:, 0], sheet[0][:, 1] + 2], axis=1)
    np.testing.assert_allclose(cloth.vertices, expected, atol=1e-12)


def test_vertex_animation_moves_an_obstacle(sheet):
    scene = cama.Scene(time_step=0.01)
    scene.add_cloth(*grid(4, z=1))
    vertices, faces = sheet
    motion = cama.Motion(times=[0, 1], positions=np.stack([vertices, vertices + [0, 0, 0.5]]))
    scene.add_obstacle(vertices, faces, motion=motion, translate=(0, 0, -1))
    simulation = cama.Simulation(scene)
    simulation.step(10)
    np.testing.assert_allclose(simulation.positions[25:], vertices + [0, 0, -0.95], atol=1e-12)


def test_threads_may_ask_while_another_steps(falling):
    simulation = cama.Simulation(falling, threads=1)
    worker = threading.Thread(target=simulation.step, args=(30,))
    worker.start()
    while worker.is_alive():
        assert np.isfinite(simulation.positions).all()
    worker.join()
    assert simulation.step_count == 30


def test_every_public_name_has_a_docstring():
    for name in cama.__all__:
        thing = getattr(cama, name)
        assert thing.__doc__, name
        classes = thing.__mro__ if isinstance(thing, type) else ()
        written = [one for one in classes if one.__module__.startswith("cama.") and one.__module__ != "cama._core"]
        for part, member in (row for one in written for row in vars(one).items()):
            if not part.startswith("_") and (callable(member) or isinstance(member, property)):
                assert member.__doc__, f"{name}.{part}"


def test_backends_and_fabrics_are_listed():
    assert "cpu" in [b["name"] for b in cama.backends() if b["available"]]
    assert "cotton" in cama.fabrics()


def test_auto_is_the_best_backend_that_works(monkeypatch):
    scene = cama.Scene()
    scene.add_cloth(shape={"grid": {"size": [0.1, 0.1], "cells": [1, 1]}})
    monkeypatch.setenv("CAMA_BACKEND", "opencl")
    assert cama.Simulation(scene).backend == "opencl"
    monkeypatch.delenv("CAMA_BACKEND")
    available = [backend["name"] for backend in cama.backends() if backend["available"]]
    chosen = cama.Simulation(scene)
    if "cuda" in available:
        assert chosen.backend == "cuda"
    else:  # pocl, an OpenCL device that is the CPU itself, gains nothing
        assert chosen.backend == "cpu" or (chosen.backend == "opencl" and "Portable" not in chosen.device)


def test_a_step_from_python_is_few_calls():
    """At most ten, of which one does the step: what a step costs beyond its stages, 20 to 60 us, is theirs."""
    scene = cama.Scene(time_step=1 / 240)
    scene.add_cloth(shape={"grid": {"size": [0.4, 0.4], "cells": [16, 16]}}, name="towel")
    simulation = cama.Simulation(scene, backend="cpu", threads=1)
    simulation.step()
    calls = []
    sys.setprofile(lambda frame, event, function: calls.append(event) if "return" not in event else None)
    try:
        simulation.step()
    finally:
        sys.setprofile(None)
    assert 1 < len(calls) <= 10
