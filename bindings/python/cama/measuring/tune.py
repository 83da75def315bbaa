# SPDX-License-Identifier: Apache-2.0
"""The cheapest options that keep a budget, judged by a reference that the search did not use; `cama tune`.

tuned = cama.tune.tune("drape", "out/tune", error=1e-3)
tuned.write("drape-1mm.json")
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from .. import _core, shipped
from ..arrays import number
from ..errors import ArrayError, Error, FileError
from ..hints import without_comments
from ..options import nested, overrides_of
from ..scene import Scene
from ..types import PathLike
from .grid import OptionValues, label
from .tradeoff import Progress, Setup, Tradeoff, tradeoff

__all__ = ["tune", "Tuned", "Budget", "BudgetError", "parse_error", "parse_time"]

FRAME = 1 / 60  # s; what a budget of time is for


class BudgetError(Error):
    """No options that were tried keep the budget, or the judge found that the chosen ones do not."""


def parse_error(text: str) -> tuple[str, float]:
    """Returns ("m", 1e-3) for "1mm", "0.5 cm" or "2e-3m", and ("edges", 0.01) for "1%". Raises ArrayError."""
    match = re.fullmatch(r"\s*([0-9.eE+-]+)\s*(um|mm|cm|m|%)\s*", str(text))
    if not match:
        raise ArrayError(f"error: {text!r} is not a length such as 1mm or a part of an edge such as 1%")
    value = number("error", match[1])
    if not value > 0:
        raise ArrayError(f"error: {text!r} is not greater than 0")
    return (
        ("edges", value / 100)
        if match[2] == "%"
        else ("m", value * {"um": 1e-6, "mm": 1e-3, "cm": 1e-2, "m": 1.0}[match[2]])
    )


def parse_time(text: str) -> float:
    """Returns the seconds of "16ms" or "0.02s". Raises ArrayError."""
    match = re.fullmatch(r"\s*([0-9.eE+-]+)\s*(us|ms|s)\s*", str(text))
    value = number("time", match[1]) if match else 0.0
    if not value > 0:
        raise ArrayError(f"time: {text!r} is not a time such as 16ms")
    return value * {"us": 1e-6, "ms": 1e-3, "s": 1.0}[match[2]]


@dataclass
class Budget:
    """A largest position error after a window, a largest time for a frame of 1/60 s, or both.

    The error is in m or in mean edge lengths; it is the rms over the vertices or that of the worst vertex.
    """

    error: float | None = None  #: m
    edges: float | None = None  #: mean edge lengths
    frame: float | None = None  #: s of wall time for FRAME s
    measure: str = "rms"  #: or "max"

    def check(self) -> None:
        """Raises ArrayError if the budget is not possible."""
        if self.measure not in ("rms", "max"):
            raise ArrayError(f"measure: {self.measure!r} is not one of rms, max")
        given = [v for v in (self.error, self.edges, self.frame) if v is not None]
        if not given or any(not number("budget", v) > 0 for v in given):
            raise ArrayError("give an error or a time, greater than 0")
        if self.error is not None and self.edges is not None:
            raise ArrayError("give the error either in m or in edges")

    def error_of(self, point: Mapping[str, Any], edge: float) -> float | None:
        """Returns the error of a point, m, or None."""
        value = point.get("restart_rms_edges" if self.measure == "rms" else "restart_max_edges")
        return None if value is None else value * edge

    def limit(self, edge: float) -> float | None:
        """Returns the largest error allowed, m, or None."""
        return self.error if self.edges is None else self.edges * edge

    def keeps(self, point: Mapping[str, Any], edge: float, safety: float = 1.0) -> bool:
        """Returns whether a point keeps the budget with this margin. Points that failed or intersect never do."""
        if point["failed"] or point.get("intersections") or point.get("ms_per_second") is None:
            return False
        error, limit = self.error_of(point, edge), self.limit(edge)
        if limit is not None and (error is None or error * safety > limit):
            return False
        return self.frame is None or point["ms_per_second"] * 1e-3 * FRAME * safety <= self.frame

    def best(self, points: Iterable[dict[str, Any]], edge: float, safety: float) -> dict[str, Any] | None:
        """Returns the fastest point within the error budget, else the most accurate within the time budget, or None."""
        kept = [p for p in points if self.keeps(p, edge, safety)]
        if self.limit(edge) is not None:
            return min(kept, key=lambda p: p["ms_per_second"], default=None)
        return min(
            (p for p in kept if self.error_of(p, edge) is not None), key=lambda p: self.error_of(p, edge), default=None
        )


@dataclass
class Tuned:
    """Options that keep a budget."""

    settings: OptionValues  #: values of options
    found: dict[str, Any]  #: the point that the search measured
    judged: dict[str, Any]  #: the point that the judge measured
    safety: float  #: factor that the search kept to spare
    rounds: int  #: choices that were judged, the last one kept
    edge: float  #: m
    search: Tradeoff = field(repr=False)  #: tradeoff.Tradeoff
    judge: Tradeoff = field(repr=False)  #: the judge's
    source: Scene | PathLike = field(repr=False)  #: what was tuned

    def scene(self) -> Scene:
        """Returns the scene with the options."""
        base = (
            self.source
            if isinstance(self.source, Scene)
            else Scene.load(self.source, self.settings.get("resolution", 0))
        )
        return Scene.parse(json.dumps(applied(json.loads(base.to_json()), self.settings)))

    def remark(self) -> str:
        """Returns a text that says what was measured."""

        def unit(p):
            return (
                f"{1e3 * p['restart_rms']:.3g} mm rms, {p['restart_max_edges']:.3g} edges largest, "
                f"{p['ms_per_second'] * FRAME:.3g} ms per frame"
            )

        return (
            f"cama tune: {label(self.settings)}: search {unit(self.found)}; judge {unit(self.judged)}; "
            f"{self.judged['device_name']}"
        )

    def write(self, path: PathLike) -> None:
        """Writes the scene file with the options in it; references to files stay valid. Raises FileError."""
        write_scene(self.source, self.settings, path, self.remark())


def applied(data: Mapping[str, Any], settings: OptionValues) -> dict[str, Any]:
    """Returns scene data (as in scene.json) with the options where `cama run` reads them; the clip keeps its length."""
    data, own = dict(data), dict(settings)
    if "resolution" in own:
        data["resolution"] = own.pop("resolution")
    if "time_step" in own:
        step = own["time_step"]
        frame = data.get("frame_time") or data.get("time_step") or 1 / 60
        seconds = frame * data.get("frames", 100)
        data["time_step"] = step
        data["frame_time"] = step * max(1, round(frame / step))
        data["frames"] = max(1, round(seconds / data["frame_time"]))
    _core.check_scene_options(overrides_of(own))
    data["options"] = nested(own)
    return data


def _anchored(value, folder):
    """Returns the value with absolute paths for texts that name files beside the scene."""
    if isinstance(value, dict):
        return {k: v if k in ("name", "description") else _anchored(v, folder) for k, v in value.items()}
    if isinstance(value, list):
        return [_anchored(v, folder) for v in value]
    if isinstance(value, str) and value and len(value) < 1024 and "\n" not in value and (folder / value).is_file():
        return str((folder / value).resolve())
    return value


def write_scene(source: Scene | PathLike, settings: OptionValues, path: PathLike, remark: str = "") -> None:
    """Writes a scene file with options. Comments are lost; keys and their order are kept.

    Args:
        source: A Scene, or what `Scene.load` accepts. If its folder is another one, its files get absolute paths.
        settings: Options, `time_step` and `resolution`.
        path: The file to write.
        remark: A text for the key "$tuned".

    Raises:
        FileError, SceneError
    """
    path = Path(path)
    if isinstance(source, Scene):
        data = json.loads(source.to_json())
    else:
        file = shipped.resolve(source)
        file = file / "scene.json" if file.is_dir() else file
        try:
            data = json.loads(without_comments(file.read_text(encoding="utf-8")))
        except (OSError, ValueError) as problem:
            raise FileError(f"{file}: {problem}") from None
        if file.parent.resolve() != path.parent.resolve():
            data = _anchored(data, file.parent)
            data.pop("$schema", None)
    data = applied(data, settings)
    if remark:
        data["$tuned"] = remark
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(data, indent=2) + "\n", encoding="utf-8")
    except OSError as problem:
        raise FileError(f"{path}: {problem.strerror}") from None


def tune(
    scene: Scene | PathLike,
    output: PathLike,
    error: float | None = None,
    edges: float | None = None,
    frame: float | None = None,
    measure: Literal["rms", "max"] = "rms",
    plan: Iterable[Mapping[str, Any]] | None = None,
    safety: float = 1.5,
    rounds: int = 3,
    windows: int = 6,
    window: float = 0.05,
    reference_step: float | None = None,
    resolution: int = 0,
    setup: Setup | None = None,
    progress: Progress | None = None,
) -> Tuned:
    """Picks the cheapest options that keep a budget, and has them judged.

    The search starts its windows at odd multiples of `window`, the judge at even ones with half the time step for the
    reference. If the judge measures more than the budget, the factor `safety` grows by 1.5 and the next choice is
    judged on later windows.

    Args:
        scene, output, plan, window, reference_step, resolution, setup, progress: As for `tradeoff.tradeoff`.
        error: Largest position error after a window, m.
        edges: The same in mean edge lengths, in place of `error`.
        frame: Wall time allowed for 1/60 s, s. Without an error budget, the most accurate options within it are picked.
        measure: "rms" over the vertices, or "max".
        safety: Factor by which the search's measurement must be below the budget.
        rounds: Largest number of choices that are judged.
        windows: Number of start states.

    Returns:
        A Tuned.

    Raises:
        BudgetError: No options keep the budget, or it is less than three times the reference's own uncertainty.
        cama.Error: As for `tradeoff.tradeoff`.
    """
    budget = Budget(error, edges, frame, measure)
    budget.check()
    safety, rounds = number("safety", safety), int(rounds)
    if safety < 1 or rounds < 1:
        raise ArrayError(f"safety {safety} and rounds {rounds} must be 1 or more")
    say = progress or (lambda *_: None)
    common = dict(resolution=resolution, window=window, windows=windows, stride=2, setup=setup)
    search = tradeoff(scene, output, plan, first=1, reference_step=reference_step, progress=say, **common)
    edge, refused = search.reference.edge, None
    doubt = (
        math.sqrt((search.reference.uncertainty**2).mean())
        if measure == "rms"
        else search.reference.uncertainty_largest.max()
    )
    if budget.limit(edge) is not None and 3 * doubt > budget.limit(edge):
        raise BudgetError(
            f"the reference may be off by {1e3 * doubt:.3g} mm itself, which is not well below the budget of "
            f"{1e3 * budget.limit(edge):.3g} mm; give a smaller reference step, fewer windows or a larger budget"
        )
    for number_of in range(1, rounds + 1):
        chosen = budget.best(search.points, edge, safety)
        if chosen is None:
            raise BudgetError(_shortfall(search, budget, safety, refused))
        judge = tradeoff(
            scene,
            output,
            [chosen["settings"]],
            first=2 + 2 * windows * (number_of - 1),
            reference_step=search.reference.time_step / 2,
            progress=lambda done, of, words: say(done, of, f"judge: {words}"),
            **common,
        )
        verdict = next(p for p in judge.points if p["backend"] == chosen["backend"])
        if budget.keeps(verdict, edge):
            settings = {**({"resolution": int(resolution)} if resolution else {}), **chosen["settings"]}
            return Tuned(settings, chosen, verdict, safety, number_of, edge, search, judge, scene)
        refused, safety = f"{chosen['label']} was refused by the judge: {_words(verdict, budget, edge)}", 1.5 * safety
    raise BudgetError(
        f"{rounds} choices were refused by the judge; the last: {refused}; give more settings or a larger budget"
    )


def _words(point, budget, edge):
    if point["failed"]:
        return point["failed"]
    error = budget.error_of(point, edge)
    words = "" if error is None else f"{1e3 * error:.3g} mm {budget.measure}, "
    return words + f"{point['ms_per_second'] * FRAME:.3g} ms per frame, {point['intersections']} intersections"


def _shortfall(search, budget, safety, refused):
    """Returns a text that says how close the options that were tried come."""
    good = [p for p in search.points if not p["failed"] and budget.error_of(p, search.reference.edge) is not None]
    edge, text = search.reference.edge, f"no settings keep the budget with a factor of {safety:.3g} to spare"
    if good:
        best, fastest = min(good, key=lambda p: budget.error_of(p, edge)), min(good, key=lambda p: p["ms_per_second"])
        text += (
            f"; most accurate: {best['label']} ({_words(best, budget, edge)}); fastest: {fastest['label']} "
            f"({_words(fastest, budget, edge)})"
        )
    else:
        text += "; every run failed: " + "; ".join(sorted({str(p["failed"]) for p in search.points}))[:400]
    return text + (f"; {refused}" if refused else "")
