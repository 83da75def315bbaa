# SPDX-License-Identifier: Apache-2.0
"""What is simulated: cloth, obstacles, pins and stitches."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Optional, Union

import numpy as np

from . import _core, collision, shipped
from .arrays import count, integers, number, plain, reals, vector, whole
from .errors import ArrayError, FileError, SceneError
from .inputs import compiled_mesh, placement, shape_scene, uniform_scale
from .material import Material
from .motion import Motion
from .options import check_scene_options
from .parts import Cloth, Obstacle, Part
from .types import ArrayLike, Description, Integers, MeshLike, PathLike, Vector, VectorLike

if TYPE_CHECKING:
    from typing_extensions import Self

__all__ = ["Scene", "Cloth", "Obstacle"]

ANIMATED = {".glb", ".gltf", ".fbx", ".dae"}


def _animated(file: PathLike) -> bool:
    """Whether files of this name hold skeletal animation."""
    return Path(file).suffix.lower() in ANIMATED


class Scene:
    """What the user describes. Lengths in m, masses in kg, times in s.

    gravity: [3] m/s^2.  time_step: s, which the levels `production` and `paper` take as it is; 0: the accuracy level's.  frames: how many
    `cama run` records.  frame_time: s between frames, 0: time_step, or 1/60 s without one.
    thickness: distance below which contact acts, m.  stiffness: of the contact penalty, N/m^3.  friction: cloth against
    cloth, for materials that give none.  static_friction: the same while it sticks, None: equal.  contact: False lets cloth pass through everything.  self_contact: cloth against cloth.
    wind: None or a dict with `velocity` [3] m/s, `density` kg/m^3, `drag` kg/(m^2 s).
    """

    __slots__ = ("_core",)  # a field that is not there is an AttributeError

    def __init__(
        self,
        gravity: VectorLike = (0, 0, -9.81),
        time_step: float = 0.0,
        frames: int = 100,
        frame_time: float = 0.0,
        name: str = "scene",
        description: str = "",
        thickness: float = 1e-3,
        stiffness: Optional[float] = None,
        friction: Optional[float] = None,
        static_friction: Optional[float] = None,
        contact: bool = True,
        self_contact: bool = True,
        wind: Optional[Mapping[str, Any]] = None,
    ) -> None:
        self._core = _core.Scene()
        self.gravity, self.time_step, self.frames, self.frame_time = gravity, time_step, frames, frame_time
        self._core.name, self._core.description = str(name), str(description)
        own = self._core.contact
        own.enabled, own.self = bool(contact), bool(self_contact)
        own.thickness = number("thickness", thickness)
        if stiffness is not None:
            own.stiffness = number("stiffness", stiffness)
        if friction is not None:
            own.friction = number("friction", friction)
        if static_friction is not None:
            own.static_friction = number("static_friction", static_friction)
        self.wind = wind

    @classmethod
    def _of(cls, core: _core.Scene) -> Self:
        scene = cls.__new__(cls)
        scene._core = core
        return scene

    @classmethod
    def load(cls, scene: PathLike, resolution: int = 0) -> Self:
        """A folder with scene.json, a JSON file, or the name of a shipped scene.

        resolution: total number of cloth triangles aimed at, 0: the scene's own. Throws FileError, SceneError, MeshError,
        MaterialError.
        """
        path = shipped.resolve(scene)
        loaded = cls._of(_core.Scene.load(path, count("resolution", resolution)))
        try:
            loaded.options = loaded.options
        except SceneError as problem:
            raise SceneError(f"{path}: {problem}") from None
        return loaded

    @classmethod
    def parse(cls, text: Union[str, Description], folder: PathLike = ".", resolution: int = 0) -> Self:
        """The same from JSON text (or a dict); relative file names start at `folder`."""
        try:
            text = text if isinstance(text, str) else json.dumps(text, default=plain)
        except (TypeError, ValueError) as problem:
            raise SceneError(f"not what JSON can hold: {problem}") from None
        parsed = cls._of(_core.Scene.parse(text, Path(folder), count("resolution", resolution)))
        parsed.options = parsed.options
        return parsed

    def to_json(self) -> str:
        """JSON text of the whole scene, meshes inline."""
        return self._core.save()

    def save(self, path: PathLike) -> None:
        """Writes `to_json()` to a file; `Scene.load(path)` gives the same scene. Throws FileError."""
        try:
            Path(path).write_text(self.to_json(), encoding="utf-8")
        except OSError as problem:
            raise FileError(f"{path}: {problem.strerror}") from None

    def copy(self) -> Scene:
        """An independent copy; copy.copy and copy.deepcopy give the same."""
        return Scene._of(_core.Scene(self._core))

    __copy__ = copy

    def __deepcopy__(self, memo: object) -> Scene:
        return self.copy()

    def __reduce__(self) -> tuple[Any, ...]:
        """Goes to other processes as its text."""
        return Scene.parse, (self.to_json(),)

    def validate(self) -> None:
        """Throws a named error for the first thing that cannot be simulated. `Simulation` calls it too."""
        self._core.validate()

    def intersections(self) -> list[collision.ObjectIntersections]:
        """What intersects at the start and may not: one cama.collision.ObjectIntersections per pair of objects.

        Exact predicates; obstacle against obstacle is left out, and cloth against cloth without `self_contact`.
        """
        return collision._start_intersections(self._core)

    def save_intersections(self, path: PathLike) -> None:
        """Writes the faces that are pierced and those beside piercing edges: .obj with a group, .ply with a colour per pair of objects.

        Throws FileError.
        """
        collision._save_intersections(path, self._core)

    def untangle(self, max_rounds: int = 400, gap: float = 0.0) -> collision.UntangleReport:
        """Moves cloth at the start until nothing intersects; obstacles and pinned vertices stay. Returns a collision.UntangleReport.

        gap: distance aimed at around what is moved, m; 0: a tenth of the smallest contact thickness. With something left the
        report's `clean` is False and the scene has the positions with the fewest intersections. Cloth without material space takes
        the moved start as its rest state (`Simulation(scene, intersections="untangle")` keeps the old one). After Volino and
        Magnenat-Thalmann 2006 and Baraff, Witkin and Kass 2003; see docs/bad-starts.md. Throws SceneError, ArrayError.
        """
        rounds, gap = int(max_rounds), number("untangle: gap", gap)
        if rounds < 0 or gap < 0:
            raise ArrayError(f"untangle: max_rounds {rounds} and gap {gap} must not be negative")
        return collision.UntangleReport(**_core.untangle(self._core, rounds, gap))

    def add_cloth(
        self,
        mesh: Union[PathLike, ArrayLike, MeshLike, None] = None,
        faces: Optional[ArrayLike] = None,
        *,
        shape: Optional[Description] = None,
        material: Union[PathLike, Description, _core.Material] = "cotton",
        thickness: Optional[float] = None,
        material_vertices: Optional[ArrayLike] = None,
        material_faces: Optional[ArrayLike] = None,
        material_scale: float = 1.0,
        transform: Optional[ArrayLike] = None,
        translate: VectorLike = (0, 0, 0),
        rotate: VectorLike = (1, 0, 0, 0),
        scale: float = 1.0,
        velocity: VectorLike = (0, 0, 0),
        name: Optional[str] = None,
    ) -> Cloth:
        """Adds a piece of cloth; returns its handle.

        mesh: a file (OBJ, PLY, glTF, FBX, DAE, STL), vertices [n, 3] float64 in m with `faces` [m, 3] integers, or an object
        that has `vertices` and `faces`.  shape: instead of a mesh, a generated one as in scene.json, for example
        {"grid": {"size": [1, 1]}, "triangles": 2000}.
        material: a fabric's name, a JSON file, a dict or a Material.  thickness: contact thickness, m.
        material_vertices [k, 2] m, material_faces [m, 3]: rest state in material space (faces alone default to `faces`);
        for files it comes from texture coordinates times `material_scale`. Stitch lines of an OBJ file are kept.
        Placement of the start: scale (of the material space too), rotate (unit quaternion w, x, y, z), translate [m],
        then transform [4, 4].
        velocity: [3] m/s. Throws ArrayError, MeshError, MaterialError, FileError, SceneError.
        """
        name = str(name) if name is not None else f"cloth {self._core.cloth_count}"
        cloth, cloth_source = self._part(
            "cloth", name, mesh, faces, shape, material_vertices, material_faces, material_scale
        )
        cloth.name, cloth.source = name, cloth_source
        cloth.mesh.transform(placement(transform, translate, rotate, scale).tolist())
        cloth.mesh.scale_material(number(f"{name}: scale", scale))
        cloth.mesh.validate(name)
        material = Material.of(material)
        if thickness is not None:
            material = material.with_thickness(thickness)
        material.validate(name)
        cloth.material = material
        cloth.velocity = vector(f"{name}: velocity", velocity)
        handle = Cloth(self, self._core.add_cloth(cloth))
        if isinstance(mesh, (str, os.PathLike)) and Path(mesh).suffix.lower() == ".obj":
            for a, b, c, ratio in _core.load_stitches(Path(mesh)):
                self._core.add_stitch(handle.index, a, handle.index, b, c, ratio, 1e3)
        return handle

    def add_obstacle(
        self,
        mesh: Union[PathLike, ArrayLike, MeshLike, None] = None,
        faces: Optional[ArrayLike] = None,
        *,
        shape: Optional[Description] = None,
        motion: Union[_core.Motion, dict[str, Any], None] = None,
        friction: float = 0.3,
        static_friction: Optional[float] = None,
        thickness: Optional[float] = None,
        contact_stiffness: Optional[float] = None,
        clip: Union[str, int] = "",
        animation: Optional[PathLike] = None,
        samples_per_second: float = 60.0,
        y_up: bool = True,
        lead_in: float = 0.0,
        loops: int = 1,
        transform: Optional[ArrayLike] = None,
        translate: VectorLike = (0, 0, 0),
        rotate: VectorLike = (1, 0, 0, 0),
        scale: float = 1.0,
        name: Optional[str] = None,
    ) -> Obstacle:
        """Adds a body that cloth collides with; returns its handle.

        mesh, faces, shape and placement: as for `add_cloth`. glTF, FBX and DAE files bring their skeletal animation:
        `clip` is its name or index, "bind" for a still body, `animation` another file to take it from, `y_up` turns y-up files to z-up,
        `lead_in` eases from the bind pose into the clip for so many seconds, `loops` plays it so often. Shapes are, for
        example, {"sphere": {"radius": 0.25}}, {"box": {"size": [1, 1, 0.1]}} or {"walker": {}}; {"shape": {"sphere": {"radius": 0.25}}},
        and likewise capsule, box and plane, is exact instead of meshed.
        motion: a cama.Motion, or a dict of its arguments; with one, a file's own animation is left out.
        friction, static_friction: Coulomb coefficients against cloth while it slides and while it sticks (None: the same).
        thickness: contact thickness, m, contact_stiffness: penalty, N/m^3 (None: the scene's). Throws as `add_cloth`.
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
        place = placement(transform, translate, rotate, scale)
        matrix = place.tolist()
        if motion is None and isinstance(mesh, (str, os.PathLike)) and (animation is not None or _animated(mesh)):
            character = _core.load_character(
                Path(mesh),
                str(clip),
                Path(animation or ""),
                1.0,
                float(samples_per_second),
                bool(y_up),
                number(f"{name}: lead_in", lead_in),
                int(loops),
            )
            obstacle.source = str(mesh)
            body, moving = character.mesh, character.motion
        else:
            part, obstacle.source = self._part("obstacle", name, mesh, faces, shape)
            body, moving = part.mesh, part.motion
            if part.surface != "mesh":
                obstacle.surface = part.surface
                obstacle.radius = part.radius * uniform_scale(name, part.surface, place[:3, :3])
        if motion is not None:
            moving = _core.Motion(Motion.of(motion))
        body.transform(matrix)
        moving.transform(matrix)
        if obstacle.surface == "mesh":
            body.validate(name)
        obstacle.mesh, obstacle.motion = body, moving
        for key, value in numbers.items():
            setattr(obstacle, key, value)
        return Obstacle(self, self._core.add_obstacle(obstacle))

    def _part(
        self, kind: str, name: str, mesh: Any, faces: Optional[ArrayLike], shape: Optional[Description], *material: Any
    ) -> tuple[Any, str]:
        """A compiled Cloth or Obstacle with the mesh that was asked for, and where it is from."""
        if (mesh is None) == (shape is None):
            raise SceneError(f"{name}: exactly one of mesh and shape is needed")
        if shape is not None:
            made = shape_scene(kind, name, shape)
            part = _core.Cloth(made.cloth(0)) if kind == "cloth" else _core.Obstacle(made.obstacle(0))
            return part, part.source
        part = _core.Cloth() if kind == "cloth" else _core.Obstacle()
        part.mesh, source = compiled_mesh(name, mesh, faces, *(material or (None, None)))
        return part, source

    def pin(
        self,
        cloth: Union[Cloth, int, str],
        vertices: ArrayLike,
        motion: Union[_core.Motion, dict[str, Any], None] = None,
        release: float = math.inf,
    ) -> None:
        """Holds cloth vertices in place, or moves them.

        cloth: a handle, index or name.  vertices: [k] integers.  motion: rigid cama.Motion (or dict) of their starting
        position, None: fixed.  release: time at which they are let go, s. Throws ArrayError, SceneError.
        """
        motion = Motion.of(motion)
        index, vertices = self._vertices("pin", cloth, vertices)
        self._core.add_pin(index, vertices, motion, None, float(release))

    def attach(
        self,
        cloth: Union[Cloth, int, str],
        vertices: ArrayLike,
        obstacle: Union[Obstacle, int, str],
        release: float = math.inf,
    ) -> None:
        """Lets cloth vertices follow the nearest point of an obstacle's surface; arguments as for `pin`."""
        index, vertices = self._vertices("attach", cloth, vertices)
        self._core.add_pin(index, vertices, Motion(), self._index("attach", obstacle, self.obstacles), float(release))

    def stitch(
        self,
        cloth_a: Union[Cloth, int, str],
        vertex_a: ArrayLike,
        cloth_b: Union[Cloth, int, str],
        vertex_b: ArrayLike,
        vertex_c: Optional[ArrayLike] = None,
        ratio: ArrayLike = 0.0,
        stiffness: float = 1e3,
    ) -> None:
        """Zero-length springs x_a = (1 - ratio) x_b + ratio x_c; x_c may be left out.

        vertex_a, vertex_b, vertex_c: [k] integers or one.  ratio: [k] or one, in [0, 1].  stiffness: N/m.
        Throws ArrayError, SceneError.
        """
        a, first = self._vertices("stitch", cloth_a, np.atleast_1d(vertex_a))
        b, second = self._vertices("stitch", cloth_b, np.atleast_1d(vertex_b))
        third = second if vertex_c is None else self._vertices("stitch", cloth_b, np.atleast_1d(vertex_c))[1]
        if not len(first) == len(second) == len(third):
            raise ArrayError(f"stitch: {len(first)} vertices a, {len(second)} b, {len(third)} c")
        ratio = np.broadcast_to(reals("stitch: ratio", np.atleast_1d(ratio), (None,)), (len(first),))
        for i, j, k, r in zip(first, second, third, ratio):
            self._core.add_stitch(a, int(i), b, int(j), int(k), float(r), number("stitch: stiffness", stiffness))

    def _index(self, what: str, part: Union[Part, int, str], parts: Sequence[Part]) -> int:
        if isinstance(part, Part):
            if part._scene is not self:
                raise SceneError(f"{what}: {part!r} belongs to another scene")
            return part.index
        for candidate in parts:
            if part in (candidate.index, candidate.name):
                return candidate.index
        raise SceneError(f"{what}: there is no {part!r}; there are {[p.name for p in parts]}")

    def _vertices(self, what: str, cloth: Union[Part, int, str], vertices: ArrayLike) -> tuple[int, Integers]:
        index = self._index(what, cloth, self.cloths)
        name, count = self.cloths[index].name, len(self.cloths[index].vertices)
        vertices = integers(f"{what}: {name}: vertices", vertices, (None,))
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
    def pins(self) -> list[dict[str, Any]]:
        """List of dicts: cloth (index), vertices [k], obstacle (index or None), release [s]."""
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
        """From one recorded frame to the next, s: frame_time; where that is 0, time_step; where that is 0 too, 1/60."""
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
    def wind(self) -> Optional[dict[str, Any]]:
        """None, or a dict with velocity, density and drag."""
        wind = self._core.wind
        return None if wind is None else {"velocity": wind.velocity, "density": wind.density, "drag": wind.drag}

    @wind.setter
    def wind(self, value: Optional[Mapping[str, Any]]) -> None:
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
        """Dict of options that `Simulation` uses where its caller gives none: `accuracy` and single options such as `tolerance`.

        `options` of scene.json; assign to change them. Where they run (`backend`, `device`, `threads`) and what a caller decides
        (`audit`, `intersections`, `pinch`) is refused, with a SceneError that names the option, and so is an unknown name or wrong type.
        """
        options: dict[str, Any] = json.loads(self._core.options or "{}")
        return options

    @options.setter
    def options(self, value: Mapping[str, Any]) -> None:
        value = dict(value)
        check_scene_options(value)
        self._core.options = json.dumps(value, sort_keys=True) if value else ""

    def __repr__(self) -> str:
        return (
            f"<cama.Scene {self.name!r}: {self._core.cloth_count} cloths with {self.triangle_count} triangles, "
            f"{self._core.obstacle_count} obstacles>"
        )
