# SPDX-License-Identifier: Apache-2.0
"""What `cama view` colours cloth by, against closed forms; the page of a recording and of a live simulation."""

import numpy as np
import pytest

import cama
from cama.io.recording import Part
from cama.parts import flat_corners
from cama.viewing import colors, quantities
from cama.viewing.surface import Surface
from conftest import grid


def tube(radius, length, around, along):
    """A cylinder about the z axis without caps: vertices, faces."""
    turn, height = 2 * np.pi * np.arange(around) / around, np.linspace(0, length, along + 1)
    vertices = np.stack(
        [
            np.tile(radius * np.cos(turn), along + 1),
            np.tile(radius * np.sin(turn), along + 1),
            np.repeat(height, around),
        ],
        1,
    )
    i, j = (k.ravel() for k in np.meshgrid(np.arange(along), np.arange(around), indexing="ij"))
    a, b = i * around + j, i * around + (j + 1) % around
    return vertices, np.concatenate([np.stack([a, b, b + around], 1), np.stack([a, b + around, a + around], 1)])


def parts(*sizes):
    """Slices of so many vertices, one after the other."""
    ends = np.cumsum((0, *sizes))
    return [slice(int(first), int(last)) for first, last in zip(ends[:-1], ends[1:])]


@pytest.mark.parametrize(
    ("gradient", "expected"),
    [
        (np.diag([1.2, 0.9, 1]), 0.2),
        ([[1, 0.5, 0], [0, 1, 0], [0, 0, 1]], (0.5 + np.sqrt(4.25)) / 2 - 1),  # simple shear by 0.5
        ([[0, -1, 0], [0, 0, -1], [1, 0, 0]], 0.0),  # a rotation
        (np.diag([0.5, 0.8, 1]), -0.2),
    ],
)
def test_strain_is_the_largest_principal_stretch_less_one(gradient, expected):
    vertices, faces = grid(5)
    inverse = quantities.inverse_rest(vertices[faces][:, :, :2])
    moved = vertices @ np.transpose(gradient)
    np.testing.assert_allclose(quantities.strain(moved, faces, inverse), expected, atol=1e-12)
    laid = quantities.inverse_rest(flat_corners(vertices[:, [2, 0, 1]], faces))  # the rest shape stands on its edge
    np.testing.assert_allclose(quantities.strain(moved, faces, laid), expected, atol=1e-12)


def test_strain_of_a_simulation_is_its_own_maximum(falling):
    simulation = cama.Simulation(falling, accuracy="preview", precision="mixed")  # in single it rounds at 3e-6
    simulation.step(20)
    surface = Surface.of_simulation(simulation)
    values = quantities.strain(simulation.positions, surface.faces, surface._inverse)
    assert values.max() == pytest.approx(simulation.max_strain, rel=1e-6) and values.max() > 1e-4


def test_mean_curvature_of_a_cylinder_is_half_of_one_over_its_radius_and_of_a_sphere_one_over_it():
    vertices, faces = tube(0.2, 0.5, 180, 30)
    curvature = quantities.mean_curvature(vertices, faces)
    np.testing.assert_allclose(curvature[180:-180], 1 / (2 * 0.2), rtol=2e-4)  # (pi / n) / sin(pi / n) of a polygon
    np.testing.assert_allclose(quantities.mean_curvature(vertices, faces[:, ::-1]), curvature, atol=1e-9)
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.3)
    of_ball = quantities.mean_curvature(ball.vertices, ball.faces)
    assert np.median(of_ball) == pytest.approx(1 / 0.3, rel=2e-3)
    np.testing.assert_allclose(of_ball, 1 / 0.3, rtol=0.15)  # where five edges meet, a third of the area is too little
    flat = grid(6)
    np.testing.assert_allclose(quantities.mean_curvature(*flat), 0, atol=1e-12)


def test_speed_of_a_rotation_is_its_rate_times_the_distance_to_the_axis():
    vertices, _ = grid(6)
    rate, dt = np.array([0, 0, 3.0]), 1e-4
    radius = np.hypot(vertices[:, 0], vertices[:, 1])
    np.testing.assert_allclose(quantities.speed(np.cross(rate, vertices)), 3 * radius, atol=1e-12)

    def turned(angle):
        c, s = np.cos(angle), np.sin(angle)
        return vertices @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])

    between = quantities.velocities_between(turned(-3 * dt), turned(3 * dt), 2 * dt)
    np.testing.assert_allclose(quantities.speed(between), 3 * radius, rtol=1e-6, atol=1e-12)


def test_contacts_are_counted_at_vertices_that_take_part():
    rows = np.zeros(3, [("vertices", np.int32, 4), ("weights", float, 4)])
    rows["vertices"] = [[0, 3, 4, 5], [0, 1, 4, 9], [2, 3, 7, 8]]
    rows["weights"] = [[1, -0.5, -0.5, 0], [0.5, 0.5, -0.25, -0.75], [1, 0, 0, -1]]
    assert quantities.contact_counts(rows, 6).tolist() == [2, 1, 1, 1, 2, 0]


def test_gaps_are_distances_to_other_surfaces():
    sheet, faces = grid(10, z=0.1)
    n = len(sheet)
    floor = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]]) + [0, 0, 0.08]
    shown = [Part("sheet", slice(0, n), faces)]

    def gaps(points, **obstacle):
        other = Part("other", slice(n, n + len(points)), obstacle.pop("faces", np.zeros((0, 3), int)), **obstacle)
        x = np.concatenate([sheet, points])
        return quantities.Gaps(x, shown, [other])(x, 0.5)

    np.testing.assert_allclose(gaps(floor, shape="plane"), 0.02, atol=1e-12)
    ball = gaps(np.array([[0, 0, -0.2]]), shape="sphere", radius=0.25)
    np.testing.assert_allclose(ball, np.minimum(0.5, np.linalg.norm(sheet - [0, 0, -0.2], axis=1) - 0.25), atol=1e-12)
    square, two = grid(1, size=0.6, z=0.0)  # few triangles: exact, beyond its rim too
    away = np.maximum(np.abs(sheet[:, :2]) - 0.3, 0)
    np.testing.assert_allclose(gaps(square, faces=two), np.sqrt(0.01 + (away**2).sum(1)), atol=1e-12)
    fine, many = grid(37, size=1.3, z=0.03)  # a mesh with its vertices elsewhere
    np.testing.assert_allclose(gaps(fine, faces=many), 0.07, atol=1e-12)


def test_gaps_of_a_fold_are_seen_and_those_of_a_flat_sheet_are_not():
    sheet, faces = grid(40)
    gaps = quantities.Gaps(sheet, [Part("sheet", slice(0, len(sheet)), faces)], [])
    assert (gaps(sheet, 0.02) == 0.02).all()
    folded = sheet * [1, 1, 0] + np.outer(sheet[:, 0] > 0, [0, 0, 0.01])  # the right half comes to lie over the left
    folded[:, 0] = -np.abs(sheet[:, 0])
    over = gaps(folded, 0.02)
    far = np.abs(sheet[:, 0]) > 0.1
    np.testing.assert_allclose(over[far], 0.01, atol=1e-9)


def test_colours_of_bands_and_the_legend():
    assert colors.bands_of(np.array([-1, 0, 0.049, 0.05, 0.999, 1, 7, np.nan]), 0, 1, 20).tolist() == [
        0, 0, 0, 1, 19, 19, 19, 0,
    ]  # fmt: skip
    assert colors.bands_of(np.array([1.0, 2.0]), 1, 1, 20).tolist() == [0, 19]
    assert [colors.round_up(v) for v in (0.0123, 1, 1.01, 30, 0, np.nan)] == [0.02, 1, 2, 50, 1, 1]
    luminance = np.array(colors.band_colors()) @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(luminance) > 0).all()  # readable without colour vision, and in print
    text = colors.legend("strain <b>", 0, 10, "%")
    assert text.count("rgb(") == 20 and "&lt;b&gt; (%)" in text and "<span>2.5</span>" in text
