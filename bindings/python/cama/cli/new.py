# SPDX-License-Identifier: Apache-2.0
"""The command `cama new`."""

import json
import os
import shutil
from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from .. import shipped
from ..errors import FileError
from .common import Debug, choice, clean, console
from .templates import TEMPLATES

Template = choice("Template", TEMPLATES)


@clean
def new(
    name: Annotated[str, typer.Argument(metavar="[NAME]", help="Folder to write; its last part names the scene.")] = (
        "my-scene"
    ),
    template: Annotated[
        Template,
        typer.Option(help="A sheet on a sphere, a flag, a garment on a walking body, an outfit on a dancing one."),
    ] = Template.sheet,
    debug: Debug = False,
):
    """Writes the folder NAME with a scene to begin with, whose comments say what its parts mean."""
    folder = Path(name)
    file = write(folder, template.value)
    out = console()
    out.print(f"wrote {escape(str(file))}; edit it, then:")
    for line in (f"cama check {folder}", f"cama run {folder}", f"cama render {Path('out') / folder.resolve().name}"):
        out.print(f"    {escape(line)}", soft_wrap=True)


def write(folder, template):
    """Writes a template and the schema that it names to a folder; returns the scene's file. Raises FileError."""
    file = folder / "scene.json"
    if file.exists():
        raise FileError(f"{file}: is there already; choose another name, or remove it")
    partial = file.with_name("scene.json.partial")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(shipped.folder() / "schema.json", folder / "schema.json")
        partial.write_text(TEMPLATES[template].replace("NAME", json.dumps(folder.resolve().name)), encoding="utf-8")
        os.replace(partial, file)
    except OSError as problem:
        raise FileError(f"{problem.filename or file}: {problem.strerror}") from None
    return file
