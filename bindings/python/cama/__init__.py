# SPDX-License-Identifier: Apache-2.0
"""cama: cloth simulation with implicit integration and exact contact, on CPUs and GPUs.

    scene = cama.Scene()
    sheet = scene.add_cloth("sheet.obj", material="cotton", thickness=1e-3)
    scene.add_obstacle("walk.glb")
    scene.pin(sheet, vertices=[0, 1])
    for frame in cama.Simulation(scene).frames(240):
        print(frame.index, frame.contacts, frame.intersections)
"""

import os as _os

# Threads that wait for each other spin for a moment, then sleep: on a shared machine they would otherwise starve each other.
_os.environ.setdefault("GOMP_SPINCOUNT", "20000")

from . import collision, shipped  # noqa: E402
from ._core import __version__, accuracy_levels, list_backends as backends
from .errors import (ArrayError, BackendError, CollisionError, DeviceMemoryError, Error, FileError, MaterialError,
                     MeshError, SceneError, SolverError)
from .material import Material, fabrics
from .motion import Motion
from .scene import Cloth, Obstacle, Scene
from .simulation import Frame, Simulation
from . import accuracy, tradeoff, tune  # noqa: E402

scenes = shipped.names

__all__ = ["Scene", "Cloth", "Obstacle", "Material", "Motion", "Simulation", "Frame", "accuracy", "accuracy_levels", "collision", "tradeoff", "tune",
           "backends", "fabrics",
           "scenes", "Error", "ArrayError", "BackendError", "CollisionError", "DeviceMemoryError", "FileError",
           "MaterialError", "MeshError", "SceneError", "SolverError"]
