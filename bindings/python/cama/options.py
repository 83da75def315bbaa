# SPDX-License-Identifier: Apache-2.0
"""Options of a simulation: names, types, the values of accuracy levels, and how level, scene and caller combine.

All of the package that handles options by name or type uses this module.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from . import _core
from .errors import SceneError

# Who runs a scene chooses these; a scene may not.
OF_THE_CALLER = ("backend", "device", "threads", "audit", "intersections", "pinch")


def names(options: _core.Options) -> list[str]:
    """Returns the names of all options that a caller may give, without `accuracy`."""
    return [n for n in dir(options) if not n.startswith("_") and n not in ("preset", "accuracy")]


def values(options: _core.Options) -> dict[str, Any]:
    """Returns {name: value} of all options, `accuracy` among them."""
    return {n: getattr(options, n) for n in sorted((*names(options), "accuracy"))}


def option_types(accuracy: str = "production") -> dict[str, type]:
    """Returns {name: type} of all options, `accuracy` among them."""
    return {name: type(value) for name, value in values(_core.Options.preset(accuracy)).items()}


def _options(
    backend: str, precision: str | None, accuracy: str, device: int, threads: int, overrides: Mapping[str, Any]
) -> _core.Options:
    """Returns the options of a level with all given ones in place of the level's. Raises SceneError."""
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
    precision: str | None,
    accuracy: str | None,
    device: int,
    threads: int,
    overrides: Mapping[str, Any],
) -> tuple[_core.Options, set[str]]:
    """Combines the options of level, scene and caller, in this order.

    An accuracy level that the caller gives sets the scene's options aside.

    Returns:
        The options, and the names of those that come from the scene.

    Raises:
        SceneError
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
    """Raises SceneError for a name or a type that the options of a scene may not have."""
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
    """Returns the time step of a Scene at a level, s: the scene's if the level uses it, else the level's."""
    return _core.chosen_time_step(_core.Options.preset(accuracy), scene._core)
