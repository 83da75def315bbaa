# SPDX-License-Identifier: Apache-2.0
"""Units of length of files and meshes, by their symbols and their names."""

from __future__ import annotations

from .hints import brief, similar

METRES = {
    "m": 1.0,
    "metre": 1.0,
    "cm": 0.01,
    "centimetre": 0.01,
    "mm": 0.001,
    "millimetre": 0.001,
    "in": 0.0254,
    "inch": 0.0254,
    "ft": 0.3048,
    "foot": 0.3048,
}
UNITS = tuple(METRES)


def unknown(units: object) -> str:
    """Returns what an error says of a unit that is not one."""
    meant = similar(str(units), UNITS) if len(str(units)) > 3 else ""
    return f"{brief(repr(units))} is none of {', '.join(UNITS)}{meant}"
