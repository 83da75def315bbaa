# SPDX-License-Identifier: Apache-2.0
"""Sewing patterns: panels with curved edges, their place around a body, and the seams between them."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from .. import shipped
from ..errors import FileError, SceneError
from ..hints import counted, naming_files, similar, without_comments
from ..types import PathLike, Reals
from ..units import METRES, unknown
from .curves import Arc, Bezier, Sampled, relative_point

__all__ = ["Edge", "Elastic", "Panel", "Seam", "SewingPattern"]

PATTERN_KEYS = ("name", "description", "units", "up", "panels", "seams", "elastics")
PANEL_KEYS = ("corners", "curves", "edges", "translate", "rotate", "shrinkage")


@dataclass(frozen=True)
class Edge:
    """An edge of a panel, from one corner to the next."""

    curve: Sampled | Arc = field(repr=False)  #: in the panel's plane, m
    label: str = ""  #: name, or ""

    @property
    def length(self) -> float:
        """Length, m."""
        return self.curve.length


@dataclass(frozen=True)
class Panel:
    """A piece of cloth of a pattern, flat, bounded by a closed line of edges.

    Its right side is the side from which the edges run counterclockwise.
    """

    name: str  #: name
    edges: tuple[Edge, ...] = field(repr=False)  #: edges in order; each begins where the one before ends
    rotation: Reals = field(repr=False)  #: [3, 3], from the panel's plane (x, y, 0) to space, z up
    translation: Reals = field(repr=False)  #: [3] m, of the plane's origin
    shrinkage: tuple[float, float] = (0.0, 0.0)  #: shares by which its cloth shrinks along x and y of the plane

    def outline(self, samples: int = 64) -> Reals:
        """Returns points [n, 2] of the boundary, m, `samples` on each curved edge and one on each straight one."""
        parts = []
        for edge in self.edges:
            parts.append(edge.curve.at(np.linspace(0, 1, (1 if edge.curve.straight else samples) + 1)[:-1]))
        return np.concatenate(parts)

    @property
    def area(self) -> float:
        """Area, m^2; negative where the edges run clockwise in the plane."""
        x, y = self.outline(SAMPLES_OF_AREA).T
        return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))

    def place(self, points: Reals) -> Reals:
        """Returns the positions [n, 3] in space, m, of points [n, 2] of the plane."""
        return np.c_[points, np.zeros(len(points))] @ self.rotation.T + self.translation


SAMPLES_OF_AREA = 256


@dataclass(frozen=True)
class Seam:
    """Two edges that are sewn together, the points at equal fractions of their lengths."""

    first: tuple[int, int]  #: panel, edge
    second: tuple[int, int]  #: panel, edge
    reversed: bool = True  #: whether the start of the first edge meets the end of the second: right sides together


@dataclass(frozen=True)
class Elastic:
    """An elastic that is sewn to an edge of a panel; it only pulls."""

    edge: tuple[int, int]  #: panel, edge
    length: float  #: at rest, over the length of the edge
    stiffness: float  #: force over strain, EA, N


@dataclass(frozen=True)
class SewingPattern:
    """Panels and the seams between them. Lengths are in m, z is up. `SewingPattern.load` reads one."""

    name: str  #: name
    panels: tuple[Panel, ...]  #: panels
    seams: tuple[Seam, ...] = field(repr=False)  #: seams
    up: str = "z"  #: the axis that was up in the file, "y" or "z"
    elastics: tuple[Elastic, ...] = field(default=(), repr=False)  #: elastics

    @classmethod
    @naming_files()
    def load(cls, file: PathLike) -> SewingPattern:
        """Reads a pattern: a JSON file in the format of cama, a specification of GarmentCode, or a shipped one by name.

        Raises:
            FileError: The file cannot be read, or is not JSON.
            SceneError: A panel, edge or seam is not as the format says; the text names it.
        """
        path = Path(file)
        own = shipped.folder() / "patterns" / f"{path.name}.json"
        if len(path.parts) == 1 and not path.exists() and own.is_file():
            path = own
        try:
            data = json.loads(without_comments(path.read_text(encoding="utf-8-sig")))
        except OSError as problem:
            raise FileError(f"{path}: {problem.strerror}") from None
        except (ValueError, RecursionError) as problem:
            raise FileError(f"{path}: not JSON: {problem}") from None
        name = path.stem[: -len("_specification")] if path.stem.endswith("_specification") else path.stem
        return cls.parse(data, name)

    @classmethod
    def parse(cls, data: Mapping[str, Any], name: str = "pattern") -> SewingPattern:
        """Makes a pattern from what JSON holds, in one of the formats that `load` reads. Raises SceneError."""
        if not isinstance(data, dict) or not ("panels" in data or "pattern" in data):
            raise SceneError(
                f'{name}: is not a sewing pattern; one has "panels" and "seams", one of GarmentCode has "pattern"'
            )
        made = _garmentcode(data, name) if "pattern" in data else _own(data, name)
        made._check()
        return made

    def scaled(self, width: float, height: float | None = None, top: float | None = None) -> SewingPattern:
        """Returns a copy whose measurements, and places around the body, are multiplied.

        Args:
            width: Factor of horizontal measurements.
            height: Factor of vertical ones; None: `width`.
            top: Height of the highest point of the placed panels, m; None: it is multiplied too, as for a taller body.
                `self.top` is for another size on the same body.

        Panels are scaled in their planes: x by `width`, y by `height`, which fits panels that hang upright.
        """
        factors = np.array([width, width if height is None else height], float)
        if not np.all(np.isfinite(factors) & (factors > 0)):
            raise SceneError(f"{self.name}: scaled: {width} and {height} must be positive")
        space = np.array([factors[0], factors[0], factors[1]])

        panels = tuple(
            Panel(
                panel.name,
                tuple(Edge(edge.curve.scaled(factors), edge.label) for edge in panel.edges),
                panel.rotation,
                panel.translation * space,
                panel.shrinkage,
            )
            for panel in self.panels
        )
        made = replace(self, panels=panels)
        if top is None:
            return made
        if not math.isfinite(top):
            raise SceneError(f"{self.name}: scaled: top {top} must be a height in m")
        up = np.array([0.0, 0.0, top - made.top])
        lifted = tuple(replace(panel, translation=panel.translation + up) for panel in panels)
        return replace(self, panels=lifted)

    def shrunk(self, shrinkage: Mapping[str, float | tuple[float, float]]) -> SewingPattern:
        """Returns a copy in which panels shrink.

        Args:
            shrinkage: By the panel's name, the share by which its cloth is shorter at rest than it was cut, from -1
                (twice as long) to 0.9: a number, or two for the x and the y direction of its plane.

        Raises:
            SceneError: There is no such panel, or a share is out of range.
        """
        names = [panel.name for panel in self.panels]
        for name in shrinkage:
            if name not in names:
                raise SceneError(f"{self.name}: shrinkage: there is no panel {name!r}{similar(name, names)}")
        panels = tuple(
            replace(panel, shrinkage=_shrinkage(f"{self.name}: panel {panel.name!r}: shrinkage", shrinkage[panel.name]))
            if panel.name in shrinkage
            else panel
            for panel in self.panels
        )
        return replace(self, panels=panels)

    @property
    def top(self) -> float:
        """Height of the highest point of the placed panels, m."""
        return max(float(panel.place(panel.outline())[:, 2].max()) for panel in self.panels)

    @property
    def area(self) -> float:
        """Area of the cloth, m^2."""
        return sum(abs(panel.area) for panel in self.panels)

    def edge(self, where: tuple[int, int]) -> Edge:
        """Returns an edge by the numbers of its panel and in it."""
        return self.panels[where[0]].edges[where[1]]

    def where(self, edge: tuple[int, int]) -> str:
        """Returns words for an edge: "front, edge 3 (hem)"."""
        label = self.edge(edge).label
        return f"{self.panels[edge[0]].name}, edge {edge[1]}{f' ({label})' if label else ''}"

    def seam_name(self, index: int) -> str:
        """Returns words for a seam: the edges that it joins."""
        seam = self.seams[index]
        return f"seam {index}: {self.where(seam.first)} to {self.where(seam.second)}"

    def _check(self) -> None:
        """Raises SceneError where panels or seams cannot be sewn."""
        if not self.panels:
            raise SceneError(f"{self.name}: has no panels")
        for panel in self.panels:
            for number, edge in enumerate(panel.edges):
                if not edge.length > 1e-5:
                    raise SceneError(f"{self.name}: panel {panel.name!r}: edge {number} has no length")
            if abs(panel.area) < 1e-6:
                raise SceneError(f"{self.name}: panel {panel.name!r} has no area")
            if abs(panel.area) > 100:
                raise SceneError(
                    f"{self.name}: panel {panel.name!r} has {abs(panel.area):,.0f} m^2; are the units right?"
                )
        sewn: dict[tuple[int, int], int] = {}
        for number, seam in enumerate(self.seams):
            for side in (seam.first, seam.second):
                if side in sewn:
                    raise SceneError(
                        f"{self.name}: {self.where(side)} is sewn twice, by seams {sewn[side]} and {number}; "
                        "an edge has one seam: divide it by a corner"
                    )
                sewn[side] = number

    def __repr__(self) -> str:
        panels, seams = counted(len(self.panels), "panel"), counted(len(self.seams), "seam")
        return f"<cama.SewingPattern {self.name!r}: {panels}, {seams}, {self.area:.3g} m^2>"


def _numbers(where: str, value: Any, shape: tuple[int, ...]) -> Reals:
    """Returns finite numbers of a shape, in which -1 is any length. Raises SceneError."""
    try:
        array = np.array(value, float)
    except (TypeError, ValueError):
        array = np.full((), np.nan)
    fits = array.ndim == len(shape) and all(n in (-1, m) for n, m in zip(shape, array.shape))
    if not fits or not np.all(np.isfinite(array)):
        words = " x ".join("n" if n < 0 else str(n) for n in shape)
        raise SceneError(f"{where}: {str(value)[:60]} is not {words or 'a'} finite number{'s' if shape else ''}")
    return array


def _shrinkage(where: str, value: Any) -> tuple[float, float]:
    """Returns the shares of a number, or of two. Raises SceneError."""
    shares = np.broadcast_to(_numbers(where, value, (2,) if isinstance(value, (list, tuple)) else ()), 2)
    if not np.all((shares >= -1) & (shares <= 0.9)):
        raise SceneError(f"{where}: {value} is out of range; give shares from -1 (twice as long) to 0.9")
    return float(shares[0]), float(shares[1])


def _entry(where: str, value: Any, key: str, kind: type, default: Any = None) -> Any:
    """Returns an entry of an object of JSON. Raises SceneError if it is missing or of another kind."""
    found = value.get(key, default) if isinstance(value, dict) else None
    if not isinstance(found, kind):
        words = "an object" if kind is dict else "a list" if kind is list else "a text"
        raise SceneError(f"{where}: {key!r} must be {words}")
    return found


def _positive(where: str, value: Mapping[str, Any], key: str) -> float:
    """Returns an entry that is a number greater than 0. Raises SceneError."""
    found = float(_numbers(f"{where}: {key}", value.get(key), ()))
    if not found > 0:
        raise SceneError(f"{where}: {key}: {found:g} must be greater than 0")
    return found


def _known(where: str, value: Mapping[str, Any], keys: tuple[str, ...]) -> None:
    for key in value:
        if key not in keys and not key.startswith(("$", "_")):
            raise SceneError(f"{where}: unknown key {key!r}{similar(key, keys)}; there are {', '.join(keys)}")


def _rotation(degrees: Reals) -> Reals:
    """Returns the matrix of turns about the fixed axes x, then y, then z."""
    matrix = np.eye(3)
    for axis, angle in enumerate(np.radians(degrees)):
        turn = np.eye(3)
        i, j = (axis + 1) % 3, (axis + 2) % 3
        turn[i, i] = turn[j, j] = math.cos(angle)
        turn[i, j], turn[j, i] = -math.sin(angle), math.sin(angle)
        matrix = turn @ matrix
    return matrix


Y_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # turns y up to z up


def _frame(up: str) -> Reals:
    return Y_UP if up == "y" else np.eye(3)


# The format of cama.


def _own(data: Mapping[str, Any], name: str) -> SewingPattern:
    _known(name, data, PATTERN_KEYS)
    name = _entry(name, data, "name", str, name)
    units, up = data.get("units", "m"), data.get("up", "z")
    if units not in METRES:
        raise SceneError(f"{name}: units: {unknown(units)}")
    if up not in ("y", "z"):
        raise SceneError(f'{name}: up {up!r} must be "y" or "z"')
    panels, names = [], []
    for panel_name, panel in _entry(name, data, "panels", dict).items():
        panels.append(_own_panel(f"{name}: panel {panel_name!r}", panel_name, panel, METRES[units], _frame(up)))
        names.append(panel_name)
    seams = []
    for number, seam in enumerate(_entry(name, data, "seams", list, [])):
        where = f"{name}: seam {number}"
        if not isinstance(seam, list) or len(seam) not in (2, 3) or not all(isinstance(s, str) for s in seam):
            raise SceneError(f'{where}: {seam!r} is not a list such as ["front.left", "back.right"]')
        if len(seam) == 3 and seam[2] not in ("opposite", "parallel"):
            raise SceneError(f'{where}: {seam[2]!r} must be "opposite" (the default) or "parallel"')
        sides = [_own_edge(where, side, panels) for side in seam[:2]]
        seams.append(Seam(sides[0], sides[1], len(seam) == 2 or seam[2] == "opposite"))
    elastics = []
    for number, elastic in enumerate(_entry(name, data, "elastics", list, [])):
        where = f"{name}: elastic {number}"
        edge = _own_edge(where, _entry(where, elastic, "edge", str), panels)
        _known(where, elastic, ("edge", "length", "stiffness"))
        elastics.append(Elastic(edge, _positive(where, elastic, "length"), _positive(where, elastic, "stiffness")))
    return SewingPattern(name, tuple(panels), tuple(seams), up, tuple(elastics))


def _own_panel(where: str, name: str, panel: Any, unit: float, frame: Reals) -> Panel:
    corners = _numbers(f"{where}: corners", _entry(where, panel, "corners", list), (-1, 2)) * unit
    _known(where, panel, PANEL_KEYS)
    if len(corners) < 2:
        raise SceneError(f"{where}: needs two corners at least")
    labels = _entry(where, panel, "edges", dict, {})
    by_number = {}
    for label, number in labels.items():
        if not isinstance(number, int) or isinstance(number, bool) or not 0 <= number < len(corners):
            raise SceneError(f"{where}: edges: {label!r} is {number!r}, not a number from 0 to {len(corners) - 1}")
        by_number[number] = label
    curves = _entry(where, panel, "curves", dict, {})
    keys = {str(number) for number in range(len(corners))} | set(labels)
    for key in curves:
        if key not in keys:
            raise SceneError(f"{where}: curves: there is no edge {key!r}{similar(key, keys)}")
    edges = []
    for number, (start, end) in enumerate(zip(corners, np.roll(corners, -1, axis=0))):
        if np.array_equal(start, end):
            raise SceneError(f"{where}: corners {number} and {(number + 1) % len(corners)} are the same point")
        label = by_number.get(number, "")
        given = curves.get(label) if label in curves else curves.get(str(number))
        edges.append(Edge(_own_curve(f"{where}: curve of edge {number}", start, end, given, unit), label))
    turn = _numbers(f"{where}: rotate", panel.get("rotate", [0, 0, 0]), (3,))
    move = _numbers(f"{where}: translate", panel.get("translate", [0, 0, 0]), (3,)) * unit
    shrinkage = _shrinkage(f"{where}: shrinkage", panel.get("shrinkage", 0.0))
    return Panel(name, tuple(edges), frame @ _rotation(turn), frame @ move, shrinkage)


def _own_curve(where: str, start: Reals, end: Reals, given: Any, unit: float) -> Bezier | Arc:
    if given is None:
        return Bezier(np.stack([start, end]))
    if not isinstance(given, dict) or len(given) != 1 or set(given) - {"control", "bulge"}:
        raise SceneError(f'{where}: {given!r} is neither {{"control": [[x, y], ...]}} nor {{"bulge": height}}')
    if "control" in given:
        control = _numbers(f"{where}: control", given["control"], (-1, 2)) * unit
        if len(control) not in (1, 2):
            raise SceneError(f"{where}: control: {len(control)} points; a Bézier curve here has one or two")
        return Bezier(np.vstack([start, control, end]))
    bulge = float(_numbers(f"{where}: bulge", given["bulge"], ())) * unit
    half = 0.5 * float(np.linalg.norm(end - start))
    if abs(bulge) < 1e-6 * half:
        return Bezier(np.stack([start, end]))
    radius = (half**2 + bulge**2) / (2 * abs(bulge))
    return Arc(start, end, radius, abs(bulge) > half, bulge > 0)


def _own_edge(where: str, text: str, panels: list[Panel]) -> tuple[int, int]:
    """Returns the numbers of panel and edge of a text such as "front.3" or "front.hem"."""
    panel_name, _, edge_name = text.rpartition(".")
    for index, panel in enumerate(panels):
        if panel.name != panel_name:
            continue
        labels = [edge.label for edge in panel.edges]
        if edge_name and edge_name in labels:
            return index, labels.index(edge_name)
        if edge_name.isdigit() and int(edge_name) < len(panel.edges):
            return index, int(edge_name)
        raise SceneError(f"{where}: panel {panel_name!r} has no edge {edge_name!r}{similar(edge_name, labels)}")
    names = [panel.name for panel in panels]
    raise SceneError(f"{where}: {text!r}: there is no panel {panel_name!r}{similar(panel_name, names)}")


# GarmentCode (Korosteleva and Sorkine-Hornung 2023, GarmentCode: Programming Parametric Sewing Patterns).


def _garmentcode(data: Mapping[str, Any], name: str) -> SewingPattern:
    pattern, properties = _entry(name, data, "pattern", dict), _entry(name, data, "properties", dict, {})
    coordinates = properties.get("curvature_coords", "relative")
    if coordinates not in ("relative", "absolute"):
        raise SceneError(f"{name}: properties: curvature_coords {coordinates!r} must be relative or absolute")
    in_metre = float(_numbers(f"{name}: properties: units_in_meter", properties.get("units_in_meter", 100), ()))
    if in_metre <= 0:
        raise SceneError(f"{name}: properties: units_in_meter must be positive")
    if properties.get("normalize_panel_translation", False):
        raise SceneError(f"{name}: normalized translations of panels do not place them around a body")
    panels = _entry(name, pattern, "panels", dict)
    made = [
        _garmentcode_panel(f"{name}: panel {panel_name!r}", panel_name, panel, 1 / in_metre, coordinates == "relative")
        for panel_name, panel in panels.items()
    ]
    index = {panel_name: number for number, panel_name in enumerate(panels)}
    seams = []
    for number, stitch in enumerate(_entry(name, pattern, "stitches", list, [])):
        where = f"{name}: stitch {number}"
        if not isinstance(stitch, list) or len(stitch) not in (2, 3):
            raise SceneError(f"{where}: is not a pair of edges")
        sides = []
        for side in stitch[:2]:
            panel_name, edge = _entry(where, side, "panel", str), side.get("edge")
            if panel_name not in index:
                raise SceneError(f"{where}: there is no panel {panel_name!r}{similar(panel_name, index)}")
            if not isinstance(edge, int) or not 0 <= edge < len(made[index[panel_name]].edges):
                raise SceneError(f"{where}: panel {panel_name!r} has no edge {edge!r}")
            sides.append((index[panel_name], edge))
        seams.append(Seam(sides[0], sides[1], len(stitch) == 2 or stitch[2] != "right_wrong"))
    return SewingPattern(name, tuple(made), tuple(seams), "y")


def _garmentcode_panel(where: str, name: str, panel: Any, unit: float, relative: bool) -> Panel:
    vertices = _numbers(f"{where}: vertices", _entry(where, panel, "vertices", list), (-1, 2)) * unit
    edges, last = [], None
    for number, edge in enumerate(_entry(where, panel, "edges", list)):
        here = f"{where}: edge {number}"
        ends = _entry(here, edge, "endpoints", list)
        if len(ends) != 2 or not all(isinstance(e, int) and 0 <= e < len(vertices) for e in ends):
            raise SceneError(f"{here}: endpoints {ends} are not two of the panel's {len(vertices)} vertices")
        if last is not None and ends[0] != last:
            raise SceneError(f"{here}: starts at vertex {ends[0]}, but the edge before ends at {last}")
        last = ends[1]
        if np.array_equal(vertices[ends[0]], vertices[ends[1]]):
            raise SceneError(f"{here}: begins and ends at the same point")
        curve = _garmentcode_curve(here, vertices[ends[0]], vertices[ends[1]], edge.get("curvature"), unit, relative)
        edges.append(Edge(curve, str(edge.get("label", ""))))
    if not edges or last != panel["edges"][0]["endpoints"][0]:
        raise SceneError(f"{where}: the edges do not close")
    turn = _numbers(f"{where}: rotation", panel.get("rotation", [0, 0, 0]), (3,))
    move = _numbers(f"{where}: translation", panel.get("translation", [0, 0, 0]), (3,)) * unit
    return Panel(name, tuple(edges), Y_UP @ _rotation(turn), Y_UP @ move)


def _garmentcode_curve(where: str, start: Reals, end: Reals, given: Any, unit: float, relative: bool) -> Bezier | Arc:
    if given is None:
        return Bezier(np.stack([start, end]))
    if isinstance(given, list):  # as older files have it
        given = {"type": "quadratic", "params": [given]}
    kind, params = _entry(where, given, "type", str), _entry(where, given, "params", list)
    if kind == "circle":
        radius, large, right = _numbers(f"{where}: params", params, (3,))
        return Arc(start, end, radius * unit, bool(large), bool(right))
    if kind not in ("quadratic", "cubic"):
        raise SceneError(f"{where}: curvature {kind!r} is not quadratic, cubic or circle")
    control = _numbers(f"{where}: params", params, (1 if kind == "quadratic" else 2, 2))
    points = [relative_point(start, end, p) if relative else p * unit for p in control]
    return Bezier(np.vstack([start, *points, end]))
