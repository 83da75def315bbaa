# SPDX-License-Identifier: Apache-2.0
"""The command `cama doctor`."""

import ctypes.util
import importlib.util
import os
import platform
import sys
from pathlib import Path

from rich.markup import escape
from rich.table import Table

from .. import _core
from ..hints import PIP_NAMES
from ..io import reading
from .common import Debug, clean, console
from .info import note_of

EXTRAS = {  # modules of the extras of pyproject.toml, and what needs them
    "render": (("pyvista", "imageio", "imageio_ffmpeg"), "cama render"),
    "view": (("viser", "scipy"), "cama view"),
    "export": (("pxr", "vtkmodules"), "cama export to USD and VTK, USD files in scenes"),
    "tradeoff": (("scipy", "matplotlib"), "cama tradeoff, cama tune"),
    "fabric": (("scipy",), "cama fabric fit"),
    "dress": (("scipy",), "cama dress"),
    "cluster": (("ray",), "cama tradeoff on several machines"),
}
MARKS = {"found": "[green]found[/]", "missing": "[yellow]missing[/]", "limited": "[yellow]limited[/]"}
GUIDE = "docs/guide/choosing-a-backend.md"


@clean
def doctor(debug: Debug = False):
    """Looks for all that cama can use on this machine, and says what to do about what is missing. Exit code 0."""
    rows = [*_program(), *_backends(), *_libraries(), *_extras(), *_threads(), *_environment()]
    table = Table("", "what", "here", box=None, padding=(0, 2))
    for state, what, here, _ in rows:
        table.add_row(MARKS[state], escape(what), escape(here))
    out = console()
    out.print(table)
    todo = [(what, remedy) for _, what, _, remedy in rows if remedy]
    for what, remedy in todo:
        out.print(f"[yellow]{escape(what)}[/]: {escape(remedy)}")
    computing = ", ".join(backend["name"] for backend in _core.list_backends() if backend["available"])
    missing = f"; {len(todo)} thing{'s' * (len(todo) != 1)} to look at, above, none of which it needs" if todo else ""
    out.print(f"[bold green]cama works here[/], with {computing}{missing}")


def _program():
    yield "found", "cama", f"{_core.__version__}, built with {_core.compiler}", ""
    yield "found", "Python", f"{platform.python_version()}, {sys.executable}", ""


def _backends():
    """Rows of the backends: state, what, what is here, what to do."""
    for backend in _core.list_backends():
        name, devices = backend["name"], ", ".join(backend["devices"])
        if backend["available"]:
            yield "found", f"backend {name}", devices or note_of(backend) or "-", ""
            continue
        yield "missing", f"backend {name}", note_of(backend), _backend_remedy(name, backend["note"])


def _backend_remedy(name, note):
    if note.startswith("not in this build"):
        return f"this build of cama has no {name}; build it with {name} to use such a device ({GUIDE})"
    if name == "opencl":
        return (
            "install the OpenCL driver of the device: for CPUs pocl (Debian: pocl-opencl-icd), for a GPU its maker's; "
            "`clinfo -l` lists what is found"
        )
    return f"needs an NVIDIA GPU with a current driver; `nvidia-smi` shows both ({GUIDE})"


def _libraries():
    """Rows of libraries outside Python."""
    for library, what, remedy in (
        ("OpenCL", "OpenCL loader", "install it to use OpenCL devices (Debian: ocl-icd-libopencl1)"),
        ("cuda", "CUDA driver", "comes with the driver of an NVIDIA GPU; without such a GPU nothing is to be done"),
    ):
        place = ctypes.util.find_library(library)
        yield ("found", what, place, "") if place else ("missing", what, f"no lib{library}", remedy)
    if has_assimp():
        yield "found", "assimp", "reads PLY, glTF, FBX, DAE, STL", ""
    else:
        yield "missing", "assimp", "meshes from OBJ only", "install assimp (Debian: libassimp-dev) and build again"
    if reading.works():
        yield "found", "reader process", "foreign mesh files are read there first", ""
    else:
        remedy = f"{sys.executable} cannot start a Python process, so a damaged mesh file can end this one"
        yield "missing", "reader process", "does not start", remedy


def has_assimp():
    """Whether the compiled module reads more than OBJ."""
    try:
        _core.load_mesh(Path("/nonexistent.ply"), 1.0, False, 1.0)
    except _core.FileError as problem:
        return "reads OBJ only" not in str(problem)
    return True


def _extras():
    """Rows of the optional packages."""
    for extra, (modules, task) in EXTRAS.items():
        absent = [PIP_NAMES.get(m, m) for m in modules if importlib.util.find_spec(m) is None]
        if absent:
            remedy = f"`{sys.executable} -m pip install {' '.join(absent)}`, for {task}"
            yield "missing", f"extra {extra}", f"without {', '.join(absent)}", remedy
        else:
            yield "found", f"extra {extra}", ", ".join(modules), ""


def _threads():
    """Rows of processors: those of the machine, and what a container or the environment leaves of them."""
    count = os.cpu_count() or 1
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else count
    quota, threads = processor_quota(), os.environ.get("OMP_NUM_THREADS", "")
    words = f"{usable} of {count} processors usable"
    words += "" if quota is None else f", quota of the container {quota:.3g}"
    words += f", OMP_NUM_THREADS={threads}" if threads else ""
    fewer = usable < count or (quota is not None and quota < usable) or (threads.isdigit() and int(threads) < usable)
    remedy = "the CPU backend computes with fewer threads than there are processors; raise the limit if it is not meant"
    yield "limited" if fewer else "found", "threads", words, remedy if fewer else ""


def processor_quota(root=Path("/sys/fs/cgroup")):
    """Returns how many processors a container may use (control groups 1 and 2), or None for no limit."""
    try:
        quota, period = (root / "cpu.max").read_text(encoding="ascii").split()
    except (OSError, ValueError):
        try:
            quota = (root / "cpu/cpu.cfs_quota_us").read_text(encoding="ascii").strip()
            period = (root / "cpu/cpu.cfs_period_us").read_text(encoding="ascii").strip()
        except OSError:
            return None
    return float(quota) / float(period) if quota.isdigit() and float(period) > 0 else None


def _environment():
    """A row of the environment variables that cama reads and that are set."""
    names = sorted(name for name in os.environ if name.startswith("CAMA_"))
    if names:
        yield "found", "environment", ", ".join(f"{name}={os.environ[name]}" for name in names), ""
