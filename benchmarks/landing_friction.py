# SPDX-License-Identifier: Apache-2.0
"""Friction where cloth lands on what turns: three sheets that fall on a turning ball, laid down in eight ways.

    python benchmarks/landing_friction.py ['{"error": "0.1 %"}' '{"time_step": 0.005}' ...]

A row for each set of options: angular momentum after 0.25 s over that of the level `reference` at 1/4800 s, mean, least
and largest of the eight; distance to its positions, root mean square, mm; steps, solves and processor seconds of one
thread, of all eight.
"""

import json
import sys
import time

import numpy as np

import cama

SECONDS, BALL = 0.25, 0.3  # s; m, height of the ball's centre
SIDE, CELLS = 1.5, 8


def scene(seed):
    random = np.random.default_rng(seed)
    angle, (x, y) = random.uniform(0, 90), random.uniform(-0.05, 0.05, 2)
    made = cama.Scene(thickness=1.5e-3, friction=0.5)
    made.frame_time = 1 / 60
    turning = {"rotation_rate": [0, 0, 2 * np.pi], "center": [0, 0, BALL]}
    ball = {"sphere": {"radius": 0.25}}
    made.add_obstacle(shape=ball, name="ball", translate=(0, 0, BALL), motion=turning, friction=0.8)
    for i in range(3):
        turn = np.radians(angle + 13 * i) / 2
        made.add_cloth(
            shape={"grid": {"size": [SIDE, SIDE], "cells": [CELLS, CELLS]}},
            material="cotton",
            translate=(x, y, BALL + 0.255 + 0.005 * i),
            rotate=(np.cos(turn), 0, 0, np.sin(turn)),
            name=f"sheet {i}",
        )
    return made


def run(seed, options):
    """Angular momentum about the ball's axis, N m s, positions, steps, solves and processor seconds."""
    simulation = cama.Simulation(scene(seed), backend="cpu", threads=1, **options)
    n, steps, solves, start = simulation.cloth_vertex_count, 0, 0, time.process_time()
    while simulation.time < SECONDS - 1e-9:
        simulation.step()
        steps += 1
        solves += simulation.report["newton_iterations"]
    x, v = simulation.positions[:n], simulation.velocities[:n]
    spin = float(simulation.masses[:n] @ (x[:, 0] * v[:, 1] - x[:, 1] * v[:, 0]))
    return spin, x, steps, solves, time.process_time() - start


def main():
    seeds = range(8)
    exact = [run(seed, {"accuracy": "reference", "time_step": 1 / 4800}) for seed in seeds]
    print("| options | momentum, mean | least to largest | distance, mm | steps | solves | s |\n" + "|---" * 7 + "|")
    for options in map(json.loads, sys.argv[1:] or ["{}"]):
        spins, ends, steps, solves, seconds = zip(*(run(seed, options) for seed in seeds))
        share = np.array(spins) / [e[0] for e in exact]
        distance = 1e3 * np.sqrt(np.mean([np.square(x - e[1]).sum(1).mean() for x, e in zip(ends, exact)]))
        cells = [json.dumps(options), f"{share.mean():.2f}", f"{share.min():.2f} to {share.max():.2f}"]
        cells += [f"{distance:.0f}", sum(steps), sum(solves), f"{sum(seconds):.2f}"]
        print("| " + " | ".join(map(str, cells)) + " |")


if __name__ == "__main__":
    main()
