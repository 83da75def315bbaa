# SPDX-License-Identifier: Apache-2.0
"""What the commands `cama tradeoff` and `cama tune` share: their options, a plan of settings from texts, the progress bar."""

import os
from typing import Annotated, Optional

import typer
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from ..errors import SceneError
from ..measuring import grid
from .common import console

Knobs = Annotated[
    Optional[list[str]],
    typer.Option(
        "--knob",
        metavar="NAME=V,V",
        help="Values of a knob; several knobs are combined. Default: a grid that says most.",
    ),
]
Also = Annotated[
    Optional[list[str]],
    typer.Option(metavar="NAME=V;NAME=V", help="One more setting beside the grid, for example 'accuracy=paper'."),
]
Backends = Annotated[list[str], typer.Option("--backend", help="Where to compute; may be given several times.")]
Resolution = Annotated[int, typer.Option(min=0, help="Total number of cloth triangles aimed at; 0: the scene's own.")]
Window = Annotated[float, typer.Option(min=1e-6, help="Seconds from a state of the reference to the comparison.")]
ReferenceStep = Annotated[
    Optional[float], typer.Option(help="Time step of the reference, s; default: the scene's / 32.")
]
Threads = Annotated[int, typer.Option(min=0, help="Threads of timed runs on the CPU backend; 0: as for run.")]
Device = Annotated[int, typer.Option(min=0, help="Index of the backend's device.")]
Jobs = Annotated[int, typer.Option(min=1, help="Timed runs at once; more than one disturb each other.")]
ErrorJobs = Annotated[
    int,
    typer.Option(
        min=0,
        help="Runs at once that measure errors alone; 0: as many as there are processors on cpu, one on other devices.",
    ),
]
ClusterAddress = Annotated[
    Optional[str],
    typer.Option("--cluster", metavar="ADDRESS", help="Run on this Ray cluster, for example auto or HOST:6379."),
]
Limit = Annotated[float, typer.Option(min=1e-3, help="Seconds of wall time for one run.")]
WarmUp = Annotated[int, typer.Option(min=0, help="Steps that are not timed.")]
Debug = Annotated[bool, typer.Option("--debug", help="Show Python's traceback of an error.")]


def plan_of(knobs, also):
    """List of settings from the texts of the options, or None: the default grid."""
    if not knobs and not also:
        return None
    plan = grid.product(dict(grid.parse_knob(k) for k in knobs)) if knobs else []
    for text in also or ():
        pairs = [grid.parse_knob(part) for part in text.split(";") if part.strip()]
        if any(len(values) != 1 for _, values in pairs):
            raise SceneError(f"also {text!r}: give one value for each knob")
        plan.append({name: values[0] for name, values in pairs})
    return plan


def backend_names(given):
    """Names without "auto", each once."""
    return tuple(dict.fromkeys(os.environ.get("CAMA_BACKEND", "cpu") if name == "auto" else name for name in given))


def bar(console):
    """What was run last, how many results there are, time left."""
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=console,
        transient=True,
    )


def follow(progress, task, before=""):
    """What moves a task of the bar: a function of (done, all, words)."""
    return lambda done, of, words: progress.update(
        task, completed=done, total=of or None, description=escape(before + words)
    )


class stoppable:
    """Ctrl-C ends with exit code 130 and says what is kept."""

    def __init__(self, folder):
        self._folder = folder

    def __enter__(self):
        return self

    def __exit__(self, kind, problem, trace):
        if kind is KeyboardInterrupt:
            console().print(
                f"[yellow]Stopped; what was finished is kept in {escape(str(self._folder))}, the same command goes on from there.[/]"
            )
            raise typer.Exit(130) from None
        return False
