# SPDX-License-Identifier: Apache-2.0
"""Trade-offs of time and accuracy: what options cost, which errors they have, and the Pareto front; `cama tradeoff`.

result = cama.tradeoff.tradeoff("drape", "out/tradeoff", plan=[{"time_step": 1 / 200}, {"time_step": 1 / 400}])
print(result.fronts["cpu"])
"""

from __future__ import annotations

import hashlib
import itertools
import json
import os
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Callable

import numpy as np

from .. import _core
from ..errors import ArrayError, BackendError, Error, FileError
from ..hints import require
from ..scene import Scene
from ..types import PathLike
from . import executor
from .grid import check_plan, default_plan, label, levels, pareto, product, unique
from .point import MEASURES, compute_reference, measure
from .reference import Reference, start_times
from .surface import rest_shapes, strain

# Called with what is done, of how many, and words; 0: nobody knows how many.
Progress = Callable[[int, int, str], object]

__all__ = ["tradeoff", "join", "Tradeoff", "levels", "pareto", "product", "default_plan", "MEASURES"]


@dataclass
class Tradeoff:
    """The measurements of one scene."""

    scene: str
    triangles: int
    #: dicts: backend, settings, label, failed (None or why), and the names of MEASURES (None: not measured)
    points: list[dict[str, Any]]
    #: {backend: indices of the points on the front of ms_per_second and restart_rms_edges, fastest first}
    fronts: dict[str, list[int]]
    reference: Reference = field(repr=False)
    #: of the reference and the run: window, windows, time_step, uncertainty_edges, converged, version, seconds
    facts: dict[str, Any]

    def front(self, backend: str, x: str = "ms_per_second", y: str = "restart_rms_edges") -> list[int]:
        """Returns the indices of the points on the Pareto front of any two measures, ordered by x.

        Points that failed or that have intersections are never on it.
        """
        own = [
            i
            for i, p in enumerate(self.points)
            if p["backend"] == backend and not p["failed"] and not p.get("intersections")
        ]
        return [own[k] for k in pareto([(self.points[i].get(x), self.points[i].get(y)) for i in own])]


def version() -> str:
    """Returns the version of the package with a digest of its compiled module, which a new build changes."""
    digest = hashlib.sha256(Path(_core.__file__).read_bytes()).hexdigest()[:12]
    return f"{_core.__version__}+{digest}"


def digest(value):
    """32 hexadecimal digits over a value that JSON can hold."""
    return hashlib.sha256(json.dumps(value, sort_keys=True, default=float).encode()).hexdigest()[:32]


def device_of(backend: str, device: int, cluster: str | None) -> str:
    """Returns the name of the hardware that results belong to. Raises BackendError if the backend is not available."""
    if cluster:
        return f"cluster {cluster}"
    for known in _core.list_backends():
        if known["name"] == backend:
            if not known["available"]:
                raise BackendError(f"backend {backend!r} is not available: {known['note']}")
            devices = known["devices"]
            if device >= len(devices):
                raise BackendError(f"backend {backend!r} has {len(devices)} devices; there is no number {device}")
            return devices[device]
    raise BackendError(
        f"backend {backend!r} is unknown; there are {', '.join(b['name'] for b in _core.list_backends())}"
    )


class Store:
    """Finished results in a folder, one file each. A file is complete or absent."""

    def __init__(self, folder):
        self.folder = Path(folder)
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as problem:
            raise FileError(f"{self.folder}: {problem.strerror}") from None

    def path(self, key, kind="json"):
        return self.folder / f"{key}.{kind}"

    def get(self, key):
        """Returns the result of a key, or None if it is absent or unreadable."""
        try:
            return json.loads(self.path(key).read_text(encoding="utf-8"))["result"]
        except (OSError, ValueError, KeyError):
            return None

    def put(self, key, task, result):
        """Writes a result and the task that it belongs to."""
        partial = self.path(key, f"{os.getpid()}.partial")
        partial.write_text(
            json.dumps({"task": task, "result": result}, indent=1, allow_nan=False, default=float), encoding="utf-8"
        )
        os.replace(partial, self.path(key))

    def reference(self, key):
        """Returns the Reference of a key, or None."""
        try:
            return Reference.load(self.path(key, "npz"))
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def put_reference(self, key, reference):
        """Writes a Reference."""
        partial = self.path(key, f"{os.getpid()}.partial.npz")
        reference.save(partial)
        os.replace(partial, self.path(key, "npz"))


@dataclass
class Setup:
    """How runs are made: where, how many at once, and for how long."""

    backends: tuple[str, ...] = ("cpu",)
    device: int = 0
    threads: int = 0  #: of timed runs; 0: as a Simulation chooses them
    jobs: int = 1  #: timed runs at once; more than one disturb each other
    #: runs at once that measure errors alone, one thread each; 0: as many as there are processors on cpu, one on other
    #: devices
    error_jobs: int = 0
    cluster: str | None = None  #: address of a Ray cluster, or None: this machine
    limit: float = 600.0  #: s of wall time for one run
    warm_up: int = 5  #: steps that are not timed
    samples: int = 4000  #: points on a surface whose distance is taken

    def check(self) -> None:
        """Raises ArrayError or BackendError if a value is not possible."""
        if self.jobs < 0 or self.error_jobs < 0 or self.threads < 0 or self.device < 0 or self.warm_up < 0:
            raise ArrayError(
                f"jobs {self.jobs}, error_jobs {self.error_jobs}, threads {self.threads}, device {self.device} and "
                f"warm_up {self.warm_up} must not be negative"
            )
        if not self.limit > 0 or not self.backends:
            raise ArrayError(f"limit {self.limit} must be greater than 0, and there must be a backend")
        for backend in self.backends:
            device_of(backend, self.device, self.cluster)


def tradeoff(
    scene: Scene | PathLike,
    output: PathLike,
    plan: Iterable[Mapping[str, Any]] | None = None,
    resolution: int = 0,
    window: float = 0.05,
    windows: int = 8,
    first: int = 1,
    stride: int = 1,
    reference_step: float | None = None,
    setup: Setup | None = None,
    progress: Progress | None = None,
) -> Tradeoff:
    """Measures the time and the errors of a plan of options.

    Finished results are kept in the folder OUTPUT/points and are not computed again; they are found by the content of
    the scene, options, version and device.

    Args:
        scene: What `Scene.load` accepts, or a Scene. With a Scene, the plan has no resolutions.
        output: Folder of the results.
        plan: Dicts of options, `accuracy`, `time_step` and `resolution`; None: `default_plan`. The scene's own options
            are not used.
        resolution: Approximate number of triangles. If the plan has several, the reference uses the finest, and the
            others are compared with it by their surfaces only.
        window, windows, first, stride: As for `accuracy.reference`.
        reference_step: Time step of the reference, s.
        setup: A Setup.
        progress: Called with (done, all, words) after each result.

    Returns:
        A Tradeoff. The error of a run that failed is its point's `failed`.

    Raises:
        cama.Error: The options are not possible; a subclass says why, before any run.
    """
    begin, setup = time.perf_counter(), setup or Setup()
    require("measuring", "scipy")  # before anything is computed
    setup.check()
    base = scene if isinstance(scene, Scene) else Scene.load(scene, resolution)
    plan = unique([dict(s) for s in plan]) if plan is not None else default_plan(base, window)
    check_plan(plan, window)
    texts, finest = _texts(scene, base, plan)
    store = Store(Path(output) / "points")
    pool = executor.make(setup.cluster, setup.jobs, any(b != "cpu" for b in setup.backends))
    try:
        run = _Run(store, pool, setup, texts, finest, progress or (lambda *_: None))
        reference = run.reference(
            dict(window=window, starts=start_times(window, windows, first, stride).tolist(), time_step=reference_step)
        )
        points = run.points(plan, reference)
    finally:
        pool.close()
    result = Tradeoff(base.name, len(reference.faces), points, {}, reference, {})
    result.fronts = {backend: result.front(backend) for backend in setup.backends}
    strained = Scene.parse(texts[finest])
    samples = [i for i, t in enumerate(reference.starts) if t > 0]
    result.facts = {
        "strain_max": max(
            (strain(reference.positions[i], reference.faces, rest_shapes(strained)).largest for i in samples),
            default=None,
        ),
        "window": window,
        "windows": windows,
        "first": first,
        "stride": stride,
        "reference_step": reference.time_step,
        "uncertainty_edges": float(np.sqrt((reference.uncertainty**2).mean()) / reference.edge),
        "converged": reference.converged,
        "order": reference.order,
        "edge": reference.edge,
        "threads": setup.threads,
        "version": version(),
        "devices": {b: device_of(b, setup.device, setup.cluster) for b in setup.backends},
        "seconds": time.perf_counter() - begin,
    }
    return result


def join(results: list[Tradeoff], file: PathLike) -> None:
    """Adds the points of a tradeoff.json of another run or machine, for backends that a scene has no points of here.

    Raises:
        FileError: The file is not a tradeoff.json.
        ArrayError: A scene was measured on another mesh or with other windows, or no scene is the same.
    """
    alike = ("triangles", "window", "windows", "first", "stride", "reference_step")
    try:
        scenes = json.loads(Path(file).read_text(encoding="utf-8"))["scenes"]
        found = [(r, s) for r in results for s in scenes if s["scene"] == r.scene]
        for r, s in found:
            own = {"triangles": r.triangles, **r.facts}
            different = [name for name in alike if s[name] != own[name]]
            if different:
                raise ArrayError(
                    f"{file}: {r.scene} has another {different[0]} there: {s[different[0]]} instead of "
                    f"{own[different[0]]}"
                )
            points = [
                {
                    **{name: None for name in MEASURES},
                    **p,
                    "settings": dict(p["settings"]),
                    "label": str(p["label"]),
                    "failed": p["failed"],
                }
                for p in s["points"]
                if p["backend"] not in r.fronts
            ]
            r.points.extend(points)
            for backend in dict.fromkeys(p["backend"] for p in points):
                r.facts["devices"][backend] = str(s["devices"][backend])
                r.fronts[backend] = r.front(backend)
    except OSError as problem:
        raise FileError(f"{file}: {problem.strerror}") from None
    except ArrayError:
        raise
    except (ValueError, KeyError, TypeError, AttributeError) as problem:
        raise FileError(f"{file}: not a tradeoff.json of cama: {problem!r}") from None
    if not found:
        raise ArrayError(f"{file}: has none of {', '.join(r.scene for r in results)}")


def _texts(scene, base, plan):
    """Returns {resolution: JSON text} of every mesh that the plan names (0: the base's) and the key of the finest."""
    wanted = sorted({s["resolution"] for s in plan if "resolution" in s})
    if wanted and isinstance(scene, Scene):
        raise ArrayError("resolution: a Scene has its meshes already; give the name or file of a scene")
    scenes = {resolution: Scene.load(scene, resolution) for resolution in wanted}
    if any("resolution" not in s for s in plan):
        scenes[0] = base
    return {key: s.to_json() for key, s in scenes.items()}, max(scenes, key=lambda key: scenes[key].triangle_count)


class _Run:
    def __init__(self, store, pool, setup, texts, finest, progress):
        self._store, self._pool, self._setup, self._texts, self._finest, self._progress = (
            store,
            pool,
            setup,
            texts,
            finest,
            progress,
        )
        self._version, self._devices = version(), {b: device_of(b, setup.device, setup.cluster) for b in setup.backends}
        self._reference_key = None

    def reference(self, arguments):
        """The Reference, computed on the first backend or read."""
        finest = self._finest
        arguments = dict(
            arguments, backend=self._setup.backends[0], device=self._setup.device, threads=self._setup.threads
        )
        key = self._reference_key = digest(
            [self._texts[finest], {k: v for k, v in arguments.items() if k != "threads"}, self._version]
        )
        found = self._store.reference(key)
        if found is None:
            self._progress(0, 0, "reference")
            task = {"resolution": finest, "arguments": arguments}
            for _, found in self._pool.run(
                compute_reference, [task], {"texts": self._texts}, 1 if self._setup.jobs else 0
            ):
                if isinstance(found, executor.Failure):
                    raise Error(f"the reference run failed: {found.text}")
                self._store.put_reference(key, found)
        return found

    def points(self, plan, reference):
        """Points of the plan on every backend, errors first, then times."""
        setup = self._setup
        rows = [{"backend": b, "settings": s} for b in setup.backends for s in plan]
        tasks = {
            kind: [
                dict(
                    row,
                    kind=kind,
                    device=setup.device,
                    threads=1 if kind == "error" else setup.threads,
                    warm_up=setup.warm_up,
                    limit=setup.limit,
                    samples=setup.samples,
                )
                for row in rows
            ]
            for kind in ("error", "time")
        }
        keys = {kind: [self._key(task) for task in tasks[kind]] for kind in tasks}
        results = {kind: [self._store.get(key) for key in keys[kind]] for kind in tasks}
        total, done = 2 * len(rows), sum(r is not None for kind in results.values() for r in kind)
        shared = {"texts": self._texts, "reference": reference}
        for kind, backend in itertools.product(tasks, setup.backends):
            missing = [i for i, r in enumerate(results[kind]) if r is None and rows[i]["backend"] == backend]
            self._progress(done, total, kind)
            if not missing:
                continue
            for k, result in self._pool.run(
                measure, [tasks[kind][i] for i in missing], shared, self._jobs(kind, backend)
            ):
                i = missing[k]
                if isinstance(result, executor.Failure):
                    result = {"failed": result.text}
                results[kind][i] = result
                self._store.put(keys[kind][i], tasks[kind][i], result)
                done += 1
                self._progress(done, total, f"{kind}, {rows[i]['backend']}, {label(rows[i]['settings'])}")
        return [self._point(row, results["error"][i], results["time"][i]) for i, row in enumerate(rows)]

    def _jobs(self, kind, backend):
        """Returns how many runs there are at once.

        None: as many as the cluster has room for; 0: one after the other in this process. Runs share no device
        unless the setup says so.
        """
        setup = self._setup
        if kind == "time" or not setup.jobs:
            return setup.jobs
        if setup.error_jobs or setup.cluster:
            return setup.error_jobs or None
        return (os.cpu_count() or 1) if backend == "cpu" else 1

    def _key(self, task):
        own = {
            k: v for k, v in task.items() if task["kind"] == "time" or k in ("kind", "backend", "settings", "device")
        }
        text = self._texts[task["settings"].get("resolution", 0)]
        return digest([own, text, self._reference_key, self._version, self._devices[task["backend"]]])

    @staticmethod
    def _point(row, error, timed):
        failed = timed.get("failed") or error.get("failed")
        return {
            **row,
            "label": label(row["settings"]),
            "failed": failed,
            **{name: None for name in MEASURES},
            **{k: v for k, v in {**error, **timed}.items() if k != "failed"},
        }
