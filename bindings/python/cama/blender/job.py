# SPDX-License-Identifier: Apache-2.0
"""Simulates what Blender's add-on has written: python -m cama.blender.job FOLDER.

The folder has job.json and job.npz. Frames go to cloth.pc2, a mesh cache in the space of Blender's object whose header
always counts the frames that are there; standard output has one JSON object a line, which says how far it is.
"""

from __future__ import annotations

import json
import os
import struct
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any

import numpy as np

import cama

from ..types import Reals

CACHE = "cloth.pc2"
HEADER = "<12siiffi"  # of a PC2 file: signature, version, vertices, start, frames a sample, samples


class Cache:
    """A PC2 file that can be read after every frame.

    Args:
        file: The file, which is begun anew.
        to_object: Matrices [frames, 4, 4] from the world, m, to the object's space.
    """

    def __init__(self, file: Path, to_object: Reals) -> None:
        self._to_object, self._frames, self._file = to_object, 0, file
        file.write_bytes(b"")

    def add(self, positions: Reals) -> None:
        """Adds the next frame, positions [vertices, 3] in m."""
        matrix = self._to_object[self._frames]
        self._frames += 1
        with open(self._file, "r+b") as file:
            file.seek(0, os.SEEK_END)
            if not file.tell():
                self._write_header(file, len(positions), 0)
            file.write((positions @ matrix[:3, :3].T + matrix[:3, 3]).astype("<f4").tobytes())
            file.flush()
            self._write_header(file, len(positions), self._frames)

    @staticmethod
    def _write_header(file: IO[bytes], vertices: int, frames: int) -> None:
        file.seek(0)
        file.write(struct.pack(HEADER, b"POINTCACHE2\0", 1, vertices, 0.0, 1.0, frames))


def rotation_of(matrix: Reals) -> tuple[list[float], float] | None:
    """Returns the unit quaternion w, x, y, z and the scale of a matrix [3, 3]; None if it does something else."""
    scale = float(np.cbrt(np.linalg.det(matrix)))
    if not scale > 1e-9 or np.abs(matrix @ matrix.T - scale**2 * np.eye(3)).max() > 1e-5 * scale**2:
        return None
    m = matrix / scale
    # Each row of 4 q q^T is the quaternion times a component; the longest row is the most exact.
    rows = np.array(
        [
            [1 + m[0, 0] + m[1, 1] + m[2, 2], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]],
            [m[2, 1] - m[1, 2], 1 + m[0, 0] - m[1, 1] - m[2, 2], m[0, 1] + m[1, 0], m[0, 2] + m[2, 0]],
            [m[0, 2] - m[2, 0], m[0, 1] + m[1, 0], 1 - m[0, 0] + m[1, 1] - m[2, 2], m[1, 2] + m[2, 1]],
            [m[1, 0] - m[0, 1], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], 1 - m[0, 0] - m[1, 1] + m[2, 2]],
        ]
    )
    row = rows[np.argmax(np.diagonal(rows))]
    return [float(c) for c in row / np.linalg.norm(row)], scale


def motion_of(times: Reals, local: Reals, matrices: Reals) -> tuple[Reals, dict[str, Any] | None]:
    """Returns the start [vertices, 3] of a collider, m, and its motion, as `Scene.add_obstacle` takes it.

    Args:
        times: Times [frames] of the samples, s.
        local: Positions [1 or frames, vertices, 3] in the object's space.
        matrices: Matrices [frames, 4, 4] from there to the world, m.
    """
    world = np.einsum("kij,kvj->kvi", matrices[:1, :3, :3], local[:1])[0] + matrices[0, :3, 3]
    if len(local) == 1 and (matrices == matrices[0]).all():
        return world, None
    if len(local) == 1 and abs(np.linalg.det(matrices[0])) > 0:
        keys: list[dict[str, Any]] = []
        for time, matrix in zip(times, matrices):
            from_start = matrix @ np.linalg.inv(matrices[0])
            turned = rotation_of(from_start[:3, :3])
            if turned is None:
                break
            center = world.mean(axis=0)  # so that a body that turns and moves turns about itself
            shift = from_start[:3, :3] @ center + from_start[:3, 3] - center
            row = {"time": time, "translation": shift, "rotation": turned[0], "scale": turned[1], "center": center}
            keys.append(row)
        if len(keys) == len(times):
            return world, {"keys": keys}
    positions = np.einsum("kij,kvj->kvi", matrices[:, :3, :3], np.broadcast_to(local, (len(times), *local.shape[1:])))
    return world, {"times": times, "positions": positions + matrices[:, None, :3, 3]}


def scene_of(job: dict[str, Any], data: dict[str, Reals]) -> cama.Scene:
    """Returns the Scene of a job."""
    times = np.arange(job["frames"] + 1) / job["fps"]
    scene = cama.Scene(
        gravity=job["gravity"], frames=job["frames"], frame_time=1 / job["fps"], self_contact=job["self_contact"],
        name=job["name"], thickness=job["thickness"] or 1e-3,
    )  # fmt: skip
    rest = {key: data[key] for key in ("material_vertices", "material_faces") if key in data}
    scene.add_cloth(
        data["vertices"], data["faces"], material=job["fabric"], thickness=job["thickness"] or None, name=job["name"],
        **rest,
    )  # fmt: skip
    for index, name in enumerate(job["colliders"]):
        local, matrices, faces = (data[f"collider_{index}_{key}"] for key in ("local", "matrices", "faces"))
        start, motion = motion_of(times, local, matrices)
        scene.add_obstacle(start, faces, motion=motion, friction=job["friction"], name=name)
    return scene


def simulate(folder: Path, say: Callable[..., None]) -> None:
    """Simulates the job of a folder and writes its cache. Raises cama.Error."""
    job = json.loads((folder / "job.json").read_text(encoding="utf-8"))
    with np.load(folder / "job.npz") as file:
        data = dict(file)
    scene = scene_of(job, data)
    simulation = cama.Simulation(scene, accuracy=job["level"], intersections=job["intersections"], pinch=job["pinch"])
    pins, targets = data["pins"], data["pin_positions"]  # [k], [1 or frames, k, 3]
    if len(pins):
        simulation.pin(pins)
    cache = Cache(folder / CACHE, data["to_object"])
    cache.add(simulation.positions[: scene.vertex_count])
    say(frame=0, frames=job["frames"])
    parent = os.getppid()
    for frame in range(1, job["frames"] + 1):
        if len(pins) and len(targets) > 1:
            simulation.set_targets(pins, targets[frame], duration=1 / job["fps"])
        simulation.step_frame()
        cache.add(simulation.positions[: scene.vertex_count])
        say(frame=frame, frames=job["frames"], contacts=simulation.report["contacts"])
        if os.getppid() != parent:
            return  # Blender is gone
    say(done=True, intersections=simulation.count_intersections())


def main(folder: str) -> int:
    """Simulates the job of a folder; returns the exit code."""

    def say(**what: object) -> None:
        print(json.dumps(what), flush=True)

    def note(message: Warning | str, category: type[Warning], *place: object, **more: object) -> None:
        if issubclass(category, cama.PlausibilityWarning):
            say(warning=str(message))

    warnings.showwarning = note
    try:
        simulate(Path(folder), say)
    except cama.Error as problem:
        say(error=f"{type(problem).__name__}: {problem}")
        return 2
    except OSError as problem:
        say(error=f"{problem.filename or folder}: {problem.strerror}")
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
