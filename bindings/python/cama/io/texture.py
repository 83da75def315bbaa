# SPDX-License-Identifier: Apache-2.0
"""Texture coordinates of cloth: those of its mesh file, else its material space."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from ..errors import Error
from ..inputs import compiled_mesh
from ..parts import Cloth
from ..types import Integers, Reals


@dataclass
class Texture:
    """Texture coordinates of one cloth, with triangles of their own: at a seam a vertex has several."""

    vertices: Reals  #: [k, 2]
    faces: Integers  #: [triangles of the cloth, 3], into `vertices`
    unit: str  #: "1": as in the mesh file; "m": material space, m


def texture_of(cloth: Cloth, folder: Path | None = None) -> Texture | None:
    """Returns the texture coordinates of a cloth; None if it has neither those of a file nor a material space.

    folder: Folder that relative file names of a scene file start at; None: the current one.
    """
    file = Path(folder or "") / cloth.source
    if file.suffix and os.path.isfile(file):
        try:
            mesh, _ = compiled_mesh(cloth.name, file, None, None, None, uv=True)
        except Error:  # a file without texture coordinates
            mesh = None
        if mesh is not None and len(mesh.material_faces) == len(cloth.faces):
            return Texture(mesh.material_vertices, mesh.material_faces, "1")
    if len(cloth.material_faces):
        return Texture(cloth.material_vertices, cloth.material_faces, "m")
    return None
