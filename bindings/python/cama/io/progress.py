# SPDX-License-Identifier: Apache-2.0
"""Progress bars that also say something where nobody sees a bar: in a log file or a pipe."""

from __future__ import annotations

import time
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID

EVERY = 10.0  # s between lines


class Bar(Progress):
    """A progress bar on a terminal; elsewhere plain lines with the same words, at most one in 10 s and one at the end.

    Args:
        columns: As for rich.progress.Progress.
        console: Where to write; None: nowhere.
    """

    def __init__(self, *columns: Any, console: Console | None = None) -> None:
        self._plain = console is not None and not console.is_terminal
        super().__init__(*columns, console=console, disable=console is None or self._plain, transient=True)
        self._said = time.monotonic()

    def stop(self) -> None:
        """As Progress.stop, which would print an empty line where there is no terminal."""
        if not self._plain:
            super().stop()

    def update(self, task_id: TaskID, **changes: Any) -> None:  # type: ignore[override]
        """As Progress.update."""
        super().update(task_id, **changes)
        if not self._plain:
            return
        task, now = next(task for task in self.tasks if task.id == task_id), time.monotonic()
        if now - self._said < EVERY and not task.finished:
            return
        self._said = now
        texts = [
            column if isinstance(column, str) else getattr(column.render(task), "plain", "")
            for column in self.columns
            if not isinstance(column, BarColumn)
        ]
        self.console.print(" ".join(filter(None, texts)), markup=False, soft_wrap=True)
