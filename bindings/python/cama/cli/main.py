# SPDX-License-Identifier: Apache-2.0
"""The command `cama`; each of its commands has a module here."""

import sys
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape

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

# What the command line got wrong. Older versions of Typer take it from Click, newer ones have their own.
UsageProblem = next(kind for kind in typer.BadParameter.__mro__ if kind.__name__ == "ClickException")

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
    """Entry point of the console script. A mistake on the command line becomes one red line, as other errors do."""
    try:
        code = app(standalone_mode=False)
    except typer.Abort:
        sys.exit(1)
    except UsageProblem as problem:
        if type(problem).__name__ == "NoArgsIsHelpError":
            problem.show()
        else:
            fail_usage(problem)
        sys.exit(problem.exit_code)
    sys.exit(code if isinstance(code, int) else 0)  # a code from typer.Exit; what else a command returns is no code


def fail_usage(problem):
    """Prints what is wrong with the command line, and where its help is."""
    context = getattr(problem, "ctx", None)
    text = problem.format_message().replace("Value error, ", "").rstrip(".")
    hint = f"; see {context.command_path} --help" if context else ""
    Console(stderr=True, soft_wrap=True).print(f"[bold red]Error:[/] [red]{escape(text + hint)}[/]", highlight=False)
