# SPDX-License-Identifier: Apache-2.0
"""The body that `dress` dresses: still while it is dressed, and moving, if it can, in the scene that comes of it."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..body import Body
from ..errors import SceneError
from ..scene import Scene
from ..types import Integers, Reals

BODY_SIZES = {"m": (0.4, 3.0), "cm": (40.0, 300.0), "mm": (400.0, 3000.0)}  # heights of a body, to tell its unit
CHARACTERS = (".glb", ".gltf", ".fbx", ".dae")
PLAIN = (".obj", ".ply", ".stl")  # that do not say which axis is up


@dataclass(frozen=True)
class Wearer:
    """A body to dress."""

    vertices: Reals  #: [n, 3] m, at time 0
    faces: Integers  #: [m, 3]
    moving: dict[str, Any]  #: arguments of `Scene.add_obstacle` for the body as it moves; empty: it stands still
    entry: dict[str, Any]  #: the same for scene.json, in which its mesh at time 0 is the file MESH
    source: Path | None  #: a file that `entry` names, or None


MESH = "body.obj"


def wearer_of(body: Any, motion: str | None, lead_in: float, units: str | None, up: str) -> Wearer:
    """Returns the body that `dress` is given.

    Args:
        body, motion, lead_in, units: As for `dress`.
        up: The axis that points up in files that do not say it.

    Raises:
        SceneError: The size is not that of a body, or a motion is given to one that has its own.
        FileError, MeshError, ArrayError: As for `Scene.add_obstacle`.
    """
    if isinstance(body, Body):
        if motion is not None:
            raise SceneError("dress: motion: the body has its own; leave it out")
        return _generated(body)
    if isinstance(body, dict):
        arguments: dict[str, Any] = {"shape": body}
    elif isinstance(body, tuple):
        arguments = {"mesh": body[0], "faces": body[1]}
    else:
        arguments = _of_file(body, units, up)
    character = "mesh" in arguments and not isinstance(body, tuple) and Path(body).suffix.lower() in CHARACTERS
    if character and motion is None:
        return _character(Path(body), {**arguments, "lead_in": lead_in})
    if character:
        arguments["clip"] = "bind"
    still = Scene().add_obstacle(**arguments, name="body")
    vertices, faces = np.array(still.vertices), np.array(still.faces)
    if motion is None:
        return Wearer(vertices, faces, {}, {}, None)
    return _generated(Body(motion, mesh=(vertices, faces), lead_in=lead_in))


def _generated(body: Body) -> Wearer:
    entry: dict[str, Any] = {"motion": body.motion, "lead_in": body.lead_in}
    if body.mesh is not None:
        entry["file"] = MESH
        if body.clearance:
            entry["clearance"] = body.clearance
    else:
        entry["triangles"] = body.triangles
        if body.start != "A":
            entry["start"] = body.start
        if body.height is not None:
            entry["height"] = body.height
    if body.period is not None:
        entry["period"] = body.period
    return Wearer(body.vertices, body.faces, {"mesh": body}, {"body": entry}, None)


def _character(file: Path, arguments: dict[str, Any]) -> Wearer:
    """Returns a body of a file with skeletal animation; without one it stands still."""
    made = Scene().add_obstacle(**arguments, name="body")
    vertices, faces = np.array(made.vertices), np.array(made.faces)
    if made.motion.is_rigid:
        return Wearer(vertices, faces, {}, {}, None)
    entry = {"file": str(file), "units": arguments["units"], "lead_in": arguments["lead_in"]}
    return Wearer(vertices, faces, arguments, {"character": entry}, file)


def _of_file(file: Any, units: str | None, up: str) -> dict[str, Any]:
    """Returns the arguments of `add_obstacle` for a file; its unit is told by the height. Raises SceneError."""
    frame: dict[str, Any] = {"up": up} if str(file).lower().endswith(PLAIN) else {}
    if units is not None:
        return {"mesh": file, "units": units, **frame}
    trial = Scene().add_obstacle(file, name="body", **frame)
    height = float(np.ptp(trial.vertices[:, 2]))
    for unit, (low, high) in BODY_SIZES.items():
        if low <= height <= high:
            return {"mesh": file, "units": unit, **frame}
    raise SceneError(
        f"{file}: is {height:g} units high, and no body has that height in {', '.join(BODY_SIZES)}; give units"
    )


def entry_in(wearer: Wearer, folder: Path) -> dict[str, Any]:
    """Returns the entry of scene.json for a body whose mesh at time 0 is the file MESH of the folder."""
    if not wearer.entry:
        return {"file": MESH}
    if wearer.source is None:
        return wearer.entry
    try:
        name = os.path.relpath(wearer.source, folder)
    except ValueError:  # on another drive
        name = str(wearer.source.resolve())
    return {"character": {**wearer.entry["character"], "file": name}}
