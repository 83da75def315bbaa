# SPDX-License-Identifier: Apache-2.0
"""What is worth knowing of a scene and may well be meant."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..welding import box
from .measures import rims_and_turns
from .obstacle import FLAT

if TYPE_CHECKING:
    from ..scene import Scene

KEPT_APART = "so that its limbs keep apart"  #: how the remark in the source of such an obstacle ends


def kept_apart(scene: Scene) -> list[str]:
    """Returns a line for each character whose limbs were moved when it was read (`clearance`)."""
    moved = [(obstacle.name, obstacle.source.partition("; ")) for obstacle in scene.obstacles]
    return [f"obstacle '{name}': {what}" for name, (_, _, what) in moved if what.endswith(KEPT_APART)]


def remarks(scene: Scene) -> list[str]:
    """Returns what is worth knowing of a scene and may well be meant: obstacles that were changed or are not closed."""
    lines = kept_apart(scene)
    for obstacle in scene.obstacles:
        if obstacle.shape != "mesh":
            continue
        sides = np.subtract(*box(obstacle.vertices)[::-1])
        rims, against = rims_and_turns(obstacle.faces, len(obstacle.vertices))
        if rims and not against and sides.min() >= FLAT * sides.max():
            lines.append(
                f"obstacle '{obstacle.name}': is open, with {rims:,} edges of one face only: cloth can get inside; "
                "fill the holes if it is meant to be a closed body"
            )
    return lines
