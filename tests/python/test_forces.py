# SPDX-License-Identifier: Apache-2.0
"""Forces of the cloth on obstacles and on what holds it: momentum, weight, closed forms; errors."""

import numpy as np
import pytest

import cama

STEP = 1 / 200
GRAVITY = np.array([0, 0, -9.81])


def sheet(scene, height, size=0.3, cells=10, **given):
    grid = {"grid": {"size": [size, size], "cells": [cells, cells]}}
    return scene.add_cloth(shape=grid, material="cotton", translate=(0, 0, height), **given)


def simulate(scene, accuracy="interactive", **options):
    return cama.Simulation(scene, accuracy=accuracy, time_step=STEP, forces=True, **options)


def momentum(simulation):
    n = simulation.cloth_vertex_count
    return simulation.masses @ simulation.velocities[:n]


def busy_scene():
    """Two cloths, a moving and a resting obstacle, exact and meshed, pins, attachments and stitches."""
    scene = cama.Scene(thickness=2e-3)
    sheet(scene, 0.5, name="sheet")
    sheet(scene, 0.46, size=0.2, cells=5, name="patch")
    scene.pin("sheet", [0, 1], motion=cama.Motion(velocity=(0.1, 0, 0.2)))
    scene.add_obstacle(
        shape={"shape": {"sphere": {"radius": 0.07}}},
        translate=(0.03, 0.02, 0.3),
        motion=cama.Motion(velocity=(0, 0, 1.5), stop=0.08),
        name="ball",
    )
    scene.add_obstacle(shape={"box": {"size": [0.2, 0.2, 0.1]}}, translate=(0.05, 0, 0.3), name="box", friction=0.5)
    scene.attach("patch", [0], "box")
    return scene


EXACT = {"tolerance": 1e-13, "max_iterations": 3000, "precision": "double"}


@pytest.mark.parametrize(
    "options, bound",
    [
        (EXACT, 1e-9),
        ({**EXACT, "precision": "mixed"}, 1e-9),
        ({"precision": "single", "tolerance": 1e-6, "max_iterations": 3000}, 1e-3),
        ({**EXACT, "integrator": "bdf2"}, 1e-9),
        ({**EXACT, "newton_iterations": 30, "newton_tolerance": 1e-10}, 1e-7),
        ({"accuracy": "paper", "tolerance": 1e-12}, 1e-6),
        ({"accuracy": "paper", "tolerance": 1e-12, "paper": {"assembly": "sorted", "contact_form": "rank_one"}}, 1e-6),
    ],
)
def test_the_impulses_are_the_momentum_that_changed(options, bound):
    simulation = simulate(busy_scene(), **options)
    weight = simulation.masses.sum() * GRAVITY
    impacts = truncated = compared = 0
    for _ in range(60):
        before = momentum(simulation)
        simulation.step()
        change = momentum(simulation) - before
        report = simulation.report
        impacts += report["impacts"]
        truncated += report["truncated"]
        if report["newton_residual"] < 1e-8:  # Newton's method does not solve every step; -1: not used
            compared += 1
            assert np.abs(change - STEP * (weight - simulation.forces.sum(axis=0))).max() < bound * STEP * -weight[2]
    assert compared > 20
    assert impacts > 0, "the scene has no impacts to account for"
    assert simulation.count_intersections() == 0
    n = simulation.cloth_vertex_count
    if truncated == 0 and options.get("integrator") != "bdf2":  # free vertices are held by nothing; BDF2 forgets blows
        assert (np.delete(simulation.forces[:n], [0, 1, 121], axis=0) == 0).all()


def test_bdf2_forgets_nothing_where_there_is_no_blow():
    scene = cama.Scene(self_contact=False)
    sheet(scene, 1.02e-3, cells=6)
    scene.add_obstacle(shape={"plane": {"size": [2, 2]}}, name="floor", friction=0.5)
    simulation = simulate(scene, **EXACT, integrator="bdf2", newton_iterations=2)
    touched = 0
    for _ in range(60):
        simulation.step()
        touched += simulation.report["contacts"] > 0
        assert (simulation.forces[: simulation.cloth_vertex_count] == 0).all(), "free vertices are held by nothing"
    assert touched > 30 and simulation.force_on("floor").force[2] < 0


def test_what_the_commit_cuts_pushes_the_obstacle():
    scene = cama.Scene(self_contact=False, gravity=(0, 0, 0))
    sheet(scene, 0.5, cells=4, velocity=(0, 0, -5))
    scene.add_obstacle(shape={"sphere": {"radius": 0.2}}, translate=(0, 0, 0.29), name="ball")
    simulation = simulate(scene, **EXACT, max_impact_passes=0, paper={"anticipate_contacts": False})
    before = momentum(simulation)
    cut = 0
    for _ in range(10):
        simulation.step()
        cut += simulation.report["truncated"]
        change = momentum(simulation) - before
        before = before + change
        assert np.abs(change + STEP * simulation.force_on("ball").force).max() < 1e-12
    assert cut > 0


@pytest.mark.parametrize("solves", [1, 2])
def test_measuring_changes_nothing_and_is_the_same_everywhere(solves):
    runs = {}
    for backend, forces in (("cpu", False), ("cpu", True), ("opencl", True)):
        simulation = cama.Simulation(
            busy_scene(),
            accuracy="interactive",
            time_step=STEP,
            newton_iterations=solves,
            forces=forces,
            backend=backend,
        )
        simulation.step(40)
        runs[backend, forces] = simulation
    assert len({simulation.state_hash for simulation in runs.values()}) == 1
    one, other = runs["cpu", True], runs["opencl", True]
    assert (one.forces == other.forces).all() and (one.impulses == other.impulses).all()
    assert np.abs(one.forces).max() > 0


def test_a_hanging_sheet_pulls_its_pins_by_its_weight():
    scene = cama.Scene(self_contact=False)
    sheet(scene, 0.5, name="sheet", cells=6)
    corners = [0, 6, 42, 48]
    scene.pin("sheet", corners)
    simulation = simulate(scene, "production")
    simulation.step(1600)
    simulation.step(200)
    pull = simulation.force_on(corners)
    weight = simulation.masses.sum() * GRAVITY
    assert np.abs(pull.impulse - weight).max() < 1e-3 * -weight[2]
    # by symmetry every corner carries a quarter, so that nothing turns the frame about the middle
    assert np.abs(simulation.impulses[corners, 2] - weight[2] / 4).max() < 2e-2 * -weight[2]
    assert np.abs(pull.angular_impulse).max() < 1e-3 * -weight[2]


@pytest.mark.parametrize("exact", [False, True])
def test_a_draped_cloth_weighs_on_the_ball(exact):
    scene = cama.Scene()
    sheet(scene, 0.455, name="sheet", cells=12)
    ball = {"sphere": {"radius": 0.1}}
    scene.add_obstacle(shape={"shape": ball} if exact else ball, translate=(0, 0, 0.35), name="ball", friction=0.6)
    simulation = simulate(scene, "production")
    simulation.step(600)
    simulation.step(200)
    load = simulation.force_on("ball", about=(0, 0, 0.35))
    weight = simulation.masses.sum() * GRAVITY
    assert np.abs(load.impulse - weight).max() < 1e-3 * -weight[2]
    assert np.abs(load.angular_impulse).max() < 0.05 * 0.1 * -weight[2], "the cloth hangs evenly"


@pytest.mark.parametrize(
    "options",
    [
        {"accuracy": "interactive"},
        {"accuracy": "production"},
        {"accuracy": "production", "integrator": "backward_euler"},
        {"accuracy": "production", "time_step": 1 / 60},
    ],
)
def test_the_ball_bears_the_weight_where_newtons_method_ends_early(options):
    """Forces of contacts at its state exceeded the weight up to ten times."""
    scene = cama.Scene(thickness=1.5e-3)
    sheet(scene, 0.26, size=0.8, cells=14)
    scene.add_obstacle(shape={"sphere": {"radius": 0.25}}, friction=0.3, name="ball")
    plain, measured = (cama.Simulation(scene, backend="cpu", forces=forces, **options) for forces in (False, True))
    while measured.time < 1.2 - 1e-9:
        plain.step_frame()
        measured.step_frame()
    assert plain.state_hash == measured.state_hash
    begin, before, normal = measured.time, momentum(measured), 0
    impulse = 0
    while measured.time < begin + 0.5:
        measured.step()
        impulse = impulse + measured.force_on("ball").impulse
        rows = measured.contacts
        first, last = (rows["vertices"][:, k] >= measured.cloth_vertex_count for k in (0, 3))  # of the ball
        push = rows["normal_force"][:, None] * rows["normal"] + rows["tangential_force"]
        push = np.where(first, -1, 1)[:, None] * push
        normal = normal + measured.report["time_step"] * push[first != last].sum(axis=0)
    weight = (measured.time - begin) * measured.masses.sum() * GRAVITY
    lost = weight - (momentum(measured) - before)
    assert np.abs(impulse - lost).max() < 0.03 * -weight[2]
    assert np.abs(normal + lost).max() < 0.05 * -weight[2]


def test_contacts_on_a_slope_have_the_forces_of_a_block():
    angle = np.radians(10)
    scene = cama.Scene(self_contact=False, gravity=9.81 * np.array([np.sin(angle), 0, -np.cos(angle)]))
    sheet(scene, 1.02e-3, cells=6)
    scene.add_obstacle(shape={"plane": {"size": [2, 2]}}, name="floor", friction=0.5)
    simulation = simulate(scene, "production", tolerance=1e-11)
    simulation.step(400)
    weight = 9.81 * simulation.masses.sum()
    rows = simulation.contacts
    side = np.where(rows["vertices"][:, 0] < simulation.cloth_vertex_count, 1, -1)  # the floor may be either
    normal = side[:, None] * rows["normal_force"][:, None] * rows["normal"]
    friction = side[:, None] * rows["tangential_force"]
    assert np.abs(normal.sum(axis=0) - [0, 0, weight * np.cos(angle)]).max() < 1e-3 * weight
    assert np.abs(friction.sum(axis=0) - [-weight * np.sin(angle), 0, 0]).max() < 1e-3 * weight
    load = simulation.force_on("floor").force
    assert np.abs(load + normal.sum(axis=0) + friction.sum(axis=0)).max() < 1e-12 * weight, "action and reaction"


def test_an_interval_is_one_call_of_step():
    scene = cama.Scene(self_contact=False)
    sheet(scene, 0.5, cells=4)
    scene.pin(0, [0])
    one, other = simulate(scene), simulate(scene)
    one.step(12)
    total = 0
    for _ in range(12):
        other.step()
        total += STEP * other.forces
    assert np.abs(one.impulses - total).max() < 1e-15
    assert (one.forces == other.forces).all()
    one.before_step = lambda now: now.set_force([20], (0, 0, 0))
    one.step(3)
    other.step(3)
    assert (one.impulses == other.impulses).all(), "also with a function before each step"


def test_what_cannot_be_asked_is_an_error():
    scene = cama.Scene()
    sheet(scene, 0.5, name="sheet")
    scene.pin("sheet", [0])
    scene.add_obstacle(shape={"sphere": {"radius": 0.1}}, name="ball")
    plain = cama.Simulation(scene, accuracy="interactive", time_step=STEP)
    assert "normal_force" not in plain.contacts.dtype.names
    for ask in (lambda: plain.forces, lambda: plain.impulses, lambda: plain.force_on("ball")):
        with pytest.raises(cama.SceneError, match="set the option forces"):
            ask()
    simulation = simulate(scene)
    simulation.step()
    with pytest.raises(cama.SceneError, match="'sheet', vertex 5 is held by no pin"):
        simulation.force_on([5])
    with pytest.raises(cama.Error, match="box"):
        simulation.force_on("box")
    with pytest.raises(cama.ArrayError):
        simulation.force_on([0.5])
