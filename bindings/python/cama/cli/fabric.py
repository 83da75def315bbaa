# SPDX-License-Identifier: Apache-2.0
"""The commands `cama fabric list`, `show`, `test` and `fit`."""

import json
from pathlib import Path
from typing import Annotated, Optional

import numpy as np
import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from ..errors import SceneError
from ..hints import digits
from ..material import Material, fabrics
from .common import Debug, choice, clean, console

app = typer.Typer(
    help="Textile tests of fabrics, and fabrics from measurements.", no_args_is_help=True, rich_markup_mode="rich"
)

Test = choice("Test", ("cantilever", "tensile", "picture_frame", "drape"))
FabricName = Annotated[str, typer.Argument(metavar="NAME", help="A shipped fabric, or a material file (.json).")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON in SI units instead of a table.")]

# How quantities are shown: factor and unit, by SI unit.
SHOWN = {"m": (1e3, "mm"), "N m": (1e6, "µN m"), "N/m": (1, "N/m"), "N": (1, "N"), "1": (100, "%"), "": (1, "")}


def texts_of(fabric):
    """Returns (what, unit, value) of a material's numbers, for people."""
    from ..fabric import bending, stretching

    def bent(direction):
        value = bending.bending_stiffness(fabric, direction)
        return "by curvature" if value is None else digits(1e6 * value)

    if stretching.is_constant(fabric):
        stiff = {d: digits(stretching.modulus(fabric, d)) for d in ("warp", "weft")}
        shear = digits(fabric.stretching[0][3] / 2)
    else:
        stiff = dict.fromkeys(("warp", "weft"), "by strain")
        shear = "by strain"
    return [
        ("mass per area", "g/m²", digits(1e3 * fabric.density)),
        ("tensile warp", "N/m", stiff["warp"]),
        ("tensile weft", "N/m", stiff["weft"]),
        ("shear", "N/m", shear),
        ("bending warp", "µN m", bent("warp")),
        ("bending weft", "µN m", bent("weft")),
        ("friction", "", "the scene's" if fabric.friction < 0 else digits(fabric.friction)),
    ]


@app.command("list")
@clean
def list_(json_: Json = False, debug: Debug = False):
    """Lists the shipped fabrics with their main numbers."""
    loaded = [Material.fabric(name) for name in fabrics()]
    if json_:
        print(json.dumps([fields_of(f) for f in loaded], indent=2))
        return
    table = Table("fabric", box=None, padding=(0, 1))
    for title, unit, _ in texts_of(loaded[0]):
        table.add_column(f"{title}\n{unit}", justify="right")
    for fabric in loaded:
        table.add_row(fabric.name, *(text for *_, text in texts_of(fabric)))
    console().print(table)


def fields_of(fabric):
    """Returns a material as what JSON can hold, in SI units."""
    fields = {name: getattr(fabric, name) for name in ("name", "source", "density")}
    return {**fields, **{name: np.asarray(getattr(fabric, name)).tolist() for name in ("stretching", "bending")}}


@app.command()
@clean
def show(name: FabricName, json_: Json = False, debug: Debug = False):
    """Shows the numbers of a fabric, where they come from, and what is published for its kind."""
    from ..fabric.published import RANGES

    fabric = Material.of(name)
    found = RANGES.get(fabric.name, {})
    if json_:
        ranges = [
            {"quantity": q, "direction": d, "low": p.low, "high": p.high, "source": p.source}
            for (q, d), p in found.items()
        ]
        print(json.dumps({**fields_of(fabric), "published": ranges}, indent=2))
        return
    out = console()
    out.print(f"[bold]{escape(fabric.name)}[/]")
    numbers = Table(box=None, padding=(0, 2), show_header=False)
    for title, unit, text in texts_of(fabric):
        numbers.add_row(title, f"{text} {unit}")
    out.print(numbers)
    if fabric.source:
        out.print(f"source: {escape(fabric.source)}")
    if found:
        table = Table("published for the kind", "range", "source", box=None, padding=(0, 2))
        for (quantity, direction), published in found.items():
            table.add_row(titled(quantity, direction), range_text(published, unit_of(quantity)), published.source)
        out.print(table)


def unit_of(quantity):
    """Returns the SI unit of a quantity that is published."""
    return {"flexural rigidity": "N m", "drape coefficient": "1"}.get(quantity, "N/m")


def titled(quantity, direction):
    return f"{quantity}, {direction}" if direction else quantity


def range_text(published, unit):
    """Returns a published range with its unit."""
    factor, shown = SHOWN[unit]
    return f"{digits(factor * published.low)} to {digits(factor * published.high)} {shown}"


def report_tables(report):
    """Returns (title, table) for each test of a report."""
    from ..fabric import TESTS

    for name, title in TESTS.items():
        rows = [row for row in report.rows if row.test == name]
        if not rows:
            continue
        table = Table("", "", box=None, padding=(0, 1))
        for heading in ("simulated", "closed form"):
            table.add_column(heading, justify="right")
        table.add_column("published")
        for row in rows:
            factor, unit = SHOWN[row.unit]
            spread = "" if row.scatter is None else f" ± {factor * row.scatter:.1f}"
            colour = "green" if row.verdict == "within" else "yellow"
            table.add_row(
                row.quantity,
                row.direction,
                f"{digits(factor * row.value)}{spread} {unit}".rstrip(),
                "" if row.expected is None else digits(factor * row.expected),
                "" if row.published is None else f"{range_text(row.published, row.unit)} [{colour}]{row.verdict}[/]",
            )
        yield title, table


@app.command()
@clean
def test(
    name: FabricName,
    only: Annotated[Optional[list[Test]], typer.Option(help="Run only this test; may be repeated.")] = None,
    drapes: Annotated[int, typer.Option(min=1, help="How often the drape test is repeated.")] = 3,
    sectors: Annotated[
        int, typer.Option(min=24, help="Cells around the specimen of the drape test; fewer are faster and stiffer.")
    ] = 144,
    json_: Json = False,
    picture: Annotated[
        Optional[Path], typer.Option(metavar="FILE.png", help="Draw the first drape, from the side and from above.")
    ] = None,
    debug: Debug = False,
):
    """Simulates textile tests of a fabric: cantilever, strip tensile, picture frame, Cusick drape."""
    from .. import fabric as textile

    chosen = [word.value for word in only] if only else None
    if picture is not None:
        if chosen is not None and "drape" not in chosen:
            raise SceneError("--picture draws the drape: add --only drape, or leave out --only")
        from ..fabric.picture import check

        check(picture)
    status = Console(stderr=True, highlight=False)
    with status.status("") as line:
        report = textile.test(
            name, chosen, drapes, sectors, lambda test: line.update(f"{escape(name)}: {test.replace('_', ' ')}")
        )
    if picture is not None:
        from ..fabric.picture import draw

        draw(report.drapes[0], picture)
    if json_:
        print(json.dumps(report.to_dict(), indent=2))
        return
    out = console()
    out.print(f"[bold]{escape(report.fabric)}[/], {1e3 * report.density:.4g} g/m²")
    for title, table in report_tables(report):
        out.print(f"\n[bold]{title}[/]")
        out.print(table)
    for number, hanging in enumerate(report.drapes):
        if not hanging.at_rest:
            out.print(f"[yellow]drape {number + 1} still moved when its time was over[/]")
    if picture is not None:
        out.print(f"\npicture: [bold]{escape(str(picture))}[/]")


@app.command()
@clean
def fit(
    measured: Annotated[
        Optional[Path], typer.Argument(metavar="MEASURED.json", help="Measured values; see --example.")
    ] = None,
    output: Annotated[
        Optional[Path],
        typer.Option("--output", "-o", metavar="FILE", help="The material file to write. Default: fabric.json."),
    ] = None,
    drapes: Annotated[
        int, typer.Option(min=1, help="Drapes that are simulated for each of four bending stiffnesses.")
    ] = 2,
    sectors: Annotated[int, typer.Option(min=24, help="Cells around the specimen of the drape test.")] = 144,
    json_: Annotated[bool, typer.Option("--json", help="Print JSON with the covariance instead of tables.")] = False,
    example: Annotated[
        bool, typer.Option("--example", help="Print measured values to begin with, or write them to FILE, and stop.")
    ] = False,
    debug: Debug = False,
):
    """Finds the numbers of a fabric from measured ones and writes a material file."""
    from ..fabric import fitting
    from ..fabric.writing import write

    if example:
        text = json.dumps(fitting.EXAMPLE, indent=2)
        if output is None:
            print(text)
        else:
            write(output, (text + "\n").encode())
        return
    if measured is None:
        raise SceneError("give a file with measured values; cama fabric fit --example prints one to begin with")
    with Console(stderr=True, highlight=False).status("") as line:
        found = fitting.fit(measured, drapes, sectors, lambda words: line.update(escape(words)))
    output = output or Path("fabric.json")
    found.write(output)
    if json_:
        print(json.dumps(found.to_dict(), indent=2))
        return
    out = console()
    numbers = Table("", box=None, padding=(0, 1))
    for heading in ("value", "uncertainty"):
        numbers.add_column(heading, justify="right")
    numbers.add_column("unit")
    for name, unit in fitting.PARAMETERS.items():
        value, spread = found.values[name], found.uncertainties[name]
        numbers.add_row(name, digits(value, 4), f"± {digits(spread, 2)}", unit)
    out.print(numbers)
    table = Table("", box=None, padding=(0, 1))
    for heading in ("measured", "fitted", "off by"):
        table.add_column(heading, justify="right")
    table.add_column("found by")
    for row in found.measured:
        colour = "yellow" if abs(row.residual) > 2 else "default"
        table.add_row(
            row.quantity,
            f"{digits(row.value, 4)} ± {digits(row.scatter, 2)}{' *' if row.assumed else ''}",
            digits(row.fitted, 4),
            f"[{colour}]{row.residual:+.1f} s[/]",
            row.method,
        )
    out.print()
    out.print(table)
    out.print("[dim]SI units; s: standard deviations of the measured value[/]")
    if any(row.assumed for row in found.measured):
        out.print("[dim]* no scatter was given; 5 % of the value is taken[/]")
    if any(abs(row.residual) > 2 for row in found.measured):
        out.print("[yellow]a value is off by more than 2 s: the measured values contradict each other, or the model[/]")
    out.print(f"\nwritten to [bold]{escape(str(output))}[/]; a scene uses it as a material with its name as file")
