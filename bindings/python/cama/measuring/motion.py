# SPDX-License-Identifier: Apache-2.0
"""Measures of motion: position errors, energy, momentum, residual of the equations, friction angle."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import number, reals
from ..errors import ArrayError, SceneError
from ..material import Material
from ..options import level_time_step
from ..scene import Scene
from ..simulation import Simulation
from ..types import ArrayLike, Booleans, Description, PathLike, Reals, VectorLike

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from .._core import SimulationOptions


@dataclass
class PositionError:
    """Distances of vertices from their expected positions."""

    rms: float  #: mass-weighted root mean square, m
    largest: float  #: m
    rms_edges: float  #: the same in mean edge lengths
    largest_edges: float


def position_error(positions: ArrayLike, expected: ArrayLike, masses: ArrayLike, edge: float) -> PositionError:
    """Returns sqrt(sum m |x - x*|^2 / sum m) and max |x - x*| as a PositionError.

    Args:
        positions: x [n, 3], m.
        expected: x* [n, 3], m.
        masses: m [n], kg.
        edge: Mean edge length, m.

    Raises:
        ArrayError
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


def momentum(velocities: Reals, masses: Reals) -> Reals:
    """Returns the momentum [3], kg m/s, of velocities [n, 3] and masses [n]."""
    return masses @ velocities


def angular_momentum(positions: Reals, velocities: Reals, masses: Reals, about: VectorLike = (0.0, 0.0, 0.0)) -> Reals:
    """Returns the angular momentum [3], kg m^2/s, about a point [3]."""
    return masses @ np.cross(positions - np.asarray(about, float), velocities)


def residual_speed(velocities: Reals, masses: Reals) -> float:
    """Returns sqrt(2 kinetic energy / mass), m/s: the motion that is left where cloth should be at rest."""
    return math.sqrt(masses @ (velocities**2).sum(axis=1) / masses.sum())


@dataclass
class Drift:
    """Changes of conserved quantities per second of simulated time."""

    energy: float  #: of kinetic + stretching + bending + gravity, W; negative: lost
    energy_relative: float  #: the same over the largest kinetic energy of the run, 1/s
    momentum: float  #: length of the change that gravity does not explain, N
    angular_momentum: float  #: the same about the centre of mass, N m


def drift(scene: Scene | PathLike, seconds: float, **options: Unpack[SimulationOptions]) -> Drift:
    """Measures the drift of energy, momentum and angular momentum of a run from the scene's start.

    The numbers tell about the integrator if nothing does work on the cloth: no wind, obstacles at rest; for momentum
    also no pins and no contact.

    Args:
        scene: A Scene, or what `Scene.load` accepts.
        seconds: Simulated time, s.
        options: As of Simulation.

    Raises:
        ArrayError, and what Simulation raises.
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


def with_time_step(scene: Scene | PathLike, time_step: float) -> Scene:
    """Returns a copy of a Scene with another time step, s."""
    changed = (scene if isinstance(scene, Scene) else Scene.load(scene)).copy()
    changed.time_step = number("time_step", time_step)
    return changed


def paper_step(scene: Scene) -> float:
    """Returns the time step of a Scene at the level `paper`, s."""
    return level_time_step("paper", scene)


def accelerations(
    scene: Scene | PathLike,
    positions: ArrayLike,
    velocities: ArrayLike,
    instant: float = 1e-9,
    **options: Unpack[SimulationOptions],
) -> Reals:
    """Returns the accelerations f(x, v) / m [n, 3], m/s^2, of all cloth vertices, from one step of `instant` seconds.

    Obstacles and pins are where the scene starts; held vertices and impacts follow their constraints, not forces. The
    error grows with `instant` times stiffness times speed, and rounding with 1e-16 |v| / instant. Raises what
    Simulation raises.
    """
    given: dict[str, Any] = {
        **options,
        "precision": "double",
        "tolerance": 1e-12,
        "intersections": "exempt",
        "time_step": instant,
        "integrator": "backward_euler",
        "newton_iterations": 1,
    }
    probe = Simulation(with_time_step(scene, instant), **given)
    velocities = reals("accelerations: velocities", velocities, (probe.cloth_vertex_count, 3))
    probe.set_state(positions, velocities)
    probe.step()
    return (probe.velocities[: len(velocities)] - velocities) / probe.time


def nonlinear_residual(
    scene: Scene | PathLike,
    before: ArrayLike,
    positions: ArrayLike,
    velocities: ArrayLike,
    time_step: float,
    masses: ArrayLike,
    instant: float = 1e-9,
    **options: Any,
) -> float:
    """Returns |M (v' - v) / dt - f(x', v')| / |M g| over free vertices: how well a step solved the implicit equations.

    The forces come from `accelerations`, so obstacles and pins must be at rest. Without gravity, |M g| is taken with
    9.81 m/s^2.

    Args:
        scene: A Scene, or what `Scene.load` accepts.
        before: Velocities v at the start of the step [n, 3], m/s.
        positions: Positions x' at its end [n, 3], m.
        velocities: Velocities v' at its end [n, 3], m/s.
        time_step: dt, s.
        masses: Masses [n], kg.
        instant: As for `accelerations`.
        options: As of Simulation.

    Raises:
        ArrayError, SceneError
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


def pinned(scene: Scene) -> Booleans:
    """Returns which cloth vertices a pin holds, whatever its release time [cloth vertices]."""
    counts = [len(cloth.vertices) for cloth in scene.cloths]
    start = np.concatenate([[0], np.cumsum(counts)]).astype(int)
    result = np.zeros(start[-1], bool)
    for pin in scene.pins:
        result[start[pin["cloth"]] + np.asarray(pin["vertices"], int)] = True
    return result


def rests(simulation: Simulation, start: Reals) -> bool:
    """Returns whether obstacle vertices and pinned vertices are where they were in `start` [vertices, 3]."""
    count = simulation.cloth_vertex_count
    now, held = simulation.positions, pinned(simulation.scene)
    return bool(np.array_equal(now[count:], start[count:]) and np.array_equal(now[:count][held], start[:count][held]))


def friction_angle(
    friction: float = 0.3,
    static_friction: float | None = None,
    seconds: float = 0.4,
    width: float = 0.05,
    size: float = 0.2,
    cells: int = 3,
    material: PathLike | Description | Material = "cotton",
    **options: Unpack[SimulationOptions],
) -> float:
    """Measures the angle of a slope, degrees, at which a sheet on an exact plane starts to slide.

    The exact angle is the arc tangent of the static friction. The result is found by bisection. A sheet slides if after
    `seconds` it is faster than half of g (sin a - mu cos a) t, one `width` past the exact angle.

    Args:
        friction: Coulomb coefficient.
        static_friction: The coefficient while cloth sticks; None: equal to `friction`.
        seconds: Simulated time of a run, s.
        width: Width of the last interval, degrees.
        size: Side of the sheet, m.
        cells: Cells along a side.
        material: As for `Scene.add_cloth`.
        options: As of Simulation, and time_step.

    Raises:
        ArrayError, SceneError
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


def slides(
    angle: float,
    friction: float,
    static_friction: float | None,
    seconds: float,
    limit: float,
    size: float,
    cells: int,
    material: PathLike | Description | Material,
    options: dict[str, Any],
) -> float:
    """Returns the speed of a sheet down a slope of `angle` degrees after `seconds`, m/s; 0 below `limit`."""
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
