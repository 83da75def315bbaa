# SPDX-License-Identifier: Apache-2.0
"""Scenes: cloth, obstacles, pins and stitches."""

from __future__ import annotations

import contextlib
import json
import math
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NoReturn

import numpy as np

from . import _core, collision, shipped
from .arrays import count, indices, number, plain, reals, vector, whole
from .body import Body
from .errors import ArrayError, FileError, SceneError
from .hints import counted, naming_files, reading
from .inputs import (
    compiled_gas,
    compiled_mesh,
    file_frame,
    placement,
    sampled,
    shape_scene,
    shrinkage_rows,
    texture_scale,
    uniform_scale,
)
from .io import morph, usd_scene
from .io import reading as guard
from .io.characters import keep_limbs_apart
from .io.usd_reader import is_usd, read_usd
from .material import Material
from .motion import Motion
from .options import nested, overrides_of
from .parts import Cloth, Obstacle, Part
from .rigid import Rigid
from .types import ArrayLike, Description, Integers, MeshLike, PathLike, Unit, Vector, VectorLike
from .welding import Weld, distance_of

if TYPE_CHECKING:
    from typing_extensions import Self

__all__ = ["Scene", "Cloth", "Obstacle"]

ANIMATED = {".glb", ".gltf", ".fbx", ".dae"}


def _animated(file: PathLike) -> bool:
    """Whether a file has one of the formats that can hold skeletal animation."""
    return Path(file).suffix.lower() in ANIMATED


def _character(file: PathLike, clip: str, animation: PathLike | None, *how: Any) -> _core.Character:
    """Loads a character; a file without animation, of which no clip is asked for, stands still. Raises FileError."""
    try:
        return _guarded_character(file, clip, "" if animation is None else animation, 1.0, *how)
    except FileError:
        if clip or animation is not None:
            raise
    return _guarded_character(file, "bind", "", 1.0, *how)


def _guarded_character(file: PathLike, clip: str, animation: PathLike, *how: Any) -> _core.Character:
    guard.check([guard.character(file, clip, animation, *how)])
    return _core.load_character(Path(file), clip, Path(animation) if animation else "", *how)


def _joint_names(what: str, names: Sequence[str]) -> list[str]:
    """The names as a list. Raises SceneError if they are one text or hold something else."""
    if isinstance(names, str) or not isinstance(names, Iterable) or not all(isinstance(n, str) for n in names):
        raise SceneError(f"{what}: {names!r} is not a list of names of joints, such as ['left_arm', 'right_arm']")
    return list(names)


def _switch(name: str, value: bool) -> bool:
    """Raises SceneError if the value is neither true nor false, such as the object that scene.json has at this key."""
    if not isinstance(value, (bool, np.bool_)):
        raise SceneError(
            f"{name}: {value!r} is not True or False; thickness, stiffness, friction and static_friction are arguments "
            "of their own"
        )
    return bool(value)


class Scene:
    """A scene to simulate. Lengths are in m, masses in kg, times in s.

    Args:
        gravity: Acceleration [3], m/s^2.
        time_step: Time step, s. The levels `production` and `paper` use it; 0: the accuracy level's own.
        frames: Number of frames that `cama run` records.
        frame_time: Time between recorded frames, s; 0: `time_step`, or 1/60 s if that is 0 too.
        name: Name of the scene.
        description: What the scene shows.
        thickness: Distance below which contact acts, m.
        stiffness: Stiffness of the contact penalty, N/m^3.
        friction: Coulomb coefficient of cloth against cloth, for materials without their own.
        static_friction: The coefficient while cloth sticks; None: equal to `friction`.
        contact: False: cloth passes through everything.
        self_contact: False: cloth passes through cloth.
        wind: A dict with `velocity` [3] m/s, `density` kg/m^3 and `drag` kg/(m^2 s), or None.
    """

    __slots__ = ("_core", "_folder")  # a field that is not there is an AttributeError

    def __init__(
        self,
        gravity: VectorLike = (0, 0, -9.81),
        time_step: float = 0.0,
        frames: int = 100,
        frame_time: float = 0.0,
        name: str = "scene",
        description: str = "",
        thickness: float = 1e-3,
        stiffness: float | None = None,
        friction: float | None = None,
        static_friction: float | None = None,
        contact: bool = True,
        self_contact: bool = True,
        wind: Mapping[str, Any] | None = None,
    ) -> None:
        self._core, self._folder = _core.Scene(), Path()
        self.gravity, self.time_step, self.frames, self.frame_time = gravity, time_step, frames, frame_time
        self._core.name, self._core.description = str(name), str(description)
        own = self._core.contact
        own.enabled, own.self = _switch("contact", contact), _switch("self_contact", self_contact)
        own.thickness = number("thickness", thickness)
        if stiffness is not None:
            own.stiffness = number("stiffness", stiffness)
        if friction is not None:
            own.friction = number("friction", friction)
        if static_friction is not None:
            own.static_friction = number("static_friction", static_friction)
        self.wind = wind

    @classmethod
    def _of(cls, core: _core.Scene, folder: Path) -> Self:
        scene = cls.__new__(cls)
        scene._core, scene._folder = core, folder
        return scene

    @classmethod
    @naming_files()
    def load(cls, scene: PathLike, resolution: int = 0) -> Self:
        """Loads a scene.

        Args:
            scene: A folder with scene.json, a JSON file, or the name of a shipped scene.
            resolution: Approximate total number of cloth triangles; 0: as many as the scene says.

        Raises:
            FileError, SceneError, MeshError, MaterialError
        """
        path = shipped.resolve(scene)
        file = path / "scene.json" if path.is_dir() else path
        with reading(path):
            with contextlib.suppress(OSError):
                guard.check(guard.of_scene(file.read_text(encoding="utf-8", errors="replace"), file.parent))
            return cls._of(usd_scene.load(path, count("resolution", resolution)), file.parent)

    @classmethod
    @naming_files()
    def parse(cls, text: str | Description, folder: PathLike = ".", resolution: int = 0) -> Self:
        """Makes a scene from JSON text or a dict, as in scene.json.

        Args:
            text: JSON text, or a dict.
            folder: Folder that relative file names start at.
            resolution: As for `load`.
        """
        try:
            text = text if isinstance(text, str) else json.dumps(text, default=plain)
        except (TypeError, ValueError) as problem:
            raise SceneError(f"not what JSON can hold: {problem}") from None
        with reading():
            guard.check(guard.of_scene(text, Path(folder)))
            return cls._of(usd_scene.parse(text, Path(folder), count("resolution", resolution)), Path(folder))

    def to_json(self) -> str:
        """Returns the whole scene as JSON text that contains its meshes."""
        return self._core.save()

    def save(self, path: PathLike) -> None:
        """Writes `to_json()` to a file; `Scene.load(path)` reads the same scene. Raises FileError."""
        try:
            Path(path).write_text(self.to_json(), encoding="utf-8")
        except OSError as problem:
            raise FileError(f"{path}: {problem.strerror}") from None

    def _allow_change(self, what: str) -> None:
        """Raises SceneError if the scene is read-only."""

    def copy(self) -> Scene:
        """Returns an independent copy, as copy.copy and copy.deepcopy do."""
        return Scene._of(_core.Scene(self._core), self._folder)

    __copy__ = copy

    def __deepcopy__(self, memo: object) -> Scene:
        return self.copy()

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickles the scene as its JSON text."""
        return Scene.parse, (self.to_json(),)

    def validate(self) -> None:
        """Raises a subclass of `cama.Error` if the scene cannot be simulated. `Simulation` calls it too."""
        self._core.validate()

    def intersections(self) -> list[collision.ObjectIntersections]:
        """Finds the intersections at the start that are not allowed, with exact predicates.

        Pairs of obstacles are left out; without `self_contact`, pairs of cloths too.

        Returns:
            One `cama.collision.ObjectIntersections` for each pair of objects that intersect.
        """
        return collision._start_intersections(self._core)

    def save_intersections(self, path: PathLike) -> None:
        """Writes the intersecting faces at the start to a file: pierced faces, and the faces beside piercing edges.

        Args:
            path: An .obj file, with a group for each pair of objects, or a .ply file, with a colour for each pair.

        Raises:
            FileError
        """
        collision._save_intersections(path, self._core)

    def untangle(self, max_rounds: int = 400, gap: float = 0.0) -> collision.UntangleReport:
        """Moves cloth at the start until nothing intersects; obstacles and pinned vertices stay.

        If intersections remain, the report's `clean` is False and the scene has the positions with the fewest
        intersections. Cloth without material space takes the moved start as its rest state;
        `Simulation(scene, intersections="untangle")` keeps the old one. The method follows Volino and Magnenat-Thalmann
        2006 and Baraff, Witkin and Kass 2003.

        Args:
            max_rounds: Largest number of rounds.
            gap: Gap to leave around moved vertices, m; 0: a tenth of the smallest contact thickness.

        Raises:
            SceneError, ArrayError
        """
        rounds, gap = int(max_rounds), number("untangle: gap", gap)
        if rounds < 0 or gap < 0:
            raise ArrayError(f"untangle: max_rounds {rounds} and gap {gap} must not be negative")
        return collision.UntangleReport(**_core.untangle(self._core, rounds, gap))

    @naming_files()
    def add_cloth(
        self,
        mesh: PathLike | ArrayLike | MeshLike | None = None,
        faces: ArrayLike | None = None,
        *,
        shape: Description | None = None,
        material: PathLike | Description | _core.Material = "cotton",
        thickness: float | None = None,
        material_vertices: ArrayLike | None = None,
        material_faces: ArrayLike | None = None,
        rest: Literal["start", "uv"] = "start",
        material_scale: float | None = None,
        units: Unit = "m",
        up: Literal["y", "z"] | None = None,
        transform: ArrayLike | None = None,
        translate: VectorLike = (0, 0, 0),
        rotate: VectorLike = (1, 0, 0, 0),
        scale: float = 1.0,
        velocity: VectorLike = (0, 0, 0),
        pressure: float = 0.0,
        gas: float | Mapping[str, float] | None = None,
        shrinkage: float | ArrayLike = 0.0,
        weld: Weld = False,
        name: str | None = None,
    ) -> Cloth:
        """Adds a piece of cloth and returns its handle.

        Args:
            mesh: A file (OBJ, PLY, glTF, FBX, DAE, STL, USD), vertices [n, 3] in m, or an object with `vertices` and
                `faces`.
                Stitch lines of an OBJ file become stitches.
            faces: Triangles [m, 3], if `mesh` is an array of vertices.
            shape: A generated mesh instead of `mesh`, as in scene.json, for example
                {"grid": {"size": [1, 1]}, "triangles": 2000}.
            material: A fabric's name, a JSON file, a dict or a `cama.Material`.
            thickness: Contact thickness, m; None: the material's.
            material_vertices: Rest positions in material space [k, 2], m, of a mesh in arrays; None: the start, with
                `scale`, is the rest shape. A `shape` has a rest shape of its own.
            material_faces: Triangles [m, 3] of `material_vertices`; None: `faces`.
            rest: The rest shape of a mesh file: "start", its vertices with `scale`, or "uv", its texture coordinates
                times `material_scale`, as garment patterns have them.
            material_scale: Length of a unit of the texture coordinates, m, with rest="uv"; None: 1.
            units: Unit of the lengths of `mesh`: "m", "cm", "mm", "in" or "ft", or "metre", "centimetre",
                "millimetre", "inch" or "foot". Texture coordinates have `material_scale`.
            up: The axis of `mesh` that points up, "y" or "z", for files without one of their own (OBJ, PLY, STL) and
                for arrays; None: "z".
            transform: Matrix [4, 4] that is applied to the start after `scale`, `rotate` and `translate`.
            translate: Translation of the start [3], m.
            rotate: Rotation of the start, a unit quaternion w, x, y, z.
            scale: Scale of the start and of the rest shape.
            velocity: Velocity at the start [3], m/s.
            pressure: Pressure inside a closed cloth above that outside, Pa. It pushes along the normals of the faces.
            gas: Gas enclosed by a closed cloth, at constant temperature, whose pressure falls as its volume grows: its
                pressure above that outside, Pa, at the volume of the start, or a dict with pressure, volume (at which
                the gas has this pressure, m^3; 0: that of the start) and ambient (absolute pressure outside, Pa;
                without it 101325). Not together with `pressure`.
            shrinkage: Share by which the rest shape shrinks, from -1 (it grows to twice its length) to 0.9: one number,
                [2] for warp and weft, or [m, 2] for the triangles. The start and the mass stay as they are.
            weld: Whether to join vertices of `mesh` that coincide, so that triangles which share a place share its
                vertices. True: vertices within a millionth of the mesh's extent; a number: within this distance, m,
                after `scale`. Each group keeps the position of its first vertex; vertices are then numbered in the
                order of these, triangles that collapse are left out, and material coordinates stay. Stitches of a
                file are renumbered; one whose vertex has become one of the edge it is drawn to is left out.
            name: Name in error texts and results.

        Raises:
            ArrayError, MeshError, MaterialError, FileError, SceneError
        """
        name = str(name) if name is not None else f"cloth {self._core.cloth_count}"
        unit = texture_scale(name, rest, material_scale, shape)
        frame, length = file_frame(name, mesh, units, up)
        cloth, cloth_source = self._part(
            "cloth", name, mesh, faces, shape, material_vertices, material_faces, unit > 0, unit or 1.0
        )
        cloth.material_scale = unit or cloth.material_scale  # a shape may be a file with its own
        cloth.name, cloth.source = name, cloth_source
        cloth.mesh.transform((placement(transform, translate, rotate, scale) @ frame).tolist())
        cloth.mesh.scale_material(number(f"{name}: scale", scale) * (1.0 if unit else length))
        renumbered = self._weld(name, cloth, weld, shape)
        cloth.mesh.validate(name)
        material = Material.of(material)
        if thickness is not None:
            material = material.with_thickness(thickness)
        material.validate(name)
        cloth.material = material
        cloth.velocity = vector(f"{name}: velocity", velocity)
        cloth.pressure = number(f"{name}: pressure", pressure)
        cloth.gas = None if gas is None else compiled_gas(name, gas)
        if shape is None or np.ndim(shrinkage) or shrinkage:  # a shape may have its own
            cloth.shrinkage = shrinkage_rows(name, shrinkage)
        handle = Cloth(self, self._core.add_cloth(cloth))
        if isinstance(mesh, (str, os.PathLike)) and Path(mesh).suffix.lower() == ".obj":
            for a, b, c, ratio in _core.load_stitches(Path(mesh), renumbered):
                self._core.add_stitch(handle.index, a, handle.index, b, c, ratio, 1e3)
        return handle

    @naming_files()
    def add_obstacle(
        self,
        mesh: PathLike | ArrayLike | MeshLike | Body | None = None,
        faces: ArrayLike | None = None,
        *,
        shape: Description | None = None,
        motion: _core.Motion | dict[str, Any] | None = None,
        rigid: _core.Rigid | dict[str, Any] | None = None,
        friction: float = 0.3,
        static_friction: float | None = None,
        thickness: float | None = None,
        contact_stiffness: float | None = None,
        clip: str | int = "",
        animation: PathLike | None = None,
        samples_per_second: float = 60.0,
        y_up: bool = True,
        lead_in: float = 0.0,
        loops: int = 1,
        leave_out: Sequence[str] = (),
        clearance: float | None = None,
        units: Unit = "m",
        up: Literal["y", "z"] | None = None,
        transform: ArrayLike | None = None,
        translate: VectorLike = (0, 0, 0),
        rotate: VectorLike = (1, 0, 0, 0),
        scale: float = 1.0,
        weld: Weld = False,
        name: str | None = None,
    ) -> Obstacle:
        """Adds an obstacle, which cloth collides with, and returns its handle.

        Args:
            mesh: As for `add_cloth`, or a `cama.Body`, which brings its motion. glTF, FBX and DAE files bring their
                skeletal animation, glTF files without a skeleton that of their morph targets, USD files the time
                samples of points, transforms and skeletons; without one they stand still.
            faces: As for `add_cloth`.
            shape: A generated obstacle instead of `mesh`, as in scene.json, for example {"sphere": {"radius": 0.25}},
                {"box": {"size": [1, 1, 0.1]}} or {"walker": {}}. {"shape": {"sphere": {"radius": 0.25}}} is an exact
                sphere instead of a mesh; capsule, box and plane can be exact too.
            motion: A `cama.Motion` or a dict of its arguments, in place of a file's own animation.
            rigid: A `cama.Rigid` or a dict of its arguments, which makes a mesh or a box a body that cloth and gravity
                move.
            friction: Coulomb coefficient against cloth.
            static_friction: The coefficient while cloth sticks; None: equal to `friction`.
            thickness: Contact thickness, m; None: the scene's.
            contact_stiffness: Stiffness of the contact penalty, N/m^3; None: the scene's.
            clip: Name or index of the animation in the file; "": the first; "bind": the bind pose, without motion.
            animation: Another file to take the animation from; None: the file of `mesh`.
            samples_per_second: Samples that are taken of the animation, 1/s.
            y_up: Whether to turn a file whose y axis is up, so that z is up.
            lead_in: Time in which the obstacle moves from the bind pose to the start of the clip, s.
            loops: How many times the clip is played.
            leave_out: Names of joints of a character. What follows them, or joints below them, more than any other
                joint is not part of the obstacle: the arms, say, where they would press a skirt into the hips.
            clearance: Distance that the limbs of a character keep from each other and from the trunk, m. Where they
                come closer, or pass through each other, they are bent aside when the file is read; `source` of the
                obstacle says how far. None: 0.01; 0: the motion stays as it is.
            units, up: As for `add_cloth`.
            transform, translate, rotate, scale: Placement, as for `add_cloth`.
            weld: As for `add_cloth`. Not for a motion that moves every vertex by itself; animated characters are
                welded when they are read.
            name: Name in error texts and results.

        Raises:
            As `add_cloth`.
        """
        name = str(name) if name is not None else f"obstacle {self._core.obstacle_count}"
        obstacle = _core.Obstacle()
        obstacle.name = name
        given = {
            "friction": friction,
            "static_friction": static_friction,
            "thickness": thickness,
            "contact_stiffness": contact_stiffness,
        }
        numbers = {key: number(f"{name}: {key}", value) for key, value in given.items() if value is not None}
        frame, _ = file_frame(name, mesh, units, up)
        place = placement(transform, translate, rotate, scale) @ frame
        matrix = place.tolist()
        joints = _joint_names(f"{name}: leave_out", leave_out)
        if joints and (motion is not None or not isinstance(mesh, (str, os.PathLike)) or not _animated(mesh)):
            raise SceneError(f"{name}: leave_out: needs a character, a glTF, FBX or DAE file without another motion")
        gap = None if clearance is None else number(f"{name}: clearance", clearance)
        if gap is not None and gap < 0:
            raise SceneError(f"{name}: clearance: must be a distance in m, 0 to leave the motion as it is, got {gap:g}")
        how: tuple[Any, ...] = ()
        from_file = motion is None and isinstance(mesh, (str, os.PathLike))
        if from_file and animation is None and morph.is_animated(mesh, str(clip)):
            if joints or gap:
                raise SceneError(f"{name}: leave_out and clearance need a skeleton, and {mesh} has morph targets alone")
            rate, lead = number(f"{name}: samples_per_second", samples_per_second), number(f"{name}: lead_in", lead_in)
            blended = morph.read(Path(mesh), str(clip), rate, bool(y_up), lead, whole(f"{name}: loops", loops))
            body, moving = sampled(blended.faces, blended.times, blended.positions)
            obstacle.source = str(mesh)
        elif from_file and (animation is not None or _animated(mesh)):
            how = (
                number(f"{name}: samples_per_second", samples_per_second),
                bool(y_up),
                number(f"{name}: lead_in", lead_in),
                whole(f"{name}: loops", loops),
                joints,
            )
            character = _character(mesh, str(clip), animation, *how)
            obstacle.source = str(mesh) + (morph.REMARK if morph.stay_at_rest(mesh, str(clip)) else "")
            body, moving = character.mesh, character.motion
        elif gap:
            raise SceneError(f"{name}: clearance: needs a character, a glTF, FBX or DAE file without another motion")
        elif motion is None and is_usd(mesh):
            if clip not in ("", "bind") or lead_in or loops != 1:
                raise SceneError(
                    f"{name}: clip, lead_in and loops are for glTF, FBX and DAE; a USD file has one animation"
                )
            read = read_usd(mesh, animated=clip != "bind")
            obstacle.source = str(mesh)
            body, moving = sampled(read.faces, read.times, read.positions)
        elif isinstance(mesh, Body) and motion is None:
            body, obstacle.source = compiled_mesh(name, mesh, None, None, None)[0], f"generated body, {mesh.motion}"
            moving = _core.Motion(mesh.animation())
        else:
            part, obstacle.source = self._part("obstacle", name, mesh, faces, shape)
            body, moving = part.mesh, part.motion
            if part.shape != "mesh":
                obstacle.shape = part.shape
                obstacle.radius = part.radius * uniform_scale(name, part.shape, place[:3, :3])
        if motion is not None:
            moving = _core.Motion(Motion.of(motion))
        body.transform(matrix)
        moving.transform(matrix)
        obstacle.mesh, obstacle.motion = body, moving
        self._weld(name, obstacle, weld, shape)
        if obstacle.shape == "mesh":
            obstacle.mesh.validate(name)
        if how:
            arguments = (Path(str(mesh)), str(clip), "" if animation is None else Path(animation), 1.0, *how)
            keep_limbs_apart(obstacle, arguments, gap)
        for key, value in numbers.items():
            setattr(obstacle, key, value)
        if rigid is not None:
            obstacle.rigid = Rigid.of(name, rigid)
        return Obstacle(self, self._core.add_obstacle(obstacle))

    def _part(
        self, kind: str, name: str, mesh: Any, faces: ArrayLike | None, shape: Description | None, *material: Any
    ) -> tuple[Any, str]:
        """Returns a compiled Cloth or Obstacle with its mesh, and a text that says where the mesh comes from."""
        if (mesh is None) == (shape is None):
            raise SceneError(f"{name}: exactly one of mesh and shape is needed")
        if shape is not None:
            if any(given is not None for given in material[:2]):
                raise SceneError(f"{name}: material_vertices: a generated shape has a rest shape of its own; leave out")
            made = shape_scene(kind, name, shape)
            part = _core.Cloth(made.cloth(0)) if kind == "cloth" else _core.Obstacle(made.obstacle(0))
            return part, part.source
        part = _core.Cloth() if kind == "cloth" else _core.Obstacle()
        part.mesh, source = compiled_mesh(name, mesh, faces, *(material or (None, None)))
        return part, source

    @staticmethod
    def _weld(name: str, part: Any, weld: Weld, shape: Description | None) -> Integers | None:
        """Welds the mesh of a compiled Cloth or Obstacle; returns the new vertex [n] of each old one, None: the old."""
        distance = distance_of(name, weld, part.mesh)
        if distance is None:
            return None
        if shape is not None:
            raise SceneError(f"{name}: weld: a generated shape has no vertices that coincide; leave it out")
        if isinstance(part, _core.Obstacle) and not part.motion.is_rigid:
            raise SceneError(f"{name}: weld: its motion gives positions of every vertex; weld the mesh and them before")
        part.mesh, renumbered = _core.weld(part.mesh, distance)
        return renumbered

    def pin(
        self,
        cloth: Cloth | int | str,
        vertices: ArrayLike,
        motion: _core.Motion | dict[str, Any] | None = None,
        release: float = math.inf,
    ) -> None:
        """Holds cloth vertices in place or moves them.

        Args:
            cloth: A handle, index or name.
            vertices: Vertex numbers [k], one vertex number, or a mask [vertices of the cloth] of booleans.
            motion: A rigid `cama.Motion`, or a dict of its arguments, that moves their starting positions; None: fixed.
            release: Time at which the vertices become free, s.

        Raises:
            ArrayError, SceneError
        """
        motion = Motion.of(motion)
        index, vertices = self._vertices("pin", cloth, vertices)
        self._core.add_pin(index, vertices, motion, None, float(release))

    def attach(
        self,
        cloth: Cloth | int | str,
        vertices: ArrayLike,
        obstacle: Obstacle | int | str,
        release: float = math.inf,
    ) -> None:
        """Makes cloth vertices follow the nearest points of an obstacle's surface.

        Args:
            cloth, vertices, release: As for `pin`.
            obstacle: A handle, index or name.

        Raises:
            ArrayError, SceneError
        """
        index, vertices = self._vertices("attach", cloth, vertices)
        self._core.add_pin(index, vertices, Motion(), self._index("attach", obstacle, self.obstacles), float(release))

    def stitch(
        self,
        cloth_a: Cloth | int | str,
        vertex_a: ArrayLike,
        cloth_b: Cloth | int | str,
        vertex_b: ArrayLike,
        vertex_c: ArrayLike | None = None,
        ratio: ArrayLike = 0.0,
        stiffness: float = 1e3,
    ) -> None:
        """Adds springs of zero rest length that pull x_a to (1 - ratio) x_b + ratio x_c.

        Args:
            cloth_a: Cloth of the vertices a: a handle, index or name.
            vertex_a: One vertex number, or [k].
            cloth_b: Cloth of the vertices b and c.
            vertex_b: One vertex number, or [k].
            vertex_c: One vertex number, or [k]; None: `vertex_b`.
            ratio: One number in [0, 1], or [k].
            stiffness: Stiffness of a spring, N/m.

        Raises:
            ArrayError, SceneError
        """
        a, first = self._vertices("stitch", cloth_a, np.atleast_1d(vertex_a))
        b, second = self._vertices("stitch", cloth_b, np.atleast_1d(vertex_b))
        third = second if vertex_c is None else self._vertices("stitch", cloth_b, np.atleast_1d(vertex_c))[1]
        if not len(first) == len(second) == len(third):
            raise ArrayError(f"stitch: {len(first)} vertices a, {len(second)} b, {len(third)} c")
        ratio = np.broadcast_to(reals("stitch: ratio", np.atleast_1d(ratio), (None,)), (len(first),))
        for i, j, k, r in zip(first, second, third, ratio):
            self._core.add_stitch(a, int(i), b, int(j), int(k), float(r), number("stitch: stiffness", stiffness))

    def elastic(self, cloth: Cloth | int | str, vertices: ArrayLike, *, length: float, stiffness: float) -> None:
        """Sews an elastic to a line of cloth: springs that only pull, one along each edge of the line.

        Args:
            cloth: A handle, index or name.
            vertices: Vertex numbers [k] in order, with an edge from each to the next; a closed line repeats the first
                at the end.
            length: Length of the elastic at rest over that of the line in the rest shape of the cloth, such as 0.8.
            stiffness: Force over strain of the elastic, EA, N.

        Raises:
            ArrayError, SceneError
        """
        index, line = self._vertices("elastic", cloth, vertices)
        self._core.add_elastic(index, line, number("elastic: length", length), number("elastic: stiffness", stiffness))

    def crease(
        self,
        cloth: Cloth | int | str,
        vertices: ArrayLike | None = None,
        *,
        line: ArrayLike | None = None,
        angle: float,
    ) -> None:
        """Folds a cloth along a line of edges in its rest shape, as pressed pleats are.

        Args:
            cloth: A handle, index or name.
            vertices: Vertex numbers [k] in order, with an edge between two faces from each to the next.
            line: Two points [2, 3], m, in place of `vertices`: the vertices of the start on the straight line between
                them.
            angle: Angle between the normals of the faces on both sides, degrees, from -180 to 180; 0: flat. Above 0
                the crease is a ridge on the side that the normals point to.

        Raises:
            ArrayError, SceneError
        """
        if (vertices is None) == (line is None):
            raise SceneError("crease: exactly one of vertices and line is needed")
        if line is None:
            index, along = self._vertices("crease", cloth, np.asarray(vertices))
        else:
            index = self._index("crease", cloth, self.cloths)
            start, end = reals("crease: line", line, (2, 3)).tolist()
            along = self._core.vertices_along(index, start, end)
        self._core.add_crease(index, along, number("crease: angle", angle))

    def _index(self, what: str, part: Part | int | str, parts: Sequence[Part]) -> int:
        if isinstance(part, Part):
            if part._scene is not self:
                raise SceneError(f"{what}: {part!r} belongs to another scene")
            return part.index
        for candidate in parts:
            if part in (candidate.index, candidate.name):
                return candidate.index
        raise SceneError(f"{what}: there is no {part!r}; there are {[p.name for p in parts]}")

    def _vertices(self, what: str, cloth: Part | int | str, vertices: ArrayLike) -> tuple[int, Integers]:
        index = self._index(what, cloth, self.cloths)
        name, count = self.cloths[index].name, len(self.cloths[index].vertices)
        vertices = indices(f"{what}: {name}: vertices", vertices, count)
        for row in np.flatnonzero((vertices < 0) | (vertices >= count))[:1]:
            raise SceneError(f"{what}: {name}: vertex {vertices[row]} (row {row}) is outside 0 to {count - 1}")
        return index, vertices

    @property
    def cloths(self) -> list[Cloth]:
        """Handles of all pieces of cloth."""
        return [Cloth(self, i) for i in range(self._core.cloth_count)]

    @property
    def obstacles(self) -> list[Obstacle]:
        """Handles of all obstacles."""
        return [Obstacle(self, i) for i in range(self._core.obstacle_count)]

    @property
    def folder(self) -> Path:
        """Folder that relative file names of its scene file start at."""
        return self._folder

    @property
    def pins(self) -> list[dict[str, Any]]:
        """A list of dicts with cloth (index), vertices [k], obstacle (index or None) and release (s)."""
        return [dict(zip(("cloth", "vertices", "obstacle", "release"), row)) for row in self._core.pins()]

    @property
    def stitch_count(self) -> int:
        """Number of stitches."""
        return self._core.stitch_count

    @property
    def vertex_count(self) -> int:
        """Number of cloth vertices."""
        return self._core.cloth_vertex_count

    @property
    def triangle_count(self) -> int:
        """Number of cloth triangles."""
        return self._core.cloth_triangle_count

    @property
    def seconds_per_frame(self) -> float:
        """Time between recorded frames, s: `frame_time`; if that is 0, `time_step`; if both are 0, 1/60."""
        return self._core.seconds_per_frame

    @property
    def name(self) -> str:
        """Name of the scene."""
        return self._core.name

    @name.setter
    def name(self, value: str) -> None:
        self._core.name = str(value)

    @property
    def description(self) -> str:
        """What the scene shows."""
        return self._core.description

    @description.setter
    def description(self, value: str) -> None:
        self._core.description = str(value)

    @property
    def time_step(self) -> float:
        """Time step, s; 0: the accuracy level's."""
        return self._core.time_step

    @time_step.setter
    def time_step(self, value: float) -> None:
        self._core.time_step = number("time_step", value)

    @property
    def frame_time(self) -> float:
        """Time between recorded frames, s; 0: `time_step`, or 1/60 s without one."""
        return self._core.frame_time

    @frame_time.setter
    def frame_time(self, value: float) -> None:
        self._core.frame_time = number("frame_time", value)

    @property
    def frames(self) -> int:
        """Number of frames that `cama run` records."""
        return self._core.frames

    @frames.setter
    def frames(self, value: int) -> None:
        self._core.frames = whole("frames", value)

    @property
    def thickness(self) -> float:
        """Contact thickness, m."""
        return self._core.contact.thickness

    @thickness.setter
    def thickness(self, value: float) -> None:
        self._core.contact.thickness = number("thickness", value)

    @property
    def stiffness(self) -> float:
        """Contact penalty, N/m^3."""
        return self._core.contact.stiffness

    @stiffness.setter
    def stiffness(self, value: float) -> None:
        self._core.contact.stiffness = number("stiffness", value)

    @property
    def friction(self) -> float:
        """Coulomb coefficient of cloth against cloth, for materials that give none."""
        return self._core.contact.friction

    @friction.setter
    def friction(self, value: float) -> None:
        self._core.contact.friction = number("friction", value)

    @property
    def static_friction(self) -> float:
        """The coefficient while cloth sticks, not below `friction`; -1: equal to it."""
        return self._core.contact.static_friction

    @static_friction.setter
    def static_friction(self, value: float) -> None:
        self._core.contact.static_friction = number("static_friction", value)

    @property
    def gravity(self) -> Vector:
        """[3] m/s^2."""
        return self._core.gravity

    @gravity.setter
    def gravity(self, value: VectorLike) -> None:
        self._core.gravity = vector("gravity", value)

    @property
    def wind(self) -> dict[str, Any] | None:
        """None, or a dict with velocity, density and drag."""
        wind = self._core.wind
        return None if wind is None else {"velocity": wind.velocity, "density": wind.density, "drag": wind.drag}

    @wind.setter
    def wind(self, value: Mapping[str, Any] | None) -> None:
        wind = None
        if value is not None:
            wind = _core.Wind()
            for key, entry in dict(value).items():
                if key not in ("velocity", "density", "drag"):
                    raise SceneError(f"wind: unknown key {key!r}; there are velocity, density, drag")
                setattr(
                    wind, key, vector("wind: velocity", entry) if key == "velocity" else number(f"wind: {key}", entry)
                )
        self._core.wind = wind

    @property
    def options(self) -> dict[str, Any]:
        """The options that `Simulation` uses unless its caller gives others: `accuracy` and others such as `tolerance`.

        These are the `options` of scene.json; assign a dict to change them. SceneError for a name that is not known, an
        option that belongs to the user alone (`backend`, `pinch`, ...), and a value that is not one of its option.
        """
        return nested(self._core.options.values())

    @options.setter
    def options(self, value: Mapping[str, Any]) -> None:
        options = overrides_of(value)
        _core.check_scene_options(options)
        self._core.options = options

    def __repr__(self) -> str:
        return (
            f"<cama.Scene {self.name!r}: {counted(self._core.cloth_count, 'cloth')} with "
            f"{counted(self.triangle_count, 'triangle')}, {counted(self._core.obstacle_count, 'obstacle')}>"
        )


class SimulatedScene(Scene):
    """The scene of a simulation, which is read-only: the simulation would not see a change."""

    __slots__ = ()

    @classmethod
    def of(cls, scene: Scene) -> SimulatedScene:
        """Returns a read-only copy of a scene."""
        return cls._of(_core.Scene(scene._core), scene._folder)

    def _refuse(self, what: str) -> NoReturn:
        raise SceneError(
            f"{what}: the scene of a simulation is read-only; drive the simulation (pin, set_targets, "
            "set_obstacle_pose, gravity, ...), or change the scene and make a new simulation"
        )

    def _allow_change(self, what: str) -> None:
        self._refuse(what)

    def __setattr__(self, name: str, value: object) -> None:
        if name not in ("_core", "_folder"):
            self._refuse(name)
        object.__setattr__(self, name, value)

    def add_cloth(self, *arguments: Any, **named: Any) -> NoReturn:  # type: ignore[override]
        self._refuse("add_cloth")

    def add_obstacle(self, *arguments: Any, **named: Any) -> NoReturn:  # type: ignore[override]
        self._refuse("add_obstacle")

    def pin(self, *arguments: Any, **named: Any) -> NoReturn:  # type: ignore[override]
        self._refuse("pin")

    def attach(self, *arguments: Any, **named: Any) -> NoReturn:  # type: ignore[override]
        self._refuse("attach")

    def stitch(self, *arguments: Any, **named: Any) -> NoReturn:  # type: ignore[override]
        self._refuse("stitch")

    def elastic(self, *arguments: Any, **named: Any) -> NoReturn:  # type: ignore[override]
        self._refuse("elastic")

    def crease(self, *arguments: Any, **named: Any) -> NoReturn:  # type: ignore[override]
        self._refuse("crease")

    def untangle(self, *arguments: Any, **named: Any) -> NoReturn:  # type: ignore[override]
        self._refuse("untangle")
