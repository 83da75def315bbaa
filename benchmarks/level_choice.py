# SPDX-License-Identifier: Apache-2.0
"""What candidates for the accuracy levels cost and give, each in a run of its own of a shipped scene.

A row is a candidate in a scene: processor seconds a simulated second of one thread; least and largest processor time
of a frame of 1/60 s, ms; steps and attempts taken back; error of a frame, root mean square over some frames and
largest, per cent of the cloth's size, of the run against the level `accurate` from the same start; kinetic energy, mean
over the run after the first tenth, and total energy at the end, J; intersections at the end. `--truth` adds the level
`accurate` itself. Tables of results/quick-levels-*.md:

python benchmarks/level_choice.py drape flag shapes sphere pile funnel twisting garment --resolution 400 -o 400.csv
"""

import argparse
import csv
import tempfile
import time
from pathlib import Path

import numpy as np

import cama
from error_control import rms

FRAME = 1 / 60  # s
FRAMES = (6, 15, 24, 33, 42, 51, 75, 105)
EULER = {"integrator": "backward_euler", "tolerance": 3e-2, "precision": "single", "max_impact_passes": 4}
BDF2 = {"tolerance": 3e-2, "precision": "single", "max_impact_passes": 4}
ONE_LENGTH = {"error": "", "newton_iterations": 1}
CANDIDATES = {
    "production": {},
    "interactive": {"accuracy": "interactive"},
    "preview": {"accuracy": "preview"},
    "interactive until 2026-11-26": {"accuracy": "interactive", **ONE_LENGTH},
    "preview until 2026-11-26": {"accuracy": "preview", **ONE_LENGTH, "tolerance": 1e-1, "max_iterations": 24},
    "bdf2 1 %": {**BDF2, "error": "1 %"},
    "bdf2 2 %": {**BDF2, "error": "2 %"},
    "bdf2 1 %, mixed, 1e-2": {"error": "1 %"},
    "bdf2 1 %, mixed, 1e-1": {"error": "1 %", "tolerance": 1e-1},
    "bdf2 0.5 %, one solve, mixed, 1e-2": {"error": "0.5 %", "newton_iterations": 1},
    "bdf2 1/120 s, mixed, 1e-2": {"time_step": 1 / 120},
    "bdf2 1/60 s, one solve, mixed, 1e-2": {"time_step": 1 / 60, "newton_iterations": 1},
    "euler 0.3 %, one solve": {**EULER, "error": "0.3 %", "newton_iterations": 1},
    "euler 0.5 %, one solve": {**EULER, "error": "0.5 %", "newton_iterations": 1},
    "euler 2 %, one solve": {**EULER, "error": "2 %", "newton_iterations": 1},
    "euler 1/120 s, one solve": {**EULER, "time_step": 1 / 120, "newton_iterations": 1},
    "euler 1/60 s, one solve": {**EULER, "time_step": 1 / 60, "newton_iterations": 1},
    "euler 0.3 %": {**EULER, "error": "0.3 %"},
    "euler 0.5 %": {**EULER, "error": "0.5 %"},
}
HEADS = [
    *("scene", "triangles", "candidate", "seconds", "least_ms", "largest_ms", "steps", "rejected", "iterations"),
    *("solves", "error", "largest_error", "kinetic", "total", "intersections"),
]


def measure(scene, options, frames, seconds, truth):
    scene.time_step, scene.frame_time = 0, FRAME
    where = {"backend": "cpu", "threads": 1}
    run = cama.Simulation(scene, **where, **options)
    count, masses = run.cloth_vertex_count, run.masses
    size = max(np.ptp(run.positions[first:last], axis=0).max() for first, last in run.cloth_ranges)
    spent, kinetic, errors, steps, rejected, iterations, solves = [], [], [], 0, 0, 0, 0
    with tempfile.TemporaryDirectory() as folder:
        start = Path(folder) / "start.h5"
        for frame in range(round(seconds / FRAME)):
            measured = frame in frames and not truth
            if measured:
                run.save_checkpoint(start)
            cost = 0.0
            while run.time < (frame + 1 - 1e-6) * FRAME:
                before = time.process_time()
                run.step()
                cost += time.process_time() - before
                steps += 1
                rejected += run.report["rejected"]
                iterations += run.report["iterations"]
                solves += run.report["newton_iterations"]
            spent.append(cost)
            kinetic.append(run.energy()["kinetic"])
            if measured:
                exact = cama.Simulation(scene, **where, accuracy="accurate", time_step=1 / 1200)
                exact.load_checkpoint(start)
                exact.step(20)
                errors.append(rms(run.positions[:count] - exact.positions[:count], masses) / size)
    errors, spent = 100 * np.array(errors or [np.nan]), np.array(spent)
    return [
        f"{spent.sum() / seconds:.4g}",
        f"{1e3 * spent.min():.3g}",
        f"{1e3 * spent.max():.3g}",
        steps,
        rejected,
        iterations,
        solves,
        f"{np.sqrt(np.mean(errors**2)):.3g}",
        f"{errors.max():.3g}",
        f"{np.mean(kinetic[len(kinetic) // 10 :]):.4g}",
        f"{sum(run.energy().values()):.4g}",
        run.count_intersections(),
    ]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+")
    parser.add_argument("--resolution", type=int, default=400, help="cloth triangles")
    parser.add_argument("--candidates", nargs="+", default=list(CANDIDATES))
    parser.add_argument("--frames", type=int, nargs="*", default=FRAMES, help="whose errors are measured")
    parser.add_argument("--seconds", type=float, default=2, help="of a run")
    parser.add_argument("--truth", action="store_true", help="also run the level `accurate`")
    parser.add_argument("-o", "--output", type=Path, required=True)
    given = parser.parse_args()
    new = not given.output.exists()
    with given.output.open("a", newline="") as file:
        writer = csv.writer(file)
        if new:
            writer.writerow(HEADS)
        for name in given.scenes:
            rows = [(label, CANDIDATES[label], False) for label in given.candidates]
            for label, options, truth in rows + [("accurate", {"accuracy": "accurate"}, True)] * given.truth:
                scene = cama.Scene.load(name, given.resolution)
                row = [name, given.resolution, label, *measure(scene, options, given.frames, given.seconds, truth)]
                writer.writerow(row)
                file.flush()
                print(*row, flush=True)


if __name__ == "__main__":
    main()
