# SPDX-License-Identifier: Apache-2.0
"""Values that can be simulated but are hardly meant: other units, unwelded meshes, cloth inside a closed obstacle.

`findings` looks for them, `warn` makes Python warnings of them. The bounds leave room around what cloth is like: they
find a wrong unit, which is off by a factor of ten at least, and not an unusual fabric.
"""

from __future__ import annotations

import math
import os
import sys
import warnings
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from . import _core
from .errors import CollisionError
from .parts import Cloth, Obstacle
from .types import Integers, Reals
from .welding import box, count_coincident, extent

if TYPE_CHECKING:
    from .scene import Scene

__all__ = ["PlausibilityWarning"]

SIZE = (1e-3, 20.0)  # m, extent of an object
FLAT = 0.05  # height over extent of a floor or a landscape, which may be larger
DENSITY = (0.005, 5.0)  # kg/m^2; fabrics have 0.02 to 2
STRETCHING = (1.0, 1e6)  # N/m; fabrics have 100 to 40,000
BENDING = 0.05  # N m, of a hinge; fabrics have 5e-6 to 1e-3
DAMPING = 0.1  # s; fabrics have about 0.001
MASS_DAMPING = 20.0  # 1/s; cloth in air has 0.1 to 3
THICK = 0.1  # of the extent of the cloth
THICK_EDGES = 5.0  # median edges of the cloth
SPEED = 100.0  # m/s
TIME_STEP = 0.1  # s
FRAME_TIME = 10.0  # s
GRAVITY = 50.0  # m/s^2
AIR = 50.0  # kg/m^3
REST = 2.0  # factor between rest shape and start, median over triangles or edges
UNWELDED_OBSTACLE = 0.25  # of its vertices
FAR = 3.0  # of the extent of the largest object, from cloth to the nearest obstacle
MANY = 200_000  # vertices of an obstacle whose faces are not looked at
SAMPLES = 200  # triangles that medians are taken over
INSTANTS = 16  # at which a rigid motion is looked at
INSIDE = 0.99  # winding number around a vertex inside a closed obstacle is 1

KEPT_APART = "so that its limbs keep apart"  #: how the remark in the source of such an obstacle ends

PACKAGE = os.path.dirname(os.path.abspath(__file__)) + os.sep


class PlausibilityWarning(UserWarning):
    """A scene can be simulated, but a value in it is hardly meant: in other units than SI, for example.

    `cama.Simulation` gives these warnings at the caller's line, and the command `cama run` prints them. Python's own
    filters silence them: `warnings.simplefilter("ignore", cama.PlausibilityWarning)`; with "error" in place of "ignore"
    they become exceptions.
    """

    __module__ = "cama"


@dataclass(frozen=True)
class Finding:
    """One value that is hardly meant."""

    kind: str  #: "size", "density", ...: findings of one kind have one cause
    object: str  #: "cloth 'shirt'", "the scene"
    element: str  #: "vertices", "material.density", "time_step"
    seen: str  #: what is there
    remedy: str

    def __str__(self) -> str:
        return f"{self.object}: {self.element}: {self.seen}; {self.remedy}"


def findings(scene: Scene, options: Mapping[str, Any] | None = None) -> list[Finding]:
    """Returns what is hardly meant in a scene that `Scene.validate` accepts.

    Args:
        scene: The scene.
        options: Options in force, as `Simulation.options` has them; None: those of the scene and its level.
    """
    if options is None:
        options = _core.resolve(_core.OptionOverrides(), scene._core)[0]
    time_step = float(options["time_step"])
    return [*_of_scene(scene, time_step), *_of_objects(scene, time_step)]


def texts(found: Iterable[Finding]) -> list[str]:
    """Returns one line for each kind of finding: the first one's, with the number of others like it."""
    kinds: dict[str, list[Finding]] = {}
    for finding in found:
        kinds.setdefault(finding.kind, []).append(finding)
    lines = []
    for first, *others in kinds.values():
        objects = len({finding.object for finding in others} - {first.object})
        more = f" (and {objects} {'object' if objects == 1 else 'objects'} like it)" if objects else ""
        lines.append(f"{first.object}{more}: {first.element}: {first.seen}; {first.remedy}")
    return lines


def warn(found: Iterable[Finding]) -> None:
    """Gives a PlausibilityWarning for each kind of finding, at the line outside the package that led here."""
    lines = texts(found)
    if not lines:
        return
    level, frame = 1, sys._getframe()
    while frame.f_back is not None and os.path.abspath(frame.f_code.co_filename).startswith(PACKAGE):
        level, frame = level + 1, frame.f_back
    for line in lines:
        warnings.warn(line, PlausibilityWarning, stacklevel=level)


def unwelded(scene: Scene) -> list[Finding]:
    """Returns a finding for each cloth with vertices that coincide, other than those that stitches may join."""
    counts = [(cloth, count_coincident(cloth.vertices)) for cloth in scene.cloths]
    if sum(count for _, count in counts) <= 2 * scene.stitch_count:
        return []
    return [_unwelded(f"cloth '{cloth.name}'", count, len(cloth.vertices), "cloth") for cloth, count in counts if count]


def explain_collision(problem: CollisionError, scene: Scene) -> None:
    """Adds to the error of a start with intersections that vertices coincide, if they do."""
    found = unwelded(scene)
    if found:
        problem.args = (f"{'; '.join(texts(found))}; {problem}",)


def _unwelded(name: str, count: int, of: int, kind: str) -> Finding:
    return Finding(
        f"unwelded {kind}",
        name,
        "vertices",
        f"{count:,} of {of:,} vertices coincide with another one",
        f"weld them, for triangles are joined by the vertices they share: weld=True of Scene.add_{kind}, "
        '"weld": true beside the path in scene.json, or merge them in the program that made the mesh',
    )


def _number(value: float) -> str:
    return f"{value:.4g}"


def _of_scene(scene: Scene, time_step: float) -> Iterator[Finding]:
    if time_step > TIME_STEP:
        yield Finding(
            "time step",
            "the scene",
            "time_step",
            f"{_number(time_step)} s",
            "cloth is computed in steps of 0.0001 to 0.02 s; leave it out, and the accuracy level chooses it",
        )
    if scene.seconds_per_frame > FRAME_TIME:
        yield Finding(
            "frame time",
            "the scene",
            "frame_time",
            f"{_number(scene.seconds_per_frame)} s",
            "it is the time between two recorded frames in seconds, for example 1/60",
        )
    gravity = math.hypot(*scene.gravity)
    if gravity > GRAVITY:
        yield Finding(
            "gravity",
            "the scene",
            "gravity",
            f"{_number(gravity)} m/s^2",
            "on Earth it is 9.81 m/s^2; lengths are metres",
        )
    wind = scene.wind
    if wind is not None:
        if math.hypot(*wind["velocity"]) > SPEED:
            yield Finding(
                "wind",
                "the scene",
                "wind.velocity",
                f"{_number(math.hypot(*wind['velocity']))} m/s",
                "a hurricane has 50 m/s; give metres per second",
            )
        if wind["density"] > AIR:
            yield Finding(
                "air",
                "the scene",
                "wind.density",
                f"{_number(wind['density'])} kg/m^3",
                "air has 1.2 kg/m^3; give kilograms per cubic metre",
            )


def _of_objects(scene: Scene, time_step: float) -> Iterator[Finding]:
    largest, boxes = 0.0, []
    thickness = scene.thickness if scene._core.contact.enabled else 0.0
    for cloth in scene.cloths:
        name, vertices = f"cloth '{cloth.name}'", cloth.vertices
        across = extent(vertices)
        largest = max(largest, across)
        boxes.append((name, vertices))
        yield from _size(name, across)
        yield from _material(name, cloth._compiled().material)
        start = _edges(vertices[_sample(cloth.faces)])
        lengths = _lengths(start)
        yield from _thickness(name, cloth, lengths, across, thickness)
        yield from _rest(name, cloth, start, lengths)
        speed = math.hypot(*cloth._compiled().velocity)
        if speed > SPEED:
            yield Finding("velocity", name, "velocity", f"{_number(speed)} m/s at the start", "give metres per second")
        yield from _pressure(name, cloth)
    yield from unwelded(scene)
    yield from _far(scene, boxes)
    for obstacle in scene.obstacles:
        yield from _of_obstacle(scene, obstacle, boxes, largest, thickness, time_step)


def _pressure(name: str, cloth: Cloth) -> Iterator[Finding]:
    pressure = cloth._compiled().pressure
    if pressure == 0:
        return
    faces, corners = cloth.faces, cloth.vertices[cloth.faces]
    edges, uses = np.unique(
        np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0, return_counts=True
    )
    seen = f"{_number(pressure)} Pa"
    if (uses == 1).any():
        yield Finding(
            "open cloth",
            name,
            "pressure",
            f"{seen}, and the cloth is open at {int((uses == 1).sum()):,} of {len(edges):,} edges",
            "pressure is for closed cloth, an open one is blown away along its normals; close it, or weld vertices "
            "that coincide (`weld`)",
        )
    elif np.einsum("ij,ij", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) < 0:
        yield Finding(
            "inverted cloth",
            name,
            "pressure",
            f"{seen}, and the normals of the faces point inwards",
            "pressure pushes along the normals; reverse the faces, or change the sign",
        )


def _size(name: str, across: float, flat: bool = False) -> Iterator[Finding]:
    if across > SIZE[1] and not flat:
        yield Finding(
            "large",
            name,
            "vertices",
            f"{_number(across)} m across",
            f"lengths are metres: if it was made in centimetres ({_number(0.01 * across)} m across), give "
            f'units="cm" or `scale` 0.01, if in millimetres ({_number(0.001 * across)} m across) units="mm" or `scale` '
            "0.001",
        )
    elif across < SIZE[0]:
        yield Finding(
            "small",
            name,
            "vertices",
            f"{_number(across)} m across",
            "lengths are metres: a `scale` may be applied twice, or a file may be in kilometres",
        )


def _material(name: str, material: _core.Material) -> Iterator[Finding]:
    if not DENSITY[0] <= material.density <= DENSITY[1]:
        yield Finding(
            "density",
            name,
            "material.density",
            f"{_number(material.density)} kg/m^2",
            "fabrics have 0.02 to 2 kg/m^2: divide g/m^2 by 1000, and multiply kg/m^3 by the fabric's thickness in m",
        )
    rows = material.stretching
    stiffest, softest = max(max(row[0], row[2]) for row in rows), max(rows[0][0], rows[0][2])
    if stiffest > STRETCHING[1]:
        yield Finding(
            "stiffness",
            name,
            "material.stretching",
            f"{_number(stiffest)} N/m",
            "fabrics have 100 to 40,000 N/m: multiply Young's modulus in Pa by the fabric's thickness in m",
        )
    elif softest < STRETCHING[0]:
        yield Finding(
            "softness",
            name,
            "material.stretching",
            f"{_number(softest)} N/m",
            "fabrics have 100 to 40,000 N/m: give Young's modulus times thickness in N/m, not in N/mm or MPa",
        )
    hinge = max(max(row) for row in material.bending)
    if hinge > BENDING:
        yield Finding(
            "bending",
            name,
            "material.bending",
            f"{_number(hinge)} N m (of a hinge, five times the plate's)",
            "fabrics have 5e-6 to 1e-3 N m: give 1 gf cm^2/cm as 9.8e-5 N m, and 1 micro N m as 1e-6",
        )
    if material.damping > DAMPING:
        yield Finding(
            "damping",
            name,
            "material.damping",
            f"{_number(material.damping)} s",
            "fabrics have about 0.001 s; give seconds",
        )
    if material.mass_damping > MASS_DAMPING:
        yield Finding(
            "mass damping",
            name,
            "material.mass_damping",
            f"{_number(material.mass_damping)} 1/s",
            "cloth in air has 0.1 to 3 1/s, and falls at 9.81 m/s^2 over that; give 1/s",
        )


def _sample(rows: Integers) -> Integers:
    return rows[:: max(1, len(rows) // SAMPLES)]


def _edges(corners: Reals) -> Reals:
    """Returns the edges [m, 3, 2 or 3] of triangles with these corners."""
    return corners[:, [1, 2, 0]] - corners


def _lengths(edges: Reals) -> Reals:
    return np.asarray(np.sqrt(np.einsum("ijk,ijk->ij", edges, edges)))


def _areas(edges: Reals) -> Reals:
    """Returns the areas [m] of triangles with these edges."""
    a, b = edges[:, 0], edges[:, 1]
    aa, ab, bb = (np.einsum("ij,ij->i", p, q) for p, q in ((a, a), (a, b), (b, b)))
    return np.asarray(0.5 * np.sqrt(np.maximum(aa * bb - ab * ab, 0.0)))


def _thickness(name: str, cloth: Cloth, lengths: Reals, across: float, thickness: float) -> Iterator[Finding]:
    own = cloth._compiled().material.thickness
    used, element = (own, "thickness") if own > 0 else (thickness, "contact.thickness, the scene's")
    if not thickness:
        return
    if used > THICK * across:
        seen = f"{_number(used)} m, and the cloth is {_number(across)} m across"
    elif used > THICK_EDGES * lengths.min() and used > THICK_EDGES * _median(lengths):
        seen = f"{_number(used)} m, and the cloth's edges are {_number(_median(lengths))} m long"
    else:
        return
    yield Finding(
        "thickness", name, element, seen, "cloth stays this far from obstacles; fabrics have 0.0002 to 0.005 m"
    )


def _off(ratio: Reals) -> tuple[float, float]:
    """Returns the medians of ratios and of their distance from 1 as a factor."""
    return _median(ratio), _median(np.maximum(ratio, 1 / ratio))


def _ratios(values: Reals, to: Reals) -> Reals:
    """Returns values over others [n], without those of slivers, whose areas round to 0."""
    good = (values > 0) & (to > 0)
    return np.asarray(values[good] / to[good])


def _median(values: Reals) -> float:
    return float(np.sort(values, axis=None)[values.size // 2])


def _rest(name: str, cloth: Cloth, start: Reals, start_lengths: Reals) -> Iterator[Finding]:
    material_faces = cloth.material_faces
    if not len(material_faces):
        return
    rest = _edges(cloth.material_vertices[_sample(material_faces)])
    lengths, areas = _ratios(_lengths(rest), start_lengths), _ratios(_areas(rest), _areas(start))
    if not (lengths.size and areas.size):
        return
    if all(ratio.min() >= 1 / REST and ratio.max() <= REST for ratio in (lengths, areas)):
        return  # so are the medians, which take longer
    (length, length_off), (area, area_off) = _off(lengths), _off(areas)
    if max(length_off, area_off) <= REST:
        return
    unit = cloth._compiled().material_scale
    if unit > 0:  # of texture coordinates
        element, given = 'rest "uv"', "texture coordinates"
        remedy = f"set `material_scale` to {_number(unit / length)}"
    else:
        element = given = "material_vertices"
        remedy = f"multiply them by {_number(1 / length)}"
    yield Finding(
        "rest shape",
        name,
        element,
        f"the rest shape, which {given} give, has edges {_number(length)} times as long and triangles {_number(area)} "
        "times as large as the start (medians)",
        f"if they only place a picture, leave {element} out, and the start is the rest shape; if their unit is wrong, "
        f"{remedy}",
    )


def _of_obstacle(
    scene: Scene,
    obstacle: Obstacle,
    cloths: list[tuple[str, Reals]],
    largest: float,
    thickness: float,
    time_step: float,
) -> Iterator[Finding]:
    name, compiled = f"obstacle '{obstacle.name}'", obstacle._compiled()
    vertices = compiled.mesh.vertices
    if obstacle.shape != "plane":
        sides = np.subtract(*box(vertices)[::-1]) + 2 * obstacle.radius
        yield from _size(name, float(sides.max()), flat=bool(sides.min() < FLAT * sides.max()))
    if thickness and compiled.thickness > THICK * largest:
        yield Finding(
            "thickness",
            name,
            "thickness",
            f"{_number(compiled.thickness)} m, and the largest cloth is {_number(largest)} m across",
            "cloth stays this far from obstacles; 0.001 to 0.005 m is usual",
        )
    motion = compiled.motion
    if not motion.is_static:
        yield from _motion(scene, name, motion, vertices, time_step)
    if obstacle.shape != "mesh":
        return
    coincident = count_coincident(vertices)
    if coincident > UNWELDED_OBSTACLE * len(vertices):
        yield _unwelded(name, coincident, len(vertices), "obstacle")
    there = vertices if motion.is_static else motion.evaluate(0.0, vertices)
    if scene._core.contact.enabled:
        yield from _inside(name, there, obstacle, cloths)
        yield from _turned(name, there, obstacle, cloths)


def _motion(scene: Scene, name: str, motion: _core.Motion, vertices: Reals, time_step: float) -> Iterator[Finding]:
    """Looks at the speed of the outermost vertices, at instants of the recorded time and between them."""
    if motion.is_rigid:
        vertices = vertices[np.concatenate([vertices.argmin(axis=0), vertices.argmax(axis=0)])]
    instants = np.linspace(0.0, scene.frames * scene.seconds_per_frame, INSTANTS if motion.is_rigid else 3)
    there = [motion.evaluate(instant, vertices) for instant in instants]
    soon = [motion.evaluate(instant + time_step, vertices) for instant in instants]
    moves = [(a, b, time_step) for a, b in zip(there, soon)] + [
        (a, b, instants[1] - instants[0]) for a, b in zip(there, there[1:])
    ]
    with np.errstate(over="ignore"):  # infinity is too fast as well
        fastest = max(float(np.sqrt(((b - a) ** 2).sum(axis=1).max())) / time for a, b, time in moves if time > 0)
    if fastest > SPEED:
        yield Finding(
            "motion",
            name,
            "motion",
            f"{_number(fastest)} m/s",
            "give metres and seconds, and rotations in radians per second",
        )


def _turned(name: str, surface: Reals, obstacle: Obstacle, cloths: list[tuple[str, Reals]]) -> Iterator[Finding]:
    """Looks whether the faces of a closed obstacle point inward, and some against others."""
    if len(surface) > MANY:
        return
    rims, against = _edges_of_surface(obstacle.faces, len(surface))
    remedy = "recalculate its normals outward in the program that made it, or turn the order of its faces' vertices"
    if against:
        seen = f"{against:,} edges join faces that are turned against each other"
        yield Finding("turned", name, "faces", seen, remedy)
        return
    if rims:
        return
    corners = surface[obstacle.faces] - surface[0]
    if np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) >= 0:
        return
    low, high = box(surface)
    if not any(((vertices > low).all() and (vertices < high).all()) for _, vertices in cloths):  # no container
        yield Finding("turned", name, "faces", "it is closed, and its faces are turned inward", remedy)


def _edges_of_surface(faces: Integers, count: int) -> tuple[int, int]:
    """Returns how many edges have one face, and how many have two that take them in the same direction."""
    first, second = faces.ravel().astype(np.int64), np.roll(faces, -1, axis=1).ravel()
    keys = np.minimum(first, second) * count + np.maximum(first, second)
    order = np.argsort(keys, kind="stable")
    starts = np.flatnonzero(np.diff(keys[order], prepend=-1))
    numbers = np.diff(starts, append=len(keys))
    pairs = starts[numbers == 2]
    along = (first < second)[order]
    return int(np.count_nonzero(numbers == 1)), int(np.count_nonzero(along[pairs] == along[pairs + 1]))


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
        rims, against = _edges_of_surface(obstacle.faces, len(obstacle.vertices))
        if rims and not against and sides.min() >= FLAT * sides.max():
            lines.append(
                f"obstacle '{obstacle.name}': is open, with {rims:,} edges of one face only: cloth can get inside; "
                "fill the holes if it is meant to be a closed body"
            )
    return lines


def _far(scene: Scene, cloths: list[tuple[str, Reals]]) -> Iterator[Finding]:
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
                f"{_number(min(gaps))} m from the nearest obstacle, and no object is more than {_number(largest)} m "
                "across",
                "move it to where it touches; if one of them is in other units, give `units` or `scale`",
            )


def _inside(name: str, surface: Reals, obstacle: Obstacle, cloths: list[tuple[str, Reals]]) -> Iterator[Finding]:
    low, high = box(surface)
    for cloth, vertices in cloths:
        if not ((vertices > low).all() and (vertices < high).all()):
            continue
        corners = surface[obstacle.faces]
        if all(_winding(corners, vertices[k]) > INSIDE for k in (0, len(vertices) // 2, len(vertices) - 1)):
            yield Finding(
                "inside",
                cloth,
                "vertices",
                f"all of it starts inside the closed {name}, which it cannot leave",
                "move it outside; if the obstacle is a container, turn its faces inward",
            )


def _winding(corners: Reals, point: Reals) -> float:
    """Returns how often a surface of triangles winds around a point: 1 inside a closed one that is turned outward.

    The solid angles of the triangles are those of Van Oosterom and Strackee 1983.
    """
    a, b, c = (corners[:, k] - point for k in range(3))
    la, lb, lc = (np.sqrt(np.einsum("ij,ij->i", p, p)) for p in (a, b, c))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))
    ab, bc, ca = (np.einsum("ij,ij->i", p, q) for p, q in ((a, b), (b, c), (c, a)))
    return float(np.arctan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb).sum() / (2 * math.pi))
