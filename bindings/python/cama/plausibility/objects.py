# SPDX-License-Identifier: Apache-2.0
"""What is looked at in cloth and obstacles alike."""

from __future__ import annotations

from collections.abc import Iterator

from .finding import Finding, number

SIZE = (1e-3, 20.0)  # m, extent of an object
SPEED = 100.0  # m/s
THICK = 0.1  # of the extent of the cloth


def size(name: str, across: float, flat: bool = False) -> Iterator[Finding]:
    """Looks at the extent of an object, m. flat: a floor or a landscape, which may be larger."""
    if across > SIZE[1] and not flat:
        yield Finding(
            "large",
            name,
            "vertices",
            f"{number(across)} m across",
            f"lengths are metres: if it was made in centimetres ({number(0.01 * across)} m across), give "
            f'units="cm" or `scale` 0.01, if in millimetres ({number(0.001 * across)} m across) units="mm" or `scale` '
            "0.001",
        )
    elif across < SIZE[0]:
        yield Finding(
            "small",
            name,
            "vertices",
            f"{number(across)} m across",
            "lengths are metres: a `scale` may be applied twice, or a file may be in kilometres",
        )


def coincident_vertices(name: str, count: int, of: int, kind: str) -> Finding:
    """Returns the finding that some vertices of an object coincide. kind: "cloth" or "obstacle"."""
    return Finding(
        f"unwelded {kind}",
        name,
        "vertices",
        f"{count:,} of {of:,} vertices coincide with another one",
        f"weld them, for triangles are joined by the vertices they share: weld=True of Scene.add_{kind}, "
        '"weld": true beside the path in scene.json, or merge them in the program that made the mesh',
    )
