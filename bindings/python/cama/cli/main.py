# SPDX-License-Identifier: Apache-2.0
"""The command `cama`: one module here for each of its commands."""

import typer

from .check import check
from .explain import explain
from .info import info
from .render import render
from .run import run
from .stability import stability
from .tradeoff import tradeoff
from .tune import tune

app = typer.Typer(
    help="Cloth simulation on CPUs and GPUs.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
)
for command in (run, info, explain, check, render, stability, tradeoff, tune):
    app.command()(command)


def main():
    """Entry point of the console script."""
    app()
