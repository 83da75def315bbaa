# SPDX-License-Identifier: Apache-2.0
"""Speed for accuracy, measured: a grid of settings, what each costs and gets wrong, and the Pareto front; `cama tradeoff`.

result = cama.tradeoff.tradeoff("drape", "out/tradeoff", plan=[{"time_step": 1 / 200}, {"time_step": 1 / 400}], resolution=600)
print(result.fronts["cpu"])
"""

import hashlib
import itertools
import json
import os
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from .. import _core
from ..errors import ArrayError, BackendError, Error, FileError
from ..scene import Scene
from . import executor
from .grid import check_plan, default_plan, label, levels, pareto, product, unique
from .point import MEASURES, compute_reference, measure
from .reference import Reference, start_times
from .surface import rest_shapes, strain

__all__ = ["tradeoff", "join", "Tradeoff", "levels", "pareto", "product", "default_plan", "MEASURES"]


@dataclass
class Tradeoff:
    """What was measured of one scene."""

    scene: str
    triangles: int
    points: (
        list  #: dicts: backend, settings, label, failed (None or why), and the names of MEASURES (None: not measured)
    )
    fronts: dict  #: {backend: indices of the points on the front of ms_per_second and restart_rms_edges, fastest first}
    reference: Reference = field(repr=False)
    facts: dict  #: of the reference and the run: window, windows, time_step, uncertainty_edges, converged, version, seconds

    def front(self, backend, x="ms_per_second", y="restart_rms_edges"):
        """Indices of the points on the front of any two measures, the smaller x first; points that intersect are never on it."""
        own = [
            i
            for i, p in enumerate(self.points)
            if p["backend"] == backend and not p["failed"] and not p.get("intersections")
        ]
        return [own[k] for k in pareto([(self.points[i].get(x), self.points[i].get(y)) for i in own])]


def version():
    """Of the package and of its compiled part, which a new build changes."""
    digest = hashlib.sha256(Path(_core.__file__).read_bytes()).hexdigest()[:12]
    return f"{_core.__version__}+{digest}"


def digest(value):
    """32 hexadecimal digits over a value that JSON can hold."""
    return hashlib.sha256(json.dumps(value, sort_keys=True, default=float).encode()).hexdigest()[:32]


def device_of(backend, device, cluster):
    """Name of the hardware that results belong to. Throws BackendError where the backend is not to be had."""
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
    """Finished results in a folder, one file each; a file is whole or not there."""

    def __init__(self, folder):
        self.folder = Path(folder)
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as problem:
            raise FileError(f"{self.folder}: {problem.strerror}") from None

    def path(self, key, kind="json"):
        return self.folder / f"{key}.{kind}"

    def get(self, key):
        """The result under a key, or None; what cannot be read counts as not there."""
        try:
            return json.loads(self.path(key).read_text(encoding="utf-8"))["result"]
        except (OSError, ValueError, KeyError):
            return None

    def put(self, key, task, result):
        """Writes a result with the task that it belongs to."""
        partial = self.path(key, f"{os.getpid()}.partial")
        partial.write_text(
            json.dumps({"task": task, "result": result}, indent=1, allow_nan=False, default=float), encoding="utf-8"
        )
        os.replace(partial, self.path(key))

    def reference(self, key):
        """The Reference under a key, or None."""
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
    """How results are come by: where, how many at once, for how long."""

    backends: tuple = ("cpu",)
    device: int = 0
    threads: int = 0  #: of timed runs; 0: as a Simulation chooses them
    jobs: int = 1  #: timed runs at once; more than one disturb each other
    error_jobs: int = 0  #: runs at once that measure errors alone, one thread each; 0: as many as there are processors on cpu, one on other devices
    cluster: str = None  #: address of a Ray cluster, or None: this machine
    limit: float = 600.0  #: s of wall time for one run
    warm_up: int = 5  #: steps that are not timed
    samples: int = 4000  #: points on a surface whose distance is taken

    def check(self):
        """Throws ArrayError, BackendError."""
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
    scene,
    output,
    plan=None,
    resolution=0,
    window=0.05,
    windows=8,
    first=1,
    stride=1,
    reference_step=None,
    setup=None,
    progress=None,
):
    """Measures what settings cost and get wrong; a Tradeoff.

    scene: what Scene.load takes, or a Scene (no resolutions then).  output: folder; finished results are kept in OUTPUT/points and are not
    computed again, by scene content, settings, version and device.  plan: list of dicts of knobs (`grid.knobs`), default
    `default_plan`; options that a scene carries are left out.  resolution: triangles aimed at; with several in the plan the reference has
    the finest, and the others are compared with it by surface alone.  window, windows, first, stride, reference_step: of `accuracy.reference`.
    setup: a Setup.  progress: called with (done, all, words) after each result.
    Throws a subclass of cama.Error before anything runs for settings that cannot be; what fails in a run is a point's `failed`.
    """
    begin, setup = time.perf_counter(), setup or Setup()
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


def join(results, file):
    """Shows the points of a tradeoff.json of another run or machine beside these: of backends that a scene has none of here.

    Throws FileError for what is no such file, ArrayError where a scene was measured on other meshes or windows, or none is the same.
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
                    f"{file}: {r.scene} has another {different[0]} there: {s[different[0]]} instead of {own[different[0]]}"
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
    """{resolution: JSON text} of every mesh that the plan names; 0: the base's. Returns also the key of the finest."""
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
        """At once. None: what the cluster has; 0: in this process. One device is not shared by several runs unless asked for."""
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
