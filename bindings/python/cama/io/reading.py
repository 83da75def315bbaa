# SPDX-License-Identifier: Apache-2.0
"""Reads doubtful files in a process of its own first: what crashes or hangs there is a FileError here.

assimp, which reads all formats but OBJ, stops the process at some damaged files, and takes minutes over others. `check`
lets a short-lived process read a file under limits of memory and time (reader_process.py); only what ended well there
is read again here. HDF5 crashes on some damaged files too: `check_hdf5` does the same for recordings, and for
checkpoints whose digest is not right. Answers are kept for as long as path, time of change and size stay.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .. import _core
from ..errors import FileError, SceneError
from ..types import PathLike
from . import morph
from .reader_process import NO_MEMORY

MEMORY = "CAMA_READ_MEMORY"  # GiB, of the environment
SECONDS = "CAMA_READ_SECONDS"  # s, of the environment
GIB = 2**30
BASE_MEMORY, MEMORY_PER_BYTE = 2 * GIB, 100
BASE_SECONDS, SECONDS_PER_BYTE = 5.0, 1.0 / 2**20
WAIT = 120.0  # s of wall time for a process on a busy machine
FOREIGN = re.compile(r'"(?:file|path|positions|animation_file)"')  # keys of a scene that name mesh files

# What h5py raises for a file that is damaged or of another program.
DAMAGED = (
    OSError,
    KeyError,
    ValueError,
    TypeError,
    AttributeError,
    IndexError,
    OverflowError,
    RuntimeError,
    MemoryError,
)
OWN = (".obj", ".usd", ".usda", ".usdc", ".usdz")  # that assimp does not read

_known: dict[tuple[Any, ...], str] = {}  # what was found out about a file: "" for one that can be read


@dataclass(frozen=True)
class Request:
    """One call of the compiled module that reads foreign files."""

    function: str  #: load_mesh or load_character
    arguments: tuple[Any, ...]
    files: tuple[Path, ...]  #: that it reads; the first is the one that errors name

    def key(self) -> tuple[Any, ...]:
        """What the answer depends on. Raises OSError, ValueError for a file that is not there."""
        stats = [os.stat(file) for file in self.files]
        places = tuple((os.path.abspath(f), s.st_mtime_ns, s.st_size) for f, s in zip(self.files, stats))
        return (self.function, repr(self.arguments), places, *limits_of(self.size()))

    def size(self) -> int:
        """Bytes of the files, and of the buffers beside a glTF file."""
        files = set(self.files)
        for file in self.files:
            if file.suffix.lower() == ".gltf":
                files.update(file.parent.glob("*.bin"))
        return sum(os.path.getsize(file) for file in files)


def mesh(file: PathLike) -> Request:
    """The request to read the mesh of a file."""
    return Request("load_mesh", (os.fspath(file), 1.0, False, 1.0), (Path(file),))


def character(file: PathLike, clip: str, animation: PathLike, *how: Any) -> Request:
    """The request to read a character; the arguments are those of the compiled `load_character`."""
    files = (Path(file), Path(animation)) if os.fspath(animation) else (Path(file),)
    return Request("load_character", (os.fspath(file), clip, os.fspath(animation), *how), files)


def _is_foreign(file: Path) -> bool:
    return file.suffix.lower() not in OWN


def _limit(name: str, otherwise: float) -> float:
    """Returns a limit of the environment; 0 there is none. Raises SceneError for a text that is no number."""
    text = os.environ.get(name, "")
    if not text:
        return otherwise
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not value >= 0:
        raise SceneError(f"{name}={text}: is not a number from 0 on, in {'GiB' if name == MEMORY else 'seconds'}")
    return value or math.inf


def limits_of(size: int) -> tuple[float, float]:
    """Returns the memory, bytes, and the processor time, s, that reading a file of `size` bytes may take."""
    memory = _limit(MEMORY, (BASE_MEMORY + MEMORY_PER_BYTE * size) / GIB) * GIB
    return memory, _limit(SECONDS, BASE_SECONDS + SECONDS_PER_BYTE * size)


def check(requests: Sequence[Request]) -> None:
    """Raises FileError for a file whose reader crashes, hangs or takes too much memory.

    Files that are missing, and those that their reader refuses with an error, are left to the caller.
    """
    open_ones: list[tuple[tuple[Any, ...], Request]] = []
    for request in requests:
        if not any(_is_foreign(file) for file in request.files):
            continue
        try:
            key = request.key()
        except (OSError, ValueError):
            continue
        if _known.get(key):
            raise FileError(_known[key])
        if key not in _known:
            open_ones.append((key, request))
    if open_ones:
        for (key, request), problem in zip(open_ones, _read([request for _, request in open_ones])):
            _known[key] = f"{request.files[0]}: {problem}" if problem else ""
            if problem:
                raise FileError(_known[key])


def works() -> bool:
    """Whether a process can be started that reads files."""
    return bool(_talk("", 30.0)[0])


def check_hdf5(path: PathLike) -> None:
    """Raises FileError for an HDF5 file on which HDF5 crashes or hangs. Nothing is found out of one that is missing."""
    try:
        stat = os.stat(path)
    except (OSError, ValueError):
        return
    key = ("hdf5", os.path.abspath(path), stat.st_mtime_ns, stat.st_size)
    if key not in _known:
        program = str(Path(__file__).with_name("hdf5_process.py"))
        _, seconds = limits_of(stat.st_size)
        limit = f"{1.5 * seconds:.0f}" if math.isfinite(seconds) else "0"
        words = [sys.executable or "python3", "-I", program, os.fspath(path), limit, *filter(None, sys.path)]
        try:
            done = subprocess.run(
                words,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                timeout=WAIT + 1.5 * seconds if math.isfinite(seconds) else None,
            )
            crashed = done.returncode < 0
        except (OSError, subprocess.TimeoutExpired):  # a machine that is too busy says nothing of the file
            return
        _known[key] = (
            "is damaged: HDF5 crashes or hangs on it; take another one, or compute it again" if crashed else ""
        )
    if _known[key]:
        raise FileError(f"{path}: {_known[key]}")


def _read(requests: list[Request]) -> Iterator[str]:
    """Yields what is wrong with each file, "" for nothing; ends after the first with which something is.

    Where no process can be started, nothing is found out: then a program that has this one embedded is in charge.
    """
    lines, wall = [], WAIT
    for request in requests:
        memory, seconds = limits_of(request.size())
        wall += 1.0 + 1.5 * seconds
        lines.append(
            json.dumps(
                {
                    "call": [request.function, *request.arguments],
                    "memory": int(memory) if math.isfinite(memory) else None,
                    "seconds": seconds if math.isfinite(seconds) else None,
                }
            )
        )
    said, complaint, code = _talk("\n".join(lines) + "\n", wall if math.isfinite(wall) else None)
    if not said and code is None:
        raise FileError(
            f"{requests[0].files[0]}: the process that reads it first gave no answer within {wall:.0f} s; the machine "
            "may be too busy, so try again"
        )
    if not said:
        return
    for request, line in zip(requests, said[1:]):
        problem = json.loads(line).get("problem", "")
        yield _explained(request, problem) if problem else ""
        if problem:
            return
    if len(said) <= len(requests):
        request = requests[len(said) - 1]
        yield _explained(request, _end(code, complaint, limits_of(request.size())[1]))


def _talk(text: str, wall: float | None) -> tuple[list[str], str, int | None]:
    """Returns the lines that the process says, the end of its standard error, and its exit code; None: it took too
    long."""
    program = [sys.executable or "python3", "-I", "-S", str(Path(__file__).with_name("reader_process.py"))]
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    try:
        process = subprocess.Popen(
            [*program, str(_core.__file__)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env=environment,
        )
    except OSError:
        return [], "", 127  # as a shell says it of a command that cannot be run
    code = None
    try:
        said, complaint = process.communicate(text.encode(), timeout=wall)
        code = process.returncode
    except subprocess.TimeoutExpired:
        process.kill()
        said, complaint = process.communicate()
    except BaseException:
        process.kill()
        process.wait()
        raise
    whole = said.decode("utf-8", "replace").split("\n")[:-1]
    return whole, complaint[-4000:].decode("utf-8", "replace"), code


def _end(code: int | None, complaint: str, seconds: float) -> str:
    """Returns in words how the process ended."""
    too_long = f"takes longer than {seconds:.2g} s to read"
    if code is None:
        return too_long
    try:
        name = signal.Signals(-code).name
    except ValueError:
        name = f"exit code {code}"
    if name == "SIGXCPU":
        return too_long
    if name == "SIGKILL":
        return NO_MEMORY
    failed = re.search(r"Assertion `(.*?)' failed", complaint)
    return f"its reader, assimp, crashes on it ({name}{f', {failed[1]}' if failed else ''})"


def _explained(request: Request, problem: str) -> str:
    """Adds to a problem what to do about it."""
    memory, seconds = limits_of(request.size())
    if problem == NO_MEMORY:
        return (
            f"needs more than {memory / GIB:.3g} GiB of memory to read, so it is probably damaged; if it is large, "
            f"raise the limit with {MEMORY}={2 * memory / GIB:.0f} (GiB) in the environment"
        )
    if problem.startswith("takes longer"):
        return (
            f"{problem}, so it is probably damaged; if it is large, raise the limit with "
            f"{SECONDS}={10 * seconds:.2g} in the environment"
        )
    skin = any(_lacks_bind_matrices(file) for file in request.files)
    why = (
        "; a skin in it has no inverseBindMatrices, which assimp needs"
        if skin
        else "; it is damaged, or has something that assimp cannot read"
    )
    return f"{problem}{why}. Open it in the program that made it, and export it again, for example as OBJ" + (
        " or with inverse bind matrices" if skin else ""
    )


def _lacks_bind_matrices(file: Path) -> bool:
    """Whether a file is glTF with a skin without inverse bind matrices, which glTF allows."""
    if file.suffix.lower() not in (".gltf", ".glb"):
        return False
    with contextlib.suppress(OSError, ValueError, RecursionError):
        text = file.read_bytes()
        if text[:4] == b"glTF":
            text = text[20 : 20 + int.from_bytes(text[12:16], "little")]
        skins = json.loads(text).get("skins", [])
        return any(isinstance(skin, dict) and "inverseBindMatrices" not in skin for skin in skins)
    return False


def of_scene(text: str, folder: Path) -> list[Request]:
    """Returns the requests for the foreign files that the JSON text of a scene names."""
    from ..hints import without_comments

    if not FOREIGN.search(text):
        return []
    try:
        data = json.loads(without_comments(text.lstrip("\ufeff")))
    except (ValueError, RecursionError):
        return []  # the scene's own reader says what is wrong
    found: list[Request] = []
    for kind in ("obstacles", "cloth"):
        entries = data.get(kind) if isinstance(data, dict) else None
        for entry in entries if isinstance(entries, list) else ():
            if isinstance(entry, dict):
                found.extend(of_part(entry, folder))
    return found


def of_part(entry: dict[str, Any], folder: Path) -> Iterator[Request]:
    """Yields the requests for the files of a cloth or an obstacle of a scene."""
    file = entry.get("file")
    named = [file.get("path"), file.get("positions")] if isinstance(file, dict) else [file]
    for name in named:
        if isinstance(name, str) and name:
            yield mesh(folder / name)
    body = entry.get("character")
    if not isinstance(body, dict) or not isinstance(body.get("file"), str):
        return
    with contextlib.suppress(TypeError, ValueError, OverflowError):  # the scene's own reader says what is wrong
        animation = body.get("animation_file")
        if animation is None and morph.is_animated(folder / body["file"], str(body.get("clip", ""))):
            return  # which assimp does not read
        yield character(
            folder / body["file"],
            str(body.get("clip", "")),
            folder / animation if isinstance(animation, str) else "",
            float(body.get("scale", 1)),
            float(body.get("samples_per_second", 60)),
            bool(body.get("y_up", True)),
            float(body.get("lead_in", 0)),
            int(body.get("loops", 1)),
            [str(joint) for joint in body.get("leave_out", [])],
        )
