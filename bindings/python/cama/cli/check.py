# SPDX-License-Identifier: Apache-2.0
"""The command `cama check`."""

from pathlib import Path
from typing import Annotated, Optional

import numpy as np
import typer
from rich.markup import escape
from rich.table import Table

from .. import plausibility
from ..errors import Error
from ..hints import counted
from ..scene import Scene
from .common import Debug, Resolution, SceneName, clean, console, fail, rest_lines

STRETCHED = 0.5  # start strain that `check` warns of, and to a stretch of 1 / 1.5


@clean
def check(
    scene: SceneName,
    resolution: Resolution = 0,
    mesh: Annotated[
        Optional[Path],
        typer.Option(metavar="FILE", help="Write the intersecting faces: .ply (coloured) or .obj (grouped)."),
    ] = None,
    debug: Debug = False,
):
    """Validates SCENE, reports its parts and all intersections at the start, and says whether it will run.

    Exit code 0: it will run. 1: it has intersections at the start. 2: it is refused.
    """
    try:
        loaded = Scene.load(scene, resolution)
        loaded.validate()
    except Error as problem:
        if debug:
            raise
        fail(problem, "will not run: ")
        raise typer.Exit(2) from None
    out = console()
    stretched = show_parts(out, loaded)
    unlikely = plausibility.findings(loaded)
    named = {finding.object for finding in unlikely if finding.kind == "rest shape"}
    doubts = plausibility.texts(unlikely)
    far = {name: strain for name, strain in stretched.items() if f"cloth '{name}'" not in named}
    for name, strain in far.items():
        doubts.append(
            f"{name}: starts far from its rest shape, with strains of {strain} %, and will spring to it. Its texture "
            'coordinates or material vertices say the rest shape; give its file "rest": "start", or leave them out, if '
            "the start is it"
        )
    found = loaded.intersections()
    count = sum(pair.count for pair in found)
    for line in doubts:
        out.print(f"[yellow]{escape(line)}[/]")
    for line in plausibility.remarks(loaded):
        out.print(escape(line))
    out.print(f"intersections at the start: [{'bold red' if count else 'green'}]{count}[/]")
    if mesh:
        loaded.save_intersections(mesh)
        out.print(f"intersecting faces written to {escape(str(mesh))}")
    for line in intersection_lines(found):
        out.print(line)
    out.print(verdict(str(scene), count, unlikely, far))
    if count:
        raise typer.Exit(1)


def show_parts(out, scene):
    """Prints all parts of a scene and the sizes of its cloth; returns {name: strain} of cloth that starts stretched."""
    table = Table("part", "name", "from", box=None, padding=(0, 2))
    sizes = Table("cloth", box=None, padding=(0, 1))
    for title in ("triangles", "vertices"):
        table.add_column(title, justify="right")
    for title in ("extent, m", "rest area, m²", "mass, kg", "start strain, %"):
        sizes.add_column(title, justify="right", no_wrap=True)
    stretched = {}
    for kind, parts in (("cloth", scene.cloths), ("obstacle", scene.obstacles)):
        for part in parts:
            table.add_row(
                kind, escape(part.name), escape(part.source), f"{len(part.faces):,}", f"{len(part.vertices):,}"
            )
            if kind == "obstacle":
                continue
            least, most = part.start_strain
            strain = f"{100 * least:.3g} to {100 * most:.3g}" if max(most, -least) > 5e-5 else "0"
            sizes.add_row(
                escape(part.name),
                extent(part.vertices),
                f"{part.rest_area:.3g}",
                f"{part.mass:.3g}",
                strain,
            )
            if most > STRETCHED or least < 1 / (1 + STRETCHED) - 1:
                stretched[part.name] = strain
    out.print(table)
    out.print(sizes)
    for line in rest_lines(scene):
        out.print(escape(line))
    pinned = sum(len(pin["vertices"]) for pin in scene.pins)
    out.print(
        f"{scene.triangle_count:,} cloth triangles, {pinned:,} pinned vertices, {scene.stitch_count:,} stitches, "
        f"{scene.frames} frames of {scene.seconds_per_frame * 1e3:g} ms"
    )
    return stretched


def extent(vertices):
    """Returns the sides of the box around vertices, m, as text; what is only rounding is 0."""
    sides = np.ptp(vertices, axis=0)
    return " x ".join(f"{x:.3g}" for x in np.where(sides < 1e-9 * sides.max(), 0, sides))


def verdict(scene, intersections, unlikely, stretched):
    """Returns the last line of `cama check`: whether the scene runs, and what to do about it if not."""
    if intersections:
        return (
            f"[bold red]will not run[/]: {counted(intersections, 'intersection')} at the start. Move the objects "
            "apart, or add to `cama run`: --intersections untangle moves the cloth first, exempt starts as it is"
        )
    places = dict.fromkeys([f"{finding.object} ({finding.kind})" for finding in unlikely])
    places.update(dict.fromkeys(f"cloth '{name}' (start)" for name in stretched))
    if places:
        first = ", ".join(list(places)[:4]) + (f" and {len(places) - 4} more" if len(places) > 4 else "")
        return f"[bold yellow]will run, but look at[/] {escape(first)}: the yellow lines above say why"
    return f"[bold green]ready[/]: `cama run {escape(scene)}` simulates it"


def place_text(place):
    return "(" + ", ".join(f"{x:.4g}" for x in place) + ")"


def intersection_lines(found):
    """Yields lines with count, place and first primitives for each pair of objects; a table would cut them."""
    for pair in found:
        names = {pair.first: pair.first_name, pair.second: pair.second_name}
        who = pair.first_name + (" with itself" if pair.first == pair.second else " with " + pair.second_name)
        edge, face = (escape(names[int(owner[0])]) for owner in (pair.edge_object, pair.face_object))
        low, high = map(place_text, pair.bounds)
        yield f"{escape(who)}: [bold red]{pair.count:,}[/]"
        yield f"    around {place_text(pair.mean)} m, from {low} to {high}"
        yield f"    first: edge {pair.edge[0, 0]}-{pair.edge[0, 1]} of {edge} through face {pair.face[0]} of {face}"
