# SPDX-License-Identifier: Apache-2.0
"""cama: cloth simulation with implicit integration and exact contact, on CPUs and GPUs.

scene = cama.Scene()
sheet = scene.add_cloth("sheet.obj", material="cotton", thickness=1e-3)
scene.add_obstacle("walk.glb")
scene.pin(sheet, vertices=[0, 1])
for frame in cama.Simulation(scene).frames(240):
    print(frame.index, frame.contacts, frame.intersections)
"""

import importlib
import os
from typing import TYPE_CHECKING

# Threads that wait for each other spin for a moment, then sleep: on a shared machine they would otherwise starve each
# other.
os.environ.setdefault("GOMP_SPINCOUNT", "20000")  # before the compiled module starts them

from . import collision, shipped  # noqa: E402
from ._core import __version__, accuracy_levels  # noqa: E402
from ._core import list_backends as backends  # noqa: E402
from .body import Body  # noqa: E402
from .device_arrays import DeviceArray  # noqa: E402
from .errors import (
    ArrayError,
    BackendError,
    CollisionError,
    DeviceArrayError,
    DeviceMemoryError,
    Error,
    FileError,
    MaterialError,  # noqa: E402
    MeshError,
    SceneError,
    SolverError,
)
from .material import Material, fabrics  # noqa: E402
from .motion import Motion  # noqa: E402
from .options import option_table  # noqa: E402
from .plausibility import PlausibilityWarning  # noqa: E402
from .rigid import Rigid, RigidPose  # noqa: E402
from .scene import Cloth, Obstacle, Scene  # noqa: E402
from .simulation import Frame, GasState, Simulation, Wrench  # noqa: E402
from .worlds import Worlds  # noqa: E402

scenes = shipped.names

__all__ = [
    "Scene",
    "Cloth",
    "Obstacle",
    "Body",
    "Material",
    "Motion",
    "Rigid",
    "RigidPose",
    "Simulation",
    "Frame",
    "GasState",
    "Wrench",
    "Worlds",
    "DeviceArray",
    "SewingPattern",
    "accuracy",
    "accuracy_levels",
    "backends",
    "collision",
    "dataset",
    "dress",
    "fabric",
    "fabrics",
    "option_table",
    "record",
    "scenes",
    "shipped",
    "tradeoff",
    "tune",
    "__version__",
    "Error",
    "ArrayError",
    "BackendError",
    "CollisionError",
    "DeviceArrayError",
    "DeviceMemoryError",
    "FileError",
    "MaterialError",
    "MeshError",
    "SceneError",
    "SolverError",
    "PlausibilityWarning",
]

if TYPE_CHECKING:
    from . import dataset, fabric
    from .measuring import accuracy, tradeoff, tune
    from .recording import record
    from .sewing import SewingPattern, dress
else:
    _ON_FIRST_USE = {
        "accuracy": "measuring.accuracy",
        "dataset": "dataset",
        "fabric": "fabric",
        "tradeoff": "measuring.tradeoff",
        "tune": "measuring.tune",
    }
    _FUNCTIONS_ON_FIRST_USE = {"record": "recording", "SewingPattern": "sewing", "dress": "sewing"}

    def __getattr__(name):
        """Tools for measurements and recordings are loaded when they are first asked for."""
        if name in _ON_FIRST_USE:
            found = importlib.import_module(f"{__name__}.{_ON_FIRST_USE[name]}")
        elif name in _FUNCTIONS_ON_FIRST_USE:
            found = getattr(importlib.import_module(f"{__name__}.{_FUNCTIONS_ON_FIRST_USE[name]}"), name)
        else:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        globals()[name] = found
        return found


def __dir__() -> list[str]:
    return sorted(__all__)
