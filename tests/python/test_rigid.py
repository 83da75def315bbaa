# SPDX-License-Identifier: Apache-2.0
"""Rigid bodies in Python: descriptions, poses, checkpoints, worlds, and the example."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import cama

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "12_hammock.py"


def ball_over_sheet(speed=-1.0, **rigid):
    scene = cama.Scene(thickness=2e-3)
    scene.add_cloth(shape={"grid": {"size": [0.3, 0.3], "cells": [8, 8]}}, material="cotton", name="sheet")
    scene.pin("sheet", [0, 8, 72, 80])
    given = {"mass": 0.2, "velocity": (0, 0, speed), **rigid}
    scene.add_obstacle(
        shape={"sphere": {"radius": 0.05, "triangles": 180}}, translate=(0.01, 0, 0.06), rigid=given, name="ball"
    )
    return scene


def simulate(scene, steps=12, **options):
    simulation = cama.Simulation(scene, time_step=0.005, backend="cpu", **options)
    simulation.step(steps)
    return simulation


def test_a_description_is_kept_and_the_pose_begins_where_it_says():
    inertia = np.diag([2e-3, 3e-3, 4e-3])
    scene = ball_over_sheet(center=(0, 0, 0.07), inertia=inertia, angular_velocity=(1, 2, 3))
    again = cama.Scene.parse(scene.to_json())
    for described in (scene, again):
        rigid = described.obstacles[0].rigid
        assert (rigid.mass, tuple(rigid.center), tuple(rigid.velocity)) == (0.2, (0, 0, 0.07), (0, 0, -1))
        assert list(rigid.inertia) == [2e-3, 3e-3, 4e-3, 0, 0, 0]
    pose = cama.Simulation(again, backend="cpu").rigid_pose("ball")
    assert pose.center == pytest.approx([0, 0, 0.07]) and pose.rotation == pytest.approx([1, 0, 0, 0])
    assert pose.angular_momentum == pytest.approx(inertia @ [1, 2, 3])
    assert pose.angular_velocity == pytest.approx([1, 2, 3])


def test_a_body_moves_by_what_the_cloth_gives_it():
    simulation = cama.Simulation(ball_over_sheet(), time_step=0.005, backend="cpu")
    simulation.step(30)
    pose, given = simulation.rigid_pose("ball"), simulation.force_on("ball").impulse
    assert given[2] > 0.05, "the sheet pushes"
    # What the cloth loses to nothing is the body's too; it is little.
    assert 0.2 * (pose.velocity - [0, 0, -1]) - [0, 0, -0.2 * 9.81 * 0.15] == pytest.approx(given, abs=2e-3 * given[2])
    first, last = simulation.obstacle_ranges[0]
    assert simulation.positions[first:last].mean(0) == pytest.approx(pose.center, abs=1e-3)
    assert simulation.count_intersections() == 0


def test_a_checkpoint_file_continues_in_the_same_bits(tmp_path):
    whole = simulate(ball_over_sheet())
    whole.save_checkpoint(tmp_path / "checkpoint.h5")
    whole.step(8)
    again = cama.Simulation(ball_over_sheet(), time_step=0.005, backend="cpu")
    again.load_checkpoint(tmp_path / "checkpoint.h5")
    again.step(8)
    assert again.state_hash == whole.state_hash
    assert (again.rigid_pose("ball").center == whole.rigid_pose("ball").center).all()
    assert (again.forces == whole.forces).all()


def test_worlds_have_the_bits_of_simulations_alone():
    scenes = [ball_over_sheet(speed) for speed in (-0.5, -1.0, -1.5)]
    worlds = cama.Worlds(scenes, time_step=0.005, backend="cpu")
    worlds.step(20)
    for scene, world in zip(scenes, worlds, strict=True):
        alone = simulate(scene, 20)
        assert world.state_hash == alone.state_hash
        assert (world.rigid_pose("ball").velocity == alone.rigid_pose("ball").velocity).all()


def test_error_control_holds_with_bodies():
    simulation = cama.Simulation(ball_over_sheet(), error="2 mm", backend="cpu")
    while simulation.time < 0.1:
        simulation.step()
    fine = cama.Simulation(ball_over_sheet(), time_step=1 / 2000, backend="cpu")
    while fine.time < simulation.time - 1e-9:
        fine.step()
    assert simulation.rigid_pose("ball").center == pytest.approx(fine.rigid_pose("ball").center, abs=4e-3)


@pytest.mark.parametrize(
    "rigid, message",
    [
        ({"mass": 0}, "rigid: has mass 0"),
        ({"mas": 1}, "'mas' is not known"),
        ({"mass": 1, "inertia": [[1, 2, 0], [0, 1, 0], [0, 0, 1]]}, "not symmetric"),
        (3, "neither a cama.Rigid nor a dict"),
    ],
)
def test_bad_descriptions_are_named(rigid, message):
    scene = cama.Scene()
    scene.add_cloth(shape={"grid": {"size": [0.1, 0.1], "cells": [2, 2]}}, material="cotton")
    with pytest.raises(cama.SceneError, match=re.escape(message)):
        scene.add_obstacle(shape={"box": {"size": [0.1, 0.1, 0.1]}}, translate=(0, 0, 1), rigid=rigid)
        scene.validate()


def test_the_example_carries_the_weight():
    text = subprocess.run([sys.executable, EXAMPLE], check=True, capture_output=True, text=True).stdout
    load, weight = (float(x) for x in re.search(r"load: ([\d.]+) N, weight: ([\d.]+) N", text).groups())
    assert load == pytest.approx(weight, rel=1e-3)
    assert "intersections: 0" in text
