# SPDX-License-Identifier: Apache-2.0
"""The command `cama tune`."""

from pathlib import Path
from typing import Annotated, Optional

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from ..errors import ArrayError
from ..hints import require
from ..measuring import grid
from ..measuring.tradeoff import Setup
from ..measuring.tune import parse_error, parse_time
from ..measuring.tune import tune as search
from .common import clean, console
from .plan import (
    Also,
    ClusterAddress,
    Debug,
    Device,
    ErrorJobs,
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
def tune(
    scene: Annotated[str, typer.Argument(metavar="SCENE", help="As for run.")],
    error: Annotated[
        Optional[str], typer.Option(metavar="LENGTH", help="Largest error, for example 1mm, or 1% of an edge.")
    ] = None,
    time: Annotated[
        Optional[str], typer.Option(metavar="TIME", help="Largest time for a frame of 1/60 s, for example 16ms.")
    ] = None,
    measure: Annotated[str, typer.Option(help="Error over the vertices: rms or max.")] = "rms",
    safety: Annotated[float, typer.Option(min=1.0, help="Factor by which the search must be below the budget.")] = 1.5,
    vary: Vary = None,
    also: Also = None,
    backend: Annotated[str, typer.Option(help="Where to compute.")] = "auto",
    resolution: Resolution = 0,
    window: Window = 0.05,
    windows: Annotated[
        int, typer.Option(min=1, help="Number of start states of the search; the judge uses as many.")
    ] = 6,
    reference_step: ReferenceStep = None,
    threads: Threads = 0,
    device: Device = 0,
    error_jobs: ErrorJobs = 0,
    cluster: ClusterAddress = None,
    limit: Limit = 600.0,
    warm_up: WarmUp = 5,
    results: Annotated[Path, typer.Option(metavar="FOLDER", help="Folder of finished results.")] = Path("out/tradeoff"),
    output: Annotated[
        Optional[Path],
        typer.Option("--output", "-o", metavar="FILE", help="Scene file to write. Default: out/tune/SCENE/scene.json."),
    ] = None,
    debug: Debug = False,
):
    """Picks the cheapest options for a budget of error or time, has them judged, and writes a scene file."""
    require("cama tune", "scipy")
    if not error and not time:
        raise ArrayError("give --error, for example --error 1mm or --error 5%, or --time, for example --time 16ms")
    metric, limit_of_error = parse_error(error) if error else (None, None)
    setup = Setup(backend_names([backend]), device, threads, 1, error_jobs, cluster, limit, warm_up)
    with bar(Console(stderr=True, highlight=False)) as progress, stoppable(results):
        task = progress.add_task(escape(scene), total=None)
        tuned = search(
            scene,
            results,
            error=limit_of_error if metric == "m" else None,
            edges=limit_of_error if metric == "edges" else None,
            frame=parse_time(time) if time else None,
            measure=measure,
            plan=plan_of(vary, also),
            safety=safety,
            windows=windows,
            window=window,
            reference_step=reference_step,
            resolution=resolution,
            setup=setup,
            progress=follow(progress, task),
        )
    path = output or Path("out") / "tune" / tuned.search.scene / "scene.json"
    tuned.write(path)
    out = console()
    table = Table("", "error rms", "largest", "time per frame of 1/60 s", box=None, padding=(0, 2))
    for name, p in (("search", tuned.found), ("judge", tuned.judged)):
        table.add_row(
            name,
            f"{1e3 * p['restart_rms']:.3g} mm, {100 * p['restart_rms_edges']:.3g} % of an edge",
            f"{1e3 * p['restart_max_edges'] * tuned.edge:.3g} mm",
            f"{p['ms_per_second'] / 60:.3g} ms",
        )
    out.print(
        f"[bold]{escape(grid.label(tuned.settings))}[/], factor {tuned.safety:.3g} to spare in the search, "
        f"judged in round {tuned.rounds}"
    )
    out.print(table)
    out.print(f"written to {escape(str(path))}; cama run {escape(str(path))} uses it")
