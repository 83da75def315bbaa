# SPDX-License-Identifier: Apache-2.0
"""Scene files that name USD files, characters, generated bodies and garments, of which the compiled reader knows less.

Meshes of USD files, bodies and garments are handed to the compiled reader written out.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np

from .. import _core
from ..errors import FileError, MaterialError, MeshError, SceneError
from ..hints import brief
from . import characters, generated
from .usd_reader import is_usd, read_usd

WRITTEN_OUT = re.compile(r'"character"|"body"\s*:\s*\{|"(?:drum|coat|trousers)"\s*:')
NAMED = re.compile(r'\.usd[acz]?"', re.IGNORECASE)


def load(path: Path, resolution: int) -> _core.Scene:
    """Loads a scene file, or the scene.json of a folder, as the compiled `Scene.load` does, with USD files."""
    file = path / "scene.json" if path.is_dir() else path
    try:
        text = file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        text = ""  # the compiled reader says what is wrong
    if not NAMED.search(text) and not WRITTEN_OUT.search(text):
        return _core.Scene.load(path, resolution)
    try:
        return parse(text, file.parent, resolution)
    except (SceneError, MaterialError, MeshError) as problem:
        raise type(problem)(f"{file}: {problem}") from None
    except FileError as problem:
        if not str(problem).startswith(("cloth", "obstacles", str(file))):
            _core.Scene.load(path, resolution)  # raises an error that names the part
        raise


def parse(text: str, folder: Path, resolution: int) -> _core.Scene:
    """Makes a scene of JSON text as the compiled `Scene.parse` does, with USD files."""
    if not NAMED.search(text) and not WRITTEN_OUT.search(text):
        return _core.Scene.parse(text, folder, resolution)
    scene = characters.parsed(text)
    if not scene:
        return _core.Scene.parse(text, folder, resolution)
    clearances = characters.take_clearances(scene, folder)
    bodies = characters.write_bodies(scene, folder)
    generated.write_drums(scene, characters.duration(scene))
    scales: dict[int, float] = {}
    for key in ("cloth", "obstacles"):
        entries = scene.get(key)
        for number, entry in enumerate(entries if isinstance(entries, list) else []):
            if isinstance(entry, dict):
                scale = _write_out(f"{key}[{number}]", entry, folder, key == "cloth")
                scales.update({number: scale} if scale else {})
    resolution = generated.write_garments(scene, folder, resolution)
    core = _core.Scene.parse(json.dumps(scene), folder, resolution)
    for number, scale in scales.items():
        core.cloth(number).material_scale = scale
    characters.keep_apart(core, scene, folder, clearances)
    for number, body in bodies.items():
        characters.animate(core.obstacle(number), body)
    return core


def _write_out(where: str, entry: dict[str, Any], folder: Path, is_cloth: bool) -> float:
    """Replaces a USD file in a cloth or an obstacle; returns the length of its texture unit, m, 0: not used."""
    given = entry.get("file", {})
    source = given if isinstance(given, dict) else {"path": given}
    character = entry.get("character", {})
    if isinstance(source.get("positions"), str) and is_usd(source["positions"]):
        raise SceneError(f"{where}.file.positions: a USD file is read as path alone")
    if isinstance(character, dict) and is_usd(character.get("file")):
        _only(f"{where}.character", character, {"file", "scale"}, "a USD file brings its own samples and axes")
        mesh = read_usd(folder / character["file"], animated=True)
        positions = _scale(f"{where}.character", character, "scale") * mesh.positions
        motion = entry.setdefault("motion", {})
        if not isinstance(motion, dict) or "sampled" in motion:
            raise SceneError(f'{where}.motion: has "sampled", but the file brings its own animation')
        if len(positions) > 1:
            motion["sampled"] = {"time": mesh.times.tolist(), "position": [_flat(frame) for frame in positions]}
        entry["mesh"] = {"position": _flat(positions[0]), "face": _flat(mesh.faces)}
        entry.setdefault("source", f"character {character['file']}")
        del entry["character"]
        return 0.0
    if isinstance(character, dict) and characters.is_blended(character, folder):
        characters.write_blended(where, entry, folder)
        return 0.0
    if not is_usd(source.get("path")):
        return 0.0
    keys = {"path", "scale", "weld"} | ({"rest", "material_scale"} if is_cloth else set())
    _only(f"{where}.file", source, keys, "other keys are not for USD files")
    mesh = read_usd(folder / source["path"], textured=is_cloth and source.get("rest") == "uv")
    entry["mesh"] = {
        "position": _flat(_scale(f"{where}.file", source, "scale") * mesh.vertices),
        "face": _flat(mesh.faces),
        **{key: source[key] for key in source if key == "weld"},
    }
    entry.setdefault("source", source["path"])
    del entry["file"]
    return _write_out_rest(f"{where}.file", source, mesh, entry["mesh"]) if is_cloth else 0.0


def _write_out_rest(where: str, source: dict[str, Any], mesh: Any, written: dict[str, Any]) -> float:
    rest = source.get("rest", "start")
    if rest not in ("start", "uv"):
        raise SceneError(f'{where}.rest: {brief(repr(rest))} is neither "start" nor "uv"')
    if rest == "start":
        if "material_scale" in source:
            raise SceneError(f'{where}.material_scale: goes with "rest": "uv" alone')
        return 0.0
    scale = _scale(where, source, "material_scale")
    texture, faces = mesh.rest_texture(f"{where}: {source['path']}")
    written["material_position"], written["material_face"] = _flat(scale * texture), _flat(faces)
    return scale


def _only(where: str, given: dict[str, Any], keys: set[str], reason: str) -> None:
    """Raises SceneError for a key that does not go with USD; remarks, which start with $ or _, do."""
    for key in given:
        if key not in keys and not key.startswith(("$", "_")):
            raise SceneError(f"{where}.{brief(key)}: {reason}; there are {', '.join(sorted(keys))}")


def _scale(where: str, given: dict[str, Any], key: str) -> float:
    value = given.get(key, 1)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 < value < np.inf:
        raise SceneError(f"{where}.{key}: must be a number greater than 0, got {brief(repr(value))}")
    return float(value)


def _flat(values: Any) -> list[Any]:
    return list(np.asarray(values).ravel().tolist())
