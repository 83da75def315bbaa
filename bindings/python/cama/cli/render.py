# SPDX-License-Identifier: Apache-2.0
"""The command `cama render`."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Optional

import typer
from rich.console import Console
from rich.markup import escape

from ..errors import SceneError
from ..io.rendering import look as looks
from .common import Debug, choice, clean, console

Format = choice("Format", looks.FORMATS)
Quality = choice("Quality", looks.QUALITIES)
Shown = choice("Shown", looks.SHOWN)


@dataclass(frozen=True)
class Kind:
    """What a film is where the options do not say it."""

    size: tuple
    fps: int
    formats: tuple
    hold: float  #: s, of the last image


USUAL = Kind((1280, 720), 30, ("png", "mp4"), 0.0)
SMALL = Kind((400, 300), 15, ("webp",), 1.0)
FILM = f"{SMALL.size[0]} x {SMALL.size[1]} pixels, {SMALL.fps}"


def point(text):
    """Returns three coordinates, m, of a text such as 0,0,1.2. Raises typer.BadParameter."""
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        raise typer.BadParameter(f"{text!r} is not three coordinates such as 0,0,1.2") from None
    return x, y, z


@clean
def render(
    output: Annotated[Path, typer.Argument(metavar="OUT", help="Folder that `cama run` wrote.")],
    to: Annotated[
        Optional[list[Format]],
        typer.Option(
            help="Format: png for a picture of each moment, mp4, webp; may be repeated. Default: png and mp4."
        ),
    ] = None,
    frame: Annotated[
        Optional[int],
        typer.Option(help="Draw only this recorded frame, counted from 0, or from the end: -1 is the last."),
    ] = None,
    film: Annotated[
        bool,
        typer.Option(
            "--film",
            help=f"A small film for a web page, which starts again at its end: {FILM} images a second, as webp.",
        ),
    ] = False,
    limit: Annotated[
        Optional[float],
        typer.Option(
            metavar="KB",
            min=1e-3,
            help="Lower the quality of each video, then its size, until the file has at most so many KB.",
        ),
    ] = None,
    fps: Annotated[
        Optional[int], typer.Option(min=1, max=240, help="Images per second of the video. Default: 30.")
    ] = None,
    speed: Annotated[
        Optional[float],
        typer.Option(min=1e-6, help="Playback speed; 1: real time, 0.5: half. Default: slow enough to see."),
    ] = None,
    width: Annotated[Optional[int], typer.Option(min=16, help="Default: 1280.")] = None,
    height: Annotated[Optional[int], typer.Option(min=16, help="Default: 720.")] = None,
    quality: Annotated[
        Quality, typer.Option(help="draft: twice as fast as good; best: for single pictures, twice as slow.")
    ] = "good",
    azimuth: Annotated[float, typer.Option(help="Direction of the camera, degrees from the x axis.")] = -60.0,
    elevation: Annotated[float, typer.Option(help="Elevation of the camera, degrees.")] = 22.0,
    target: Annotated[
        Optional[str], typer.Option(metavar="X,Y,Z", help="Point that the camera looks at, m. Default: the middle.")
    ] = None,
    distance: Annotated[
        Optional[float], typer.Option(help="Of the camera from the target, m. Default: such that everything is seen.")
    ] = None,
    turntable: Annotated[
        float,
        typer.Option(metavar="DEGREES", help="Turn the camera by so much a second; with --frame: one turn around it."),
    ] = 0.0,
    follow: Annotated[bool, typer.Option("--follow", help="Let the camera follow the cloth.")] = False,
    color: Annotated[
        Optional[list[str]],
        typer.Option(
            metavar="COLOR|CLOTH=COLOR",
            help="Colour of the next cloth, or of the named one: a name or #rrggbb; may be repeated.",
        ),
    ] = None,
    background: Annotated[str, typer.Option(help="Colour of the ground and behind it.")] = looks.BACKGROUND,
    texture: Annotated[
        Optional[Path], typer.Option(metavar="FILE", help="Image on cloths that have texture coordinates.")
    ] = None,
    show: Annotated[
        Shown, typer.Option(help="strain: colours for the largest strain since the first frame.")
    ] = "cloth",
    wireframe: Annotated[bool, typer.Option("--wireframe", help="Draw the edges of the triangles.")] = False,
    smooth: Annotated[
        bool, typer.Option("--smooth", help="Round the outlines of coarse cloth; layers may show through each other.")
    ] = False,
    obstacle_opacity: Annotated[
        Optional[float],
        typer.Option(min=0, max=1, help="0: unseen, 1: solid. Default: 1, less where obstacles hide the cloth."),
    ] = None,
    caption: Annotated[bool, typer.Option(help="Write time and speed into the pictures.")] = False,
    debug: Debug = False,
):
    """Draws OUT/frames.h5 without a display: PNG images and OUT/video.mp4."""
    from ..io import render as draw

    small = SMALL if film else USUAL
    if film and frame is not None and not turntable:
        raise SceneError("film: of a single frame needs a turntable, for example --turntable 45")
    look = draw.Look(
        size=(width or small.size[0], height or small.size[1]),
        azimuth=azimuth,
        elevation=elevation,
        target=point(target) if target is not None else None,
        distance=distance,
        turntable=turntable,
        follow=follow,
        colors=tuple(color or ()),
        background=background,
        obstacle_opacity=obstacle_opacity,
        wireframe=wireframe,
        texture=texture,
        show=Shown(show).value,
        smooth=smooth,
        quality=Quality(quality).value,
    )
    result = draw.render(
        output,
        look,
        fps=fps or small.fps,
        speed=speed,
        formats=[kind.value for kind in to] if to else list(small.formats),
        frame=frame,
        caption=caption,
        progress=Console(stderr=True, highlight=False),
        processes=max(1, min(2, len(os.sched_getaffinity(0)))),
        hold=small.hold,
        limit=limit,
    )
    said = [f"[bold]{escape(str(file))}[/]{size_of(file, result.notes)}" for file in result.files]
    images = f"{result.images} images, {result.seconds:.1f} s at {draw.speed_text(result.speed)}: "
    console().print((images if result.images > 1 else "") + ", ".join(said))


def size_of(file, notes):
    """What is said of a video that was compressed at the end."""
    return f" ({file.stat().st_size / 1000:,.0f} KB, {notes[file]})" if file in notes else ""
