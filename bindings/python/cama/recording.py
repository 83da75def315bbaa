# SPDX-License-Identifier: Apache-2.0
"""`cama.record`: a simulation is computed and written to a folder, as `cama run` does."""

from __future__ import annotations

import signal
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .arrays import count
from .errors import SceneError
from .types import PathLike

if TYPE_CHECKING:
    from .simulation import Simulation

__all__ = ["record"]


def record(
    simulation: Simulation,
    path: PathLike,
    frames: int | None = None,
    store: str = "double",
    overwrite: bool = False,
    progress: bool = False,
) -> dict[str, Any]:
    """Computes frames of a simulation and writes them to a folder, for `cama render` and `cama view`.

    The first frame is the present state. Steps go on where the simulation is and obey its `before_step`. What
    `cama run` writes is written: frames.h5, summary.json and checkpoint.h5, also when an error or Ctrl-C ends it.

    Args:
        simulation: The simulation; it ends at the last frame.
        path: The folder, made if it is not there. Results of an earlier run in it are moved to its folder `previous`.
        frames: Number of frames after the first; None: the scene's.
        store: Precision of the positions in the file: "double" or "single".
        overwrite: Whether results of an earlier run are deleted instead.
        progress: Whether to show a progress bar on standard error.

    Returns:
        The fields of summary.json.

    Raises:
        FileError: The folder cannot be written, or another run writes to it.
        SolverError, CollisionError: A step cannot be computed; the frames before it are written.
    """
    if store not in ("double", "single"):
        raise SceneError(f'record: store is {store!r}; it is "double" or "single"')
    number = simulation.scene.frames if frames is None else count("record: frames", frames)
    from rich.console import Console

    from .cli import loop
    from .io.lock import locked

    folder = Path(path)
    with locked(folder):
        result = loop.run(
            simulation,
            folder,
            number,
            store=store,
            progress=Console(stderr=True, highlight=False) if progress else None,
            keep=None if overwrite else lambda frames, folder: None,
        )
    if result.problem is not None:
        raise result.problem
    if result.interrupted:
        signal.raise_signal(result.interrupted)
    return result.fields
