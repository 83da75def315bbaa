# SPDX-License-Identifier: Apache-2.0
"""Cloth whose vertices are above edges and corners of what carries it: heights by the weight, slides by Coulomb."""

import numpy as np
import pytest

import cama
from conftest import grid

THICKNESS, STIFFNESS, DENSITY = 1e-3, 1e6, 0.2  # m, N/m^3, kg/m^2
SIDE = 0.4  # m, of the box
HEIGHT = THICKNESS - 9.81 * DENSITY / STIFFNESS  # where each vertex presses its own weight
#: A corner of the cloth in parts of half the box: above a face of the box, its diagonals, its edges, its corners.
PLACES = {
    "face": (0.21, 0.37),
    "diagonal": (0.25, 0.25),
    "other diagonal": (0.25, -0.25),
    "middle": (0.0, 0.0),
    "edge": (1.0, 0.3),
    "corner": (1.0, 1.0),
    "other corner": (-1.0, 1.0),
}


def material(**values):
    result = cama.Material.isotropic(200, 0.3, 1e-5, DENSITY)
    result.contact_stiffness = STIFFNESS
    return result


def on_box(place, **options):
    """A triangle whose first corner is at `place`, the others nearer to the middle of one of the box's faces."""
    scene = cama.Scene(thickness=THICKNESS, self_contact=False)
    corner = np.array(place) * SIDE / 2
    towards = np.array([0.3, 0.11]) * SIDE / 2 if place == (0.0, 0.0) else -0.3 * corner
    aside = np.array([-towards[1], towards[0]])
    flat = np.stack([corner, corner + towards + 0.7 * aside, corner + towards - 0.2 * aside])
    triangle = np.column_stack([flat, np.full(3, 1.02 * THICKNESS)])
    scene.add_cloth(triangle, [[0, 1, 2]], material=material(), name="sheet")
    scene.add_obstacle(
        shape={"shape": {"box": {"size": [SIDE, SIDE, 0.1]}}},
        translate=(0, 0, -0.05),
        contact_stiffness=STIFFNESS,
        friction=0.3,
        name="box",
    )
    return cama.Simulation(scene, backend="cpu", threads=1, time_step=1 / 240, forces=True, **options)


@pytest.mark.parametrize("precision", ["double", "mixed", "single"])
@pytest.mark.parametrize("place", PLACES)
def test_each_vertex_presses_its_own_weight_wherever_it_is(place, precision):
    simulation = on_box(PLACES[place], precision=precision)
    simulation.step(240)
    rounding = 1e-4 if precision == "double" else 1e-2  # of the depth
    np.testing.assert_allclose(simulation.positions[:3, 2], HEIGHT, atol=rounding * (THICKNESS - HEIGHT))
    weight = 9.81 * simulation.masses.sum()
    assert simulation.force_on("box").force[2] == pytest.approx(-weight, rel=rounding)
    assert simulation.report["contacts"] == 3 and simulation.count_intersections() == 0


def sliding(angle, aligned, seconds, friction, speed=0.4):
    """m/s along its direction of a patch that slides over a table of many cells, what a block has, and its heights, m.

    aligned: its vertices move along the lines of the table's edges and diagonals, and over its corners.
    """
    scene = cama.Scene(thickness=THICKNESS, self_contact=False)
    vertices, faces = grid(5, 0.05)
    table, triangles = grid(100, 1.0)
    shift = (0, 0) if aligned else (0.0013, 0.0047)
    vertices += [*shift, HEIGHT]
    direction = np.array([np.cos(angle), np.sin(angle), 0])
    scene.add_cloth(vertices, faces, material=material(), velocity=tuple(speed * direction), name="patch")
    scene.add_obstacle(table, triangles, friction=friction, contact_stiffness=STIFFNESS, name="table")
    simulation = cama.Simulation(scene, backend="cpu", threads=1, time_step=1 / 240, integrator="bdf2")
    n, highest, lowest = simulation.cloth_vertex_count, 0.0, 1.0
    for _ in range(round(seconds * 240)):
        simulation.step()
        z = simulation.positions[:n, 2]
        highest, lowest = max(highest, z.max()), min(lowest, z.min())
    return (simulation.velocities[:n] @ direction).mean(), speed - friction * 9.81 * seconds, (lowest, highest)


@pytest.mark.parametrize("aligned", [True, False])
@pytest.mark.parametrize("degrees", [0, 17, 45, 90, 135])
def test_a_patch_slides_over_edges_and_corners_without_gap_or_ledge(degrees, aligned):
    friction, seconds = 0.1, 0.25
    end, block, (lowest, highest) = sliding(np.radians(degrees), aligned, seconds, friction)
    assert end == pytest.approx(block, abs=0.003 * friction * 9.81 * seconds)
    assert lowest > HEIGHT - 0.1 * (THICKNESS - HEIGHT) and highest < THICKNESS + 0.1 * (THICKNESS - HEIGHT)
