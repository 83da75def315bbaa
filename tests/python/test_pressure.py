# SPDX-License-Identifier: Apache-2.0
"""Pressure inside closed cloth: Laplace's law of a sphere, momentum, backends, driving, scene files and warnings."""

import numpy as np
import pytest
import trimesh

import cama

STIFFNESS, POISSON, RADIUS = 100.0, 0.3, 0.1  # N/m, 1, m


def balloon(pressure=0.0, subdivisions=3, inside_out=False, **scene):
    sphere = trimesh.creation.icosphere(subdivisions, RADIUS)
    material = cama.Material.isotropic(STIFFNESS, POISSON, 0.0, 0.1)
    material.mass_damping = 15.0
    made = cama.Scene(gravity=(0, 0, 0), **scene)
    faces = sphere.faces[:, ::-1] if inside_out else sphere.faces
    made.add_cloth(np.array(sphere.vertices), np.array(faces), material=material, pressure=pressure, name="balloon")
    return made


def stretch(simulation):
    """Square root of the area over that at rest."""
    mesh = trimesh.Trimesh(simulation.positions, simulation.scene.cloths[0].faces, process=False)
    return np.sqrt(mesh.area / simulation.scene.cloths[0].rest_area)


@pytest.mark.parametrize("expected", [1.01, 1.1])
def test_a_sphere_stretches_by_laplaces_law(expected):
    """p = 2 T / r with the membrane's tension T = Y / (1 - nu) (s^2 - 1) / 2 at the stretch s, r = s R."""
    pressure = STIFFNESS / (1 - POISSON) * (expected**2 - 1) / (expected * RADIUS)
    simulation = cama.Simulation(balloon(pressure), error="", time_step=1 / 200, backend="cpu")
    simulation.step(200)
    assert stretch(simulation) - 1 == pytest.approx(expected - 1, rel=0.01)
    np.testing.assert_allclose(simulation.positions.mean(0), 0, atol=1e-6)


def test_pressure_of_a_closed_cloth_moves_it_nowhere():
    simulation = cama.Simulation(balloon(100.0, 2), error="", time_step=1 / 200, backend="cpu", precision="double")
    simulation.step(20)
    mass = np.array(simulation.masses)[:, None]
    assert np.abs((mass * simulation.velocities).sum(0)).max() < 1e-9 * np.abs(mass * simulation.velocities).sum()


@pytest.mark.parametrize("precision", ["double", "mixed", "single"])
def test_pressure_has_the_same_bits_on_every_backend(precision):
    states = []
    for backend in ("cpu", "opencl"):
        simulation = cama.Simulation(balloon(200.0, 1), time_step=1 / 200, backend=backend, precision=precision)
        simulation.step(10)
        states.append(simulation.positions.copy())
    assert np.array_equal(*states)
    assert states[0].max() > 1.02 * RADIUS


def test_pressure_is_driven_and_a_checkpoint_holds_it(tmp_path):
    def run(break_at):
        simulation = cama.Simulation(balloon(subdivisions=1), time_step=1 / 200, backend="cpu")
        simulation.step(3)
        simulation.set_pressure("balloon", 150.0)
        simulation.step(3)
        if break_at:
            simulation.save_checkpoint(tmp_path / "c.h5")
            simulation = cama.Simulation(balloon(subdivisions=1), time_step=1 / 200, backend="cpu")
            simulation.load_checkpoint(tmp_path / "c.h5")
            assert simulation.pressures.tolist() == [150.0]
        simulation.step(3)
        return simulation.positions.copy()

    whole = run(False)
    assert np.array_equal(whole, run(True))
    assert np.linalg.norm(whole, axis=1).max() > 1.01 * RADIUS


def test_pressure_is_in_scene_files(tmp_path):
    scene = balloon(123.0, 1)
    scene.save(tmp_path / "scene.json")
    assert cama.Simulation(cama.Scene.load(tmp_path / "scene.json"), backend="cpu").pressures.tolist() == [123.0]


def test_bad_pressures_are_named():
    with pytest.raises(cama.ArrayError, match="balloon: pressure"):
        balloon(float("nan"))
    simulation = cama.Simulation(balloon(subdivisions=1), backend="cpu")
    with pytest.raises(cama.SceneError, match="set_pressure"):
        simulation.set_pressure("bag", 1.0)
    with pytest.raises(cama.ArrayError, match="set_pressure: pressure"):
        simulation.set_pressure(0, float("inf"))
    assert simulation.pressures.tolist() == [0.0]


@pytest.mark.parametrize(("case", "text"), [("open", "is open"), ("inside out", "point inwards")])
def test_pressure_that_does_not_inflate_is_warned_of(case, text):
    if case == "open":
        scene = cama.Scene()
        scene.add_cloth(shape={"grid": {"size": [0.3, 0.3]}, "triangles": 50}, pressure=100.0, name="sheet")
    else:
        scene = balloon(100.0, 1, inside_out=True)
    with pytest.warns(cama.PlausibilityWarning, match=text):
        cama.Simulation(scene, backend="cpu")
