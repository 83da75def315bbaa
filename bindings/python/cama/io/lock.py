# SPDX-License-Identifier: Apache-2.0
"""One run at a time in a folder of results."""

from __future__ import annotations

import contextlib
import json
import os
import socket
import time
from collections.abc import Iterator
from pathlib import Path

from ..errors import FileError

try:
    import fcntl
except ImportError:  # not a system of the Unix kind: runs are not kept apart there
    fcntl = None  # type: ignore[assignment]

NAME = "run.lock"


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Makes a folder and keeps other runs out of it.

    The operating system holds the lock and takes it back when the process ends, however it ends: the file that a killed
    process leaves behind locks nothing.

    Raises:
        FileError: Another run writes there, or the folder cannot be made.
    """
    path = folder / NAME
    try:
        folder.mkdir(parents=True, exist_ok=True)
        file = _take(path)
    except OSError as problem:
        raise FileError(f"{folder}: {problem.strerror}") from None
    if file is None:
        raise FileError(
            f"{folder}: another run{_holder(path)} writes there; wait for it, stop it, or choose another folder "
            "(--output)"
        )
    try:
        yield
    finally:
        with contextlib.suppress(OSError):
            path.unlink()  # while it is locked: nobody else can take this file any more
        os.close(file)


def _take(path: Path) -> int | None:
    """Returns the descriptor of the locked file, or None if another process holds it."""
    while True:
        file = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            if fcntl is not None:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.fstat(file).st_ino == os.stat(path).st_ino:
                who = {"process": os.getpid(), "machine": socket.gethostname(), "since": time.strftime("%F %T")}
                os.ftruncate(file, 0)
                os.write(file, json.dumps(who).encode())
                return file
        except BlockingIOError:
            os.close(file)
            return None
        except FileNotFoundError:
            pass
        except OSError:
            os.close(file)
            raise
        os.close(file)  # its holder ended and took it away meanwhile


def _holder(path: Path) -> str:
    """Returns " (process 12 on host, since ...)", or "" where the file does not say."""
    try:
        who = json.loads(path.read_text(encoding="utf-8"))
        return f" (process {who['process']} on {who['machine']}, since {who['since']})"
    except (OSError, ValueError, KeyError, TypeError):
        return ""
