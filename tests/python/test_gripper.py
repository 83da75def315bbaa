# SPDX-License-Identifier: Apache-2.0
"""Cloth between two pads that press: the normal force and the pull at which it slips, by Hooke and Coulomb."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import cama
from cama.io.recording import Recording
from conftest import judge

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
STEP = 1 / 240
THICKNESS, STIFFNESS = 1e-3, 1e6  # m, N/m^3
GAP = 1.6 * THICKNESS  # between the closed pads
SIDE = 0.04  # m, of the patch between them
BOUND = 0.02  # of the closed form


def clamped(friction, *, hanging=0.0, time_step=STEP, accuracy="production"):
    """A strip whose upper SIDE is between two closed pads, without gravity; `hanging` m of it are below them.

    Without any, the pads are larger than the strip.
    """
    cells = round(SIDE / 0.005), round((SIDE + hanging) / 0.005)
    scene = cama.Scene(thickness=THICKNESS, gravity=(0, 0, 0), self_contact=False)
    material = cama.Material.fabric("cotton")
    material.contact_stiffness = STIFFNESS
    turned = (np.sqrt(0.5), np.sqrt(0.5), 0, 0)  # about x: the strip hangs in the plane y = 0
    scene.add_cloth(
        shape={"grid": {"size": [SIDE, SIDE + hanging], "cells": list(cells)}},
        material=material,
        rotate=turned,
        translate=(0.0011, 0, -hanging / 2 + 0.0003),
        name="strip",
    )
    for name, side in (("left", -1), ("right", 1)):
        scene.add_obstacle(
            shape={"shape": {"box": {"size": [0.1, 0.02, SIDE if hanging else 2 * SIDE]}}},
            translate=(0, side * (0.01 + 1.05 * THICKNESS), 0),
            friction=friction,
            contact_stiffness=STIFFNESS,
            name=name,
        )
    options = {"backend": "cpu", "threads": 1, "forces": True}
    simulation = cama.Simulation(scene, accuracy=accuracy, time_step=time_step, **options)
    for name, side in (("left", -1), ("right", 1)):
        simulation.set_obstacle_pose(name, (0, side * (GAP / 2 - 1.05 * THICKNESS), 0), duration=0.1)
    simulation.step(round(0.3 / time_step))
    return simulation


def normal_force(simulation):
    """N, with which each pad presses."""
    left, right = (simulation.force_on(name).force[1] for name in ("left", "right"))
    assert left == pytest.approx(-right, rel=1e-6), "nothing but the pads presses"
    return right


def slipped(simulation, where, force):
    """m, by which the strip's upper edge moves down under a force, N, that grows for 0.25 s and stays for 0.5 s."""
    n = simulation.cloth_vertex_count
    strip = simulation.positions[:n]
    top = strip[:, 2] > strip[:, 2].max() - 1e-6
    hem = np.flatnonzero(strip[:, 2] < strip[:, 2].min() + 1e-6)
    steps = round(0.25 / simulation.time_step)
    for k in range(1, steps + 1):
        now = force * k / steps
        if where == "weight":
            simulation.gravity = (0, 0, -now / simulation.masses.sum())
        else:
            simulation.set_force(hem, (0, 0, -now / len(hem)))
        simulation.step()
    simulation.step(2 * steps)
    return (strip - simulation.positions[:n])[top, 2].mean()


def test_pads_press_as_their_gap_says():
    """Each contact is a spring of STIFFNESS times its area, pressed by what the gap leaves out of the thickness."""
    simulation = clamped(0.6)
    assert normal_force(simulation) == pytest.approx(STIFFNESS * (THICKNESS - GAP / 2) * SIDE**2, rel=1e-3)
    assert simulation.count_intersections() == 0


@pytest.mark.parametrize("friction", [0.6, 0.05])
@pytest.mark.parametrize("where, hanging, step", [("weight", 0, STEP), ("hem", 0, STEP), ("hem", 0.02, STEP / 4)])
def test_pads_hold_twice_the_friction_of_their_normal_force(friction, where, hanging, step):
    """The weight of a patch, a pull at its lower edge, and a pull at the hem of a strip that hangs out of the pads.

    The last takes shorter steps: the pull is up to 200 times the weight of the strip, and at 1/240 s it slips between
    0.9 and 0.98 of the limit.
    """
    limit = 2 * friction * normal_force(clamped(friction, hanging=hanging, time_step=step))
    holds = clamped(friction, hanging=hanging, time_step=step)
    assert slipped(holds, where, (1 - BOUND) * limit) < 0.002 * SIDE  # the strip stretches between the pads
    assert holds.count_intersections() == 0
    slips = clamped(friction, hanging=hanging, time_step=step)
    assert slipped(slips, where, (1 + BOUND) * limit) > SIDE / 4


@pytest.mark.parametrize("where, hanging, step", [("weight", 0, STEP), ("hem", 0, STEP), ("hem", 0.02, STEP / 4)])
def test_one_solve_a_step_holds_without_creep(where, hanging, step):
    """The pull moves the strip while it grows, by what one solve brakes of it in a step; then nothing moves."""
    options = {"hanging": hanging, "time_step": step, "accuracy": "interactive"}
    limit = 2 * 0.6 * normal_force(clamped(0.6, **options))
    holds = clamped(0.6, **options)
    assert slipped(holds, where, (1 - BOUND) * limit) < 0.01 * SIDE
    before = holds.positions[: holds.cloth_vertex_count]
    holds.step(round(1 / step))
    assert np.abs(holds.positions[: holds.cloth_vertex_count] - before).max() < 1e-3 * 0.01 * SIDE
    assert holds.count_intersections() == 0
    assert slipped(clamped(0.6, **options), where, (1 + BOUND) * limit) > SIDE / 4


@pytest.mark.parametrize("rate", [60, 120, 960])
def test_the_time_step_does_not_matter(rate):
    """The springs of the contacts would swing ten times within a step of 1/60 s."""
    limit = 2 * 0.6 * normal_force(clamped(0.6, time_step=1 / rate))
    assert slipped(clamped(0.6, time_step=1 / rate), "weight", (1 - BOUND) * limit) < 0.005 * SIDE
    assert slipped(clamped(0.6, time_step=1 / rate), "weight", (1 + BOUND) * limit) > SIDE / 4


def gripper(*arguments):
    """{what: text} of what examples/07_gripper.py prints."""
    done = subprocess.run(
        [sys.executable, str(EXAMPLES / "07_gripper.py"), *arguments], capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0 and "PlausibilityWarning" not in done.stderr, done.stderr
    return dict(line.split(": ", 1) for line in done.stdout.splitlines())


def numbers(text):
    return [float(word) for word in re.findall(r"-?\d+\.\d+", text)]


def test_the_gripper_lifts_a_towel_and_carries_its_weight():
    claims = gripper()
    assert claims["lifted"] == "True" and claims["intersections"] == "0"
    weight, load = numbers(claims["weight of the towel"])
    assert weight == pytest.approx(0.24**2 * 0.12 * 9.81, abs=1e-4)  # side, density of cotton
    assert load == pytest.approx(weight, rel=0.1)  # it still swings a little
    assert numbers(claims["pads"])[1] > weight / (2 * 0.6)


def test_the_gripper_drops_a_towel_where_friction_is_low(tmp_path):
    claims = gripper("--friction", "0.05", "--record", str(tmp_path / "run"))
    assert claims["lifted"] == "False" and claims["intersections"] == "0"
    assert numbers(claims["weight of the towel"])[1] == 0
    with Recording(tmp_path / "run") as recording:
        assert len(recording) == 271
        assert [recording.counts(i)["intersections"] for i in range(271)] == [0] * 271, "no frame has intersections"
    assert judge(tmp_path / "run", every=30) == 0, "nor by ipctk"
