# SPDX-License-Identifier: Apache-2.0
"""Shared parts of the commands `cama tradeoff` and `cama tune`: options, plans and the progress bar."""

import os
from typing import Annotated, Optional

import typer
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from ..errors import SceneError
from ..io.progress import Bar
from ..measuring import grid
from .common import console, positive_seconds

Vary = Annotated[
    Optional[list[str]],
    typer.Option(
        "--vary",
        metavar="NAME=V,V",
        help="Values of an option; several options are combined. Default: a plan of levels, time steps and tolerances.",
    ),
]
Also = Annotated[
    Optional[list[str]],
    typer.Option(
        metavar="NAME=V;NAME=V", help="One more combination of options, for example 'accuracy=paper'; may be repeated."
    ),
]
Backends = Annotated[list[str], typer.Option("--backend", help="Where to compute; may be given several times.")]
Resolution = Annotated[
    int, typer.Option(min=0, help="Approximate total number of cloth triangles; 0: the scene's own.")
]
Window = Annotated[
    float,
    typer.Option(
        parser=positive_seconds, metavar="SECONDS", help="Time from a state of the reference to the comparison, s."
    ),
]
ReferenceStep = Annotated[
    Optional[float],
    typer.Option(
        parser=positive_seconds, metavar="SECONDS", help="Time step of the reference, s. Default: 1/32 of the scene's."
    ),
]
Threads = Annotated[int, typer.Option(min=0, help="Threads of timed runs on the CPU backend; 0: as for run.")]
Device = Annotated[int, typer.Option(min=0, help="Index of the backend's device.")]
Jobs = Annotated[int, typer.Option(min=1, help="Number of timed runs at once; more than one slow each other down.")]
ErrorJobs = Annotated[
    int,
    typer.Option(
        min=0,
        help="Number of runs at once that measure only errors; 0: one for every core on cpu, one on other devices.",
    ),
]
ClusterAddress = Annotated[
    Optional[str],
    typer.Option("--cluster", metavar="ADDRESS", help="Run on this Ray cluster, for example auto or HOST:6379."),
]
Limit = Annotated[
    float, typer.Option(parser=positive_seconds, metavar="SECONDS", help="Largest wall time of a run, s.")
]
WarmUp = Annotated[int, typer.Option(min=0, help="Number of first steps that are not timed.")]
Debug = Annotated[bool, typer.Option("--debug", help="Show Python's traceback of an error.")]


def plan_of(vary, also):
    """Returns a plan from the texts of the options, or None: the default plan."""
    if not vary and not also:
        return None
    plan = grid.product(dict(grid.parse_values(k) for k in vary)) if vary else []
    for text in also or ():
        pairs = [grid.parse_values(part) for part in text.split(";") if part.strip()]
        if any(len(values) != 1 for _, values in pairs):
            raise SceneError(f"also {text!r}: give one value for each option")
        plan.append({name: values[0] for name, values in pairs})
    return plan


def backend_names(given):
    """Returns the names without "auto" and without repetitions."""
    return tuple(dict.fromkeys(os.environ.get("CAMA_BACKEND", "cpu") if name == "auto" else name for name in given))


def bar(console):
    """Returns a progress bar with the last run, the number of results and the time left."""
    return Bar(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=console,
    )


def follow(progress, task, before=""):
    """Returns a function of (done, all, words) that updates a task of the bar."""
    return lambda done, of, words: progress.update(
        task, completed=done, total=of or None, description=escape(before + words)
    )


class stoppable:
    """Turns Ctrl-C into exit code 130 and says where the results are kept."""

    def __init__(self, folder):
        self._folder = folder

    def __enter__(self):
        return self

    def __exit__(self, kind, problem, trace):
        if kind is KeyboardInterrupt:
            console().print(
                f"[yellow]Stopped; what was finished is kept in {escape(str(self._folder))}, the same command "
                "goes on from there.[/]"
            )
            raise typer.Exit(130) from None
        return False
