# SPDX-License-Identifier: Apache-2.0
"""Where cloth starts among obstacles."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from ..types import Reals
from ..welding import box
from .finding import Finding, number

if TYPE_CHECKING:
    from ..scene import Scene

FAR = 3.0  # of the extent of the largest object, from cloth to the nearest obstacle


def far(scene: Scene, cloths: list[tuple[str, Reals]]) -> Iterator[Finding]:
    """Looks for cloth that nothing holds, and that starts far from every obstacle."""
    boxes = []
    for obstacle in scene.obstacles:
        if obstacle.shape == "plane":
            return
        compiled = obstacle._compiled()
        vertices = compiled.mesh.vertices
        low, high = box(vertices if compiled.motion.is_static else compiled.motion.evaluate(0.0, vertices))
        boxes.append((low - obstacle.radius, high + obstacle.radius))
    held = {pin["cloth"] for pin in scene.pins}
    for index, (name, vertices) in enumerate(cloths if boxes and not scene.stitch_count else ()):
        low, high = box(vertices)
        gaps = [float(np.maximum(np.maximum(a - high, low - b), 0).max()) for a, b in boxes]
        largest = max([float((high - low).max())] + [float((b - a).max()) for a, b in boxes])
        if index not in held and min(gaps) > FAR * largest:
            yield Finding(
                "far",
                name,
                "vertices",
                f"{number(min(gaps))} m from the nearest obstacle, and no object is more than {number(largest)} m "
                "across",
                "move it to where it touches; if one of them is in other units, give `units` or `scale`",
            )
