# SPDX-License-Identifier: Apache-2.0
"""The folder that `dress` writes: garment, body, scene, frames and summary."""

from __future__ import annotations

import contextlib
import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..cli.loop import attributes, prepare
from ..errors import FileError
from ..io.lock import locked
from ..io.recording import NAME as FRAMES
from ..io.recording import Recorder
from ..io.summary import finite
from ..scene import Scene
from ..types import Integers, PathLike, Reals
from .wearer import MESH, entry_in
from .work import STIFFEST

if TYPE_CHECKING:
    from typing_extensions import Self

    from ..simulation import Simulation
    from .result import Dressed

SCENE, SUMMARY = "scene.json", "summary.json"


class Output:
    """Writes the results of `dress` to a folder; a context that keeps other runs out of it."""

    def __init__(self, folder: PathLike) -> None:
        self.folder = Path(folder)
        self._stack = contextlib.ExitStack()
        self._recorder: Any = None

    def __enter__(self) -> Self:
        self._stack.enter_context(locked(self.folder))
        prepare(self.folder, lambda frames, folder: None)
        return self

    def __exit__(self, *problem: object) -> None:
        if self._recorder is not None:
            self._recorder.close()
        self._stack.close()

    def start(self, simulation: Simulation) -> None:
        """Begins the recording with the placed panels."""
        self._recorder = Recorder(self.folder / FRAMES, simulation, attributes(simulation), np.float32)
        self._body = simulation.positions[simulation.cloth_vertex_count :]
        self._recorder.add(0.0, simulation.positions, 0, 0)

    def add(self, time: float, positions: Reals, simulation: Simulation) -> None:
        """Records the panels' vertices, those of a seam at one place once they are joined."""
        every = np.concatenate([positions, self._body])
        self._recorder.add(time, every, simulation.report["contacts"], simulation.count_intersections())

    def finish(self, dressed: Dressed) -> None:
        """Writes garment, body, scene and summary, each completely or not at all."""
        pattern, mesh, verdict = dressed.mesh.pattern, dressed.mesh, dressed.verdict
        body = dressed.wearer
        for garment in (*dressed.under, dressed):
            self._write(_file(garment), _garment_text(garment))
        self._write(MESH, obj_text(body.vertices, body.faces))
        self._write(SCENE, json.dumps(scene_of(dressed, self.folder), indent=2) + "\n")
        fields = {
            "pattern": pattern.name,
            "good": verdict.good,
            "problems": verdict.problems,
            "seam_gap": verdict.seam_gap,
            "joined_gap": verdict.joined_gap,
            "widest_seam": verdict.widest_seam,
            "intersections": verdict.intersections,
            "speed": verdict.speed,
            "max_strain": verdict.max_strain,
            "strained_at": verdict.strained_at,
            "panels": len(pattern.panels),
            "seams": len(pattern.seams),
            "triangles": len(mesh.faces),
            "vertices": len(dressed.positions),
            "edge_length": mesh.edge_length,
            "min_angle": mesh.min_angle(),
            "wall_time": dressed.seconds,
            "sewing_phases": dressed.sewing_phases,
            "draping_phases": dressed.draping_phases,
        }
        self._write(SUMMARY, json.dumps(finite(fields), indent=2, allow_nan=False) + "\n")

    def _write(self, name: str, text: str) -> None:
        path = self.folder / name
        partial = path.with_name(name + ".partial")
        try:
            partial.write_text(text, encoding="utf-8")
            os.replace(partial, path)
        except OSError as problem:
            with contextlib.suppress(OSError):
                partial.unlink()
            raise FileError(f"{path}: writing failed ({problem})") from None


def scene_of(dressed: Dressed, folder: Path) -> dict[str, Any]:
    """Returns what scene.json of a folder says: the garment on the body, in the fabric that it was draped in."""
    scene, body = dressed.scene, dressed.scene.obstacles[0]
    alone = Scene()  # without the body, whose motion would be written out
    cloths = scene.cloths
    for cloth in cloths:
        alone.add_cloth(cloth.vertices, cloth.faces, material=cloth.material)
    first, second = dressed.open_pairs.T
    alone.stitch(len(cloths) - 1, first, len(cloths) - 1, second, stiffness=STIFFEST)
    saved = json.loads(alone.to_json())
    names = ["fabric"] if len(cloths) == 1 else [f"fabric of {cloth.name}" for cloth in cloths]
    moves = bool(dressed.wearer.moving)
    outfit = [garment.mesh.pattern.name for garment in (*dressed.under, dressed)]
    return {
        "name": " and ".join(outfit),
        "description": f"The pattern{'s' * (len(outfit) > 1)} {', '.join(outfit)}, sewn and draped on a body.",
        "frame_time": scene.frame_time if moves else 0.02,
        "frames": scene.frames if moves else 50,
        "materials": {name: entry["material"] for name, entry in zip(names, saved["cloth"])},
        "obstacles": [{"name": "body", **entry_in(dressed.wearer, folder), "friction": body.friction}],
        "cloth": [
            {
                "name": garment.name,
                "file": {"path": _file(garment), "rest": "uv"},
                "material": name,
                **_shrinkage(garment),
            }
            for garment, name in zip((*dressed.under, dressed), names)
        ],
        "stitches": saved.get("stitches", []),
        "elastics": [
            {"cloth": garment.name, **elastic, "vertices": elastic["vertices"].tolist()}
            for garment in (*dressed.under, dressed)
            for elastic in garment.mesh.elastics(garment.vertex_of)
        ],
    }


def _shrinkage(garment: Dressed) -> dict[str, Any]:
    """Returns the key `shrinkage` of a garment's cloth, for its triangles in the order of its file, or nothing."""
    shares = garment.mesh.shrinkage
    if not len(shares):
        return {}
    return {"shrinkage": shares[np.argsort(garment.mesh.panel_of_face, kind="stable")].tolist()}


def _file(garment: Dressed) -> str:
    """Returns the name of a garment's file."""
    return "".join(c if c.isalnum() or c in "-_" else "_" for c in garment.name) + ".obj"


def _garment_text(garment: Dressed) -> str:
    mesh = garment.mesh
    groups = [(panel.name, mesh.panel_of_face == index) for index, panel in enumerate(mesh.pattern.panels)]
    return obj_text(garment.positions, garment.faces, mesh.material, mesh.faces, groups)


def obj_text(
    vertices: Reals,
    faces: Integers,
    material: Reals | None = None,
    material_faces: Integers | None = None,
    groups: Any = (),
) -> str:
    """Returns an OBJ file, z up and in m: texture coordinates are the material space, in m."""
    lines = _rows("v {:.9g} {:.9g} {:.9g}", vertices)
    if material is None or material_faces is None:
        return "\n".join(lines + _rows("f {} {} {}", faces + 1)) + "\n"
    lines += _rows("vt {:.9g} {:.9g}", material)
    corners = np.stack([faces + 1, material_faces + 1], axis=2).reshape(-1, 6)
    for name, chosen in groups:
        lines.append("g " + "_".join(name.split()))
        lines += _rows("f {}/{} {}/{} {}/{}", corners[chosen])
    return "\n".join(lines) + "\n"


def _rows(pattern: str, rows: Reals | Integers) -> list[str]:
    return [pattern.format(*row) for row in rows.tolist()]
