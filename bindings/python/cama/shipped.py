# SPDX-License-Identifier: Apache-2.0
"""The scenes that come with cama."""

from __future__ import annotations

from pathlib import Path

from .errors import FileError
from .types import PathLike


def folder() -> Path:
    """Folder that holds the shipped scenes and `schema.json`."""
    installed = Path(__file__).parent / "scenes"
    return installed if installed.is_dir() else Path(__file__).parents[3] / "scenes"


def names() -> list[str]:
    """Names of the shipped scenes, sorted."""
    return sorted(p.parent.name for p in folder().glob("*/scene.json"))


def resolve(scene: PathLike) -> Path:
    """Path of a scene given as folder, JSON file or shipped name. Throws FileError."""
    path = Path(scene)
    if path.is_file() or (path / "scene.json").is_file():
        return path
    shipped = folder() / str(scene)
    if len(path.parts) == 1 and (shipped / "scene.json").is_file():
        return shipped
    if path.is_dir():
        raise FileError(f"{path}: this folder has no scene.json")
    raise FileError(f"{scene}: no such file, folder or shipped scene; shipped scenes: {', '.join(names())}")
