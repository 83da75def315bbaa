# SPDX-License-Identifier: Apache-2.0
"""Bending on five kinds of meshes: energy of forced shapes over the plate's, and cantilevers against the elastica.

python benchmarks/bending.py [plate|hinge] [ELASTICA_CSV]
"""

import math
import sys

import numpy as np

import cama

SIDE, CURVATURE, BENDING = 0.2, 0.2, 1e-4  # m, 1/m, N m
SHAPES = {
    "cylinder 0": (1.0, 0.0, 0.0),
    "cylinder 22.5": (math.cos(math.pi / 8) ** 2, math.sin(math.pi / 8) ** 2, math.sin(math.pi / 4) / 2),
    "cylinder 45": (0.5, 0.5, 0.5),
    "sphere": (1.0, 1.0, 0.0),
    "saddle": (1.0, -1.0, 0.0),
}  # curvatures along the warp, along the weft, and twist, over CURVATURE
MESHES = ("alternating", "rising", "irregular", "graded", "equilateral")


def grid(kind, cells, rows, cell):
    """Returns vertices [n, 2] and faces of a grid whose diagonals alternate, rise, or are drawn at random with moved
    vertices; or whose cells grow threefold from one end to the other."""
    random = np.random.default_rng(1)
    x, y = np.meshgrid(np.arange(cells + 1.0), np.arange(rows + 1.0), indexing="ij")
    if kind == "irregular":
        inner = (slice(1, -1), slice(1, -1))
        for part in (x, y):
            part[inner] += random.uniform(-0.25, 0.25, part[inner].shape)
    if kind == "graded":
        x, y = ((part + part**2 / count) / 2 for part, count in ((x, cells), (y, rows)))
    faces = []
    for i in range(cells):
        for j in range(rows):
            a = i * (rows + 1) + j
            b, c, d = a + rows + 1, a + rows + 2, a + 1
            falls = {"rising": 0, "irregular": random.integers(2)}.get(kind, (i + j) % 2)
            faces += [(a, b, d), (b, c, d)] if falls else [(a, b, c), (a, c, d)]
    return cell * np.stack([x.ravel(), y.ravel()], axis=1), np.array(faces)


def equilateral(cells, rows, cell):
    """Returns vertices [n, 2] and faces of rows of triangles with equal sides, but for the ends and the height of
    the rows that fills the same rectangle."""
    lines = max(2, 2 * round(rows * cell / (cell * math.sqrt(3))))
    height = rows * cell / lines
    points, start = [], []
    for j in range(lines + 1):
        start.append(len(points))
        x = np.arange(cells + 1.0) if j % 2 == 0 else np.concatenate([[0], np.arange(cells) + 0.5, [cells]])
        points += [(cell * value, height * j) for value in x]
    start.append(len(points))
    faces = []
    for j in range(lines):
        low, high, top = start[j], start[j + 1], start[j + 2]
        a, b = low, high
        while a + 1 < high or b + 1 < top:
            if b + 1 >= top or (a + 1 < high and points[a + 1][0] <= points[b + 1][0]):
                faces.append((a, a + 1, b))
                a += 1
            else:
                faces.append((a, b + 1, b))
                b += 1
    return np.array(points), np.array(faces)


def mesh(kind, cells, rows, cell):
    """Returns vertices [n, 2], m, and faces of a rectangle of `cells` by `rows` cells."""
    return equilateral(cells, rows, cell) if kind == "equilateral" else grid(kind, cells, rows, cell)


def simulation(rest, faces, start, material, pinned=(), gravity=(0, 0, 0), **options):
    """Returns a simulation of a sheet without contact."""
    scene = cama.Scene(contact=False, gravity=gravity)
    scene.add_cloth(start, faces, material=material, material_vertices=rest, name="sheet")
    if len(pinned):
        scene.pin("sheet", [int(i) for i in pinned])
    return cama.Simulation(scene, backend="cpu", precision="double", error="", **options)


def energy_ratio(kind, shape, cells, poisson_ratio=0.0, **options):
    """Returns the bending energy of a square sheet that is held in a shape, over the plate's."""
    rest, faces = mesh(kind, cells, cells, SIDE / cells)
    u, v = (rest - SIDE / 2).T
    a, b, c = (CURVATURE * value for value in SHAPES[shape])
    start = np.column_stack([rest, a * u**2 / 2 + b * v**2 / 2 + c * u * v])
    material = cama.Material.isotropic(1e4, poisson_ratio, BENDING, 0.2)
    plate = BENDING / 2 * (a**2 + b**2 + 2 * poisson_ratio * a * b + 2 * (1 - poisson_ratio) * c**2) * SIDE**2
    return simulation(rest, faces, start, material, **options).energy()["bending"] / plate


def cantilever(kind, gamma, cells, rows=2, steps=300, **options):
    """Returns drop over reach of the end of a cantilever of length 1 m, whose weight over bending stiffness is gamma,
    at rest. It is half of a strip that is held along its middle line."""
    cell, density, g = 1.0 / cells, 0.2, 9.81
    rest, faces = mesh(kind, cells, rows, cell)
    inner = rest[:, 0] > 1e-9
    other = np.arange(len(rest))
    other[inner] = len(rest) + np.arange(inner.sum())
    rest, faces = (
        np.concatenate([rest, rest[inner] * (-1, 1)]),
        np.concatenate([faces, other[faces][:, ::-1]]),
    )
    material = cama.Material.isotropic(2e4, 0.0, density * g / gamma, density)
    start = np.column_stack([rest, np.zeros(len(rest))])
    made = simulation(
        rest, faces, start, material, np.flatnonzero(np.abs(rest[:, 0]) < 1e-9), (0, 0, -g), time_step=0.05,
        integrator="backward_euler", newton_iterations=1, solver="direct", **options,
    )  # fmt: skip
    made.step(steps)
    tip = made.positions[rest[:, 0] > 1 - 1e-9].mean(axis=0)
    return -tip[2] / tip[0]


def main():
    bending = sys.argv[1] if len(sys.argv) > 1 else "plate"
    print(f"energy of a forced shape over the plate's, bending={bending}, 8, 16, 32, 64 cells a side")
    for poisson_ratio in (0.0, 0.3):
        for kind in MESHES:
            for shape in SHAPES:
                ratios = [energy_ratio(kind, shape, n, poisson_ratio, bending=bending) for n in (8, 16, 32, 64)]
                print(f"| {poisson_ratio} | {kind} | {shape} | " + " | ".join(f"{r:.3f}" for r in ratios) + " |")
    if len(sys.argv) > 2:
        rows = np.genfromtxt(sys.argv[2], delimiter=",", names=True, comments="#")
        print("drop over reach of a cantilever against the elastica, %, 8, 16, 32 cells")
        for kind in MESHES:
            for gamma in (0.5, 5.0, 20.0):
                expected = float(rows["H_over_W"][np.isclose(rows[rows.dtype.names[0]], gamma)][0])
                off = [100 * (cantilever(kind, gamma, n, bending=bending) / expected - 1) for n in (8, 16, 32)]
                print(f"| {kind} | {gamma:g} | " + " | ".join(f"{value:.2f}" for value in off) + " |", flush=True)


if __name__ == "__main__":
    main()
