# SPDX-License-Identifier: Apache-2.0
"""A generated human body that moves: `Body`."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, field

import numpy as np

from .arrays import number, whole
from .clearance import clear
from .errors import MeshError, SceneError
from .hints import brief, similar
from .isosurface import central_differences, decimated, outward, polygonise
from .motion import Motion
from .posing import BONES, GENERATED, JOINTS, LYING, MOTIONS, on_ground, periods, pose
from .rigging import HEIGHT, Rig, rig
from .skinning import skinned, smoothed
from .types import ArrayLike, Integers, PathLike, Reals

__all__ = ["Body"]

FINEST = 16_000  # triangles; a coarser grid would lose the thumbs, so that smaller meshes are decimated ones


@dataclass(frozen=True)
class _Shape:
    """A round cone from a to b with the radii at its ends, or an ellipsoid at a if there is no b."""

    a: tuple[float, float, float]
    radii: tuple[float, ...]
    b: tuple[float, float, float] | None = None
    axes: Reals | None = None  # [3, 3] rows, of an ellipsoid; None: x, y, z

    def distance(self, x: Reals) -> Reals:
        """Returns the signed distances [n], m; of an ellipsoid the first-order one."""
        offset = x - np.array(self.a)
        if self.b is None:
            offset = offset if self.axes is None else offset @ self.axes.T
            radii = np.array(self.radii)
            first, second = np.linalg.norm(offset / radii, axis=1), np.linalg.norm(offset / radii**2, axis=1)
            return first * (first - 1) / np.maximum(second, 1e-9)
        along = np.array(self.b) - np.array(self.a)
        t = np.clip(offset @ along / (along @ along), 0, 1)
        return np.linalg.norm(offset - t[:, None] * along, axis=1) - (
            self.radii[0] + t * (self.radii[1] - self.radii[0])
        )


def _trunk() -> list[_Shape]:
    shapes = [
        _Shape((0, 0.005, 1.275), (0.135, 0.098, 0.165)),  # rib cage
        _Shape((0, 0.0, 1.09), (0.116, 0.084, 0.16)),  # waist
        _Shape((0, 0.002, 0.935), (0.146, 0.1, 0.14)),  # pelvis
        _Shape((0, 0.014, 1.40), (0.047, 0.044), (0, 0.002, 1.53)),  # neck
    ]
    for side in (1.0, -1.0):
        shapes += [
            _Shape((side * 0.05, 0.008, 1.38), (0.056, 0.05), (side * 0.15, 0.008, 1.382)),  # shoulder girdle
            _Shape((side * 0.03, 0.016, 1.44), (0.036, 0.032), (side * 0.12, 0.012, 1.4)),  # trapezius
            _Shape((side * 0.068, -0.066, 1.25), (0.057, 0.053, 0.058)),  # breast
            _Shape((side * 0.074, 0.042, 0.895), (0.078, 0.074, 0.086)),  # buttock
        ]
    return shapes


def _head() -> list[_Shape]:
    return [
        _Shape((0, 0.008, 1.605), (0.074, 0.092, 0.094)),  # skull
        _Shape((0, -0.032, 1.556), (0.056, 0.058, 0.068)),  # face
        _Shape((0, -0.062, 1.506), (0.030, 0.026, 0.024)),  # chin
        _Shape((0, -0.087, 1.566), (0.011, 0.017, 0.026)),  # nose
    ]


def _arm(side: float) -> list[_Shape]:
    shoulder, elbow, wrist = (JOINTS[name + ("_left" if side > 0 else "_right")] for name in ("arm", "forearm", "hand"))
    along = (wrist - elbow) / np.linalg.norm(wrist - elbow)
    across = np.array([0.0, 1.0, 0.0])
    thin = np.cross(along, across)
    axes = np.stack([along, across, thin])

    def at(point: Reals, *offset: float) -> tuple[float, float, float]:
        x = point + np.array(offset or (0.0, 0.0, 0.0)) @ axes
        return float(x[0]), float(x[1]), float(x[2])

    return [
        _Shape(at(shoulder), (0.049, 0.036), at(elbow)),
        _Shape(at(shoulder, 0.05, 0, 0), (0.085, 0.050, 0.050), axes=axes),  # deltoid
        _Shape(at(elbow), (0.036, 0.025), at(wrist)),
        _Shape(at(elbow, 0.07, 0, 0), (0.09, 0.041, 0.038), axes=axes),  # forearm
        _Shape(at(wrist, 0.055, 0, 0), (0.060, 0.040, 0.0165), axes=axes),  # palm
        _Shape(at(wrist, 0.115, 0.002, 0), (0.062, 0.034, 0.0135), axes=axes),  # fingers
        _Shape(at(wrist, 0.03, -0.028, 0), (0.0135, 0.011), at(wrist, 0.085, -0.056, 0)),  # thumb
    ]


def _leg(side: float) -> list[_Shape]:
    end = "_left" if side > 0 else "_right"
    hip, knee, ankle = (JOINTS[name + end] for name in ("thigh", "shin", "foot"))

    def at(point: Reals, x: float, y: float, z: float) -> tuple[float, float, float]:
        return float(point[0] + side * x), float(point[1] + y), float(point[2] + z)

    return [
        _Shape(at(hip, 0, 0, 0), (0.080, 0.045), at(knee, 0, 0, 0)),
        _Shape(at(hip, 0.006, -0.006, -0.15), (0.072, 0.079, 0.19)),
        _Shape(at(knee, 0, -0.006, 0), (0.043, 0.047, 0.06)),
        _Shape(at(knee, 0, 0, 0), (0.044, 0.034), at(ankle, 0, 0, 0)),
        _Shape(at(knee, 0.002, 0.022, -0.125), (0.048, 0.047, 0.125)),  # calf
        _Shape(at(ankle, 0, 0.022, -0.046), (0.034, 0.040, 0.036)),  # heel
        _Shape(at(ankle, 0, -0.008, -0.03), (0.038, 0.025), at(ankle, 0.008, -0.115, -0.058)),
        _Shape(at(ankle, 0.010, -0.105, -0.058), (0.042, 0.085, 0.026)),  # ball and toes
    ]


def _blend(first: Reals, second: Reals, width: float) -> Reals:
    """Returns the smooth minimum of two distances (Quilez's polynomial, quadratic)."""
    part = np.maximum(width - np.abs(first - second), 0) / width
    return np.minimum(first, second) - 0.25 * width * part**2


def _union(shapes: list[_Shape], x: Reals, width: float) -> Reals:
    distance = shapes[0].distance(x)
    for shape in shapes[1:]:
        distance = _blend(distance, shape.distance(x), width)
    return distance


class _Surface:
    """The signed distance of the body and of its parts."""

    def __init__(self) -> None:
        self.head = _head()
        self.parts = [(_trunk(), 0.055), (_arm(1), 0.025), (_arm(-1), 0.025), (_leg(1), 0.03), (_leg(-1), 0.03)]

    def trunk(self, x: Reals) -> Reals:
        """Returns the distances [n] of trunk and neck, m."""
        shapes, width = self.parts[0]
        return _union(shapes, x, width)

    def arm(self, x: Reals, side: float) -> Reals:
        """Returns the distances [n] of the left arm, side 1, or the right one, -1, m."""
        shapes, width = self.parts[1 if side > 0 else 2]
        return _union(shapes, x, width)

    def leg(self, x: Reals, side: float) -> Reals:
        """Returns the distances [n] of the left leg, side 1, or the right one, -1, m."""
        shapes, width = self.parts[3 if side > 0 else 4]
        return _union(shapes, x, width)

    def part_distances(self, x: Reals) -> Reals:
        """Returns the distances [5, n] of trunk, left and right arm, left and right leg, m."""
        trunk, *limbs = (_union(shapes, x, width) for shapes, width in self.parts)
        return np.stack([_blend(trunk, _union(self.head, x, 0.02), 0.03), *limbs])

    def distance(self, x: Reals) -> Reals:
        """Returns the signed distances [n], m; the soles are flat."""
        trunk, *limbs = self.part_distances(x)
        joined = trunk
        for limb, width in zip(limbs, (0.04, 0.04, 0.05, 0.05)):
            joined = _blend(joined, _blend(trunk, limb, width), 0.01)  # limbs do not melt into each other
        return -_blend(-joined, x[:, 2] - 0.002, 0.01)

    def gradient(self, x: Reals) -> Reals:
        """Returns central differences [n, 3]."""
        return central_differences(self, x)


def _polygonise(surface: _Surface, triangles: int) -> tuple[Reals, Integers]:
    cell = math.sqrt(3.5 / max(triangles, FINEST))  # the body has an area of about 1.6 m^2
    vertices, faces = polygonise(surface, np.array([-0.82, -0.24, -0.05]), np.array([0.82, 0.19, 1.78]), cell)
    if len(faces) > 1.05 * triangles:
        vertices, faces = decimated(vertices, faces, triangles)
    return vertices, outward(vertices, faces)


@functools.lru_cache(maxsize=1)
def body_field() -> _Surface:
    """Returns the signed distance of a body of `HEIGHT` in the bind pose."""
    return _Surface()


def _skin(surface: _Surface, vertices: Reals, faces: Integers) -> Reals:
    """Returns the weights [vertices, bones]: 1 for the bone of a vertex's part, smoothed over the surface."""
    part = surface.part_distances(vertices).argmin(axis=0)
    bone = np.zeros(len(vertices), int)
    for name in ("spine", "chest", "neck", "head"):
        bone[(part == 0) & (vertices[:, 2] > JOINTS[name][2])] = BONES.index(name)
    chains = (("arm", "forearm", "hand"), ("thigh", "shin", "foot"))
    for limb in range(1, 5):
        end = "_left" if limb % 2 else "_right"
        names = [name + end for name in chains[limb > 2]]
        own = part == limb
        bone[own] = BONES.index(names[0])
        for before, name in zip(names, names[1:]):
            way = JOINTS[name] - JOINTS[before]
            past = own & ((vertices - JOINTS[name]) @ way > 0)
            bone[past] = BONES.index(name)
        if limb > 2:  # the foot begins at the ankle, whatever the direction of the shin
            low = own & (vertices[:, 2] < JOINTS[names[2]][2])
            bone[low] = BONES.index(names[2])
    return smoothed(np.eye(len(BONES))[bone], vertices, faces)


@functools.lru_cache(maxsize=2)
def _made(triangles: int) -> tuple[Reals, Integers, Reals]:
    """Returns vertices in the bind pose, faces and weights; they are kept for the next body of this process."""
    surface = body_field()
    bind, faces = _polygonise(surface, triangles)
    made = bind, faces, _skin(surface, bind, faces)
    for array in made:
        array.flags.writeable = False
    return made


@dataclass(frozen=True)
class Body:
    """A generated body of an adult that stands at the origin, looks along -y and moves.

    It has no file and no licence but that of cama: the surface is a smooth union of round cones and ellipsoids, which
    VTK polygonises; its vertices follow seventeen bones by dual quaternions. `Scene.add_obstacle` takes it in place of
    a mesh.

    Args:
        motion: "stand", "walk", "dance", "kick", "turn", "swing", "kungfu" or "fall". All are on the spot; "fall" ends
            lying, after one round.
        height: Height, m; None: 1.7, or that of `mesh`.
        triangles: Approximate number of triangles, from 5,000 to 50,000; not of a `mesh`.
        duration: How long it moves, s; the motion repeats.
        lead_in: Time in which it moves from the starting pose into the motion, s; part of the duration.
        start: The starting pose, "A" with lowered or "T" with level arms; of a `mesh` its own.
        period: Duration of one round of the motion, s; None: its own.
        samples_per_second: Frames that are computed, 1/s.
        mesh: Another body in place of the generated one, to which the motion is given: a mesh file, or (vertices
            [n, 3] in m, faces [m, 3]), closed and z up. It stands upright, with its arms away from its sides and its
            legs apart, and stays where it is; it may look along any axis.
        clearance: Distance that the limbs of a `mesh` keep from each other and from the trunk as it moves, m; 0: the
            motion stays as it is.

    Raises:
        SceneError, ArrayError: An argument is not one of these.
        FileError, MeshError: `mesh` cannot be read, or has not a head, two arms and two legs.
        BackendError: VTK is not installed, which the generated body needs.
    """

    motion: str = "stand"
    height: float | None = None
    triangles: int = 12_000
    duration: float = 5.0
    lead_in: float = 1.0
    start: str = "A"
    period: float | None = None
    samples_per_second: float = 60.0
    mesh: PathLike | tuple[ArrayLike, ArrayLike] | None = field(default=None, repr=False, compare=False)
    clearance: float = 0.0
    vertices: Reals = field(init=False, repr=False, compare=False)  #: [n, 3] m, at time 0
    faces: Integers = field(init=False, repr=False, compare=False)  #: [m, 3]
    weights: Reals = field(init=False, repr=False, compare=False)  #: [n, 17], of the bones `cama.posing.BONES`
    times: Reals = field(init=False, repr=False, compare=False)  #: [t] s
    positions: Reals = field(init=False, repr=False, compare=False)  #: [t, n, 3] m

    def __post_init__(self) -> None:
        self._check()
        rigged = None if self.mesh is None else self._rigged()
        if rigged is None:
            bind, faces, weights = _made(int(self.triangles))
            skeleton, own_height = GENERATED, HEIGHT
        else:
            (bind, faces), weights, skeleton = (rigged[0].vertices, rigged[1]), rigged[0].weights, rigged[0].skeleton
            own_height = rigged[0].scale * HEIGHT
        self._check_size(len(faces))
        count = max(1, math.ceil(self.duration * self.samples_per_second - 1e-9))
        times = np.linspace(0, self.duration, count + 1)
        how = self.start, self.period or periods[self.motion], skeleton
        rotations, translations = pose(self.motion, times, self.lead_in, *how)
        positions = np.stack([skinned(bind, weights, r, t) for r, t in zip(rotations, translations)])
        if self.motion in LYING:
            positions = on_ground(times, positions)
        if rigged is not None:
            if self.motion not in LYING:
                # it starts where its mesh is
                positions[..., 2] -= pose(self.motion, np.zeros(1), 1.0, *how)[1][0, 0, 2]
            if self.clearance > 0:
                positions = clear(bind, faces, times, positions, self.clearance, self.lead_in > 0).positions
            positions = rigged[0].placed(positions)
            scale = (self.height or own_height) / own_height
        else:
            scale = (self.height or HEIGHT) / HEIGHT
        positions = scale * positions
        for name, value in (
            ("faces", faces),
            ("weights", weights),
            ("times", times),
            ("positions", positions),
            ("vertices", positions[0]),
        ):
            object.__setattr__(self, name, value)

    def _rigged(self) -> tuple[Rig, Integers]:
        from .inputs import compiled_mesh  # which reads scenes, and with them this module

        mesh, faces = self.mesh if isinstance(self.mesh, tuple) else (self.mesh, None)
        read = compiled_mesh("body: mesh", mesh, faces, None, None)[0]
        return rig(read.vertices, read.faces, str(mesh) if faces is None else "body: mesh"), read.faces

    def _check(self) -> None:
        if not isinstance(self.motion, str) or self.motion not in MOTIONS:
            raise SceneError(
                f"body: motion: no {brief(repr(self.motion))}; there are {', '.join(MOTIONS)}"
                f"{similar(self.motion, MOTIONS)}"
            )
        if self.start not in ("A", "T"):
            raise SceneError(f'body: start: {brief(repr(self.start))} is neither "A" nor "T"')
        if self.mesh is not None and self.start != "A":
            raise SceneError("body: start: is for the generated body; a mesh starts in its own pose")
        whole("body: triangles", self.triangles)
        if not 5000 <= self.triangles <= 50_000:
            raise SceneError(f"body: triangles: must be from 5,000 to 50,000, got {self.triangles:,}")
        for name in ("height", "duration", "samples_per_second", "period"):
            value = getattr(self, name)
            if not (name in ("height", "period") and value is None) and not number(f"body: {name}", value) > 0:
                raise SceneError(f"body: {name}: must be greater than 0, got {value:g}")
        for name in ("lead_in", "clearance"):
            if number(f"body: {name}", getattr(self, name)) < 0:
                raise SceneError(f"body: {name}: must not be negative, got {getattr(self, name):g}")

    def _check_size(self, triangles: int) -> None:
        if self.duration * self.samples_per_second * triangles > 1e8:
            raise MeshError("body: duration times samples_per_second is too much; give less of either, or of triangles")

    def animation(self) -> Motion:
        """Returns the motion of its vertices."""
        return Motion(times=self.times, positions=self.positions)
