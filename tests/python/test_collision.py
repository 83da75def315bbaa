# SPDX-License-Identifier: Apache-2.0
"""Geometry queries against ipctk."""

import ipctk
import numpy as np
import pytest

import cama
from cama import collision
from conftest import edges_of, grid

KINDS = ["vertex_face", "edge_edge"]
OURS = {"vertex_face": collision.vertex_face_ccd, "edge_edge": collision.edge_edge_ccd}


def tight_inclusion(kind, start, end, tolerance=1e-9):
    ccd = ipctk.TightInclusionCCD(tolerance, 1_000_000, 1.0)
    query = ccd.point_triangle_ccd if kind == "vertex_face" else ccd.edge_edge_ccd
    answers = [query(*a, *b) for a, b in zip(start, end)]
    return np.array([hit for hit, _ in answers]), np.array([time for _, time in answers])


def random_queries(seed, n, speed=1.0):
    random = np.random.default_rng(seed)
    start = random.normal(size=(n, 4, 3))
    return start, start + speed * random.normal(size=(n, 4, 3))


def adversarial_queries(kind, seed, n):
    """Points that meet at a random time, near corners, edges and parallel positions: exactly, every number and product
    being a double.
    """
    random = np.random.default_rng(seed)
    start, end = (np.round(x * 2**12) / 2**12 for x in random_queries(seed + 1, n))
    time = random.integers(1, 16, n) / 16
    middle = start + time[:, None, None] * (end - start)
    corner = random.integers(0, 3, n)
    if kind == "vertex_face":
        weight = np.round(random.dirichlet([0.2] * 3, n) * 64) / 64
        weight[:, 2] = 1 - weight[:, 0] - weight[:, 1]
        weight[weight[:, 2] < 0] = [0, 0.25, 0.75]
        weight[corner == 0] = [0.5, 0.5, 0]
        weight[corner == 1] = [1, 0, 0]
        target = np.einsum("nk,nkd->nd", weight, middle[:, 1:])
        moved = 0
        shift = target - middle[:, moved]
        start[:, 0] += shift
        end[:, 0] += shift
    else:
        near = np.flatnonzero(corner == 0)
        for points in (start, end):
            points[near, 3] = points[near, 2] + (points[near, 1] - points[near, 0]) * (1 + 2**-16)
        middle = start + time[:, None, None] * (end - start)
        s, t = random.choice([0, 1, 0.25, 0.75], (2, n))
        shift = (
            (1 - s)[:, None] * middle[:, 0]
            + s[:, None] * middle[:, 1]
            - (1 - t)[:, None] * middle[:, 2]
            - t[:, None] * middle[:, 3]
        )
        for points in (start, end):
            points[:, 2:] += shift[:, None]
    return start, end


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(3))
def test_ccd_finds_all_that_tight_inclusion_finds(kind, seed):
    start, end = random_queries(seed, 3000)
    hit, time = OURS[kind](start, end)
    truth, first = tight_inclusion(kind, start, end)
    assert hit.dtype == bool and hit.shape == time.shape == (3000,)
    assert truth.sum() > 50
    assert not (truth & ~hit).any()
    late = truth & (time > first + 2e-8)  # Tight Inclusion may be early by its tolerance; asked again with a finer one
    first[late] = tight_inclusion(kind, start[late], end[late], 1e-12)[1]
    assert (time[truth] <= first[truth] + 2e-8).all()
    assert (hit & ~truth).sum() <= 3
    assert np.median(first[truth] - time[truth]) < 1e-3


@pytest.mark.parametrize("kind", KINDS)
def test_ccd_misses_no_planted_contact(kind):
    start, end = adversarial_queries(kind, 5, 3000)
    assert OURS[kind](start, end)[0].all()
    if kind == "vertex_face":  # Tight Inclusion takes minutes for nearly parallel edges
        assert tight_inclusion(kind, start[:300], end[:300])[0].all()


@pytest.mark.parametrize("kind", KINDS)
def test_cubic_agrees_away_from_degeneracy(kind):
    start, end = random_queries(11, 3000)
    hit, time = OURS[kind](start, end, method="cubic")
    truth, first = tight_inclusion(kind, start, end)
    assert (hit != truth).sum() <= 3
    both = hit & truth
    assert np.abs(time[both] - first[both]).max() < 1e-4


@pytest.mark.parametrize("kind", KINDS)
def test_ccd_keeps_the_minimum_distance(kind):
    start, end = random_queries(21, 1000, speed=0.5)
    distance = collision.vertex_face_distance if kind == "vertex_face" else collision.edge_edge_distance
    apart = distance(start) > 0.05
    start, end = start[apart], end[apart]
    hit, time = OURS[kind](start, end, minimum_distance=0.05)
    assert hit.sum() > OURS[kind](start, end)[0].sum()
    for t in np.linspace(0, 1, 21):
        earlier = t < time
        assert (distance((start + t * (end - start))[earlier]) >= 0.05 * (1 - 1e-9)).all()


@pytest.mark.parametrize("kind", KINDS)
def test_distances_equal_ipctk(kind):
    points = np.concatenate([random_queries(31, 500)[0], np.round(random_queries(32, 500)[0])])
    ours, weights = (collision.vertex_face_distance if kind == "vertex_face" else collision.edge_edge_distance)(
        points, return_weights=True
    )
    theirs = ipctk.point_triangle_distance if kind == "vertex_face" else ipctk.edge_edge_distance
    flat = np.linalg.norm(np.cross(points[:, 2] - points[:, 1], points[:, 3] - points[:, 1]), axis=1) > 0.1
    if kind == "edge_edge":
        flat = (
            np.minimum(
                np.linalg.norm(points[:, 1] - points[:, 0], axis=1), np.linalg.norm(points[:, 3] - points[:, 2], axis=1)
            )
            > 0.1
        )
    expected = np.sqrt([max(0.0, theirs(*p)) for p in points[flat]])
    np.testing.assert_allclose(ours[flat], expected, atol=1e-9)
    np.testing.assert_allclose(
        np.linalg.norm(np.einsum("nk,nkd->nd", weights, points), axis=1)[flat], ours[flat], atol=1e-9
    )


@pytest.mark.parametrize("shift", [0.01, 0.05, -0.05, 2.0])
def test_intersections_agree_with_ipctk(shift):
    sheet, faces = grid(6)
    other = sheet[:, [0, 2, 1]] @ np.array([[0.9, 0.1, 0], [-0.1, 0.9, 0.1], [0, 0.2, 1]]) + [0.013, 0.017, shift]
    vertices, faces = np.concatenate([sheet, other]), np.concatenate([faces, faces + len(sheet)]).astype(np.int32)
    mesh = ipctk.CollisionMesh(vertices, edges_of(faces).astype(np.int32), faces)
    found = collision.intersections(vertices, faces)
    assert (len(found) > 0) == ipctk.has_intersections(mesh, vertices)
    for a, b, f in found:
        assert ipctk.is_edge_intersecting_triangle(vertices[a], vertices[b], *vertices[faces[f]])
    assert len(collision.intersections(vertices, faces, first_obstacle_vertex=0)) == 0


def test_nothing_in_nothing_out():
    empty = np.zeros((0, 4, 3))
    hit, time = collision.vertex_face_ccd(empty, empty)
    assert hit.shape == time.shape == (0,)
    assert collision.edge_edge_distance(empty).shape == (0,)


@pytest.mark.filterwarnings("ignore::cama.PlausibilityWarning")  # no fabric is as heavy
@pytest.mark.parametrize("density", [200.0, 2000.0])
def test_contacts_carry_any_load_at_half_the_thickness(density):
    """A heavy sheet laid on a plane: the least gap is half the thickness, not what a spring of fixed stiffness leaves,
    and nothing is left to impacts.
    """
    scene = cama.Scene(thickness=2e-3)
    vertices, faces = grid(8, 0.2, z=0.004)
    scene.add_cloth(vertices, faces, name="sheet", material=cama.Material.isotropic(100, 0.3, 1e-5, density))
    scene.add_obstacle(shape={"plane": {"size": [1, 1], "triangles": 8}}, name="floor", translate=(0.013, 0.017, 0))
    simulation = cama.Simulation(scene, threads=1, time_step=0.005)
    simulation.step(200)
    impacts = 0
    for _ in range(20):
        simulation.step()
        impacts += simulation.report["impacts"]
    assert impacts == 0
    assert simulation.positions[: simulation.cloth_vertex_count, 2].min() == pytest.approx(1e-3, rel=0.01)


def test_cloth_that_has_blown_up_is_a_named_error_in_paper_mode():
    """Vertices that cross the scene many times in a step are near everything: 5 million pairs of 3,200 triangles, or an
    error before that.
    """
    scene = cama.Scene(time_step=0.005, gravity=(0, 0, 0))
    scene.add_cloth(*grid(40))
    simulation = cama.Simulation(scene, accuracy="paper", threads=1)
    x = simulation.positions
    simulation.set_state(x, np.random.default_rng(1).normal(size=x.shape) * 1e6)
    with pytest.raises(cama.SolverError, match="unstable; take a smaller time step"):
        simulation.step()
    assert np.array_equal(simulation.positions, x)
