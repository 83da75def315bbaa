# SPDX-License-Identifier: Apache-2.0
"""Values that can be simulated but are hardly meant: other units, unwelded meshes, cloth inside a closed obstacle.

`findings` looks for them, `warn` makes Python warnings of them. The bounds leave room around what cloth is like: they
find a wrong unit, which is off by a factor of ten at least, and not an unusual fabric.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from .. import _core
from ..errors import CollisionError
from ..types import Reals
from ..welding import count_coincident, extent
from .cloth import of_cloth
from .finding import Finding, PlausibilityWarning, texts, warn
from .objects import coincident_vertices
from .obstacle import of_obstacle
from .placing import far
from .remarks import KEPT_APART, kept_apart, remarks
from .values import of_scene

if TYPE_CHECKING:
    from ..scene import Scene

__all__ = [
    "KEPT_APART",
    "Finding",
    "PlausibilityWarning",
    "explain_collision",
    "findings",
    "kept_apart",
    "remarks",
    "texts",
    "unwelded",
    "warn",
]


def findings(scene: Scene, options: Mapping[str, Any] | None = None) -> list[Finding]:
    """Returns what is hardly meant in a scene that `Scene.validate` accepts.

    Args:
        scene: The scene.
        options: Options in force, as `Simulation.options` has them; None: those of the scene and its level.
    """
    if options is None:
        options = _core.resolve(_core.OptionOverrides(), scene._core)[0]
    time_step = float(options["time_step"])
    return [*of_scene(scene, time_step), *_of_objects(scene, time_step)]


def _of_objects(scene: Scene, time_step: float) -> Iterator[Finding]:
    largest = 0.0
    cloths: list[tuple[str, Reals]] = []
    thickness = scene.thickness if scene._core.contact.enabled else 0.0
    for cloth in scene.cloths:
        vertices = cloth.vertices
        across = extent(vertices)
        largest = max(largest, across)
        cloths.append((f"cloth '{cloth.name}'", vertices))
        yield from of_cloth(cloth, vertices, across, thickness)
    yield from unwelded(scene)
    yield from far(scene, cloths)
    for obstacle in scene.obstacles:
        yield from of_obstacle(scene, obstacle, cloths, largest, thickness, time_step)


def unwelded(scene: Scene) -> list[Finding]:
    """Returns a finding for each cloth with vertices that coincide, other than those that stitches may join."""
    counts = [(cloth, count_coincident(cloth.vertices)) for cloth in scene.cloths]
    if sum(count for _, count in counts) <= 2 * scene.stitch_count:
        return []
    return [
        coincident_vertices(f"cloth '{cloth.name}'", count, len(cloth.vertices), "cloth")
        for cloth, count in counts
        if count
    ]


def explain_collision(problem: CollisionError, scene: Scene) -> None:
    """Adds to the error of a start with intersections that vertices coincide, if they do."""
    found = unwelded(scene)
    if found:
        problem.args = (f"{'; '.join(texts(found))}; {problem}",)
