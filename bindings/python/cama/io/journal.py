# SPDX-License-Identifier: Apache-2.0
"""A file that h5py writes and that is whole whenever its process is killed.

HDF5 changes tables in several places of a file for every frame, and a file in which only some of them were changed
cannot be read. `JournaledFile` is what h5py writes to. New bytes go behind the end of the file, where no table refers
to them yet. Changes of bytes that the last commit left wait in memory; `commit` writes them to the journal beside the
file, then to the file, then empties the journal. A journal that was written whole is carried out by `recover`, or by
`readable` in memory; of another one nothing has reached the file.
"""

from __future__ import annotations

import contextlib
import os
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

T = TypeVar("T")
Changes = list[tuple[int, bytes]]  # place in the file, bytes

MARK = b"cama journal 1\n"
HEAD = struct.Struct("<QI")  # length and CRC-32 of what follows
CHANGE = struct.Struct("<QQ")  # place and length of the bytes that follow


def journal_of(path: Path) -> Path:
    """Returns the path of a file's journal."""
    return path.with_name(path.name + ".journal")


def sync_folder(folder: Path) -> None:
    """Makes the names of a folder's files last through a power cut, where the system can."""
    with contextlib.suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def packed(changes: Changes) -> bytes:
    """Returns the journal of changes."""
    body = b"".join(CHANGE.pack(place, len(data)) + data for place, data in changes)
    return MARK + HEAD.pack(len(body), zlib.crc32(body)) + body


def unpacked(text: bytes) -> Changes:
    """Returns the changes of a journal; none where it was not written whole."""
    start = len(MARK) + HEAD.size
    if len(text) < start or not text.startswith(MARK):
        return []
    length, check = HEAD.unpack_from(text, len(MARK))
    body = text[start : start + length]
    if len(body) != length or zlib.crc32(body) != check:
        return []
    changes, place = [], 0
    while place < length:
        where, size = CHANGE.unpack_from(body, place)
        place += CHANGE.size + size
        changes.append((where, body[place - size : place]))
    return changes


def left_behind(path: Path) -> Changes:
    """Returns the changes that a killed process did not carry out, or not all of them. Raises OSError."""
    try:
        return unpacked(journal_of(path).read_bytes())
    except FileNotFoundError:
        return []


def recover(path: Path) -> None:
    """Carries out what a killed process left in the journal. Nobody else may be writing the file. Raises OSError."""
    changes = left_behind(path) if path.is_file() else []
    if changes:
        with open(path, "r+b", buffering=0) as file:
            for place, data in changes:
                write_at(file, place, data)
            os.fsync(file.fileno())
    journal_of(path).unlink(missing_ok=True)


def readable(path: Path) -> Path | JournaledFile:
    """Returns what h5py.File reads: the path, or where a journal was left the file with its changes. Raises OSError."""
    changes = left_behind(path)
    return JournaledFile(path, "rb", changes) if changes else path


def write_at(file: Any, place: int, data: Any) -> None:
    """Writes all bytes from a place of an unbuffered file on."""
    file.seek(place)
    rest = memoryview(data)
    while rest:
        rest = rest[file.write(rest) :]


class JournaledFile:
    """A file object for h5py.File. What was written belongs to the file from the next `commit` on.

    The first failure is kept in `problem`. The file stays as the last commit left it from then on, and HDF5, which must
    not see the failure because it could not close its file then, goes on in memory.

    Args:
        path: The file.
        mode: "rb", "r+b" or "w+b".
        changes: Of the file, in memory.
    """

    def __init__(self, path: Path, mode: str, changes: Changes | None = None) -> None:
        self.problem: OSError | None = None
        self._journal_path = journal_of(path)
        self._file: Any = open(path, mode, buffering=0)  # noqa: SIM115
        self._journal: Any = None
        self._waiting: Changes = list(changes or [])
        self._committed = self._size = os.fstat(self._file.fileno()).st_size  # bytes
        self._place = 0
        self._carrying_out = False  # from a whole journal to the end of its changes

    def _do(self, work: Callable[[], T], otherwise: T) -> T:
        try:
            return work()
        except OSError as problem:
            self.problem = self.problem or problem
        return otherwise

    def write(self, data: Any) -> int:
        start, view = self._place, memoryview(data).cast("B")
        below = len(view) if self.problem else min(len(view), max(0, self._committed - start))
        if below:
            self._waiting.append((start, bytes(view[:below])))
        if below < len(view):
            rest = view[below:]
            self._do(lambda: write_at(self._file, start + below, rest), None)
            if self.problem:
                self._waiting.append((start + below, bytes(rest)))
        self._place = start + len(view)
        self._size = max(self._size, self._place)
        return len(view)

    def readinto(self, buffer: Any) -> int:
        view, start = memoryview(buffer).cast("B"), self._place
        self._do(lambda: self._read(start, view), None)
        for place, data in self._waiting:
            first, last = max(place, start), min(place + len(data), start + len(view))
            if first < last:
                view[first - start : last - start] = data[first - place : last - place]
        self._place += len(view)
        return len(view)

    def _read(self, start: int, view: memoryview) -> None:
        self._file.seek(start)
        while view:
            count = self._file.readinto(view)
            if not count:  # behind the end
                return
            view = view[count:]

    def read(self, size: int = -1) -> bytes:
        result = bytearray(size if size >= 0 else max(0, self._size - self._place))
        self.readinto(result)
        return bytes(result)

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        self._place = offset + {os.SEEK_SET: 0, os.SEEK_CUR: self._place, os.SEEK_END: self._size}[whence]
        return self._place

    def tell(self) -> int:
        return self._place

    def truncate(self, size: int | None = None) -> int:
        self._size = self._place if size is None else size
        return self._size

    def flush(self) -> None:
        """Nothing: `commit` writes."""

    def commit(self) -> None:
        """Makes what was written part of the file, all of it or, after a failure, nothing."""
        if self.problem is None:
            self._do(self._commit, None)

    def _commit(self) -> None:
        if self._size > self._committed:
            self._file.truncate(self._size)
        if self._waiting:
            if self._journal is None:
                self._journal = open(self._journal_path, "w+b", buffering=0)  # noqa: SIM115
            write_at(self._journal, 0, packed(self._waiting))
            self._carrying_out = True
            for place, data in self._waiting:
                write_at(self._file, place, data)
            self._journal.truncate(0)
            self._carrying_out = False
        if self._size < self._committed:
            self._file.truncate(self._size)
        self._waiting, self._committed = [], self._size

    def sync(self) -> None:
        """Makes what was committed last through a power cut."""
        self._do(lambda: os.fsync(self._file.fileno()), None)

    def rename(self, path: Path) -> None:
        """Gives the file the name by which it is looked for, in place of another file of that name."""

        def replace() -> None:
            os.replace(self._file.name, path)
            self._journal_path = journal_of(path)

        self._do(replace, None)

    def is_at(self, path: Path) -> bool:
        """Whether a path leads to this file."""
        try:
            return os.path.samestat(os.stat(path), os.fstat(self._file.fileno()))
        except (OSError, ValueError):  # not there, closed
            return False

    def close(self) -> None:
        """Closes the file, without a commit. After a failure it gives back the space of what was not committed."""
        if self.problem and not self._carrying_out:
            with contextlib.suppress(OSError):
                self._file.truncate(self._committed)
        self._do(self._file.close, None)
        if self._journal is not None:
            self._do(self._journal.close, None)
            if not self._carrying_out:  # else `recover` carries it out
                self._do(lambda: self._journal_path.unlink(missing_ok=True), None)
