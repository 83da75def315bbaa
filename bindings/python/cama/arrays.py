# SPDX-License-Identifier: Apache-2.0
"""Checks that turn what a user passes into arrays that the compiled module can read."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Optional

import numpy as np

from .errors import ArrayError
from .types import Integers, Quaternion, Reals, Vector

_Shape = Sequence[Optional[int]]


def _shape_text(shape: _Shape) -> str:
    return "[" + ", ".join("n" if s is None else str(s) for s in shape) + "]"


def _as_array(name: str, value: object, shape: _Shape) -> Any:
    try:
        array = np.asarray(value)
    except (TypeError, ValueError, RuntimeError, BufferError) as problem:
        raise ArrayError(f"{name}: not an array of shape {_shape_text(shape)}: {problem}") from None
    if array.size == 0 and array.ndim == 1 and len(shape) > 1:
        array = array.reshape([0 if s is None else s for s in shape])
    if array.ndim != len(shape) or any(want not in (None, got) for want, got in zip(shape, array.shape)):
        raise ArrayError(f"{name}: shape {list(array.shape)}, expected {_shape_text(shape)}")
    return array


def reals(name: str, value: object, shape: _Shape, finite: bool = True) -> Reals:
    """Returns `value` as a C-ordered float64 array; a None in `shape` stands for any length."""
    array = _as_array(name, value, shape)
    if array.dtype.kind not in "fiu":
        raise ArrayError(f"{name}: type {array.dtype}, expected numbers (float64)")
    array = np.ascontiguousarray(array, dtype=np.float64)
    if finite and not np.isfinite(array).all():
        row = int(np.argwhere(~np.isfinite(array))[0][0])
        raise ArrayError(f"{name}: row {row} is not finite: {array[row].tolist()}")
    return array


def integers(name: str, value: object, shape: _Shape) -> Integers:
    """Returns `value` as a C-ordered int32 array; floating-point values are an error."""
    array = _as_array(name, value, shape)
    if array.size and array.dtype.kind not in "iu":
        raise ArrayError(f"{name}: type {array.dtype}, expected integers (int32 or int64)")
    limit = np.iinfo(np.int32)
    outside = (array > limit.max) | (array < limit.min) if array.size else np.zeros(0, bool)
    if outside.any():
        row = int(np.argwhere(outside)[0][0])
        raise ArrayError(f"{name}: row {row} is beyond 32 bits: {np.asarray(array[row]).tolist()}")
    return np.ascontiguousarray(array, dtype=np.int32)


def indices(name: str, value: object, count: int) -> Integers:
    """Returns indices [k] below `count` from indices [k], one index, or a mask [count] of booleans."""
    try:
        array = _as_array(name, value, (None,)) if isinstance(value, (list, tuple)) else np.asarray(value)
    except (TypeError, ValueError, RuntimeError, BufferError) as problem:
        if isinstance(problem, ArrayError):
            raise
        raise ArrayError(f"{name}: not indices on the host: {problem}") from None
    if array.dtype.kind == "b":
        if array.shape != (count,):
            raise ArrayError(f"{name}: a mask of shape {list(array.shape)}, expected [{count}], one for each vertex")
        return np.flatnonzero(array).astype(np.int32)
    return integers(name, array.reshape(1) if array.ndim == 0 else array, (None,))


def vector(name: str, value: object) -> Vector:
    """Returns `value` as a tuple of three finite floats."""
    x, y, z = reals(name, value, (3,)).tolist()
    return x, y, z


def quaternion(name: str, value: object) -> Quaternion:
    """Returns `value` as a tuple of four finite floats: w, x, y, z."""
    w, x, y, z = reals(name, value, (4,)).tolist()
    return w, x, y, z


def number(name: str, value: Any) -> float:
    """Returns `value` as a finite float."""
    try:
        result = float(value)
    except (TypeError, ValueError):
        raise ArrayError(f"{name}: {value!r} is not a number") from None
    if not np.isfinite(result):
        raise ArrayError(f"{name}: {result} is not finite")
    return result


def whole(name: str, value: Any) -> int:
    """Returns `value` as an integer of 32 bits."""
    result = number(name, value)
    if result != int(result) or abs(result) > 2**31 - 1:
        raise ArrayError(f"{name}: {value!r} is not a whole number below 2^31")
    return int(result)


def count(name: str, value: Any) -> int:
    """Returns `value` as an integer of 32 bits that is not negative."""
    result = whole(name, value)
    if result < 0:
        raise ArrayError(f"{name} is negative: {result}")
    return result


def plain(value: object) -> Any:
    """Returns arrays and numbers of NumPy as what JSON can hold. Raises TypeError."""
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} {value!r}")
