# SPDX-License-Identifier: Apache-2.0
"""Data sets: many samples of random scenes in one HDF5 file.

Until all samples are there, finished batches lie as files of their own in the folder PATH.parts, each written whole or
not at all. The last step puts them together.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Union

import h5py
import numpy as np

from ._core import __version__
from .arrays import count, number
from .errors import ArrayError, CollisionError, Error, FileError, SceneError
from .io import checkpoint
from .io.journal import sync_folder
from .io.lock import locked
from .scene import Scene
from .types import PathLike
from .worlds import Worlds

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ._options import AccuracyLevel, BackendName, Overrides, Precision

__all__ = ["generate", "random"]

Sample = Union[Scene, tuple[Scene, Mapping[str, float]]]
FORMAT = "cama dataset 1"
PLAN = "plan.json"
STORES = {"double": np.float64, "single": np.float32}


def random(seed: int, sample: int) -> np.random.Generator:
    """Returns the random numbers of a sample: NumPy's PCG64 of the entropy (seed, sample), both from 0."""
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence((count("seed", seed), count("sample", sample)))))


def generate(
    path: PathLike,
    make: Callable[[np.random.Generator], Sample],
    samples: int | range,
    seed: int = 0,
    frames: int = 1,
    batch: int = 64,
    store: str = "single",
    progress: bool = False,
    backend: BackendName = "auto",
    precision: Precision | None = None,
    accuracy: AccuracyLevel | None = None,
    device: int = 0,
    threads: int = 0,
    **overrides: Unpack[Overrides],
) -> None:
    """Simulates random scenes and writes them to an HDF5 file, or goes on where an interrupted call ended.

    Sample k comes from `random(seed, k)` alone: it has the same bits whatever the other samples, the batch and the
    backend are. Samples of a batch are `cama.Worlds`. The same call after a kill computes what is missing.

    The file has the datasets positions [samples, frames + 1, vertices, 3], m, those of the start first; times [frames +
    1], s; faces [triangles, 3]; sample [samples], its number; intersections [samples], edges through faces at the end,
    -1 where the start has some already, and nothing is simulated;
    error [samples], text, empty where the simulation did not fail: where it did, positions are NaN from there on; and
    for every parameter a dataset [samples] in the group `parameters`. Attributes: format, seed, cloth_vertices,
    cloth_triangles, options (JSON), cama_version.

    Args:
        path: The file. It must not be there. Until it is whole, finished batches lie in the folder PATH.parts.
        make: Called with the random numbers of a sample; returns its scene, or the scene and a dict of the numbers that
            are kept as its parameters. All scenes have the same triangles and the same time between frames.
        samples: How many, from 0, or a range of them, for example range(1000, 2000) for one of many machines.
        seed: Of all samples.
        frames: Frames after the start, each the scene's `frame_time` long.
        batch: Samples that are simulated together and written at once.
        store: Precision of the positions in the file: "single" or "double".
        progress: Whether to show a progress bar on standard error.
        backend, precision, accuracy, device, threads, overrides: As of `cama.Worlds`.

    Raises:
        ArrayError: The scene of a sample does not fit those before it.
        FileError: The file is there, cannot be written, or another call writes it.
        SceneError: An argument does not fit, or PATH.parts was begun with other arguments.
        cama.Error: A sample's scene cannot be simulated at all; the text says which.
    """
    if store not in STORES:
        raise SceneError(f'generate: store is {store!r}; it is "single" or "double"')
    wanted = samples if isinstance(samples, range) else range(count("generate: samples", samples))
    if not wanted or min(wanted) < 0 or wanted.step != 1:
        raise SceneError(f"generate: samples: {samples!r} holds no samples; give a number or range(first, last)")
    if count("generate: batch", batch) < 1 or count("generate: frames", frames) < 1:
        raise SceneError("generate: batch and frames are at least 1")
    target = Path(path)
    if target.exists():
        raise FileError(f"{target}: is there already; remove it or choose another name")
    given = {"precision": precision, "accuracy": accuracy, **overrides}
    options = {key: value for key, value in sorted(given.items()) if value is not None}
    runs = {"backend": backend, "device": device, "threads": threads, **given}
    folder = target.with_name(target.name + ".parts")
    with locked(folder), _named(target):
        first = _scene_of(make, seed, wanted[0])[0]
        plan = {
            "format": FORMAT,
            "seed": seed,
            "first": wanted.start,
            "last": wanted.stop,
            "frames": frames,
            "store": store,
            "options": options,
            "scene": checkpoint.parts_of(first),
            "cama_version": __version__,
        }
        _agree(folder, plan)
        done = _done(folder)
        missing = [k for k in wanted if k not in done]
        with _bar(len(wanted), len(done), progress) as advance:
            for begin in range(0, len(missing), batch):
                part = missing[begin : begin + batch]
                _write(folder / f"{part[0]:09d}.h5", _simulate(make, seed, part, frames, store, runs))
                advance(len(part))
        _join(folder, target, plan)
    shutil.rmtree(folder, ignore_errors=True)


@contextlib.contextmanager
def _named(target: Path) -> Any:
    """Names the file in what the operating system refuses."""
    try:
        yield
    except OSError as problem:
        if isinstance(problem, Error):
            raise
        raise FileError(f"{target}: {problem.strerror or problem}") from None


@contextlib.contextmanager
def _bar(total: int, done: int, progress: bool) -> Any:
    """Yields a function that moves a progress bar on."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn

    from .io.progress import Bar

    console = Console(stderr=True, highlight=False) if progress else None
    columns = (TextColumn("sample"), MofNCompleteColumn(), BarColumn(), TimeRemainingColumn())
    with Bar(*columns, console=console) as bar:
        task = bar.add_task("", total=total, completed=done)
        yield lambda n: bar.update(task, advance=n)


def _scene_of(make: Callable[[np.random.Generator], Sample], seed: int, sample: int) -> tuple[Scene, dict[str, float]]:
    """Returns the scene and the parameters of a sample."""
    made = make(random(seed, sample))
    scene, parameters = made if isinstance(made, tuple) and len(made) == 2 else (made, {})
    if not isinstance(scene, Scene):
        raise SceneError(f"sample {sample}: make returned {type(scene).__name__}; give a Scene, or a Scene and a dict")
    if not isinstance(parameters, Mapping):
        raise SceneError(f"sample {sample}: make returned parameters of type {type(parameters).__name__}; give a dict")
    return scene, {str(key): number(f"sample {sample}: {key}", value) for key, value in parameters.items()}


def _agree(folder: Path, plan: dict[str, Any]) -> None:
    """Writes the plan of a folder, or compares it with the one that is there."""
    file = folder / PLAN
    text = json.dumps(plan, indent=1, sort_keys=True)
    if not file.exists():
        _replace(file, lambda partial: partial.write_text(text))
        return
    try:
        before = json.loads(file.read_text())
    except ValueError:
        raise FileError(f"{file}: is no plan of a data set; remove the folder to begin anew") from None
    now = json.loads(text)
    differ = sorted(key for key in {*before, *now} if before.get(key) != now.get(key))
    if differ:
        raise SceneError(
            f"{folder}: was begun with other arguments ({', '.join(differ)}); use those, or remove the folder"
        )


def _done(folder: Path) -> set[int]:
    """Returns the samples whose batches are there."""
    found: set[int] = set()
    for file in sorted(folder.glob("*.h5")):
        with h5py.File(file, "r") as part:
            found.update(int(k) for k in part["sample"][:])
    return found


def _simulate(
    make: Callable[[np.random.Generator], Sample],
    seed: int,
    part: list[int],
    frames: int,
    store: str,
    runs: dict[str, Any],
) -> dict[str, Any]:
    """Returns {dataset: values} of some samples."""
    made = [_scene_of(make, seed, k) for k in part]
    names = list(made[0][1])
    for k, (_, parameters) in zip(part, made):
        if list(parameters) != names:
            raise ArrayError(f"sample {k}: has parameters {list(parameters)}, but sample {part[0]} {names}")
    worlds, failed = _worlds_of([scene for scene, _ in made], part, runs)
    begun = [row for row in range(len(part)) if row not in failed]  # of each world
    faces = worlds[0].faces
    for k, world in zip([part[row] for row in begun], worlds):
        if not np.array_equal(world.faces, faces):
            raise ArrayError(f"sample {k}: has other triangles than sample {part[0]}; all samples have the same")
        if world.scene.seconds_per_frame != worlds[0].scene.seconds_per_frame:
            raise ArrayError(f"sample {k}: has another frame_time than sample {part[0]}; all samples have the same")
    positions = np.full((len(part), frames + 1, worlds[0].vertex_count, 3), np.nan, STORES[store])
    positions[begun, 0] = worlds.positions
    for frame in range(frames):
        worlds.step_frame()
        alive = np.setdiff1d(np.arange(len(begun)), worlds.frozen)
        positions[np.array(begun)[alive], frame + 1] = worlds.positions[alive]
    errors, intersections = [failed.get(row) for row in range(len(part))], np.full(len(part), -1, np.int64)
    for world, row in enumerate(begun):
        errors[row], intersections[row] = worlds.error(world), worlds[world].count_intersections()
    return {
        "sample": np.array(part, np.int64),
        "positions": positions,
        "intersections": intersections,
        "error": np.array(["" if e is None else str(e) for e in errors], dtype=object),
        "times": worlds[0].scene.seconds_per_frame * np.arange(frames + 1),
        "faces": faces,
        "cloth": np.array([worlds[0].cloth_vertex_count, worlds[0].cloth_triangle_count]),
        **{f"parameters/{name}": np.array([parameters[name] for _, parameters in made]) for name in names},
    }


def _worlds_of(scenes: list[Any], part: list[int], runs: dict[str, Any]) -> tuple[Worlds, dict[int, Error]]:
    """Returns worlds of the scenes that can begin, and {row: error} of the others, which start with intersections."""
    try:
        return Worlds(scenes, **runs), {}
    except CollisionError:
        failed: dict[int, Error] = {}
    except Error as problem:
        raise type(problem)(f"samples {part[0]} to {part[-1]}: {problem}") from problem
    for row, scene in enumerate(scenes):
        try:
            Worlds([scene], **runs)
        except CollisionError as problem:
            failed[row] = CollisionError(str(problem).removeprefix("world 0: "))
    if len(failed) == len(scenes):
        raise CollisionError(
            f"sample {part[0]}, and every other of its batch of {len(part)}: {failed[0]}; let `make` place cloth "
            "without intersections"
        )
    return Worlds([scene for row, scene in enumerate(scenes) if row not in failed], **runs), failed


def _write(path: Path, values: dict[str, Any]) -> None:
    def fill(partial: Path) -> None:
        with h5py.File(partial, "w") as file:
            for name, array in values.items():
                file.create_dataset(name, data=array, dtype=h5py.string_dtype() if array.dtype == object else None)

    _replace(path, fill)


def _replace(path: Path, fill: Callable[[Path], object]) -> None:
    """Writes a file under another name, waits until it is on the disk, and gives it its name."""
    partial = path.with_name(path.name + ".partial")
    fill(partial)
    with open(partial, "rb") as file:
        os.fsync(file.fileno())
    os.replace(partial, path)
    sync_folder(path.parent)


def _join(folder: Path, target: Path, plan: dict[str, Any]) -> None:
    """Puts the batches together in the order of samples."""
    total = plan["last"] - plan["first"]

    def fill(partial: Path) -> None:
        with h5py.File(partial, "w") as file:
            file.attrs.update({key: plan[key] for key in ("format", "seed", "cama_version")})
            file.attrs["options"] = json.dumps(plan["options"])
            for path in sorted(folder.glob("*.h5")):
                with h5py.File(path, "r") as part:
                    _add(file, part, part["sample"][:] - plan["first"], total, path.name)

    _replace(target, fill)


def _add(file: h5py.File, part: h5py.File, rows: Any, total: int, name: str) -> None:
    """Copies a batch to its rows of the whole file."""
    for key in ("times", "faces", "cloth"):
        if key == "cloth":
            file.attrs["cloth_vertices"], file.attrs["cloth_triangles"] = (int(n) for n in part[key][:])
        elif key not in file:
            part.copy(key, file)
        elif not np.array_equal(file[key][:], part[key][:]):
            raise ArrayError(f"{name}: its samples have other {key} than those before; all samples have the same")
    keys = ["sample", "positions", "intersections", "error"]
    keys += [f"parameters/{key}" for key in part.get("parameters", ())]
    for key in keys:
        if key not in file:
            file.create_dataset(key, (total, *part[key].shape[1:]), part[key].dtype)
        if file[key].shape[1:] != part[key].shape[1:]:
            raise ArrayError(f"{name}: its samples have other vertices than those before; all samples have the same")
        file[key][rows] = part[key][:]
