# SPDX-License-Identifier: Apache-2.0
"""Parts of scene files that the Python package generates: coats, trousers and drums, which become meshes."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from .. import _core, tailoring
from ..drum import Drum
from ..errors import ArrayError, MeshError, SceneError
from ..hints import similar


def _given(where: str, entry: object, known: tuple[str, ...]) -> dict[str, Any]:
    """Returns the keys of a part without remarks; raises SceneError for one that is not known."""
    if not isinstance(entry, dict):
        raise SceneError(f"{where}: must be an object, got {entry!r}")
    given = {key: value for key, value in entry.items() if not key.startswith(("$", "_"))}
    for key in given:
        if key not in known:
            raise SceneError(f"{where}.{key}: not known; there are {', '.join(known)}{similar(key, known)}")
    return given


def _entries(scene: dict[str, Any], key: str) -> list[Any]:
    entries = scene.get(key)
    return entries if isinstance(entries, list) else []


def write_drums(scene: dict[str, Any], duration: float) -> None:
    """Replaces the drums of a scene by meshes that turn for a time, s. Raises SceneError, ArrayError."""
    for number, entry in enumerate(_entries(scene, "obstacles")):
        if not isinstance(entry, dict) or "drum" not in entry:
            continue
        where = f"obstacles[{number}].drum"
        given = _given(where, entry["drum"], tuple(field.name for field in fields(Drum)))
        if "motion" in entry:
            raise SceneError(f"obstacles[{number}].motion: a drum has its own; leave it out, or give a mesh")
        try:
            drum = Drum(**given)
        except (SceneError, ArrayError) as problem:
            raise type(problem)(f"obstacles[{number}].{problem}".replace(".drum: ", ".drum.", 1)) from None
        vertices, faces = drum.mesh()
        entry["mesh"] = {"position": vertices.ravel().tolist(), "face": faces.ravel().tolist()}
        entry["motion"] = {"keys": drum.keys(duration)}
        entry.setdefault("source", "drum")
        del entry["drum"]


def _garments(scene: dict[str, Any]) -> dict[int, tuple[str, dict[str, Any]]]:
    """Returns kind and fields of each cloth that is a garment of `cama.tailoring`."""
    found = {}
    for number, entry in enumerate(_entries(scene, "cloth")):
        garment = entry.get("garment") if isinstance(entry, dict) else None
        kinds = [kind for kind in tailoring.GARMENTS if isinstance(garment, dict) and kind in garment]
        if not kinds or not isinstance(garment, dict):
            continue
        if len([key for key in garment if not key.startswith(("$", "_"))]) > 1:
            raise SceneError(f"cloth[{number}].garment: more than one of skirt, dress, {', '.join(tailoring.GARMENTS)}")
        kind = kinds[0]
        known = tuple(field.name for field in fields(tailoring.GARMENTS[kind]))
        given = _given(f"cloth[{number}].garment.{kind}", garment[kind], known)
        with _naming(number, kind):
            tailoring.area(kind, given)
        found[number] = kind, given
    return found


@contextlib.contextmanager
def _naming(number: int, kind: str) -> Iterator[None]:
    """Errors of a garment name the cloth."""
    try:
        yield
    except (SceneError, ArrayError, MeshError) as problem:
        raise type(problem)(f"cloth[{number}].garment.{kind}.{problem}") from None


def write_garments(scene: dict[str, Any], folder: Path, resolution: int) -> int:
    """Replaces coats and trousers of a scene, whose bodies are written out, by meshes, and the edges of their pins.

    Returns the resolution that is left for the other cloths. Raises SceneError, ArrayError, MeshError, BackendError
    """
    garments = _garments(scene)
    if not garments:
        return resolution
    total = resolution or scene.get("resolution", 0)
    total = total if isinstance(total, int) else 0
    cloths = _entries(scene, "cloth")
    weights, others = _weights(scene, folder, garments)
    rims: dict[str | int, dict[str, list[int]]] = {}
    for number, (kind, given) in garments.items():
        entry = cloths[number]
        share = weights[number] / (sum(weights.values()) + sum(others.values()))
        wanted = round(total * share) if total else entry.get("triangles", 2000)
        with _naming(number, kind):
            made = tailoring.make(kind, given, wanted)
        entry["mesh"] = {
            "position": made.vertices.ravel().tolist(),
            "face": made.faces.ravel().tolist(),
            "material_position": made.material_vertices.ravel().tolist(),
            "material_face": made.material_faces.ravel().tolist(),
        }
        entry.setdefault("source", kind)
        for key in ("garment", "share", "triangles"):
            entry.pop(key, None)
        rims[number] = rims[entry.get("name", f"cloth {number}")] = {k: v.tolist() for k, v in made.rims.items()}
    _write_edges(scene, rims)
    if not total:
        return 0
    scene.pop("resolution", None)
    return max(1, round(total * sum(others.values()) / (sum(weights.values()) + sum(others.values()))))


def _weights(
    scene: dict[str, Any], folder: Path, garments: dict[int, tuple[str, dict[str, Any]]]
) -> tuple[dict[int, float], dict[int, float]]:
    """Returns the shares of the garments, and of the other cloths that are generated."""
    cloths = _entries(scene, "cloth")
    rest = [n for n in range(len(cloths)) if n not in garments]
    trial = {key: scene[key] for key in ("materials", "obstacles") if key in scene}
    trial["cloth"] = [cloths[n] for n in rest]
    core = _core.Scene.parse(json.dumps(trial), folder, 2000) if rest else None
    others = {}
    for row, number in enumerate(rest):
        entry = cloths[number]
        if core is None or not isinstance(entry, dict) or {"file", "mesh"} & set(entry):
            continue
        if "cells" not in (entry.get("grid") or {}):
            others[number] = entry.get("share", _area(core.cloth(row).mesh))
    return {n: cloths[n].get("share", tailoring.area(*garment)) for n, garment in garments.items()}, others


def _area(mesh: _core.Mesh) -> float:
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def _write_edges(scene: dict[str, Any], rims: dict[str | int, dict[str, list[int]]]) -> None:
    """Replaces the edges that pins of garments name by vertices."""
    for number, pin in enumerate(_entries(scene, "pins")):
        if not isinstance(pin, dict) or pin.get("cloth") not in rims or "edge" not in pin:
            continue
        known = rims[pin["cloth"]]
        if pin["edge"] not in known:
            raise SceneError(f"pins[{number}].edge: {pin['edge']!r}; there are {', '.join(known)}")
        pin["vertices"] = known[pin.pop("edge")]
