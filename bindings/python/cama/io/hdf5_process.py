# SPDX-License-Identifier: Apache-2.0
"""A process of its own that reads an HDF5 file once, since HDF5 itself crashes on some damaged ones.

Arguments: the file, the processor time that reading it may take, s (0: any), then the folders to import from. What ends
with a Python exception ends with exit code 0: the caller meets the same one.
"""

import contextlib
import sys

LARGE = 2**26  # bytes of a dataset; of larger ones the first and the last row are read


def read(group):
    """Reads all attributes and datasets of a group and the groups in it."""
    dict(group.attrs)
    for item in group.values():
        if hasattr(item, "values"):
            read(item)
            continue
        dict(item.attrs)
        if item.nbytes <= LARGE:
            item[()]
        elif item.shape:
            item[0], item[-1]


def limit(seconds):
    """Lets the system stop this process after so much processor time, where it can."""
    with contextlib.suppress(ImportError, ValueError, OSError):
        import resource

        resource.setrlimit(resource.RLIMIT_CPU, (seconds, resource.getrlimit(resource.RLIMIT_CPU)[1]))


def main():
    if int(sys.argv[2]):
        limit(int(sys.argv[2]))
    sys.path[:0] = sys.argv[3:]
    with contextlib.suppress(Exception):
        import h5py

        with h5py.File(sys.argv[1], "r") as file:
            read(file)


if __name__ == "__main__":
    main()
