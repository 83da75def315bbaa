# SPDX-License-Identifier: Apache-2.0
"""The command `cama dress`."""

import math
from pathlib import Path
from typing import Annotated, Any, Optional

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from ..body import Body
from ..errors import FileError, SceneError
from ..hints import similar
from ..posing import MOTIONS
from ..units import UNITS
from .common import Backend, BackendOption, Debug, Threads, choice, clean, console

Units = choice("Units", UNITS)
Up = choice("Up", ["y", "z"])
Motions = choice("Motions", list(MOTIONS))


@clean
def dress(
    pattern: Annotated[
        list[Path],
        typer.Argument(
            metavar="PATTERN...",
            help="A sewing pattern: JSON of cama, GarmentCode's, or skirt or top. Several are put on one after the "
            "other, the first next to the skin.",
        ),
    ],
    body: Annotated[
        str,
        typer.Option(
            metavar="FILE",
            help="The body: a mesh file, a character with its animation, walker (a generated body that stands still), "
            f"or a motion of the generated body: {', '.join(MOTIONS)}.",
        ),
    ],
    motion: Annotated[
        Optional[Motions], typer.Option(help="What a body of a mesh file does in the scene that is written.")
    ] = None,
    lead_in: Annotated[
        float, typer.Option(min=0, help="Time in which a body moves from its starting pose into its motion, s.")
    ] = 1.0,
    fabric: Annotated[
        Optional[list[str]],
        typer.Option(
            metavar="NAME",
            help="A fabric's name, or a JSON file; given once, or once for each pattern. Default: cotton.",
        ),
    ] = None,
    scale: Annotated[
        Optional[tuple[float, float]],
        typer.Option(metavar="WIDTH HEIGHT", help="Factors of the patterns' horizontal and vertical measurements."),
    ] = None,
    same_body: Annotated[
        bool,
        typer.Option(
            "--same-body", help="With --scale: the panels' highest point stays where it is, as for another size."
        ),
    ] = False,
    shrinkage: Annotated[
        Optional[list[str]],
        typer.Option(
            metavar="PANEL=SHARE",
            help="A panel's cloth shrinks by this share, 0.05 for 5 %, or by PANEL=WIDTH,HEIGHT across and along it; "
            "once for each panel.",
        ),
    ] = None,
    resolution: Annotated[int, typer.Option(min=16, help="About how many triangles each garment has.")] = 8000,
    edge_length: Annotated[
        Optional[float], typer.Option(metavar="METRES", help="Length of their edges, in place of --resolution.")
    ] = None,
    units: Annotated[Optional[Units], typer.Option(help="Unit of the body's file. Default: by its height.")] = None,
    up: Annotated[
        Optional[Up], typer.Option(help="Axis of the body's file that points up. Default: the pattern's.")
    ] = None,
    seconds: Annotated[float, typer.Option(min=0.5, help="Longest time of draping, s.")] = 12.0,
    backend: BackendOption = Backend.auto,
    threads: Threads = 0,
    output: Annotated[
        Optional[Path], typer.Option("--output", "-o", metavar="OUT", help="Folder of the results. Default: out/NAME.")
    ] = None,
    debug: Debug = False,
):
    """Sews patterns around a body and drapes them; writes OUT/garment.obj, OUT/scene.json and the frames.

    In OUT/scene.json the body moves, if it can: cama run OUT/scene.json simulates the dressed body.

    Ends with exit code 1 if a seam stays open, something intersects or the cloth does not come to rest.
    """
    from ..sewing import SewingPattern
    from ..sewing import dress as sew

    chosen: Any = body
    if not Path(body).is_file():
        if body not in ("walker", *MOTIONS):
            raise FileError(f"{body}: there is no such file; --body is a mesh file, walker, {', '.join(MOTIONS)}")
        chosen = {"walker": {}} if body == "walker" else Body(body, lead_in=lead_in)
    made = [SewingPattern.load(file) for file in pattern]
    if scale is not None:
        made = [each.scaled(*scale, top=each.top if same_body else None) for each in made]
    made = _shrunk(made, shrinkage or [])
    folder = output or Path("out") / "-".join(each.name for each in made)
    status = Console(stderr=True, highlight=False)
    dressed = sew(
        made,
        chosen,
        motion=motion.value if motion else None,
        lead_in=lead_in,
        fabric=fabric if fabric and len(fabric) > 1 else (fabric or ["cotton"])[0],
        triangles=resolution,
        edge_length=edge_length,
        output=folder,
        units=units.value if units else None,
        up=up.value if up else None,
        seconds=seconds,
        backend=backend.value,
        threads=threads,
        say=lambda text: status.print(escape(text)),
    )
    print_verdict(dressed, folder)
    if not dressed.verdict.good:
        raise typer.Exit(1)


def _shrunk(patterns: list[Any], given: list[str]) -> list[Any]:
    """Returns the patterns with the shrinkage of panels given as PANEL=SHARE or PANEL=WIDTH,HEIGHT.

    A panel's name counts in every pattern that has such a panel. Raises SceneError.
    """
    shares: dict[str, Any] = {}
    for text in given:
        name, equals, numbers = text.rpartition("=")
        try:
            values = [float(value) for value in numbers.split(",")]
        except ValueError:
            values = []
        if not (name and equals and len(values) in (1, 2)):
            raise SceneError(f"--shrinkage {text}: is not PANEL=SHARE or PANEL=WIDTH,HEIGHT, such as front=0.05")
        shares[name] = values[0] if len(values) == 1 else tuple(values)
    names = [panel.name for pattern in patterns for panel in pattern.panels]
    for name in shares:
        if name not in names:
            raise SceneError(f"--shrinkage {name}: no pattern has this panel{similar(name, names)}")
    return [
        pattern.shrunk({panel.name: shares[panel.name] for panel in pattern.panels if panel.name in shares})
        for pattern in patterns
    ]


def print_verdict(dressed, folder):
    """Prints what was made, and the verdict."""
    verdict = dressed.verdict
    table = Table(show_header=False, box=None, padding=(0, 2))
    rows = []
    for each in (*dressed.under, dressed):
        own = each.mesh
        rows += [
            ("pattern", f"{own.pattern.name}, {len(own.pattern.panels)} panels, {len(own.pattern.seams)} seams"),
            ("garment", f"{len(own.faces):,} triangles, {len(each.positions):,} vertices"),
        ]
    rows += [
        ("seams", f"{verdict.seam_gap * 1e3:.2g} mm open at most; {verdict.joined_gap * 1e3:.2g} mm when joined"),
        ("intersections", f"{verdict.intersections:,}"),
        ("speed at the end", "-" if math.isnan(verdict.speed) else f"{verdict.speed * 1e3:.2g} mm/s"),
        ("largest strain", f"{verdict.max_strain * 100:.3g} %, in {verdict.strained_at}"),
        ("wall time", f"{dressed.seconds:.3g} s"),
        ("written to", str(folder)),
        ("verdict", "[bold green]good[/]" if verdict.good else "[bold red]failed[/]"),
    ]
    for name, text in rows:
        table.add_row(f"[bold]{name}[/]", text if name == "verdict" else escape(text))
    console().print(table)
    for problem in verdict.problems:
        console().print(f"[red]{escape(problem)}[/]")
