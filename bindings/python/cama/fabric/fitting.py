# SPDX-License-Identifier: Apache-2.0
"""A material from measured values: weighted least squares, with the uncertainty of every number."""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import count, number
from ..errors import FileError, MaterialError
from ..hints import digits, require, similar, without_comments
from ..material import Material
from ..types import PathLike, Reals
from . import bending, draping, shear, stretching
from .specimens import DIRECTIONS, GRAVITY
from .writing import write

PARAMETERS = {  # name in the material file: unit
    "density": "kg/m^2",
    "youngs_warp": "N/m",
    "youngs_weft": "N/m",
    "poisson_ratio": "",
    "shear": "N/m",
    "bending_warp": "N m",
    "bending_weft": "N m",
}
KEYS = (
    "name",
    "description",
    "density",
    "tensile",
    "gauge",
    "shear_rigidity",
    "picture_frame",
    "frame_side",
    "poisson_ratio",
    "bending_length",
    "flexural_rigidity",
    "drape_coefficient",
    "damping",
    "friction",
)
PLANE = ("warp", "weft")
SCATTER = 0.05  # relative standard deviation of a value that is given without one
POISSON = (0.25, 0.1)  # of woven cloth, where it is not measured: published values lie from 0.1 to 0.5
LIKE = 0.5  # standard deviation of log(warp/weft) of bending, where only the drape coefficient is measured
REACH = 0.5  # of log(stiffness) beyond the simulated drapes, in which a drape coefficient is still extrapolated
DRAPE_SLOPE = 0.12  # change of the drape coefficient with the logarithm of bending stiffness, to begin with
EXAMPLE = {
    "name": "my-twill",
    "density": {"value": 0.21, "scatter": 0.004},
    "bending_length": {"warp": {"value": 0.0195, "scatter": 0.0008}, "weft": {"value": 0.0178, "scatter": 0.0008}},
    "tensile": {
        "warp": [[0.02, 95, 6], [0.05, 250, 15]],
        "weft": [[0.02, 70, 5], [0.05, 185, 12]],
        "bias": [[0.02, 4.1, 0.4], [0.05, 10.8, 0.9]],
    },
    "shear_rigidity": {"value": 42, "scatter": 4},
    "drape_coefficient": {"value": 0.69, "scatter": 0.03},
}


@dataclass(frozen=True)
class Measured:
    """One measured value and what the fitted material gives for it, in SI units."""

    quantity: str
    value: float
    scatter: float  #: standard deviation
    assumed: bool  #: whether the scatter was not given, and 5 % of the value was taken
    fitted: float
    method: str  #: "closed form", "closed form, jaws" or "simulation"

    @property
    def residual(self) -> float:
        """Fitted minus measured, in standard deviations."""
        return (self.fitted - self.value) / self.scatter


@dataclass(frozen=True)
class Fit:
    """A material that was found from measured values."""

    material: Material
    values: dict[str, float]  #: the parameters of `PARAMETERS`
    uncertainties: dict[str, float]  #: their standard deviations
    covariance: Reals = field(repr=False)  #: [7, 7], of the parameters in their order
    measured: list[Measured] = field(repr=False)
    description: dict[str, Any] = field(repr=False)  #: the material file

    def to_dict(self) -> dict[str, Any]:
        """Returns what JSON can hold, in SI units."""
        rows = [{**vars(m), "residual": m.residual} for m in self.measured]
        return {
            "material": self.description,
            "uncertainties": self.uncertainties,
            "parameters": list(PARAMETERS),
            "covariance": self.covariance.tolist(),
            "measured": rows,
        }

    def write(self, path: PathLike) -> None:
        """Writes the material file, which scenes and `Material.load` read. Raises FileError."""
        write(Path(path), (json.dumps(self.description, indent=2) + "\n").encode())


_Model = Callable[[Reals], float]  # of the parameters


@dataclass(frozen=True)
class _Observation:
    quantity: str
    value: float
    scatter: float
    assumed: bool
    model: _Model
    method: str = "closed form"


def _positive(where: str, value: Any) -> float:
    result = number(where, value)
    if result <= 0:
        raise MaterialError(f"{where}: {result:g} is not above 0")
    return result


def _value(where: str, given: Any) -> tuple[float, float, bool]:
    """Returns value, scatter and whether the scatter is assumed, of a number or {"value": ..., "scatter": ...}."""
    if isinstance(given, Mapping):
        for key in given:
            if key not in ("value", "scatter"):
                raise MaterialError(f"{where}: unknown key {key!r}; there are value and scatter")
        if "value" not in given:
            raise MaterialError(f"{where}: has no value")
        value = _positive(f"{where}: value", given["value"])
        if "scatter" in given:
            return value, _positive(f"{where}: scatter", given["scatter"]), False
    else:
        value = _positive(where, given)
    return value, SCATTER * value, True


def _directions(where: str, given: Any, allowed: Iterable[str]) -> Mapping[str, Any]:
    if not isinstance(given, Mapping):
        raise MaterialError(f"{where}: {given!r} is not an object with {', '.join(allowed)}")
    for key in given:
        if key not in allowed:
            raise MaterialError(f"{where}: unknown direction {key!r}; there are {', '.join(allowed)}")
    return given


def _pairs(where: str, given: Any) -> list[tuple[float, tuple[float, float, bool]]]:
    """Returns (abscissa, (value, scatter, assumed)) of rows [abscissa, value] or [abscissa, value, scatter]."""
    if not isinstance(given, (list, tuple, np.ndarray)) or not len(given):
        raise MaterialError(f"{where}: {given!r} is not a list of pairs")
    rows = []
    for k, row in enumerate(given):
        if not isinstance(row, (list, tuple, np.ndarray)) or len(row) not in (2, 3):
            raise MaterialError(f"{where}[{k}]: {row!r} is not a pair of numbers, or three with the scatter")
        numbers = [_positive(f"{where}[{k}]", x) for x in row]
        scatter = numbers[2] if len(row) == 3 else SCATTER * numbers[1]
        rows.append((numbers[0], (numbers[1], scatter, len(row) == 2)))
    return rows


def _material(values: Reals) -> Material:
    density, warp, weft, poisson, stiffness, bending_warp, bending_weft = (float(v) for v in values)
    return Material.orthotropic(warp, weft, poisson, stiffness, bending_warp, bending_weft, density)


class _Jaws:
    """Force of a strip between jaws, which hold its width, over that of a strip that is free to narrow."""

    def __init__(self, length: float, width: float) -> None:
        self._gauge = length, width
        self._factors: dict[tuple[str, float], float] = {}

    def update(self, material: Material, rows: Mapping[str, Sequence[float]]) -> None:
        for direction, stretches in rows.items():
            wanted = sorted(set(stretches))
            length, width = self._gauge
            cells = max(16, round(8 * length / width))
            found = stretching.tensile(material, direction, wanted, length, width, cells)
            free = stretching.modulus(material, direction)
            for stretch, force in zip(wanted, found.force):
                self._factors[direction, stretch] = force / stretching.uniaxial_force(free, stretch)

    def force(self, direction: str, stretch: float, values: Reals) -> float:
        free = stretching.uniaxial_force(stretching.modulus(_material(values), direction), stretch)
        return self._factors.get((direction, stretch), 1.0) * free


def _observations(given: Mapping[str, Any], jaws: _Jaws) -> list[_Observation]:
    """Returns everything measured but the drape coefficient."""
    rows: list[_Observation] = []

    def add(quantity: str, value: tuple[float, float, bool], model: _Model, method: str = "closed form") -> None:
        rows.append(_Observation(quantity, *value, model, method))

    add("density", _value("density", given["density"]), _parameter("density"))
    for direction, pairs in _directions("tensile", given.get("tensile", {}), DIRECTIONS).items():
        for stretch, value in _pairs(f"tensile: {direction}", pairs):
            model = functools.partial(jaws.force, direction, stretch)
            add(f"force at {100 * stretch:g} % stretch, {direction}", value, model, "closed form, jaws")
    if "shear_rigidity" in given:
        add("shear rigidity", _value("shear_rigidity", given["shear_rigidity"]), _parameter("shear"))
    side = _positive("frame_side", given.get("frame_side", shear.SIDE))
    for angle, value in _pairs("picture_frame", given["picture_frame"]) if "picture_frame" in given else ():
        if angle >= 90:
            raise MaterialError(f"picture_frame: {angle:g} is not below 90 degrees")
        unit = shear.corner_force(1.0, math.radians(angle), side)
        add(f"picture frame at {angle:g} degrees", value, _parameter("shear", unit))
    for key, title in (("bending_length", "bending length"), ("flexural_rigidity", "flexural rigidity")):
        for direction, measured in _directions(key, given.get(key, {}), PLANE).items():
            stiffness = _parameter(f"bending_{direction}")
            model = functools.partial(_length, stiffness) if key == "bending_length" else stiffness
            add(f"{title}, {direction}", _value(f"{key}: {direction}", measured), model)
    if "poisson_ratio" in given:
        add("Poisson ratio", _value("poisson_ratio", given["poisson_ratio"]), _parameter("poisson_ratio"))
    return rows


def _parameter(name: str, factor: float = 1.0) -> _Model:
    """Returns the model of a value that is a parameter times a factor."""
    index = list(PARAMETERS).index(name)
    return lambda values: factor * float(values[index])


def _length(stiffness: _Model, values: Reals) -> float:
    return bending.bending_length_of(stiffness(values), float(values[0]))


def _complete(given: Mapping[str, Any]) -> None:
    """Raises MaterialError if something is unknown, or missing without which a parameter cannot be found."""
    for key in given:
        if key not in KEYS:
            raise MaterialError(f"measured: unknown key {key!r}; there are {', '.join(KEYS)}{similar(key, KEYS)}")
    missing = []
    if "density" not in given:
        missing.append("density")
    tensile = _directions("tensile", given.get("tensile", {}), DIRECTIONS)
    bent = {d for key in ("bending_length", "flexural_rigidity") for d in _directions(key, given.get(key, {}), PLANE)}
    missing += [f"tensile: {d}" for d in PLANE if d not in tensile]
    if not ("shear_rigidity" in given or "picture_frame" in given or "bias" in tensile):
        missing.append("shear_rigidity, picture_frame or tensile: bias")
    if "drape_coefficient" not in given:
        missing += [f"bending_length: {d} (or flexural_rigidity, or drape_coefficient)" for d in PLANE if d not in bent]
    if missing:
        raise MaterialError(f"measured: lacks {'; '.join(missing)}")


class _Problem:
    """Least squares in the logarithms of the positive parameters."""

    def __init__(self, start: Reals, observations: list[_Observation], measured_poisson: bool) -> None:
        self.observations = observations
        self._measured_poisson = measured_poisson
        self.at = self._inward(start)

    @staticmethod
    def _inward(values: Reals) -> Reals:
        inside = np.log(values)
        inside[3] = values[3]
        return inside

    @staticmethod
    def outward(at: Reals) -> Reals:
        values = np.exp(at)
        values[3] = at[3]
        return values

    def _residuals(self, at: Reals) -> Reals:
        values = self.outward(at)
        rows = [(o.model(values) - o.value) / o.scatter for o in self.observations]
        if not self._measured_poisson:
            rows.append((values[3] - POISSON[0]) / POISSON[1])
        rows.append((at[5] - at[6]) / LIKE if not self.bends() else 0.0)
        return np.array(rows)

    def bends(self) -> bool:
        """Whether both directions of bending are measured."""
        found = {o.quantity.split(", ")[1] for o in self.observations if o.quantity.startswith(("bending", "flexural"))}
        return found == {"warp", "weft"}

    def solve(self) -> Reals:
        """Moves to the least sum of squares and returns the covariance of the parameters [7, 7]."""
        from scipy.optimize import least_squares

        low, high = np.full(7, -np.inf), np.full(7, np.inf)
        low[3], high[3] = -0.9, 0.9
        result = least_squares(self._residuals, self.at, bounds=(low, high), x_scale=0.1, xtol=1e-12, ftol=1e-12)
        self.at = result.x
        scale = self.outward(self.at)
        scale[3] = 1.0
        return scale[:, None] * np.linalg.pinv(result.jac.T @ result.jac) * scale


def _start(given: Mapping[str, Any]) -> Reals:
    """Returns parameters to begin with, from the first values of each kind."""
    density = _value("density", given["density"])[0]
    first = {d: _pairs(f"tensile: {d}", rows)[0] for d, rows in given["tensile"].items()}
    young = {d: value[0] / stretching.uniaxial_force(1.0, stretch) for d, (stretch, value) in first.items()}
    if "shear_rigidity" in given:
        stiffness = _value("shear_rigidity", given["shear_rigidity"])[0]
    elif "picture_frame" in given:
        angle, value = _pairs("picture_frame", given["picture_frame"])[0]
        side = _positive("frame_side", given.get("frame_side", shear.SIDE))
        stiffness = value[0] / shear.corner_force(1.0, math.radians(angle), side)
    else:
        stiffness = young["bias"] / 4
    bent = {}
    for d in PLANE:
        if d in given.get("flexural_rigidity", {}):
            bent[d] = _value("flexural_rigidity", given["flexural_rigidity"][d])[0]
        elif d in given.get("bending_length", {}):
            bent[d] = bending.flexural_rigidity_of(_value("bending_length", given["bending_length"][d])[0], density)
    other = next(iter(bent.values()), density * GRAVITY * 0.018**3)
    return np.array(
        [
            density,
            young["warp"],
            young["weft"],
            POISSON[0],
            stiffness,
            bent.get("warp", other),
            bent.get("weft", other),
        ]
    )


def _drape_observation(
    given: Any, problem: _Problem, drapes: int, sectors: int, progress: Callable[[str], object]
) -> tuple[_Observation, tuple[float, float]]:
    """Simulates drapes of stiffer and softer cloth.

    Returns the drape coefficient as a line over `_log_stiffness`, and the range of this in which the line is good.
    """
    value, scatter, assumed = _value("drape_coefficient", given)
    if value >= 1:
        raise MaterialError(f"drape_coefficient: {value:g} is not below 1; give a share, such as 0.62")
    at = problem.at.copy()
    found: list[tuple[float, float]] = []
    shift, spread = 0.0, 0.0
    for round_ in range(4):
        moved = at.copy()
        moved[5:] += shift
        fabric = _material(_Problem.outward(moved))
        for seed in range(drapes):
            progress(f"drape {round_ * drapes + seed + 1} of {4 * drapes}")
            found.append((shift, draping.drape(fabric, seed, sectors).coefficient))
        shifts, values = np.array(found).T
        slope = DRAPE_SLOPE
        if np.ptp(shifts) > 0.1:
            slope = max(float(np.polyfit(shifts, values, 1)[0]), 0.03)
        level = float(np.mean(values - slope * shifts))
        spread = float(np.std(values - slope * shifts - level, ddof=1)) if len(values) > 2 else 0.0
        wanted = float(np.clip((value - level) / slope, -3, 3))
        shift = wanted if abs(wanted - shift) > 0.15 else wanted + (0.3 if round_ % 2 == 0 else -0.3)
    total = math.hypot(scatter, spread / math.sqrt(len(found)))
    middle = _log_stiffness(_Problem.outward(at))

    def line(values: Reals) -> float:
        return level + slope * (_log_stiffness(values) - middle)

    reach = middle + float(shifts.min()) - REACH, middle + float(shifts.max()) + REACH
    return _Observation("drape coefficient", value, total, assumed, line, "simulation"), reach


def _log_stiffness(values: Reals) -> float:
    """Returns the logarithm of bending stiffness, the geometric mean of warp and weft, over mass: what drapes."""
    return float(np.log(values[5]) + np.log(values[6])) / 2 - float(np.log(values[0]))


def fit(
    measured: Mapping[str, Any] | PathLike,
    drapes: int = 2,
    sectors: int = draping.SECTORS,
    progress: Callable[[str], object] | None = None,
) -> Fit:
    """Finds the numbers of a fabric from measured ones.

    Tensile, shear and bending stiffness come from closed forms, which the simulated strip corrects for its jaws; only
    the drape coefficient needs simulated drapes. All values together are weighted by their scatter: least squares with
    `scipy.optimize.least_squares`. Uncertainties are standard deviations, from the covariance (J'J)^-1.

    Args:
        measured: A dict, or a JSON file of one, in SI units. A value is a number, or {"value": ..., "scatter": ...}
            with its standard deviation; without it 5 % are taken.

            - density: kg/m^2.
            - tensile: {"warp": [[stretch, force in N/m], ...], "weft": ..., "bias": ...}; a third number in a row is
              the scatter. gauge: distance of the jaws and width, m, [0.2, 0.05] if left out.
            - shear_rigidity: N/m for each radian; or picture_frame: [[angle in degrees, force in N], ...] with
              frame_side, m; or tensile: bias.
            - bending_length: {"warp": m, "weft": m}; or flexural_rigidity, N m.
            - drape_coefficient: 1; beside the bending lengths or instead of them. Of directions whose bending is not
              measured the logarithms differ by 0 with a standard deviation of 0.5.
            - poisson_ratio: 1; without it 0.25 with a standard deviation of 0.1.
            - name, description, damping (s), friction: for the material file.
        drapes: How many drapes are simulated for each of four bending stiffnesses.
        sectors: Cells around the specimen of the drape test.
        progress: Called with a few words before each simulated drape.

    Raises:
        FileError: The file cannot be read.
        MaterialError: A value is missing, unknown or out of its range, or no bending stiffness gives the drape.
        BackendError: SciPy is not installed.
    """
    require("cama fabric fit", "scipy")
    given = measured if isinstance(measured, Mapping) else _read(Path(measured))
    _complete(given)
    gauge = given.get("gauge", (stretching.LENGTH, stretching.WIDTH))
    if not isinstance(gauge, (list, tuple)) or len(gauge) != 2:
        raise MaterialError(f"gauge: {gauge!r} is not the distance of the jaws and the width, m")
    jaws = _Jaws(_positive("gauge[0]", gauge[0]), _positive("gauge[1]", gauge[1]))
    problem = _Problem(_start(given), _observations(given, jaws), "poisson_ratio" in given)
    strips = {d: [row[0] for row in _pairs(f"tensile: {d}", rows)] for d, rows in given["tensile"].items()}
    covariance = problem.solve()
    for _ in range(3):
        jaws.update(_material(problem.outward(problem.at)), strips)
        covariance = problem.solve()
    if "drape_coefficient" in given:
        hanging, (low, high) = _drape_observation(
            given["drape_coefficient"], problem, count("fit: drapes", drapes), sectors, progress or (lambda words: None)
        )
        problem.observations.append(hanging)
        covariance = problem.solve()
        if not low < _log_stiffness(problem.outward(problem.at)) < high:
            raise MaterialError(
                f"drape_coefficient: {hanging.value:g} is out of reach of bending stiffness in cloth of this weight, "
                "tensile and shear stiffness; check these, and give bending lengths instead"
            )
    return _result(given, problem, covariance)


def _read(path: Path) -> Mapping[str, Any]:
    try:
        read = json.loads(without_comments(path.read_text(encoding="utf-8-sig")))
    except OSError as problem:
        raise FileError(f"{path}: {problem.strerror}") from None
    except ValueError as problem:
        raise FileError(f"{path}: is not JSON: {problem}") from None
    if not isinstance(read, dict):
        raise FileError(f"{path}: is not a JSON object with measured values")
    return read


def _result(given: Mapping[str, Any], problem: _Problem, covariance: Reals) -> Fit:
    values = problem.outward(problem.at)
    named = {name: float(v) for name, v in zip(PARAMETERS, values)}
    spread = {name: float(math.sqrt(max(c, 0.0))) for name, c in zip(PARAMETERS, np.diag(covariance))}
    rows = [
        Measured(o.quantity, o.value, o.scatter, o.assumed, o.model(values), o.method) for o in problem.observations
    ]
    evidence = {
        name: f"fitted: {digits(named[name])} ± {digits(spread[name], 2)} {PARAMETERS[name]} (standard deviation)"
        for name in PARAMETERS
    }
    if "poisson_ratio" not in given:
        evidence["poisson_ratio"] += "; not measured: 0.25 ± 0.1 was assumed for woven cloth"
    text = {key: str(given[key]) for key in ("name", "description") if key in given}
    rounded = {name: float(f"{value:.6g}") for name, value in named.items()}
    description: dict[str, Any] = {
        "format": "cama",
        "name": "fitted",
        **text,
        "source": "cama fabric fit, from measured " + "; ".join(o.quantity for o in problem.observations),
        "density": rounded.pop("density"),
        "orthotropic": rounded,
        "damping": number("damping", given.get("damping", 5e-4)),
        "evidence": evidence,
    }
    if "friction" in given:
        description["friction"] = number("friction", given["friction"])
    return Fit(Material.of(description), named, spread, covariance, rows, description)
