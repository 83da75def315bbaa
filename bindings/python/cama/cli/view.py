# SPDX-License-Identifier: Apache-2.0
"""The command `cama view`."""

import signal
from pathlib import Path
from typing import Annotated, Optional

import typer
from rich.markup import escape

from .. import shipped
from ..errors import FileError
from ..hints import require
from .common import Computing, Debug, clean, computing, console


@clean
@computing
def view(
    what: Annotated[
        str,
        typer.Argument(
            metavar="SCENE|OUT",
            help="A folder that `cama run` wrote; or a scene: a folder with scene.json, a JSON file, or a shipped "
            "scene's name.",
        ),
    ],
    *,
    host: Annotated[
        str, typer.Option(help="Address to serve at; 0.0.0.0: reachable by everyone in the network.")
    ] = "127.0.0.1",
    port: Annotated[
        Optional[int],
        typer.Option(min=1, max=65535, help="Port to serve at. Default: the first free from 8080 on."),
    ] = None,
    how: Computing,
    debug: Debug = False,
):
    """Serves a page in which a recording is played, or a scene simulated live, until Ctrl-C.

    The options from --backend on are those of a simulation.
    """
    require("the viewer", "viser")
    if is_recording(what):
        from ..viewing.player import Player

        viewer = Player(what, host, port)
    else:
        from ..viewing.live import Live

        viewer = Live(how.simulation(how.load(what)), host, port)
    with viewer:
        before = signal.signal(signal.SIGTERM, signal.default_int_handler)
        try:
            say_where(viewer)  # Ctrl-C ends from the moment that it says so
            viewer.wait()
        except KeyboardInterrupt:
            pass
        finally:
            signal.signal(signal.SIGTERM, before)


def is_recording(what):
    """Whether a folder or file holds frames; a folder that also has scene.json is a scene, as for other commands."""
    path = Path(what)
    if path.is_file():
        return path.suffix == ".h5"
    if (path / "scene.json").is_file():
        return False
    if (path / "frames.h5").is_file():
        return True
    if path.is_dir() and what not in shipped.names():
        raise FileError(
            f"{what}: this folder has neither scene.json nor frames.h5; `cama run SCENE -o {what}` writes a recording"
        )
    return False


def say_where(viewer):
    """Prints the page's address, and how it is reached from elsewhere."""
    console().print(f"open [bold]{escape(viewer.url)}[/] in a browser; Ctrl-C ends")
    if viewer.tunnel:
        console().print(f"from another machine, first run there: {escape(viewer.tunnel)}")
