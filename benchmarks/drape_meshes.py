# SPDX-License-Identifier: Apache-2.0
"""Cusick's drape coefficient of a fabric on meshes of several sizes, regular and irregular.

    python benchmarks/drape_meshes.py OUT.csv --fabric cotton --triangles 2000 8000 32000

The regular mesh is that of `cama fabric test`: rings of quads whose diagonals alternate. In the irregular one the inner
vertices are moved by up to a quarter of a cell in both directions, at random, and diagonals are drawn at random. Each
is draped --drapes times from different disturbances, the same for all meshes.
"""

import argparse
import csv
import math
import statistics
import time

import numpy as np

import cama
from cama.fabric.draping import DISC, SPECIMEN, drape_mesh
from cama.fabric.specimens import annulus_mesh


def ring(triangles):
    """Returns sectors and rings of a mesh of about so many triangles, with cells that are nearly square."""
    ratio = (SPECIMEN - DISC) / (math.pi * (SPECIMEN + DISC))
    sectors = max(24, round(math.sqrt(triangles / 2 / ratio)))
    return sectors, max(3, round(sectors * ratio))


def regular(sectors, rings):
    return annulus_mesh(DISC, SPECIMEN, sectors, rings)


def irregular(sectors, rings):
    """The first two rings, which are held, and the rim stay where they are."""
    random = np.random.default_rng(1)
    vertices, _ = regular(sectors, rings)
    cell = (SPECIMEN - DISC) / rings
    inner = slice(2 * sectors, -sectors)
    vertices[inner] += cell * random.uniform(-0.25, 0.25, vertices[inner].shape)
    index = np.arange(len(vertices)).reshape(-1, sectors)
    turned = np.roll(index, -1, axis=1)
    a, b, c, d = (part.ravel() for part in (index[:-1], index[1:], turned[1:], turned[:-1]))
    rises = random.integers(2, size=len(a))[:, None] == 1
    first = np.where(rises, np.stack([a, b, c], 1), np.stack([a, b, d], 1))
    second = np.where(rises, np.stack([a, c, d], 1), np.stack([b, c, d], 1))
    return vertices, np.concatenate([first, second]).astype(np.int32)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out")
    parser.add_argument("--fabric", default="cotton")
    parser.add_argument("--triangles", type=int, nargs="+", default=[2000, 8000, 32000])
    parser.add_argument("--drapes", type=int, default=3)
    given = parser.parse_args()
    with open(given.out, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["fabric", "mesh", "triangles", "percent", "mean_percent", "at_rest", "nodes", "cpu_s"])
        for triangles in given.triangles:
            for make in (regular, irregular):
                sectors, rings = ring(triangles)
                mesh, begin = make(sectors, rings), time.process_time()
                found = [
                    drape_mesh(cama.Material.of(given.fabric), mesh, sectors, seed) for seed in range(given.drapes)
                ]
                each = [100 * one.coefficient for one in found]
                row = [given.fabric, make.__name__, len(mesh[1]), " ".join(f"{value:.2f}" for value in each)]
                row += [f"{statistics.mean(each):.2f}", all(one.at_rest for one in found)]
                row += [" ".join(str(one.nodes) for one in found), f"{time.process_time() - begin:.0f}"]
                print(*row, flush=True)
                writer.writerow(row)
                file.flush()


if __name__ == "__main__":
    main()
