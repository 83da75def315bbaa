# SPDX-License-Identifier: Apache-2.0
"""Processes that work for this one: Ctrl-C is for their parent, and they end with it."""

import contextlib
import multiprocessing
import multiprocessing.connection
import os
import signal
import threading
from concurrent.futures.process import BrokenProcessPool


@contextlib.contextmanager
def interrupts_held():
    """Holds Ctrl-C back. Processes that start meanwhile have SIGINT blocked, even during their imports."""
    handler, masks, came = signal.getsignal(signal.SIGINT), hasattr(signal, "pthread_sigmask"), []
    ours = handler is not None and threading.current_thread() is threading.main_thread()
    if ours:  # other threads of this process may take the signal
        signal.signal(signal.SIGINT, lambda *_: came.append(True))
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT}) if masks else ()
    try:
        yield
    finally:
        if masks:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        if ours:
            signal.signal(signal.SIGINT, handler)
            if came:
                signal.raise_signal(signal.SIGINT)


def follow_parent():
    """Makes this process, which another one started, ignore Ctrl-C and end with its parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()

    def follow():
        multiprocessing.connection.wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=follow, daemon=True).start()


def submit(pool, function, *arguments):
    """Submits a call to a ProcessPoolExecutor and returns its future; processes may start here, and hold Ctrl-C back.

    Raises BrokenProcessPool where a process of the pool has ended. Python 3.11 closes the pool's pipes without a lock
    when it sees that: if another process starts meanwhile, the error is one about pipes.
    """
    with interrupts_held():
        try:
            return pool.submit(function, *arguments)
        except BrokenProcessPool:
            raise
        except Exception:
            if getattr(pool, "_broken", False):
                raise BrokenProcessPool("a process of the pool ended while another one started") from None
            raise


def terminate(pool):
    """Ends the processes of a ProcessPoolExecutor, with what they are at."""
    for process in list((getattr(pool, "_processes", None) or {}).values()):
        process.terminate()
