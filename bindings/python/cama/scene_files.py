# SPDX-License-Identifier: Apache-2.0
"""Scenes in files and as JSON text."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path

from . import _core, shipped
from .arrays import count, plain
from .errors import FileError, SceneError
from .hints import reading
from .io import reading as guard
from .io import usd_scene
from .types import Description, PathLike


def load(scene: PathLike, resolution: int) -> tuple[_core.Scene, Path]:
    """Returns a compiled scene and the folder that its file names start at; the arguments are those of `Scene.load`."""
    path = shipped.resolve(scene)
    file = path / "scene.json" if path.is_dir() else path
    with reading(path):
        with contextlib.suppress(OSError):
            guard.check(guard.of_scene(file.read_text(encoding="utf-8", errors="replace"), file.parent))
        return usd_scene.load(path, count("resolution", resolution)), file.parent


def parse(text: str | Description, folder: Path, resolution: int) -> _core.Scene:
    """Returns a compiled scene; the arguments are those of `Scene.parse`."""
    try:
        text = text if isinstance(text, str) else json.dumps(text, default=plain)
    except (TypeError, ValueError) as problem:
        raise SceneError(f"not what JSON can hold: {problem}") from None
    with reading():
        guard.check(guard.of_scene(text, folder))
        return usd_scene.parse(text, folder, count("resolution", resolution))


def save(path: PathLike, text: str) -> None:
    """Writes the JSON text of a scene to a file. Raises FileError."""
    try:
        Path(path).write_text(text, encoding="utf-8")
    except OSError as problem:
        raise FileError(f"{path}: {problem.strerror}") from None
