# SPDX-License-Identifier: Apache-2.0
"""The scenes that come with cama."""

from __future__ import annotations

import os
from pathlib import Path

from .errors import FileError, SceneError
from .hints import MESHES, mesh_is_no_scene, similar
from .types import PathLike


def folder() -> Path:
    """Returns the folder that holds the shipped scenes and `schema.json`."""
    installed = Path(__file__).parent / "scenes"
    return installed if installed.is_dir() else Path(__file__).parents[3] / "scenes"


def names() -> list[str]:
    """Returns the names of the shipped scenes, sorted."""
    return sorted(p.parent.name for p in folder().glob("*/scene.json"))


def resolve(scene: PathLike) -> Path:
    """Returns the path of a scene given as a folder, a JSON file or the name of a shipped scene.

    Raises FileError; SceneError if `scene` is none of these, or a mesh.
    """
    if not isinstance(scene, (str, os.PathLike)):
        raise SceneError(f"scene: {scene!r} is neither a cama.Scene, a file, a folder nor the name of a shipped scene")
    path = Path(scene)
    if path.suffix.lower() in MESHES and path.is_file():
        raise SceneError(mesh_is_no_scene(path))
    if path.is_file() or (path / "scene.json").is_file():
        return path
    shipped = folder() / str(scene)
    if len(path.parts) == 1 and (shipped / "scene.json").is_file():
        return shipped
    if path.is_dir():
        raise FileError(f"{path}: this folder has no scene.json")
    known = ", ".join(names())
    raise FileError(
        f"{scene}: no such file, folder or shipped scene; shipped scenes: {known}{similar(str(scene), names())}"
    )
