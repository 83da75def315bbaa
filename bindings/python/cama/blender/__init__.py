# SPDX-License-Identifier: Apache-2.0
"""Blender's way to cama: the add-on, and the process that it starts.

`addon/` runs in Blender and needs its module bpy, not cama. `job.py` runs where cama is installed. They meet in a
folder: the add-on writes job.json and job.npz there, the process frames into cloth.pc2 and what happens into
progress.jsonl.
"""

from __future__ import annotations

import json
import sys
import zipfile
from pathlib import Path

from ..errors import FileError
from ..types import PathLike

DEFAULT = 'PYTHON = "python3"'  # a line of addon/running.py
MAIN = "panel.py"  # which Blender loads; under its own name, since it can be imported there alone
NAME = "cama_cloth"  #: of the add-on in Blender


def write_addon(file: PathLike, python: PathLike | None = None) -> Path:
    """Writes the add-on as a zip file, to be installed in Blender.

    Args:
        file: The file.
        python: The interpreter that it starts cama with; None: this one.

    Raises:
        FileError
    """
    path, own = Path(file), f"PYTHON = {json.dumps(str(python or sys.executable))}"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            for source in sorted((Path(__file__).parent / "addon").glob("*.py")):
                text = source.read_text(encoding="utf-8").replace(DEFAULT, own)
                name = "__init__.py" if source.name == MAIN else source.name
                archive.writestr(f"{NAME}/{name}", text)
    except OSError as problem:
        raise FileError(f"{problem.filename or path}: {problem.strerror}") from None
    return path
