# SPDX-License-Identifier: Apache-2.0
"""Plans of options for trade-offs: what can be varied, grids of values, and Pareto fronts."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction
from typing import Any

from .. import _core
from ..errors import ArrayError, SceneError
from ..options import option_types
from ..scene import Scene
from ..simulation import Simulation
from .reference import steps_of

# Values of options: one row of a plan.
OptionValues = dict[str, Any]

# Steps, s, and values that are tried where the caller names none.
STEPS = tuple(Fraction(1, n) for n in (60, 120, 240, 480, 960))
TOLERANCES, PRECISIONS = (1e-1, 1e-2, 1e-3), ("double", "mixed", "single")


def levels() -> list[str]:
    """Returns the names of the accuracy levels, from fast to exact, the paper's last."""
    return list(_core.accuracy_levels())


def variable_options() -> dict[str, type]:
    """Returns {name: type} of all that can be varied: options, `accuracy`, `time_step` and `resolution`."""
    own = option_types(set_by="scene")
    return {**own, "time_step": float, "resolution": int}


def value_of(name: str, text: object) -> Any:
    """Returns a value from a text or a value: numbers may be fractions such as 1/60, booleans true or false.

    Raises SceneError.
    """
    known = variable_options()
    if name not in known:
        raise SceneError(f"option {name!r} is not known; there are {', '.join(sorted(known))}")
    kind = known[name]
    try:
        if kind is bool:
            if str(text).lower() not in ("true", "false"):
                raise ValueError
            return str(text).lower() == "true"
        if kind is int:
            if Fraction(str(text)).denominator != 1:
                raise ValueError
            return int(Fraction(str(text)))
        if kind is float:
            value = float(Fraction(str(text).strip()))
            if not math.isfinite(value) or value <= 0:
                raise ValueError
            return value
        return str(text).strip()
    except (ValueError, ZeroDivisionError, OverflowError):
        raise SceneError(
            f"option {name}: {text!r} is not a {'positive number' if kind is float else kind.__name__}"
        ) from None


def parse_values(text: str) -> tuple[str, list[Any]]:
    """Returns ("time_step", [1/60, 1/200]) for "time_step=1/60,1/200". Raises SceneError."""
    name, equals, values = str(text).partition("=")
    if not equals or not values.strip():
        raise SceneError(f"option {text!r}: give name=value,value")
    return name.strip(), [value_of(name.strip(), v) for v in values.split(",")]


def product(chosen: Mapping[str, Iterable[Any]]) -> list[OptionValues]:
    """Returns all combinations of {name: [values]} as dicts. Raises SceneError."""
    chosen = {name: [value_of(name, v) for v in values] for name, values in dict(chosen).items()}
    for name, values in chosen.items():
        if not values:
            raise SceneError(f"option {name}: give values")
    return [dict(zip(chosen, values)) for values in itertools.product(*chosen.values())]


def default_plan(scene: Scene, window: float) -> list[OptionValues]:
    """Returns the plan that is measured if the caller gives none.

    Every level but `reference`; `production` with time steps and tolerances, in every precision at the longest and the
    shortest step; and the second-order integrator and Newton iterations.
    """
    steps = [float(step) for step in STEPS if _divides(float(step), window)] or [window / math.ceil(200 * window)]
    plan = [{"accuracy": level} for level in levels() if level != "reference"]
    plan += product({"accuracy": ["production"], "time_step": steps, "tolerance": TOLERANCES, "precision": ["mixed"]})
    plan += product(
        {
            "accuracy": ["production"],
            "time_step": [steps[0], steps[-1]],
            "tolerance": [1e-2],
            "precision": ["double", "single"],
        }
    )
    for name, value in (("integrator", "bdf2"), ("newton_iterations", 4)):
        plan += product(
            {
                "accuracy": ["production"],
                "time_step": steps[1::2],
                "tolerance": [1e-2],
                "precision": ["mixed"],
                name: [value],
            }
        )
    return unique(plan)


def _divides(step: float, span: float) -> bool:
    return abs(round(span / step) * step - span) <= 1e-9 * span and round(span / step) >= 1


def unique(plan: Iterable[OptionValues]) -> list[OptionValues]:
    """Returns the plan without repetitions, in order."""
    seen, kept = set(), []
    for settings in plan:
        key = tuple(sorted(settings.items()))
        if key not in seen:
            seen.add(key)
            kept.append(settings)
    return kept


def label(settings: OptionValues) -> str:
    """Returns a text such as "production, dt 1/200 s, tolerance 0.01, mixed"."""
    words = []
    for name, value in settings.items():
        if name in ("accuracy", "precision"):
            words.append(str(value))
        elif name == "time_step":
            words.append(f"dt {step_text(value)} s")
        else:
            words.append(f"{name} {value:g}" if isinstance(value, float) else f"{name} {value}")
    return ", ".join(words) or "production"


def step_text(seconds: float) -> str:
    """Returns a fraction such as 1/200 where the step is one, else the number."""
    parts = Fraction(seconds).limit_denominator(100000)
    return (
        f"{parts.numerator}/{parts.denominator}"
        if parts and abs(float(parts) / seconds - 1) < 1e-9
        else f"{seconds:.4g}"
    )


def pareto(points: Iterable[tuple[float | None, float | None]]) -> list[int]:
    """Returns the indices of the points (x, y) on the Pareto front, ordered by x.

    Points with a value that is None or not finite are never on it; of equal points the first is.
    """
    finite = [
        (x, y, i)
        for i, (x, y) in enumerate(points)
        if x is not None and y is not None and math.isfinite(x) and math.isfinite(y)
    ]
    front, best = [], math.inf
    for _x, y, i in sorted(finite):
        if y < best:
            front.append(i)
            best = y
    return front


def check_plan(plan: Sequence[OptionValues], window: float) -> None:
    """Raises SceneError or ArrayError for impossible options and for time steps that do not divide the window."""
    if not plan:
        raise SceneError("no settings to measure")
    sheet = Scene.parse({"cloth": [{"grid": {"size": [1, 1], "cells": [1, 1]}, "material": "cotton"}]})
    tried = set()
    for settings in plan:
        for name, value in settings.items():
            value_of(name, value)
        if "time_step" in settings:
            steps_of(window, settings["time_step"], f"{label(settings)}: window")
        if settings.get("resolution", 1) < 1:
            raise ArrayError(f"{label(settings)}: resolution must be 1 or more")
        own = tuple(sorted((k, v) for k, v in settings.items() if k not in ("time_step", "resolution")))
        if own not in tried:
            tried.add(own)
            Simulation(sheet, backend="cpu", threads=1, **dict(own))
