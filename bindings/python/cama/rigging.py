# SPDX-License-Identifier: Apache-2.0
"""Bones and skin for the mesh of a body that stands still, so that it can move as the generated body does.

Arms, legs and head are the parts that stick out from the middle of the surface (clearance.py). A limb's bones lie on
the line through the centres of its rings, at the same parts of its length as those of the generated body.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .clearance import limbs
from .errors import MeshError
from .posing import BONES, JOINTS, Skeleton
from .skinning import smoothed
from .types import Integers, Reals

__all__ = ["Rig", "rig"]

SIDES = "_left", "_right"
HEIGHT = 1.7  # m, of the generated body, to which a mesh is scaled
LEAST = 0.15, 0.12, 0.1, 0.08  # of the extent, by which arms, legs and head stick out; the first that does
LIFTED = 0.1  # of the height, by which one foot may be higher than the other
RINGS = 24  # of a limb
HIP = (0.95, 0.08)  # the hip joint: part of a thigh's distance from the middle; m above the crotch
SHOULDER = 0.172, 0.052  # m: the shoulder joint is so far from the middle, and so far below the skin
ELBOW, WRIST = 0.275 / 0.692, 0.515 / 0.692  # parts of the way from shoulder to fingertips, as of the generated body
CREASE = (0.17, 0.1)  # m, a point of the fold between leg and trunk: to the side; above the crotch
SOLE = 0.02  # m, above the lowest point of a foot, below which it is sole


@dataclass(frozen=True)
class Rig:
    """A mesh with bones: in its own place it is `scale * vertices @ turn + origin`."""

    vertices: Reals  #: [n, 3] m, 1.7 m high, on z = 0, the middle of the hips at x = 0, looking along -y
    weights: Reals  #: [n, 17] of the bones
    skeleton: Skeleton  #: the bones
    scale: float
    turn: Reals  #: [3, 3] a rotation about z
    origin: Reals  #: [3] m

    def placed(self, vertices: Reals) -> Reals:
        """Returns vertices [..., 3] of the rig where its mesh was."""
        return self.scale * vertices @ self.turn + self.origin


@dataclass(frozen=True)
class _Limb:
    """The centres of a limb's rings, from its root to its tip."""

    own: np.ndarray  # whether each vertex [n] is part of it
    centres: Reals  # [rings, 3] m
    root: Reals  # [3] the lowest point of the ring at its root

    def at(self, start: Reals, part: float) -> Reals:
        """Returns the point at a part of the length of the line from a start through the centres."""
        line = np.vstack([start, self.centres])
        length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
        return np.array([np.interp(part * length[-1], length, line[:, k]) for k in range(3)])

    def at_height(self, z: float) -> Reals:
        """Returns the point of the line of centres at a height."""
        order = np.argsort(self.centres[:, 2])
        x, y = (np.interp(z, self.centres[order, 2], self.centres[order, k]) for k in range(2))
        return np.array([x, y, z])


def rig(vertices: Reals, faces: Integers, name: str = "body") -> Rig:
    """Finds the bones of a standing body, z up, whose arms and legs are apart from the rest.

    Args:
        vertices: [n, 3] m.
        faces: [m, 3], closed.
        name: Of the body, in error texts.

    Raises:
        MeshError: The mesh has not one head, two arms and two legs, or does not stand along z.
    """
    vertices, faces = np.asarray(vertices, float), np.asarray(faces)
    height = float(np.ptp(vertices[:, 2]))
    if not np.isfinite(vertices).all() or not height > 0:
        raise MeshError(f"{name}: has no height; a body stands along z")
    ways = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    if (np.unique(ways, axis=0, return_counts=True)[1] != 2).any():
        raise MeshError(f"{name}: is not a closed surface, which a body that is to be moved must be")
    for least in LEAST:
        label, outwards = limbs(vertices, faces, least)
        arms, legs = _parts(vertices, label)
        if arms:
            break
    else:
        raise MeshError(
            f"{name}: a head, two arms and two legs are not what sticks out from the middle of the mesh: a body that "
            "is to be moved stands upright along z, its arms away from its sides and its legs apart"
        )
    turn = _facing(vertices, label, legs, height)
    scale = height / HEIGHT
    feet = vertices[np.isin(label, legs)]
    origin = np.array([*_middle(feet), vertices[:, 2].min()])
    x = (vertices - origin) @ turn.T / scale
    parts = {}
    for kind, pair in (("arm", arms), ("leg", legs)):
        sides = sorted(pair, key=lambda part: -x[label == part, 0].mean())
        for end, part in zip(SIDES, sides):
            parts[kind + end] = _limb(x, label == part, outwards)
    crotch = _crotch(x, faces, parts)
    joints = _joints(x, crotch, parts)
    soles = tuple(_sole(x[parts["leg" + end].own]) for end in SIDES)
    skeleton = Skeleton(joints, (soles[0], soles[1]), _turns(joints))
    weights = smoothed(np.eye(len(BONES))[_bones(x, parts, joints, crotch)], x, faces)
    return Rig(x, weights, skeleton, scale, turn, origin)


def _middle(points: Reals) -> Reals:
    """Returns the middle [2] of the box around points, seen from above."""
    return 0.5 * (points[:, :2].min(axis=0) + points[:, :2].max(axis=0))


def _parts(vertices: Reals, label: Integers) -> tuple[list[int], list[int]]:
    """Returns the labels of the arms and the legs; none if they are not those of a body that stands."""
    if label.max() != 5:
        return [], []
    low, high = (np.array([end(vertices[label == part, 2]) for part in range(1, 6)]) for end in (np.min, np.max))
    legs = [int(part) + 1 for part in np.argsort(low)[:2]]
    head = int(np.argmax(high)) + 1
    arms = [part for part in range(1, 6) if part != head and part not in legs]
    lifted = np.sort(low)[1] - low.min()
    return (arms, legs) if len(arms) == 2 and lifted < LIFTED * float(np.ptp(vertices[:, 2])) else ([], [])


def _facing(vertices: Reals, label: Integers, legs: list[int], height: float) -> Reals:
    """Returns the rotation about z, [3, 3], after which the body looks along -y: that way point the feet."""
    way = np.zeros(2)
    for leg in legs:
        x = vertices[label == leg]
        low = x[:, 2] - vertices[:, 2].min()
        foot, shin = x[low < 0.04 * height, :2], x[(low > 0.1 * height) & (low < 0.15 * height), :2]
        way += foot.mean(axis=0) - shin.mean(axis=0)
    angle = np.round((-np.pi / 2 - np.arctan2(way[1], way[0])) / (np.pi / 2)) * (np.pi / 2)  # in quarters
    return np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])


def _limb(x: Reals, own: np.ndarray, outwards: Reals) -> _Limb:
    way = outwards[own]
    edges = np.linspace(way.min(), way.max(), RINGS + 1)
    ring = np.clip(np.digitize(way, edges) - 1, 0, RINGS - 1)
    centres = np.stack([x[own][ring == k].mean(axis=0) for k in range(RINGS) if (ring == k).any()])
    tip = x[own][np.argmax(way)]
    first = x[own][way < way.min() + 0.02 * HEIGHT]
    return _Limb(own, np.vstack([centres, tip]), first[np.argmin(first[:, 2])])


def _crotch(x: Reals, faces: Integers, parts: dict[str, _Limb]) -> Reals:
    """Returns the point [3], m, at which the legs join: the surface below it is in two pieces, that above in one."""
    edges = np.unique(np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1), axis=0)
    highest = edges[np.arange(len(edges)), np.argmax(x[edges, 2], axis=1)]
    left, right = (int(np.flatnonzero(own)[np.argmin(x[own, 2])]) for own in (parts[f"leg{end}"].own for end in SIDES))
    parent = np.arange(len(x))

    def find(vertex: int) -> int:
        while parent[vertex] != vertex:
            parent[vertex] = parent[parent[vertex]]
            vertex = int(parent[vertex])
        return vertex

    for edge in np.argsort(x[highest, 2], kind="stable"):
        parent[find(int(edges[edge, 0]))] = find(int(edges[edge, 1]))
        if find(left) == find(right):
            return x[highest[edge]]
    raise MeshError("body: its legs are not joined")


def _joints(x: Reals, crotch: Reals, parts: dict[str, _Limb]) -> dict[str, Reals]:
    """Returns the joints of all bones, m."""
    joints = {}
    hip = crotch[2] + HIP[1]
    shoulders = []
    for end in SIDES:
        leg, arm = parts["leg" + end], parts["arm" + end]
        below = leg.at_height(crotch[2] - 0.03)
        joints["thigh" + end] = np.array([HIP[0] * below[0], below[1], hip])
        joints["shin" + end] = leg.at_height(JOINTS["shin_left"][2] / JOINTS["thigh_left"][2] * hip)
        joints["foot" + end] = leg.at_height(JOINTS["foot_left"][2])
        joints["foot" + end][:2] = leg.at_height(1.5 * JOINTS["foot_left"][2])[:2]  # rings further down are the foot's
        upper = arm.centres[2:9]  # on the upper arm; the first rings are cut off at a slant
        middle = upper.mean(axis=0)
        way = np.linalg.svd(upper - middle)[2][0]
        shoulder = middle + (np.sign(middle[0]) * SHOULDER[0] - middle[0]) / way[0] * way
        above = (np.abs(x[:, :2] - shoulder[:2]) < [0.015, 0.08]).all(axis=1)
        height = x[above, 2].max(initial=shoulder[2]) - SHOULDER[1]
        shoulder[2] = np.clip(height, shoulder[2] - SHOULDER[1], shoulder[2] + SHOULDER[1])
        joints["arm" + end] = shoulder
        joints["forearm" + end] = arm.at(shoulder, ELBOW)
        joints["hand" + end] = arm.at(shoulder, WRIST)
        shoulders.append(shoulder)
    low, high = JOINTS["thigh_left"][2], JOINTS["arm_left"][2]
    shoulder = np.mean(shoulders, axis=0)
    for name in ("pelvis", "spine", "chest", "neck", "head"):
        z = hip + (JOINTS[name][2] - low) / (high - low) * (shoulder[2] - hip)
        near = (np.abs(x[:, 2] - z) < 0.02) & (np.abs(x[:, 0]) < 0.15)
        joints[name] = np.array([0.0, _middle(x[near])[1] if near.any() else shoulder[1], z])
    return joints


def _turns(joints: dict[str, Reals]) -> dict[str, Reals]:
    """Returns the turns of the arms from where they are to where those of the generated body are, axis times angle."""
    turns = {}
    for end in SIDES:
        for name, before, after in (("arm", "arm", "forearm"), ("forearm", "forearm", "hand")):
            own, goal = (from_[after + end] - from_[before + end] for from_ in (joints, JOINTS))
            own, goal = own / np.linalg.norm(own), goal / np.linalg.norm(goal)
            axis = np.cross(own, goal)
            length = float(np.linalg.norm(axis))
            turns[name + end] = axis / max(length, 1e-12) * np.arctan2(length, own @ goal)
        turns["hand" + end] = turns["forearm" + end]
    return turns


def _bones(x: Reals, parts: dict[str, _Limb], joints: dict[str, Reals], crotch: Reals) -> Integers:
    """Returns the bone [n] that each vertex belongs to."""
    bone = np.zeros(len(x), int)
    for name in ("spine", "chest", "neck", "head"):
        bone[x[:, 2] > joints[name][2]] = BONES.index(name)
    limb = np.any([part.own for part in parts.values()], axis=0)
    for end, side in zip(SIDES, (1.0, -1.0)):
        arm, leg = parts["arm" + end], parts["leg" + end]
        shoulder = joints["arm" + end]
        fold = (arm.root - shoulder)[[0, 2]]  # from the shoulder to the armpit, in the plane of x and z
        under = np.minimum(x[:, 2] - shoulder[2], 0)  # above the joint the arm ends at a vertical plane
        out = side * (fold[0] * under - fold[1] * (x[:, 0] - shoulder[0]))
        cap = ~limb & (out > 0) & (side * x[:, 0] > 0) & (x[:, 2] > arm.root[2])
        chain = (("arm", arm.own | cap), ("forearm", arm.own), ("hand", arm.own))
        _assign(bone, x, joints, end, chain)
        below = CREASE[1] * (side * x[:, 0]) - CREASE[0] * (x[:, 2] - crotch[2])
        fold_of_leg = ~limb & (below > 0) & (side * x[:, 0] > 0) & (x[:, 2] < joints["spine"][2])
        whole = leg.own | fold_of_leg
        _assign(bone, x, joints, end, (("thigh", whole), ("shin", leg.own), ("foot", leg.own)))
        bone[leg.own & (x[:, 2] < joints["foot" + end][2])] = BONES.index("foot" + end)
    return bone


def _assign(bone: Integers, x: Reals, joints: dict[str, Reals], end: str, chain: object) -> None:
    before = None
    for name, own in chain:  # type: ignore[attr-defined]
        joint = joints[name + end]
        past = own if before is None else own & ((x - joint) @ (joint - before) > 0)
        bone[past] = BONES.index(name + end)
        before = joint


def _sole(leg: Reals) -> Reals:
    """Returns points [k, 3] of a sole, on the ground: the outermost ones in eight directions."""
    sole = leg[leg[:, 2] < leg[:, 2].min() + SOLE]
    angles = np.arange(8) * (np.pi / 4)
    chosen = np.argmax(sole[:, :2] @ np.stack([np.cos(angles), np.sin(angles)]), axis=0)
    return np.unique(sole[chosen], axis=0) * [1, 1, 0]
