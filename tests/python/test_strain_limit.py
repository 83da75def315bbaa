# SPDX-License-Identifier: Apache-2.0
"""Strain limits: the static stretch and the energy of a biphasic law in closed form, backends, and files."""

import numpy as np
import pytest

import cama

STIFFNESS, STIFFENING = 200.0, 40.0  # N/m, 1
LIMIT = 0.05


def green(stretch):
    return (stretch**2 - 1) / 2


def added(strain, power):
    """What the limit adds in parts of (factor - 1) k: the stress (power 1) or its integral (2).

    The slope rises from 0 at the limit to 1 at one and a half of it.
    """
    start, rise = green(1 + LIMIT), green(1 + LIMIT) / 2
    strains = np.linspace(start, max(strain, start), 20001)
    slope = np.clip((strains - start) / rise, 0, 1)
    stress = np.concatenate([[0], np.cumsum((slope[1:] + slope[:-1]) / 2 * np.diff(strains))])
    return stress[-1] if power == 1 else np.sum((stress[1:] + stress[:-1]) / 2 * np.diff(strains))


def fabric(limit=LIMIT):
    material = cama.Material.isotropic(STIFFNESS, 0.0, 0.0, 0.1)
    material.strain_limit, material.limit_stiffening, material.mass_damping = limit, STIFFENING, 15.0
    return material


def strip():
    """A strip of 0.2 m x 0.1 m in the plane z = 0, warp along x."""
    scene = cama.Scene(gravity=(0, 0, 0), contact=False)
    scene.add_cloth(shape={"grid": {"size": [0.2, 0.1]}, "triangles": 60}, material=fabric(), name="strip")
    return scene


def stretch_under(force):
    """Stretch lambda at which lambda S(E) = force, N/m, with S = k E + (factor - 1) k added(E)."""
    low, high = 1.0, 2.0
    for _ in range(60):
        middle = (low + high) / 2
        strain = green(middle)
        stress = STIFFNESS * (strain + (STIFFENING - 1) * added(strain, 1))
        low, high = (low, middle) if middle * stress > force else (middle, high)
    return low


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("force", [5.0, 30.0])
def test_a_strip_stretches_by_the_biphasic_law(axis, force):
    scene = strip()
    along = scene.cloths[0].vertices[:, axis]
    simulation = cama.Simulation(scene, error="", time_step=1 / 200, backend="cpu")
    start = simulation.positions.copy()
    held, pulled = np.flatnonzero(along < along.min() + 1e-9), np.flatnonzero(along > along.max() - 1e-9)
    simulation.pin(held)
    across = np.sort(start[pulled, 1 - axis])
    widths = np.gradient(across)
    widths[[0, -1]] /= 2
    forces = np.zeros((len(pulled), 3))
    forces[np.argsort(start[pulled, 1 - axis]), axis] = force * widths
    simulation.set_force(pulled, forces)
    simulation.step(400)
    length = start[pulled, axis].mean() - start[held, axis].mean()
    found = (simulation.positions[pulled, axis].mean() - start[held, axis].mean()) / length
    assert found - 1 == pytest.approx(stretch_under(force) - 1, rel=2e-3)
    assert (found - 1 > LIMIT) == (force > 20)
    assert np.abs(simulation.velocities).max() < 1e-4  # at rest: it does not swing across the limit


@pytest.mark.parametrize(
    ("warp", "weft", "shear"), [(1.1, 1.0, 0.0), (0.9, 1.12, 0.0), (1.0, 1.0, 0.3), (1.2, 1.1, -0.25)]
)
def test_energy_of_an_affine_deformation(warp, weft, shear):
    """F = [[warp, shear], [0, weft]]; E = (F'F - 1) / 2; energy k (E11^2 + E22^2) / 2 + k33 E12^2, more beyond."""
    scene = strip()
    simulation = cama.Simulation(scene, backend="cpu", precision="double")
    moved = simulation.positions.copy()
    moved[:, 0], moved[:, 1] = warp * moved[:, 0] + shear * moved[:, 1], weft * moved[:, 1]
    simulation.set_state(moved, np.zeros_like(moved))
    f = np.array([[warp, shear], [0, weft]])
    e = (f.T @ f - np.eye(2)) / 2
    over = [added(strain, 2) for strain in (e[0, 0], e[1, 1], abs(e[0, 1]))]
    k33 = scene.cloths[0].material.stretching[0][3]
    energy = STIFFNESS / 2 * (e[0, 0] ** 2 + e[1, 1] ** 2) + k33 * e[0, 1] ** 2
    energy += (STIFFENING - 1) * (STIFFNESS * (over[0] + over[1]) + 2 * k33 * over[2])
    assert simulation.energy()["stretching"] == pytest.approx(0.02 * energy, rel=1e-6)


def test_limits_have_the_same_bits_on_every_backend():
    states = []
    for backend in ("cpu", "opencl"):
        scene = cama.Scene(contact=False, gravity=(0, 0, -200))
        cloth = scene.add_cloth(shape={"grid": {"size": [0.3, 0.3]}, "triangles": 100}, material=fabric(0.02))
        scene.pin(cloth, cloth.vertices[:, 0] < cloth.vertices[:, 0].min() + 1e-6)
        simulation = cama.Simulation(scene, time_step=1 / 200, backend=backend)
        simulation.step(60)
        states.append(simulation.positions.copy())
        strain = simulation.max_strain
    assert np.array_equal(*states)
    assert 0.02 < strain < 0.08


def test_limits_are_in_scene_files_and_checked(tmp_path):
    scene = strip()
    scene.save(tmp_path / "scene.json")
    read = cama.Scene.load(tmp_path / "scene.json").cloths[0].material
    assert (read.strain_limit, read.limit_stiffening) == (LIMIT, STIFFENING)
    for field, value in (("strain_limit", -0.1), ("limit_stiffening", 0.5)):
        material = fabric()
        setattr(material, field, value)
        with pytest.raises(cama.MaterialError, match=field):
            cama.Scene().add_cloth(shape={"grid": {"size": [1, 1]}, "triangles": 8}, material=material)
