# SPDX-License-Identifier: Apache-2.0
"""Checks that turn what a user passes into arrays the compiled part can read."""

import numpy as np

from .errors import ArrayError


def _shape_text(shape):
    return "[" + ", ".join("n" if s is None else str(s) for s in shape) + "]"


def _as_array(name, value, shape):
    try:
        array = np.asarray(value)
    except (TypeError, ValueError) as problem:
        raise ArrayError(f"{name}: not an array of shape {_shape_text(shape)}: {problem}") from None
    if array.size == 0 and array.ndim == 1 and len(shape) > 1:
        array = array.reshape([0 if s is None else s for s in shape])
    if array.ndim != len(shape) or any(want not in (None, got) for want, got in zip(shape, array.shape)):
        raise ArrayError(f"{name}: shape {list(array.shape)}, expected {_shape_text(shape)}")
    return array


def reals(name, value, shape, finite=True):
    """`value` as a C-ordered float64 array of this shape; None in `shape` is any length."""
    array = _as_array(name, value, shape)
    if array.dtype.kind not in "fiu":
        raise ArrayError(f"{name}: type {array.dtype}, expected numbers (float64)")
    array = np.ascontiguousarray(array, dtype=np.float64)
    if finite and not np.isfinite(array).all():
        row = int(np.argwhere(~np.isfinite(array))[0][0])
        raise ArrayError(f"{name}: row {row} is not finite: {array[row].tolist()}")
    return array


def integers(name, value, shape):
    """`value` as a C-ordered int32 array of this shape; floating-point values are refused."""
    array = _as_array(name, value, shape)
    if array.size and array.dtype.kind not in "iu":
        raise ArrayError(f"{name}: type {array.dtype}, expected integers (int32 or int64)")
    limit = np.iinfo(np.int32)
    outside = (array > limit.max) | (array < limit.min) if array.size else np.zeros(0, bool)
    if outside.any():
        row = int(np.argwhere(outside)[0][0])
        raise ArrayError(f"{name}: row {row} is beyond 32 bits: {np.asarray(array[row]).tolist()}")
    return np.ascontiguousarray(array, dtype=np.int32)


def vector(name, value, length=3):
    """`value` as a tuple of finite floats."""
    return tuple(float(x) for x in reals(name, value, (length,)))


def number(name, value):
    """`value` as one finite float."""
    try:
        result = float(value)
    except (TypeError, ValueError):
        raise ArrayError(f"{name}: {value!r} is not a number") from None
    if not np.isfinite(result):
        raise ArrayError(f"{name}: {result} is not finite")
    return result


def whole(name, value):
    """`value` as one int of 32 bits."""
    result = number(name, value)
    if result != int(result) or abs(result) > 2**31 - 1:
        raise ArrayError(f"{name}: {value!r} is not a whole number below 2^31")
    return int(result)


def count(name, value):
    """`value` as one int of 32 bits, not below 0."""
    result = whole(name, value)
    if result < 0:
        raise ArrayError(f"{name} is negative: {result}")
    return result


def plain(value):
    """NumPy's arrays and numbers as what JSON can hold. Throws TypeError."""
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} {value!r}")
