# SPDX-License-Identifier: Apache-2.0
"""A thousand cloths of random fabric, place and turn fall on a ball: `python examples/08_dataset.py draped.h5`.

The file has a row for each of them: the cloth at the start and after a second, and what was random. A run that was
interrupted goes on with the same command.
"""

import argparse

import numpy as np

import cama

FABRICS = ("cotton", "silk", "wool", "denim")
SIDE, RADIUS = 0.4, 0.12  # m


def draped(random):
    """The scene of a sample and its parameters; all that is random comes from `random`, a NumPy generator."""
    fabric = int(random.integers(len(FABRICS)))
    turn = random.uniform(0, np.pi / 2)
    x, y = random.uniform(-0.05, 0.05, 2)
    friction = random.uniform(0.1, 0.8)
    scene = cama.Scene(name="draped", frame_time=1.0, time_step=1 / 240)
    scene.add_cloth(
        shape={"grid": {"size": [SIDE, SIDE], "cells": [16, 16]}},
        material=FABRICS[fabric],
        rotate=(np.cos(turn / 2), 0, 0, np.sin(turn / 2)),
        translate=(x, y, RADIUS + 0.005),
        name="cloth",
    )
    scene.add_obstacle(shape={"shape": {"sphere": {"radius": RADIUS}}}, friction=friction, name="ball")
    return scene, {"fabric": fabric, "turn": turn, "x": x, "y": y, "friction": friction}


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("file")
    parser.add_argument("--samples", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    cama.dataset.generate(given.file, draped, given.samples, seed=given.seed, batch=50, progress=True)
    print(f"samples: {given.samples} in {given.file}")
