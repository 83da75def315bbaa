# SPDX-License-Identifier: Apache-2.0
"""What error texts add for the reader: similar names, the scene file and part that name a file, how to install."""

from __future__ import annotations

import contextlib
import difflib
import importlib.util
import json
import re
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from .errors import BackendError, FileError, MaterialError, SceneError

MESHES = (".obj", ".ply", ".stl", ".glb", ".gltf", ".fbx", ".dae", ".usd", ".usda", ".usdc", ".usdz")
# Modules and how pip calls them, where that is not the same.
PIP_NAMES = {"imageio_ffmpeg": "imageio-ffmpeg", "pxr": "usd-core", "vtkmodules": "vtk"}


def counted(number: int, noun: str) -> str:
    """Returns "1 cloth", "2 cloths"."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def brief(value: object) -> str:
    """Returns a text as it is, or what Python shows of something else, of at most 60 characters."""
    text = value if isinstance(value, str) else repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def digits(value: float, count: int = 4) -> str:
    """Returns a number of so many significant digits, without an exponent from 1e-4 to 1e6."""
    rounded = float(f"{value:.{count}g}")
    if rounded != 0 and not 1e-4 <= abs(rounded) < 1e6:
        return f"{rounded:g}"
    return f"{rounded:.10f}".rstrip("0").rstrip(".")


def similar(word: str, known: Iterable[str]) -> str:
    """Returns "; did you mean 'cotton'?" for "Cotton", or "" where no known word is like it."""
    names = {name.lower(): name for name in known}
    near = difflib.get_close_matches(str(word).lower(), names, n=1)
    return f"; did you mean {names[near[0]]!r}?" if near else ""


def without_comments(text: str) -> str:
    """Returns JSON text without the comments that scene files may have."""
    return re.sub(r'("(?:\\.|[^"\\])*")|//[^\n]*|/\*.*?\*/', lambda m: m[1] or " ", text, flags=re.S)


@contextlib.contextmanager
def naming_files() -> Iterator[None]:
    """Makes a FileError of what the system says of a name that no file can have, such as one that is too long."""
    try:
        yield
    except OSError as problem:
        if problem.filename is None:  # a pipe, say
            raise
        raise FileError(f"{brief(str(problem.filename))}: {problem.strerror}") from None
    except RuntimeError as problem:  # of the compiled module: "filesystem error: status: REASON [FILE]"
        found = re.match(r"filesystem error: [\w ]+: ([^\[]*) \[(.*)\]", str(problem), re.S)
        if found is None:
            raise
        raise FileError(f"{brief(found[2])}: {found[1]}") from None


@contextlib.contextmanager
def reading(scene: Path | None = None) -> Iterator[None]:
    """Adds to errors of reading a scene: the fabric that was meant, and who names a file that is not there."""
    try:
        yield
    except MaterialError as problem:
        unknown = re.search(r'no fabric "([^"]*)"; there are: ([\w, ]+)', str(problem))
        hint = similar(unknown[1], unknown[2].split(", ")) if unknown else ""
        if not hint:
            raise
        raise MaterialError(f"{problem}{hint}") from None
    except MemoryError:
        raise SceneError(
            f"{'' if scene is None else f'{scene}: '}needs more memory than there is; look for a number that is too "
            "large, of triangles, cells, loops or samples"
        ) from None
    except FileError as problem:
        where = _named_by(scene, str(problem)) if scene is not None else ""
        if not where or str(problem).startswith((f"{scene}:", f"{scene / 'scene.json'}:")):
            raise
        raise FileError(f"{where}: {problem}") from None


def _named_by(scene: Path, text: str) -> str:
    """Returns for example "scene.json: cloth 'skirt'": the part whose file an error text begins with, or ""."""
    file = scene / "scene.json" if scene.is_dir() else scene
    try:
        data = json.loads(without_comments(file.read_text(encoding="utf-8-sig")))
    except (OSError, ValueError):
        return ""

    def names(value: Any) -> bool:
        if isinstance(value, dict):
            return any(names(entry) for entry in value.values())
        if isinstance(value, list):
            return any(names(entry) for entry in value)
        return isinstance(value, str) and value != "" and text.startswith(f"{file.parent / value}: ")

    for key, entries in data.items() if isinstance(data, dict) else ():
        for number, entry in enumerate(entries if isinstance(entries, list) else [entries]):
            if names(entry):
                own = entry.get("name") if isinstance(entry, dict) else None
                return f"{file}: {key}{f' {own!r}' if own else f'[{number}]' if isinstance(entries, list) else ''}"
    return ""


def mesh_is_no_scene(path: Path) -> str:
    """Returns what to do with a mesh where a scene is wanted."""
    return (
        f"{path}: is a mesh, not a scene. Write a scene file beside it, for example scene.json with "
        f'{{"cloth": [{{"file": "{path.name}", "material": "cotton"}}]}}, and give that; in Python, '
        f'Scene().add_cloth("{path}") or add_obstacle'
    )


def require(task: str, *modules: str) -> None:
    """Raises BackendError that says how to install what a task needs, if a module is missing. Nothing is imported."""

    def missing(module: str) -> bool:
        try:
            return importlib.util.find_spec(module) is None
        except (ImportError, ValueError):
            return True

    absent = [PIP_NAMES.get(module, module) for module in modules if missing(module)]
    if absent:
        raise BackendError(
            f"{task} needs {' and '.join(absent)}, not installed here; install with "
            f"`{sys.executable} -m pip install {' '.join(absent)}`"
        )
