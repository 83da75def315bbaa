# SPDX-License-Identifier: Apache-2.0
"""What settings a trade-off is measured over: knobs as this version has them, grids of their values, Pareto fronts."""

import itertools
import math
from fractions import Fraction

from .. import _core
from ..errors import ArrayError, SceneError
from ..options import OF_THE_CALLER, option_types
from ..scene import Scene
from ..simulation import Simulation
from .reference import steps_of

# Steps, s, and values that are tried where the caller names none.
STEPS = tuple(Fraction(1, n) for n in (60, 120, 240, 480, 960))
TOLERANCES, PRECISIONS = (1e-1, 1e-2, 1e-3), ("double", "mixed", "single")


def levels():
    """Names of the accuracy presets that this version has, from fast to exact, the paper's last."""
    return list(_core.accuracy_levels())


def knobs():
    """{name: type} of everything that may be varied: options of this version, `accuracy`, `time_step` and `resolution`."""
    own = {name: kind for name, kind in option_types().items() if name not in OF_THE_CALLER}
    return {**own, "time_step": float, "resolution": int}


def value_of(name, text):
    """A knob's value from text or itself: fractions such as 1/60 for numbers, true and false for switches. Throws SceneError."""
    known = knobs()
    if name not in known:
        raise SceneError(f"knob {name!r} is unknown; there are {', '.join(sorted(known))}")
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
            f"knob {name}: {text!r} is not a {'positive number' if kind is float else kind.__name__}"
        ) from None


def parse_knob(text):
    """("time_step", [1/60, 1/200]) of "time_step=1/60,1/200". Throws SceneError."""
    name, equals, values = str(text).partition("=")
    if not equals or not values.strip():
        raise SceneError(f"knob {text!r}: give name=value,value")
    return name.strip(), [value_of(name.strip(), v) for v in values.split(",")]


def product(chosen):
    """All combinations of {knob: [values]} as dicts. Throws SceneError."""
    chosen = {name: [value_of(name, v) for v in values] for name, values in dict(chosen).items()}
    for name, values in chosen.items():
        if not values:
            raise SceneError(f"knob {name}: no values")
    return [dict(zip(chosen, values)) for values in itertools.product(*chosen.values())]


def default_plan(scene, window):
    """Settings that say most: every level but `reference` as it is, and `production` with time steps by tolerances, in every precision at both ends,
    and with the second-order integrator and Newton's iterations where this version has them.
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


def _divides(step, span):
    return abs(round(span / step) * step - span) <= 1e-9 * span and round(span / step) >= 1


def unique(plan):
    """The same settings once, in order."""
    seen, kept = set(), []
    for settings in plan:
        key = tuple(sorted(settings.items()))
        if key not in seen:
            seen.add(key)
            kept.append(settings)
    return kept


def label(settings):
    """Settings in words: "production, dt 1/200 s, tolerance 0.01, mixed"."""
    words = []
    for name, value in settings.items():
        if name in ("accuracy", "precision"):
            words.append(str(value))
        elif name == "time_step":
            words.append(f"dt {step_text(value)} s")
        else:
            words.append(f"{name} {value:g}" if isinstance(value, float) else f"{name} {value}")
    return ", ".join(words) or "production"


def step_text(seconds):
    """1/200 where that is what it is, else the number."""
    parts = Fraction(seconds).limit_denominator(100000)
    return (
        f"{parts.numerator}/{parts.denominator}"
        if parts and abs(float(parts) / seconds - 1) < 1e-9
        else f"{seconds:.4g}"
    )


def pareto(points):
    """Indices of the points (x, y) that no other betters in one value without being worse in the other, by x. Points with a value that is
    not finite, or None, are never among them; of equal points the first is.
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


def check_plan(plan, window):
    """Throws SceneError or ArrayError for settings that no scene can run: unknown knobs, words or values, steps that do not divide the window."""
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
