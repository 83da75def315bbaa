# SPDX-License-Identifier: Apache-2.0
"""Names of types that the annotations of this package use."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any, Literal, Protocol, Union

import numpy as np
import numpy.typing as npt

Reals = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int32]
Booleans = npt.NDArray[np.bool_]
#: An array, or lists or tuples of numbers.
ArrayLike = Union[npt.ArrayLike, Sequence[Any]]
#: Three numbers.
VectorLike = Union[Sequence[float], npt.NDArray[Any]]
Vector = tuple[float, float, float]
#: w, x, y, z.
Quaternion = tuple[float, float, float, float]
PathLike = Union[str, "os.PathLike[str]"]
#: A unit of length.
Unit = Literal["m", "metre", "cm", "centimetre", "mm", "millimetre", "in", "inch", "ft", "foot"]
#: A dict as in scene.json.
Description = dict[str, Any]


class MeshLike(Protocol):
    """What has `vertices` [n, 3], m, and `faces` [m, 3], such as a mesh of trimesh."""

    @property
    def vertices(self) -> Any: ...

    @property
    def faces(self) -> Any: ...
