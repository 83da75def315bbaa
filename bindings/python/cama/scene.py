# SPDX-License-Identifier: Apache-2.0
"""Scenes: cloth, obstacles, pins and stitches."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from . import _core, collision, scene_files
from .arrays import number, vector
from .body import Body
from .errors import ArrayError
from .hints import counted, naming_files
from .inputs import compiled_gas, compiled_part, file_frame, placement, shrinkage_rows, texture_scale, uniform_scale
from .io.characters import keep_limbs_apart
from .material import Material
from .motion import Motion
from .obstacle_meshes import Playback, joint_names, mesh_and_motion
from .parts import Cloth, Obstacle
from .rigid import Rigid
from .scene_parts import SceneParts
from .scene_values import switch
from .types import ArrayLike, Description, MeshLike, PathLike, Unit, VectorLike
from .welding import Weld, weld_mesh

if TYPE_CHECKING:
    from typing_extensions import Self

__all__ = ["Scene", "Cloth", "Obstacle"]


class Scene(SceneParts):
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

    __slots__ = ()

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
        super().__init__(_core.Scene(), Path())
        self.gravity, self.wind = gravity, wind
        self.time_step, self.frames, self.frame_time = time_step, frames, frame_time
        self._core.name, self._core.description = str(name), str(description)
        own = self._core.contact
        own.enabled, own.self = switch("contact", contact), switch("self_contact", self_contact)
        own.thickness = number("thickness", thickness)
        if stiffness is not None:
            own.stiffness = number("stiffness", stiffness)
        if friction is not None:
            own.friction = number("friction", friction)
        if static_friction is not None:
            own.static_friction = number("static_friction", static_friction)

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
        return cls._of(*scene_files.load(scene, resolution))

    @classmethod
    @naming_files()
    def parse(cls, text: str | Description, folder: PathLike = ".", resolution: int = 0) -> Self:
        """Makes a scene from JSON text or a dict, as in scene.json.

        Args:
            text: JSON text, or a dict.
            folder: Folder that relative file names start at.
            resolution: As for `load`.
        """
        return cls._of(scene_files.parse(text, Path(folder), resolution), Path(folder))

    def to_json(self) -> str:
        """Returns the whole scene as JSON text that contains its meshes."""
        return self._core.save()

    def save(self, path: PathLike) -> None:
        """Writes `to_json()` to a file; `Scene.load(path)` reads the same scene. Raises FileError."""
        scene_files.save(path, self.to_json())

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
        cloth, cloth_source = compiled_part(
            "cloth", name, mesh, faces, shape, material_vertices, material_faces, unit > 0, unit or 1.0
        )
        cloth.material_scale = unit or cloth.material_scale  # a shape may be a file with its own
        cloth.name, cloth.source = name, cloth_source
        cloth.mesh.transform((placement(transform, translate, rotate, scale) @ frame).tolist())
        cloth.mesh.scale_material(number(f"{name}: scale", scale) * (1.0 if unit else length))
        renumbered = weld_mesh(name, cloth, weld, shape)
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
            rigid: A `cama.Rigid` or a dict of its arguments, which makes a mesh or a box a body that gravity, cloth and
                other obstacles move.
            friction: Coulomb coefficient against cloth; of a rigid body and another obstacle the mean of both counts.
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
        playback = Playback(
            str(clip),
            animation,
            samples_per_second,
            y_up,
            lead_in,
            loops,
            joint_names(f"{name}: leave_out", leave_out),
            None if clearance is None else number(f"{name}: clearance", clearance),
        )
        body, moving, character = mesh_and_motion(obstacle, mesh, faces, shape, motion is not None, playback)
        if obstacle.shape != "mesh":
            obstacle.radius *= uniform_scale(name, obstacle.shape, place[:3, :3])
        if motion is not None:
            moving = _core.Motion(Motion.of(motion))
        body.transform(place.tolist())
        moving.transform(place.tolist())
        obstacle.mesh, obstacle.motion = body, moving
        weld_mesh(name, obstacle, weld, shape)
        if obstacle.shape == "mesh":
            obstacle.mesh.validate(name)
        if character:
            keep_limbs_apart(obstacle, character, playback.clearance)
        for key, value in numbers.items():
            setattr(obstacle, key, value)
        if rigid is not None:
            obstacle.rigid = Rigid.of(name, rigid)
        return Obstacle(self, self._core.add_obstacle(obstacle))

    def __repr__(self) -> str:
        return (
            f"<cama.Scene {self.name!r}: {counted(self._core.cloth_count, 'cloth')} with "
            f"{counted(self.triangle_count, 'triangle')}, {counted(self._core.obstacle_count, 'obstacle')}>"
        )
