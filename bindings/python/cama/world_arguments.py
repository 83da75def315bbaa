# SPDX-License-Identifier: Apache-2.0
"""What `Worlds` accepts: scenes, numbers of worlds, and arrays for each of them or for all."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from .arrays import count, indices, integers, reals
from .device_arrays import brought
from .errors import ArrayError, Error, SceneError
from .parts import Obstacle
from .scene import Scene
from .simulated_scene import SimulatedScene
from .types import ArrayLike, Integers, PathLike, Reals

if TYPE_CHECKING:
    from .simulation import Simulation


def scenes_of(
    scenes: Scene | PathLike | Sequence[Scene | PathLike],
    number: int | None,
    vary: Callable[[Scene, int], object] | None,
) -> list[SimulatedScene]:
    """Returns the scene of each world; the arguments are those of `Worlds`."""
    return [_varied(scene, world, vary) for world, scene in enumerate(_listed(scenes, number))]


def _listed(scenes: Scene | PathLike | Sequence[Scene | PathLike], number: int | None) -> list[Scene]:
    if isinstance(scenes, Sequence) and not isinstance(scenes, str):
        if number is not None:
            raise SceneError(
                "worlds: number is for copies of one scene; give a list of scenes, or one scene and a number"
            )
        return [scene if isinstance(scene, Scene) else Scene.load(scene) for scene in scenes]
    scene = scenes if isinstance(scenes, Scene) else Scene.load(scenes)
    copies = count("worlds: number", 1 if number is None else number)
    return [scene] * copies


def _varied(scene: Scene, world: int, vary: Callable[[Scene, int], object] | None) -> SimulatedScene:
    if vary is None:
        return SimulatedScene.of(scene)
    own = scene.copy()
    vary(own, world)
    return SimulatedScene.of(own)


class WorldArguments:
    """Checks arguments, and brings them to rows of each world.

    In the methods `what` begins error texts, and `chosen` are the numbers [k] of the worlds.
    """

    __slots__ = ("_worlds", "_cloth")

    def __init__(self, worlds: Sequence[Simulation]) -> None:
        self._worlds = worlds
        self._cloth = [world.cloth_vertex_count for world in worlds]

    def index(self, what: str, world: int) -> int:
        """Returns the number of one world."""
        chosen = self.chosen(what, world)
        if len(chosen) != 1:
            raise ArrayError(f"{what}: {len(chosen)} worlds, expected one")
        return int(chosen[0])

    def chosen(self, what: str, worlds: ArrayLike | None) -> Integers:
        """Returns the numbers [k] of worlds that are given as one number, numbers [k] or a mask [worlds]; None: all."""
        if worlds is None:
            return np.arange(len(self._worlds), dtype=np.int32)
        array = np.asarray(worlds)
        if array.dtype.kind == "b":
            if array.shape != (len(self._worlds),):
                raise ArrayError(f"{what}: worlds: a mask of shape {list(array.shape)}, expected [{len(self._worlds)}]")
            return np.flatnonzero(array).astype(np.int32)
        chosen = integers(f"{what}: worlds", array.reshape(1) if array.ndim == 0 else array, (None,))
        for world in chosen:
            if not 0 <= world < len(self._worlds):
                raise ArrayError(f"{what}: world {world} is out of range; there are {len(self._worlds)} worlds, from 0")
        if len(np.unique(chosen)) != len(chosen):
            raise ArrayError(f"{what}: worlds: a world is named twice")
        return chosen

    def rows(self, what: str, values: Any, chosen: Integers) -> list[Reals]:
        """Returns vectors [cloth vertices, 3] of each world."""
        return self.vectors(what, values, chosen, [self._cloth[w] for w in chosen], same=False)

    def vectors(
        self, what: str, values: Any, chosen: Integers, rows: list[int], same: bool = True, one: bool = False
    ) -> list[Reals]:
        """Returns vectors [rows[i], 3] of each world. same: one array may be for all worlds; one: also one vector."""
        given = brought(what, values, self._worlds[0]._core)
        dimensions = _dimensions(given)
        if one and dimensions == 1 and len(given) == 3:
            vector = reals(what, given, (3,))
            return [np.ascontiguousarray(np.broadcast_to(vector, (n, 3))) for n in rows]
        whole = _checked(given, rows)
        if whole is not None:
            return list(whole)
        if same and dimensions == 2:
            given = [given] * len(chosen)
        elif dimensions < 1 or len(given) != len(chosen):
            found = "no row for each world" if dimensions < 1 else f"of {len(given)} worlds"
            raise ArrayError(f"{what}: {found}, expected {len(chosen)}")
        return [reals(f"{what} of world {world}", row, (n, 3)) for world, row, n in zip(chosen, given, rows)]

    def vertices(self, what: str, vertices: Any, chosen: Integers) -> list[Integers]:
        """Returns the indices of each world's vertices."""
        if _dimensions(vertices) < 2:
            if len(chosen) and len({self._cloth[world] for world in chosen}) == 1:
                name = f"{what}: vertices of world {chosen[0]}"
                return [indices(name, vertices, self._cloth[chosen[0]])] * len(chosen)
            vertices = [vertices] * len(chosen)
        elif len(vertices) != len(chosen):
            raise ArrayError(f"{what}: vertices: of {len(vertices)} worlds, expected {len(chosen)}")
        return [
            indices(f"{what}: vertices of world {world}", row, self._cloth[world])
            for world, row in zip(chosen, vertices)
        ]

    def obstacles(self, what: str, obstacle: Obstacle | int | str, chosen: Integers) -> Integers:
        """Returns the index of the obstacle in each world. A handle stands for its index in its scene."""
        found = []
        for world in chosen:
            scene = self._worlds[world]._scene
            own = obstacle
            if isinstance(obstacle, Obstacle) and not any(obstacle is o for o in scene.obstacles):
                own = obstacle.name
            try:
                found.append(scene._index(what, own, scene.obstacles))
            except Error as problem:
                raise type(problem)(f"world {world}: {problem}") from None
        return np.array(found, np.int32)

    def each(self, what: str, values: Any, chosen: Integers, width: int) -> Reals:
        """Returns [worlds, width] from that, or from one [width] for all worlds."""
        given = brought(what, values, self._worlds[0]._core)
        if _dimensions(given) == 1:
            one = reals(what, given, (width,))
            return np.ascontiguousarray(np.broadcast_to(one, (len(chosen), width)))
        return reals(what, given, (len(chosen), width))


def _checked(values: Any, rows: list[int]) -> Reals | None:
    """Returns an array [worlds, n, 3] in which nothing is wrong; None: the worlds have to be looked at one by one."""
    if not (isinstance(values, np.ndarray) and rows and values.shape == (len(rows), rows[0], 3)):
        return None
    if values.dtype.kind not in "fiu" or len(set(rows)) > 1:
        return None
    whole = np.ascontiguousarray(values, dtype=np.float64)
    return whole if np.isfinite(whole).all() else None


def _dimensions(values: Any) -> int:
    """Number of dimensions; of lists whose rows differ in length 2, or 3 where the rows are arrays of vectors."""
    try:
        return np.ndim(values)
    except ValueError:
        return 1 + max((_dimensions(row) for row in values), default=0)
