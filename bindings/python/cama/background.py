# SPDX-License-Identifier: Apache-2.0
"""Steps in the background: one thread for each simulation, or for all worlds of one object."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

from . import _core
from .errors import SceneError

Result = TypeVar("Result")


class Background:
    """The thread that takes the steps of `step_async`, in the order in which they were asked for."""

    __slots__ = ("_thread",)

    def __init__(self) -> None:
        self._thread: ThreadPoolExecutor | None = None

    def submit(self, core: _core.Simulation | _core.Worlds, work: Callable[[], Result]) -> Future[Result]:
        """Does the work in the thread. Whoever asks the core from now on waits until it is done.

        Raises SceneError in the thread itself, where steps would wait for themselves.
        """
        if core.is_worker():
            raise SceneError("step_async: called by before_step of steps in the background; steps cannot wait for it")
        if self._thread is None:
            self._thread = ThreadPoolExecutor(1, "cama steps")

        def run() -> Result:
            core.set_worker()
            return work()

        core.begin_background()
        try:
            future = self._thread.submit(run)
        except BaseException:
            core.end_background()
            raise
        future.add_done_callback(lambda _: core.end_background())
        return future
