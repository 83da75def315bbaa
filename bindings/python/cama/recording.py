# SPDX-License-Identifier: Apache-2.0
"""frames.h5: every recorded moment of a run, written as it is computed.

positions [frames, vertices, 3] m; times [frames] s; contacts, intersections [frames]; faces [triangles, 3]; cloth_ranges and
obstacle_ranges [objects, 2], first vertex and last excluded, with attribute `names`, obstacles also with `surfaces` and `radii` (of
exact ones, whose vertices are their defining points); what was run as attributes of the file.
Frame 0 is the start.
"""

from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from .errors import FileError

NAME = "frames.h5"


class Recorder:
    """Writes frames.h5, flushed after every frame, so that a stop at any time keeps what was computed."""

    def __init__(self, path, simulation, attributes=(), dtype=np.float64):
        count = simulation.vertex_count
        self._file = h5py.File(path, "w")
        self._file.attrs.update(dict(attributes))
        self._file["faces"] = simulation.faces
        for kind, parts in (("cloth", simulation.scene.cloths), ("obstacle", simulation.scene.obstacles)):
            ranges = np.array(getattr(simulation, f"{kind}_ranges"), np.int64).reshape(-1, 2)
            self._file[f"{kind}_ranges"] = ranges
            self._file[f"{kind}_ranges"].attrs["names"] = np.array([p.name for p in parts], dtype=h5py.string_dtype())
            if kind == "obstacle":
                self._file["obstacle_ranges"].attrs["surfaces"] = np.array([p.surface for p in parts], dtype=h5py.string_dtype())
                self._file["obstacle_ranges"].attrs["radii"] = np.array([p.radius for p in parts], np.float64)
        self._rows = {
            "positions": self._growing("positions", (count, 3), dtype),
            "contacts": self._growing("contacts", (), np.int64),
            "intersections": self._growing("intersections", (), np.int64),
            "times": self._growing("times", (), np.float64),  # last: a frame is there once its time is
        }
        self._file.flush()

    def _growing(self, name, shape, dtype):
        chunk = (1 if shape else 1024,) + tuple(max(1, s) for s in shape)
        return self._file.create_dataset(name, (0,) + shape, dtype, maxshape=(None,) + shape, chunks=chunk)

    def add(self, time, positions, contacts, intersections):
        """Appends one frame and flushes."""
        values = {"positions": positions, "contacts": contacts, "intersections": intersections, "times": time}
        for name, rows in self._rows.items():
            rows.resize(len(rows) + 1, axis=0)
            rows[-1] = values[name]
        self._file.flush()

    def close(self):
        """Closes the file; more calls do nothing."""
        self._file.close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()


@dataclass
class Part:
    """One cloth or obstacle of a recording."""

    name: str
    vertices: slice        #: into the vertices of a frame
    faces: np.ndarray      #: [triangles, 3] int64, counted from the part's first vertex
    surface: str = "mesh"  #: or that of an exact obstacle, whose vertices are its defining points
    radius: float = 0.0    #: of an exact sphere or capsule, m


class Recording:
    """Reads frames.h5 of a folder, or the file itself. Throws FileError."""

    def __init__(self, path):
        path = Path(path)
        path = path / NAME if path.is_dir() else path
        if not path.is_file():
            raise FileError(f"{path}: no such file; `cama run ... -o {path.parent}` writes it")
        try:
            self._file = h5py.File(path, "r")
            self.positions, self.times = self._file["positions"], self._file["times"][:]
            self.faces = self._file["faces"][:].astype(np.int64)
            self.cloths, self.obstacles = self._parts("cloth"), self._parts("obstacle")
        except (OSError, KeyError) as problem:
            raise FileError(f"{path}: not a recording of cama: {problem}") from None
        self.attributes = dict(self._file.attrs)
        if not len(self.times):
            raise FileError(f"{path}: no frame was recorded")

    def _parts(self, kind):
        ranges = self._file[f"{kind}_ranges"]
        texts = lambda key: [t if isinstance(t, str) else t.decode() for t in ranges.attrs.get(key, ["mesh"] * len(ranges))]
        radii = ranges.attrs.get("radii", [0.0] * len(ranges))
        return [Part(name, slice(first, last), self._faces_of(first, last), surface, float(radius))
                for name, (first, last), surface, radius in zip(texts("names"), ranges[:].tolist(), texts("surfaces"), radii)]

    def _faces_of(self, first, last):
        inside = (self.faces[:, 0] >= first) & (self.faces[:, 0] < last)
        return self.faces[inside] - first

    def __len__(self):
        return len(self.times)

    def frame(self, index):
        """[vertices, 3] float64, m."""
        return self.positions[index].astype(np.float64)

    def close(self):
        """Closes the file."""
        self._file.close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()
