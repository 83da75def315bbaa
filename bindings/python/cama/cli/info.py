# SPDX-License-Identifier: Apache-2.0
"""The command `cama info`."""

import importlib.metadata
import platform

from rich.markup import escape
from rich.table import Table

from .. import _core, shipped
from ..material import fabrics
from .common import Debug, clean, console


@clean
def info(debug: Debug = False):
    """Shows backends, devices, versions, shipped scenes and fabrics."""
    table = Table("backend", "devices", "note", box=None, padding=(0, 2))
    for backend in _core.list_backends():
        mark = "[green]" if backend["available"] else "[dim]"
        table.add_row(mark + backend["name"], escape(", ".join(backend["devices"]) or "-"), escape(backend["note"]))
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
