# SPDX-License-Identifier: Apache-2.0
"""The command `cama tradeoff`."""

from pathlib import Path
from typing import Annotated, Optional

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from ..hints import require
from ..measuring import report
from ..measuring.tradeoff import Setup
from ..measuring.tradeoff import join as join_results
from ..measuring.tradeoff import tradeoff as measure_tradeoff
from .common import clean, console
from .plan import (
    Also,
    Backends,
    ClusterAddress,
    Debug,
    Device,
    ErrorJobs,
    Jobs,
    Limit,
    ReferenceStep,
    Resolution,
    Threads,
    Vary,
    WarmUp,
    Window,
    backend_names,
    bar,
    follow,
    plan_of,
    stoppable,
)


@clean
def tradeoff(
    scenes: Annotated[list[str], typer.Argument(metavar="SCENE...", help="As for run.")],
    vary: Vary = None,
    also: Also = None,
    backend: Backends = ("auto",),
    resolution: Resolution = 0,
    window: Window = 0.05,
    windows: Annotated[int, typer.Option(min=1, help="Number of start states.")] = 8,
    first: Annotated[int, typer.Option(min=0, help="Number of first windows that are left out.")] = 1,
    reference_step: ReferenceStep = None,
    threads: Threads = 0,
    device: Device = 0,
    jobs: Jobs = 1,
    error_jobs: ErrorJobs = 0,
    cluster: ClusterAddress = None,
    limit: Limit = 600.0,
    warm_up: WarmUp = 5,
    plots: Annotated[bool, typer.Option(help="Write plots and the page; needs matplotlib.")] = True,
    join: Annotated[
        Optional[list[Path]],
        typer.Option(
            metavar="FILE",
            help="A tradeoff.json of another run or machine: its other backends "
            "are shown beside these; may be repeated.",
        ),
    ] = None,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="OUT", help="Folder of the results; finished ones are kept.")
    ] = Path("out/tradeoff"),
    debug: Debug = False,
):
    """Measures the time and the errors of options; writes OUT/tradeoff.csv, .json, plots and index.html.

    The same command continues an interrupted run.
    """
    require("cama tradeoff", "scipy", *(["matplotlib"] if plots else []))
    plan = plan_of(vary, also)
    setup = Setup(backend_names(backend), device, threads, jobs, error_jobs, cluster, limit, warm_up)
    results = []
    with bar(Console(stderr=True, highlight=False)) as progress, stoppable(output):
        for scene in scenes:
            task = progress.add_task(escape(scene), total=None)
            results.append(
                measure_tradeoff(
                    scene,
                    output,
                    plan,
                    resolution=resolution,
                    window=window,
                    windows=windows,
                    first=first,
                    reference_step=reference_step,
                    setup=setup,
                    progress=follow(progress, task, f"{scene}: "),
                )
            )
            report.write(results, output, plots)
    for file in join or ():
        join_results(results, file)
    if join:
        report.write(results, output, plots)
    out = console()
    out.print(front_table(results))
    failed = [p for r in results for p in r.points if p["failed"]]
    for p in failed[:10]:
        out.print(f"[red]failed:[/] {p['backend']}, {escape(p['label'])}: {escape(p['failed'])}")
    for r in results:
        out.print(
            f"{escape(r.scene)}: the reference may be off by {r.facts['uncertainty_edges']:.2g} edge lengths itself"
            + ("" if r.facts["converged"] else " [bold red]and has not converged[/]")
        )
    out.print(f"written to {escape(str(output))}")
    if len(failed) == sum(len(r.points) for r in results):
        raise typer.Exit(1)


def front_table(results):
    """Returns a table of the Pareto fronts, fastest points first."""
    table = Table("scene", "backend", box=None, padding=(0, 1), title="Fronts: ms per simulated second and rms error")
    table.add_column("settings", overflow="fold")
    for title in ("ms", "edges", "mm"):
        table.add_column(title, justify="right", no_wrap=True)
    for r in results:
        for backend, name, cost, edges, millimetres in report.summary_rows(r):
            table.add_row(escape(r.scene), backend, escape(name), f"{cost:,.4g}", f"{edges:.3g}", f"{millimetres:.3g}")
    return table
