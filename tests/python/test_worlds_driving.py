# SPDX-License-Identifier: Apache-2.0
"""Arrays over worlds: driving and measuring many worlds at once gives the bits of doing it one by one."""

import gc

import numpy as np
import pytest

import cama
from conftest import grid
from test_worlds import backends

COUNT = 5
CLOTH = 49  # vertices
HELD = [0, 6]


def scene(cells=6):
    made = cama.Scene()
    made.add_cloth(*grid(cells, 0.3, 0.11), name="sheet", material="cotton")
    made.add_obstacle(shape={"sphere": {"radius": 0.1, "triangles": 80}}, name="ball")
    made.wind = {"velocity": (0, 0, 0), "density": 1.2}
    return made


def make(count=COUNT, backend="cpu", cells=6, **options):
    given = {"backend": backend, "accuracy": "interactive", "time_step": 1 / 200, "forces": True, **options}
    if isinstance(cells, tuple):
        return cama.Worlds([scene(n) for n in cells], **given)
    return cama.Worlds(scene(cells), count, **given)


def hashes(worlds):
    return [world.state_hash for world in worlds]


@pytest.mark.parametrize("backend", backends())
def test_driving_all_worlds_at_once_gives_the_bits_of_driving_each(backend):
    together, apart = make(backend=backend), make(backend=backend)
    rng = np.random.default_rng(4)
    corners = together.positions[:, HELD]
    targets = corners + rng.uniform(0, 0.004, corners.shape)
    forces = 1e-3 * rng.normal(size=(COUNT, 4, 3))
    heights = np.linspace(0, 0.002, COUNT)
    translations = np.stack([0 * heights, 0 * heights, heights], 1)
    angles = np.linspace(0, 0.02, COUNT)
    rotations = np.stack([np.cos(angles), 0 * angles, 0 * angles, np.sin(angles)], 1)
    gravity, wind = rng.normal(size=(2, COUNT, 3))
    some = [3, 1]

    together.pin(HELD)
    together.set_targets(HELD, targets, duration=0.02)
    together.set_force([9, 10, 11, 30], forces)
    together.set_obstacle_pose("ball", translations, rotations, duration=0.02)
    together.gravity = gravity
    together.wind = wind
    together.pin([[20, 21], [22, 23]], targets=corners[some] + 0.001, worlds=some)
    together.release([6], worlds=some)
    together.set_gravity((0, 0, -1), worlds=[0])
    together.set_wind([[0.1, 0, 0]], worlds=4)
    for w, world in enumerate(apart):
        world.pin(HELD)
        world.set_targets(HELD, targets[w], duration=0.02)
        world.set_force([9, 10, 11, 30], forces[w])
        world.set_obstacle_pose("ball", translations[w], rotations[w], duration=0.02)
        world.gravity, world.wind = gravity[w], wind[w]
    for w, row in zip(some, [[20, 21], [22, 23]]):
        apart[w].pin(row, corners[w] + 0.001)
        apart[w].release([6])
    apart[0].gravity = (0, 0, -1)
    apart[4].wind = (0.1, 0, 0)

    together.step(5)
    apart.step(5)
    assert hashes(together) == hashes(apart) and len(set(hashes(together))) == COUNT
    np.testing.assert_array_equal(together.gravity, [world.gravity for world in apart])
    np.testing.assert_array_equal(together.wind, [world.wind for world in apart])
    np.testing.assert_array_equal(together.forces, [world.forces for world in apart])
    np.testing.assert_array_equal(together.impulses, [world.impulses for world in apart])
    for seen, world in zip(together.contacts, apart):
        np.testing.assert_array_equal(seen, world.contacts)
    assert sum(map(len, together.contacts)) > 0
    about = np.arange(3 * COUNT).reshape(COUNT, 3)
    for what in ("ball", [0]):
        wrench = together.force_on(what, about=about)
        for field in ("force", "torque", "impulse", "angular_impulse"):
            expected = [getattr(world.force_on(what, about=point), field) for world, point in zip(apart, about)]
            np.testing.assert_array_equal(getattr(wrench, field), expected)
    np.testing.assert_array_equal(together.force_on("ball", worlds=[2]).force, [apart[2].force_on("ball").force])


def test_the_weight_of_each_world_hangs_on_its_pins():
    worlds = make(accuracy="interactive")
    gravity = np.outer(np.arange(1, COUNT + 1), [0, 0, -2.0])
    worlds.set_obstacle_pose("ball", (0, 0, -5))
    worlds.step()
    worlds.gravity = gravity
    worlds.pin([0, 6, 42, 48])
    worlds.step(800)
    worlds.step(400)
    interval = 400 / 200
    mass = worlds[0].masses.sum()
    impulse = worlds.force_on([0, 6, 42, 48]).impulse
    np.testing.assert_allclose(impulse / interval, mass * gravity, atol=0.02 * mass * 10)


def test_one_array_may_be_for_all_worlds():
    together, apart = make(3), make(3)
    corners = together.positions[0, HELD]
    together.pin(np.isin(np.arange(CLOTH), HELD), corners + 0.001)
    together.set_force(range(CLOTH), (0, 0, 1e-4))
    together.gravity = (0, 0, -3)
    together.set_obstacle_pose(0, (0, 0, -0.01))
    for world in apart:
        world.pin(HELD, corners + 0.001)
        world.set_force(range(CLOTH), (0, 0, 1e-4))
        world.gravity = (0, 0, -3)
        world.set_obstacle_pose(0, (0, 0, -0.01))
    together.step(3)
    apart.step(3)
    assert hashes(together) == hashes(apart)


def test_worlds_of_different_sizes_take_lists():
    together, apart = make(cells=(4, 6)), make(cells=(4, 6))
    rows = [[0, 4, 20], [0, 6]]
    targets = [world.positions[row] + 0.002 for world, row in zip(apart, rows)]
    together.pin(rows, targets)
    together.set_force(rows, [1e-3 * target for target in targets])
    for world, row, target in zip(apart, rows, targets):
        world.pin(row, target)
        world.set_force(row, 1e-3 * target)
    together.step(3)
    apart.step(3)
    assert hashes(together) == hashes(apart)
    assert [len(rows) for rows in together.forces] == [len(world.forces) for world in apart]
    with pytest.raises(cama.SceneError, match="device_positions: the worlds have different numbers of vertices"):
        print(together.device_positions)


def test_an_argument_that_does_not_fit_one_world_changes_none():
    worlds, untouched = make(), make()
    worlds.pin(HELD)
    for world in untouched:
        world.pin(HELD)
    here = worlds.positions[:, HELD]
    unpinned = np.array([HELD, HELD, [0, 7], HELD, HELD])
    holed = np.zeros((COUNT, 2, 3))
    holed[3, 1, 2] = np.nan
    beyond = np.array([HELD] * 4 + [[0, CLOTH]])
    rotation = np.tile([1.0, 0, 0, 0], (COUNT, 1))
    rotation[2] = 2
    for call, text in [
        (lambda: worlds.set_targets(unpinned, here + 1), "world 2: set_targets: cloth 'sheet', vertex 7 is not held"),
        (lambda: worlds.set_targets(HELD, holed), "set_targets: positions of world 3: row 1 is not finite"),
        (lambda: worlds.set_targets(HELD, here[:3]), "set_targets: positions: of 3 worlds, expected 5"),
        (lambda: worlds.set_targets(HELD, here[:, :1]), r"positions of world 0: shape \[1, 3\], expected \[2, 3\]"),
        (lambda: worlds.pin(beyond), "world 4: pin: vertices.1. is 49; the cloth has 49 vertices"),
        (lambda: worlds.pin([HELD] * 2), "pin: vertices: of 2 worlds, expected 5"),
        (lambda: worlds.pin(HELD, here + 1, duration=-1), "pin: duration is -1.0 s"),
        (lambda: worlds.pin([8, 8]), "world 0: pin: vertices.1. is 8, which appears twice"),
        (lambda: worlds.release(beyond), "world 4: release: vertices.1. is 49"),
        (lambda: worlds.set_force(beyond, here), "world 4: set_force: vertices.1. is 49"),
        (lambda: worlds.set_force(HELD, 3.0), "set_force: forces: no row for each world, expected 5"),
        (lambda: worlds.set_obstacle_pose("ball", (0, 0, 1), rotation), "world 2: set_obstacle_pose: rotation is not"),
        (lambda: worlds.set_obstacle_pose("wall"), "world 0: .*wall"),
        (lambda: worlds.set_obstacle_pose("ball", np.zeros((2, 3))), r"shape \[2, 3\], expected \[5, 3\]"),
        (lambda: worlds.set_gravity(np.full((COUNT, 3), np.inf)), "gravity: row 0 is not finite"),
        (lambda: worlds.set_wind((1, 0, 0), worlds=[7]), "world 7 is out of range"),
        (lambda: worlds.force_on([3]), "world 0: force_on: .* is held by no pin"),
    ]:
        with pytest.raises(cama.Error, match=text):
            call()
    worlds.step(2)
    untouched.step(2)
    assert hashes(worlds) == hashes(untouched)


def test_a_world_without_wind_is_named():
    calm = cama.Scene()
    calm.add_cloth(*grid(6, 0.3, 0.11), name="sheet", material="cotton")
    worlds = cama.Worlds([scene(), calm], backend="cpu")
    with pytest.raises(cama.SceneError, match="world 1: wind: the scene has no air"):
        worlds.wind = (1, 0, 0)
    np.testing.assert_array_equal(worlds.wind, np.zeros((2, 3)))
    with pytest.raises(cama.SceneError, match="world 0: forces: they are not measured"):
        print(worlds.forces)


def test_arrays_of_all_worlds_on_the_device():
    worlds = make(3)
    worlds.step(30)
    given = [worlds.device_positions, worlds.device_velocities, worlds.device_forces]
    expected = [worlds.positions, worlds.velocities, worlds.forces]
    arrays = [np.from_dlpack(array) for array in given]
    assert given[0].shape == (3, worlds[0].vertex_count, 3) and len(given[0]) == 3
    worlds.step(2)
    for array, moment in zip(arrays, expected):
        np.testing.assert_array_equal(array, moment)
        assert array.flags.c_contiguous and not array.flags.writeable
    copy = np.from_dlpack(given[0], copy=True)
    copy[:] = 0
    start = make(3)
    start.set_state(arrays[0][:, :CLOTH], arrays[1][:, :CLOTH])
    np.testing.assert_array_equal(start.positions[:, :CLOTH], expected[0][:, :CLOTH])
    del worlds, given
    gc.collect()
    np.testing.assert_array_equal(arrays[0], expected[0])


def test_memory_without_addresses_is_refused():
    if not any(row["name"] == "opencl" and row["available"] for row in cama.backends()):
        pytest.skip("no opencl here")
    worlds = make(2, backend="opencl")
    with pytest.raises(cama.BackendError, match="opencl has no address"):
        print(worlds.device_positions)
    worlds.step()
