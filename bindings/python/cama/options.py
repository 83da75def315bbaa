# SPDX-License-Identifier: Apache-2.0
"""Options of a simulation: names, types, the accuracy levels' values, and how level, scene and caller are merged.

Everything in the package that knows options by name or type asks this module.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Optional

from . import _core
from .errors import SceneError

# Who runs a scene chooses these; a scene may not.
OF_THE_CALLER = ("backend", "device", "threads", "audit", "intersections", "pinch")


def names(options: _core.Options) -> list[str]:
    """Names of all options that a caller may give, beside `accuracy`. options: compiled ones."""
    return [n for n in dir(options) if not n.startswith("_") and n not in ("preset", "accuracy")]


def values(options: _core.Options) -> dict[str, Any]:
    """{name: value} of compiled options, `accuracy` among them."""
    return {n: getattr(options, n) for n in sorted((*names(options), "accuracy"))}


def option_types(accuracy: str = "production") -> dict[str, type]:
    """{name: type} of all options, `accuracy` among them."""
    return {name: type(value) for name, value in values(_core.Options.preset(accuracy)).items()}


def _options(
    backend: str, precision: Optional[str], accuracy: str, device: int, threads: int, overrides: Mapping[str, Any]
) -> _core.Options:
    """Compiled options: the level's with everything given in its place. Throws SceneError."""
    options = _core.Options.preset(accuracy)
    known = names(options)
    given = dict(backend=backend, device=device, threads=threads, **overrides)
    if precision is not None:
        given["precision"] = precision
    for name, value in given.items():
        if name not in known:
            raise SceneError(f"option {name!r} is unknown; there are {', '.join(known)}")
        try:
            setattr(options, name, value)
        except TypeError:
            raise SceneError(
                f"option {name}: {value!r} is of the wrong type, expected like {getattr(options, name)!r}"
            ) from None
    return options


def merged(
    of_scene: Mapping[str, Any],
    backend: str,
    precision: Optional[str],
    accuracy: Optional[str],
    device: int,
    threads: int,
    overrides: Mapping[str, Any],
) -> tuple[_core.Options, set[str]]:
    """(compiled options, names of the options that the scene gave): level, then scene, then caller. of_scene: `Scene.options`.

    An accuracy that the caller gives sets the scene's options aside. Throws SceneError.
    """
    taken = set()
    if accuracy is None:
        taken = set(of_scene) - {name for name, value in overrides.items() if name != "time_step" or value}
        taken -= set() if precision is None else {"precision"}
        overrides = {**of_scene, **{k: v for k, v in overrides.items() if k != "time_step" or v}}
        accuracy, own = overrides.pop("accuracy", "production"), overrides.pop("precision", None)
        precision = own if precision is None else precision
    return _options(backend, precision, accuracy, device, threads, overrides), taken


def check_scene_options(options: Mapping[str, Any]) -> None:
    """Throws SceneError for a name or a type that a scene's options may not have."""
    for name in options:
        if name in OF_THE_CALLER:
            raise SceneError(f"options: {name!r} is chosen by who runs the scene, not by the scene")
    single = dict(options)
    try:
        accuracy = single.pop("accuracy", "production")
        if not isinstance(accuracy, str):
            raise SceneError(f"option accuracy: {accuracy!r} is not a text")
        _options("auto", None, accuracy, 0, 0, single)
    except SceneError as problem:
        raise SceneError(f"options: {problem}") from None


def level_time_step(accuracy: str, scene: Any) -> float:
    """The time step of a Scene at a level, s: the scene's own where the level takes it as it is, else the level's."""
    return _core.chosen_time_step(_core.Options.preset(accuracy), scene._core)
