# SPDX-License-Identifier: Apache-2.0
"""A towel that hangs a little over the edge of a table, and a hand of two pads in front of it.

The examples 07, 09 and 10 import this file. All motion of the towel comes from contact and friction.
"""

import numpy as np

import cama

SIDE = 0.24  # m, of the towel
OVERHANG = 0.04  # m, of it beyond the table
THICKNESS = 1e-3  # m: contact acts below this distance, so pads that are closer than twice of it press
PAD = (0.024, 0.06, 0.008)  # m
PADS = (("lower", -1), ("upper", 1))
OPEN = 0.03  # m, between the pads of the open hand
PRESS = 0.3  # N, with which each pad presses; the towel weighs 0.07 N
CENTRE = np.array([OVERHANG - PAD[0] / 2 - 0.002, 0.0, 0.0])  # m, between the pads at the start


def towel_scene(pad_friction: float = 0.6, cells: int = 30) -> cama.Scene:
    """Towel, table and open hand. Friction of the table is 0.3."""
    scene = cama.Scene(name="gripper", thickness=THICKNESS, friction=0.3)
    scene.add_cloth(
        shape={"grid": {"size": [SIDE, SIDE], "cells": [cells, cells]}},
        material="cotton",
        translate=(OVERHANG - SIDE / 2, 0, 1.01 * THICKNESS),
        name="towel",
    )
    scene.add_obstacle(
        shape={"shape": {"box": {"size": [0.4, 0.4, 0.02]}}}, translate=(-0.2, 0, -0.01), friction=0.3, name="table"
    )
    for name, side in PADS:
        scene.add_obstacle(
            shape={"shape": {"box": {"size": list(PAD)}}},
            translate=tuple(CENTRE + [0, 0, side * (OPEN + PAD[2]) / 2]),
            friction=pad_friction,
            name=name,
        )
    return scene


def pad_pose(side: int, position, angle, gap):
    """Translation [..., 3], m, and rotation [..., 4] of the lower (-1) or upper (1) pad of one hand or of many.

    Args:
        position: [..., 3], m, of the middle between the pads.
        angle: [...], radians, by which a hand is turned from flat towards fingers that point down.
        gap: [...], m, between its pads.
    """
    zero = np.zeros_like(angle)
    along = np.stack([np.cos(angle), zero, np.sin(angle)], -1)  # where the turn takes x
    half = np.asarray(angle) / 2
    translation = position + np.asarray(side * (gap - OPEN) / 2)[..., None] * normal(angle) - CENTRE[0] * along
    return translation, np.stack([np.cos(half), zero, -np.sin(half), zero], -1)


def normal(angle):
    """[..., 3], from the lower pad to the upper one."""
    return np.stack([-np.sin(angle), np.zeros_like(angle), np.cos(angle)], -1)


class Hand:
    """Two pads that move as one, and towards each other."""

    def __init__(self, simulation: cama.Simulation) -> None:
        self.simulation = simulation
        self.position = CENTRE.copy()  # m, of the middle between the pads
        self.angle = 0.0  # radians, by which the hand is turned from flat towards fingers that point down
        self.gap = OPEN  # m, between the pads

    def move(self, duration: float) -> None:
        """Lets the pads reach position, angle and gap within this time, s."""
        for name, side in PADS:
            pose = pad_pose(side, self.position, self.angle, self.gap)
            self.simulation.set_obstacle_pose(name, *pose, duration=duration)

    def pressing(self) -> float:
        """N, with which the pads press the towel between them, in the last step."""
        lower, upper = (self.simulation.force_on(name).force @ normal(self.angle) for name, _ in PADS)
        return min(-lower, upper)
