# SPDX-License-Identifier: Apache-2.0
"""Error of the accuracy levels over one frame of 1/60 s that starts from checkpoints of one run of `production`.

As a fraction of the cloth's size, its largest side at the start. The rows of the table in results/default-level-*.md:

python benchmarks/frame_error.py drape sphere flag funnel twisting pile shapes --resolution 200
python benchmarks/frame_error.py drape sphere flag funnel twisting pile shapes --resolution 2000
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np

import cama

FRAME = 1 / 60
REFERENCE = 1 / 4800  # s, step of the level `reference`
TIMES = (0.1, 0.25, 0.4, 0.55, 0.7, 0.85)
LEVELS = {name: {"accuracy": name} for name in ("preview", "interactive", "production", "accurate")}
FORMER = {"time_step": 1 / 960, "integrator": "backward_euler", "newton_iterations": 1, "tolerance": 1e-3}


def rms(difference, masses):
    return np.sqrt((np.square(difference).sum(1) * masses).sum() / masses.sum())


def measure(name, resolution, levels, times=TIMES, backend="cpu"):
    """(triangles, size in m, {label: error}, uncertainty of the reference). Errors: rms over starts, fractions of size.

    levels: options by label. A level has its own time step, not the scene's.
    """
    scene = cama.Scene.load(name, resolution)
    scene.time_step, scene.frame_time = 0, FRAME
    where = {"backend": backend, "threads": 1}
    path = cama.Simulation(scene, **where)
    count, masses = path.cloth_vertex_count, path.masses
    size = np.ptp(path.positions[:count], axis=0).max()
    with tempfile.TemporaryDirectory() as folder:
        starts = [Path(folder) / f"{i}.h5" for i in range(len(times))]
        for start, time in zip(starts, times):
            while path.time < time - FRAME / 2:
                path.step_frame()
            path.save_checkpoint(start)

        def ends(options):
            found = []
            for start in starts:
                simulation = cama.Simulation(scene, **where, **options)
                simulation.load_checkpoint(start)
                simulation.step_frame()
                found.append(simulation.positions[:count])
            return found

        def error(of, exact):
            return np.sqrt(np.mean([rms(x - y, masses) ** 2 for x, y in zip(of, exact)])) / size

        exact = ends({"accuracy": "reference", "time_step": REFERENCE})
        half = ends({"accuracy": "reference", "time_step": 2 * REFERENCE})
        errors = {label: error(ends(options), exact) for label, options in levels.items()}
    return path.cloth_triangle_count, size, errors, error(half, exact)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", nargs="+")
    parser.add_argument("--resolution", type=int, default=0, help="cloth triangles, 0: the scene's own")
    parser.add_argument("--times", type=float, nargs="+", default=TIMES, help="s, of the starts")
    parser.add_argument("--backend", default="cpu")
    arguments = parser.parse_args()
    levels = {**LEVELS, "backward Euler, 1/960 s": FORMER}
    heads = ["scene, triangles", "size", *levels, "uncertainty"]
    print("| " + " | ".join(heads) + " |\n" + "|---" * len(heads) + "|")
    for scene in arguments.scenes:
        triangles, size, errors, uncertainty = measure(
            scene, arguments.resolution, levels, arguments.times, arguments.backend
        )
        cells = [f"{100 * error:.2g} %" for error in [*errors.values(), uncertainty]]
        print("| " + " | ".join([f"{scene}, {triangles:,}", f"{size:.2g} m", *cells]) + " |", flush=True)


if __name__ == "__main__":
    main()
