# SPDX-License-Identifier: Apache-2.0
"""The command `cama info`."""

import importlib.metadata
import platform

from rich.markup import escape
from rich.table import Table

from .. import _core, shipped
from ..material import fabrics
from .common import Debug, clean, console

# What the CUDA runtime says where there is nothing to compute on, and what that means.
NO_DRIVER = (
    "cudaErrorInsufficientDriver",
    "cudaErrorNoDevice",
    "cudaErrorStubLibrary",
    "cudaErrorSystemDriverMismatch",
)


def note_of(backend):
    """Returns the note of a backend, for people who have no such device too."""
    note = backend["note"]
    if any(error in note for error in NO_DRIVER):
        return f"no NVIDIA GPU with a current driver here ({note})"
    if backend["name"] == "cuda" and note.startswith("not in this build"):
        return f"{note}; cama computes on the other backends"
    return note


@clean
def info(debug: Debug = False):
    """Shows backends, devices, versions, shipped scenes and fabrics."""
    table = Table("backend", "devices", "note", box=None, padding=(0, 2))
    for backend in _core.list_backends():
        mark = "[green]" if backend["available"] else "[dim]"
        table.add_row(mark + backend["name"], escape(", ".join(backend["devices"]) or "-"), escape(note_of(backend)))
    out = console()
    out.print(table)
    versions = [f"cama {_core.__version__}", f"built with {_core.compiler}", f"Python {platform.python_version()}"]
    for package in ("numpy", "h5py", "pyvista", "vtk"):
        try:
            versions.append(f"{package} {importlib.metadata.version(package)}")
        except importlib.metadata.PackageNotFoundError:
            versions.append(f"{package} absent")
    out.print("versions  " + ", ".join(versions))
    out.print("scenes    " + (", ".join(shipped.names()) or "-"))
    out.print("fabrics   " + ", ".join(fabrics()))
