# SPDX-License-Identifier: Apache-2.0
"""The command `cama blender`."""

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from ..blender import write_addon
from .common import Debug, clean, console


@clean
def blender(
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FILE", help="Where to write the add-on.")] = Path(
        "cama_cloth.zip"
    ),
    debug: Debug = False,
):
    """Writes the add-on for Blender, which simulates meshes with this installation of cama."""
    file = write_addon(output)
    out = console()
    out.print(f"wrote {escape(str(file))}; in Blender 4.2 or later:")
    out.print("    Edit > Preferences > Add-ons > Install from Disk, choose that file, and switch on 'cama cloth'")
    out.print("    then the sidebar of the 3D viewport (N) has a tab 'cama'")
