# SPDX-License-Identifier: Apache-2.0
"""Materials of cloth."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from . import _core
from .arrays import number
from .errors import MaterialError
from .hints import reading
from .types import Description, PathLike

if TYPE_CHECKING:
    from typing_extensions import Self

__all__ = ["Material", "fabrics"]

HINGE_PER_PLATE = 5  # tables of bending hold so many times the stiffness of a plate


def fabrics() -> list[str]:
    """Returns the names of the fabrics that ship with cama."""
    return _core.Material.fabric_names()


class Material(_core.Material):
    """A fabric, in SI units. Make one with `isotropic`, `orthotropic`, `fabric` or `load`, then change its fields.

    Attributes:
        name: Name of the fabric.
        source: Where the numbers come from.
        density: Mass per area, kg/m^2.
        stretching: Stretching stiffness [6, 4], N/m.
        bending: Bending stiffness [3, 5], N m.
        damping: Stiffness damping c of D = -c K, s.
        mass_damping: Mass damping a of D = -a M, 1/s, on the velocity relative to the air (`Wind`; at rest without).
            A swing loses half its amplitude in 1.39 / a; free fall ends at the speed g / a.
        strain_limit: Strain of warp, weft and shear from which stress grows `limit_stiffening` times as fast; 0: none.
        limit_stiffening: That factor, 1 or more.
        yield_curvature: Elastic curvature at which bending becomes plastic, 1/m: what the cloth is bent beyond it
            stays. 0: never.
        hardening: Share of the bending stiffness that is left beyond the yield curvature, 0 or more, below 1.
        friction: Coulomb coefficient of cloth against cloth; -1: the scene's.
        static_friction: The coefficient while cloth sticks; -1: equal to `friction`.
        thickness: Contact thickness, m; 0: the scene's.
        contact_stiffness: Stiffness of the contact penalty, N/m^3; -1: the scene's.
    """

    __slots__ = ()  # a field that is not there is an AttributeError

    @classmethod
    def isotropic(
        cls, youngs_modulus: float, poisson_ratio: float = 0.3, bending: float = 0.0, density: float = 0.2
    ) -> Self:
        """Makes an isotropic fabric.

        Args:
            youngs_modulus: Young's modulus times thickness, N/m.
            poisson_ratio: Poisson's ratio.
            bending: Plate bending stiffness, N m.
            density: Mass per area, kg/m^2.
        """
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
        """Makes an orthotropic fabric.

        Args:
            youngs_warp, youngs_weft: Young's moduli times thickness along warp and weft, N/m.
            poisson_ratio: Poisson's ratio.
            shear: Shear modulus times thickness, N/m.
            bending_warp, bending_weft: Plate bending stiffness along warp and weft, N m.
            density: Mass per area, kg/m^2.
        """
        return cls(
            _core.Material.orthotropic(
                youngs_warp, youngs_weft, poisson_ratio, shear, bending_warp, bending_weft, density
            )
        )

    @classmethod
    def fabric(cls, name: str) -> Self:
        """Returns a shipped fabric, see `cama.fabrics()`. Raises MaterialError."""
        if not isinstance(name, str):
            raise MaterialError(f"material: {name!r} is not the name of a fabric")
        with reading():
            return cls(_core.Material.fabric(name))

    @classmethod
    def load(cls, file: PathLike) -> Self:
        """Reads a JSON file in the format of cama or of ARCSim. Raises FileError, MaterialError."""
        if not isinstance(file, (str, os.PathLike)):
            raise MaterialError(f"material: {file!r} is not the name of a file")
        return cls(_core.Material.load(Path(file)))

    @classmethod
    def of(cls, value: _core.Material | Description | PathLike) -> Self:
        """Returns a Material made from a Material, a fabric's name, a file, or a dict as in scene.json."""
        if isinstance(value, _core.Material):
            return cls(value)
        if isinstance(value, dict):
            with reading():
                return cls(_core.Material.parse(json.dumps(value), value.get("name", "material")))
        if isinstance(value, str):
            return cls.load(value) if value.endswith(".json") else cls.fabric(value)
        if isinstance(value, os.PathLike):
            return cls.load(value)
        raise MaterialError(f"material: {value!r} is neither a name, a file, a dict nor a cama.Material")

    def __repr__(self) -> str:
        warp, _, weft, _ = self.stretching[0]
        plate = np.ravel(self.bending) / HINGE_PER_PLATE
        bending = f"{plate.min():.3g}" if plate.min() == plate.max() else f"{plate.min():.3g} to {plate.max():.3g}"
        return (
            f"<cama.Material {self.name!r}: {self.density:g} kg/m², stretching {warp:.4g} (warp) and {weft:.4g} (weft) "
            f"N/m, plate bending {bending} N m>"
        )

    def with_thickness(self, thickness: float) -> Material:
        """Returns a copy with this contact thickness, m."""
        other = Material(self)
        other.thickness = number("thickness", thickness)
        return other
