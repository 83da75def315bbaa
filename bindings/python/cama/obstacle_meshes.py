# SPDX-License-Identifier: Apache-2.0
"""Meshes of obstacles with their motion: of characters, morph targets, USD files, bodies, arrays and shapes."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from . import _core
from .arrays import number, whole
from .body import Body
from .errors import FileError, SceneError
from .inputs import compiled_mesh, compiled_part, sampled
from .io import morph
from .io import reading as guard
from .io.usd_reader import is_usd, read_usd
from .types import ArrayLike, Description, PathLike

ANIMATED = {".glb", ".gltf", ".fbx", ".dae"}


@dataclass(frozen=True)
class Playback:
    """How the animation of a file is read; the fields are arguments of `Scene.add_obstacle`."""

    clip: str
    animation: PathLike | None
    samples_per_second: float
    y_up: bool
    lead_in: float
    loops: int
    leave_out: Sequence[str]
    clearance: float | None

    def character_arguments(self, name: str) -> tuple[Any, ...]:
        """Returns the arguments of `_core.load_character` after the scale. Raises ArrayError."""
        return (
            number(f"{name}: samples_per_second", self.samples_per_second),
            bool(self.y_up),
            number(f"{name}: lead_in", self.lead_in),
            whole(f"{name}: loops", self.loops),
            list(self.leave_out),
        )


def mesh_and_motion(
    obstacle: _core.Obstacle,
    mesh: Any,
    faces: ArrayLike | None,
    shape: Description | None,
    moved: bool,
    playback: Playback,
) -> tuple[_core.Mesh, _core.Motion, tuple[Any, ...]]:
    """Returns the mesh and the motion of an obstacle before its placement, and how a character was read; (): none was.

    Sets the obstacle's source, and the shape and radius of an exact one.

    Args:
        obstacle: Has its name.
        mesh, faces, shape: As given to `Scene.add_obstacle`.
        moved: Whether the obstacle is given a motion, in place of a file's own animation.
        playback: How the animation of a file is read.
    """
    name, clip, animation, gap = obstacle.name, playback.clip, playback.animation, playback.clearance
    from_file = not moved and isinstance(mesh, (str, os.PathLike))
    if playback.leave_out and not (from_file and _animated(mesh)):
        raise SceneError(f"{name}: leave_out: needs a character, a glTF, FBX or DAE file without another motion")
    if gap is not None and gap < 0:
        raise SceneError(f"{name}: clearance: must be a distance in m, 0 to leave the motion as it is, got {gap:g}")
    if from_file and animation is None and morph.is_animated(mesh, clip):
        if playback.leave_out or gap:
            raise SceneError(f"{name}: leave_out and clearance need a skeleton, and {mesh} has morph targets alone")
        obstacle.source = str(mesh)
        rate, y_up, lead_in, loops, _ = playback.character_arguments(name)
        blended = morph.read(Path(mesh), clip, rate, y_up, lead_in, loops)
        return *sampled(blended.faces, blended.times, blended.positions), ()
    if from_file and (animation is not None or _animated(mesh)):
        how = playback.character_arguments(name)
        character = _character(mesh, clip, animation, *how)
        obstacle.source = str(mesh) + (morph.REMARK if morph.stay_at_rest(mesh, clip) else "")
        arguments = (Path(str(mesh)), clip, "" if animation is None else Path(animation), 1.0, *how)
        return character.mesh, character.motion, arguments
    if gap:
        raise SceneError(f"{name}: clearance: needs a character, a glTF, FBX or DAE file without another motion")
    if not moved and is_usd(mesh):
        if clip not in ("", "bind") or playback.lead_in or playback.loops != 1:
            raise SceneError(f"{name}: clip, lead_in and loops are for glTF, FBX and DAE; a USD file has one animation")
        read = read_usd(mesh, animated=clip != "bind")
        obstacle.source = str(mesh)
        return *sampled(read.faces, read.times, read.positions), ()
    if isinstance(mesh, Body) and not moved:
        obstacle.source = f"generated body, {mesh.motion}"
        return compiled_mesh(name, mesh, None, None, None)[0], _core.Motion(mesh.animation()), ()
    part, obstacle.source = compiled_part("obstacle", name, mesh, faces, shape)
    if part.shape != "mesh":
        obstacle.shape, obstacle.radius = part.shape, part.radius
    return part.mesh, part.motion, ()


def joint_names(what: str, names: Sequence[str]) -> list[str]:
    """The names as a list. Raises SceneError if they are one text or hold something else."""
    if isinstance(names, str) or not isinstance(names, Iterable) or not all(isinstance(n, str) for n in names):
        raise SceneError(f"{what}: {names!r} is not a list of names of joints, such as ['left_arm', 'right_arm']")
    return list(names)


def _animated(file: PathLike) -> bool:
    """Whether a file has one of the formats that can hold skeletal animation."""
    return Path(file).suffix.lower() in ANIMATED


def _character(file: PathLike, clip: str, animation: PathLike | None, *how: Any) -> _core.Character:
    """Loads a character; a file without animation, of which no clip is asked for, stands still. Raises FileError."""
    try:
        return _guarded_character(file, clip, "" if animation is None else animation, 1.0, *how)
    except FileError:
        if clip or animation is not None:
            raise
    return _guarded_character(file, "bind", "", 1.0, *how)


def _guarded_character(file: PathLike, clip: str, animation: PathLike, *how: Any) -> _core.Character:
    guard.check([guard.character(file, clip, animation, *how)])
    return _core.load_character(Path(file), clip, Path(animation) if animation else "", *how)
