# SPDX-License-Identifier: Apache-2.0
"""Arrays on the device of a simulation, out and in, by DLPack and the CUDA array interface."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from . import _core
from .arrays import reals
from .errors import ArrayError, DeviceArrayError
from .types import Reals

__all__ = ["DeviceArray"]

_HOST, _CUDA, _PINNED, _MANAGED = 1, 2, 3, 13  # kinds of devices of DLPack
_READ_ONLY, _IS_COPY = 1, 2  # flags of DLPack


class DeviceArray:
    """Vectors [n, 3], or [worlds, n, 3], of float64 on the device of a simulation, as they were when they were taken.

    Other libraries read the memory in place: `numpy.asarray` and `numpy.from_dlpack` with the backend "cpu",
    `torch.from_dlpack`, `cupy.from_dlpack`, `cupy.asarray` and `jax.dlpack.from_dlpack` with "cuda". All work of the
    simulation on it is done. The simulation never writes to an array that it has lent: as long as somebody holds the
    array, or what was made of it, later steps use other memory, to which they copy it once. The memory lives as long as
    its last user, also when the simulation is gone.

    The array is read-only. A library that does not know DLPack 1.0, which can say so, gets a copy of its own on the
    device, to which it may write.
    """

    __slots__ = ("_core", "__weakref__")

    #: Type of the numbers.
    dtype = np.dtype(np.float64)

    def __init__(self) -> None:
        raise TypeError("a DeviceArray comes from device_positions, device_velocities or device_forces")

    @classmethod
    def _of(cls, core: _core.LentArray) -> DeviceArray:
        made = cls.__new__(cls)
        made._core = core
        return made

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of vectors, and 3; of `Worlds` the number of worlds before them."""
        return tuple(self._core.shape())

    @property
    def device(self) -> str:
        """The device: "cpu", or "cuda:0" and so on."""
        kind, index = self._core.device()
        return "cpu" if kind == _HOST else f"cuda:{index}"

    def numpy(self) -> Reals:
        """Returns the array on the host: with the backend "cpu" the same memory, read-only, else a copy."""
        return self._core.host_view() if self._on_host else self._core.download().reshape(self.shape)

    @property
    def _on_host(self) -> bool:
        return self._core.device()[0] == _HOST

    def __len__(self) -> int:
        return self.shape[0]

    def __repr__(self) -> str:
        return f"<cama.DeviceArray {list(self.shape)} float64 on {self.device}>"

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Any:
        if not self._on_host:
            raise DeviceArrayError(f"the array is on {self.device}; numpy() copies it to the host")
        view = self._core.host_view()
        if dtype is not None and np.dtype(dtype) != view.dtype:
            if copy is False:
                raise ValueError(f"float64 becomes {np.dtype(dtype)} only by a copy")
            return view.astype(dtype)
        return view.copy() if copy else view

    @property
    def __cuda_array_interface__(self) -> dict[str, Any]:
        if self._on_host:
            raise AttributeError(f"__cuda_array_interface__: the array is on {self.device}")
        return {
            "shape": self.shape,
            "typestr": "<f8",
            "data": (self._core.address(), True),
            "version": 3,
            "strides": None,
            "stream": None,  # nothing is left to wait for
        }

    def __dlpack_device__(self) -> tuple[int, int]:
        return self._core.device()

    def __dlpack__(
        self,
        *,
        stream: Any = None,
        max_version: tuple[int, int] | None = None,
        dl_device: tuple[int, int] | None = None,
        copy: bool | None = None,
    ) -> Any:
        """Returns a capsule of DLPack with the array.

        Args:
            stream: The receiver's stream, which has nothing to wait for: the array was complete when it was made.
            max_version: Newest version that the receiver knows; None: before 1.0.
            dl_device: Device on which it is wanted: the array's own; None: there.
            copy: True: a copy, to which the receiver may write; False: the memory itself; None: the memory itself
                where the receiver knows that it is read-only.

        Raises:
            DeviceArrayError: The array cannot be had like this.
        """
        self._check_stream(stream)
        if dl_device is not None and tuple(int(d) for d in dl_device) != self._core.device():
            raise DeviceArrayError(f"dl_device: the array is on {self.device}; numpy() copies it to the host")
        versioned = max_version is not None and max_version[0] >= 1
        if copy is False and not versioned:
            raise DeviceArrayError(
                "copy: the array is read-only, and DLPack before 1.0 cannot say so; take a copy, or a library that "
                "knows DLPack 1.0"
            )
        if copy or not versioned:
            return self._core.copy().dlpack(versioned, _IS_COPY)
        return self._core.dlpack(versioned, _READ_ONLY)

    def _check_stream(self, stream: Any) -> None:
        if stream is None:
            return
        if self._on_host:
            raise DeviceArrayError(f"stream: {stream!r} given, but memory of the host has none; leave it out")
        if isinstance(stream, bool) or not isinstance(stream, (int, np.integer)) or stream < -1 or stream == 0:
            raise DeviceArrayError(
                f"stream: {stream!r} is no CUDA stream; give None, -1 (not to wait), 1 (the default stream), 2 (that "
                "of the thread) or an address"
            )


def vectors(name: str, value: Any, rows: int, core: _core.Simulation) -> Reals | _core.Received:
    """Returns vectors [rows, 3] of any library: on the host as `arrays.reals`, else as they lie on the device.

    Raises ArrayError.
    """
    if isinstance(value, (np.ndarray, list, tuple)):
        return reals(name, value, (rows, 3))
    kind, index = _device_of(name, value)
    if kind in (_HOST, _PINNED):
        return reals(name, value if hasattr(value, "__array__") else _imported(name, value), (rows, 3))
    return _on_device(name, value, (rows, 3), core)


def spread(value: Any, rows: int) -> Any:
    """Returns one vector [3] of the host as vectors [rows, 3]; anything else as it is."""
    try:
        one = np.shape(value) == (3,) and _device_of("", value)[0] == _HOST
    except (TypeError, ValueError, ArrayError):
        return value
    return np.broadcast_to(np.asarray(value), (rows, 3)) if one else value


def on_host(name: str, value: Any, rows: int, core: _core.Simulation) -> Reals:
    """Returns vectors [rows, 3] of any library on the host. Raises ArrayError."""
    given = vectors(name, value, rows, core)
    if isinstance(given, np.ndarray):
        return given
    return core.download(name, given, rows)


def brought(name: str, value: Any, core: _core.Simulation) -> Any:
    """Returns an array [..., 3] of any library on the host, of whatever shape; what is no array as it is.

    Raises ArrayError.
    """
    if isinstance(value, (np.ndarray, list, tuple)):
        return value
    kind, _ = _device_of(name, value)
    if kind in (_HOST, _PINNED):
        return value if hasattr(value, "__array__") else _imported(name, value)
    shape = tuple(int(n) for n in getattr(value, "shape", ()))
    if len(shape) < 2 or shape[-1] != 3:
        raise ArrayError(f"{name}: shape {list(shape)}, expected [worlds, n, 3]")
    rows = int(np.prod(shape[:-1]))
    return core.download(name, _on_device(name, value, shape, core), rows).reshape(shape)


def _on_device(name: str, value: Any, shape: tuple[int, ...], core: _core.Simulation) -> _core.Received:
    """Takes an array of this shape on the CUDA device of the simulation."""
    kind, index = _device_of(name, value)
    if kind not in (_CUDA, _MANAGED):
        raise ArrayError(f"{name}: is on a device of kind {kind} of DLPack; copy it to the host")
    on_cuda, own_index, queue = core.memory()
    if not on_cuda or (index is not None and index != own_index):
        where = f"cuda:{own_index}" if on_cuda else "the host" if core.backend()[0] == "cpu" else core.backend()[0]
        there = "a CUDA device" if index is None else f"cuda:{index}"
        raise ArrayError(f"{name}: is on {there}, and the simulation computes on {where}; copy it there")
    received = _received(name, value, queue)
    if received.type() not in ("float64", "float32"):
        raise ArrayError(f"{name}: type {received.type()}, expected float64 or float32")
    if received.shape() != list(shape):
        raise ArrayError(f"{name}: shape {received.shape()}, expected {list(shape)}")
    if not received.dense():
        raise ArrayError(f"{name}: its rows are not one after the other in memory; make a contiguous copy")
    return received


def _device_of(name: str, value: Any) -> tuple[int, int | None]:
    """Returns kind and index of the device of an array, as DLPack counts them."""
    if hasattr(value, "__dlpack_device__"):
        try:
            kind, index = value.__dlpack_device__()
        except Exception as problem:
            raise ArrayError(f"{name}: __dlpack_device__: {problem}") from problem
        return int(kind), int(index)
    return (_CUDA, None) if hasattr(value, "__cuda_array_interface__") else (_HOST, 0)


def _imported(name: str, value: Any) -> Any:
    """Returns an array of the host that has no `__array__`."""
    if not hasattr(value, "__dlpack__"):
        return value
    return _asked(name, lambda: np.from_dlpack(value))


def _received(name: str, value: Any, queue: int) -> _core.Received:
    """Takes an array on a CUDA device: its work comes first in the queue or, by the interface alone, is waited for."""
    if hasattr(value, "__dlpack__"):
        return _asked(name, lambda: _core.Received(_capsule(value, queue)))
    return _asked(name, lambda: _of_interface(value, value.__cuda_array_interface__))


def _capsule(value: Any, queue: int) -> Any:
    try:
        return value.__dlpack__(stream=queue, max_version=(1, 0))
    except TypeError:  # of a library from before DLPack 1
        return value.__dlpack__(stream=queue)


def _of_interface(value: Any, interface: dict[str, Any]) -> _core.Received:
    shape, typestr = [int(n) for n in interface["shape"]], interface["typestr"]
    names = {"<f8": "float64", "<f4": "float32"}
    strides, dense = interface.get("strides"), [int(typestr[2:])]
    for n in shape[:0:-1]:
        dense.insert(0, dense[0] * n)
    if strides is not None and list(strides) != dense:
        raise ValueError("its rows are not one after the other in memory; make a contiguous copy")
    return _core.Received(interface["data"][0], shape, names.get(typestr, typestr), value)


def _asked(name: str, ask: Callable[[], Any]) -> Any:
    try:
        return ask()
    except (ArrayError, MemoryError):
        raise
    except Exception as problem:
        raise ArrayError(f"{name}: {type(problem).__name__}: {problem}") from problem
