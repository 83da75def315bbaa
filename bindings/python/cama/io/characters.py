# SPDX-License-Identifier: Apache-2.0
"""Obstacles of scene files that are bodies: characters, whose limbs are kept apart, and generated ones."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from .. import _core
from ..body import Body
from ..clearance import GAP, clear
from ..errors import ArrayError, FileError, MeshError, SceneError
from ..hints import brief, similar, without_comments
from ..plausibility import KEPT_APART
from ..types import Reals
from ..units import METRES, unknown
from . import morph, reading
from .usd_reader import is_usd

BLENDED_NUMBERS = {"scale": 1, "samples_per_second": 60, "lead_in": 0, "loops": 1}
BLENDED_KEYS = ("file", "clip", "units", "y_up", *BLENDED_NUMBERS)
LARGEST = 200_000_000  # numbers of an animation; longer ones stay as they are unless a clearance is given


def parsed(text: str) -> dict[str, Any]:
    """Returns the dict of a scene's JSON text; empty if it is none: the compiled reader says what is wrong."""
    try:
        scene = json.loads(without_comments(text.lstrip("\ufeff")))
    except (ValueError, RecursionError):
        return {}
    return scene if isinstance(scene, dict) else {}


def is_blended(character: dict[str, Any], folder: Path) -> bool:
    """Whether the character of a scene is a file that is animated by morph targets alone."""
    file = character.get("file")
    if not isinstance(file, str) or "animation_file" in character:
        return False
    return morph.is_animated(folder / file, str(character.get("clip", "")))


def write_blended(where: str, entry: dict[str, Any], folder: Path) -> None:
    """Replaces the character of an obstacle, which `is_blended`, by its mesh and the samples of its motion.

    Raises SceneError, FileError
    """
    given = entry["character"]
    for key in given:
        if key not in BLENDED_KEYS and not key.startswith(("$", "_")):
            why = "needs a skeleton, and the file has morph targets alone" if key == "leave_out" else "not known"
            raise SceneError(f"{where}.character.{brief(key)}: {why}; there are {', '.join(BLENDED_KEYS)}")
    units, y_up = given.get("units", "m"), given.get("y_up", True)
    if units not in METRES:
        raise SceneError(f"{where}.character.units: {unknown(units)}")
    if not isinstance(y_up, bool):
        raise SceneError(f"{where}.character.y_up: {brief(repr(y_up))} is neither true nor false")
    numbers = {key: given.get(key, otherwise) for key, otherwise in BLENDED_NUMBERS.items()}
    for key, value in numbers.items():
        fits = isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) < np.inf
        if not fits or (key == "loops" and not isinstance(value, int)) or (key == "scale" and not value > 0):
            raise SceneError(
                f"{where}.character.{key}: {brief(repr(value))} does not fit; give a number such as {numbers[key]}"
            )
    motion = entry.setdefault("motion", {})
    if not isinstance(motion, dict) or "sampled" in motion:
        raise SceneError(f'{where}.motion: has "sampled", but the file brings its own animation')
    read = morph.read(
        folder / given["file"],
        str(given.get("clip", "")),
        float(numbers["samples_per_second"]),
        y_up,
        float(numbers["lead_in"]),
        numbers["loops"],
    )
    positions = float(numbers["scale"]) * METRES[units] * read.positions
    if len(positions) > 1:
        motion["sampled"] = {"time": read.times.tolist(), "position": [rows.ravel().tolist() for rows in positions]}
    entry["mesh"] = {"position": positions[0].ravel().tolist(), "face": read.faces.ravel().tolist()}
    entry.setdefault("source", f"character {given['file']}")
    del entry["character"]


def take_clearances(scene: dict[str, Any], folder: Path) -> dict[int, float | None]:
    """Removes `clearance` from the characters of a scene, which the compiled reader does not know.

    Returns the clearance of each obstacle that is a character, m; None: the default. Raises SceneError.
    """
    found: dict[int, float | None] = {}
    entries = scene.get("obstacles")
    for number, entry in enumerate(entries if isinstance(entries, list) else []):
        character = entry.get("character") if isinstance(entry, dict) else None
        if not isinstance(character, dict) or not isinstance(character.get("file"), str):
            continue
        found[number] = None
        if "clearance" in character:
            value = character.pop("clearance")
            if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 <= value < np.inf:
                raise SceneError(
                    f"obstacles[{number}].character.clearance: must be a distance in m, 0 to leave the motion as it "
                    f"is, got {brief(repr(value))}"
                )
            found[number] = float(value)
        still = is_usd(character["file"]) or "motion" in entry or is_blended(character, folder)
        if still and found.pop(number):
            raise SceneError(
                f"obstacles[{number}].character.clearance: is for skeletons of glTF, FBX and DAE files without "
                "another motion"
            )
    return found


def keep_apart(core: _core.Scene, scene: dict[str, Any], folder: Path, clearances: dict[int, float | None]) -> None:
    """Keeps the limbs of the characters of a compiled scene apart."""
    for number, gap in clearances.items():
        entry = scene["obstacles"][number]
        request = next((r for r in reading.of_part(entry, folder) if r.function == "load_character"), None)
        if request is None:
            continue
        file, clip, animation, *how = request.arguments
        keep_limbs_apart(core.obstacle(number), (Path(file), clip, Path(animation) if animation else "", *how), gap)


def keep_limbs_apart(obstacle: _core.Obstacle, arguments: tuple[Any, ...], gap: float | None) -> None:
    """Keeps the limbs of an obstacle apart, in place, and says so in its `source`.

    Args:
        obstacle: The obstacle, placed in the scene.
        arguments: Those of `_core.load_character` that it was read with.
        gap: Distance, m; None: the default, 0: nothing is moved.
    """
    file, clip, _, unit, rate, y_up, lead_in, loops, leave_out = arguments
    if clip == "bind" or gap == 0:
        return
    try:
        character = _core.load_character(*arguments)
        bind = _core.load_character(file, "bind", Path(), unit, rate, y_up, 0.0, 1, leave_out).mesh
    except FileError:
        return  # it stands still
    mesh = obstacle.mesh
    times = _sample_times(character.duration, rate, lead_in, loops)
    if len(bind.vertices) != len(mesh.vertices) or len(times) < 2:
        return
    if gap is None and mesh.vertices.size * len(times) > LARGEST:
        return
    positions = np.stack([obstacle.motion.evaluate(time, mesh.vertices) for time in times])
    scale = _size(mesh.vertices) / max(_size(character.mesh.vertices), 1e-30)  # of its units and its placement
    cleared = clear(scale * bind.vertices, mesh.faces, times, positions, GAP if gap is None else gap, lead_in > 0)
    if not cleared.vertices:
        return
    motion = _core.Motion()
    motion.set_samples(times, cleared.positions)
    obstacle.motion = motion
    obstacle.mesh = _core.Mesh(cleared.positions[0], mesh.faces, mesh.material_vertices, mesh.material_faces)
    obstacle.source += (
        f"; {cleared.vertices:,} of {len(mesh.vertices):,} vertices are moved by up to "
        f"{1e3 * cleared.largest:.0f} mm in {cleared.frames} of {len(times)} samples, {KEPT_APART}"
    )


def _size(vertices: Reals) -> float:
    """Returns the root mean square distance of vertices from their mean."""
    return float(np.sqrt(((vertices - vertices.mean(axis=0)) ** 2).sum(axis=1).mean()))


def _sample_times(duration: float, rate: float, lead_in: float, loops: int) -> Reals:
    """Returns the times at which the compiled reader samples a clip, s."""
    lead = max(1, int(np.ceil(lead_in * rate))) if lead_in > 0 else 0
    length = (duration - max(lead_in, 0.0)) / max(loops, 1)
    count = max(1, int(np.ceil(length * rate - 1e-9)))
    starts = np.linspace(0, max(lead_in, 0.0), lead + 1)[:-1] if lead else np.zeros(0)
    clip = np.arange(count * max(loops, 1) + 1) * (length / count)
    return np.concatenate([starts, max(lead_in, 0.0) + clip])


BODY_KEYS = (
    "motion",
    "height",
    "triangles",
    "duration",
    "lead_in",
    "start",
    "period",
    "samples_per_second",
    "file",
    "clearance",
)


def write_bodies(scene: dict[str, Any], folder: Path) -> dict[int, Body]:
    """Replaces the bodies that `Body` makes by their meshes; returns the body of each such obstacle.

    Files of meshes are relative to the folder. Raises SceneError, ArrayError, FileError, MeshError, BackendError.
    """
    bodies: dict[int, Body] = {}
    entries = scene.get("obstacles")
    for number, entry in enumerate(entries if isinstance(entries, list) else []):
        if not isinstance(entry, dict) or not isinstance(entry.get("body"), dict):
            continue
        given = {key: value for key, value in entry["body"].items() if not key.startswith(("$", "_"))}
        for key in given:
            if key not in BODY_KEYS:
                raise SceneError(
                    f"obstacles[{number}].body.{brief(key)}: not known; there are {', '.join(BODY_KEYS)}"
                    f"{similar(key, BODY_KEYS)}"
                )
        given.setdefault("duration", duration(scene))
        file = given.pop("file", None)
        if file is not None:
            if not isinstance(file, str):
                raise SceneError(f"obstacles[{number}].body.file: {brief(repr(file))} is not the name of a mesh file")
            given["mesh"] = folder / file
        try:
            body = Body(**given)
        except (SceneError, ArrayError, MeshError, FileError) as problem:
            text = str(problem)
            if not text.startswith("body: "):  # of the mesh
                text = f"body: file: {text}"
            raise type(problem)(f"obstacles[{number}].{text}".replace(".body: ", ".body.", 1)) from None
        bodies[number] = body
        entry["mesh"] = {"position": body.vertices.ravel().tolist(), "face": body.faces.ravel().tolist()}
        entry.setdefault("source", f"generated body, {body.motion}" if file is None else f"{file}, {body.motion}")
        del entry["body"]
    return bodies


def duration(scene: dict[str, Any]) -> float:
    """Returns the length of a scene, s, or that of one second where it has none yet."""
    frames, frame_time = scene.get("frames", 100), scene.get("frame_time", 0) or scene.get("time_step", 0) or 1 / 60
    if not isinstance(frames, (int, float)) or not isinstance(frame_time, (int, float)):
        return 1.0  # the compiled reader says what is wrong
    return float(frames * frame_time) if 0 < frames * frame_time < 1e4 else 1.0


def animate(obstacle: _core.Obstacle, body: Body) -> None:
    """Gives an obstacle of a scene, which has the mesh of a body, the body's animation."""
    at_start = np.column_stack([body.vertices, np.ones(len(body.vertices))])
    place = np.linalg.lstsq(at_start, obstacle.mesh.vertices, rcond=None)[0]  # [4, 3], where the scene puts it
    motion = obstacle.motion
    motion.set_samples(body.times, body.positions @ place[:3] + place[3])
    obstacle.motion = motion
