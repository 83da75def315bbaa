# SPDX-License-Identifier: Apache-2.0
"""The command `cama stability`."""

from pathlib import Path
from typing import Annotated, Optional

import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn
from rich.table import Table

from .. import _core
from ..errors import BackendError, SceneError
from ..io.progress import Bar
from .common import Precision, clean, console, positive_seconds

Cases = Annotated[
    Optional[list[str]], typer.Argument(metavar="[CASE...]", help="Numbers (1 to 45) or names. Default: all.")
]
Backends = Annotated[
    Optional[list[str]],
    typer.Option("--backend", help="cpu, opencl, cuda; may be repeated. Default: all available ones."),
]
Output = Annotated[Path, typer.Option("--output", "-o", metavar="OUT", help="Folder of the results.")]


LEVELS = _core.accuracy_levels()


def backends_of(names):
    """Returns the available backends of these names, without repetitions. Raises BackendError."""
    there = {b["name"]: b for b in _core.list_backends()}
    chosen = list(dict.fromkeys(names or [name for name, b in there.items() if b["available"]]))
    for name in chosen:
        if not there.get(name, {}).get("available"):
            raise BackendError(
                f"backend {name!r} is not available{': ' + there[name]['note'] if name in there else ''}; "
                f"there are {', '.join(n for n, b in there.items() if b['available'])}"
            )
    return chosen


def outcome_table(outcomes, width):
    """Returns a table with one line per run; below 110 columns it has no measures, which the files have."""
    measures = ("steps", "cuts", "strain", "energy", "s") if width >= 110 else ()
    table = Table("", box=None, padding=(0, 1))
    for title in ("check", "backend", "precision"):
        table.add_column(title, no_wrap=True)
    for title in measures:
        table.add_column(title, justify="right", no_wrap=True)
    table.add_column("outcome", overflow="fold")
    for o in outcomes:
        colour = "green" if o.good else "yellow" if o.known else "bold red"
        energy = "-" if o.energy_ratio is None else f"{o.energy_ratio:.2g}"
        known = f" [dim](known: {escape(o.known)})[/]" if o.known else ""
        seen = (str(o.steps), str(o.intersections), f"{o.strain:.2g}", energy, f"{o.seconds:.1f}")[: len(measures)]
        table.add_row(
            str(o.number),
            escape(o.check),
            o.backend,
            o.precision,
            *seen,
            f"[{colour}]{escape(o.outcome[:160])}[/]" + known,
        )
    return table


@clean
def stability(
    cases: Cases = None,
    backend: Backends = None,
    precision: Annotated[Optional[list[Precision]], typer.Option(help="May be repeated. Default: all three.")] = None,
    accuracy: Annotated[str, typer.Option(metavar="LEVEL", help=f"One of {', '.join(LEVELS)}.")] = "production",
    limit: Annotated[
        float, typer.Option(parser=positive_seconds, metavar="SECONDS", help="Largest wall time of a run, s.")
    ] = 120.0,
    jobs: Annotated[int, typer.Option(min=0, help="Number of runs at once; 0: one for two cores.")] = 0,
    long: Annotated[bool, typer.Option("--long", help="Run the long cases too.")] = False,
    show: Annotated[bool, typer.Option("--list", help="Print the table of cases and stop.")] = False,
    join: Annotated[
        Optional[list[Path]],
        typer.Option(
            metavar="FILE", help="A stability.json of another run or machine, shown beside these; may be repeated."
        ),
    ] = None,
    page: Annotated[Optional[Path], typer.Option(metavar="FILE", help="Write the Markdown page here too.")] = None,
    output: Output = Path("out/stability"),
    debug: Annotated[bool, typer.Option("--debug", help="Show Python's traceback of an error.")] = False,
):
    """Runs cases that break cloth simulators and checks their outcomes; exit code 1 if one is not as expected."""
    from ..torture import stability as runner
    from ..torture import table

    try:
        checks = table.select(cases or ())
    except KeyError as word:
        names = ", ".join(c.name for c in table.CHECKS)
        raise SceneError(f"case {word} is unknown; there are the numbers 1 to 45 and {names}") from None
    out = console()
    if show:
        listing = Table("", "case", "expected", box=None, padding=(0, 1))
        for c in checks:
            listing.add_row(str(c.number), c.name, escape(c.expected + (f" (not run: {c.reason})" if c.reason else "")))
        out.print(listing)
        return
    if accuracy not in LEVELS:
        raise SceneError(f"accuracy {accuracy!r} is unknown; there are {', '.join(LEVELS)}")
    others = [o for file in join or () for o in runner.read(file)]
    backends, precisions = backends_of(backend), [p.value for p in precision or Precision]
    # a case that is asked for by name or number is run however long it is
    long = long or bool(cases)
    total = sum(c.applies(b, p) and (long or not c.long) for c in checks for b in backends for p in precisions)
    with Bar(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        console=Console(stderr=True, highlight=False),
    ) as progress:
        task, done = progress.add_task("", total=total), []

        def each(o):
            progress.update(task, advance=1, description=f"{o.number} {o.check} on {o.backend} in {o.precision}")
            done.append(o)
            runner.write(done, output, None, checks)

        outcomes = runner.run(checks, backends, precisions, accuracy, limit, jobs or runner.default_jobs(), long, each)
    ran = {(o.check, o.backend, o.precision) for o in outcomes}
    joined = {(o.check, o.backend, o.precision): o for o in others}  # of runs of the same, the last
    runner.write(outcomes + [o for key, o in joined.items() if key not in ran], output, page, checks)
    out.print(outcome_table(outcomes, out.width))
    good, known = sum(o.good for o in outcomes), sum(bool(o.known) for o in outcomes)
    out.print(
        f"{good} of {len(outcomes)} as expected, {known} fail as known, {len(outcomes) - good - known} fail otherwise; "
        f"{sum(c.body is None for c in checks)} cases cannot be run here. Written to {escape(str(output))}"
    )
    if len(outcomes) < total:
        raise typer.Exit(130)
    if not all(o.excused for o in outcomes):
        raise typer.Exit(1)
