# SPDX-License-Identifier: Apache-2.0
"""Error measures against closed forms, other libraries and motions that are known."""

import math

import ipctk
import numpy as np
import pytest
import trimesh
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import cama
from cama import accuracy
from cama.measuring.reference import Reference, richardson
from conftest import grid

G = 9.81
EULER = {"integrator": "backward_euler", "newton_iterations": 1}


def sheet_in_the_air(time_step=0.005, cells=3):
    scene = cama.Scene(time_step=time_step, contact=False)
    scene.add_cloth(*grid(cells, size=0.3), name="sheet")
    return scene


def sphere(radius=1.0, shift=(0, 0, 0), subdivisions=4):
    ball = trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius)
    return np.array(ball.vertices) + shift, np.array(ball.faces)


# Distances of surfaces


def test_hausdorff_distance_of_shifted_and_of_concentric_spheres():
    first = sphere()
    d = accuracy.surface_distance(*first, *sphere(shift=(0.2, 0, 0)))
    # To a shifted sphere: largest the shift, on the mean |cos| of it: a half, to first order.
    assert d.hausdorff == pytest.approx(0.2, abs=3e-3) and d.forward == pytest.approx(d.backward, abs=5e-3)
    assert d.mean == pytest.approx(0.1, rel=0.03) and d.rms == pytest.approx(0.2 / math.sqrt(3), rel=0.03)
    d = accuracy.surface_distance(*first, *sphere(1.3, subdivisions=3))
    assert d.hausdorff == pytest.approx(0.3, abs=0.02) and d.mean == pytest.approx(0.3, rel=0.03)
    same = accuracy.surface_distance(*first, *first)
    assert same.hausdorff < 1e-12 and same.mean < 1e-12


def test_the_distance_is_symmetric_over_surfaces_that_cover_each_other_in_part():
    small, large = grid(4, size=1.0), grid(6, size=2.0)
    d = accuracy.surface_distance(*small, *large)
    assert d.forward < 1e-12
    assert d.backward == pytest.approx(0.5 * math.sqrt(2), rel=1e-9)  # a corner of the large one
    assert d.hausdorff == d.backward


def test_distances_to_a_surface_are_those_of_brute_force():
    rng = np.random.default_rng(3)
    vertices, faces = sphere(subdivisions=2)
    vertices[:, 0] *= 30  # long triangles beside small ones
    points = rng.normal(0, 5, (200, 3))
    exact = np.min([[ipctk.point_triangle_distance(p, *vertices[f]) for f in faces] for p in points], axis=1)
    np.testing.assert_allclose(
        accuracy.distance_to_surface(points, vertices, faces), np.sqrt(exact), rtol=1e-9, atol=1e-12
    )


# Strain, gaps, contacts that were missed, drape


def test_strain_of_a_known_deformation():
    vertices, faces = grid(4)
    matrix = np.array([[1.2, 0.3, 0], [0.0, 0.9, 0], [0, 0, 1]])
    s = accuracy.strain(vertices @ matrix.T, faces, vertices[faces])
    exact = np.linalg.svd(matrix[:2, :2], compute_uv=False) - 1
    np.testing.assert_allclose(s.principal, np.tile(exact, (len(faces), 1)), atol=1e-12)
    assert (
        s.largest == pytest.approx(exact[0])
        and s.mean_area == pytest.approx(1.2 * 0.9)
        and s.smallest_area == pytest.approx(1.08)
    )
    turned = trimesh.transformations.rotation_matrix(1.0, [1, 2, 3])[:3, :3]
    assert abs(accuracy.strain(vertices @ turned.T, faces, vertices[faces][:, :, :2]).largest) < 1e-12


def test_strain_agrees_with_the_library():
    scene = cama.Scene.load("flag", resolution=100)
    simulation = cama.Simulation(scene, threads=1)
    simulation.step(20)
    n = simulation.cloth_vertex_count
    s = accuracy.strain(
        simulation.positions[:n], simulation.faces[: simulation.cloth_triangle_count], accuracy.rest_shapes(scene)
    )
    assert s.largest == pytest.approx(simulation.max_strain, rel=1e-6) and s.p999 <= s.largest


def test_the_smallest_gap_of_sheets_and_of_crossing_edges():
    vertices, faces = grid(3)
    two = np.concatenate([vertices, vertices + [0.01, 0.02, 0.05]]), np.concatenate([faces, faces + len(vertices)])
    assert accuracy.smallest_gap(*two, within=0.1) == pytest.approx(0.05, rel=1e-9)
    assert accuracy.smallest_gap(*two, within=0.04) == math.inf
    # Two triangles whose edges cross at a distance of 3 mm, every vertex far away.
    x = np.array([[-1, 0, 0], [1, 0, 0], [0, 0, -2], [0, -1, 0.003], [0, 1, 0.003], [0, 0, 2]], float)
    assert accuracy.smallest_gap(x, [[0, 1, 2], [3, 4, 5]], within=0.1) == pytest.approx(0.003, rel=1e-9)
    assert accuracy.smallest_gap(x, [[0, 1, 2], [3, 4, 5]], within=0.1, first_obstacle_vertex=0) == math.inf


def test_missed_contacts_are_those_of_an_independent_detection():
    vertices, faces = grid(2)
    turned = vertices @ trimesh.transformations.rotation_matrix(0.3, [0, 0, 1])[:3, :3].T + [0.02, 0.01, 0]
    before = np.concatenate([vertices, turned + [0, 0, 0.1]])
    after = np.concatenate([vertices, turned - [0, 0, 0.1]])
    both = np.concatenate([faces, faces + len(vertices)])
    vf, ee = accuracy.missed_contacts(before, after, both)
    mesh = ipctk.CollisionMesh(before, edges=ipctk.edges(both.astype(np.int32)), faces=both.astype(np.int32))
    candidates = ipctk.Candidates()
    candidates.build(mesh, before, after)
    ccd = ipctk.TightInclusionCCD()
    e, f = mesh.edges, mesh.faces

    def hits(pairs):
        found = 0
        for c in pairs:
            found += c.ccd(c.dof(before, e, f), c.dof(after, e, f), 0.0, 1.0, ccd)[0]
        return found

    assert len(vf) == hits(candidates.fv_candidates) > 0 and len(ee) == hits(candidates.ee_candidates) > 0
    assert not sum(map(len, accuracy.missed_contacts(before, before, both)))
    assert not sum(map(len, accuracy.missed_contacts(before, after, both, first_obstacle_vertex=0)))


def test_a_run_with_contact_misses_nothing_and_one_without_does():
    for contact in (True, False):
        scene = cama.Scene(time_step=0.005, contact=contact)
        scene.add_cloth(*grid(5, size=0.4, z=0.11), name="sheet")
        scene.add_obstacle(shape={"sphere": {"radius": 0.1, "triangles": 80}}, name="ball")
        simulation, found = cama.Simulation(scene, threads=1), 0
        for _ in range(25):
            before = simulation.positions
            simulation.step()
            found += sum(
                map(
                    len,
                    accuracy.missed_contacts(
                        before, simulation.positions, simulation.faces, simulation.cloth_vertex_count
                    ),
                )
            )
        assert (found == 0) == contact


def test_drape_coefficient_of_a_board_a_cone_and_cloth_that_hangs_straight():
    disc = trimesh.creation.icosphere(subdivisions=4)
    plane = np.array(disc.vertices)
    plane[:, 2] = 0  # the sphere laid flat: a disc of radius 1
    flat = math.pi
    assert accuracy.drape_coefficient(plane, disc.faces, 0.6, flat) == pytest.approx(1.0, abs=0.02)
    assert accuracy.drape_coefficient(0.6 * plane, disc.faces, 0.6, flat) == pytest.approx(0.0, abs=0.01)
    assert accuracy.drape_coefficient(0.8 * plane, disc.faces, 0.6, flat) == pytest.approx(
        (0.64 - 0.36) / (1 - 0.36), abs=0.02
    )
    assert accuracy.shadow_area(*grid(2, size=2.0)) == pytest.approx(4.0, rel=0.01)
    with pytest.raises(cama.ArrayError, match="larger"):
        accuracy.drape_coefficient(plane, disc.faces, 2.0, flat)


# Motion


def test_position_error_by_hand():
    e = accuracy.position_error([[0, 0, 0], [0, 0, 2.0]], [[0, 3, 0], [0, 0, 0]], [1.0, 3.0], 0.5)
    assert (
        e.rms == pytest.approx(math.sqrt((1 * 9 + 3 * 4) / 4))
        and e.largest == 3
        and e.rms_edges == e.rms / 0.5
        and e.largest_edges == 6
    )


def test_free_fall_is_off_by_half_a_step_of_gravity():
    # Backward Euler: x_n = -g dt^2 n (n + 1) / 2, the exact fall -g t^2 / 2: off by g dt t / 2.
    scene, window = sheet_in_the_air(), 0.1
    r = accuracy.reference(scene, window=window, windows=2, first=1, time_step=window / 160)
    x0 = scene.cloths[0].vertices
    for i, start in enumerate(r.starts):
        fall = r.positions[i][:, 2] - r.velocities[i][:, 2] * 0
        exact = fall + r.velocities[i][:, 2] * window - G * window**2 / 2
        np.testing.assert_allclose(
            r.targets[i][:, 2], exact, atol=1e-9
        )  # extrapolation takes out an error of first order
        assert r.velocities[i][0, 2] == pytest.approx(-G * start, rel=1e-9)
    assert (
        r.converged
        and (r.order == pytest.approx(1, abs=0.05) or r.order == pytest.approx(2, abs=0.05))
        and r.uncertainty.max() < 1e-9
    )
    assert r.edge == pytest.approx((24 * 0.1 + 9 * 0.1 * math.sqrt(2)) / 33, rel=1e-9)
    for dt in (0.05, 0.02, 0.005):
        e = accuracy.restart_error(r, scene, time_step=dt, **EULER)
        assert e.steps == round(window / dt) and not e.at_floor
        np.testing.assert_allclose(e.rms, G * dt * window / 2, rtol=1e-6)
        np.testing.assert_allclose(e.largest, G * dt * window / 2, rtol=1e-6)
        # Energy from the state at the window's start, v = -g t0: potential off by m g (g dt w / 2), kinetic exact.
        mass = r.masses.sum()
        assert e.energy == pytest.approx(
            mass * G * G * dt * window / 2, abs=1.01 * mass * G * G * r.time_step * window / 2
        )
        assert e.momentum < 1e-9
    assert np.abs(x0).max() > 0


def test_energy_and_momentum_drift_of_a_free_fall():
    dt, scene = 0.01, sheet_in_the_air(0.01)
    d = accuracy.drift(scene, 0.3, **EULER)
    mass = cama.Simulation(scene).masses.sum()
    assert d.energy == pytest.approx(-0.5 * mass * G**2 * dt, rel=1e-6)  # E_n = m g^2 dt^2 (n^2 - n (n + 1)) / 2
    assert d.momentum < 1e-9 and d.angular_momentum < 1e-12


def test_angular_momentum_of_a_turning_ring():
    angle = np.linspace(0, 2 * math.pi, 12, endpoint=False)
    x = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    v = np.cross([0, 0, 3.0], x)
    m = np.full(12, 0.5)
    np.testing.assert_allclose(accuracy.angular_momentum(x, v, m), [0, 0, 12 * 0.5 * 3], atol=1e-12)
    np.testing.assert_allclose(accuracy.momentum(v, m), 0, atol=1e-12)
    assert accuracy.residual_speed(v, m) == pytest.approx(3)


def test_the_reference_is_a_pendulum():
    # One stiff triangle, held at two corners: its third corner, with its lumped mass, is a pendulum of the triangle's
    # height.
    height = 0.5
    scene = cama.Scene(time_step=0.005, contact=False)
    material = cama.Material.isotropic(2e3, 0.0, bending=0.0, density=0.1)
    swing = scene.add_cloth(
        [[0, -0.2, 0], [0, 0.2, 0], [height, 0, 0]], [[0, 1, 2]], material=material, name="pendulum"
    )
    scene.pin(swing, [0, 1])
    r = accuracy.reference(scene, window=0.1, windows=3, first=1, time_step=0.1 / 640)
    for i in range(3):
        x, v = r.positions[i][2], r.velocities[i][2]
        start = math.atan2(x[2], x[0])
        rate = (v[2] * x[0] - v[0] * x[2]) / (x @ x)
        swung = solve_ivp(
            lambda t, y: [y[1], -G / height * math.cos(y[0])], (0, 0.1), [start, rate], rtol=1e-10, atol=1e-12
        ).y[:, -1]
        exact = height * np.array([math.cos(swung[0]), 0, math.sin(swung[0])])
        assert np.linalg.norm(r.targets[i][2] - exact) < 2e-4  # it is stretched by a hundred thousandth
        assert np.linalg.norm(r.ends[i][2] - exact) < 1e-3
    e = [
        accuracy.restart_error(r, scene, time_step=dt, precision="double", tolerance=1e-8, **EULER).rms_all
        for dt in (0.00125, 0.000625, 0.0003125)
    ]
    assert e[0] / e[1] == pytest.approx(2, rel=0.1) and e[1] / e[2] == pytest.approx(2, rel=0.1)  # first order


def test_a_hanging_strip_is_a_catenary():
    span, length, cells = 0.8, 1.0, 40
    scene = cama.Scene(time_step=1 / 120, contact=False)
    x = np.linspace(0, span, cells + 1)
    vertices = np.concatenate([np.stack([x, np.full_like(x, y), 0 * x], axis=1) for y in (0, 0.02)])
    k = np.arange(cells)
    faces = np.concatenate([np.stack([k, k + 1, k + cells + 2], 1), np.stack([k, k + cells + 2, k + cells + 1], 1)])
    rest = vertices[:, :2] * [length / span, 1]
    material = cama.Material.isotropic(2000, 0.0, bending=0.0, density=0.2)
    material.damping = 0.02
    strip = scene.add_cloth(
        vertices, faces, material=material, material_vertices=rest, material_faces=faces, name="strip"
    )
    scene.pin(strip, [0, cells, cells + 1, 2 * cells + 1])
    simulation = cama.Simulation(scene, precision="double", tolerance=1e-8, **EULER)
    simulation.step(1500)
    found = simulation.positions[: cells + 1]
    a = brentq(lambda a: 2 * a * math.sinh(span / (2 * a)) - length, 0.05, 5)
    middle = span / 2
    exact = a * (np.cosh((found[:, 0] - middle) / a) - math.cosh(middle / a))
    count = simulation.cloth_vertex_count
    assert accuracy.residual_speed(simulation.velocities[:count], simulation.masses) < 1e-3
    assert np.abs(found[:, 2] - exact).max() < 0.004 * length
    residual = accuracy.nonlinear_residual(
        scene,
        simulation.velocities[:count],
        simulation.positions[:count],
        simulation.velocities[:count],
        1 / 120,
        simulation.masses,
    )
    assert residual < 0.05  # at rest, forces balance


def test_accelerations_are_the_gradient_of_the_energy():
    scene = sheet_in_the_air()
    simulation = cama.Simulation(scene, threads=1)
    n = simulation.cloth_vertex_count
    x = simulation.positions[:n] + np.random.default_rng(1).normal(0, 2e-3, (n, 3))
    force = simulation.masses[:, None] * accuracy.accelerations(scene, x, np.zeros((n, 3)))
    h = 1e-6
    for vertex, axis in ((0, 0), (5, 1), (7, 2), (n - 1, 0)):
        e = []
        for sign in (1, -1):
            y = x.copy()
            y[vertex, axis] += sign * h
            simulation.set_state(y, np.zeros((n, 3)))
            e.append(sum(simulation.energy().values()))
        assert force[vertex, axis] == pytest.approx(-(e[0] - e[1]) / (2 * h), abs=2e-4 * np.abs(force).max())


def test_the_nonlinear_residual_falls_with_the_time_step():
    scene, found = cama.Scene.load("flag", resolution=60), []
    for dt in (1 / 120, 1 / 960):
        simulation = cama.Simulation(_with(scene, dt), precision="double", tolerance=1e-10)
        n = simulation.cloth_vertex_count
        simulation.step(round(0.1 / dt) - 1)
        before = simulation.velocities[:n]
        simulation.step()
        found.append(
            accuracy.nonlinear_residual(
                scene, before, simulation.positions[:n], simulation.velocities[:n], dt, simulation.masses
            )
        )
    assert found[1] < 0.3 * found[0]
    fall = sheet_in_the_air()
    simulation = cama.Simulation(fall)
    n = simulation.cloth_vertex_count
    simulation.step()
    assert (
        accuracy.nonlinear_residual(
            fall, np.zeros((n, 3)), simulation.positions[:n], simulation.velocities[:n], 0.005, simulation.masses
        )
        < 1e-6
    )


def _with(scene, dt):
    changed = scene.copy()
    changed.time_step = dt
    return changed


@pytest.mark.parametrize("friction, static", [(0.2, 0.4), (0.3, 0.6)])
def test_the_friction_angle_is_that_of_static_friction(friction, static):
    assert accuracy.friction_angle(friction, static, threads=1) == pytest.approx(
        math.degrees(math.atan(static)), abs=0.3
    )


def test_the_friction_angle_with_equal_coefficients_is_within_two_degrees():
    # docs/theory/contact.md: a slide from rest shortly above the angle can stick again.
    assert accuracy.friction_angle(0.3, threads=1) == pytest.approx(math.degrees(math.atan(0.3)), abs=2)


# Reference


def test_richardson_of_known_sequences():
    masses = np.ones(4)
    exact = np.random.default_rng(0).normal(size=(2, 4, 3))
    slope, curve = np.random.default_rng(1).normal(size=(2, 2, 4, 3))
    first = richardson({k: exact + 0.01 * k * slope + 1e-5 * k * k * curve for k in (1, 2, 4)}, masses)
    assert first["order"] == pytest.approx(1, abs=0.02) and first["shrinks"]
    assert np.abs(first["targets"] - exact).max() < 1e-4
    rms = np.sqrt(((first["targets"] - exact) ** 2).sum(axis=2).mean(axis=1))
    assert (rms <= first["uncertainty"]).all()
    second = richardson({k: exact + 0.01 * k * k * slope for k in (1, 2, 4)}, masses)
    assert second["order"] == pytest.approx(2, abs=1e-6) and np.abs(second["targets"] - exact).max() < 1e-12
    rng = np.random.default_rng(2)
    chaos = richardson({k: exact + 0.01 * rng.normal(size=exact.shape) for k in (1, 2, 4)}, masses)
    assert not chaos["shrinks"] and (chaos["uncertainty"] > 0.005).all()


def test_a_reference_survives_a_file(tmp_path):
    r = accuracy.reference(sheet_in_the_air(), window=0.05, windows=2, time_step=0.05 / 8)
    r.save(tmp_path / "r.npz")
    again = Reference.load(tmp_path / "r.npz")
    for name, value in r.__dict__.items():
        np.testing.assert_array_equal(getattr(again, name), value)
        assert not np.isnan(np.asarray(value, float)).any(), name
    assert isinstance(again.converged, bool) and isinstance(again.edge, float)


def test_a_restart_does_not_depend_on_what_came_before(falling):
    # The reference's own settings from its own states, in a simulation that has computed nothing yet, give its own ends
    # up to the solve.
    r = accuracy.reference(
        falling, window=0.02, windows=3, first=1, stride=2, time_step=0.02 / 16, accuracy="production", tolerance=1e-10
    )
    for i in (2, 0, 1):
        simulation = cama.Simulation(_with(falling, r.time_step), precision="double", tolerance=1e-10)
        simulation.set_state(r.positions[i], r.velocities[i])
        simulation.step(16)
        np.testing.assert_allclose(simulation.positions[: len(r.masses)], r.ends[i], rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    "call, text",
    [
        (lambda s, r: accuracy.reference(s, window=0.05, time_step=0.02), "whole number of steps"),
        (lambda s, r: accuracy.reference(s, window=-1), "window"),
        (lambda s, r: accuracy.reference(s, window=0.05, starts=[0, 0.02]), "apart"),
        (lambda s, r: accuracy.reference(s, window=0.05, starts=[[0]]), "starts"),
        (lambda s, r: accuracy.restart_error(r, s, time_step=0.03), "whole number of steps"),
        (lambda s, r: accuracy.restart_error(r, s, steps=3), "10"),
        (lambda s, r: accuracy.restart_error(r, sheet_in_the_air(cells=2)), "vertices"),
        (lambda s, r: accuracy.position_error([[0, 0, 0]], [[0, 0]], [1], 1), "expected"),
        (lambda s, r: accuracy.position_error([[0, 0, 0]], [[0, 0, np.nan]], [1], 1), "finite"),
        (lambda s, r: accuracy.position_error([[0, 0, 0]], [[0, 0, 0]], [1], 0), "edge"),
        (lambda s, r: accuracy.strain([[0, 0, 0]] * 3, [[0, 1, 2]], [[[0, 0], [1, 0]]]), "rest"),
        (lambda s, r: accuracy.friction_angle(0.5, 0.2), "friction"),
    ],
)
def test_bad_input_is_named(call, text):
    scene = sheet_in_the_air()
    r = accuracy.reference(scene, window=0.05, windows=1, time_step=0.05 / 8)
    with pytest.raises(cama.ArrayError, match=text):
        call(scene, r)


def test_bad_meshes_are_named():
    with pytest.raises(cama.MeshError, match="face 0"):
        accuracy.surface_distance([[0, 0, 0]] * 3, [[0, 1, 7]], *grid(1))
    with pytest.raises(cama.MeshError, match="no faces"):
        accuracy.smallest_gap([[0, 0, 0]], np.zeros((0, 3), int), 0.1)
    with pytest.raises(cama.MeshError, match="no area"):
        accuracy.strain([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], [[[0, 0], [1, 0], [2, 0]]])
