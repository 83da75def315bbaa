# SPDX-License-Identifier: Apache-2.0
"""Rigid bodies that meet each other and other obstacles: expected values are closed forms of mechanics."""

import math

import numpy as np
import pytest

import cama

G = 9.81
THICKNESS = 1e-3  # m: the gap between surfaces that touch
H = 1 / 240  # s


def scene_of(*, gravity=(0, 0, -G), friction=0.3, floor="plane", contact=True):
    """A floor at z = 0, and a scrap of cloth far away, which every scene must have."""
    scene = cama.Scene(gravity=gravity, thickness=THICKNESS, contact=contact)
    scene.add_cloth(
        shape={"grid": {"size": [0.1, 0.1], "cells": [2, 2]}}, material="cotton", translate=(50, 0, 50), name="scrap"
    )
    scene.pin("scrap", list(range(9)))
    if floor == "plane":
        scene.add_obstacle(shape={"shape": {"plane": {}}}, friction=friction, name="floor")
    elif floor == "box":
        scene.add_obstacle(
            shape={"box": {"size": [4, 4, 0.2]}}, translate=(0, 0, -0.1), friction=friction, name="floor"
        )
    return scene


def box(scene, place, *, size=(0.1, 0.1, 0.1), mass=1.0, friction=0.3, name="box", **rigid):
    scene.add_obstacle(
        shape={"box": {"size": list(size)}},
        translate=place,
        friction=friction,
        rigid={"mass": mass, **rigid},
        name=name,
    )


def ball(scene, place, *, radius=0.05, mass=1.0, triangles=320, friction=0.3, name="ball", **rigid):
    scene.add_obstacle(
        shape={"sphere": {"radius": radius, "triangles": triangles}},
        translate=place,
        friction=friction,
        rigid={"mass": mass, **rigid},
        name=name,
    )


def simulation_of(scene, **options):
    return cama.Simulation(scene, **{"time_step": H, "backend": "cpu", **options})


@pytest.mark.parametrize("floor", ["plane", "box"])
@pytest.mark.parametrize("integrator", ["bdf2", "backward_euler"])
def test_a_ball_that_falls_on_a_floor_rests_at_its_radius_and_the_gap(floor, integrator):
    scene = scene_of(floor=floor)
    ball(scene, (0, 0, 0.3))
    simulation = simulation_of(scene, integrator=integrator)
    lowest = np.inf
    for _ in range(180):
        simulation.step()
        lowest = min(lowest, simulation.rigid_pose("ball").center[2])
    pose = simulation.rigid_pose("ball")
    assert pose.center == pytest.approx([0, 0, 0.05 + THICKNESS], abs=0.02 * THICKNESS)
    assert lowest > 0.05 + 0.98 * THICKNESS
    assert np.linalg.norm(pose.velocity) < 1e-6
    assert pose.contact_force == pytest.approx([0, 0, G], abs=1e-4)


@pytest.mark.parametrize("floor", ["plane", "box"])
@pytest.mark.parametrize("mu", [0.2, 0.5])
def test_a_box_on_a_slope_holds_or_slides_as_coulomb_says(floor, mu):
    for tangent in (0.9 * mu, 1.5 * mu):
        a = math.atan(tangent)
        scene = scene_of(gravity=(G * math.sin(a), 0, -G * math.cos(a)), friction=mu, floor=floor)
        box(scene, (0, 0, 0.05 + THICKNESS), friction=mu)
        simulation = simulation_of(scene)
        simulation.step(120)
        pose = simulation.rigid_pose("box")
        if tangent < mu:
            assert abs(pose.center[0]) < 1e-6 and abs(pose.velocity[0]) < 1e-6
        else:
            assert pose.velocity[0] == pytest.approx(G * (math.sin(a) - mu * math.cos(a)) * 0.5, rel=0.01)
        assert pose.center[2] == pytest.approx(0.05 + THICKNESS, abs=0.05 * THICKNESS)


def test_what_sticks_needs_the_static_coefficient_to_break_away():
    a = math.atan(0.4)
    for static, moves in ((0.5, False), (0.35, True)):
        scene = scene_of(gravity=(G * math.sin(a), 0, -G * math.cos(a)), floor=None)
        scene.add_obstacle(shape={"shape": {"plane": {}}}, friction=0.2, static_friction=static, name="floor")
        scene.add_obstacle(
            shape={"box": {"size": [0.1, 0.1, 0.1]}},
            translate=(0, 0, 0.05 + THICKNESS),
            friction=0.2,
            static_friction=static,
            rigid={"mass": 1},
            name="box",
        )
        simulation = simulation_of(scene)
        simulation.step(60)
        expected = G * (math.sin(a) - 0.2 * math.cos(a)) * 0.25 if moves else 0
        assert simulation.rigid_pose("box").velocity[0] == pytest.approx(expected, rel=0.01, abs=1e-6)


def test_balls_that_collide_head_on_go_on_together_with_the_momentum_that_they_had():
    scene = scene_of(gravity=(0, 0, 0), floor=None)
    ball(scene, (0, 0, 0), velocity=(2, 0, 0), name="a")
    ball(scene, (0.3, 0, 0), name="b")
    simulation = simulation_of(scene)
    for _ in range(60):
        simulation.step()
        a, b = simulation.rigid_pose("a"), simulation.rigid_pose("b")
        assert np.abs(a.velocity + b.velocity - [2, 0, 0]).max() < 1e-15
        assert np.abs(a.contact_force + b.contact_force).max() == 0
    assert a.velocity == pytest.approx([1, 0, 0], abs=1e-6)
    assert b.center[0] - a.center[0] == pytest.approx(0.1 + THICKNESS, abs=0.05 * THICKNESS)


def test_bodies_that_strike_each_other_off_centre_keep_both_momenta():
    scene = scene_of(gravity=(0, 0, 0), floor=None)
    box(scene, (0, 0, 0), mass=0.7, velocity=(3, 0, 0), angular_velocity=(1, 2, 3), name="a")
    box(scene, (0.25, 0.06, 0.03), size=(0.1, 0.2, 0.1), mass=1.3, angular_velocity=(0, -2, 1), name="b")
    simulation = simulation_of(scene)

    def momenta():
        poses = [(m, simulation.rigid_pose(name)) for m, name in ((0.7, "a"), (1.3, "b"))]
        return (
            sum(m * p.velocity for m, p in poses),
            sum(p.angular_momentum + m * np.cross(p.center, p.velocity) for m, p in poses),
            sum(0.5 * m * p.velocity @ p.velocity + 0.5 * p.angular_velocity @ p.angular_momentum for m, p in poses),
        )

    linear, angular, energy = momenta()
    simulation.step(60)
    linear_now, angular_now, energy_now = momenta()
    assert simulation.rigid_pose("b").velocity[0] > 0.3
    assert np.abs(linear_now - linear).max() < 1e-14
    # Contact has the lever of the place in the step at which it begins.
    assert np.abs(angular_now - angular).max() < 0.01 * (0.7 * 3 * 0.1)
    assert energy_now < energy


def test_bodies_that_touch_at_the_start_exchange_angular_momentum_exactly():
    scene = scene_of(gravity=(0, 0, 0), floor=None)
    box(scene, (0, 0, 0), mass=0.7, velocity=(1, 0.3, 0), name="a")
    box(scene, (0.1 + THICKNESS, 0.06, 0.03), mass=1.3, name="b")
    simulation = simulation_of(scene)
    simulation.step()
    poses = [(m, simulation.rigid_pose(name)) for m, name in ((0.7, "a"), (1.3, "b"))]
    assert poses[1][1].velocity[0] > 0.1 and poses[1][1].velocity[1] > 0.01
    angular = sum(p.angular_momentum + m * np.cross(p.center, p.velocity) for m, p in poses)
    assert np.abs(angular).max() < 1e-9 * 0.7 * 0.1  # the sides are parted by rounding, too


@pytest.mark.parametrize("floor", ["plane", "box"])
def test_a_ball_rolls_down_a_slope_as_a_solid_sphere(floor):
    a = 0.2
    scene = scene_of(gravity=(G * math.sin(a), 0, -G * math.cos(a)), friction=0.5, floor=floor)
    ball(scene, (0, 0, 0.05 + THICKNESS), triangles=2000, friction=0.5)
    simulation = simulation_of(scene)
    simulation.step(120)
    pose = simulation.rigid_pose("ball")
    assert pose.velocity[0] == pytest.approx(5 / 7 * G * math.sin(a) * 0.5, rel=0.01)
    assert pose.angular_velocity[1] * (0.05 + THICKNESS / 2) == pytest.approx(pose.velocity[0], rel=1e-3)
    assert pose.center[2] == pytest.approx(0.05 + THICKNESS, abs=0.02 * THICKNESS)


def test_a_stack_of_three_boxes_stands():
    scene = scene_of()
    for i in range(3):
        box(scene, (0, 0, 0.05 + THICKNESS + i * (0.1 + THICKNESS)), name=f"box {i}")
    simulation = simulation_of(scene)
    simulation.step(480)
    for i in range(3):
        pose = simulation.rigid_pose(f"box {i}")
        assert pose.center == pytest.approx([0, 0, 0.05 + THICKNESS + i * (0.1 + THICKNESS)], abs=0.1 * THICKNESS)
        assert np.linalg.norm(pose.velocity) < 1e-5
        assert pose.contact_force == pytest.approx([0, 0, G], abs=1e-3)  # of its neighbours together


@pytest.mark.parametrize("body", ["ball", "box"])
def test_a_fast_body_does_not_pass_a_thin_plate(body):
    scene = scene_of(gravity=(0, 0, 0), floor=None)
    scene.add_obstacle(shape={"box": {"size": [1, 1, 0.002]}}, name="plate")
    add = ball if body == "ball" else box
    add(scene, (0.1, 0.07, 0.5), velocity=(0, 0, -100), angular_velocity=(3, 5, 0), name="body")
    simulation = simulation_of(scene)
    for _ in range(30):
        simulation.step()
        assert simulation.positions[slice(*simulation.obstacle_ranges[1])][:, 2].min() > 0


def test_a_body_is_carried_and_pushed_by_obstacles_that_move():
    scene = scene_of(floor=None)
    scene.add_obstacle(
        shape={"box": {"size": [1, 1, 0.1]}}, translate=(0, 0, -0.05), motion={"velocity": (0.3, 0, 0.2)}, name="lift"
    )
    box(scene, (0, 0, 0.05 + THICKNESS))
    simulation = simulation_of(scene)
    simulation.step(120)
    pose = simulation.rigid_pose("box")
    assert pose.velocity == pytest.approx([0.3, 0, 0.2], abs=1e-4)
    assert pose.center[2] == pytest.approx(0.05 + THICKNESS + 0.1, abs=0.05 * THICKNESS)


@pytest.mark.parametrize(
    "exact, place, rest",
    [
        ({"sphere": {"radius": 0.2}}, (0, 0, 0.4), 0.2),
        ({"capsule": {"radius": 0.2, "points": [[-1, 0, 0], [1, 0, 0]]}}, (0, 0, 0.4), 0.2),
    ],
)
def test_bodies_rest_on_exact_shapes(exact, place, rest):
    """Balanced on top, a symmetric body stays there for the first half second."""
    scene = scene_of(floor=None)
    scene.add_obstacle(shape={"shape": exact}, name="round")
    ball(scene, place, name="body")
    simulation = simulation_of(scene)
    simulation.step(120)
    assert simulation.rigid_pose("body").center == pytest.approx([0, 0, rest + 0.05 + THICKNESS], abs=0.02 * THICKNESS)


def test_a_start_within_another_obstacle_is_named_with_its_depth():
    scene = scene_of()
    box(scene, (0, 0, 0.04))
    with pytest.raises(cama.CollisionError, match=r"'box', which is rigid, 0\.0100\d* m deep in obstacle 'floor'"):
        simulation_of(scene)
    simulation = simulation_of(scene, intersections="exempt")
    simulation.step(20)
    assert simulation.rigid_pose("box").velocity[2] == pytest.approx(-G * 20 * H)
    scene = scene_of(floor=None)
    box(scene, (0, 0, 0), name="a")
    box(scene, (0.09, 0.01, 0.02), name="b")
    with pytest.raises(cama.CollisionError, match=r"obstacle 'a', which is rigid, 0\.0\d+ m deep in obstacle 'b'"):
        simulation_of(scene)


def test_bodies_that_start_nearer_than_the_gap_are_parted_without_a_velocity():
    scene = scene_of()
    box(scene, (0, 0, 0.05))  # touches the floor
    simulation = simulation_of(scene)
    highest = 0.0
    for _ in range(120):
        simulation.step()
        highest = max(highest, simulation.rigid_pose("box").velocity[2])
    assert simulation.rigid_pose("box").center[2] == pytest.approx(0.05 + THICKNESS, abs=0.02 * THICKNESS)
    assert highest < 1e-6


def test_a_body_that_is_squeezed_beyond_its_size_is_named():
    scene = scene_of(gravity=(0, 0, 0))
    box(scene, (0, 0, 0.06))
    scene.add_obstacle(
        shape={"box": {"size": [1, 1, 0.1]}}, translate=(0, 0, 0.2), motion={"velocity": (0, 0, -0.5)}, name="press"
    )
    simulation = simulation_of(scene)
    with pytest.raises(cama.SolverError, match="obstacle 'box' is squeezed"):
        simulation.step(60)
    assert np.isfinite(simulation.positions).all()


def rolling_off():
    """A ball rolls off an inclined sheet onto the floor."""
    scene = cama.Scene(thickness=2e-3)
    material = cama.Material.fabric("cotton")
    material.damping = 0.05
    scene.add_cloth(
        shape={"grid": {"size": [0.5, 0.3], "cells": [10, 6]}},
        material=material,
        rotate=(math.cos(0.13), 0, math.sin(0.13), 0),
        translate=(0, 0, 0.25),
        name="sheet",
    )
    grid = np.arange(77).reshape(7, 11)
    scene.pin("sheet", [*grid[0], *grid[-1], *grid[1:-1, 0], *grid[1:-1, -1]])
    scene.add_obstacle(shape={"box": {"size": [4, 4, 0.2]}}, translate=(0, 0, -0.1), name="floor")
    ball(scene, (0.05, 0, 0.32), mass=0.1)
    return scene


@pytest.mark.parametrize("steps", (90, 120, 150))  # a second
def test_a_ball_rolls_off_a_sheet_onto_the_floor(steps):
    """On the sheet's pinned border the ball's contacts open, stick and slide within a step."""
    simulation = simulation_of(rolling_off(), time_step=1 / steps, accuracy="production")
    simulation.step(round(1.25 * steps))
    pose = simulation.rigid_pose("ball")
    assert pose.center[0] > 0.35, "it has left the sheet"
    assert pose.center[2] == pytest.approx(0.05 + 1.5e-3, abs=0.6e-3)
    assert simulation.count_intersections() == 0


def two_boxes_and_a_ball():
    scene = rolling_off()
    box(scene, (0.6, 0, 0.06), mass=0.4, angular_velocity=(1, 2, 0), name="box a")
    box(scene, (0.62, 0.02, 0.2), mass=0.3, name="box b")
    return scene


def poses(simulation):
    each = [simulation.rigid_pose(name) for name in ("ball", "box a", "box b")]
    return np.concatenate([np.r_[p.center, p.rotation, p.velocity, p.angular_momentum] for p in each])


def test_contact_has_the_same_bits_with_two_threads_on_opencl_after_a_checkpoint_and_in_worlds(tmp_path):
    def run(**options):
        simulation = simulation_of(two_boxes_and_a_ball(), time_step=1 / 120, **options)
        simulation.step(40)
        return simulation

    whole = run(threads=1)
    assert whole.rigid_pose("box a").contact_force[2] > 1
    whole.save_checkpoint(tmp_path / "checkpoint.h5")
    others = [run(threads=2)]
    if any(backend["name"] == "opencl" and backend["available"] for backend in cama.backends()):
        others.append(run(backend="opencl"))
    for other in others:
        assert other.state_hash == whole.state_hash
        assert (poses(other) == poses(whole)).all()
    whole.step(10)
    again = simulation_of(two_boxes_and_a_ball(), time_step=1 / 120)
    again.load_checkpoint(tmp_path / "checkpoint.h5")
    again.step(10)
    assert (poses(again) == poses(whole)).all()
    worlds = cama.Worlds([two_boxes_and_a_ball()] * 2, time_step=1 / 120, backend="cpu")
    worlds.step(50)
    for world in worlds:
        assert (poses(world) == poses(whole)).all()


def test_without_contact_bodies_pass_through():
    scene = scene_of(contact=False)
    ball(scene, (0, 0, 0.06))
    simulation = simulation_of(scene)
    simulation.step(60)
    assert simulation.rigid_pose("ball").center[2] < 0
