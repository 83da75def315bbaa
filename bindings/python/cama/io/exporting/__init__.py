# SPDX-License-Identifier: Apache-2.0
"""Writes a recording in formats of other programs: USD, glTF, OBJ, PLY, PC2, MDD and VTK; a module for each."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from ...errors import FileError, SceneError
from ...hints import naming_files, require, similar
from ...types import PathLike
from ...units import METRES, unknown
from ..recording import Recording
from . import cache, gltf, sequence, usd, vtk
from .series import Series

__all__ = ["FORMATS", "Exported", "export"]


@dataclass(frozen=True)
class Format:
    """What a format is, and who writes it."""

    title: str
    write: Callable[[Series, Path, Callable[[], None]], None]  #: to a folder, calling a function after every frame
    needs: tuple[str, ...] = ()  #: modules
    says_up: bool = False  #: whether a file says which axis is up
    only_metres: bool = False
    folder: bool = True  #: whether it makes many files


FORMATS = {
    "usd": Format("USD", usd.write, ("pxr",), says_up=True, folder=False),
    "gltf": Format("glTF", gltf.write, says_up=True, only_metres=True, folder=False),
    "obj": Format("OBJ", sequence.write_obj),
    "ply": Format("PLY", sequence.write_ply),
    "pc2": Format("PC2", cache.write_pc2),
    "mdd": Format("MDD", cache.write_mdd),
    "vtk": Format("VTK", vtk.write, ("vtkmodules",)),
}


@dataclass
class Exported:
    """What `export` wrote."""

    files: list[Path]  #: sorted by name
    frames: int
    fps: float  #: frames per second


@naming_files()
def export(
    recording: PathLike,
    to: str,
    output: PathLike | None = None,
    *,
    cloth_only: bool = False,
    fps: float | None = None,
    first: int = 0,
    last: int | None = None,
    every: int = 1,
    up: str | None = None,
    units: str = "m",
    progress: Callable[[int, int], None] | None = None,
) -> Exported:
    """Writes a recording in another format. Files appear under their names once all of them are complete.

    Args:
        recording: Folder that `cama run` wrote, or its frames.h5.
        to: "usd", "gltf", "obj", "ply", "pc2", "mdd" or "vtk".
        output: Folder to write to; None: `export` in the recording's folder, for a format of many files
            `export/FORMAT`.
        cloth_only: Whether to leave obstacles out.
        fps: Frames per second of simulated time, interpolated linearly between recorded frames; None: the recorded
            frames.
        first: First recorded frame.
        last: Last recorded frame; None: that of the recording.
        every: 2 takes every second frame from `first` on; only without `fps`.
        up: The axis that points up, "y" or "z"; None: z. USD and glTF say theirs: z in USD, y in glTF.
        units: Unit of length of the file: "m", "cm", "mm", "inch" or "foot", or as `add_cloth` takes them. Not for
            glTF, which has metres.
        progress: Is called with the number of frames that are written and that of all; an exception ends the export.

    Raises:
        FileError: The recording cannot be read, or the disk is full.
        SceneError: An argument does not fit the recording or the format.
        BackendError: A library that the format needs is not installed.
    """
    chosen = _format(to, up, units)
    require(f"exporting {chosen.title}", *chosen.needs)
    with Recording(recording) as source:
        own = Path(recording) if Path(recording).is_dir() else Path(recording).parent
        series = Series(source, own.resolve().name, cloth_only, fps, first, last, every, up or "z", METRES[units])
        folder = Path(output) if output is not None else own / "export" / (to if chosen.folder else "")
        done = 0

        def tick() -> None:
            nonlocal done
            done += 1
            if progress is not None:
                progress(done, len(series))

        with _written_whole(folder) as partial:
            chosen.write(series, partial, tick)
            files = sorted(path.name for path in partial.iterdir())
        _remove_frames_of_before(folder, series.name, set(files))
    return Exported([folder / name for name in files], len(series), series.fps)


def _format(to: str, up: str | None, units: str) -> Format:
    """Returns a format. Raises SceneError if there is none, or if it has no choice of the axis or the unit."""
    if to not in FORMATS:
        raise SceneError(f"export: there is no format {to!r}; there are {', '.join(FORMATS)}{similar(to, FORMATS)}")
    if up not in (None, "y", "z"):
        raise SceneError(f"export: up: {up!r} is neither 'y' nor 'z'")
    if units not in METRES:
        raise SceneError(f"export: units: {unknown(units)}")
    chosen = FORMATS[to]
    if up and chosen.says_up:
        raise SceneError(f"export: up: a {chosen.title} file says which axis is up, and programs turn it; leave it out")
    if METRES[units] != 1 and chosen.only_metres:
        raise SceneError(f"export: units: lengths in {chosen.title} are metres; leave it out")
    return chosen


@contextlib.contextmanager
def _written_whole(folder: Path) -> Iterator[Path]:
    """Yields a temporary folder, whose files move to `folder` at the end; after an exception nothing of it stays."""
    partial = None
    try:
        folder.mkdir(parents=True, exist_ok=True)
        partial = Path(tempfile.mkdtemp(prefix=".partial-", dir=folder))
        yield partial
        for path in sorted(partial.iterdir()):
            os.replace(path, folder / path.name)
    except OSError as problem:
        said = (str(problem).splitlines() or [type(problem).__name__])[0]
        raise FileError(f"{folder}: writing failed ({said}); is the disk full?") from problem
    finally:
        if partial is not None:
            shutil.rmtree(partial, ignore_errors=True)


def _remove_frames_of_before(folder: Path, name: str, files: set[str]) -> None:
    """Removes the numbered files of an earlier, longer export of the same format."""
    pattern = re.compile(re.escape(name) + r"_\d{4,}(\.\w+)")
    ends = {found[1] for found in map(pattern.fullmatch, files) if found}
    for path in folder.iterdir():
        found = pattern.fullmatch(path.name)
        if found and found[1] in ends and path.name not in files:
            path.unlink(missing_ok=True)
