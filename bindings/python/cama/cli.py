# SPDX-License-Identifier: Apache-2.0
"""The command `cama`."""

import functools
import importlib.metadata
import platform
import sys
from enum import Enum
from pathlib import Path
from typing import Annotated, Optional

import numpy as np
import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

import cama

from . import _core, runner, stability_command, tradeoff_command

app = typer.Typer(help="Cloth simulation on CPUs and GPUs.", no_args_is_help=True, add_completion=False,
                  pretty_exceptions_enable=False, rich_markup_mode="rich")


class Backend(str, Enum):
    auto, cpu, opencl, cuda = "auto", "cpu", "opencl", "cuda"


class Precision(str, Enum):
    double, mixed, single = "double", "mixed", "single"


Accuracy = Enum("Accuracy", {name: name for name in _core.accuracy_levels()}, type=str)


class Store(str, Enum):
    double, single = "double", "single"


class Policy(str, Enum):
    reject, exempt, untangle = "reject", "exempt", "untangle"


class Pinch(str, Enum):
    stop, release = "stop", "release"


SceneName = Annotated[str, typer.Argument(metavar="SCENE", help="A folder with scene.json, a JSON file, or a shipped scene's name.")]
BackendOption = Annotated[Backend, typer.Option(help="Where to compute.")]
PrecisionOption = Annotated[Optional[Precision], typer.Option(help="Of forces, matrix and solve; left out: what the accuracy says.")]
AccuracyOption = Annotated[Optional[Accuracy], typer.Option(help="Level: time step, integrator, solver and collision options in one word; left out: the scene's options, else production.")]
TimeStep = Annotated[float, typer.Option(min=0.0, help="s; 0: the scene's at production and paper, else the level's.")]
Set = Annotated[Optional[list[str]], typer.Option("--set", metavar="NAME=VALUE", help="One option in place of the level's, for example tolerance=1e-4; may be repeated.")]
Resolution = Annotated[int, typer.Option(min=0, help="Total number of cloth triangles aimed at; 0: the scene's own.")]
Threads = Annotated[int, typer.Option(min=0, help="Threads of the CPU backend; 0: one for every 1,000 triangles, at most all processors.")]
Device = Annotated[int, typer.Option(min=0, help="Index of the backend's device.")]
Debug = Annotated[bool, typer.Option("--debug", help="Show Python's traceback of an error.")]


STRETCHED = 0.5   # start strain that `check` warns of, and to a stretch of 1 / 1.5
LARGE = 20.0      # m, extent that `check` asks about: a garment in centimetres
OVERSTRETCHED = 1.0   # strain that the summary warns of: no fabric is measured there
WHERE = ("backend", "device", "threads", "precision", "accuracy", "intersections", "pinch")   # options of the command's own


def clean(command):
    """Turns an exception of cama into one red line and exit code 2 (1 once a run has started)."""
    @functools.wraps(command)
    def run_clean(*arguments, debug=False, **options):
        try:
            return command(*arguments, debug=debug, **options)
        except cama.Error as problem:
            if debug:
                raise
            fail(problem)
            raise typer.Exit(2) from None
    return run_clean


def fail(problem):
    """One red line on standard error."""
    Console(stderr=True, soft_wrap=True).print(f"[bold red]{type(problem).__name__}:[/] [red]{escape(str(problem))}[/]", highlight=False)


def chosen(accuracy, time_step, words):
    """Options of `--time-step` and `--set NAME=VALUE`, each of the type that the level has it in. Throws SceneError."""
    level, result = _core.Options.preset(accuracy.value if accuracy else "production"), {"time_step": time_step} if time_step else {}
    for word in words or ():
        name, mark, text = word.partition("=")
        if not mark:
            raise cama.SceneError(f"--set {word}: expected NAME=VALUE")
        if name in WHERE:
            raise cama.SceneError(f"--set {word}: use --{name}")
        kind = type(getattr(level, name, ""))
        try:
            result[name] = {"true": True, "false": False}[text.lower()] if kind is bool else kind(text)
        except (KeyError, ValueError):
            raise cama.SceneError(f"--set {word}: {text!r} is not a {kind.__name__}") from None
    return result


def console():
    return Console(soft_wrap=True, highlight=False)


@app.command()
@clean
def run(scene: SceneName,
        backend: BackendOption = Backend.auto, precision: PrecisionOption = None,
        accuracy: AccuracyOption = None, time_step: TimeStep = 0.0, set_: Set = None, resolution: Resolution = 0,
        frames: Annotated[Optional[int], typer.Option(min=0, help="Frames to record; default: the scene's.")] = None,
        threads: Threads = 0, device: Device = 0,
        intersections: Annotated[Policy, typer.Option(help="What becomes of a start that intersects: refused, started as it is, cloth moved first.")] = Policy.reject,
        pinch: Annotated[Pinch, typer.Option(help="What becomes of cloth that moving bodies pinch: an error, or it is let go of until free.")] = Pinch.stop,
        store: Annotated[Optional[Store], typer.Option(help="Precision of the positions in frames.h5. Default: double; with --resume that of the file.")] = None,
        output: Annotated[Optional[Path], typer.Option("--output", "-o", metavar="OUT", help="Folder of the results; default: out/SCENE.")] = None,
        checkpoint: Annotated[int, typer.Option(min=0, metavar="N", help="Write OUT/checkpoint.h5 every N frames too; it is always written at the end.")] = 0,
        resume: Annotated[bool, typer.Option("--resume", help="Go on from OUT/checkpoint.h5 and its frames.h5, as if the run had never stopped.")] = False,
        debug: Debug = False):
    """Simulates SCENE; writes OUT/frames.h5, OUT/summary.json and OUT/checkpoint.h5. Ctrl-C or SIGTERM stops between steps and keeps what was computed."""
    loaded = cama.Scene.load(scene, resolution)
    simulation = cama.Simulation(loaded, backend=backend.value, precision=precision.value if precision else None,
                                 accuracy=accuracy.value if accuracy else None, device=device, threads=threads,
                                 **{"intersections": intersections.value, "pinch": pinch.value, **chosen(accuracy, time_step, set_)})
    if simulation.untangled.rounds:
        moved = simulation.untangled
        console().print(f"start untangled: {moved.before:,} intersections, {moved.moved:,} vertices moved by up to {moved.largest_move * 1e3:.3g} mm")
    say_frame_time(loaded, simulation)
    folder = output or Path("out") / (Path(scene).stem if Path(scene).name != "scene.json" else Path(scene).resolve().parent.name)
    if resume:
        different = simulation.load_checkpoint(folder)
        console().print(f"resumed at step {simulation.step_count:,}, {simulation.time:.4g} s")
        if different:
            console().print(f"[yellow]not bit by bit as before: {escape(', '.join(different))}[/]")
    result = runner.run(simulation, folder, loaded.frames if frames is None else frames,
                        store=store.value if store else None, progress=Console(stderr=True, highlight=False), checkpoint_every=checkpoint, resume=resume)
    print_summary(result.fields, folder)
    if result.problem is not None:
        if debug:
            raise result.problem
        fail(result.problem)
        raise typer.Exit(1)
    if result.interrupted:
        console().print(f"[yellow]Stopped after {result.fields['steps']} steps; what was computed is kept, --resume goes on from it.[/]")
        raise typer.Exit(128 + result.interrupted)


def say_frame_time(scene, simulation):
    """Says where steps do not fill frames, so that these come at other times than the scene says."""
    steps, wanted = simulation.steps_per_frame, scene.seconds_per_frame
    apart = steps * simulation.time_step
    if abs(apart - wanted) > 1e-6 * wanted:
        console().print(f"[yellow]frames are {apart * 1e3:.6g} ms apart, not {wanted * 1e3:.6g}: {steps} {'step' if steps == 1 else 'steps'} of "
                        f"{simulation.time_step * 1e3:.6g} ms; take a time step that divides the frame time[/]")


def number(value, pattern="{:.4g}", unit=""):
    return "-" if value is None else pattern.format(value) + unit


def strained(strain):
    text = number(strain and strain * 100, "{:,.4g}", " %")
    if strain is None or strain <= OVERSTRETCHED:
        return text
    return f"[bold yellow]{text}[/]: no fabric is like that; look at what pulls, and whether shorter steps (--time-step, --accuracy) change it"


def print_summary(s, folder):
    """A short table of summary.json."""
    ms, iterations = s["ms_per_step"], s["pcg"]["iterations"]
    bad = s["intersections"] > 0
    rows = [
        ("scene", f"{s['scene']}, {s['triangles']:,} triangles, {s['vertices']:,} vertices"),
        ("computed on", f"{s['backend']} ({s['device']}), {s['precision']} precision, accuracy {s['accuracy']}"),
        ("steps", f"{s['steps']} of {number(s['dt'] * 1e3)} ms"),
        ("time per step", f"{number(ms['mean'])} ms mean, {number(ms['median'])} median, {number(ms['max'])} max"),
        ("solver iterations", f"{number(iterations['mean'])} mean, {number(iterations['max'], '{:d}')} max"),
        ("contacts, impacts", f"at most {s['contacts']['max']:,} and {s['impacts']['max']:,} in a step"),
        ("intersections", f"[{'bold red' if bad else 'green'}]{s['intersections']:,}[/] in all recorded frames"),
        ("motion cut", f"of {s['truncated']:,} vertices in all; at most {s['lost_motion'] * 100:.3g} % of a step's motion"),
        ("smallest gap", number(s["min_gap"] and s["min_gap"] * 1e3, unit=" mm")),
        ("largest strain", strained(s["max_strain"])),
        ("peak memory", f"{s['peak_memory_bytes'] / 2**20:,.1f} MiB"),
        ("state hash", s["state_hash"]),
        ("written to", escape(str(folder))),
    ]
    if s["retries"]:
        rows.append(("retries", f"[bold yellow]{s['retries']:,}[/] attempts at steps failed and were done again in shorter ones"))
    if s["released"]:
        rows.append(("let go of", f"[bold red]{s['released']:,}[/] vertices that moving bodies pinched"))
    slowest = sorted(((v, k) for k, v in s["stages"].items() if "/" not in k), reverse=True)[:6]
    if slowest:
        rows.insert(4, ("of which", ", ".join(f"{escape(name)} {value:.3g} ms" for value, name in slowest)))
    table = Table(show_header=False, box=None, padding=(0, 2))
    for name, text in rows:
        table.add_row(f"[bold]{name}[/]", text)
    console().print(table)


@app.command()
@clean
def info(debug: Debug = False):
    """Shows backends, devices, versions, shipped scenes and fabrics."""
    table = Table("backend", "devices", "note", box=None, padding=(0, 2))
    for backend in cama.backends():
        mark = "[green]" if backend["available"] else "[dim]"
        table.add_row(mark + backend["name"], escape(", ".join(backend["devices"]) or "-"), escape(backend["note"]))
    out = console()
    out.print(table)
    versions = [f"cama {cama.__version__}", f"built with {_core.compiler}", f"Python {platform.python_version()}"]
    for package in ("numpy", "h5py", "pyvista", "vtk"):
        try:
            versions.append(f"{package} {importlib.metadata.version(package)}")
        except importlib.metadata.PackageNotFoundError:
            versions.append(f"{package} absent")
    out.print("versions  " + ", ".join(versions))
    out.print("scenes    " + (", ".join(cama.scenes()) or "-"))
    out.print("fabrics   " + ", ".join(cama.fabrics()))


@app.command()
@clean
def explain(scene: SceneName, backend: BackendOption = Backend.auto, precision: PrecisionOption = None,
            accuracy: AccuracyOption = None, time_step: TimeStep = 0.0, set_: Set = None, resolution: Resolution = 0,
            threads: Threads = 0, device: Device = 0, debug: Debug = False):
    """Shows what the accuracy level chose, which stages and streams SCENE gets, why, and their memory after one step."""
    loaded = cama.Scene.load(scene, resolution)
    simulation = cama.Simulation(loaded, backend=backend.value, precision=precision.value if precision else None,
                                 accuracy=accuracy.value if accuracy else None, device=device, threads=threads, **chosen(accuracy, time_step, set_))
    level = accuracy.value if accuracy else loaded.options.get("accuracy", "production")
    simulation.step()
    out = console()
    out.print(f"[bold]{escape(repr(simulation.scene))}[/] on {simulation.backend} ({escape(simulation.device)}), accuracy {level}")
    chosen_by = {"level": f"level {level}", "scene": "scene", "user": "[bold]user[/]"}
    options = Table("option", "value", "set by", "trades time for", box=None, padding=(0, 2))
    for s in simulation.settings:
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


def place_text(place):
    return "(" + ", ".join(f"{x:.4g}" for x in place) + ")"


def intersection_table(found):
    """Count, place and first primitives for each pair of objects."""
    table = Table("objects", box=None, padding=(0, 2))
    table.add_column("count", justify="right")
    for title in ("around, m", "from, m", "to, m", "first edge", "first face"):
        table.add_column(title)
    for pair in found:
        names = {pair.first: pair.first_name, pair.second: pair.second_name}
        who = pair.first_name + (" with itself" if pair.first == pair.second else " with " + pair.second_name)
        edge, face = (escape(names[int(owner[0])]) for owner in (pair.edge_object, pair.face_object))
        table.add_row(escape(who), f"[bold red]{pair.count:,}[/]", place_text(pair.mean), *map(place_text, pair.bounds),
                      f"{pair.edge[0, 0]}-{pair.edge[0, 1]} of {edge}", f"{pair.face[0]} of {face}")
    return table


@app.command()
@clean
def check(scene: SceneName, resolution: Resolution = 0,
          mesh: Annotated[Optional[Path], typer.Option(metavar="FILE", help="Write the intersecting faces: .ply (coloured) or .obj (grouped).")] = None,
          debug: Debug = False):
    """Validates SCENE; reports its parts and what intersects at the start, and where. Exit code 1 if anything does."""
    loaded = cama.Scene.load(scene, resolution)
    loaded.validate()
    table = Table("part", "name", "from", box=None, padding=(0, 2))
    sizes = Table("cloth", box=None, padding=(0, 1))
    for title in ("triangles", "vertices"):
        table.add_column(title, justify="right")
    for title in ("extent, m", "rest area, m²", "mass, kg", "start strain, %"):
        sizes.add_column(title, justify="right", no_wrap=True)
    stretched, large = [], []
    for kind, parts in (("cloth", loaded.cloths), ("obstacle", loaded.obstacles)):
        for part in parts:
            table.add_row(kind, escape(part.name), escape(part.source), f"{len(part.faces):,}", f"{len(part.vertices):,}")
            if kind == "obstacle":
                continue
            least, most = part.start_strain
            if np.ptp(part.vertices, axis=0).max() > LARGE:
                large.append(part.name)
            strain = f"{100 * least:.3g} to {100 * most:.3g}" if max(most, -least) > 5e-5 else "0"
            sizes.add_row(escape(part.name), " x ".join(f"{x:.3g}" for x in np.ptp(part.vertices, axis=0)), f"{part.rest_area:.3g}", f"{part.mass:.3g}", strain)
            if most > STRETCHED or least < 1 / (1 + STRETCHED) - 1:
                stretched.append(part.name)
    out = console()
    out.print(table)
    out.print(sizes)
    pinned = sum(len(pin["vertices"]) for pin in loaded.pins)
    found = loaded.intersections()
    count = sum(pair.count for pair in found)
    out.print(f"{loaded.triangle_count:,} cloth triangles, {pinned:,} pinned vertices, {loaded.stitch_count:,} stitches, "
              f"{loaded.frames} frames of {loaded.seconds_per_frame * 1e3:g} ms")
    if large:
        out.print(f"[yellow]{escape(', '.join(large))}: more than {LARGE:g} m across; lengths are metres, so what was made in centimetres or millimetres needs "
                  "a file with `scale` 0.01 or 0.001[/]")
    if stretched:
        out.print(f"[yellow]{escape(', '.join(stretched))}: starts far from its rest shape, which its texture coordinates or material vertices say[/]")
    out.print(f"intersections at the start: [{'bold red' if count else 'green'}]{count}[/]")
    if mesh:
        loaded.save_intersections(mesh)
        out.print(f"intersecting faces written to {escape(str(mesh))}")
    if count:
        out.print(intersection_table(found))
        out.print("`cama run` refuses this start; its option --intersections untangle moves the cloth first, exempt starts as it is.")
        raise typer.Exit(1)


@app.command()
@clean
def render(output: Annotated[Path, typer.Argument(metavar="OUT", help="Folder that `cama run` wrote.")],
           fps: Annotated[int, typer.Option(min=1, max=240, help="Images per second of the video.")] = 30,
           speed: Annotated[Optional[float], typer.Option(min=1e-6, help="1: real time, 0.5: half. Default: slow enough to see.")] = None,
           width: Annotated[int, typer.Option(min=16)] = 1280, height: Annotated[int, typer.Option(min=16)] = 720,
           azimuth: Annotated[float, typer.Option(help="Where the camera stands, degrees from the x axis.")] = -60.0,
           elevation: Annotated[float, typer.Option(help="How high it stands, degrees.")] = 22.0,
           images: Annotated[bool, typer.Option(help="Write one PNG per image to OUT/images.")] = True,
           debug: Debug = False):
    """Draws OUT/frames.h5 without a display: PNG images and OUT/video.mp4."""
    from . import render as draw
    result = draw.render(output, fps=fps, speed=speed, size=(width, height), azimuth=azimuth, elevation=elevation, images=images,
                         progress=Console(stderr=True, highlight=False))
    console().print(f"{result.images} images, {result.seconds:.1f} s at {draw.speed_text(result.speed)}: [bold]{escape(str(result.video))}[/]")


stability_command.register(app, clean, console)
tradeoff_command.register(app, clean, console)


def main():
    """Entry point of the console script."""
    app()


if __name__ == "__main__":
    sys.exit(main())
