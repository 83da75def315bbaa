# SPDX-License-Identifier: Apache-2.0
"""All exceptions that cama raises; they are subclasses of `cama.Error`."""

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
    """An array of a wrong shape or type, or with a value that is not finite; the text names argument and row."""

    __module__ = "cama"


class DeviceArrayError(BackendError, BufferError):
    """A `DeviceArray` that cannot be handed to another library as it asks for it."""

    __module__ = "cama"


__all__ = [
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
]
