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

from ..errors import FileError, SceneError
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
    """Returns (what, value) of a material's numbers, for people."""
    from ..fabric import bending, stretching

    def bent(direction):
        value = bending.bending_stiffness(fabric, direction)
        return "varies with curvature" if value is None else f"{1e6 * value:.3g} µN m"

    if stretching.is_constant(fabric):
        stiff = {d: f"{stretching.modulus(fabric, d):.4g} N/m" for d in ("warp", "weft")}
        shear = f"{fabric.stretching[0][3] / 2:.4g} N/m"
    else:
        stiff = dict.fromkeys(("warp", "weft"), "varies with strain")
        shear = "varies with strain"
    return [
        ("mass per area", f"{1e3 * fabric.density:.4g} g/m²"),
        ("tensile stiffness, warp", stiff["warp"]),
        ("tensile stiffness, weft", stiff["weft"]),
        ("shear stiffness", shear),
        ("bending stiffness, warp", bent("warp")),
        ("bending stiffness, weft", bent("weft")),
        ("friction, cloth on cloth", "the scene's" if fabric.friction < 0 else f"{fabric.friction:g}"),
    ]


@app.command("list")
@clean
def list_(json_: Json = False, debug: Debug = False):
    """Lists the shipped fabrics with their main numbers."""
    loaded = [Material.fabric(name) for name in fabrics()]
    if json_:
        print(json.dumps([{"name": f.name, **dict(texts_of(f))} for f in loaded], indent=2, ensure_ascii=False))
        return
    table = Table("fabric", box=None, padding=(0, 2))
    for title, _ in texts_of(loaded[0])[:-1]:
        table.add_column(title, justify="right", max_width=18)
    for fabric in loaded:
        table.add_row(fabric.name, *(text for _, text in texts_of(fabric)[:-1]))
    console().print(table)


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
        fields = {
            "density": fabric.density,
            "stretching": np.asarray(fabric.stretching).tolist(),
            "bending": np.asarray(fabric.bending).tolist(),
        }
        print(json.dumps({"name": fabric.name, "source": fabric.source, **fields, "published": ranges}, indent=2))
        return
    out = console()
    out.print(f"[bold]{escape(fabric.name)}[/]")
    numbers = Table(box=None, padding=(0, 2), show_header=False)
    for row in texts_of(fabric):
        numbers.add_row(*row)
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
    """Returns a published range with its unit, or ""."""
    if published is None:
        return ""
    factor, shown = SHOWN[unit]
    return f"{factor * published.low:.4g} to {factor * published.high:.4g} {shown}"


def report_tables(report):
    """Returns (title, table) for each test of a report."""
    from ..fabric import TESTS

    for name, title in TESTS.items():
        rows = [row for row in report.rows if row.test == name]
        if not rows:
            continue
        table = Table("", box=None, padding=(0, 2))
        for heading in ("simulated", "closed form", "published"):
            table.add_column(heading, justify="right")
        table.add_column("")
        for row in rows:
            factor, unit = SHOWN[row.unit]
            spread = "" if row.scatter is None else f" ± {factor * row.scatter:.2g}"
            table.add_row(
                titled(row.quantity, row.direction),
                f"{factor * row.value:.4g}{spread} {unit}".rstrip(),
                "" if row.expected is None else f"{factor * row.expected:.4g} {unit}",
                range_text(row.published, row.unit),
                {"within": "[green]within[/]"}.get(row.verdict, f"[yellow]{row.verdict}[/]") if row.verdict else "",
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


def write(path, text):
    """Writes a file whole or not at all. Raises FileError."""
    import os

    new = path.with_name(path.name + ".new")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        new.write_text(text, encoding="utf-8")
        os.replace(new, path)
    except OSError as problem:
        raise FileError(f"{path}: {problem.strerror}") from None
