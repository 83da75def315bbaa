# SPDX-License-Identifier: Apache-2.0
"""What the option `error` promises and keeps: error of a frame of 1/60 s over the error that was asked for.

A run with `error` is compared, over some of its frames, with the level `reference` at 1/4800 s from the same start.
Rows of the tables in results/error-control-*.md:

python benchmarks/error_control.py drape sphere flag funnel twisting pile shapes --resolution 200
python benchmarks/error_control.py --variations 20
"""

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

import cama

FRAME = 1 / 60
FRAMES = (6, 15, 24, 33, 42, 51)
ASKED = (1.0, 0.3, 0.1, 0.03, 0.01)  # %
FABRICS = ("cotton", "denim", "jersey", "leather", "linen", "polyester", "silk", "wool")


def rms(difference, masses):
    return np.sqrt((np.square(difference).sum(1) * masses).sum() / masses.sum())


def measure(scene, options, frames=FRAMES, backend="cpu"):
    """Runs to the last of the frames.

    Returns (errors of the frames as shares of the cloth's size, lengths of all steps in s, attempts taken back,
    seconds a simulated second).
    """
    scene.time_step, scene.frame_time = 0, FRAME
    where = {"backend": backend, "threads": 1}
    run = cama.Simulation(scene, **where, **options)
    count, masses = run.cloth_vertex_count, run.masses
    size = max(np.ptp(run.positions[first:last], axis=0).max() for first, last in run.cloth_ranges)
    errors, lengths, rejected, seconds = [], [], 0, 0.0
    with tempfile.TemporaryDirectory() as folder:
        start = Path(folder) / "start.h5"
        for frame in range(max(frames) + 1):
            if frame in frames:
                run.save_checkpoint(start)
            while run.time < (frame + 1 - 1e-6) * FRAME:
                before = time.perf_counter()
                run.step()
                seconds += time.perf_counter() - before
                lengths.append(run.report["time_step"])
                rejected += run.report["rejected"]
            if frame in frames:
                exact = cama.Simulation(scene, **where, accuracy="reference", time_step=1 / 4800)
                exact.load_checkpoint(start)
                exact.step(80)
                errors.append(rms(run.positions[:count] - exact.positions[:count], masses) / size)
    return np.array(errors), np.array(lengths), rejected, seconds / ((max(frames) + 1) * FRAME)


def variation(number):
    """Returns (name, scene): a sheet of random fabric, size, mesh and speed that meets something."""
    random = np.random.default_rng(number)
    fabric = random.choice(FABRICS)
    side = float(random.choice([0.3, 0.6, 1.0, 2.0]))
    cells = int(14 * 7 ** random.random() ** 2)  # 400 to 19,000 triangles
    speed = float(random.choice([0.0, 1.0, 4.0]))
    kind = random.choice(["ball", "floor", "pinned", "wind", "shaken", "free"])
    scene = cama.Scene(thickness=2e-3, friction=float(random.uniform(0.1, 0.6)))
    velocity = (speed * float(random.uniform(-0.5, 0.5)), 0.0, -speed)
    quaternion = (1.0, *(random.uniform(-0.3, 0.3, 3)))
    scene.add_cloth(
        shape={"grid": {"size": [side, side * float(random.uniform(0.5, 1.0))], "cells": [cells, cells]}},
        material=str(fabric),
        translate=(0, 0, 0.6 * side),
        rotate=np.array(quaternion) / np.linalg.norm(quaternion),
        velocity=velocity if kind in ("ball", "floor", "free") else (0, 0, 0),
        name="sheet",
    )
    corners = [0, cells] if kind in ("pinned", "wind", "shaken") else []
    if kind == "ball":
        scene.add_obstacle(shape={"sphere": {"radius": 0.25 * side}}, name="ball")
    if kind == "floor":
        scene.add_obstacle(shape={"shape": {"plane": {}}}, name="floor")
    if kind == "wind":
        scene.wind = {"velocity": (5.0, 2.0, 0.0), "density": 1.2, "drag": 0.05}
    if kind == "shaken":
        scene.pin("sheet", corners, motion={"oscillation": (0.2 * side, 0, 0), "period": 0.5})
    elif corners:
        scene.pin("sheet", corners)
    return f"{number}: {fabric}, {side:g} m, {2 * cells * cells:,} triangles, {kind}, {speed:g} m/s", scene


def report(name, scene, asked, fixed, frames, backend):
    ratios = []
    for rate in fixed:
        errors, lengths, _, seconds = measure(scene, {"time_step": 1 / rate}, frames, backend)
        cells = [name, f"1/{rate} s", len(lengths), 0, f"{1e3 / rate:.2g}", f"{seconds:.2g}"]
        print("| " + " | ".join(map(str, cells)) + f" | {' '.join(f'{100 * e:.2g} %' for e in errors)} |", flush=True)
    for share in asked:
        errors, lengths, rejected, seconds = measure(scene, {"error": f"{share} %"}, frames, backend)
        ratios.extend(100 * errors / share)
        cells = [
            name,
            f"{share} %",
            len(lengths),
            rejected,
            f"{1e3 * lengths.min():.2g} to {1e3 * lengths.max():.2g}",
            f"{seconds:.2g}",
            " ".join(f"{r:.2g}" for r in 100 * errors / share),
        ]
        print("| " + " | ".join(map(str, cells)) + " |", flush=True)
    return ratios


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", nargs="*")
    parser.add_argument("--resolution", type=int, default=0, help="cloth triangles, 0: the scene's own")
    parser.add_argument("--variations", type=int, default=0, help="number of random scenes")
    parser.add_argument("--first", type=int, default=0, help="number of the first of them")
    parser.add_argument("--asked", type=float, nargs="*", default=ASKED, help="errors, %% of the cloth's size")
    parser.add_argument("--fixed", type=int, nargs="*", default=(), help="steps a second of runs without `error`")
    parser.add_argument("--frames", type=int, nargs="+", default=FRAMES, help="whose errors are measured")
    parser.add_argument("--backend", default="cpu")
    given = parser.parse_args()
    heads = ["scene", "asked", "steps", "taken back", "length, ms", "s a second", "error / asked, by frame"]
    print("| " + " | ".join(heads) + " |\n" + "|---" * len(heads) + "|")
    scenes = [(f"{name}, {given.resolution}", cama.Scene.load(name, given.resolution)) for name in given.scenes]
    scenes += [variation(n) for n in range(given.first, given.first + given.variations)]
    rest = (given.asked, given.fixed, given.frames, given.backend)
    ratios = np.array([ratio for name, scene in scenes for ratio in report(name, scene, *rest)])
    if not len(ratios):
        return
    within = ", ".join(f"{100 * np.mean(ratios <= most):.3g} % at most {most}" for most in (1, 3))
    quantiles = np.quantile(ratios, (0.5, 0.9, 1.0))
    print("\n{} frames: median {:.2g}, 90 % below {:.2g}, largest {:.2g}, ".format(len(ratios), *quantiles) + within)


if __name__ == "__main__":
    main()
