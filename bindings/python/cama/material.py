# SPDX-License-Identifier: Apache-2.0
"""What cloth is made of."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Union

from . import _core
from .arrays import number
from .errors import MaterialError
from .types import Description, PathLike

if TYPE_CHECKING:
    from typing_extensions import Self

__all__ = ["Material", "fabrics"]


def fabrics() -> list[str]:
    """Names of the fabrics that ship with cama."""
    return _core.Material.fabric_names()


class Material(_core.Material):
    """A fabric in SI units.

    Fields: name, source, density [kg/m^2], stretching [6, 4] N/m, bending [3, 5] N m, damping [s], friction (-1: the
    scene's), static_friction (-1: equal to it), thickness [m] (0: the scene's) and contact_stiffness [N/m^3] (-1: the
    scene's). Made by `isotropic`, `orthotropic`, `fabric` or `load`; fields may then be changed.
    """

    __slots__ = ()  # a field that is not there is an AttributeError

    @classmethod
    def isotropic(
        cls, youngs_modulus: float, poisson_ratio: float = 0.3, bending: float = 0.0, density: float = 0.2
    ) -> Self:
        """Young's modulus times thickness [N/m], Poisson ratio, plate bending stiffness [N m], density [kg/m^2]."""
        return cls(_core.Material.isotropic(youngs_modulus, poisson_ratio, bending, density))

    @classmethod
    def orthotropic(
        cls,
        youngs_warp: float,
        youngs_weft: float,
        poisson_ratio: float,
        shear: float,
        bending_warp: float,
        bending_weft: float,
        density: float,
    ) -> Self:
        """Moduli times thickness along warp and weft and in shear [N/m], bending along both [N m], density [kg/m^2]."""
        return cls(
            _core.Material.orthotropic(
                youngs_warp, youngs_weft, poisson_ratio, shear, bending_warp, bending_weft, density
            )
        )

    @classmethod
    def fabric(cls, name: str) -> Self:
        """A shipped fabric, see `cama.fabrics()`. Throws MaterialError."""
        return cls(_core.Material.fabric(name))

    @classmethod
    def load(cls, file: PathLike) -> Self:
        """A JSON file in cama's or ARCSim's format. Throws FileError, MaterialError."""
        return cls(_core.Material.load(Path(file)))

    @classmethod
    def of(cls, value: Union[_core.Material, Description, PathLike]) -> Self:
        """A Material from itself, a fabric's name, a file or a dict of fields as in scene.json."""
        if isinstance(value, _core.Material):
            return cls(value)
        if isinstance(value, dict):
            return cls(_core.Material.parse(json.dumps(value), value.get("name", "material")))
        if isinstance(value, str):
            return cls.load(value) if value.endswith(".json") else cls.fabric(value)
        if isinstance(value, os.PathLike):
            return cls.load(value)
        raise MaterialError(f"material: {value!r} is neither a name, a file, a dict nor a cama.Material")

    def with_thickness(self, thickness: float) -> Material:
        """A copy with this contact thickness [m]."""
        other = Material(self)
        other.thickness = number("thickness", thickness)
        return other
