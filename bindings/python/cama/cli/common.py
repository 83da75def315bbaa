# SPDX-License-Identifier: Apache-2.0
"""Shared parts of the commands: types of options, the console, errors as one red line."""

import contextlib
import functools
import inspect
import math
import os
import sys
import warnings
from dataclasses import dataclass, fields
from enum import Enum
from fractions import Fraction
from typing import Annotated, Optional

import typer
from rich.console import Console
from rich.markup import escape

from .. import _core, options
from ..errors import Error, SceneError
from ..hints import naming_files
from ..material import Material
from ..plausibility import PlausibilityWarning


def choice(title, words):
    """Returns an enumeration of words for a command line."""
    return Enum(title, {word: word for word in words}, type=str)


Backend = choice("Backend", ["auto", *(backend["name"] for backend in _core.list_backends())])
Precision = choice("Precision", options.words("precision"))
Accuracy = choice("Accuracy", _core.accuracy_levels())
Policy = choice("Policy", options.words("intersections"))
Pinch = choice("Pinch", options.words("pinch"))
Store = choice("Store", ["double", "single"])


def option_names(incomplete):
    """Completes the name of an option for --set."""
    for row in options.option_table():
        if row["name"].startswith(incomplete) and row["name"] not in WHERE:
            yield row["name"] + "=", row["help"]


def seconds(text):
    """Returns a time, s, of a text such as 0.005 or 1/200. Raises typer.BadParameter."""
    try:
        value = float(text if isinstance(text, float) else Fraction(str(text).strip()))
    except (ValueError, ZeroDivisionError, OverflowError):
        value = math.nan
    if not 0 <= value < math.inf:
        raise typer.BadParameter(f"{text!r} is not a number of seconds such as 0.005 or 1/200")
    return value


def positive_seconds(text):
    """As `seconds`, but 0 is refused too."""
    if seconds(text) == 0:
        raise typer.BadParameter(f"{text!r} is not above 0")
    return seconds(text)


SceneName = Annotated[
    str, typer.Argument(metavar="SCENE", help="A folder with scene.json, a JSON file, or a shipped scene's name.")
]
BackendOption = Annotated[Backend, typer.Option(help=options.help_of("backend"))]
PrecisionOption = Annotated[
    Optional[Precision],
    typer.Option(help="Precision of forces, matrix and solve. Default: the accuracy level's."),
]
AccuracyOption = Annotated[
    Optional[Accuracy],
    typer.Option(
        help="Accuracy level: one word for time step, integrator, solver and collision options. "
        "Default: the scene's, else production."
    ),
]
TimeStep = Annotated[
    float,
    typer.Option(parser=seconds, metavar="SECONDS", help=f"{options.help_of('time_step')} For example 1/200."),
]
ErrorOption = Annotated[str, typer.Option(metavar="LENGTH", help=options.help_of("error"))]
Set = Annotated[
    Optional[list[str]],
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help="An option in place of the level's, for example tolerance=1e-4 or paper.search=fronts; may be repeated.",
        autocompletion=option_names,
    ),
]
Resolution = Annotated[
    int, typer.Option(min=0, help="Approximate total number of cloth triangles; 0: the scene's own.")
]
Threads = Annotated[
    int,
    typer.Option(min=0, help=options.help_of("threads")),
]
Device = Annotated[int, typer.Option(min=0, help=options.help_of("device"))]
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


@dataclass
class Computing:
    """How to compute a scene: the options that `cama run`, `cama explain` and `cama view` have in common."""

    backend: BackendOption = Backend.auto
    precision: PrecisionOption = None
    accuracy: AccuracyOption = None
    time_step: TimeStep = 0.0
    error: ErrorOption = ""
    set_: Set = None
    resolution: Resolution = 0
    threads: Threads = 0
    device: Device = 0

    def load(self, scene):
        """Returns the Scene of a name or file."""
        from ..scene import Scene

        return Scene.load(scene, self.resolution)

    def simulation(self, scene, **overrides):
        """Returns the Simulation of a Scene; overrides: options of the command's own."""
        from ..simulation import Simulation

        return Simulation(
            scene,
            backend=self.backend.value,
            precision=self.precision.value if self.precision else None,
            accuracy=self.accuracy.value if self.accuracy else None,
            device=self.device,
            threads=self.threads,
            **chosen(self.time_step, self.set_, self.error),
            **overrides,
        )


def computing(command):
    """Decorates a command that takes `how`, a Computing: on the command line its options stand there."""
    shared = [
        inspect.Parameter(f.name, inspect.Parameter.KEYWORD_ONLY, default=f.default, annotation=f.type)
        for f in fields(Computing)
    ]

    @functools.wraps(command)
    def run(**keywords):
        return command(how=Computing(**{row.name: keywords.pop(row.name) for row in shared}), **keywords)

    own = [row.replace(kind=inspect.Parameter.KEYWORD_ONLY) for row in inspect.signature(command).parameters.values()]
    at = [row.name for row in own].index("how")
    rows = [*own[:at], *shared, *own[at + 1 :]]
    run.__signature__ = inspect.Signature(rows)
    run.__annotations__ = {row.name: row.annotation for row in rows}
    return run


def clean(command):
    """Decorates a command: an error of cama becomes one red line and exit code 2."""

    @functools.wraps(command)
    def run_clean(*arguments, debug=False, **keywords):
        try:
            with plain_warnings(), naming_files():
                return command(*arguments, debug=debug, **keywords)
        except Error as problem:
            if debug:
                raise
            fail(problem)
            raise typer.Exit(2) from None

    return run_clean


@contextlib.contextmanager
def plain_warnings():
    """Prints each PlausibilityWarning once, as a yellow line on standard error, without the place in the code."""
    said = set()

    with warnings.catch_warnings():
        usual = warnings.showwarning

        def show(message, category, *place):
            if not issubclass(category, PlausibilityWarning):
                usual(message, category, *place)
            elif str(message) not in said:
                said.add(str(message))
                caution(message)

        warnings.showwarning = show
        yield


def caution(text):
    """Prints a warning as one yellow line on standard error."""
    Console(stderr=True, soft_wrap=True).print(f"[yellow]{escape(str(text))}[/]", highlight=False)


def fail(problem, verdict=""):
    """Prints an error as one red line on standard error, after words that say what it means."""
    Console(stderr=True, soft_wrap=True).print(
        f"[bold red]{verdict}{type(problem).__name__}:[/] [red]{escape(str(problem))}[/]", highlight=False
    )


def chosen(time_step, words, error=""):
    """Returns the options of `--time-step`, `--error` and `--set NAME=VALUE`, {name: value}. Raises SceneError."""
    result = _core.OptionOverrides()
    if error:
        result.set("error", error)
    if time_step:
        result.set("time_step", time_step)
    for word in words or ():
        name, mark, text = word.partition("=")
        if not mark:
            raise SceneError(f"--set {word}: give it as NAME=VALUE")
        if name in WHERE:
            raise SceneError(f"--set {word}: use --{name}")
        try:
            result.set_text(name, text)
        except SceneError as problem:
            raise SceneError(f"--set {word}: {problem}") from None
    return result.values()


def put_materials(scene, words):
    """Gives cloths the materials of `--material [CLOTH=]MATERIAL`; each keeps its contact thickness.

    Raises SceneError, MaterialError, FileError.
    """
    for word in words or ():
        name, mark, text = word.rpartition("=")
        cloths = [cloth for cloth in scene.cloths if not mark or cloth.name == name]
        if not cloths:
            raise SceneError(
                f"--material {word}: there is no cloth {name!r}; there are {[c.name for c in scene.cloths]}"
            )
        material = Material.of(text)
        for cloth in cloths:
            thickness = material.thickness or cloth.material.thickness
            cloth.material = material.with_thickness(thickness)


def rest_lines(scene):
    """Returns a line for each cloth from a mesh, which says what its rest shape is."""
    return [
        f"{cloth.name}: the rest shape is {'the start' if cloth.rest_shape == 'start' else cloth.rest_shape}"
        for cloth in scene.cloths
        if cloth.rest_shape != "material coordinates"
    ]


def console():
    """Returns the console of a command's answer. In a pipe or a file, whose width nobody knows, tables are not cut."""
    wide = not sys.stdout.isatty() and "COLUMNS" not in os.environ
    return Console(soft_wrap=True, highlight=False, width=160 if wide else None)
