# SPDX-License-Identifier: Apache-2.0
"""Damping of materials against its closed forms: free fall, swings and vibrations."""

import math

import numpy as np
import pytest

import cama

G = 9.81


def material(mass_damping=0.0, damping=0.0, youngs_modulus=2000.0, bending=1e-5):
    """Returns a material of 0.1 kg/m^2."""
    made = cama.Material.isotropic(youngs_modulus, 0.0, bending, 0.1)
    made.mass_damping, made.damping = mass_damping, damping
    return made


def falling_velocity(mass_damping, wind=None, seconds=1.0, **options):
    """Returns the mean velocity of a sheet that was let go."""
    scene = cama.Scene(contact=False)
    if wind:
        scene.wind = {"velocity": wind, "density": 0.0, "drag": 0.0}
    shape = {"grid": {"size": [0.2, 0.2], "cells": [4, 4]}}
    scene.add_cloth(shape=shape, material=material(mass_damping), name="sheet")
    simulation = cama.Simulation(scene, backend="cpu", error="", **options)
    simulation.step(round(seconds / simulation.time_step))
    return np.mean(simulation.velocities, axis=0)


@pytest.mark.parametrize("precision", ["double", "mixed", "single"])
@pytest.mark.parametrize("accuracy, bound", [("preview", 0.02), ("production", 2e-4), ("accurate", 2e-5)])
@pytest.mark.parametrize("a", [0.5, 5.0])
def test_free_fall(accuracy, bound, precision, a):
    """From rest v' = g - a v gives v = (1 - exp(-a t)) g / a."""
    v = falling_velocity(a, accuracy=accuracy, precision=precision)
    assert v[2] == pytest.approx(-(1.0 - math.exp(-a)) * G / a, rel=bound)
    assert np.abs(v[:2]).max() < 1e-4


@pytest.mark.parametrize("accuracy", ["paper", "preview", "production"])
@pytest.mark.filterwarnings("ignore::cama.PlausibilityWarning")
def test_strong_damping_is_stable(accuracy):
    """At a = 1e4 1/s, far above one over the time step, the sheet sinks at g / a."""
    assert falling_velocity(1e4, accuracy=accuracy)[2] == pytest.approx(-G / 1e4, rel=1e-3)


@pytest.mark.parametrize("accuracy, bound", [("preview", 0.02), ("production", 5e-4)])
def test_moving_air_takes_cloth_along(accuracy, bound):
    """Damping acts on the velocity relative to the air, whether or not this has a density."""
    v = falling_velocity(3.0, wind=(2.0, -1.0, 0.5), accuracy=accuracy)
    share = 1.0 - math.exp(-3.0)
    assert v == pytest.approx([2.0 * share, -share, (0.5 - G / 3.0) * share], rel=bound)


def end_of_strip(strip, length, pinned_rows, seconds, time_step, gravity=(0, 0, -G), shape_of=None):
    """Returns where the free end of a strip is across its plane after each step, m. It hangs along -z from rows that
    are pinned; `shape_of` gives its displacement along y at the start from the distance to the pinned end."""
    cells = 20
    scene = cama.Scene(contact=False, gravity=gravity)
    x, s = np.meshgrid([0.0, 0.02, 0.04], np.linspace(0.0, length, cells + 1))
    rest = np.stack([x.ravel(), s.ravel()], axis=1)
    rows = np.arange(3 * cells).reshape(cells, 3)[:, :2]
    a, b, c, d = (rows.ravel() + k for k in (0, 1, 3, 4))
    faces = np.concatenate([np.stack([a, b, d], axis=1), np.stack([a, d, c], axis=1)])
    start = np.stack([rest[:, 0], shape_of(rest[:, 1]), -rest[:, 1]], axis=1)
    scene.add_cloth(start, faces, material=strip, material_vertices=rest, name="strip")
    scene.pin("strip", list(range(3 * pinned_rows)))
    simulation = cama.Simulation(scene, backend="cpu", time_step=time_step, tolerance=1e-6, precision="double")
    path = []
    for _ in range(round(seconds / time_step)):
        simulation.step()
        path.append(simulation.positions[-3:, 1].mean())
    return np.array(path)


def decrement(path):
    """Returns the mean logarithmic decrement from peak to peak, and the mean number of samples between them."""
    peaks = [i for i in range(1, len(path) - 1) if path[i - 1] < path[i] >= path[i + 1] and path[i] > 0.0]
    assert len(peaks) > 3
    return math.log(path[peaks[0]] / path[peaks[-1]]) / (len(peaks) - 1), (peaks[-1] - peaks[0]) / (len(peaks) - 1)


def test_hanging_strip_loses_by_mass_damping():
    """Each swing of frequency f loses the logarithmic decrement a / (2 f)."""
    step, a = 1 / 240, 1.0

    def swing(mass_damping):
        path = end_of_strip(material(mass_damping), 0.5, 1, 6.0, step, shape_of=lambda s: 0.02 * s)
        return decrement(path)

    (own, _), (damped, period) = swing(0.0), swing(a)
    assert damped - own == pytest.approx(a * period * step / 2.0, rel=0.03)
    assert own < 0.02


def test_vibrating_strip_loses_by_stiffness_damping():
    """A clamped strip without gravity, bent as its first mode, loses pi c omega in each vibration."""
    step, c = 1 / 1000, 2e-3

    def vibrate(damping):
        strip = material(damping=damping, bending=8e-3)
        path = end_of_strip(strip, 0.2, 2, 3.0, step, gravity=(0, 0, 0), shape_of=lambda s: 0.1 * s**2)
        return decrement(path)

    (own, _), (damped, period) = vibrate(0.0), vibrate(c)
    assert damped - own == pytest.approx(2.0 * math.pi**2 * c / (period * step), rel=0.05)
