# SPDX-License-Identifier: Apache-2.0
"""The commands `cama tradeoff` and `cama tune`."""

import os
from pathlib import Path
from typing import Annotated, List, Optional

import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

from . import tradeoff, tradeoff_grid, tradeoff_report, tune
from .errors import SceneError

Knobs = Annotated[Optional[List[str]], typer.Option("--knob", metavar="NAME=V,V", help="Values of a knob; several knobs are combined. Default: a grid that says most.")]
Also = Annotated[Optional[List[str]], typer.Option(metavar="NAME=V;NAME=V", help="One more setting beside the grid, for example 'accuracy=paper'.")]
Backends = Annotated[List[str], typer.Option("--backend", help="Where to compute; may be given several times.")]
Resolution = Annotated[int, typer.Option(min=0, help="Total number of cloth triangles aimed at; 0: the scene's own.")]
Window = Annotated[float, typer.Option(min=1e-6, help="Seconds from a state of the reference to the comparison.")]
ReferenceStep = Annotated[Optional[float], typer.Option(help="Time step of the reference, s; default: the scene's / 32.")]
Threads = Annotated[int, typer.Option(min=0, help="Threads of timed runs on the CPU backend; 0: as for run.")]
Device = Annotated[int, typer.Option(min=0, help="Index of the backend's device.")]
Jobs = Annotated[int, typer.Option(min=1, help="Timed runs at once; more than one disturb each other.")]
ErrorJobs = Annotated[int, typer.Option(min=0, help="Runs at once that measure errors alone; 0: as many as there are processors on cpu, one on other devices.")]
ClusterAddress = Annotated[Optional[str], typer.Option("--cluster", metavar="ADDRESS", help="Run on this Ray cluster, for example auto or HOST:6379.")]
Limit = Annotated[float, typer.Option(min=1e-3, help="Seconds of wall time for one run.")]
WarmUp = Annotated[int, typer.Option(min=0, help="Steps that are not timed.")]
Debug = Annotated[bool, typer.Option("--debug", help="Show Python's traceback of an error.")]


def plan_of(knobs, also):
    """List of settings from the texts of the options, or None: the default grid."""
    if not knobs and not also:
        return None
    plan = tradeoff_grid.product(dict(tradeoff_grid.parse_knob(k) for k in knobs)) if knobs else []
    for text in also or ():
        pairs = [tradeoff_grid.parse_knob(part) for part in text.split(";") if part.strip()]
        if any(len(values) != 1 for _, values in pairs):
            raise SceneError(f"also {text!r}: give one value for each knob")
        plan.append({name: values[0] for name, values in pairs})
    return plan


def backend_names(given):
    """Names without "auto", each once."""
    return tuple(dict.fromkeys(os.environ.get("CAMA_BACKEND", "cpu") if name == "auto" else name for name in given))


def bar(console):
    """What was run last, how many results there are, time left."""
    return Progress(TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn(), console=console,
                    transient=True)


def front_table(results):
    """The fronts, fastest first."""
    table = Table("scene", "backend", box=None, padding=(0, 1), title="Fronts: ms per simulated second and rms error")
    table.add_column("settings", overflow="fold")
    for title in ("ms", "edges", "mm"):
        table.add_column(title, justify="right", no_wrap=True)
    for r in results:
        for backend, name, cost, edges, millimetres in tradeoff_report.summary_rows(r):
            table.add_row(escape(r.scene), backend, escape(name), f"{cost:,.4g}", f"{edges:.3g}", f"{millimetres:.3g}")
    return table


def register(app, clean, console):
    """Adds the commands to a typer application. clean: its decorator for errors."""

    @app.command("tradeoff")
    @clean
    def tradeoff_command(scenes: Annotated[List[str], typer.Argument(metavar="SCENE...", help="As for run.")],
                         knob: Knobs = None, also: Also = None, backend: Backends = ("auto",), resolution: Resolution = 0, window: Window = 0.05,
                         windows: Annotated[int, typer.Option(min=1, help="Start states.")] = 8,
                         first: Annotated[int, typer.Option(min=0, help="Windows that are left out at the start.")] = 1,
                         reference_step: ReferenceStep = None, threads: Threads = 0, device: Device = 0, jobs: Jobs = 1, error_jobs: ErrorJobs = 0,
                         cluster: ClusterAddress = None, limit: Limit = 600.0, warm_up: WarmUp = 5,
                         plots: Annotated[bool, typer.Option(help="Write plots and the page (matplotlib).")] = True,
                         join: Annotated[Optional[List[Path]], typer.Option(metavar="FILE", help="A tradeoff.json of another run or machine: its other backends "
                                                                                                 "are shown beside these; may be repeated.")] = None,
                         output: Annotated[Path, typer.Option("--output", "-o", metavar="OUT", help="Folder of results; finished ones are kept there.")] = Path("out/tradeoff"),
                         debug: Debug = False):
        """Measures what settings cost and get wrong; writes OUT/tradeoff.csv, .json, plots and index.html. Run again, it goes on."""
        plan = plan_of(knob, also)
        setup = tradeoff.Setup(backend_names(backend), device, threads, jobs, error_jobs, cluster, limit, warm_up)
        results = []
        with bar(Console(stderr=True, highlight=False)) as progress, stoppable(console, output):
            for scene in scenes:
                task = progress.add_task(escape(scene), total=None)
                results.append(tradeoff.tradeoff(scene, output, plan, resolution, window, windows, first, 1, reference_step, setup,
                                                 lambda done, of, words: progress.update(task, completed=done, total=of or None,
                                                                                         description=f"{escape(scene)}: {escape(words)}")))
                tradeoff_report.write(results, output, plots)
        for file in join or ():
            tradeoff.join(results, file)
        if join:
            tradeoff_report.write(results, output, plots)
        out = console()
        out.print(front_table(results))
        failed = [p for r in results for p in r.points if p["failed"]]
        for p in failed[:10]:
            out.print(f"[red]failed:[/] {p['backend']}, {escape(p['label'])}: {escape(p['failed'])}")
        for r in results:
            out.print(f"{escape(r.scene)}: the reference may be off by {r.facts['uncertainty_edges']:.2g} edge lengths itself"
                      + ("" if r.facts["converged"] else " [bold red]and has not converged[/]"))
        out.print(f"written to {escape(str(output))}")
        if len(failed) == sum(len(r.points) for r in results):
            raise typer.Exit(1)

    @app.command("tune")
    @clean
    def tune_command(scene: Annotated[str, typer.Argument(metavar="SCENE", help="As for run.")],
                     error: Annotated[Optional[str], typer.Option(metavar="LENGTH", help="Largest allowed error: 1mm, or 1% of an edge.")] = None,
                     time: Annotated[Optional[str], typer.Option(metavar="TIME", help="Allowed for a frame of 1/60 s: 16ms.")] = None,
                     measure: Annotated[str, typer.Option(help="rms or max over the vertices.")] = "rms",
                     safety: Annotated[float, typer.Option(min=1.0, help="The search must be below the budget by this factor.")] = 1.5,
                     knob: Knobs = None, also: Also = None, backend: Annotated[str, typer.Option(help="Where to compute.")] = "auto",
                     resolution: Resolution = 0, window: Window = 0.05,
                     windows: Annotated[int, typer.Option(min=1, help="Start states of the search, and as many of the judge.")] = 6,
                     reference_step: ReferenceStep = None, threads: Threads = 0, device: Device = 0, error_jobs: ErrorJobs = 0,
                     cluster: ClusterAddress = None, limit: Limit = 600.0, warm_up: WarmUp = 5,
                     results: Annotated[Path, typer.Option(metavar="FOLDER", help="Finished results are kept there.")] = Path("out/tradeoff"),
                     output: Annotated[Optional[Path], typer.Option("--output", "-o", metavar="FILE", help="Scene file to write; default: out/tune/SCENE/scene.json.")] = None,
                     debug: Debug = False):
        """Picks the cheapest settings for a budget of error or time, has them judged, and writes a scene file with them."""
        metric, limit_of_error = tune.parse_error(error) if error else (None, None)
        setup = tradeoff.Setup(backend_names([backend]), device, threads, 1, error_jobs, cluster, limit, warm_up)
        with bar(Console(stderr=True, highlight=False)) as progress, stoppable(console, results):
            task = progress.add_task(escape(scene), total=None)
            tuned = tune.tune(scene, results, error=limit_of_error if metric == "m" else None, edges=limit_of_error if metric == "edges" else None,
                              frame=tune.parse_time(time) if time else None, measure=measure, plan=plan_of(knob, also), safety=safety, windows=windows,
                              window=window, reference_step=reference_step, resolution=resolution, setup=setup,
                              progress=lambda done, of, words: progress.update(task, completed=done, total=of or None, description=escape(words)))
        path = output or Path("out") / "tune" / tuned.search.scene / "scene.json"
        tuned.write(path)
        out = console()
        table = Table("", "error rms", "largest", "time per frame of 1/60 s", box=None, padding=(0, 2))
        for name, p in (("search", tuned.found), ("judge", tuned.judged)):
            table.add_row(name, f"{1e3 * p['restart_rms']:.3g} mm, {100 * p['restart_rms_edges']:.3g} % of an edge",
                          f"{1e3 * p['restart_max_edges'] * tuned.edge:.3g} mm", f"{p['ms_per_second'] / 60:.3g} ms")
        out.print(f"[bold]{escape(tradeoff_grid.label(tuned.settings))}[/], factor {tuned.safety:.3g} to spare in the search, judged in round {tuned.rounds}")
        out.print(table)
        out.print(f"written to {escape(str(path))}; cama run {escape(str(path))} uses it")


class stoppable:
    """Ctrl-C ends with exit code 130 and says what is kept."""

    def __init__(self, console, folder):
        self._console, self._folder = console, folder

    def __enter__(self):
        return self

    def __exit__(self, kind, problem, trace):
        if kind is KeyboardInterrupt:
            self._console().print(f"[yellow]Stopped; what was finished is kept in {escape(str(self._folder))}, the same command goes on from there.[/]")
            raise typer.Exit(130) from None
        return False
