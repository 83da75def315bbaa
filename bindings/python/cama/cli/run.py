# SPDX-License-Identifier: Apache-2.0
"""The command `cama run`."""

from contextlib import nullcontext, suppress
from datetime import timedelta
from pathlib import Path
from typing import Annotated, Optional

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from .. import plausibility
from ..hints import counted
from ..io.lock import locked
from ..io.progress import during
from ..options import help_of
from . import loop
from .common import (
    Computing,
    Debug,
    Pinch,
    Policy,
    SceneName,
    Store,
    clean,
    computing,
    console,
    fail,
    put_materials,
    seconds,
)
from .resume import resume as resumed_from

OVERSTRETCHED = 1.0  # strain that the summary warns of: no fabric is measured there


@clean
@computing
def run(
    scene: SceneName,
    how: Computing,
    material: Annotated[
        Optional[list[str]],
        typer.Option(
            metavar="[CLOTH=]MATERIAL",
            help="A fabric's name or a material file, for the named cloth or for all; may be repeated.",
        ),
    ] = None,
    frames: Annotated[
        Optional[int], typer.Option(min=0, help="Number of frames to record. Default: the scene's.")
    ] = None,
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
    checkpoint_every: Annotated[
        float,
        typer.Option(
            parser=seconds,
            metavar="SECONDS",
            help="Wall time between checkpoints; 0: only the one that is written however the run ends.",
        ),
    ] = loop.EVERY,
    checkpoint: Annotated[
        int, typer.Option(min=0, metavar="N", help="Write a checkpoint every N frames too; 0: not by frames.")
    ] = 0,
    resume: Annotated[
        bool,
        typer.Option(
            "--resume",
            help="Continue from the last checkpoint and OUT/frames.h5, as if the run had not stopped; "
            "without a checkpoint, start anew.",
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

    Ctrl-C, SIGTERM and SIGHUP stop it between steps; --resume goes on, after kill -9 too.
    """
    progress = Console(stderr=True, highlight=False)
    with during("loading the scene", progress):
        loaded = how.load(scene)
        put_materials(loaded, material)
    for line in plausibility.kept_apart(loaded):
        console().print(escape(line))
    with during("untangling the start" if intersections == Policy.untangle else "checking the start", progress):
        simulation = how.simulation(loaded, intersections=intersections.value, pinch=pinch.value)
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
        wanted = loaded.frames if frames is None else frames
        resumed = resumed_from(simulation, folder, changed_scene) if resume else None
        say_what_runs(simulation, wanted, folder)
        result = loop.run(
            simulation,
            folder,
            wanted,
            store=store.value if store else None,
            progress=progress,
            every=checkpoint_every,
            every_frames=checkpoint,
            resumed=resumed,
            keep=None if overwrite else say_kept,
        )
    with suppress(OSError) if result.interrupted else nullcontext():  # SIGHUP: nobody listens any more
        print_summary(result.fields, folder)
    if result.problem is not None:
        if debug:
            raise result.problem
        fail(result.problem)
        raise typer.Exit(1)
    if result.interrupted:
        with suppress(OSError):
            console().print(
                f"[yellow]Stopped after {result.fields['steps']} steps; what was computed is kept, --resume goes "
                "on from it.[/]"
            )
        raise typer.Exit(128 + result.interrupted)


def say_what_runs(simulation, frames, folder):
    """Says scene, size, level, backend, frames and folder before the run begins."""
    scene, options = simulation.scene, simulation.options
    counts = f"{simulation.cloth_triangle_count:,} triangles, {simulation.cloth_vertex_count:,} vertices"
    console().print(
        f"{escape(scene.name)}: {counts}; accuracy {options['accuracy']}, {options['precision']} precision, on "
        f"{simulation.backend} ({escape(simulation.device)})"
    )
    apart = scene.seconds_per_frame if simulation.error else simulation.time_step * simulation.steps_per_frame
    console().print(
        f"{counted(frames, 'frame')} of {apart * 1e3:.4g} ms, {frames * apart:.4g} s, to {escape(str(folder))}"
    )


def say_kept(frames, folder):
    """Says where the results of an earlier run are now."""
    console().print(
        f"the results of an earlier run, {frames:,} {'frame' if frames == 1 else 'frames'}, are now in "
        f"{escape(str(folder))}, which keeps one run; --overwrite deletes them instead"
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
        + (f"; {s['over_error']:,} as short as steps become err by more than that" if s["over_error"] else "")
    )


def wall_text(s):
    whole = timedelta(seconds=round(s["wall_time"])) if s["wall_time"] >= 60 else f"{s['wall_time']:.3g} s"
    if s["resumed_at"] is None:
        return str(whole)
    if s["counted_from"]:
        return f"{whole}; this and what steps did are counted from step {s['counted_from']:,} on"
    return f"{whole}, with the parts before step {s['resumed_at']:,}"


def print_summary(s, folder):
    """Prints a short table of summary.json."""
    ms, iterations = s["ms_per_step"], s["pcg"]["iterations"]
    bad = s["intersections"] > 0
    rows = [
        ("scene", f"{s['scene']}, {s['triangles']:,} triangles, {s['vertices']:,} vertices"),
        ("computed on", f"{s['backend']} ({s['device']}), {s['precision']} precision, accuracy {s['accuracy']}"),
        ("steps", steps_text(s)),
        ("wall time", wall_text(s)),
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
