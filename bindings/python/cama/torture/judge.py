# SPDX-License-Identifier: Apache-2.0
"""Runs a scene and judges every step: intersections by cama's exact audit and, where it is installed, by ipctk; NaN, bounds."""

import time
from dataclasses import dataclass, field

import numpy as np

import cama

try:
    import ipctk
except ImportError:  # the exact audit judges alone
    ipctk = None

JUDGES = "the exact audit and ipctk" if ipctk else "the exact audit alone: ipctk is not installed"


class Referee:
    """ipctk's view of one simulation: obstacle against obstacle and neighbours left out."""

    def __init__(self, simulation):
        """Throws cama.Error without ipctk."""
        if ipctk is None:
            raise cama.Error("ipctk is not installed")
        self.faces = np.asfortranarray(simulation.faces, np.int32)
        pairs = np.concatenate([self.faces[:, [0, 1]], self.faces[:, [1, 2]], self.faces[:, [2, 0]]])
        self.edges = np.asfortranarray(np.unique(np.sort(pairs, axis=1), axis=0), np.int32)
        self.first_obstacle = simulation.cloth_vertex_count
        self.mesh = ipctk.CollisionMesh(np.asfortranarray(simulation.positions), self.edges, self.faces)

    def count(self, positions):
        """Edges through faces."""
        positions = np.asfortranarray(positions)
        return self._count(positions) if ipctk.has_intersections(self.mesh, positions) else 0

    def _count(self, positions):
        low, high = positions.min(axis=0), positions.max(axis=0)
        tree = ipctk.LBVH()
        tree.build(positions, self.edges, self.faces, 1e-9 * np.linalg.norm(high - low))
        found = 0
        for pair in tree.detect_edge_face_candidates():
            e, f = self.edges[pair.edge_id], self.faces[pair.face_id]
            if set(e) & set(f) or (min(e) >= self.first_obstacle and min(f) >= self.first_obstacle):
                continue
            found += ipctk.is_edge_intersecting_triangle(*positions[e], *positions[f])
        return found


@dataclass
class Run:
    """What happened, step by step."""

    scene: cama.Scene
    simulation: cama.Simulation
    start: np.ndarray  #: [vertices, 3] m
    reports: list = field(default_factory=list)
    kinetic: list = field(default_factory=list)  #: J
    audit: list = field(default_factory=list)  #: intersections by cama, -1 where not asked
    referee: list = field(default_factory=list)  #: by ipctk, empty without it
    strain: float = 0.0  #: largest of all steps
    kept: list = field(default_factory=list)  #: (time, positions) now and then
    error: str = ""  #: class and text of what ended it
    failure: cama.Error = None  #: the same, itself
    problems: list = field(default_factory=list)
    seconds: float = 0.0

    @property
    def positions(self):
        """[vertices, 3] now, m."""
        return self.simulation.positions

    def cloth(self, k, positions=None):
        """Vertices [n, 3] now and faces of one cloth."""
        first, last = self.simulation.cloth_ranges[k]
        return (self.positions if positions is None else positions)[first:last], self.scene.cloths[k].faces

    def total(self, name):
        """Sum over steps of a field of the report."""
        return sum(r[name] for r in self.reports)


def referees(simulation):
    """[(name, positions -> count)] of who judges: the exact audit of the state now, and ipctk where it is installed."""
    judges = [("audit", lambda positions: simulation.count_intersections())]
    return judges + ([("ipctk", Referee(simulation).count)] if ipctk else [])


def finite(simulation):
    """Complaints about arrays and numbers that a user can get and that are not finite."""
    bad = [
        name
        for name, array in (("positions", simulation.positions), ("velocities", simulation.velocities))
        if not np.isfinite(array).all()
    ]
    contacts = simulation.contacts
    bad += [
        f"contacts[{name!r}]" for name in ("weights", "normal", "distance") if not np.isfinite(contacts[name]).all()
    ]
    bad += [f"report[{name!r}]" for name, value in simulation.report.items() if not np.isfinite(value)]
    bad += [f"energy()[{name!r}]" for name, value in simulation.energy().items() if not np.isfinite(value)]
    if not np.isfinite(simulation.max_strain):
        bad.append("max_strain")
    if not simulation.min_gap >= 0:  # inf: no pairs
        bad.append("min_gap")
    return bad


def run(scene, steps=None, bound=20.0, keep=0, judge_every=1, backend="cpu", threads=1, stop=True, **options):
    """Computes the scene's steps. keep: remember positions every so many steps.  stop: at the first intersection.

    A problem is a line of text in `problems`; an error of a step ends the run and is kept in `error`.
    """
    simulation = cama.Simulation(scene, backend=backend, threads=threads, **options)
    judges = referees(simulation)
    result = Run(scene, simulation, simulation.positions)
    result.problems += [
        f"start: {who} sees {n} intersections" for who, count in judges for n in [count(result.start)] if n
    ]
    begin = time.perf_counter()
    for step in range(1, (scene.frames if steps is None else steps) + 1):
        try:
            simulation.step()
        except cama.Error as problem:
            result.error, result.failure = f"{type(problem).__name__}: {problem}", problem
            break
        _look(result, judges, step, bound, step % judge_every == 0)
        if keep and step % keep == 0:
            result.kept.append((simulation.time, result.positions))
        if stop and result.problems:
            break
    result.seconds = time.perf_counter() - begin
    return result


def _look(result, judges, step, bound, judge):
    simulation, positions = result.simulation, result.positions
    result.reports.append(simulation.report)
    result.kinetic.append(simulation.energy()["kinetic"])
    bad = finite(simulation)
    if bad:
        result.problems.append(f"step {step}: not finite: {', '.join(bad)}")
        return
    result.strain = max(result.strain, simulation.max_strain)
    farthest = np.abs(positions[: simulation.cloth_vertex_count]).max()
    if farthest > bound:
        result.problems.append(f"step {step}: a vertex is {farthest:.3g} m away")
    if judge:
        counts = [count(positions) for _, count in judges]
        result.audit.append(counts[0])
        result.referee += counts[1:]
        if any(counts):
            result.problems.append(
                f"step {step}: intersections: " + ", ".join(f"{n} by {who}" for (who, _), n in zip(judges, counts))
            )
