# SPDX-License-Identifier: Apache-2.0
"""frames.h5: every recorded moment of a run, written as it is computed, whole frames only (`journal`).

positions [frames, vertices, 3] m; times [frames] s; contacts, intersections [frames]; faces [triangles, 3];
cloth_ranges and obstacle_ranges [objects, 2], first vertex and last excluded, with attribute `names`, cloths also
with `materials`, obstacles with `shapes` and `radii` (of exact ones, whose vertices are their defining points); of a
cloth with texture coordinates the group texture/INDEX: vertices [k, 2], faces [its triangles, 3], attribute `unit` ("1"
in its mesh file, "m" in material space); rest_corners [cloth triangles, 3, 2] m, every triangle at rest, in a plane;
what was run as attributes of the file. Frame 0 is the start.
"""

import errno
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Optional

import h5py
import numpy as np

from .. import shipped
from ..errors import FileError
from ..hints import naming_files
from .journal import JournaledFile, readable, recover
from .reading import DAMAGED, check_hdf5
from .texture import texture_of

NAME = "frames.h5"
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


class Recorder:
    """Writes frames.h5 frame by frame, so that a stop at any time, `kill -9` too, keeps all frames that were added.

    A new file has its name from the first frame on.

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
        self._path, self._output, self._file, count = Path(path), None, None, simulation.vertex_count
        self._partial = self._path.with_name(self._path.name + ".partial") if until is None else None
        with self._writing():
            recover(self._path)
        if until is not None and not h5py.is_hdf5(path):
            raise FileError(f"{path}: is not there, or no HDF5 file; there is nothing to go on with")
        if until is not None:
            check_hdf5(path)
        with self._writing():
            self._output = JournaledFile(self._partial or self._path, "w+b" if until is None else "r+b")
        try:
            with self._writing():
                self._file = h5py.File(self._output, "w" if until is None else "r+")
                if until is None:
                    self._start(simulation, attributes, dtype or np.float64, count)
                else:
                    self._go_on(count, until, dict(attributes), dtype)
        except FileError:
            if self._file:
                self._file.close()
            self._output.close()
            if self._partial is not None:
                self._partial.unlink(missing_ok=True)
            raise

    @contextmanager
    def _writing(self):
        """A failure to write becomes a FileError."""
        before = self._output and self._output.problem
        try:
            yield
            problem = self._output and self._output.problem
        except OSError as error:
            problem = error
        if problem and not before:
            self._check_place()
            full = "; is the disk full?" if problem.errno in FULL else ""
            raise FileError(f"{self._path}: writing failed ({problem}){full}") from problem

    def _check_place(self):
        if self._output is not None and not self._output.is_at(self._partial or self._path):
            raise FileError(f"{self._path}: was moved, deleted or replaced while the run wrote to it")

    def _start(self, simulation, attributes, dtype, count):
        self._file.attrs.update(dict(attributes))
        self._file["faces"] = simulation.faces
        for kind, parts in (("cloth", simulation.scene.cloths), ("obstacle", simulation.scene.obstacles)):
            ranges = np.array(getattr(simulation, f"{kind}_ranges"), np.int64).reshape(-1, 2)
            self._file[f"{kind}_ranges"] = ranges
            self._file[f"{kind}_ranges"].attrs["names"] = np.array([p.name for p in parts], dtype=h5py.string_dtype())
            if kind == "cloth":
                self._start_texture(simulation.scene)
            else:
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
            "times": self._growing("times", (), np.float64),
        }

    def _start_texture(self, scene):
        materials = np.array([cloth.material.name for cloth in scene.cloths], dtype=h5py.string_dtype())
        self._file["cloth_ranges"].attrs["materials"] = materials
        for index, cloth in enumerate(scene.cloths):
            texture = texture_of(cloth, scene.folder)
            if texture is not None:
                group = self._file.create_group(f"texture/{index}")
                group["vertices"], group["faces"], group.attrs["unit"] = texture.vertices, texture.faces, texture.unit

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
        self._commit()

    def _growing(self, name, shape, dtype):
        chunk = (1 if shape else 1024,) + tuple(max(1, s) for s in shape)
        return self._file.create_dataset(name, (0,) + shape, dtype, maxshape=(None,) + shape, chunks=chunk)

    def _commit(self):
        self._file.flush()
        self._output.commit()

    def add(self, time, positions, contacts, intersections):
        """Appends one frame: after a return it is in the file, after a FileError the file is as it was before."""
        values = {"positions": positions, "contacts": contacts, "intersections": intersections, "times": time}
        self._check_place()
        with self._writing():
            for name, rows in self._rows.items():
                rows.resize(len(rows) + 1, axis=0)
                rows[-1] = values[name]
            self._commit()
            if self._partial is not None and not self._output.problem:
                self._output.rename(self._path)
                self._partial = None

    def sync(self):
        """Makes the frames so far last through a power cut."""
        with self._writing():
            self._output.sync()

    def close(self):
        """Closes the file; more calls do nothing. A new one without a frame is taken away."""
        with self._writing():
            if self._file:
                self._file.close()
                self._output.commit()
                self._output.sync()
                self._output.close()
            if self._partial is not None:
                self._partial.unlink(missing_ok=True)

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
    material: str = ""  #: name of the material of a cloth; "" if the recording does not say
    uv: Optional[np.ndarray] = None  #: texture coordinates [k, 2] of a cloth, None: none
    uv_faces: Optional[np.ndarray] = None  #: [triangles, 3] int64, into `uv`


def _how_to_record(path):
    """Returns what to do where a recording is missing."""
    out = Path("out") / path.name
    if path.name != NAME and (out / NAME).is_file():
        return f"the recording is in another folder: `cama render {out}`"
    if path.name in shipped.names():
        return f"`cama run {path}` records the scene in {out}, then `cama render {out}` draws it"
    return f"`cama run SCENE -o {path.parent if path.name == NAME else path}` writes one"


class Recording:
    """Reads frames.h5.

    Args:
        path: The file or its folder.
        checked: It is known that HDF5 does not crash on the file; otherwise a process of its own reads it first, which
            takes some tenths of a second and is done once for a file that stays as it is.

    Raises:
        FileError
    """

    @naming_files()
    def __init__(self, path, checked=False):
        path = Path(path)
        path = path / NAME if path.is_dir() else path
        if not path.is_file():
            raise FileError(f"{path}: no such file; {_how_to_record(path)}")
        if not checked:
            check_hdf5(path)
        self._path = path
        try:
            self._file = h5py.File(readable(path), "r")
            self.positions, self.times = self._file["positions"], np.asarray(self._file["times"][:], np.float64)
            self.faces = self._file["faces"][:].astype(np.int64)
            self.cloths, self.obstacles = self._parts("cloth"), self._parts("obstacle")
            self.attributes = dict(self._file.attrs)
            self.contacts, self.intersections, self.rest_corners = (
                self._file[name][:] if name in self._file else None
                for name in ("contacts", "intersections", "rest_corners")
            )  #: [frames], [frames], [cloth triangles, 3, 2] m; None: not in the file
            self._check()
        except DAMAGED as problem:
            raise FileError(f"{path}: not a recording of cama: {problem}") from None
        if not len(self.times):
            raise FileError(f"{path}: no frame was recorded")

    def _check(self):
        """Raises ValueError for shapes and numbers that a recording does not have."""
        shape, count = self.positions.shape, self.positions.shape[1]
        if shape[2:] != (3,) or self.positions.dtype.kind != "f" or shape[0] < len(self.times):
            raise ValueError(f"its positions are {self.positions.dtype} of shape {shape}")
        if self.times.ndim != 1 or not np.isfinite(self.times).all() or (np.diff(self.times) < 0).any():
            raise ValueError("its times are no rising numbers")
        if self.faces.ndim != 2 or self.faces.shape[1] != 3 or (self.faces < 0).any() or (self.faces >= count).any():
            raise ValueError("its faces name vertices that are not there")
        for part in (*self.cloths, *self.obstacles):
            if not 0 <= part.vertices.start <= part.vertices.stop <= count or not np.isfinite(part.radius):
                raise ValueError(f"{part.name!r} has vertices that are not there, or no radius")
            if (part.faces >= part.vertices.stop - part.vertices.start).any():
                raise ValueError(f"faces of {part.name!r} name vertices of another object")

    def _parts(self, kind):
        ranges = self._file[f"{kind}_ranges"]

        def texts(key, otherwise="mesh"):
            return [t if isinstance(t, str) else t.decode() for t in ranges.attrs.get(key, [otherwise] * len(ranges))]

        def texture(index):
            group = self._file.get(f"texture/{index}") if kind == "cloth" else None
            return (None, None) if group is None else (group["vertices"][:], group["faces"][:].astype(np.int64))

        radii = ranges.attrs.get("radii", [0.0] * len(ranges))
        return [
            Part(name, slice(first, last), self._faces_of(first, last), shape, float(radius), material, *texture(index))
            for index, (name, (first, last), shape, radius, material) in enumerate(
                zip(texts("names"), ranges[:].tolist(), texts("shapes"), radii, texts("materials", ""))
            )
        ]

    def _faces_of(self, first, last):
        inside = (self.faces[:, 0] >= first) & (self.faces[:, 0] < last)
        return self.faces[inside] - first

    def __len__(self):
        return len(self.times)

    def frame(self, index):
        """[vertices, 3] float64, m. Raises FileError for a frame that is damaged."""
        try:
            positions = self.positions[index].astype(np.float64)
        except DAMAGED as problem:
            raise FileError(f"{self._path}: frame {index} cannot be read: {problem}") from None
        if not np.isfinite(positions).all():
            raise FileError(f"{self._path}: frame {index} is damaged: a position is not a finite number")
        return positions

    def counts(self, index):
        """Contacts and intersections of a frame, {name: number}; of an older recording those that it has."""
        return {name: int(self._file[name][index]) for name in ("contacts", "intersections") if name in self._file}

    def close(self):
        """Closes the file."""
        self._file.close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()
