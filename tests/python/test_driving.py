# SPDX-License-Identifier: Apache-2.0
"""Driving a simulation between steps: pins and targets, obstacles, forces, gravity, wind; checkpoints; errors."""

import numpy as np
import pytest

import cama
from conftest import grid

STEP = 1 / 200


def add_towel(scene, cells=6):
    grid = {"grid": {"size": [0.3, 0.3], "cells": [cells, cells]}}
    scene.add_cloth(shape=grid, material="cotton", translate=(0, 0, 0.5), name="towel")


def towel(cells=6, **scene):
    made = cama.Scene(time_step=STEP, **scene)
    add_towel(made, cells)
    return made


def simulate(scene, **options):
    return cama.Simulation(scene, accuracy="interactive", time_step=STEP, **options)


def circle(start, time):
    """Along a circle of 0.3 m at 1 m/s."""
    angle = time / 0.3
    return start + 0.3 * np.array([np.cos(angle) - 1, 0, np.sin(angle)])


def test_a_dragged_corner_is_on_its_target_at_the_end_of_every_interval():
    simulation = simulate(towel())
    corner = 0
    start = simulation.positions[corner]
    simulation.pin(corner)
    interval = 5 * STEP
    for k in range(1, 30):
        target = circle(start, k * interval)
        simulation.set_targets([corner], [target], duration=interval)
        simulation.step(5)
        assert np.abs(simulation.positions[corner] - target).max() < 1e-9
    assert simulation.count_intersections() == 0


def test_driving_a_pin_gives_the_bits_of_a_prescribed_one():
    scene = towel()
    moved = scene.copy()
    moved.pin("towel", [0, 6], motion=cama.Motion(velocity=(0.2, 0.1, 0.3)))
    prescribed = simulate(moved)
    scene.pin("towel", [0, 6])
    driven = simulate(scene)
    driven.pin([0, 6])
    for _ in range(40):
        prescribed.step()
        driven.set_targets([0, 6], prescribed.positions[[0, 6]])
        driven.step()
        assert driven.state_hash == prescribed.state_hash


def test_released_vertices_fall_freely():
    simulation = simulate(towel(self_contact=False))
    simulation.pin(range(simulation.cloth_vertex_count))
    simulation.step(10)
    before = simulation.positions.copy()
    simulation.release(range(simulation.cloth_vertex_count))
    simulation.step(20)
    # backward Euler: z = -g h^2 n (n + 1) / 2
    fallen = 9.81 * STEP**2 * 20 * 21 / 2
    assert np.abs(simulation.positions - before - [0, 0, -fallen]).max() < 1e-6


def test_pins_of_the_scene_obey_too():
    scene = towel()
    scene.pin("towel", [0, 6])
    simulation = simulate(scene)
    simulation.step(5)
    simulation.release([0])
    simulation.set_force([6], [0, 0, 1.0])
    simulation.step(10)
    first, kept = scene.cloths[0].vertices[0], scene.cloths[0].vertices[6]
    assert simulation.positions[0][2] < first[2] - 1e-4
    assert (simulation.positions[6] == kept).all(), "a held vertex ignores forces"


def ball_scene():
    scene = towel(cells=8)
    scene.add_obstacle(shape={"shape": {"sphere": {"radius": 0.08}}}, translate=(0, 0, 0.35), name="ball")
    return scene


def poke(simulation, steps=60):
    for k in range(1, steps + 1):
        simulation.set_obstacle_pose("ball", (0, 0, 0.004 * k), (np.cos(0.01 * k), 0, 0, np.sin(0.01 * k)))
        simulation.step()


@pytest.mark.parametrize("exact", [False, True])
def test_a_static_obstacle_starts_to_move_and_lifts_the_cloth_without_intersections(exact):
    scene = cama.Scene(time_step=STEP, gravity=(0, 0, 0))
    sphere = {"sphere": {"radius": 0.08}}
    add_towel(scene)
    scene.add_obstacle(shape={"shape": sphere} if exact else sphere, translate=(0, 0, 0.35), name="ball")
    simulation = simulate(scene)
    simulation.step(3)
    ball = slice(*simulation.obstacle_ranges[0])
    rest = simulation.positions[ball].copy()
    poke(simulation)
    c, s = np.cos(2 * 0.6), np.sin(2 * 0.6)
    turned = rest @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T + [0, 0, 0.24]
    assert np.abs(simulation.positions[ball] - turned).max() < 1e-12
    assert simulation.count_intersections() == 0
    assert simulation.positions[: simulation.cloth_vertex_count, 2].max() > 0.6


@pytest.mark.parametrize("backend", ["cpu", "opencl"])
def test_checkpoints_hold_what_was_driven(tmp_path, backend):
    scene = cama.Scene(time_step=STEP, wind={"velocity": [0, 0, 0], "density": 1.2, "drag": 0.0})
    add_towel(scene)
    scene.add_obstacle(shape={"box": {"size": [0.1, 0.1, 0.1]}}, translate=(0, 0, 0.3), name="box")
    scene.pin("towel", [3])

    def drive(simulation):
        simulation.pin([0, 6], duration=0.1, targets=simulation.positions[[0, 6]] + [0, 0, 0.05])
        simulation.set_obstacle_pose("box", (0, 0, 0.02), duration=0.1)
        simulation.set_force([20], [[0.01, 0, 0]])
        simulation.gravity = (0, 0, -5)
        simulation.wind = (2, 0, 0)
        simulation.step(5)
        simulation.release([3])
        simulation.attach([24], "box")
        simulation.step(5)

    whole = simulate(scene, backend=backend)
    drive(whole)
    whole.save_checkpoint(tmp_path / "a.h5")
    whole.step(15)
    expected = whole.state_hash
    for again in (simulate(scene, backend=backend), simulate(scene), whole):
        again.load_checkpoint(tmp_path / "a.h5")
        assert again.gravity == (0, 0, -5) and again.wind == (2, 0, 0)
        again.step(15)
        assert again.state_hash == expected
    fresh = simulate(scene)
    fresh.save_checkpoint(tmp_path / "start.h5")
    fresh.step(10)
    expected = fresh.state_hash
    whole.load_checkpoint(tmp_path / "start.h5")  # back to a state that nobody had driven
    whole.step(10)
    assert whole.state_hash == expected


def test_the_callback_drives_every_step():
    simulation = simulate(towel(gravity=(0, 0, 0), self_contact=False), precision="double", tolerance=1e-9)
    calls = []

    def push(now):
        calls.append(now.step_count)
        now.set_force(range(now.cloth_vertex_count), now.masses[:, None] * [[0, 0, 2.0]])

    simulation.before_step = push
    simulation.step(10)
    assert calls == list(range(10))
    risen = simulation.positions[:, 2] - 0.5
    assert np.abs(risen - 2.0 * STEP**2 * 10 * 11 / 2).max() < 1e-6  # a body force of 2 m/s^2
    simulation.before_step = None
    with pytest.raises(TypeError, match="before_step"):
        simulation.before_step = 3


def test_the_scene_of_a_simulation_is_read_only():
    simulation = simulate(ball_scene())
    for change in (
        lambda scene: scene.pin("towel", [0]),
        lambda scene: setattr(scene, "gravity", (0, 0, 0)),
        lambda scene: setattr(scene, "wind", None),
        lambda scene: setattr(scene.cloths[0], "material", "silk"),
        lambda scene: scene.add_obstacle(shape={"sphere": {"radius": 1}}),
    ):
        with pytest.raises(cama.SceneError, match="read-only"):
            change(simulation.scene)
    with pytest.raises(AttributeError):
        simulation.external_forces = 1
    with pytest.raises(AttributeError):
        simulation.scene = ball_scene()
    own = simulation.scene.copy()
    own.gravity = (0, 0, 0)  # a copy is anybody's


@pytest.mark.parametrize(
    "call, message",
    [
        (lambda s: s.pin([999]), r"vertices\[0\] is 999; the cloth has 81 vertices"),
        (lambda s: s.pin([1, 1]), r"vertices\[1\] is 1, which appears twice"),
        (lambda s: s.pin([1], [[0, 0, np.nan]]), "row 0 is not finite"),
        (lambda s: s.set_targets([1], [[0, 0, 0]]), "cloth 'towel', vertex 1 is not held by pin"),
        (lambda s: s.set_obstacle_pose("ball", rotation=(2, 0, 0, 0)), "unit quaternion"),
        (lambda s: s.set_obstacle_pose("cube"), "cube"),
        (lambda s: s.set_obstacle_vertices("ball", np.zeros((2, 3))), "set_obstacle_vertices"),
        (lambda s: s.attach([1], "ball"), "ball' is an exact shape"),
        (lambda s: s.set_force([1, 2], [[0, 0, 1]]), r"shape \[1, 3\], expected \[2, 3\]"),
        (lambda s: s.pin([1], duration=-1), "must be positive"),
        (lambda s: setattr(s, "wind", (1, 0, 0)), "no air"),
    ],
)
def test_what_cannot_be_driven_is_named_and_changes_nothing(call, message):
    simulation, other = simulate(ball_scene()), simulate(ball_scene())
    with pytest.raises(cama.Error, match=message):
        call(simulation)
    for s in (simulation, other):
        s.step(3)
    assert simulation.state_hash == other.state_hash


def test_a_pose_moves_the_vertices_that_were_set(tmp_path):
    scene = cama.Scene(time_step=STEP, gravity=(0, 0, 0))
    add_towel(scene)
    scene.add_obstacle(shape={"sphere": {"radius": 0.05}}, translate=(0, 0, 0.2), name="ball")
    simulation = simulate(scene)
    ball = slice(*simulation.obstacle_ranges[0])
    flat = simulation.positions[ball] * [1, 1, 0.5]
    simulation.set_obstacle_vertices("ball", flat)
    simulation.step()
    assert np.abs(simulation.positions[ball] - flat).max() < 1e-12
    simulation.set_obstacle_pose("ball", (0.01, 0, 0), duration=4 * STEP)
    simulation.save_checkpoint(tmp_path / "a.h5")
    simulation.step(4)
    assert np.abs(simulation.positions[ball] - flat - [0.01, 0, 0]).max() < 1e-12
    again = simulate(scene)
    again.load_checkpoint(tmp_path / "a.h5")
    again.step(4)
    assert np.abs(again.positions[ball] - flat - [0.01, 0, 0]).max() < 1e-12


@pytest.mark.parametrize(
    "table, values, message",
    [
        ("pins", [999.0] + [0.0] * 8, "vertex that is not there"),
        ("pins", [0.0], "ends within a row"),
        ("attachments", [0.0, 5.0, 6.0, 7.0] + [0.0] * 12, "vertex that is not of an obstacle"),
        ("attachments", [0.0] * 10, "ends within a row"),
        ("attached", [999.0] + [0.0] * 9, "vertex that is not there"),
        ("attached", [0.0, 1e6, 60.0, 61.0] + [0.0] * 6, "vertex that is not of an obstacle"),
        ("poses", [7.0] + [0.0] * 9, "obstacle that is not there"),
        ("force", [1.0], "force does not fit the scene"),
        ("wind", [1.0, 0.0, 0.0], "wind does not fit the scene"),
        ("nonsense", [1.0], "nonsense: is not known"),
    ],
)
def test_a_damaged_checkpoint_of_a_driven_run_is_refused_and_changes_nothing(tmp_path, table, values, message):
    import h5py

    simulation = simulate(ball_scene())
    simulation.save_checkpoint(tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5", "a") as file:
        file["driving"][table] = np.array(values)
    before = simulation.state_hash
    with pytest.raises(cama.SceneError, match=message):
        simulation.load_checkpoint(tmp_path / "a.h5")
    assert simulation.state_hash == before


def test_attachments_of_an_earlier_checkpoint_are_where_they_were(tmp_path):
    """Its rows end with an offset in the frame of the triangle; the positions say the same."""
    import h5py

    scene = cama.Scene(contact=False)
    add_towel(scene)
    scene.add_obstacle(shape={"box": {"size": [0.1, 0.1, 0.1]}}, translate=(0, 0, 0.3), name="box")
    simulation = simulate(scene)
    simulation.attach([24], "box")
    simulation.step(2)
    simulation.save_checkpoint(tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5", "a") as file:
        row = file["driving"]["attachments"][:]
        del file["driving"]["attachments"]
        file["driving"]["attached"] = np.concatenate([row[:7], [0.0, 0.0, 0.0]])
    other = simulate(scene)
    other.load_checkpoint(tmp_path / "a.h5")
    start = other.positions[24]
    other.set_obstacle_pose("box", (0.01, 0, 0.02))
    other.step(1)
    np.testing.assert_allclose(other.positions[24] - start, [0.01, 0, 0.02], atol=1e-12)


def test_attached_vertices_stay_neighbours_where_the_surface_bends():
    """A plate that becomes part of a cylinder of radius R stretches what is attached d above it by d / R, evenly."""
    radius, height, cell, spacing = 0.3, 0.02, 0.06, 0.006
    plate, faces = grid(10, 10 * cell)
    vertices, triangles = grid(20, 20 * spacing)
    scene = cama.Scene(contact=False)
    scene.add_cloth(vertices + [0, 0, height], triangles, name="band")
    scene.add_obstacle(plate, faces, name="plate")
    scene.attach("band", np.arange(len(vertices)), "plate")
    simulation = cama.Simulation(scene, backend="cpu", time_step=0.01)
    angle = plate[:, 0] / radius
    bent = np.stack([radius * np.sin(angle), plate[:, 1], radius * (np.cos(angle) - 1)], axis=1)
    simulation.set_obstacle_vertices("plate", bent)
    simulation.step(1)
    x = simulation.positions[: len(vertices)].reshape(21, 21, 3)
    along = 0 if abs(vertices[21, 0] - vertices[0, 0]) > 1e-9 else 1
    stretched = np.linalg.norm(np.diff(x, axis=along), axis=-1) / spacing - 1
    assert stretched == pytest.approx(height / radius, abs=0.25 * height / radius)
    assert np.hypot(x[..., 0], x[..., 2] + radius) == pytest.approx(radius + height, abs=cell**2 / (8 * radius) + 1e-4)
