# SPDX-License-Identifier: Apache-2.0
"""Checks of meshes: single triangles, non-manifold ones, slivers, far away, very small and large, many pieces, all in
one place.
"""

import numpy as np

import cama

from . import shapes

GRAVITY = 9.81


def cloth_scene(vertices, faces, steps=100, time_step=0.005, material="cotton", velocity=(0, 0, 0), rest=None, **scene):
    """A scene with one cloth, its handle with it."""
    made = cama.Scene(time_step=time_step, frames=steps, **scene)
    more = {} if rest is None else dict(material_vertices=rest, material_faces=faces)
    return made, made.add_cloth(vertices, faces, material=material, velocity=velocity, name="cloth", **more)


def fallen(integrator, steps, time_step):
    """Height lost in free fall, m.

    By backward Euler g dt^2 n (n + 1) / 2, by BDF2 after one step of it g dt^2 (n^2 / 2 + 3/4 (1 - 3^-n)).
    """
    if integrator == "backward_euler":
        return GRAVITY * time_step**2 * steps * (steps + 1) / 2
    return GRAVITY * time_step**2 * (steps**2 / 2 + 0.75 * (1 - 3.0**-steps))


def check_fall(p, simulation, start, what):
    """Positions of a body in free fall: to O(dt) at any level, as its integrator has them at the scene's time step."""
    dt, t, n = simulation.scene.time_step, simulation.time, simulation.step_count
    moved = (simulation.positions - start)[: simulation.cloth_vertex_count]
    exact = np.array([0, 0, -GRAVITY * t**2 / 2])
    p.near(moved, exact, 1.01 * GRAVITY * t * dt, what + " against g t^2 / 2")
    if p.plain:
        integrator = simulation.options["integrator"]
        drop, name = fallen(integrator, n, dt), {"backward_euler": "backward Euler", "bdf2": "BDF2"}[integrator]
        p.near(moved, [0, 0, -drop], p.per_precision(1e-9, 1e-6, 1e-5) * drop, f"{what} against {name}")


def single_triangle(p):
    scene, _ = cloth_scene([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]], [[0, 1, 2]])
    simulation = p.simulation(scene, tolerance=p.per_precision(1e-12, 1e-9, 1e-5))
    start = simulation.positions
    p.run(simulation, 100)
    check_fall(p, simulation, start, "fall")


def book(pages=5):
    """Pages that share one edge: vertices, faces."""
    angle = np.linspace(0.3, 2.8, pages)
    far = [[0.1 * np.cos(a), y, 0.1 * np.sin(a)] for a in angle for y in (0, 0.1)]
    faces = [f for k in range(pages) for f in ([0, 1, 2 * k + 2], [1, 2 * k + 3, 2 * k + 2])]
    return np.array([[0, 0, 0], [0, 0.1, 0], *far]), np.array(faces)


def non_manifold_edge(p):
    """The spine is held; the outermost pages fall open, none through another."""
    scene, cloth = cloth_scene(*book(), steps=60, thickness=1e-3)
    scene.pin(cloth, [0, 1])
    p.run(scene, 60, bound=0.3)
    p.require(p.seen.strain < 0.05, f"stretched by {p.seen.strain:.3g}")


def moebius(columns=24, rows=2, radius=0.1, width=0.04):
    """A band with one half turn: vertices, faces."""
    u, v = np.meshgrid(
        2 * np.pi * np.arange(columns) / columns, np.linspace(-width / 2, width / 2, rows + 1), indexing="xy"
    )
    out = radius + v * np.cos(u / 2)
    vertices = np.stack([out * np.cos(u), out * np.sin(u), v * np.sin(u / 2)], 2).reshape(-1, 3)
    index = lambda i, j: (rows - j if i >= columns else j) * columns + i % columns  # noqa: E731
    faces = []
    for i in range(columns):
        for j in range(rows):
            a, b, c, d = index(i, j), index(i + 1, j), index(i + 1, j + 1), index(i, j + 1)
            faces += [[a, b, c], [a, c, d]]
    return vertices, np.array(faces)


def moebius_strip(p):
    """Hangs from one vertex, and still has the one border of a Moebius strip."""
    scene, cloth = cloth_scene(*moebius(), steps=60, thickness=1e-3)
    scene.pin(cloth, [0])
    simulation = p.run(scene, 60, bound=0.5)
    p.require(p.seen.strain < 0.1, f"stretched by {p.seen.strain:.3g}")
    p.require(simulation.positions[:, 2].min() < -0.1, "it does not hang")


def flipped_faces(p):
    """Half of the faces the other way round: a cantilever bends by the same hinge angles."""
    tips = []
    for flip in (False, True):
        vertices, faces = shapes.sheet(0.2, 0.1, 60)
        if flip:
            faces[::2] = faces[::2, ::-1]
        scene, cloth = cloth_scene(vertices, faces, material=cama.Material.isotropic(1000, 0.3, 1e-4, 0.2))
        scene.pin(cloth, np.flatnonzero(vertices[:, 0] < vertices[:, 0].min() + 0.03))
        tips.append(p.run(scene, 40, tolerance=p.per_precision(1e-10, 1e-8, 1e-5)).positions)
    p.near(tips[1], tips[0], p.per_precision(1e-7, 1e-5, 1e-3), "cantilever with half of its faces flipped")


def _hanging(p, flat, faces, steps):
    """Hangs a piece upright by its upper border from rest: the weight below stretches it by rho g L / k at most, twice
    that on the way.
    """
    density, stiffness, height = 0.2, 1000.0, np.ptp(flat[:, 1])
    scene, cloth = cloth_scene(
        flat[:, [0, 2, 1]],
        faces,
        rest=flat[:, :2],
        contact=False,
        material=cama.Material.isotropic(stiffness, 0.0, 1e-6, density),
    )
    scene.pin(cloth, np.flatnonzero(flat[:, 1] == flat[:, 1].max()))
    simulation = p.run(scene, steps, tolerance=p.per_precision(1e-8, 1e-6, 1e-4))
    static = density * GRAVITY * height / stiffness
    p.seen.note = f"{simulation.report['iterations']} iterations; static strain {static:.3g}"
    p.require(p.seen.strain < 2.1 * static, f"stretched by {p.seen.strain:.3g}, its weight by {static:.3g}")
    lower = simulation.positions[flat[:, 1] == flat[:, 1].min(), 2]
    p.near(lower, flat[:, 1].min() - static * height / 2, 0.6 * static * height, "its lower border")


def slivers(p):
    """A hanging strip of triangles 50 mm by 5 micrometres, aspect 1e4. Beyond single precision, which must say so."""
    try:
        _hanging(p, *shapes.lattice(60 * 5e-6, 0.1, 60, 2), 60)
    except cama.SolverError as problem:
        p.seen.error, p.seen.note = f"SolverError: {problem}", "SolverError in " + p.precision
        p.require(p.precision == "single", p.seen.error)


def swinging_slivers(p):
    """The same strip held level at one end and let go: stays as long as it is.

    Beyond single precision, which must say so.
    """
    vertices, faces = shapes.lattice(60 * 5e-6, 0.1, 60, 2)
    scene, cloth = cloth_scene(vertices, faces, contact=False, material=cama.Material.isotropic(1000, 0.3, 1e-6, 0.2))
    scene.pin(cloth, np.flatnonzero(vertices[:, 1] == vertices[:, 1].max()))
    try:
        simulation = p.run(scene, 60)
    except cama.SolverError as problem:
        p.seen.error, p.seen.note = f"SolverError: {problem}", "SolverError in " + p.precision
        return p.require(p.precision == "single", p.seen.error)
    reach = np.linalg.norm(simulation.positions - [0, 0.05, 0], axis=1).max()
    p.require(reach < 0.101, f"its end is {reach:.4g} m from where it is held, of 0.1 m")


def graded_edges(p):
    """Edges from 10 micrometres to 0.1 m in one mesh, in all combinations of width and height."""
    line = np.concatenate([[0], np.cumsum(np.geomspace(1e-5, 0.1, 14))])
    x, y = np.meshgrid(line, line, indexing="xy")
    _hanging(p, np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], 1), shapes.cells(14, 14), 30)


def draped_patch(scale=1.0, away=0.0):
    """A sheet laid on a ball, all lengths times `scale`, shifted by `away`.

    Masses per area and times stay, so stiffnesses scale along.
    """
    material = cama.Material.isotropic(1000 * scale**2, 0.3, 1e-4 * scale**4, 0.2)
    vertices, faces = shapes.sheet(0.2 * scale, 0.2 * scale, 72)
    scene, _ = cloth_scene(
        vertices + np.array([0.01, 0.015, 0.1015]) * scale + away,
        faces,
        rest=vertices[:, :2],
        material=material,
        gravity=(0, 0, -GRAVITY * scale),
        thickness=2e-3 * scale,
    )
    scene.add_obstacle(
        shape={"sphere": {"radius": 0.1, "triangles": 320}}, scale=scale, translate=np.full(3, away), name="ball"
    )
    return scene


def _patches(p, steps, **changed):
    """Positions of the sheet on the ball, at the reference place and size and changed, in the reference's units."""
    scale, away = changed.get("scale", 1.0), changed.get("away", 0.0)
    options = dict(tolerance=p.per_precision(1e-12, 1e-9, 1e-5))
    first, second = (p.run(draped_patch(**c), steps, clean=not away, **options) for c in ({}, changed))
    p.seen.note = f"{second.report['contacts']} contacts"
    p.require(first.report["contacts"] > 0, "no contact")
    n = first.cloth_vertex_count
    return first.positions[:n], (second.positions[:n] - away) / scale


def far_away(p):
    """1e6 m from the origin, where a double has a spacing of 1e-10 m."""
    first, second = _patches(p, 30, away=float(2**20))
    p.near(second, first, p.per_precision(1e-5, 1e-5, 1e-3), "shape far from the origin")


def millimetre(p):
    first, second = _patches(p, 30, scale=1e-3)
    p.near(second, first, p.per_precision(1e-7, 1e-5, 1e-3), "shape at a thousandth of the size")


def kilometre(p):
    first, second = _patches(p, 30, scale=1e3)
    p.near(second, first, p.per_precision(1e-7, 1e-5, 1e-3), "shape at a thousand times the size")


def huge_triangles(p):
    """A fine sheet on two triangles of 1 km: pairs grow with the sheet, not with its square."""
    counts = []
    for triangles in (200, 800):
        vertices, faces = shapes.sheet(0.4, 0.4, triangles)
        scene, _ = cloth_scene(vertices + [0, 0, 0.002], faces, thickness=1.5e-3)
        scene.add_obstacle(
            [[-500, -500, 0], [500, -500, 0], [500, 500, 0], [-500, 500, 0]], [[0, 1, 2], [0, 2, 3]], name="floor"
        )
        simulation = p.run(scene, 30)
        p.require(simulation.positions[: simulation.cloth_vertex_count, 2].min() > 0, "a vertex is under the floor")
        counts.append(simulation.report["candidates"])
    p.seen.note = f"{counts[0]} and {counts[1]} pairs for 4 times the triangles"
    p.require(0 < counts[1] < 6 * counts[0], p.seen.note)


def _collapsed(p, size):
    """A sheet of 0.2 m whose start is squeezed by `size` per axis: unfolds, or a SolverError says that it cannot."""
    vertices, faces = shapes.sheet(0.2, 0.2, 128)
    random = np.random.default_rng(1)
    rough = vertices + random.uniform(-1e-3, 1e-3, vertices.shape) * [0, 0, 1]
    scene, _ = cloth_scene(rough * size, faces, rest=vertices[:, :2], gravity=(0, 0, 0), time_step=1e-3)
    try:
        p.run(scene, 20, bound=1e3)
    except cama.SolverError as problem:
        p.seen.error, p.seen.note = f"SolverError: {problem}", f"SolverError in {p.precision}"


def collapsed_to_a_point(p):
    _collapsed(p, np.array([1e-7, 1e-7, 1e-7]))


def collapsed_to_a_line(p):
    _collapsed(p, np.array([1, 1e-7, 1e-7]))


def all_on_one_point(p):
    """Every vertex exactly at the origin: triangles without area."""
    vertices, faces = shapes.sheet(0.2, 0.2, 32)
    p.refused(
        cama.Error,
        [],
        lambda: p.simulation(cloth_scene(0 * vertices, faces, rest=vertices[:, :2])[0]),
        "all at the origin",
    )


def identical_centroids(p):
    """60 triangles 2 mm above each other and one 100 km away: all in one cell of a Morton code.

    They fall as one body each.
    """
    corner = np.array([[np.cos(a), np.sin(a), 0] for a in (0.1, 0.1 + 2 * np.pi / 3, 0.1 + 4 * np.pi / 3)])
    vertices = np.concatenate([0.01 * corner + [0, 0, 0.002 * k] for k in range(60)] + [0.01 * corner + [1e5, 0, 0]])
    scene, _ = cloth_scene(vertices, np.arange(183).reshape(-1, 3), thickness=5e-4)
    simulation = p.simulation(scene)
    start = simulation.positions
    p.run(simulation, 20)
    check_fall(p, simulation, start, "fall")


def same_centroid(p):
    """30 triangles in each other, all with the centroid 0: refused; as it is, it does not hang or break."""
    corner = np.array([[np.cos(a), np.sin(a), 0] for a in (0.1, 0.1 + 2 * np.pi / 3, 0.1 + 4 * np.pi / 3)])
    vertices = np.concatenate([(0.01 + 0.005 * k) * corner for k in range(30)])
    scene, _ = cloth_scene(vertices, np.arange(90).reshape(-1, 3), thickness=5e-4)
    p.refused(cama.CollisionError, ["intersections"], lambda: p.simulation(scene), "nested triangles")
    p.run(scene, 5, clean=False, intersections="exempt")


def confetti(p, pieces=1000):
    """Single triangles dropped on a floor: each a component of its own."""
    random = np.random.default_rng(2)
    side = int(round(pieces ** (1 / 3)))
    place = np.stack(np.meshgrid(*[np.arange(side)] * 3), 3).reshape(-1, 3) * 0.02 + [0, 0, 0.03]
    parts = []
    for x in place:
        turn = shapes.rotation(random.normal(size=3), random.uniform(0, 3))
        parts.append((np.array([[0, 0, 0], [0.008, 0, 0], [0, 0.008, 0]]) @ turn.T + x, np.array([[0, 1, 2]])))
    scene, _ = cloth_scene(*shapes.join(parts), thickness=1e-3)
    scene.add_obstacle(shape={"plane": {"size": [2, 2], "triangles": 8}}, name="floor", translate=(0.0131, 0.0177, 0))
    simulation = p.run(scene, 20)
    z = simulation.positions[: simulation.cloth_vertex_count, 2]
    p.require(z.min() > 0, "a piece is under the floor")
    p.require(simulation.report["contacts"] > 0, "nothing has landed")
