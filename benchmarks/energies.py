# SPDX-License-Identifier: Apache-2.0
"""Energy over two seconds of two built versions, against a run of the level `reference`.

Run it with the Python path of one version, then of the other, into one folder; `compare` prints a table of it:

PYTHONPATH=OLD python benchmarks/energies.py run old drape --resolution 400 -o out
PYTHONPATH=NEW python benchmarks/energies.py run new drape --resolution 400 -o out
PYTHONPATH=NEW python benchmarks/energies.py run reference drape --accuracy reference --rate 4800 -o out
python benchmarks/energies.py compare old new reference -o out

A file holds, for every frame of 1/60 s, the kinetic, elastic and potential energy of the cloth, J. The table has, for
each version, kinetic energy over that of the reference, mean over the run, and the root mean square of the distance to
the reference's kinetic and total energy, each over the reference's mean kinetic energy.
"""

import argparse
from pathlib import Path

import numpy as np

import cama

FRAME, SECONDS = 1 / 60, 2.0


def energies(run):
    found = run.energy()
    kinetic = found.pop("kinetic")
    height = found.pop("gravity")
    return kinetic, sum(found.values()), height


def run(given):
    version, *scenes = given.names
    given.output.mkdir(parents=True, exist_ok=True)
    for name in scenes:
        scene = cama.Scene.load(name, given.resolution)
        scene.frame_time = FRAME
        step = {"time_step": 1 / given.rate} if given.rate else {}
        simulation = cama.Simulation(scene, backend="cpu", threads=1, accuracy=given.accuracy, **step)
        rows, steps = [energies(simulation)], 0
        for frame in range(1, round(SECONDS / FRAME) + 1):
            while simulation.time < frame * FRAME - 1e-6:
                simulation.step()
                steps += 1
            rows.append(energies(simulation))
        np.save(given.output / f"{Path(name).stem}_{given.resolution}_{version}.npy", rows, False)
        print(f"{name}, {given.resolution}: {steps} steps", flush=True)


def compare(given):
    *tried, truth = given.names
    heads = [f"{v}: {h}" for h in ("kinetic", "distance, kinetic", "distance, total") for v in tried]
    print("| scene, triangles | " + " | ".join(heads) + " |\n|---" + "|---" * len(heads) + "|")
    for path in sorted(given.output.glob(f"*_{truth}.npy")):
        label = path.name.removesuffix(f"_{truth}.npy")
        runs = [np.load(given.output / f"{label}_{v}.npy") for v in given.names]
        exact = runs.pop()
        scale = exact[:, 0].mean()
        cells = [f"{r[:, 0].mean() / scale:.3f}" for r in runs]
        cells += [f"{np.sqrt(np.square(r[:, 0] - exact[:, 0]).mean()) / scale:.3f}" for r in runs]
        cells += [f"{np.sqrt(np.square((r - exact).sum(1)).mean()) / scale:.3f}" for r in runs]
        print(f"| {', '.join(label.split('_'))} | " + " | ".join(cells) + " |")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("run", "compare"))
    parser.add_argument("names", nargs="+", help="run: the version, then scenes; compare: versions, reference last")
    parser.add_argument("--resolution", type=int, default=400, help="cloth triangles")
    parser.add_argument("--accuracy", default="production")
    parser.add_argument("--rate", type=float, default=0, help="steps a second, 0: those of the level")
    parser.add_argument("-o", "--output", type=Path, required=True)
    given = parser.parse_args()
    {"run": run, "compare": compare}[given.what](given)


if __name__ == "__main__":
    main()
