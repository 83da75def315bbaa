# SPDX-License-Identifier: Apache-2.0
"""Checks of time steps, stiffness, bending, mass, wind and free flight at their extremes."""

import numpy as np

import cama

from . import shapes
from .meshes import GRAVITY, cloth_scene, draped_patch


def second_step(p):
    """A sheet laid on a ball with a time step of 1 s."""
    scene = draped_patch()
    scene.time_step = 1.0
    p.run(scene, 10, bound=1e4)


def tiny_step(p):
    """Free fall with a time step of 0.1 microseconds; velocities are g t to rounding."""
    vertices, faces = shapes.sheet(0.2, 0.2, 32)
    scene, _ = cloth_scene(vertices, faces, time_step=1e-7)
    simulation = p.run(scene, 100, tolerance=p.per_precision(1e-12, 1e-9, 1e-5))
    t = simulation.time
    p.near(simulation.velocities, [0, 0, -GRAVITY * t], p.per_precision(1e-9, 1e-6, 1e-5) * GRAVITY * t, "velocity")
    p.near(simulation.positions - vertices, [0, 0, -GRAVITY * t**2 / 2], 0.02 * GRAVITY * t**2 / 2, "fall")


def _held(material, **more):
    """A level sheet held at one side, nothing else: scene, starting vertices, held vertices."""
    vertices, faces = shapes.lattice(0.2, 0.1, 8, 4)
    scene, cloth = cloth_scene(vertices, faces, material=material, **more)
    held = np.flatnonzero(vertices[:, 0] == vertices[:, 0].min())
    scene.pin(cloth, held)
    return scene, vertices, held


def no_stiffness(p):
    """Stiffness and bending 0: vertices that are not held fall freely."""
    material = cama.Material.isotropic(1000, 0.3, 0.0, 0.2)
    material.stretching = [[0.0] * 4] * 6
    scene, vertices, held = _held(material, contact=False)
    simulation = p.run(scene, 40)
    free = np.setdiff1d(np.arange(len(vertices)), held)
    t = simulation.time
    p.near(
        (simulation.positions - vertices)[free],
        [0, 0, -GRAVITY * t**2 / 2],
        1.01 * GRAVITY * t * scene.time_step,
        "fall",
    )
    p.require(np.array_equal(simulation.positions[held], vertices[held]), "a held vertex moved")


def huge_stiffness(p):
    """1e12 N/m: nothing stretches. Single precision cannot know the mass beside it, and says so."""
    scene, vertices, _ = _held(cama.Material.isotropic(1e12, 0.3, 1e-5, 0.2))
    if p.precision == "single":
        p.refused(
            cama.MaterialError, ["cloth", "e+12 N/m", "vertex", "single"], lambda: p.simulation(scene), "1e12 N/m"
        )
        return
    p.run(scene, 40, bound=0.5)
    p.require(p.seen.strain < 0.01, f"stretched by {p.seen.strain:.3g}")


def indefinite_stiffness(p):
    """k12^2 > k11 k22: no energy to minimise; refused."""
    material = cama.Material.isotropic(1000, 0.3, 1e-5, 0.2)
    material.stretching = [[1000.0, 1100.0, 1000.0, 500.0]] * 6
    p.refused(cama.MaterialError, ["k12", "cloth"], lambda: p.simulation(_held(material)[0]), "k12^2 > k11 k22")


def no_bending(p):
    """A held sheet without bending stiffness hangs down; not one Joule is in its folds."""
    scene, vertices, _ = _held(cama.Material.isotropic(1000, 0.3, 0.0, 0.2))
    simulation, lowest = p.simulation(scene), 0.0
    for _ in range(10):
        p.run(simulation, 10, bound=0.5)
        p.require(simulation.energy()["bending"] == 0, "it has bending energy")
        lowest = min(lowest, simulation.positions[:, 2].min())
    p.require(lowest < -0.1, "it does not swing down")


def huge_bending(p):
    """1e3 N m: a plate. rho g L^4 / (8 B) = 4e-7 m is how far its end sinks, so it does not move to be seen."""
    scene, vertices, _ = _held(cama.Material.isotropic(1e5, 0.3, 1e3, 0.2))
    scene.pin("cloth", np.flatnonzero(np.isclose(vertices[:, 0], -0.075)))
    simulation = p.run(scene, 40, tolerance=p.per_precision(1e-8, 1e-6, 1e-4))
    p.near(simulation.positions, vertices, p.per_precision(1e-5, 1e-5, 1e-3), "the plate")


def folded_crease(p):
    """A hinge is turned through a full turn: bending energy c theta^2 / 4 up to pi, and back down beyond it (closed
    form).
    """
    vertices = np.array([[0, -0.05, 0], [0, 0.05, 0], [0.1, 0, 0], [-0.1, 0, 0]])
    scene, cloth = cloth_scene(
        vertices,
        [[0, 1, 3], [1, 0, 2]],
        contact=False,
        gravity=(0, 0, 0),
        time_step=0.01,
        material=cama.Material.isotropic(1000, 0.3, 1e-3, 0.2),
    )
    scene.pin(cloth, [0, 1, 3])
    scene.pin(cloth, [2], dict(rotation_rate=(0, 2 * np.pi, 0)))
    simulation = p.simulation(scene)
    energies = []
    for _ in range(100):
        p.run(simulation, 1, clean=False)
        energies.append(simulation.energy()["bending"])
    theta = 2 * np.pi * 0.01 * np.arange(1, 101)
    theta = np.minimum(theta, 2 * np.pi - theta)
    scale = energies[24] / theta[24] ** 2
    p.require(scale > 0, "no bending energy")
    p.near(
        energies, scale * theta**2, p.per_precision(1e-9, 1e-9, 1e-4) * scale * np.pi**2, "bending energy over a turn"
    )


def paper_crease(p):
    """A sheet folded to half a thickness between its halves opens flat, and may swing on; it never crosses itself."""
    vertices, faces = shapes.lattice(0.2, 0.1, 12, 6)
    x = vertices[:, 0]
    gap = 5e-4
    height = np.sign(x) * gap / 2 * np.minimum(1, np.abs(x) / 0.01)
    folded = np.stack([np.abs(x), vertices[:, 1], height], 1)
    scene, _ = cloth_scene(
        folded,
        faces,
        rest=vertices[:, :2],
        gravity=(0, 0, 0),
        thickness=1e-3,
        material=cama.Material.isotropic(1000, 0.3, 1e-4, 0.2),
    )
    simulation, opened = p.simulation(scene), 0.0
    for _ in range(60):
        p.run(simulation, 1, bound=1)
        opened = max(opened, np.linalg.norm(simulation.positions[0] - simulation.positions[12]))
    p.seen.note = f"ends {opened * 1e3:.3g} mm apart"
    p.require(opened > 0.18, f"the ends of the sheet of 0.2 m were at most {opened:.3g} m apart: it does not open")


def _on_ball(p, density, steps=30):
    scene = draped_patch()
    material = scene.cloths[0].material
    material.density = density
    scene.cloths[0].material = material
    p.run(scene, steps, bound=10)


def light(p):
    """1e-6 kg/m^2 on a ball."""
    _on_ball(p, 1e-6)


def heavy(p):
    """1e6 kg/m^2 on a ball."""
    _on_ball(p, 1e6)


def mass_ratio(p):
    """A sheet of 1e3 kg/m^2 falls on one of 1e-3 kg/m^2 that lies on a ball."""
    scene = draped_patch()
    vertices, faces = shapes.sheet(0.2, 0.2, 60)
    for z, density in ((0.1045, 1e3),):
        scene.add_cloth(
            vertices + [0.005, 0.01, z], faces, material=cama.Material.isotropic(1000, 0.3, 1e-4, density), name="heavy"
        )
    material = scene.cloths[0].material
    material.density = 1e-3
    scene.cloths[0].material = material
    p.run(scene, 60, bound=20)


def _still(p, scene, steps):
    """Largest motion of a vertex, m, and whether every bit is as it was.

    Intersections are looked for every tenth of the run.
    """
    simulation = p.simulation(scene)
    start = simulation.positions
    for step in range(1, steps + 1):
        simulation.step()
        p.watch(simulation, judges=None if step % (steps // 10) == 0 else ())
    moved = np.abs(simulation.positions - start).max()
    p.seen.note = f"moved by {moved:.2g} m"
    return moved, np.array_equal(simulation.positions, start) and not simulation.velocities.any()


def _resting(side, columns):
    """Two sheets and a ball, out of contact, without gravity."""
    scene = cama.Scene(gravity=(0, 0, 0), thickness=1e-3, time_step=1 / 200)
    for z in (0, 0.00390625):
        vertices, faces = shapes.lattice(side, side, columns, columns)
        scene.add_cloth(vertices + [0, 0, z], faces)
    scene.add_obstacle(shape={"sphere": {"radius": 0.1, "triangles": 320}}, translate=(0, 0, -0.104), name="ball")
    return scene


def at_rest(p, steps=1000):
    """No gravity, two sheets and a ball near each other, coordinates exact in binary: no bit changes."""
    p.require(_still(p, _resting(0.25, 4), steps)[1], "it moved")


def at_rest_for_long(p):
    """The same for 1e5 steps."""
    at_rest(p, 100000)


def at_rest_any_mesh(p):
    """The same with cells of 1/20 m: their rest shape is rounded, so is their strain."""
    moved, same = _still(p, _resting(0.2, 4), 1000)
    p.require(moved < p.per_precision(1e-12, 1e-12, 1e-5), p.seen.note)
    p.require(same, f"not bitwise still: {p.seen.note} in 1000 steps")


def translation(p):
    """Free cloth at 10 m/s for 50 steps: every vertex keeps its velocity, the body its momentum and shape."""
    vertices, faces = shapes.sheet(0.2, 0.2, 60)
    velocity = np.array([6.0, 0, -8.0])
    scene, _ = cloth_scene(vertices, faces, gravity=(0, 0, 0), velocity=velocity)
    simulation = p.run(scene, 50)
    mass = simulation.masses[:, None]
    drift = np.abs((mass * simulation.velocities).sum(0) / mass.sum() - velocity).max() / 10
    p.seen.note = f"relative drift of the momentum {drift:.2g}"
    p.require(drift < p.per_precision(1e-12, 1e-12, 1e-6), p.seen.note)
    p.near(simulation.positions - vertices, velocity * simulation.time, p.per_precision(1e-11, 1e-6, 1e-5), "motion")


def rotation(p):
    """Free cloth turning once a second for a quarter turn: momentum stays 0, no strain to speak of; the loss of spin is
    reported.
    """
    vertices, faces = shapes.sheet(0.2, 0.2, 60)
    scene, _ = cloth_scene(vertices, faces, gravity=(0, 0, 0), time_step=1.25e-3)
    simulation = p.simulation(scene, tolerance=p.per_precision(1e-12, 1e-9, 1e-5))
    axis = np.array([2 * np.pi, 0, 0])
    simulation.set_state(vertices, np.cross(axis, vertices))
    mass = simulation.masses[:, None]
    before = (mass * np.cross(vertices, simulation.velocities)).sum(0)
    p.run(simulation, 200)
    after = (mass * np.cross(simulation.positions, simulation.velocities)).sum(0)
    drift = np.abs((mass * simulation.velocities).sum(0)).max() / (mass.sum() * 2 * np.pi * 0.1)
    kept = after @ before / (before @ before)
    p.seen.note = f"angular momentum kept {kept:.4g}, relative drift of the momentum {drift:.2g}"
    p.require(drift < p.per_precision(1e-12, 1e-9, 1e-5), p.seen.note)
    p.require(0.5 < kept < 1 + p.per_precision(1e-9, 1e-6, 1e-3), p.seen.note)
    p.require(p.seen.strain < 0.01, f"stretched by {p.seen.strain:.3g}")


def storm(p):
    """A flag in a wind of 100 m/s; the wind drops to its lee when it turns, where drag is discontinuous."""
    vertices, faces = shapes.sheet(0.3, 0.2, 120)
    random = np.random.default_rng(4)
    upright = vertices[:, [0, 2, 1]] + random.uniform(-1e-3, 1e-3, vertices.shape) * [0, 1, 0]
    scene, cloth = cloth_scene(
        upright,
        faces,
        rest=vertices[:, :2],
        thickness=1e-3,
        wind={"velocity": (100, 5, 0), "density": 1.2, "drag": 0.05},
    )
    scene.pin(cloth, np.flatnonzero(vertices[:, 0] == vertices[:, 0].min()))
    p.run(scene, 100, bound=2)
    p.require(p.seen.strain < 5, f"stretched by {p.seen.strain:.3g}")


def scale_error(p):
    """Material space 100 times as large as the sheet, as of texture coordinates in centimetres: it would snap to that
    size.
    """
    vertices, faces = shapes.sheet(0.1, 0.1, 32)
    scene, _ = cloth_scene(vertices, faces, rest=100 * vertices[:, :2])
    p.refused(
        cama.MeshError,
        ["cloth", "material space is 100 times as large"],
        lambda: p.simulation(scene),
        "material space 100 times as large",
    )


def t_junction(p):
    """A coarse and a fine piece sewn along a border, fine vertices to points of coarse edges: the seam closes."""
    scene = cama.Scene(gravity=(0, 0, 0), thickness=1e-4, time_step=1 / 200)
    coarse, fine = shapes.lattice(0.1, 0.1, 2, 2), shapes.lattice(0.1, 0.1, 6, 6)
    scene.add_cloth(*coarse, name="coarse")
    scene.add_cloth(fine[0] + [0.105, 0, 0], fine[1], name="fine")
    border = np.flatnonzero(np.isclose(coarse[0][:, 0], 0.05))
    seam = np.flatnonzero(np.isclose(fine[0][:, 0], -0.05))
    along = (fine[0][seam, 1] + 0.05) / 0.05
    k = np.minimum((along + 1e-9).astype(int), 1)
    ratio = np.clip(along - k, 0, 1)
    scene.stitch("fine", seam, "coarse", border[k], border[k + 1], ratio, stiffness=100.0)
    simulation = p.run(scene, 150, bound=1, judges=("audit",))  # which knows what may touch at a seam
    x = simulation.positions
    target = (1 - ratio)[:, None] * x[border[k]] + ratio[:, None] * x[border[k + 1]]
    gap = np.linalg.norm(x[len(coarse[0]) + seam] - target, axis=1).max()
    p.seen.note = f"seam open by {gap * 1e3:.2g} mm of 5 mm"
    p.require(gap < 1e-3, p.seen.note)
