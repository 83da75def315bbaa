# SPDX-License-Identifier: Apache-2.0
"""frames.h5: every recorded moment of a run, written as it is computed.

positions [frames, vertices, 3] m; times [frames] s; contacts, intersections [frames]; faces [triangles, 3];
cloth_ranges and obstacle_ranges [objects, 2], first vertex and last excluded, with attribute `names`, obstacles also
with `shapes` and `radii` (of exact ones, whose vertices are their defining points); rest_corners [cloth triangles, 3,
2] m, every triangle at rest, in a plane; what was run as attributes of the file. Frame 0 is the start.
"""

from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from .. import shipped
from ..errors import FileError

NAME = "frames.h5"


class Output:
    """The file that h5py writes to.

    The first failure is kept in `problem`, and nothing is written from then on, so that what was flushed stays intact.
    HDF5 must not see the failure: it could not close its file then, and would crash at the end of the process.
    """

    def __init__(self, path, mode):
        self.problem = None
        self._file = open(path, mode, buffering=0)  # noqa: SIM115

    def _do(self, work, otherwise):
        if self.problem is None:
            try:
                return work()
            except OSError as problem:
                self.problem = problem
        return otherwise

    def write(self, data):
        def whole():
            rest = memoryview(data)
            while rest:
                rest = rest[self._file.write(rest) :]
            return len(data)

        return self._do(whole, len(data))

    def read(self, size=-1):
        return self._do(lambda: self._file.read(size), b"")

    def readinto(self, buffer):
        return self._do(lambda: self._file.readinto(buffer), len(buffer))

    def seek(self, offset, whence=0):
        return self._file.seek(offset, whence)

    def tell(self):
        return self._file.tell()

    def truncate(self, size=None):
        return self._do(lambda: self._file.truncate(size), size)

    def flush(self):
        self._do(self._file.flush, None)

    def close(self):
        self._do(self._file.close, None)


class Recorder:
    """Writes frames.h5 and flushes it after every frame, so that a stop at any time keeps what was computed.

    Args:
        path: The file.
        simulation: The Simulation to record.
        attributes: Attributes of the file.
        dtype: Type of the positions; None: double, or that of the file that is continued.
        until: Continue the existing file after this time, s; its later frames are dropped. None: a new file.

    Raises:
        FileError
    """

    def __init__(self, path, simulation, attributes=(), dtype=None, until=None):
        self._path, self._output, count = path, None, simulation.vertex_count
        if until is not None and not h5py.is_hdf5(path):
            raise FileError(f"{path}: is not there, or no HDF5 file; there is nothing to go on with")
        with self._writing():
            self._output = Output(path, "w+b" if until is None else "r+b")
            self._file = h5py.File(self._output, "w" if until is None else "r+")
            if until is None:
                self._start(simulation, attributes, dtype or np.float64, count)
            else:
                self._go_on(count, until, dict(attributes), dtype)

    @contextmanager
    def _writing(self):
        """A failure to write becomes a FileError."""
        before = self._output and self._output.problem
        try:
            yield
            problem = self._output.problem
        except OSError as error:
            problem = error
        if problem and not before:
            raise FileError(f"{self._path}: writing failed ({problem}); is the disk full?") from problem

    def _start(self, simulation, attributes, dtype, count):
        self._file.attrs.update(dict(attributes))
        self._file["faces"] = simulation.faces
        for kind, parts in (("cloth", simulation.scene.cloths), ("obstacle", simulation.scene.obstacles)):
            ranges = np.array(getattr(simulation, f"{kind}_ranges"), np.int64).reshape(-1, 2)
            self._file[f"{kind}_ranges"] = ranges
            self._file[f"{kind}_ranges"].attrs["names"] = np.array([p.name for p in parts], dtype=h5py.string_dtype())
            if kind == "obstacle":
                self._file["obstacle_ranges"].attrs["shapes"] = np.array(
                    [p.shape for p in parts], dtype=h5py.string_dtype()
                )
                self._file["obstacle_ranges"].attrs["radii"] = np.array([p.radius for p in parts], np.float64)
        rest = [cloth.rest_corners for cloth in simulation.scene.cloths]
        self._file["rest_corners"] = np.concatenate([np.zeros((0, 3, 2)), *rest]).astype(np.float32)
        self._rows = {
            "positions": self._growing("positions", (count, 3), dtype),
            "contacts": self._growing("contacts", (), np.int64),
            "intersections": self._growing("intersections", (), np.int64),
            "times": self._growing("times", (), np.float64),  # last: a frame is there once its time is
        }
        self._file.flush()

    def _go_on(self, count, until, attributes, dtype):
        try:
            self._rows = {name: self._file[name] for name in ("positions", "contacts", "intersections", "times")}
            times = self._rows["times"][:]
            if self._rows["positions"].shape[1:] != (count, 3):
                raise FileError(
                    f"{self._path}: has {self._rows['positions'].shape[1]} vertices a frame, the simulation {count}"
                )
            stored, interval = self._rows["positions"].dtype, float(self._file.attrs.get("frame_time", 0))
        except (KeyError, IndexError, TypeError, ValueError) as problem:
            raise FileError(f"{self._path}: not a recording of cama: {problem}") from None
        if dtype is not None and stored != dtype:
            raise FileError(
                f"{self._path}: holds positions as {stored}, not {np.dtype(dtype)}; leave --store out to go on as it is"
            )
        wanted = attributes.get("frame_time", interval)
        if abs(interval - wanted) > 1e-9 * wanted:
            raise FileError(
                f"{self._path}: has a frame every {interval:.9g} s, this run would go on with one every "
                f"{wanted:.9g} s; keep the scene's frame_time "
                "and a time step that divides it"
            )
        self._file.attrs.update(
            {name: attributes[name] for name in ("time_step", "steps_per_frame") if name in attributes}
        )
        kept = int(np.searchsorted(times, until * (1 + 1e-12), side="right"))
        if not kept:
            raise FileError(f"{self._path}: has no frame up to {until:g} s, where the checkpoint is")
        for rows in self._rows.values():
            rows.resize(kept, axis=0)
        self.times, self.intersections = (
            times[:kept],
            int(self._rows["intersections"][:].sum()),
        )  #: of the frames that are kept
        self._file.flush()

    def _growing(self, name, shape, dtype):
        chunk = (1 if shape else 1024,) + tuple(max(1, s) for s in shape)
        return self._file.create_dataset(name, (0,) + shape, dtype, maxshape=(None,) + shape, chunks=chunk)

    def add(self, time, positions, contacts, intersections):
        """Appends one frame and flushes."""
        values = {"positions": positions, "contacts": contacts, "intersections": intersections, "times": time}
        with self._writing():
            for name, rows in self._rows.items():
                rows.resize(len(rows) + 1, axis=0)
                rows[-1] = values[name]
            self._file.flush()

    def close(self):
        """Closes the file; more calls do nothing."""
        with self._writing():
            self._file.close()
            self._output.close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()


@dataclass
class Part:
    """One cloth or obstacle of a recording."""

    name: str
    vertices: slice  #: into the vertices of a frame
    faces: np.ndarray  #: [triangles, 3] int64, counted from the part's first vertex
    shape: str = "mesh"  #: or that of an exact obstacle, whose vertices are its defining points
    radius: float = 0.0  #: of an exact sphere or capsule, m


def _how_to_record(path):
    """Returns what to do where a recording is missing."""
    out = Path("out") / path.name
    if path.name != NAME and (out / NAME).is_file():
        return f"the recording is in another folder: `cama render {out}`"
    if path.name in shipped.names():
        return f"`cama run {path}` records the scene in {out}, then `cama render {out}` draws it"
    return f"`cama run SCENE -o {path.parent if path.name == NAME else path}` writes one"


class Recording:
    """Reads frames.h5, given the file or its folder. Raises FileError."""

    def __init__(self, path):
        path = Path(path)
        path = path / NAME if path.is_dir() else path
        if not path.is_file():
            raise FileError(f"{path}: no such file; {_how_to_record(path)}")
        try:
            self._file = h5py.File(path, "r")
            self.positions, self.times = self._file["positions"], self._file["times"][:]
            self.faces = self._file["faces"][:].astype(np.int64)
            self.cloths, self.obstacles = self._parts("cloth"), self._parts("obstacle")
        except (OSError, KeyError) as problem:
            raise FileError(f"{path}: not a recording of cama: {problem}") from None
        self.attributes = dict(self._file.attrs)
        self.contacts, self.intersections, self.rest_corners = (
            self._file[name][:] if name in self._file else None
            for name in ("contacts", "intersections", "rest_corners")
        )  #: [frames], [frames], [cloth triangles, 3, 2] m; None: not in the file
        if not len(self.times):
            raise FileError(f"{path}: no frame was recorded")

    def _parts(self, kind):
        ranges = self._file[f"{kind}_ranges"]

        def texts(key):
            return [t if isinstance(t, str) else t.decode() for t in ranges.attrs.get(key, ["mesh"] * len(ranges))]

        radii = ranges.attrs.get("radii", [0.0] * len(ranges))
        return [
            Part(name, slice(first, last), self._faces_of(first, last), shape, float(radius))
            for name, (first, last), shape, radius in zip(texts("names"), ranges[:].tolist(), texts("shapes"), radii)
        ]

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
