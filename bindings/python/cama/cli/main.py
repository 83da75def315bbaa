# SPDX-License-Identifier: Apache-2.0
"""The command `cama`; each of its commands has a module here."""

from typing import Annotated

import typer

from .. import _core
from .blender import blender
from .check import check
from .doctor import doctor
from .dress import dress
from .explain import explain
from .export import export
from .fabric import app as fabric
from .info import info
from .new import new
from .render import render
from .run import run
from .stability import stability
from .tradeoff import tradeoff
from .tune import tune
from .view import view

app = typer.Typer(
    help="Cloth simulation on CPUs and GPUs.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
)


def say_version(wanted: bool) -> None:
    """Prints the version and ends, if it is wanted."""
    if wanted:
        typer.echo(f"cama {_core.__version__}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool, typer.Option("--version", callback=say_version, is_eager=True, help="Print the version and exit.")
    ] = False,
):
    pass


commands = (run, new, dress, check, render, view, export, blender, explain, info, doctor, stability, tradeoff, tune)
for command in commands:
    app.command()(command)
app.add_typer(fabric, name="fabric")


def main():
    """Entry point of the console script."""
    app()
