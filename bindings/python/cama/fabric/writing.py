# SPDX-License-Identifier: Apache-2.0
"""Files that are written whole or not at all."""

from __future__ import annotations

import os
from pathlib import Path

from ..errors import FileError


def write(path: Path, content: bytes) -> None:
    """Writes a file under a temporary name, then renames it; makes its folder. Raises FileError."""
    new = path.with_name(path.name + ".new")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        new.write_bytes(content)
        os.replace(new, path)
    except OSError as problem:
        raise FileError(f"{path}: {problem.strerror}") from None
