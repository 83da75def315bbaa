# SPDX-License-Identifier: Apache-2.0
"""Every exception that cama throws; all are subclasses of `cama.Error`."""

from ._core import (
    BackendError,
    CollisionError,
    DeviceMemoryError,
    Error,
    FileError,
    MaterialError,
    MeshError,
    SceneError,
    SolverError,
)


class ArrayError(Error, ValueError):
    """An array of the wrong shape or type, or with a value that is not finite; the text names argument and row."""

    __module__ = "cama"


__all__ = [
    "Error",
    "ArrayError",
    "BackendError",
    "CollisionError",
    "DeviceMemoryError",
    "FileError",
    "MaterialError",
    "MeshError",
    "SceneError",
    "SolverError",
]
