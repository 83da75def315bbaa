# SPDX-License-Identifier: Apache-2.0
"""What a check runs on, and what it saw."""

import time
from dataclasses import dataclass

import numpy as np

import cama

from . import judge


class Wrong(Exception):
    """What was seen is not what was expected."""


@dataclass
class Seen:
    """Figures of one check, over all of its simulations."""

    steps: int = 0
    intersections: int = 0  #: most in a step, by any judge
    strain: float = 0.0  #: largest
    peak: float = 0.0  #: kinetic energy, J
    last: float = 0.0  #: the same at the end of the last simulation, J
    note: str = ""  #: what else is worth knowing
    error: str = ""  #: class and text of an error of cama, expected or not

    @property
    def energy_ratio(self):
        """Kinetic energy at the end over its peak; None if nothing moved."""
        return self.last / self.peak if self.peak > 0 else None


class Probe:
    """Makes simulations on one backend in one precision, and watches every step of them."""

    def __init__(self, backend="cpu", precision="double", accuracy="production", threads=1):
        self.backend, self.precision, self.accuracy, self.threads = backend, precision, accuracy, threads
        self.seen = Seen()

    @property
    def plain(self):
        """Whether the level takes the scene's time step."""
        return self.accuracy in ("production", "paper")

    @property
    def certified(self):
        """Whether the level ends its steps with the certified commit."""
        return self.accuracy != "paper"

    def per_precision(self, double, mixed, single):
        """The bound of this precision."""
        return {"double": double, "mixed": mixed, "single": single}[self.precision]

    def options(self, scene, **options):
        """Arguments of a cama.Simulation beside the scene. The scene's own time step holds at every level."""
        given = dict(backend=self.backend, precision=self.precision, accuracy=self.accuracy, threads=self.threads)
        if not self.plain:
            given["time_step"] = scene.time_step
        return {**given, **options}

    def simulation(self, scene, **options):
        """A cama.Simulation."""
        return cama.Simulation(scene, **self.options(scene, **options))

    def run(self, scene, steps, bound=1e9, clean=True, judges=("audit", "ipctk"), **options):
        """Computes steps of a scene, or of a simulation, and watches each.

        clean: intersections are wrong. judges: of them. Raises Wrong; cama.Error where a step does.
        """
        simulation = self.simulation(scene, **options) if isinstance(scene, cama.Scene) else scene
        judges = [(who, count) for who, count in judge.referees(simulation) if who in judges]
        guarded = self.certified and simulation.scene._core.contact.enabled
        for _ in range(steps):
            simulation.step()
            self.watch(simulation, judges, bound, clean and guarded)
        return simulation

    def watch(self, simulation, judges=None, bound=1e9, clean=True):
        """Looks at the state after a step. judges: as of judge.referees, None: all. bound: of cloth coordinates, m.
        clean: intersections are wrong.
        """
        seen, step = self.seen, simulation.step_count
        seen.steps += 1
        bad = judge.finite(simulation)
        if bad:
            raise Wrong(f"step {step}: not finite: {', '.join(bad)}")
        positions = simulation.positions
        judges = judge.referees(simulation) if judges is None else judges
        counts = {who: count(positions) for who, count in judges}
        seen.intersections = max([seen.intersections, *counts.values()])
        seen.strain = max(seen.strain, simulation.max_strain)
        seen.last = simulation.energy()["kinetic"]
        seen.peak = max(seen.peak, seen.last)
        if clean and any(counts.values()):
            raise Wrong(f"step {step}: intersections: " + ", ".join(f"{n} by {who}" for who, n in counts.items()))
        farthest = np.abs(positions[: simulation.cloth_vertex_count]).max()
        self.require(farthest <= bound, f"step {step}: a vertex is {farthest:.3g} m away")

    def scene_case(self, case, resolution, **build):
        """Runs a case of scene_cases from seed 1 to its end. Raises Wrong; cama.Error where the case expects one."""
        scene = case.build(resolution, 1, **build)
        run = judge.run(scene, bound=case.bound, **self.options(scene))
        seen = self.seen
        seen.steps, seen.strain = len(run.reports), run.strain
        seen.intersections = max([0, *run.audit, *run.referee])
        seen.peak, seen.last = max(run.kinetic, default=0.0), run.kinetic[-1] if run.kinetic else 0.0
        self.require(not run.problems, "; ".join(run.problems))
        if run.failure is not None:
            raise run.failure
        complaints = case.expect(run)
        self.require(not complaints, "; ".join(complaints))

    def require(self, holds, text):
        """Raises Wrong unless it holds."""
        if not holds:
            raise Wrong(text)

    def near(self, seen, expected, bound, what):
        """Raises Wrong unless every entry is within `bound` of what is expected. Returns the largest difference."""
        off = float(np.abs(np.asarray(seen, float) - expected).max())
        self.require(off <= bound, f"{what}: off by {off:.3g}, more than {bound:.3g}")
        return off

    def refused(self, error, words, attempt, what=""):
        """Raises Wrong unless the attempt raises this error with the words in its text."""
        try:
            attempt()
        except cama.Error as problem:
            name, text = type(problem).__name__, str(problem)
            self.seen.error = f"{name}: {text}"
            self.require(
                isinstance(problem, error) and all(w in text for w in words),
                f"{what}: expected {error.__name__} with {words}, got {name}: {text}",
            )
            return
        raise Wrong(f"{what}: expected {error.__name__}, nothing was refused")

    def timed(self, function, *arguments):
        """(seconds, result)."""
        begin = time.perf_counter()
        result = function(*arguments)
        return time.perf_counter() - begin, result
