# SPDX-License-Identifier: Apache-2.0
"""What the commands share: the types of their options, the console, and errors as one red line."""

import functools
from enum import Enum
from typing import Annotated, Optional

import typer
from rich.console import Console
from rich.markup import escape

from .. import _core
from ..errors import Error, SceneError
from ..options import option_types


class Backend(str, Enum):
    auto, cpu, opencl, cuda = "auto", "cpu", "opencl", "cuda"


class Precision(str, Enum):
    double, mixed, single = "double", "mixed", "single"


Accuracy = Enum("Accuracy", {name: name for name in _core.accuracy_levels()}, type=str)


class Store(str, Enum):
    double, single = "double", "single"


class Policy(str, Enum):
    reject, exempt, untangle = "reject", "exempt", "untangle"


class Pinch(str, Enum):
    stop, release = "stop", "release"


SceneName = Annotated[
    str, typer.Argument(metavar="SCENE", help="A folder with scene.json, a JSON file, or a shipped scene's name.")
]
BackendOption = Annotated[Backend, typer.Option(help="Where to compute.")]
PrecisionOption = Annotated[
    Optional[Precision], typer.Option(help="Of forces, matrix and solve; left out: what the accuracy says.")
]
AccuracyOption = Annotated[
    Optional[Accuracy],
    typer.Option(
        help="Level: time step, integrator, solver and collision options in one word; left out: the scene's options, else production."
    ),
]
TimeStep = Annotated[float, typer.Option(min=0.0, help="s; 0: the scene's at production and paper, else the level's.")]
Set = Annotated[
    Optional[list[str]],
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help="One option in place of the level's, for example tolerance=1e-4; may be repeated.",
    ),
]
Resolution = Annotated[int, typer.Option(min=0, help="Total number of cloth triangles aimed at; 0: the scene's own.")]
Threads = Annotated[
    int,
    typer.Option(min=0, help="Threads of the CPU backend; 0: one for every 1,000 triangles, at most all processors."),
]
Device = Annotated[int, typer.Option(min=0, help="Index of the backend's device.")]
Debug = Annotated[bool, typer.Option("--debug", help="Show Python's traceback of an error.")]

WHERE = (
    "backend",
    "device",
    "threads",
    "precision",
    "accuracy",
    "intersections",
    "pinch",
)  # options of the command's own


def clean(command):
    """Turns an exception of cama into one red line and exit code 2 (1 once a run has started)."""

    @functools.wraps(command)
    def run_clean(*arguments, debug=False, **options):
        try:
            return command(*arguments, debug=debug, **options)
        except Error as problem:
            if debug:
                raise
            fail(problem)
            raise typer.Exit(2) from None

    return run_clean


def fail(problem):
    """One red line on standard error."""
    Console(stderr=True, soft_wrap=True).print(
        f"[bold red]{type(problem).__name__}:[/] [red]{escape(str(problem))}[/]", highlight=False
    )


def chosen(accuracy, time_step, words):
    """Options of `--time-step` and `--set NAME=VALUE`, each of the type that the level has it in. Throws SceneError."""
    known, result = (
        option_types(accuracy.value if accuracy else "production"),
        {"time_step": time_step} if time_step else {},
    )
    for word in words or ():
        name, mark, text = word.partition("=")
        if not mark:
            raise SceneError(f"--set {word}: expected NAME=VALUE")
        if name in WHERE:
            raise SceneError(f"--set {word}: use --{name}")
        kind = known.get(name, str)
        try:
            result[name] = {"true": True, "false": False}[text.lower()] if kind is bool else kind(text)
        except (KeyError, ValueError):
            raise SceneError(f"--set {word}: {text!r} is not a {kind.__name__}") from None
    return result


def console():
    return Console(soft_wrap=True, highlight=False)
