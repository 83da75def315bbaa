# SPDX-License-Identifier: Apache-2.0
"""The tests of one fabric, beside closed forms and published values."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from ..arrays import count
from ..errors import ArrayError
from ..hints import similar
from ..material import Material
from . import bending, draping, shear, stretching
from .published import Published, published
from .specimens import DIRECTIONS

TESTS = {
    "cantilever": "ASTM D1388: bending length at 41.5 degrees, 25 mm wide",
    "tensile": "ISO 13934-1: strip of 200 mm between the jaws, 50 mm wide",
    "picture_frame": "picture frame: square of 200 mm, yarns along the bars",
    "drape": "ISO 9073-9, Cusick: specimen of 30 cm on a disc of 18 cm",
}


@dataclass(frozen=True)
class Row:
    """One measured quantity of a test, in SI units."""

    test: str  #: a key of `TESTS`
    quantity: str
    direction: str  #: "warp", "weft", "bias" or ""
    unit: str  #: "m", "N m", "N/m", "N", "1", or "" for a count
    value: float
    scatter: float | None = None  #: standard deviation over repeated tests
    expected: float | None = None  #: by a closed form; of a tensile force, at the stretch of the strip's middle
    published: Published | None = None

    @property
    def verdict(self) -> str:
        """ "within", "below" or "above" the published range, or ""."""
        if self.published is None:
            return ""
        if self.value < self.published.low:
            return "below"
        return "above" if self.value > self.published.high else "within"


@dataclass(frozen=True)
class Report:
    """What `cama.fabric.test` measured."""

    fabric: str  #: name
    density: float  #: kg/m^2
    rows: list[Row]
    drapes: list[draping.Drape] = field(repr=False)  #: one for each repeated drape test

    def value(self, quantity: str, direction: str = "") -> float:
        """Returns a measured value. Raises ArrayError if it was not measured."""
        for row in self.rows:
            if (row.quantity, row.direction) == (quantity, direction):
                return row.value
        raise ArrayError(f"report of {self.fabric}: no {direction} {quantity} was measured")

    def to_dict(self) -> dict[str, Any]:
        """Returns what JSON can hold, in SI units."""
        rows = [{**asdict(row), "verdict": row.verdict} for row in self.rows]
        return {"fabric": self.fabric, "density": self.density, "standards": TESTS, "rows": rows}


def _cantilever(fabric: Material, add: Callable[..., None]) -> None:
    for direction in DIRECTIONS:
        if not np.any(fabric.bending):
            add("bending length", direction, "m", 0.0)
            continue
        found = bending.cantilever(fabric, direction)
        add("bending length", direction, "m", found.bending_length, expected=found.expected)
        stiffness = bending.bending_stiffness(fabric, direction)
        add("flexural rigidity", direction, "N m", found.flexural_rigidity, expected=stiffness)


def _tensile(fabric: Material, add: Callable[..., None]) -> None:
    for direction in DIRECTIONS:
        found = stretching.tensile(fabric, direction)
        for k, stretch in enumerate(found.stretch):
            expected = None if found.expected is None else found.expected[k]
            add(f"force at {100 * stretch:g} % stretch", direction, "N/m", found.force[k], expected=expected)
        add("tensile stiffness", direction, "N/m", found.force[-1] / found.stretch[-1])


def _picture_frame(fabric: Material, add: Callable[..., None]) -> None:
    found = shear.picture_frame(fabric)
    for k, angle in enumerate(found.angle):
        expected = None if found.expected is None else found.expected[k]
        add(f"force at {angle:g}°", "", "N", found.force[k], expected=expected)
    expected = fabric.stretching[0][3] / 2 if stretching.is_constant(fabric) else None
    add("shear rigidity", "", "N/m", found.shear_rigidity, expected=expected)


def _drape(fabric: Material, add: Callable[..., None], drapes: int, sectors: int) -> list[draping.Drape]:
    found = [draping.drape(fabric, seed, sectors) for seed in range(drapes)]
    for quantity, unit, values in (
        ("drape coefficient", "1", [d.coefficient for d in found]),
        ("nodes", "", [float(d.nodes) for d in found]),
    ):
        add(quantity, "", unit, float(np.mean(values)), scatter=float(np.std(values, ddof=1)) if drapes > 1 else None)
    return found


def test(
    material: Material | str,
    only: Sequence[str] | None = None,
    drapes: int = 3,
    sectors: int = draping.SECTORS,
    progress: Callable[[str], object] | None = None,
) -> Report:
    """Runs the textile tests on a fabric.

    Args:
        material: A `cama.Material`, or what `Material.of` accepts: a shipped fabric's name, a file, a dict.
        only: Of "cantilever", "tensile", "picture_frame" and "drape"; None: all.
        drapes: How often the drape test is repeated, each time with another disturbance of the start.
        sectors: Cells around the specimen of the drape test, as for `drape`.
        progress: Called with the name of each test before it runs.

    Raises:
        ArrayError, MaterialError, SolverError
    """
    fabric = Material.of(material)
    chosen = list(TESTS if only is None else only)
    for name in chosen:
        if name not in TESTS:
            raise ArrayError(f"test: {name!r} is not one of {', '.join(TESTS)}{similar(name, TESTS)}")
    if count("test: drapes", drapes) < 1:
        raise ArrayError("test: drapes is 0; give at least 1")
    rows: list[Row] = []
    hanging: list[draping.Drape] = []
    for name in TESTS:
        if name not in chosen:
            continue
        if progress is not None:
            progress(name)

        def add(quantity: str, direction: str, unit: str, value: float, test: str = name, **more: Any) -> None:
            found = published(fabric.name, quantity, direction)
            rows.append(Row(test, quantity, direction, unit, value, published=found, **more))

        if name == "drape":
            hanging = _drape(fabric, add, drapes, sectors)
        else:
            {"cantilever": _cantilever, "tensile": _tensile, "picture_frame": _picture_frame}[name](fabric, add)
    return Report(fabric.name, fabric.density, rows, hanging)
