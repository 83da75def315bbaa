# SPDX-License-Identifier: Apache-2.0
"""Cusick's drape coefficient of a fabric on meshes of several sizes, regular and irregular.

    python benchmarks/drape_meshes.py OUT.csv --fabric cotton --triangles 2000 8000 32000
    python benchmarks/drape_meshes.py OUT.csv --board

The regular mesh is that of `cama fabric test`: rings of quads whose diagonals alternate. In the irregular one the inner
vertices are moved by up to a quarter of a cell in both directions, at random, and diagonals are drawn at random. Each
is draped --drapes times from different disturbances, the same for all meshes.

--board: the rim of a board, which hardly bends, against that of an annular plate that is clamped at the disc, and how
far behind the outer held row of vertices a clamped plate would sink as much.
"""

import argparse
import csv
import math
import statistics
import time

import numpy as np

import cama
from cama.fabric.draping import DISC, SPECIMEN, drape_mesh
from cama.fabric.specimens import GRAVITY, annulus_mesh, specimen

RATIO = (SPECIMEN - DISC) / (math.pi * (SPECIMEN + DISC))  # of rings to sectors, for cells that are nearly square


def ring(triangles):
    """Returns sectors and rings of a mesh of about so many triangles, with cells that are nearly square."""
    sectors = max(24, round(math.sqrt(triangles / 2 / RATIO)))
    return sectors, max(3, round(sectors * RATIO))


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


def sunk_plate(inner, outer, pressure, stiffness):
    """Deflection, m, of the rim of an annular plate without Poisson's ratio, clamped at `inner`, under a pressure, Pa.

    w = q r^4 / (64 D) + c0 + c1 ln r + c2 r^2 + c3 r^2 ln r (Timoshenko and Woinowsky-Krieger 1959, chapter 3).
    """
    a, b, q = math.log(inner), math.log(outer), pressure / stiffness
    rows = [
        [1, a, inner**2, inner**2 * a],  # w
        [0, 1 / inner, 2 * inner, inner * (2 * a + 1)],  # its slope
        [0, -1 / outer**2, 2, 2 * b + 3],  # the moment at the rim
        [0, 0, 0, 4 / outer],  # and the shear force
    ]
    right = [-q * inner**4 / 64, -q * inner**3 / 16, -3 * q * outer**2 / 16, -q * outer / 2]
    c = np.linalg.solve(rows, right)
    return q * outer**4 / 64 + c @ [1, b, outer**2, outer**2 * b]


def sunk_board(sectors, mesh, stiffness=0.05, density=0.2):
    """Deflection, m, of the rim of a board in equilibrium, and that of the plate."""
    board = cama.Material.isotropic(1e4, 0.0, stiffness, density)
    scene = specimen(board, *mesh, np.arange(2 * sectors))
    simulation = cama.Simulation(
        scene, backend="cpu", integrator="backward_euler", newton_iterations=4, solver="direct", precision="double",
        time_step=100.0,
    )  # fmt: skip
    simulation.step(12)
    pressure = density * GRAVITY
    sunk = -float(simulation.positions[-sectors:, 2].mean())
    low, high = DISC - 0.03, DISC + 0.03
    while high - low > 1e-7:
        middle = (low + high) / 2
        low, high = (middle, high) if sunk_plate(middle, SPECIMEN, pressure, stiffness) > sunk else (low, middle)
    return sunk, sunk_plate(DISC, SPECIMEN, pressure, stiffness), low


def boards(writer):
    writer.writerow(["mesh", "sectors", "rings", "rim_mm", "plate_mm", "ratio", "clamp_behind_outer_row_cells"])
    for sectors in (36, 72, 144, 216):
        rings = max(3, round(sectors * RATIO))
        cell = (SPECIMEN - DISC) / (rings - 0.5)
        for make in (regular, irregular):
            sunk, plate, clamp = sunk_board(sectors, make(sectors, rings))
            row = [make.__name__, sectors, rings, f"{1e3 * sunk:.4f}", f"{1e3 * plate:.4f}", f"{sunk / plate:.3f}"]
            row.append(f"{(DISC + cell / 2 - clamp) / cell:.2f}")
            print(*row, flush=True)
            writer.writerow(row)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out")
    parser.add_argument("--fabric", default="cotton")
    parser.add_argument("--triangles", type=int, nargs="+", default=[2000, 8000, 32000])
    parser.add_argument("--drapes", type=int, default=3)
    parser.add_argument("--backend", default="cpu")
    parser.add_argument("--board", action="store_true")
    given = parser.parse_args()
    with open(given.out, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        if given.board:
            boards(writer)
            return
        writer.writerow(["fabric", "mesh", "triangles", "percent", "mean_percent", "at_rest", "nodes", "cpu_s"])
        for triangles in given.triangles:
            for make in (regular, irregular):
                sectors, rings = ring(triangles)
                mesh, begin = make(sectors, rings), time.process_time()
                fabric = cama.Material.of(given.fabric)
                found = [drape_mesh(fabric, mesh, sectors, seed, 30.0, given.backend) for seed in range(given.drapes)]
                each = [100 * one.coefficient for one in found]
                row = [given.fabric, make.__name__, len(mesh[1]), " ".join(f"{value:.2f}" for value in each)]
                row += [f"{statistics.mean(each):.2f}", all(one.at_rest for one in found)]
                row += [" ".join(str(one.nodes) for one in found), f"{time.process_time() - begin:.0f}"]
                print(*row, flush=True)
                writer.writerow(row)
                file.flush()


if __name__ == "__main__":
    main()
