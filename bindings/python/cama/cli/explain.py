# SPDX-License-Identifier: Apache-2.0
"""The command `cama explain`."""

from rich.markup import escape
from rich.table import Table

from .common import Computing, Debug, SceneName, clean, computing, console, rest_lines


@clean
@computing
def explain(
    scene: SceneName,
    how: Computing,
    debug: Debug = False,
):
    """Shows the options that are used, the stages and streams of SCENE with reasons, and memory after one step."""
    loaded = how.load(scene)
    simulation = how.simulation(loaded)
    level = how.accuracy.value if how.accuracy else loaded.options.get("accuracy", "production")
    simulation.step()
    out = console()
    out.print(
        f"[bold]{escape(repr(simulation.scene))}[/] on {simulation.backend} ({escape(simulation.device)}), "
        f"accuracy {level}"
    )
    chosen_by = {"level": f"level {level}", "scene": "scene", "user": "[bold]user[/]", "time_step": "long time_step"}
    for line in rest_lines(simulation.scene):
        out.print(escape(line))
    options = Table(box=None, padding=(0, 2))
    options.add_column("option", no_wrap=True)
    for title in ("value", "set by", "trades time for"):
        options.add_column(title)
    for s in simulation.chosen_options:
        options.add_row(s["name"], escape(s["value"]), chosen_by[s["origin"]], s["trades"])
    out.print(options)
    stages = Table(box=None, padding=(0, 2))
    stages.add_column("stage", no_wrap=True)
    stages.add_column("why")
    for name, why in simulation.explain():
        stages.add_row(escape(name), escape(why))
    out.print(stages)
    streams = Table(box=None, padding=(0, 2))
    streams.add_column("stream", no_wrap=True)
    streams.add_column("element")
    streams.add_column("elements", justify="right")
    streams.add_column("KiB", justify="right")
    rows = sorted(simulation.streams, key=lambda s: -s["bytes"])
    for s in rows:
        streams.add_row(escape(s["name"]), escape(s["element"]), f"{s['size']:,}", f"{s['bytes'] / 1024:,.1f}")
    streams.add_row("[bold]all[/]", "", "", f"[bold]{sum(s['bytes'] for s in rows) / 1024:,.1f}[/]")
    out.print(streams)
    out.print(f"peak of everything that was allocated: {simulation.peak_memory_bytes / 2**20:,.1f} MiB")
