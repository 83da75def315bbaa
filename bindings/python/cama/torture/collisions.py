# SPDX-License-Identifier: Apache-2.0
"""Checks of contact at its boundaries: measure-zero hits, grazing, friction without bound, pins that tear cloth about."""

import numpy as np

import cama

from . import scenes, shapes
from .meshes import GRAVITY, cloth_scene

TENT = (
    np.array([[-0.05, -0.05, 0], [0.05, -0.05, 0], [0.05, 0.05, 0], [-0.05, 0.05, 0], [0, 0, 0.05]]),
    np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]),
)


def touching(p):
    """Two equal sheets at distance 0."""
    p.refused(
        cama.CollisionError,
        ["intersections", "'lower'", "'upper'"],
        lambda: p.simulation(scenes.touching(100)),
        "distance 0",
    )


def coplanar(p):
    """Two sheets in one plane, 1 micrometre from edge to edge, fall side by side on a floor."""
    scene = cama.Scene(thickness=1e-3, time_step=1 / 200)
    for k in range(2):
        vertices, faces = shapes.sheet(0.1, 0.1, 32)
        scene.add_cloth(vertices + [k * (0.1 + 1e-6), 0, 0.01], faces, name=("left", "right")[k])
    scene.add_obstacle(shape={"plane": {"size": [1, 1], "triangles": 8}}, name="floor", translate=(0.0131, 0.0177, 0))
    p.run(scene, 40, bound=0.5)


def start_that_intersects(p):
    """Refused with the names of both; simulated as it is; untangled first."""
    scene = cama.Scene(gravity=(0, 0, 0), time_step=1 / 200)
    mesh = shapes.sheet(0.2, 0.2, 50)
    scene.add_cloth(*mesh, name="flat")
    scene.add_cloth(mesh[0] @ shapes.rotation((0, 1, 0), 1.2).T + [0.003, 0.004, 0.005], mesh[1], name="slanted")
    p.refused(cama.CollisionError, ["'flat'", "'slanted'"], lambda: p.simulation(scene), "crossing sheets")
    count = sum(pair.count for pair in scene.intersections())
    p.require(count > 0, "no pair is listed")
    p.run(scene, 5, clean=False, intersections="exempt")
    tangled = p.seen.intersections
    p.seen.intersections = 0
    p.run(scene, 10, intersections="untangle")
    p.seen.note = f"{count} at the start, {tangled} with exempt, {p.seen.intersections} with untangle"


def near_parallel_edges(p):
    """The lower edge of a falling upright sheet lies on the upper edge of one that is held, 5e-4 rad apart."""
    flat, faces = shapes.sheet(0.2, 0.1, 40)
    upright = flat[:, [0, 2, 1]]
    scene = cama.Scene(thickness=1e-3, time_step=2e-3)
    low = scene.add_cloth(upright, faces, name="held")
    scene.pin(low, np.arange(len(flat)))
    scene.add_cloth(
        upright @ shapes.rotation((0, 0, 1), 5e-4).T + [0.02, 0, 0.1025], faces, name="falling", velocity=(0.2, 0, -0.5)
    )
    p.run(scene, 40, bound=2)


def _drop(p, mesh, obstacle, height, steps=30, speed=1.0):
    """Drops a mesh on an obstacle; it may not get below it."""
    scene, _ = cloth_scene(mesh[0] + [0, 0, height], mesh[1], velocity=(0, 0, -speed), thickness=1e-3)
    scene.add_obstacle(*obstacle, name="target")
    return p.run(scene, steps, bound=2)


def corner_to_corner(p):
    """A tent's tip falls exactly on the tip of another."""
    upside = TENT[0] * [1, 1, -1], TENT[1][:, ::-1]
    simulation = _drop(p, upside, TENT, 0.104, steps=10)
    tip = simulation.positions[4]
    p.require(tip[2] > 0.05 or np.abs(tip[:2]).max() > 1e-3, f"the tip is at {tip}")


def corner_to_edge(p):
    """A tent's tip falls exactly on the edge between two triangles, and on a vertex where four meet."""
    upside = TENT[0] * [1, 1, -1], TENT[1][:, ::-1]
    ridge = np.array(
        [[-0.1, -0.1, -0.05], [0.1, -0.1, -0.05], [-0.1, 0, 0], [0.1, 0, 0], [-0.1, 0.1, -0.05], [0.1, 0.1, -0.05]]
    )
    roof = np.array([[0, 1, 3], [0, 3, 2], [2, 3, 5], [2, 5, 4]])
    _drop(p, upside, (ridge, roof), 0.054, steps=10)
    flat = shapes.lattice(0.2, 0.2, 2, 2)
    simulation = _drop(p, upside, flat, 0.054, steps=10)
    p.require(simulation.positions[4, 2] > 0, "the tip is under the sheet")


def edge_through_endpoint(p):
    """The edge of a falling triangle aims exactly at the end of an upright edge; another one grazes it sideways."""
    blade = np.array([[0, 0, 0], [0, 0.05, -0.1], [0, -0.05, -0.1]]), np.array([[0, 1, 2]])
    for across, velocity in ((0.0, (0, 0, -1.0)), (0.0, (1.0, 0, -1.0)), (1e-12, (0, 0, -1.0))):
        triangle = np.array([[-0.1, across, 0.006], [0.1, across, 0.006], [0, 0.15, 0.03]])
        scene, _ = cloth_scene(triangle, [[0, 1, 2]], velocity=velocity, thickness=1e-3)
        scene.add_obstacle(*blade, name="blade")
        p.run(scene, 12, bound=1)


def grazing(p):
    """A sheet flies past a ball, tangent to it within a hundredth of the thickness."""
    vertices, faces = shapes.sheet(0.1, 0.1, 32)
    scene, _ = cloth_scene(
        vertices + [-0.15, 0, 0.1 + 1e-5], faces, gravity=(0, 0, 0), velocity=(20, 0, 0), thickness=1e-3, time_step=1e-3
    )
    scene.add_obstacle(shape={"sphere": {"radius": 0.1, "triangles": 1280}}, name="ball")
    p.run(scene, 20, bound=2)


def _slope(p, friction, loaded=True, degrees=26.57, steps=120, settled=60):
    """Acceleration of a patch down a slope, m/s^2, and how far it moved, m, after it has settled.

    loaded: starts where the penalty carries its weight; else just out of contact, so that it moves when the load sets in.
    """
    angle = np.radians(degrees)
    down, normal = np.array([np.cos(angle), 0, -np.sin(angle)]), np.array([np.sin(angle), 0, np.cos(angle)])
    basis = np.stack([down, [0, 1, 0], normal])
    patch, faces = shapes.lattice(0.05, 0.05, 4, 4)
    material = cama.Material.isotropic(500, 0.3, 1e-4, 0.2)
    stiffness, thickness = 1e6, 1e-3
    gap = thickness - loaded * 0.2 * GRAVITY * np.cos(angle) / stiffness
    turned = (patch @ shapes.rotation((0, 0, 1), 0.3).T + [0.0033, 0, gap]) @ basis
    scene, _ = cloth_scene(
        turned, faces, rest=patch[:, :2], material=material, thickness=thickness, stiffness=stiffness
    )
    ground = np.array([[-0.5, -0.3, 0], [3, -0.3, 0], [3, 0.3, 0], [-0.5, 0.3, 0]]) @ basis
    scene.add_obstacle(ground, [[0, 1, 2], [0, 2, 3]], friction=friction, name="slope")
    simulation = p.run(scene, settled, tolerance=p.per_precision(1e-10, 1e-8, 1e-5))
    n = simulation.cloth_vertex_count
    place, speed = (simulation.positions[:n] @ down).mean(), (simulation.velocities @ down)[:n].mean()
    p.run(simulation, steps - settled)
    seconds = (steps - settled) * scene.time_step
    return ((simulation.velocities @ down)[:n].mean() - speed) / seconds, (
        simulation.positions[:n] @ down
    ).mean() - place


def frictionless(p):
    """mu = 0: down the slope with g sin(angle)."""
    acceleration, _ = _slope(p, 0.0)
    free = GRAVITY * np.sin(np.radians(26.57))
    p.seen.note = f"acceleration {acceleration / free:.4g} of free"
    p.near(acceleration, free, 0.02 * free, "acceleration")


def friction_angle(p):
    """1 % below tan(angle) what moves slides on with g sin(angle) / 100, 1 % above it stops."""
    tangent, free = np.tan(np.radians(26.57)), GRAVITY * np.sin(np.radians(26.57))
    slip, stick = _slope(p, 0.99 * tangent, False)[0], _slope(p, 1.01 * tangent, False)[1]
    p.seen.note = f"below: {slip / free:.4g} of free; above: moved {stick:.2g} m in 0.3 s"
    p.near(slip, 0.01 * free, 0.002 * free, "acceleration below the angle of friction")
    p.require(abs(stick) < 1e-3, f"moved {stick:.3g} m above the angle of friction")


def friction_angle_at_rest(p):
    """1 % below tan(angle) what rests under its load starts to slide with g sin(angle) / 100."""
    tangent, free = np.tan(np.radians(26.57)), GRAVITY * np.sin(np.radians(26.57))
    slip = _slope(p, 0.99 * tangent)[0]
    p.seen.note = f"{slip / free:.4g} of free"
    p.near(slip, 0.01 * free, 0.002 * free, "acceleration below the angle of friction")


def huge_friction(p):
    """mu = 1, 10 and 1e6: no motion on 26.57 degrees, and no explosion."""
    for mu in (1.0, 10.0, 1e6):
        moved = _slope(p, mu)[1]
        p.require(abs(moved) < 1e-3, f"mu = {mu:g}: moved {moved:.3g} m")


def all_pinned(p):
    """Held vertices keep every bit; moved ones are where the motion puts them."""
    vertices, faces = shapes.sheet(0.2, 0.2, 50)
    scene, cloth = cloth_scene(vertices, faces)
    scene.pin(cloth, np.arange(len(vertices)))
    simulation = p.run(scene, 10)
    p.require(np.array_equal(simulation.positions, vertices), "a held vertex moved")
    scene, cloth = cloth_scene(vertices, faces)
    scene.pin(cloth, np.arange(len(vertices)), dict(velocity=(1, 2, 3)))
    simulation = p.run(scene, 10)
    p.near(simulation.positions, vertices + np.array([1, 2, 3]) * simulation.time, 1e-12, "moved pins")


def pulled_apart(p):
    """Two opposite edges are pulled to ten times their distance: strain 9 along the pull."""
    vertices, faces = shapes.lattice(0.1, 0.1, 6, 6)
    scene, cloth = cloth_scene(vertices, faces, gravity=(0, 0, 0))
    for side in (1, -1):
        scene.pin(
            cloth, np.flatnonzero(np.isclose(vertices[:, 0], side * 0.05)), dict(velocity=(side * 2.25, 0, 0), stop=0.2)
        )
    simulation = p.run(scene, 60, bound=0.6)
    reach = np.ptp(simulation.positions[:, 0])
    p.near(reach, 1.0, 1e-9, "distance of the pinned edges")
    p.require(9 - 1e-3 <= p.seen.strain < 30, f"stretched by {p.seen.strain:.3g}, not about 9")


def pin_through_own_cloth(p):
    """A corner of a hanging sheet is driven through the sheet and out behind: stopped by name, or the sheet goes with it."""
    vertices, faces = shapes.sheet(0.2, 0.2, 72)
    upright = vertices[:, [0, 2, 1]]
    random = np.random.default_rng(3)
    start = upright + random.uniform(-1e-4, 1e-4, upright.shape)
    scene, cloth = cloth_scene(start, faces, rest=vertices[:, :2], thickness=1e-3)
    top = np.flatnonzero(np.isclose(vertices[:, 1], 0.1))
    corner = int(np.argmin(vertices[:, 0] + vertices[:, 1]))
    scene.pin(cloth, top)
    keys = [
        dict(time=0, translation=(0, 0, 0)),
        dict(time=0.1, translation=(0.1, 0.08, 0.08)),
        dict(time=0.2, translation=(0.12, -0.1, 0.1)),
    ]
    scene.pin(cloth, [corner], dict(keys=keys))
    p.run(scene, 50, bound=1)
