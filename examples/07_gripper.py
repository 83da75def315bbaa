# SPDX-License-Identifier: Apache-2.0
"""Two pads close on the edge of a towel until they feel it, lift it off a table and turn: `python
examples/07_gripper.py`.

Friction of the pads alone holds the towel; `--friction 0.05` drops it. `--record out/gripper` writes a folder for `cama
render` and `cama view`.
"""

import argparse

import numpy as np
from gripper import CENTRE, PRESS, THICKNESS, Hand, towel_scene

import cama

parser = argparse.ArgumentParser()
parser.add_argument("--friction", type=float, default=0.6, help="of the pads")
parser.add_argument("--record", metavar="FOLDER", help="where to write frames")
given = parser.parse_args()

INTERVAL = 1 / 60  # s, between two commands
CLOSE, LIFT, HOLD = 90, 120, 60  # intervals
HEIGHT = 0.3  # m

scene = towel_scene(given.friction)
# The level "interactive", which solves once a step, holds as well.
simulation = cama.Simulation(scene, accuracy="production", time_step=INTERVAL / 4, forces=True)
steps = round(INTERVAL / simulation.time_step)
hand = Hand(simulation)


def smooth(x):
    """0 to 1, at rest at both ends."""
    return x * x * (3 - 2 * x)


def command(k):
    """Moves the hand in interval k: it closes until it presses, then lifts and turns."""
    if k < CLOSE:
        if hand.gap > 2.2 * THICKNESS:
            hand.gap = max(hand.gap - 0.06 * INTERVAL, 2.2 * THICKNESS)
        elif hand.pressing() < PRESS:
            hand.gap = max(hand.gap - 0.03 * THICKNESS, THICKNESS)
    else:
        way = smooth(min((k - CLOSE) / LIFT, 1))
        hand.angle = np.pi / 2 * way
        hand.position = CENTRE + [-0.05 * way, 0, HEIGHT * way]
    hand.move(INTERVAL)


def before_step(now):
    """Gives a command at the start of every interval."""
    if now.step_count % steps == 0:
        command(now.step_count // steps)


simulation.before_step = before_step
if given.record:
    cama.record(simulation, given.record, frames=CLOSE + LIFT + HOLD, overwrite=True)
    intersections = simulation.count_intersections()
else:
    intersections = sum(frame.intersections for frame in simulation.frames(CLOSE + LIFT + HOLD))

towel = simulation.positions[: simulation.cloth_vertex_count]
weight = 9.81 * simulation.masses.sum()
load = sum(simulation.force_on(name).force for name in ("lower", "upper"))
print(f"pads: {hand.gap * 1e3:.3f} mm apart, each presses with {hand.pressing():.3f} N")
print(f"weight of the towel: {weight:.4f} N, load of the hand: {-load[2]:.4f} N")
print(f"highest point of the towel: {towel[:, 2].max():.3f} m, hand at {hand.position[2]:.3f} m")
print(f"lifted: {bool(towel[:, 2].max() > hand.position[2])}")
print(f"intersections: {intersections}")
