# SPDX-License-Identifier: Apache-2.0
"""Error of `production` after ten steps that start from checkpoints of one run, at its own time step and others.

The rows of the tables in results/accuracy-levels-*.md:

python benchmarks/restarted_steps.py drape sphere flag funnel twisting --resolution 400
python benchmarks/restarted_steps.py drape sphere flag funnel twisting --per-second
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np

import cama

STEPS, REFERENCE, PATH = 10, 80, 1 / 960
TIMES = (0.1, 0.25, 0.4, 0.55, 0.7, 0.85)


def rms(difference, masses):
    return np.sqrt((np.square(difference).sum(1) * masses).sum() / masses.sum())


def measure(name, resolution, time_steps, times=TIMES, backend="cpu"):
    """(triangles, edge in m, [(time step in s, error, uncertainty of the reference)]), the level's own step first.

    Errors are in edges, rms over starts.
    """
    scene = cama.Scene.load(name, resolution)
    where = {"backend": backend, "threads": 1}
    time_steps = [cama.Simulation(scene, **where).time_step, *time_steps]
    path = cama.Simulation(scene, time_step=PATH, **where)
    count, masses = path.cloth_vertex_count, path.masses
    with tempfile.TemporaryDirectory() as folder:
        starts = [Path(folder) / f"{i}.h5" for i in range(len(times))]
        for start, time in zip(starts, times):
            path.step(round((time - path.time) / PATH))
            path.save_checkpoint(start)
        faces = path.faces[: path.cloth_triangle_count]
        edge = np.mean(
            [
                np.linalg.norm(path.positions[faces[:, i]] - path.positions[faces[:, i - 1]], axis=1).mean()
                for i in range(3)
            ]
        )

        def run(start, window, steps, **options):
            simulation = cama.Simulation(scene, time_step=window / steps, **where, **options)
            simulation.load_checkpoint(start)
            simulation.step(steps)
            return simulation.positions[:count]

        def error(ends, exact):
            return np.sqrt(np.mean([rms(x - y, masses) ** 2 for x, y in zip(ends, exact)])) / edge

        rows = []
        for step in time_steps:
            fine, half, own = (
                [run(s, STEPS * step, n, **options) for s in starts]
                for n, options in (
                    (REFERENCE, {"accuracy": "reference"}),
                    (REFERENCE // 2, {"accuracy": "reference"}),
                    (STEPS, {}),
                )
            )

            rows.append((step, error(own, fine), error(half, fine)))
    return len(faces), edge, rows


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", nargs="+")
    parser.add_argument("--resolution", type=int, default=0, help="cloth triangles, 0: the scene's own")
    parser.add_argument("--per-second", type=int, nargs="*", default=[200, 480, 960, 2000], help="steps per second")
    parser.add_argument("--times", type=float, nargs="+", default=TIMES, help="s, of the starts")
    parser.add_argument("--backend", default="cpu")
    arguments = parser.parse_args()
    heads = ["scene, triangles", "an edge", "`production`", *(f"1/{n} s" for n in arguments.per_second)]
    print("| " + " | ".join(heads) + " |\n" + "|---" * len(heads) + "|")
    for scene in arguments.scenes:
        triangles, edge, rows = measure(
            scene, arguments.resolution, [1 / n for n in arguments.per_second], arguments.times, arguments.backend
        )
        cells = [f"{100 * error:.2g} % ({100 * uncertainty:.1g})" for _, error, uncertainty in rows]
        cells[0] += f" at 1/{1 / rows[0][0]:.0f} s"
        print("| " + " | ".join([f"{scene}, {triangles:,}", f"{edge * 1e3:.1f} mm", *cells]) + " |", flush=True)


if __name__ == "__main__":
    main()
