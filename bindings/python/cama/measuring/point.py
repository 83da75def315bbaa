# SPDX-License-Identifier: Apache-2.0
"""One point of a trade-off: what a run with some settings costs, and what it gets wrong. Runs in a worker."""

import time

import numpy as np

from ..errors import SolverError
from ..io.summary import finite
from ..scene import Scene
from ..simulation import Simulation
from . import motion, surface
from .reference import reference as converged_run
from .reference import restart_error, steps_of

# name: (unit, what it is). Columns of the table, in order; all from measured runs.
MEASURES = {
    "ms_per_second": ("ms", "time per simulated second: median step / time step"),
    "ms_per_second_mean": ("ms", "the same from the mean"),
    "ms_per_step": ("ms", "median over the steps after the warm-up"),
    "ms_per_step_p95": ("ms", "95 % quantile of it"),
    "restart_rms": ("m", "position error after a window from the reference's states, mass-weighted rms"),
    "restart_rms_edges": ("edges", "the same in mean edge lengths"),
    "restart_max_edges": ("edges", "largest over vertices and windows"),
    "energy_error": ("1", "energy against the reference at the ends of windows, over its largest kinetic energy"),
    "momentum_error": ("1", "momentum likewise, over sqrt(2 m E_kin)"),
    "angular_momentum_error": ("kg m^2/s", "angular momentum about the origin likewise"),
    "surface_mean": ("m", "mean distance to the reference's surface in a run from the start, at the last sample"),
    "surface_mean_edges": ("edges", "the same in mean edge lengths of the reference"),
    "hausdorff": ("m", "symmetric Hausdorff distance there"),
    "energy_drift": ("W", "change of energy over the run; work of pins, wind and bodies is in it"),
    "residual": ("1", "largest residual of the linear solves"),
    "nonlinear_residual": ("1", "of the implicit equations in the last step, over |M g|; none where bodies move"),
    "strain_max": ("1", "largest principal strain at the samples"),
    "strain_p999": ("1", "its 99.9 % quantile over the triangles"),
    "strain_error": (
        "1",
        "rms over the triangles and samples of the difference of larger strains to the reference; same mesh only",
    ),
    "area_min": ("1", "smallest area ratio"),
    "area_mean": ("1", "mean area ratio furthest from 1"),
    "min_gap": ("m", "smallest gap at the samples"),
    "intersections": ("1", "at all samples"),
    "lost_motion": ("1", "mean part of a step's motion that the commit cut"),
    "truncated": ("1", "mean part of the vertices whose motion it cut in a step"),
    "residual_speed": ("m/s", "rms speed at the end"),
    "iterations": ("1", "of the linear solve, mean"),
    "contacts": ("1", "largest number in a step"),
    "peak_mib": ("MiB", "device memory"),
}


def measure(task, shared):
    """A dict of MEASURES for a task: kind ("time" or "error"), settings, backend, device, threads, warm_up, limit [s]; shared: texts, reference."""
    settings = dict(task["settings"])
    scene = Scene.parse(shared["texts"][settings.pop("resolution", 0)])
    scene.options = {}
    if settings.get("time_step"):
        scene.time_step = settings["time_step"]
    options = dict(settings, backend=task["backend"], device=task["device"], threads=task["threads"])
    options.setdefault("accuracy", "production")
    reference = shared["reference"]
    result = (
        restart(scene, options, reference) if task["kind"] == "error" else free_run(scene, options, reference, task)
    )
    return finite(result)


def compute_reference(task, shared):
    """The Reference of a task: keywords of `accuracy.reference` but the scene."""
    scene = Scene.parse(shared["texts"][task["resolution"]])
    scene.options = {}
    return converged_run(scene, **task["arguments"])


def restart(scene, options, reference):
    """Errors over windows; none where the mesh is another."""
    if sum(len(cloth.vertices) for cloth in scene.cloths) != len(reference.masses):
        return {}
    e = restart_error(reference, scene, **options)
    return {
        "restart_rms": e.rms_all,
        "restart_rms_edges": e.rms_edges,
        "restart_max_edges": e.largest_edges,
        "energy_error": e.energy_relative,
        "momentum_error": e.momentum_relative,
        "angular_momentum_error": e.angular_momentum,
        "at_floor": e.at_floor,
        "windows_rms": [float(x) for x in e.rms],
    }


class Stopwatch:
    """Runs a simulation step by step; keeps times and reports."""

    def __init__(self, simulation, limit):
        self.simulation, self.times, self.reports = simulation, [], []
        self._before, self._limit = None, time.perf_counter() + limit
        self._count = simulation.cloth_vertex_count

    def reach(self, moment, keep_last=False):
        """Steps until a time, s; keep_last: the velocities before the last step are kept."""
        s = self.simulation
        for left in range(steps_of(moment - s.time, s.time_step, f"time {moment:g} s"), 0, -1):
            if keep_last and left == 1:
                self._before = s.velocities[: self._count]
            start = time.perf_counter()
            s.step()
            end = time.perf_counter()
            self.times.append(1e3 * (end - start))
            self.reports.append(s.report)
            if end > self._limit:
                raise SolverError(f"stopped at {s.time:.3g} s of simulated time: the limit of wall time is reached")

    @property
    def before(self):
        """[n, 3] m/s before the last step."""
        return self._before


def free_run(scene, options, reference, task):
    """Times, and everything that a run from the start shows at the reference's window starts and ends."""
    begin = time.perf_counter()
    simulation = Simulation(scene, **options)
    watch, count = Stopwatch(simulation, task["limit"]), simulation.cloth_vertex_count
    first, energy = simulation.positions, sum(simulation.energy().values())
    faces, rest = simulation.faces[: simulation.cloth_triangle_count], surface.rest_shapes(scene)
    samples = [t for t in reference.starts if t > 0] or [reference.window]
    same = count == len(reference.masses)
    strains, apart, gaps, intersections = [], [], [], 0
    for i, moment in enumerate(samples):
        watch.reach(moment, keep_last=i == len(samples) - 1)
        x = simulation.positions[:count]
        if not np.isfinite(x).all():
            raise SolverError(f"positions are not finite at {moment:g} s")
        strains.append(surface.strain(x, faces, rest))
        if same and moment in reference.starts:
            exact = surface.strain(reference.positions[list(reference.starts).index(moment)], faces, rest)
            apart.append(np.mean((strains[-1].principal[:, 0] - exact.principal[:, 0]) ** 2))
        gaps.append(simulation.min_gap)
        intersections += simulation.count_intersections()
    v, seconds, dt = simulation.velocities[:count], simulation.time, simulation.time / simulation.step_count
    skip = min(task["warm_up"], len(watch.times) - 1)
    times, reports = np.array(watch.times[skip:]), watch.reports

    def column(name):
        return np.array([r[name] for r in reports], float)

    result = {
        "dt": dt,
        "steps": len(times),
        "setup_s": time.perf_counter() - begin - sum(watch.times) / 1e3,
        "vertices": count,
        "triangles": len(faces),
        "ms_per_step": float(np.median(times)),
        "ms_per_step_p95": float(np.quantile(times, 0.95)),
        "ms_per_second": float(np.median(times)) / dt,
        "ms_per_second_mean": float(times.mean()) / dt,
        "energy_drift": (sum(simulation.energy().values()) - energy) / seconds,
        "residual": float(column("residual").max()),
        "iterations": float(column("iterations").mean()),
        "contacts": int(column("contacts").max()),
        "strain_max": max(s.largest for s in strains),
        "strain_p999": max(s.p999 for s in strains),
        "area_min": min(s.smallest_area for s in strains),
        "area_mean": max((s.mean_area for s in strains), key=lambda a: abs(a - 1)),
        "min_gap": min(gaps),
        "intersections": intersections,
        "lost_motion": float(column("lost_motion").mean()),
        "truncated": float(column("truncated").mean() / count),
        "residual_speed": motion.residual_speed(v, simulation.masses),
        "peak_mib": simulation.peak_memory_bytes / 2**20,
        "device_name": simulation.device,
        "state_hash": simulation.state_hash,
    }
    if apart:
        result["strain_error"] = float(np.sqrt(np.mean(apart)))
    if len(reference.starts) and reference.starts[-1] > 0:
        away = surface.surface_distance(x, faces, reference.positions[-1], reference.faces, task["samples"])
        result.update(surface_mean=away.mean, surface_mean_edges=away.mean / reference.edge, hausdorff=away.hausdorff)
    if motion.rests(simulation, first):
        result["nonlinear_residual"] = motion.nonlinear_residual(
            scene,
            watch.before,
            x,
            v,
            dt,
            simulation.masses,
            **{k: w for k, w in options.items() if k not in ("tolerance", "time_step")},
        )
    return result
