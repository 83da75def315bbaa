# SPDX-License-Identifier: Apache-2.0
"""Measures of motion: position errors, energy, momentum, residual of the equations, friction angle."""

import math
from dataclasses import dataclass

import numpy as np

from ..arrays import number, reals
from ..errors import ArrayError, SceneError
from ..material import Material
from ..options import level_time_step
from ..scene import Scene
from ..simulation import Simulation


@dataclass
class PositionError:
    """How far vertices are from where they should be."""

    rms: float  #: mass-weighted root mean square, m
    largest: float  #: m
    rms_edges: float  #: the same in mean edge lengths
    largest_edges: float


def position_error(positions, expected, masses, edge):
    """sqrt(sum m |x - x*|^2 / sum m) and max |x - x*|; a PositionError.

    positions, expected: [n, 3] m.  masses: [n] kg.  edge: mean edge length, m. Throws ArrayError.
    """
    positions = reals("position_error: positions", positions, (None, 3))
    expected = reals("position_error: expected", expected, positions.shape)
    masses = reals("position_error: masses", masses, (len(positions),))
    edge = number("position_error: edge", edge)
    if not edge > 0 or not masses.sum() > 0:
        raise ArrayError(f"position_error: edge {edge} and the sum of masses {masses.sum()} must be greater than 0")
    square = ((positions - expected) ** 2).sum(axis=1)
    rms, largest = math.sqrt(masses @ square / masses.sum()), math.sqrt(square.max())
    return PositionError(rms, largest, rms / edge, largest / edge)


def momentum(velocities, masses):
    """[3] kg m/s, from velocities [n, 3] m/s and masses [n] kg."""
    return masses @ velocities


def angular_momentum(positions, velocities, masses, about=(0.0, 0.0, 0.0)):
    """[3] kg m^2/s about a point [3] m."""
    return masses @ np.cross(positions - np.asarray(about, float), velocities)


def residual_speed(velocities, masses):
    """sqrt(2 kinetic energy / mass), m/s: what is left of motion where cloth should be at rest."""
    return math.sqrt(masses @ (velocities**2).sum(axis=1) / masses.sum())


@dataclass
class Drift:
    """How conserved quantities of a run changed, per second of simulated time."""

    energy: float  #: of kinetic + stretching + bending + gravity, W; negative: lost
    energy_relative: float  #: the same over the largest kinetic energy of the run, 1/s
    momentum: float  #: length of the change that gravity does not explain, N
    angular_momentum: float  #: the same about the centre of mass, N m


def drift(scene, seconds, **options):
    """Drift of energy, momentum and angular momentum of a run from the scene's start.

    Says something about the integrator where nothing does work on the cloth or pushes it: no wind, obstacles that rest, for momentum no pins
    and no contact either. options: as of Simulation. Returns a Drift. Throws ArrayError and what Simulation throws.
    """
    seconds = number("drift: seconds", seconds)
    simulation = Simulation(scene, **options)
    count, masses, gravity = simulation.cloth_vertex_count, simulation.masses, np.array(simulation.scene.gravity)

    def now():
        x, v = simulation.positions[:count], simulation.velocities[:count]
        energy = simulation.energy()
        return (
            sum(energy.values()),
            energy["kinetic"],
            momentum(v, masses),
            angular_momentum(x, v, masses, masses @ x / masses.sum()),
        )

    first = last = now()
    largest = first[1]
    while simulation.time < seconds * (1 - 1e-9):
        simulation.step()
        last = now()
        largest = max(largest, last[1])
    if not simulation.time > 0:
        raise ArrayError(f"drift: seconds is {seconds}, not greater than 0")
    span = simulation.time
    power = (last[0] - first[0]) / span
    push = (last[2] - first[2]) / span - masses.sum() * gravity
    return Drift(
        power,
        power / largest if largest > 0 else 0.0,
        float(np.linalg.norm(push)),
        float(np.linalg.norm(last[3] - first[3]) / span),
    )


def with_time_step(scene, time_step):
    """A copy of a Scene with another time step, s."""
    changed = (scene if isinstance(scene, Scene) else Scene.load(scene)).copy()
    changed.time_step = number("time_step", time_step)
    return changed


def paper_step(scene):
    """The time step of a Scene at the level `paper`, s: its own, without one 1/200 or as whole steps fill a frame."""
    return level_time_step("paper", scene)


def accelerations(scene, positions, velocities, instant=1e-9, **options):
    """f(x, v) / m of every cloth vertex [n, 3] m/s^2 in a state [n, 3] m, [n, 3] m/s: from one step of `instant` seconds in double precision.

    Obstacles and pins are where the scene starts; held vertices and impacts follow their constraints, not forces. The error grows with
    `instant` times stiffness times speed, and rounding with 1e-16 |v| / instant. Throws what Simulation throws.
    """
    forced = {
        "precision": "double",
        "tolerance": 1e-12,
        "intersections": "exempt",
        "time_step": instant,
        "integrator": "backward_euler",
        "newton_iterations": 1,
    }
    options = {**options, **forced}
    probe = Simulation(with_time_step(scene, instant), **options)
    velocities = reals("accelerations: velocities", velocities, (probe.cloth_vertex_count, 3))
    probe.set_state(positions, velocities)
    probe.step()
    return (probe.velocities[: len(velocities)] - velocities) / probe.time


def nonlinear_residual(scene, before, positions, velocities, time_step, masses, instant=1e-9, **options):
    """|M (v' - v) / dt - f(x', v')| / |M g| over vertices that are not pinned: how well a step solved the implicit equations.

    before: velocities v [n, 3] m/s at its start; positions x', velocities v' at its end; masses [n] kg. Forces come from `accelerations`:
    for scenes whose obstacles and pins rest. |M g| is 9.81 m/s^2 times the mass norm without gravity. Throws ArrayError, SceneError.
    """
    scene = scene if isinstance(scene, Scene) else Scene.load(scene)
    before = reals("nonlinear_residual: before", before, (None, 3))
    velocities = reals("nonlinear_residual: velocities", velocities, before.shape)
    masses = reals("nonlinear_residual: masses", masses, (len(before),))
    free = ~pinned(scene)
    force = accelerations(scene, positions, velocities, instant, **options)
    gravity = np.linalg.norm(scene.gravity) or 9.81
    left = masses[:, None] * ((velocities - before) / number("time_step", time_step) - force)
    return float(np.linalg.norm(left[free]) / (gravity * np.linalg.norm(masses[free]))) if free.any() else 0.0


def pinned(scene):
    """[cloth vertices] bool: which a pin names, whatever its release time."""
    counts = [len(cloth.vertices) for cloth in scene.cloths]
    start = np.concatenate([[0], np.cumsum(counts)]).astype(int)
    result = np.zeros(start[-1], bool)
    for pin in scene.pins:
        result[start[pin["cloth"]] + np.asarray(pin["vertices"], int)] = True
    return result


def rests(simulation, start):
    """Whether obstacle vertices are where they were in `start` [vertices, 3] m, and pinned ones too: nothing that the scene prescribes has moved."""
    count = simulation.cloth_vertex_count
    now, held = simulation.positions, pinned(simulation.scene)
    return bool(np.array_equal(now[count:], start[count:]) and np.array_equal(now[:count][held], start[:count][held]))


def friction_angle(
    friction=0.3, static_friction=None, seconds=0.4, width=0.05, size=0.2, cells=3, material="cotton", **options
):
    """Angle of a slope, degrees, at which a sheet on an exact plane starts to slide; exact is atan(static friction, or friction without).

    Bisection down to `width` degrees. A sheet slides if after `seconds` it is faster than half of what gravity beyond friction gives it,
    g (sin a - mu cos a) t, one `width` past the exact angle. options: as of Simulation, and time_step. Throws ArrayError, SceneError.
    """
    friction = number("friction_angle: friction", friction)
    holds = friction if static_friction is None else number("friction_angle: static_friction", static_friction)
    width = number("friction_angle: width", width)
    if not holds >= friction >= 0 or not width > 0:
        raise ArrayError(
            f"friction_angle: friction {friction}, static_friction {holds} and width {width} do not fit together"
        )
    exact = math.degrees(math.atan(holds))
    low, high = max(0.0, exact - 8), min(89.0, exact + 8)
    limit = (
        0.5
        * seconds
        * 9.81
        * (math.sin(math.radians(exact + width)) - friction * math.cos(math.radians(exact + width)))
    )
    if slides(high, friction, static_friction, seconds, limit, size, cells, material, options) == 0:
        raise SceneError(
            f"friction_angle: the sheet still sticks at {high:.1f} degrees, {high - exact:.1f} past the exact angle"
        )
    while high - low > width:
        middle = (low + high) / 2
        if slides(middle, friction, static_friction, seconds, limit, size, cells, material, options):
            high = middle
        else:
            low = middle
    return (low + high) / 2


def slides(angle, friction, static_friction, seconds, limit, size, cells, material, options):
    """Speed of a sheet down a slope of `angle` degrees after `seconds` where it is beyond `limit`, m/s, else 0."""
    options = dict(options)
    a = math.radians(angle)
    scene = Scene(
        gravity=(9.81 * math.sin(a), 0, -9.81 * math.cos(a)),
        time_step=options.pop("time_step", 1 / 200),
        thickness=1e-3,
        stiffness=1e6,
    )
    material = Material.of(material)
    depth = material.density * 9.81 * math.cos(a) / 1e6  # where penalty and weight are in balance
    scene.add_obstacle(shape={"shape": {"plane": {}}}, friction=friction, static_friction=static_friction, name="slope")
    scene.add_cloth(
        shape={"grid": {"size": [size, size], "cells": [cells, cells]}},
        material=material,
        translate=(0, 0, 1e-3 - depth),
        name="sheet",
    )
    simulation = Simulation(scene, **options)
    while simulation.time < seconds * (1 - 1e-9):
        simulation.step()
    speed = (
        momentum(simulation.velocities[: simulation.cloth_vertex_count], simulation.masses)[0] / simulation.masses.sum()
    )
    return float(speed) if speed > limit else 0.0
