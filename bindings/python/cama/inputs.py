# SPDX-License-Identifier: Apache-2.0
"""What `Scene.add_cloth` and `Scene.add_obstacle` accept: meshes, shapes and their placement."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from . import _core, hints
from .arrays import integers, number, quaternion, reals, vector
from .errors import ArrayError, MeshError, SceneError
from .io import reading, usd_scene
from .io.usd_reader import is_usd, read_usd
from .types import ArrayLike, Description, Integers, Reals, VectorLike
from .units import METRES, unknown


def placement(transform: ArrayLike | None, translate: VectorLike, rotate: VectorLike, scale: float) -> Reals:
    """Returns the 4x4 matrix of scale, rotation (unit quaternion w, x, y, z) and translation, then `transform`."""
    w, x, y, z = quaternion("rotate", rotate)
    length = math.sqrt(w * w + x * x + y * y + z * z)
    if length == 0:
        raise ArrayError("rotate: a quaternion of length 0")
    w, x, y, z = (c / length for c in (w, x, y, z))
    own = np.eye(4)
    own[:3, :3] = number("scale", scale) * np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    own[:3, 3] = vector("translate", translate)
    if transform is not None:
        own = reals("transform", transform, (4, 4)) @ own
    return own


def file_frame(name: str, mesh: object, units: str, up: str | None) -> tuple[Reals, float]:
    """Returns the matrix [4, 4] from a mesh's own units and axes to metres with z up, and the length of its unit, m.

    mesh: as given to `add_cloth`; None: a generated shape, which is in metres with z up. Raises SceneError.
    """
    if units not in METRES:
        raise SceneError(f"{name}: units: {unknown(units)}")
    if up not in (None, "y", "z"):
        raise SceneError(f'{name}: up: {up!r} is neither "y" nor "z"')
    if mesh is None and (METRES[units] != 1 or up is not None):
        raise SceneError(f"{name}: units and up are for meshes; a generated shape is in metres, with z up")
    ending = Path(mesh).suffix.lower() if isinstance(mesh, (str, os.PathLike)) else ""
    if up is not None and ending in (".glb", ".gltf", ".fbx", ".dae"):
        raise SceneError(
            f"{name}: up: is for OBJ, PLY, STL and arrays; in {ending} y is up, and it is turned already; leave it out"
        )
    if is_usd(mesh) and (METRES[units] != 1 or up is not None):
        raise SceneError(f"{name}: units and up: a USD file says its own, and they are honoured; leave them out")
    frame = np.eye(4)
    if up == "y":
        frame[:3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    frame[:3, :3] *= METRES[units]
    return frame, METRES[units]


def uniform_scale(name: str, surface: str, matrix: Reals) -> float:
    """Returns the scale of a matrix [3, 3] that is a rotation times a scale; an exact obstacle allows no other."""
    scale = np.cbrt(np.linalg.det(matrix))
    if not scale > 0 or np.abs(matrix @ matrix.T - scale**2 * np.eye(3)).max() > 1e-9 * scale**2:
        raise SceneError(
            f"{name}: transform: an exact {surface} can be turned, moved and scaled alike in all directions only"
        )
    return 1.0 if abs(scale - 1) < 1e-12 else float(scale)  # unit quaternions round


def compiled_mesh(
    name: str,
    mesh: Any,
    faces: ArrayLike | None,
    material_vertices: ArrayLike | None,
    material_faces: ArrayLike | None,
    uv: bool = False,
    material_scale: float = 1.0,
) -> tuple[_core.Mesh, str]:
    """Returns the compiled Mesh of a file, of arrays or of an object with `vertices` and `faces`, and its source.

    uv: whether the texture coordinates of a file are the rest shape, in units of `material_scale`, m.
    """
    if isinstance(mesh, (str, os.PathLike)):
        if faces is not None:
            raise SceneError(f"{name}: faces are given beside the file {mesh}")
        if material_vertices is not None or material_faces is not None:
            raise SceneError(
                f"{name}: material_vertices or material_faces are given beside the file {mesh}; pass its vertices and "
                'faces as arrays, or give rest="uv" for its texture coordinates'
            )
        reading.check([reading.mesh(mesh)])
        try:
            return (usd_mesh if is_usd(mesh) else _core.load_mesh)(Path(mesh), 1.0, uv, material_scale), str(mesh)
        except MeshError as problem:
            raise MeshError(f"{name}: {problem}") from None
    if uv:
        raise SceneError(
            f'{name}: rest="uv" takes the texture coordinates of a mesh file, and this is an array or an object; give '
            "the rest shape as material_vertices, in m"
        )
    if faces is None:
        if not (hasattr(mesh, "vertices") and hasattr(mesh, "faces")):
            raise SceneError(f"{name}: neither a file, vertices with faces, nor an object that has both")
        mesh, faces = mesh.vertices, mesh.faces
    if (material_vertices is None) != (material_faces is None):
        if material_faces is not None:
            raise SceneError(f"{name}: material_faces are given without material_vertices")
        material_faces = faces
    vertices = reals(f"{name}: vertices", mesh, (None, 3), finite=False)
    faces = integers(f"{name}: faces", faces, (None, 3))
    if material_vertices is None:
        return _core.Mesh(vertices, faces, np.zeros((0, 2)), np.zeros((0, 3), np.int32)), "arrays"
    material_vertices = reals(f"{name}: material_vertices", material_vertices, (None, 2), finite=False)
    material_faces = integers(f"{name}: material_faces", material_faces, (len(faces), 3))
    return _core.Mesh(vertices, faces, material_vertices, material_faces), "arrays"


def shrinkage_rows(name: str, shrinkage: float | ArrayLike) -> Reals:
    """Returns shrinkage as the compiled module has it: [0, 2] for none, [1, 2] for all triangles, or [m, 2].

    Raises ArrayError.
    """
    where = f"{name}: shrinkage"
    if np.ndim(shrinkage) == 0:
        share = number(where, shrinkage)
        return np.full((1 if share else 0, 2), share)
    return np.atleast_2d(reals(where, shrinkage, (2,) if np.ndim(shrinkage) == 1 else (None, 2)))


def compiled_gas(name: str, gas: float | Mapping[str, float]) -> _core.Gas:
    """Returns the compiled Gas of a pressure, Pa, or of a dict. Raises ArrayError, SceneError."""
    made = _core.Gas()
    for key, value in (gas if isinstance(gas, Mapping) else {"pressure": gas}).items():
        if key not in ("pressure", "volume", "ambient"):
            raise SceneError(f"{name}: gas: unknown key {key!r}; there are pressure, volume, ambient")
        setattr(made, key, number(f"{name}: gas: {key}", value))
    return made


def sampled(faces: Integers, times: Reals, positions: Reals) -> tuple[_core.Mesh, _core.Motion]:
    """Returns the compiled mesh and motion of positions [times, vertices, 3], m, at times, s; one time: at rest."""
    motion = _core.Motion()
    if len(times) > 1:
        motion.set_samples(times, positions)
    return _core.Mesh(positions[0], faces, np.zeros((0, 2)), np.zeros((0, 3), np.int32)), motion


def usd_mesh(file: Path, scale: float, uv: bool, material_scale: float) -> _core.Mesh:
    """Returns the compiled Mesh of a USD file, as `_core.load_mesh` does of other files."""
    read = read_usd(file, textured=uv)
    texture, texture_faces = read.rest_texture(str(file)) if uv else (np.zeros((0, 2)), np.zeros((0, 3), np.int32))
    return _core.Mesh(scale * read.vertices, read.faces, material_scale * texture, texture_faces)


def texture_scale(name: str, rest: str, material_scale: float | None, shape: object) -> float:
    """Returns the length of a texture unit, m, that `rest` and `material_scale` of `add_cloth` mean; 0: not used."""
    if rest not in ("start", "uv"):
        raise SceneError(f'{name}: rest: {rest!r} is neither "start" nor "uv"')
    if rest == "start":
        if material_scale is not None:
            raise SceneError(
                f"{name}: material_scale is the length of a texture unit, and texture coordinates are not the rest "
                'shape; give rest="uv" too, or leave it out'
            )
        return 0.0
    if shape is not None:
        raise SceneError(f'{name}: rest="uv" is for mesh files; a generated shape has a rest shape of its own')
    scale = 1.0 if material_scale is None else number(f"{name}: material_scale", material_scale)
    if not scale > 0:
        raise SceneError(f"{name}: material_scale: must be greater than 0, got {scale:g}; give m for a texture unit")
    return scale


def shape_scene(kind: str, name: str, shape: object) -> _core.Scene:
    """Returns a scene whose one cloth or obstacle is a generated shape, described as in scene.json."""
    if not isinstance(shape, dict):
        raise SceneError(
            f"{name}: shape: {shape!r} is not a dict as in scene.json, for example {{'sphere': {{'radius': 0.25}}}}"
        )
    key = "cloth" if kind == "cloth" else "obstacles"
    text = json.dumps({key: [dict(shape, name=name)]})
    reading.check(reading.of_scene(text, Path(".")))
    with hints.reading():
        return usd_scene.parse(text, Path("."), 0)


def compiled_part(
    kind: str, name: str, mesh: Any, faces: ArrayLike | None, shape: Description | None, *material: Any
) -> tuple[Any, str]:
    """Returns a compiled Cloth or Obstacle with its mesh, and a text that says where the mesh comes from."""
    if (mesh is None) == (shape is None):
        raise SceneError(f"{name}: exactly one of mesh and shape is needed")
    if shape is not None:
        if any(given is not None for given in material[:2]):
            raise SceneError(f"{name}: material_vertices: a generated shape has a rest shape of its own; leave out")
        made = shape_scene(kind, name, shape)
        part = _core.Cloth(made.cloth(0)) if kind == "cloth" else _core.Obstacle(made.obstacle(0))
        return part, part.source
    part = _core.Cloth() if kind == "cloth" else _core.Obstacle()
    part.mesh, source = compiled_mesh(name, mesh, faces, *(material or (None, None)))
    return part, source
