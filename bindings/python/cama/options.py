# SPDX-License-Identifier: Apache-2.0
"""Options of a simulation, by the table of options of the compiled module (libcama/include/cama/options.def).

All of the package that handles options by name or type uses this module.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from . import _core
from .errors import SceneError

if TYPE_CHECKING:
    from ._core import OptionInfo
    from .scene import Scene

__all__ = ["option_table"]

TYPES: dict[str, type] = {"boolean": bool, "integer": int, "number": float, "choice": str, "text": str}


def option_table() -> list[OptionInfo]:
    """Returns the table of options, a dict for each.

    Keys: name ("tolerance", "paper.search"), type ("number", "integer", "boolean", "choice" or "text"), words (of a
    choice), levels ({accuracy level: value}), range (text), unit, set_by ("scene": by a scene file or the user; "user":
    by the user alone), trades (what it trades accuracy for time in; empty: nothing), help.
    """
    return _core.option_table()


def words(name: str) -> list[str]:
    """Returns the words of a choice."""
    return next(row["words"] for row in option_table() if row["name"] == name)


def help_of(name: str) -> str:
    """Returns what the table says of an option."""
    return next(row["help"] for row in option_table() if row["name"] == name)


def option_types(set_by: str | None = None) -> dict[str, type]:
    """Returns {name: type} of all options, or of those that the scene ("scene") or the user alone ("user") may set."""
    return {row["name"]: TYPES[row["type"]] for row in option_table() if set_by in (None, row["set_by"])}


def overrides_of(given: Mapping[str, Any]) -> _core.OptionOverrides:
    """Returns options that replace those of scene and level.

    Args:
        given: {name: value}; those of the paper as "paper.NAME" or as a mapping "paper". None: not given.

    Raises:
        SceneError: A name is not known, or a value is not one of its option.
    """
    overrides = _core.OptionOverrides()
    for name, value in given.items():
        for inner, entry in value.items() if isinstance(value, Mapping) else [("", value)]:
            full = f"{name}.{inner}" if inner else name
            if entry is None:
                continue
            try:
                overrides.set(full, entry)
            except TypeError:
                raise SceneError(f"option {full}: {entry!r} is of the wrong type") from None
    return overrides


def nested(values: Mapping[str, Any]) -> dict[str, Any]:
    """Returns {name: value} with the options of the paper in a dict of their own, as scene.json has them."""
    result: dict[str, Any] = {}
    for name, value in values.items():
        group, dot, inner = name.partition(".")
        if dot:
            result.setdefault(group, {})[inner] = value
        else:
            result[name] = value
    return result


def level_time_step(accuracy: str, scene: Scene) -> float:
    """Returns the time step of a scene at a level, s: the scene's if the level uses it, else the level's."""
    return _core.level_time_step(accuracy, scene._core)


def signature(function: Callable[..., Any]) -> inspect.Signature:
    """Returns the signature of a function that takes options as keywords, with every option by its name."""
    own = inspect.signature(function)
    parameters = [p for p in own.parameters.values() if p.kind is not p.VAR_KEYWORD]
    known = {p.name for p in parameters}
    names = dict.fromkeys(row["name"].partition(".")[0] for row in option_table())
    parameters += [inspect.Parameter(n, inspect.Parameter.KEYWORD_ONLY, default=None) for n in names if n not in known]
    return own.replace(parameters=parameters)
