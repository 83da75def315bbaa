# SPDX-License-Identifier: Apache-2.0
"""The command `cama run`."""

from pathlib import Path
from typing import Annotated, Optional

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from ..io.checkpoint import SceneChanged
from ..io.lock import locked
from ..options import help_of
from ..scene import Scene
from ..simulation import Simulation
from . import loop
from .common import (
    AccuracyOption,
    Backend,
    BackendOption,
    Debug,
    Device,
    ErrorOption,
    Pinch,
    Policy,
    PrecisionOption,
    Resolution,
    SceneName,
    Set,
    Store,
    Threads,
    TimeStep,
    chosen,
    clean,
    console,
    fail,
)

OVERSTRETCHED = 1.0  # strain that the summary warns of: no fabric is measured there


@clean
def run(
    scene: SceneName,
    backend: BackendOption = Backend.auto,
    precision: PrecisionOption = None,
    accuracy: AccuracyOption = None,
    time_step: TimeStep = 0.0,
    error: ErrorOption = "",
    set_: Set = None,
    resolution: Resolution = 0,
    frames: Annotated[
        Optional[int], typer.Option(min=0, help="Number of frames to record. Default: the scene's.")
    ] = None,
    threads: Threads = 0,
    device: Device = 0,
    intersections: Annotated[
        Policy,
        typer.Option(help=help_of("intersections")),
    ] = Policy.reject,
    pinch: Annotated[
        Pinch,
        typer.Option(help=help_of("pinch")),
    ] = Pinch.stop,
    store: Annotated[
        Optional[Store],
        typer.Option(help="Precision of the positions in frames.h5. Default: double; with --resume that of the file."),
    ] = None,
    output: Annotated[
        Optional[Path], typer.Option("--output", "-o", metavar="OUT", help="Folder of the results. Default: out/SCENE.")
    ] = None,
    checkpoint: Annotated[
        int,
        typer.Option(
            min=0, metavar="N", help="Write OUT/checkpoint.h5 every N frames too; it is always written at the end."
        ),
    ] = 0,
    resume: Annotated[
        bool,
        typer.Option(
            "--resume", help="Continue from OUT/checkpoint.h5 and OUT/frames.h5, as if the run had not stopped."
        ),
    ] = False,
    changed_scene: Annotated[
        bool, typer.Option("--changed-scene", help="With --resume: go on although SCENE was edited since.")
    ] = False,
    overwrite: Annotated[
        bool,
        typer.Option("--overwrite", help="Delete the results of an earlier run in OUT; else OUT/previous keeps them."),
    ] = False,
    debug: Debug = False,
):
    """Simulates SCENE; writes OUT/frames.h5, OUT/summary.json and OUT/checkpoint.h5.

    Ctrl-C or SIGTERM stops between steps and keeps what was computed.
    """
    loaded = Scene.load(scene, resolution)
    simulation = Simulation(
        loaded,
        backend=backend.value,
        precision=precision.value if precision else None,
        accuracy=accuracy.value if accuracy else None,
        device=device,
        threads=threads,
        **{"intersections": intersections.value, "pinch": pinch.value, **chosen(time_step, set_, error)},
    )
    if simulation.untangled.rounds:
        moved = simulation.untangled
        console().print(
            f"start untangled: {moved.before:,} intersections, {moved.moved:,} vertices moved by up to "
            f"{moved.largest_move * 1e3:.3g} mm"
        )
    say_frame_time(loaded, simulation)
    folder = output or Path("out") / (
        Path(scene).stem if Path(scene).name != "scene.json" else Path(scene).resolve().parent.name
    )
    with locked(folder):
        if resume:
            load_checkpoint(simulation, folder, changed_scene)
        result = loop.run(
            simulation,
            folder,
            loaded.frames if frames is None else frames,
            store=store.value if store else None,
            progress=Console(stderr=True, highlight=False),
            checkpoint_every=checkpoint,
            resume=resume,
            keep=None if overwrite else say_kept,
        )
    print_summary(result.fields, folder)
    if result.problem is not None:
        if debug:
            raise result.problem
        fail(result.problem)
        raise typer.Exit(1)
    if result.interrupted:
        console().print(
            f"[yellow]Stopped after {result.fields['steps']} steps; what was computed is kept, --resume goes "
            "on from it.[/]"
        )
        raise typer.Exit(128 + result.interrupted)


def load_checkpoint(simulation, folder, changed_scene):
    """Continues from the checkpoint of a folder and says where. Raises as Simulation.load_checkpoint."""
    try:
        different = simulation.load_checkpoint(folder, changed_scene=changed_scene)
    except SceneChanged as problem:
        raise SceneChanged(
            problem.changed,
            "run the scene that it was taken of, start anew without --resume, or go on with this one by "
            "--changed-scene",
        ) from None
    console().print(f"resumed at step {simulation.step_count:,}, {simulation.time:.4g} s")
    if different:
        console().print(f"[yellow]not bit by bit as before: {escape(', '.join(different))}[/]")


def say_kept(frames, folder):
    """Says where the results of an earlier run are now."""
    console().print(
        f"the results of an earlier run, {frames:,} {'frame' if frames == 1 else 'frames'}, are now in "
        f"{escape(str(folder))}, in place of what was there; --overwrite deletes them instead"
    )


def say_frame_time(scene, simulation):
    """Warns if steps do not fill frames, so that frames come at other times than the scene says."""
    if simulation.error:
        return
    steps, wanted = simulation.steps_per_frame, scene.seconds_per_frame
    apart = steps * simulation.time_step
    if abs(apart - wanted) > 1e-6 * wanted:
        console().print(
            f"[yellow]frames are {apart * 1e3:.6g} ms apart, not {wanted * 1e3:.6g}: {steps} "
            f"{'step' if steps == 1 else 'steps'} of "
            f"{simulation.time_step * 1e3:.6g} ms; take a time step that divides the frame time[/]"
        )


def number(value, pattern="{:.4g}", unit=""):
    return "-" if value is None else pattern.format(value) + unit


def strained(strain):
    text = number(strain and strain * 100, "{:,.4g}", " %")
    if strain is None or strain <= OVERSTRETCHED:
        return text
    return (
        f"[bold yellow]{text}[/]: no fabric is like that; look at what pulls, and whether shorter steps "
        "(--time-step, --accuracy) change it"
    )


def steps_text(s):
    if not s["error"]:
        return f"{s['steps']} of {number(s['dt'] * 1e3)} ms"
    lengths = s["time_steps"]
    return (
        f"{s['steps']} of {number(lengths['min'] and lengths['min'] * 1e3)} to "
        f"{number(lengths['max'] and lengths['max'] * 1e3)} ms, for an error of {s['error'] * 1e3:.3g} mm a frame of "
        f"1/60 s; {s['rejected']:,} taken again"
    )


def print_summary(s, folder):
    """Prints a short table of summary.json."""
    ms, iterations = s["ms_per_step"], s["pcg"]["iterations"]
    bad = s["intersections"] > 0
    rows = [
        ("scene", f"{s['scene']}, {s['triangles']:,} triangles, {s['vertices']:,} vertices"),
        ("computed on", f"{s['backend']} ({s['device']}), {s['precision']} precision, accuracy {s['accuracy']}"),
        ("steps", steps_text(s)),
        ("time per step", f"{number(ms['mean'])} ms mean, {number(ms['median'])} median, {number(ms['max'])} max"),
        ("solver iterations", f"{number(iterations['mean'])} mean, {number(iterations['max'], '{:d}')} max"),
        ("contacts, impacts", f"at most {s['contacts']['max']:,} and {s['impacts']['max']:,} in a step"),
        ("intersections", f"[{'bold red' if bad else 'green'}]{s['intersections']:,}[/] in all recorded frames"),
        (
            "motion cut",
            f"of {s['truncated']:,} vertices in all; at most {s['lost_motion'] * 100:.3g} % of a step's motion",
        ),
        ("smallest gap", number(s["min_gap"] and s["min_gap"] * 1e3, unit=" mm")),
        ("largest strain", strained(s["max_strain"])),
        ("peak memory", f"{s['peak_memory_bytes'] / 2**20:,.1f} MiB"),
        ("state hash", s["state_hash"]),
        ("written to", escape(str(folder))),
    ]
    if s["retries"]:
        rows.append(
            (
                "retries",
                f"[bold yellow]{s['retries']:,}[/] attempts at steps failed and were done again in shorter ones",
            )
        )
    if s["released"]:
        rows.append(("let go of", f"[bold red]{s['released']:,}[/] vertices that moving bodies pinched"))
    slowest = sorted(((v, k) for k, v in s["stages"].items() if "/" not in k), reverse=True)[:6]
    if slowest:
        rows.insert(4, ("of which", ", ".join(f"{escape(name)} {value:.3g} ms" for value, name in slowest)))
    table = Table(show_header=False, box=None, padding=(0, 2))
    for name, text in rows:
        table.add_row(f"[bold]{name}[/]", text)
    console().print(table)
