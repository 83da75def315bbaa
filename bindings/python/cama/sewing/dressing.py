# SPDX-License-Identifier: Apache-2.0
"""`cama.dress`: sewing patterns are placed around a body, sewn, and draped to rest."""

from __future__ import annotations

import contextlib
import time
import warnings
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ..arrays import number
from ..body import Body
from ..errors import SceneError
from ..hints import counted
from ..material import Material
from ..plausibility import PlausibilityWarning
from ..types import Description, PathLike, Unit
from .meshing import edge_length_of, mesh_pattern
from .pattern import SewingPattern
from .result import Dressed
from .wearer import wearer_of
from .work import Dressing

if TYPE_CHECKING:
    from .output import Output

__all__ = ["dress"]


def dress(
    pattern: SewingPattern | PathLike | Sequence[SewingPattern | PathLike],
    body: PathLike | Description | Body | tuple[Any, Any],
    *,
    motion: str | None = None,
    lead_in: float = 1.0,
    fabric: PathLike | Description | Material | Sequence[PathLike | Description | Material] = "cotton",
    triangles: int = 8000,
    edge_length: float | None = None,
    output: PathLike | None = None,
    units: Unit | None = None,
    up: Literal["y", "z"] | None = None,
    seconds: float = 12.0,
    backend: str = "auto",
    threads: int = 0,
    say: Callable[[str], object] | None = None,
) -> Dressed:
    """Sews a pattern around a body and lets it come to rest.

    The panels are meshed, placed as the pattern says, and moved clear of the body and of each other (`Scene.untangle`).
    Then stitches draw the seams together without gravity, the upper ones first, with a stiffness that doubles every
    tenth of a second; vertices closer than 1 mm are joined, and the garment drapes under gravity until it rests.

    Args:
        pattern: A `SewingPattern`, or a file that `SewingPattern.load` reads; or several, which are put on one after
            the other, the first next to the skin.
        body: A `cama.Body`, a character with its animation, a mesh file, (vertices [n, 3] in m, faces [m, 3]), or an
            obstacle as in scene.json, for example {"walker": {}}. It stands still as it is dressed, as at time 0.
        motion: What a body of a mesh does once it is dressed: "stand", "walk", "dance", "kick" or "turn", as
            `cama.Body(motion, mesh=...)`; None: nothing, or its own animation.
        lead_in: Time in which a body with an animation or a `motion` moves from the pose that it is dressed in into the
            motion, s. A character is dressed in its bind pose.
        fabric: A fabric's name, a file, a dict or a `cama.Material`; or as many of them as there are patterns.
        triangles: About how many triangles each garment has.
        edge_length: Length of their edges, m, in place of `triangles`; None: by `triangles`.
        output: A folder for the garment, a scene, the frames and a summary; None: nothing is written.
        units: Unit of the body's file; None: by its height, which is 0.4 to 3 m.
        up: The axis of the body's file that points up; None: that of the pattern's file.
        seconds: Longest time of draping, s.
        backend, threads: As for `Simulation`.
        say: Called with a line of text when a stage begins and after each phase; None: nothing is said.

    Returns:
        The garment and a verdict. A garment whose verdict is not good is returned and written too. In its scene the
        body moves, if it can, for 5 s.

    Raises:
        FileError, SceneError, MeshError, MaterialError: Pattern, body or fabric cannot be used.
        CollisionError: The placed panels cannot be moved clear of the body; the text says where they are.
        BackendError: SciPy is not installed.
    """
    started = time.monotonic()
    patterns: list[Any] = list(pattern) if isinstance(pattern, (list, tuple)) else [pattern]
    fabrics: list[Any] = list(fabric) if isinstance(fabric, (list, tuple)) else [fabric] * len(patterns)
    if not patterns or len(fabrics) != len(patterns):
        raise SceneError(
            f"dress: {counted(len(patterns), 'pattern')} and {counted(len(fabrics), 'fabric')}; give one fabric, or "
            "one for each pattern"
        )
    materials = [Material.of(each) for each in fabrics]
    made = [given if isinstance(given, SewingPattern) else SewingPattern.load(given) for given in patterns]
    meshes = []
    for each in made:
        length = (
            number("dress: edge_length", edge_length) if edge_length is not None else edge_length_of(each, triangles)
        )
        meshes.append(mesh_pattern(each, length))
    wearer = wearer_of(body, motion, number("dress: lead_in", lead_in), units, up or made[0].up)
    names = _names([each.name for each in made])
    dressed: list[Dressed] = []
    with contextlib.ExitStack() as stack:
        stack.enter_context(warnings.catch_warnings())
        warnings.simplefilter("ignore", PlausibilityWarning)  # of panels that are far from each other
        writer: Output | None = None
        if output is not None:
            from .output import Output

            writer = stack.enter_context(Output(output))
        for name, mesh, material in zip(names, meshes, materials):
            how = {"backend": backend, "threads": threads}
            work = Dressing(name, mesh, wearer, material, dressed, how, say)
            last = len(dressed) == len(meshes) - 1
            dressed.append(work.run(writer if last else None, number("dress: seconds", seconds), started))
            if not np.isfinite(dressed[-1].verdict.speed):
                break  # it would not stay on
        if writer is not None:
            writer.finish(dressed[-1])
    return dressed[-1]


def _names(patterns: list[str]) -> list[str]:
    """Returns the names of the cloths: those of the patterns, with a number where they are the same."""
    if len(patterns) == 1:
        return ["garment"]
    return [
        f"{name} {patterns[:index].count(name) + 1}" if patterns.count(name) > 1 else name
        for index, name in enumerate(patterns)
    ]
