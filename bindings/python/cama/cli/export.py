# SPDX-License-Identifier: Apache-2.0
"""The command `cama export`."""

from pathlib import Path
from typing import Annotated, Optional

import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn

from ..hints import counted
from ..io.exporting import FORMATS
from ..io.exporting import export as write
from ..io.progress import Bar
from ..units import UNITS
from .common import Debug, choice, clean, console
from .loop import interruptible

Target = choice("Target", FORMATS)
Up = choice("Up", ["y", "z"])
Units = choice("Units", UNITS)


@clean
def export(
    recording: Annotated[Path, typer.Argument(metavar="OUT", help="Folder that `cama run` wrote.")],
    to: Annotated[Target, typer.Option(help="Format to write.")],
    output: Annotated[
        Optional[Path],
        typer.Option(
            "--output", "-o", help="Folder to write to. Default: OUT/export, or a folder for the format in it."
        ),
    ] = None,
    cloth_only: Annotated[bool, typer.Option("--cloth-only", help="Leave obstacles out.")] = False,
    fps: Annotated[
        Optional[float],
        typer.Option(
            min=1e-3,
            help="Frames per second of simulated time, interpolated between recorded frames. "
            "Default: every recorded frame.",
        ),
    ] = None,
    first: Annotated[int, typer.Option(min=0, help="First recorded frame.")] = 0,
    last: Annotated[Optional[int], typer.Option(min=0, help="Last recorded frame. Default: the last one.")] = None,
    every: Annotated[int, typer.Option(min=1, help="2: every second recorded frame, and so on.")] = 1,
    up: Annotated[
        Optional[Up], typer.Option(help="Axis that points up; not for usd and gltf, which say theirs. Default: z.")
    ] = None,
    units: Annotated[Units, typer.Option(help="Unit of length of the files; gltf has metres.")] = Units.m,
    debug: Debug = False,
):
    """Writes OUT/frames.h5 in formats of other programs: USD, glTF, OBJ, PLY, PC2, MDD or VTK.

    Files appear under their names once all of them are complete; Ctrl-C leaves none half written.
    """
    bar = Bar(
        TextColumn("frame"),
        MofNCompleteColumn(),
        BarColumn(),
        TimeRemainingColumn(),
        TextColumn("left"),
        console=Console(stderr=True, highlight=False),
    )
    with bar, interruptible() as pressed:
        task = bar.add_task("", total=None)

        def show(done, total):
            if pressed():
                raise typer.Exit(128 + pressed())
            bar.update(task, completed=done, total=total)

        result = write(
            recording,
            to.value,
            output,
            cloth_only=cloth_only,
            fps=fps,
            first=first,
            last=last,
            every=every,
            up=up and up.value,
            units=units.value,
            progress=show,
        )
    files = [path for path in result.files if path.suffix != ".mtl"]
    shown = str(files[0]) if len(files) == 1 else f"{counted(len(files), 'file')} in {files[0].parent}"
    console().print(f"{counted(result.frames, 'frame')} at {result.fps:g} frames per second: [bold]{escape(shown)}[/]")
