# SPDX-License-Identifier: Apache-2.0
"""The command `cama render`."""

from pathlib import Path
from typing import Annotated, Optional

import typer
from rich.console import Console
from rich.markup import escape

from .common import Debug, clean, console


@clean
def render(
    output: Annotated[Path, typer.Argument(metavar="OUT", help="Folder that `cama run` wrote.")],
    fps: Annotated[int, typer.Option(min=1, max=240, help="Images per second of the video.")] = 30,
    speed: Annotated[
        Optional[float], typer.Option(min=1e-6, help="1: real time, 0.5: half. Default: slow enough to see.")
    ] = None,
    width: Annotated[int, typer.Option(min=16)] = 1280,
    height: Annotated[int, typer.Option(min=16)] = 720,
    azimuth: Annotated[float, typer.Option(help="Where the camera stands, degrees from the x axis.")] = -60.0,
    elevation: Annotated[float, typer.Option(help="How high it stands, degrees.")] = 22.0,
    images: Annotated[bool, typer.Option(help="Write one PNG per image to OUT/images.")] = True,
    debug: Debug = False,
):
    """Draws OUT/frames.h5 without a display: PNG images and OUT/video.mp4."""
    from ..io import render as draw

    result = draw.render(
        output,
        fps=fps,
        speed=speed,
        size=(width, height),
        azimuth=azimuth,
        elevation=elevation,
        images=images,
        progress=Console(stderr=True, highlight=False),
    )
    console().print(
        f"{result.images} images, {result.seconds:.1f} s at {draw.speed_text(result.speed)}: [bold]{escape(str(result.video))}[/]"
    )
