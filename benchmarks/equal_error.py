# SPDX-License-Identifier: Apache-2.0
"""Cost at equal error of two built versions: windows of 0.05 s from common starts, each against its own reference.

Run it with the Python path of one version, then of the other, into one folder. The first call writes the starts:

PYTHONPATH=NEW python benchmarks/equal_error.py new drape --resolution 2000 --steps 8 12 16 24 -o out/equal
PYTHONPATH=OLD python benchmarks/equal_error.py old drape --resolution 2000 --steps 0 -o out/equal

--steps 0 takes the version's own time step. A row is the root mean square over the cloth and the windows of the
distance to the version's level `reference` at 1/4800 s, and processor seconds a simulated second of one thread.
"""

import argparse
import time
from pathlib import Path

import numpy as np

import cama

WINDOW = 0.05  # s
TIMES = (0.2, 0.45)  # s, of the starts
WHERE = {"backend": "cpu", "threads": 1}


def window(scene, start, instant, steps, **options):
    """Returns positions [cloth vertices, 3], m, after the window, and the processor seconds of its steps."""
    simulation = cama.Simulation(scene, **WHERE, time_step=WINDOW / steps, **options)
    if '"motion"' in scene.to_json():  # the clock of a simulation starts at 0
        simulation.step(round(instant / WINDOW * steps))
    simulation.set_state(*start)
    before = time.process_time()
    simulation.step(steps)
    return simulation.positions[: simulation.cloth_vertex_count], time.process_time() - before


def starts(scene, path):
    """Positions and velocities at each of TIMES, of the version that comes first."""
    if not path.exists():
        simulation, found = cama.Simulation(scene, **WHERE, time_step=1 / 240), {}
        count = simulation.cloth_vertex_count
        for i, instant in enumerate(TIMES):
            simulation.step(round((instant - simulation.time) * 240))
            found[f"x{i}"], found[f"v{i}"] = simulation.positions[:count], simulation.velocities[:count]
        np.savez(path, **found)
    with np.load(path) as file:
        return [(file[f"x{i}"], file[f"v{i}"]) for i in range(len(TIMES))]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("version", help="a name for what is measured")
    parser.add_argument("scenes", nargs="+")
    parser.add_argument("--resolution", type=int, default=2000, help="cloth triangles")
    parser.add_argument("--steps", type=int, nargs="+", default=(0,), help="in a window; 0: the version's own")
    parser.add_argument("-o", "--output", type=Path, required=True)
    given = parser.parse_args()
    given.output.mkdir(parents=True, exist_ok=True)
    for name in given.scenes:
        scene = cama.Scene.load(name, given.resolution)
        label = f"{Path(name).stem}_{given.resolution}"
        begin = starts(scene, given.output / f"{label}.npz")
        known = given.output / f"{label}_{given.version}.npy"
        if not known.exists():
            np.save(known, [window(scene, s, t, 240, accuracy="reference")[0] for s, t in zip(begin, TIMES)], False)
        exact = np.load(known)
        for steps in given.steps:
            steps = steps or round(WINDOW / cama.Simulation(scene, **WHERE).time_step)
            ends, seconds = zip(*(window(scene, s, t, steps) for s, t in zip(begin, TIMES)))
            error = 1e3 * np.sqrt(np.square(np.array(ends) - exact).sum(2).mean())
            rate = sum(seconds) / len(seconds) / WINDOW
            print(f"{given.version}, {label}: {steps} steps, {error:.2f} mm, {rate:.2f} s a second", flush=True)


if __name__ == "__main__":
    main()
