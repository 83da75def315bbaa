# SPDX-License-Identifier: Apache-2.0
"""Rigid bodies: obstacles that gravity, cloth and other obstacles move."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from . import _core
from .arrays import number, reals, vector
from .errors import SceneError
from .hints import similar
from .types import ArrayLike, Reals, VectorLike

__all__ = ["Rigid", "RigidPose"]

ARGUMENTS = ("mass", "density", "center", "inertia", "velocity", "angular_velocity")


class Rigid(_core.Rigid):
    """What makes an obstacle a rigid body, which gravity, cloth and other obstacles move.

    Args:
        mass: Mass, kg; or give `density`.
        density: Density of the solid that the closed mesh bounds, kg/m^3.
        center: Centre of mass [3], m; None: that of the solid.
        inertia: Inertia about the centre of mass along the axes of the scene, kg m^2: a symmetric matrix [3, 3], or its
            values xx, yy, zz, xy, yz, zx [6]; None: that of the solid.
        velocity: Velocity of the centre of mass at the start [3], m/s.
        angular_velocity: Angular velocity at the start [3], rad/s.

    Raises:
        ArrayError: An argument has a wrong type or shape.
        SceneError: The inertia is not symmetric.
    """

    def __init__(
        self,
        mass: float | None = None,
        density: float | None = None,
        center: VectorLike | None = None,
        inertia: ArrayLike | None = None,
        velocity: VectorLike = (0, 0, 0),
        angular_velocity: VectorLike = (0, 0, 0),
    ) -> None:
        super().__init__()
        if mass is not None:
            self.mass = number("rigid: mass", mass)
        if density is not None:
            self.density = number("rigid: density", density)
        if center is not None:
            self.center = vector("rigid: center", center)
        if inertia is not None:
            self.inertia = _symmetric(inertia)
        self.velocity = vector("rigid: velocity", velocity)
        self.angular_velocity = vector("rigid: angular_velocity", angular_velocity)

    @classmethod
    def of(cls, name: str, value: _core.Rigid | Mapping[str, Any]) -> _core.Rigid:
        """Returns a `Rigid`, or that of a dict of its arguments."""
        if isinstance(value, _core.Rigid):
            return value
        if not isinstance(value, Mapping):
            raise SceneError(f"{name}: rigid: {value!r} is neither a cama.Rigid nor a dict with {', '.join(ARGUMENTS)}")
        for key in value:
            if key not in ARGUMENTS:
                known = ", ".join(ARGUMENTS)
                raise SceneError(f"{name}: rigid: {key!r} is not known; there are {known}{similar(key, ARGUMENTS)}")
        return cls(**value)


def _symmetric(inertia: ArrayLike) -> list[float]:
    """Returns xx, yy, zz, xy, yz, zx of an inertia [6] or [3, 3]."""
    if np.ndim(inertia) != 2:
        return reals("rigid: inertia", inertia, (6,)).tolist()
    m = reals("rigid: inertia", inertia, (3, 3))
    if not np.allclose(m, m.T, rtol=0, atol=1e-9 * np.abs(m).max()):
        raise SceneError("rigid: inertia: is not symmetric; give a symmetric matrix, or xx, yy, zz, xy, yz, zx")
    return [m[0, 0], m[1, 1], m[2, 2], m[0, 1], m[1, 2], m[2, 0]]


@dataclass(frozen=True)
class RigidPose:
    """Where a rigid body is and how it moves, as `Simulation.rigid_pose` returns it."""

    center: Reals  #: [3] centre of mass, m
    rotation: Reals  #: [4] since the start: unit quaternion w, x, y, z
    velocity: Reals  #: [3] of the centre of mass, m/s
    angular_velocity: Reals  #: [3] rad/s
    angular_momentum: Reals  #: [3] about the centre of mass, kg m^2/s
    contact_force: Reals  #: [3] of other bodies and obstacles on it, without cloth, mean over the last step, N
