# SPDX-License-Identifier: Apache-2.0
"""Worlds from Python: copies and variants of a scene, arrays over worlds, failures and resets."""

import signal
import threading

import numpy as np
import pytest

import cama
from conftest import count_intersections, grid

BALL = {"shape": {"sphere": {"radius": 0.1}}}


def scene(cells=6, height=0.11):
    made = cama.Scene()
    made.add_cloth(*grid(cells, 0.3, height), name="sheet", material="cotton")
    made.add_obstacle(shape=BALL, name="ball")
    return made


def vary(own, world):
    own.cloths[0].velocity = (0.2 * world, 0, 0)


def backends():
    wanted = ("cpu", "opencl")
    here = {row["name"] for row in cama.backends() if row["available"]}
    return [pytest.param(b, marks=() if b in here else pytest.mark.skip(reason=f"no {b} here")) for b in wanted]


def test_ctrl_c_ends_many_steps_and_keeps_every_world():
    worlds, wanted = cama.Worlds(scene(2), 2, backend="cpu"), 400_000
    timer = threading.Timer(0.2, lambda: signal.raise_signal(signal.SIGINT))
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        worlds.step(wanted)
    timer.join()
    done = worlds[0].step_count
    assert 0 < done < wanted and worlds[1].step_count == done
    worlds.step(3)
    assert [world.step_count for world in worlds] == [done + 3] * 2


@pytest.mark.parametrize("backend", backends())
def test_every_world_equals_its_scene_alone(backend):
    worlds = cama.Worlds(scene(), 16, vary, backend=backend)
    assert len(worlds) == 16
    worlds.step(10)
    for number, world in enumerate(worlds):
        own = scene()
        vary(own, number)
        alone = cama.Simulation(own, backend=backend)
        alone.step(10)
        assert world.state_hash == alone.state_hash, number
        assert world.scene.cloths[0].velocity == (0.2 * number, 0, 0)
    assert len({world.state_hash for world in worlds}) == 16
    assert worlds.positions.shape == (16, worlds[0].vertex_count, 3)
    np.testing.assert_array_equal(worlds.positions[5], worlds[5].positions)
    np.testing.assert_array_equal(worlds.velocities[5], worlds[5].velocities)
    assert sum(world.report["contacts"] for world in worlds) > 16
    for world in worlds:
        assert world.count_intersections() == 0
        assert count_intersections(world.positions, world.faces[: world.cloth_triangle_count], 10**9) == 0


def test_worlds_of_different_sizes_are_lists():
    worlds = cama.Worlds([scene(4), scene(6)], backend="cpu")
    worlds.step()
    assert [len(rows) for rows in worlds.positions] == [25 + 1, 49 + 1]  # an exact sphere has its centre
    np.testing.assert_array_equal(worlds.positions[1], worlds[1].positions)


def test_a_frame_has_the_steps_of_a_simulation_alone():
    worlds = cama.Worlds(scene(), 2, backend="cpu", accuracy="production")
    worlds.step_frame()
    alone = cama.Simulation(scene(), backend="cpu", accuracy="production")
    alone.step_frame()
    assert worlds[1].state_hash == alone.state_hash
    np.testing.assert_allclose(worlds.times, alone.scene.seconds_per_frame)


def test_state_and_reset_of_some_worlds():
    worlds = cama.Worlds(scene(), 3, vary, backend="cpu")
    start = worlds.positions[:, :49]
    worlds.step(2)
    worlds.set_state([start[0], start[2]], np.full((2, 49, 3), 0.5), worlds=[0, 2])
    np.testing.assert_array_equal(worlds[2].positions[:49], start[2])
    np.testing.assert_array_equal(worlds[0].velocities[:49], np.full((49, 3), 0.5))
    assert worlds[1].step_count == 2 and worlds[1].time > 0
    worlds[1].gravity = (0, 0, 0)
    worlds.reset(np.array([False, True, False]))
    assert worlds[1].step_count == 0 and worlds[1].gravity == pytest.approx((0, 0, -9.81), abs=0.01)
    worlds.reset()
    worlds.step(3)
    fresh = cama.Worlds(scene(), 3, vary, backend="cpu")
    fresh.step(3)
    assert [w.state_hash for w in worlds] == [w.state_hash for w in fresh]


def test_a_failed_world_is_frozen_and_says_why():
    worlds = cama.Worlds(scene(), 3, backend="cpu")
    worlds.step()
    worlds[1].set_force([0, 1], (1e12, 0, 0))
    worlds.step(2)
    assert worlds.frozen == [1]
    assert worlds[1].step_count == 1 and worlds[0].step_count == 3
    assert isinstance(worlds.error(1), cama.SolverError) and str(worlds.error(1)).startswith("world 1: step 2")
    assert worlds.error(0) is None
    worlds.reset(1)
    worlds.step()
    assert worlds.frozen == [] and worlds.error(1) is None
    assert "0 frozen" in repr(worlds)


def test_bad_arguments_name_the_world():
    with pytest.raises(cama.SceneError, match="worlds: has no scene"):
        cama.Worlds([], backend="cpu")
    with pytest.raises(cama.SceneError, match="number is for copies"):
        cama.Worlds([scene()], 2, backend="cpu")
    other = scene()
    other.time_step = -1
    with pytest.raises(cama.SceneError, match="world 1: "):
        cama.Worlds([scene(), other], backend="cpu")
    worlds = cama.Worlds(scene(), 2, backend="cpu")
    for bad in (2, -1, [0, 5], [0.5], [1, 1], [True]):
        with pytest.raises(cama.ArrayError):
            worlds.reset(bad)
    with pytest.raises(cama.ArrayError, match="of world 1"):
        worlds.set_state([worlds[0].positions[:49], np.zeros((3, 3))], np.zeros((2, 49, 3)))
    with pytest.raises(TypeError, match="pickled"):
        worlds.__reduce__()
    world = worlds[1]
    del worlds
    world.step()
    assert world.step_count == 1
