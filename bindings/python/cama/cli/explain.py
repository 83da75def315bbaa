# SPDX-License-Identifier: Apache-2.0
"""The command `cama explain`."""

from rich.markup import escape
from rich.table import Table

from ..scene import Scene
from ..simulation import Simulation
from .common import (
    AccuracyOption,
    Backend,
    BackendOption,
    Debug,
    Device,
    ErrorOption,
    PrecisionOption,
    Resolution,
    SceneName,
    Set,
    Threads,
    TimeStep,
    chosen,
    clean,
    console,
    rest_lines,
)


@clean
def explain(
    scene: SceneName,
    backend: BackendOption = Backend.auto,
    precision: PrecisionOption = None,
    accuracy: AccuracyOption = None,
    time_step: TimeStep = 0.0,
    error: ErrorOption = "",
    set_: Set = None,
    resolution: Resolution = 0,
    threads: Threads = 0,
    device: Device = 0,
    debug: Debug = False,
):
    """Shows the options that are used, the stages and streams of SCENE with reasons, and memory after one step."""
    loaded = Scene.load(scene, resolution)
    simulation = Simulation(
        loaded,
        backend=backend.value,
        precision=precision.value if precision else None,
        accuracy=accuracy.value if accuracy else None,
        device=device,
        threads=threads,
        **chosen(time_step, set_, error),
    )
    level = accuracy.value if accuracy else loaded.options.get("accuracy", "production")
    simulation.step()
    out = console()
    out.print(
        f"[bold]{escape(repr(simulation.scene))}[/] on {simulation.backend} ({escape(simulation.device)}), "
        f"accuracy {level}"
    )
    chosen_by = {"level": f"level {level}", "scene": "scene", "user": "[bold]user[/]"}
    for line in rest_lines(simulation.scene):
        out.print(escape(line))
    options = Table("option", "value", "set by", "trades time for", box=None, padding=(0, 2))
    for s in simulation.chosen_options:
        options.add_row(s["name"], escape(s["value"]), chosen_by[s["origin"]], s["trades"])
    out.print(options)
    stages = Table("stage", "why", box=None, padding=(0, 2))
    for name, why in simulation.explain():
        stages.add_row(escape(name), escape(why))
    out.print(stages)
    streams = Table("stream", "element", box=None, padding=(0, 2))
    streams.add_column("elements", justify="right")
    streams.add_column("KiB", justify="right")
    rows = sorted(simulation.streams, key=lambda s: -s["bytes"])
    for s in rows:
        streams.add_row(escape(s["name"]), escape(s["element"]), f"{s['size']:,}", f"{s['bytes'] / 1024:,.1f}")
    streams.add_row("[bold]all[/]", "", "", f"[bold]{sum(s['bytes'] for s in rows) / 1024:,.1f}[/]")
    out.print(streams)
    out.print(f"peak of everything that was allocated: {simulation.peak_memory_bytes / 2**20:,.1f} MiB")
