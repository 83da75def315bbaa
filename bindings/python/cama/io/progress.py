# SPDX-License-Identifier: Apache-2.0
"""Progress bars that also say something where nobody sees a bar: in a log file or a pipe."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Iterator
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID

EVERY = 10.0  # s between lines
SOON = 2.0  # s that something takes before a line says it


@contextlib.contextmanager
def during(text: str, console: Console | None) -> Iterator[None]:
    """Says what is being done: on a terminal while it lasts, elsewhere by one line if it takes longer than 2 s."""
    if console is None:
        yield
    elif console.is_terminal:
        with console.status(text):
            yield
    else:
        timer = threading.Timer(SOON, console.print, [f"{text} ..."], {"markup": False, "soft_wrap": True})
        timer.daemon = True
        timer.start()
        try:
            yield
        finally:
            timer.cancel()


class Bar(Progress):
    """A progress bar on a terminal; elsewhere plain lines with the same words, at most one in 10 s and one at the end.

    A terminal that is gone is no error.

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
            with contextlib.suppress(OSError):
                super().stop()

    def during(self, text: str) -> contextlib.AbstractContextManager[None]:
        """As the function `during`; on a terminal nothing, since the bar is there."""
        return during(text, self.console if self._plain else None)

    def update(self, task_id: TaskID, **changes: Any) -> None:  # type: ignore[override]
        """As Progress.update."""
        with contextlib.suppress(OSError):
            self._update(task_id, changes)

    def _update(self, task_id: TaskID, changes: dict[str, Any]) -> None:
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
