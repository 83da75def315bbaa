# SPDX-License-Identifier: Apache-2.0
"""Energy over two seconds of two built versions, against a run of the level `reference`, from several starts.

`move` writes copies of a scene whose cloth starts up to 20 mm aside; run them with the Python path of one version,
then of the other, into one folder; `compare` prints a table:

python benchmarks/energies.py move scenes/funnel/scene.json --starts 8 -o starts
PYTHONPATH=OLD python benchmarks/energies.py run old starts/funnel-*.json --resolution 400 -o out
PYTHONPATH=NEW python benchmarks/energies.py run new starts/funnel-*.json --resolution 400 -o out
PYTHONPATH=NEW python benchmarks/energies.py run reference starts/funnel-*.json --accuracy reference --rate 4800 -o out
python benchmarks/energies.py compare old new reference -o out

A file holds, for every frame of 1/60 s, the kinetic, elastic and potential energy of the cloth, J. The table has, for
each version, kinetic energy over that of the reference, the mean over the run and all starts and the least and largest
of the starts; and the root mean square over the frames of the distance to the reference's kinetic energy and to its sum
of all, over its mean kinetic energy: of single runs, mean over the starts, and of the means over the starts.
"""

import argparse
import json
from pathlib import Path

import numpy as np

FRAME, SECONDS, ASIDE = 1 / 60, 2.0, 0.02


def move(given):
    given.output.mkdir(parents=True, exist_ok=True)
    for name in given.names:
        for k in range(given.starts):
            scene = json.loads(Path(name).read_text())
            scene.pop("$schema", None)
            aside = np.random.default_rng(100 + k).uniform(-ASIDE, ASIDE, 2)
            for cloth in scene["cloth"]:
                place = cloth.setdefault("transform", {}).setdefault("translate", [0, 0, 0])
                place[:2] = [place[0] + aside[0], place[1] + aside[1]]
            (given.output / f"{scene['name']}-{k}.json").write_text(json.dumps(scene))


def energies(run):
    found = run.energy()
    kinetic = found.pop("kinetic")
    height = found.pop("gravity")
    return kinetic, sum(found.values()), height


def run(given):
    import cama

    version, *scenes = given.names
    given.output.mkdir(parents=True, exist_ok=True)
    options = {"accuracy": given.accuracy}
    if given.rate:
        options["time_step"] = 1 / given.rate
    if given.error:
        options["error"] = given.error
    for name in scenes:
        scene = cama.Scene.load(name, given.resolution)
        scene.frame_time = FRAME
        simulation = cama.Simulation(scene, backend="cpu", threads=1, **options)
        rows, steps = [energies(simulation)], 0
        for frame in range(1, round(SECONDS / FRAME) + 1):
            while simulation.time < frame * FRAME - 1e-6:
                simulation.step()
                steps += 1
            rows.append(energies(simulation))
        np.save(given.output / f"{Path(name).stem}_{given.resolution}_{version}.npy", rows, False)
        print(f"{name}, {given.resolution}: {steps} steps", flush=True)


def root_mean_square(values):
    return np.sqrt(np.square(values).mean(-1))


def compare(given):
    *tried, truth = given.names
    groups = {}
    for path in sorted(given.output.glob(f"*_{truth}.npy")):
        label = path.name.removesuffix(f"_{truth}.npy")
        stem, resolution = label.rsplit("_", 1)
        groups.setdefault((stem.split("-")[0], resolution), []).append(label)
    heads = ("kinetic", "least to largest", "distance, kinetic", "of means", "distance, sum", "of means")
    print("| scene, triangles, starts | version | " + " | ".join(heads) + " |\n|---|---" + "|---" * len(heads) + "|")
    for (scene, resolution), labels in groups.items():
        exact = np.array([np.load(given.output / f"{label}_{truth}.npy") for label in labels])
        scale = exact[:, :, 0].mean()
        for version in tried:
            found = np.array([np.load(given.output / f"{label}_{version}.npy") for label in labels])
            shares = found[:, :, 0].mean(1) / exact[:, :, 0].mean(1)
            kinetic, total = (found - exact)[:, :, 0] / scale, (found - exact).sum(2) / scale
            cells = [f"{found[:, :, 0].mean() / scale:.3f}", f"{shares.min():.2f} to {shares.max():.2f}"]
            for distance in (kinetic, total):
                cells += [f"{root_mean_square(distance).mean():.3f}", f"{root_mean_square(distance.mean(0)):.3f}"]
            print(f"| {scene}, {resolution}, {len(labels)} | {version} | " + " | ".join(cells) + " |")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("move", "run", "compare"))
    parser.add_argument(
        "names", nargs="+", help="scenes; run: a version before them; compare: versions, reference last"
    )
    parser.add_argument("--starts", type=int, default=8, help="copies that move writes")
    parser.add_argument("--resolution", type=int, default=400, help="cloth triangles")
    parser.add_argument("--accuracy", default="production")
    parser.add_argument("--rate", type=float, default=0, help="steps a second, 0: those of the level")
    parser.add_argument("--error", default="", help="as of cama run")
    parser.add_argument("-o", "--output", type=Path, required=True)
    given = parser.parse_args()
    {"move": move, "run": run, "compare": compare}[given.what](given)


if __name__ == "__main__":
    main()
