# SPDX-License-Identifier: Apache-2.0
"""A converged reference of a scene on its own mesh, and the errors of other settings over windows that start from its states."""

import math
from dataclasses import dataclass, field
from fractions import Fraction

import numpy as np

from ..arrays import number, reals
from ..errors import ArrayError, SolverError
from ..scene import Scene
from ..simulation import Simulation
from . import surface
from .motion import angular_momentum, momentum, paper_step, position_error, with_time_step


@dataclass
class Reference:
    """States at the starts of windows and where the cloth is at their ends."""

    window: float  #: length of a window, s
    starts: np.ndarray  #: [windows] s
    positions: np.ndarray = field(repr=False)  #: [windows, n, 3] m, at the starts
    velocities: np.ndarray = field(repr=False)  #: [windows, n, 3] m/s
    targets: np.ndarray = field(
        repr=False
    )  #: [windows, n, 3] m, at the ends, extrapolated to no time step where that converges
    ends: np.ndarray = field(repr=False)  #: [windows, n, 3] m, at the ends with `time_step`
    end_velocities: np.ndarray = field(repr=False)  #: [windows, n, 3] m/s
    energies: np.ndarray = field(repr=False)  #: [windows, 4] J at the ends: kinetic, stretching, bending, gravity
    masses: np.ndarray = field(repr=False)  #: [n] kg
    faces: np.ndarray = field(repr=False)  #: [triangles, 3] of the cloth
    edge: float  #: mean edge length of the start, m
    time_step: float  #: s
    uncertainty: np.ndarray  #: [windows] rms m that the targets may be off themselves
    uncertainty_largest: np.ndarray  #: [windows] m, of a single vertex
    order: float  #: of convergence that was seen in the time step
    converged: (
        bool  #: halving the time step shrinks differences by a quarter, or the uncertainty is below 1 % of an edge
    )

    def save(self, path):
        """Writes a NumPy archive, .npz."""
        np.savez_compressed(path, **self.__dict__)

    @classmethod
    def load(cls, path):
        """Reads what `save` wrote."""
        with np.load(path) as stored:
            return cls(**{name: stored[name] if stored[name].ndim else stored[name].item() for name in stored.files})


def steps_of(span, time_step, what):
    """Whole number of steps in `span`; throws ArrayError if there is none."""
    count = round(span / time_step)
    if count < 1 or abs(count * time_step - span) > 1e-9 * span:
        near = Fraction(span / max(1, count)).limit_denominator(100000)
        raise ArrayError(
            f"{what}: {span:g} s is not a whole number of steps of {time_step:g} s; a step of {near} s would do"
        )
    return count


def best_options(given):
    """Options of a reference: the level `reference` in double precision, and what is given."""
    return {"accuracy": "reference", "precision": "double", **given}


def reach(simulation, time):
    """Steps until `time`; throws ArrayError if that is not a whole number of steps away."""
    left = time - simulation.time
    if left > 1e-9 * max(time, 1e-9):
        simulation.step(steps_of(left, simulation.time_step, f"time {time:g} s"))


def start_times(window, count, first=0, stride=1):
    """[count] s: every `stride`-th multiple of `window` from number `first`."""
    return window * (first + stride * np.arange(count))


def _scene_of(scene, time_step):
    scene = scene if isinstance(scene, Scene) else Scene.load(scene)
    return with_time_step(scene, time_step) if time_step else scene


def _windows(scene, options, starts, window, at_start, at_end):
    """Runs `scene`; calls at_start(i, simulation) where windows start and at_end(i, simulation, positions, velocities) where they end."""
    simulation = Simulation(scene, **options)
    count = simulation.cloth_vertex_count
    for i, start in enumerate(starts):
        reach(simulation, start)
        at_start(i, simulation)
        reach(simulation, start + window)
        at_end(i, simulation, simulation.positions[:count], simulation.velocities[:count])
    return simulation


def reference(scene, window=0.05, windows=10, first=0, stride=1, time_step=None, starts=None, **options):
    """A converged run of a scene on its own mesh, to measure other settings against; a Reference.

    window: s between a start state and its target.  windows, first, stride: they start at every `stride`-th multiple of `window` from number
    `first`, or at `starts` [k] s, ascending and apart by `window` at least.  time_step: s, default: 1/32 of that of the level `paper`, so that it divides
    `window`.  options: as of Simulation, on top of the accuracy `reference` in double precision.

    From every start state the window is run with the time step, twice and four times it. Richardson: where the extrapolations to no time
    step from each pair agree better than the runs themselves, the target is the finer extrapolation and the uncertainty their difference; else
    the target is the finest run and the uncertainty the larger difference between runs (Roache 1998). `converged` says whether
    differences shrink by a quarter at least, or the uncertainty is below a hundredth of an edge, in the rms over the windows. Throws ArrayError and what Simulation throws.
    """
    scene = _scene_of(scene, None)
    window = number("reference: window", window)
    starts = (
        start_times(window, int(windows), int(first), int(stride))
        if starts is None
        else reals("reference: starts", starts, (None,))
    )
    if not window > 0 or not len(starts) or starts[0] < 0 or (np.diff(starts) < window * (1 - 1e-9)).any():
        raise ArrayError(
            f"reference: window {window} and starts {starts.tolist()}: give at least one, ascending, apart by the window"
        )
    fine = (
        number("reference: time_step", time_step)
        if time_step
        else window / (4 * math.ceil(8 * window / paper_step(scene)))
    )
    steps_of(window, 4 * fine, "reference: window, with four times the time step")
    options = best_options(options)

    def run(factor, at_start):
        step = factor * fine
        own = dict(options, time_step=step)
        return _windows(
            with_time_step(scene, step),
            own,
            starts,
            window,
            at_start,
            lambda i, s, *state: at_end(factor, i, s, *state),
        )

    x, v, ends, end_velocities, energies = [], [], {1: [], 2: [], 4: []}, [], []

    def at_end(factor, i, s, positions, velocities):
        ends[factor].append(positions)
        if factor == 1:
            end_velocities.append(velocities)
            energies.append(list(s.energy().values()))

    def keep(i, s):
        count = s.cloth_vertex_count
        x.append(s.positions[:count])
        v.append(s.velocities[:count])
        s.set_state(x[-1], v[-1])  # a window starts without history here too

    simulation = run(1, keep)
    for factor in (2, 4):
        run(factor, lambda i, s: s.set_state(x[i], v[i]))
    x, v, end_velocities, energies = (np.array(rows) for rows in (x, v, end_velocities, energies))
    ends = {factor: np.array(rows) for factor, rows in ends.items()}
    masses, count = simulation.masses, simulation.cloth_triangle_count
    faces = simulation.faces[:count]
    found = richardson(ends, masses)
    edge = surface.edge_length(np.concatenate([c.vertices for c in scene.cloths]), faces)
    converged = found["shrinks"] or math.sqrt((found["uncertainty"] ** 2).mean()) < 0.01 * edge
    return Reference(
        window,
        starts,
        x,
        v,
        found["targets"],
        ends[1],
        end_velocities,
        energies,
        masses,
        faces,
        edge,
        fine,
        found["uncertainty"],
        found["largest"],
        found["order"],
        bool(converged),
    )


def _rms(difference, masses):
    return np.sqrt((difference**2).sum(axis=2) @ masses / masses.sum())


def richardson(ends, masses):
    """Targets, their uncertainty and the order of convergence from runs with 1, 2 and 4 times a time step: {factor: [windows, n, 3] m}."""
    near, far = ends[1] - ends[2], ends[2] - ends[4]
    one, two = _rms(near, masses), _rms(far, masses)
    total_one, total_two = math.sqrt((one**2).mean()), math.sqrt((two**2).mean())
    scale = max(np.abs(ends[1]).max(), 1e-3)
    still = total_one <= 1e-9 * scale
    order = 0.0 if still or not total_two > 0 else math.log2(total_two / total_one)
    gain = 2 ** (2 if order > 1.5 else 1) - 1
    better, coarse = ends[1] + near / gain, ends[2] + far / gain
    apart = _rms(better - coarse, masses)
    use = apart < one
    targets = np.where(use[:, None, None], better, ends[1])
    single = np.where(use, _largest(better - coarse), np.maximum(_largest(near), _largest(far)))
    return {
        "targets": targets,
        "uncertainty": np.where(use, apart, np.maximum(one, two)),
        "largest": single,
        "order": order,
        "shrinks": bool(still or total_one < 0.75 * total_two),
    }


def _largest(difference):
    return np.sqrt((difference**2).sum(axis=2)).max(axis=1)


@dataclass
class RestartError:
    """What settings get wrong over a window, from the reference's states."""

    steps: int  #: in a window
    time_step: float  #: s
    rms: np.ndarray  #: [windows] mass-weighted rms, m
    largest: np.ndarray  #: [windows] m
    rms_all: float  #: root mean square over the windows, m
    rms_edges: float  #: the same in mean edge lengths
    largest_all: float  #: largest over the windows, m
    largest_edges: float
    energy: float  #: rms over the windows of the error of kinetic + stretching + bending + gravity energy, J
    energy_relative: float  #: the same over the reference's largest kinetic energy
    momentum: float  #: rms over the windows, kg m/s
    momentum_relative: float  #: the same over sqrt(2 m E_kin) with the reference's largest kinetic energy
    angular_momentum: float  #: about the origin, kg m^2/s
    uncertainty: float  #: rms of the reference's own over the windows, m
    at_floor: bool  #: the error is below three times that: the reference cannot tell it


def restart_error(reference, scene, time_step=None, steps=None, **options):
    """Errors after a window from the reference's start states, compared at the same time; a RestartError.

    scene: the reference's, same mesh.  time_step: s, default: what scene and options say; it must divide the window and its start times.
    steps: checks that a window has so many (a Reference with window = k dt gives the error over k steps).  options: as of Simulation.
    Energies and momenta are compared with the reference at the same time, so that pins, wind and bodies may do work.
    Throws ArrayError for another mesh or a time step that does not fit, and what Simulation throws.
    """
    scene = _scene_of(scene, time_step)
    if time_step:
        options["time_step"] = time_step
    if sum(len(cloth.vertices) for cloth in scene.cloths) != len(reference.masses):
        raise ArrayError(
            f"restart_error: the scene's cloth has {scene.vertex_count} vertices, the reference {len(reference.masses)}; "
            "use surface_distance between different meshes"
        )
    r, rows = reference, []

    def record(i, s, x, v):
        if not np.isfinite(x).all():
            raise SolverError(f"restart_error: window {i}: positions are not finite")
        error = position_error(x, r.targets[i], r.masses, r.edge)
        rows.append(
            (
                error.rms,
                error.largest,
                sum(s.energy().values()) - r.energies[i].sum(),
                np.linalg.norm(momentum(v, r.masses) - momentum(r.end_velocities[i], r.masses)),
                np.linalg.norm(
                    angular_momentum(x, v, r.masses) - angular_momentum(r.ends[i], r.end_velocities[i], r.masses)
                ),
            )
        )

    simulation = _windows(
        scene, options, r.starts, r.window, lambda i, s: s.set_state(r.positions[i], r.velocities[i]), record
    )
    length = simulation.time_step
    count = steps_of(r.window, length, "restart_error: window")
    if steps is not None and steps != count:
        raise ArrayError(f"restart_error: steps is {steps}, the reference's window has {count} of {length:g} s")
    table = np.array(rows)
    rms, _, energy, push, turn = (math.sqrt((table[:, k] ** 2).mean()) for k in range(5))
    kinetic, mass = float(r.energies[:, 0].max()), float(r.masses.sum())
    largest = float(table[:, 1].max())
    doubt = math.sqrt((r.uncertainty**2).mean())
    return RestartError(
        count,
        length,
        table[:, 0],
        table[:, 1],
        rms,
        rms / r.edge,
        largest,
        largest / r.edge,
        energy,
        energy / kinetic if kinetic > 0 else 0.0,
        push,
        push / math.sqrt(2 * mass * kinetic) if kinetic > 0 else 0.0,
        turn,
        doubt,
        bool(rms < 3 * doubt),
    )
