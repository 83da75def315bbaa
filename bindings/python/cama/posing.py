# SPDX-License-Identifier: Apache-2.0
"""The skeleton of the generated body, and the motions that were made for it.

The body looks along -y, with z up and its left at +x. Angles are about the axes of the world in the bind pose, in which
the arms are lowered by 42 degrees from level.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Callable

import numpy as np

from .types import Reals

__all__ = ["BONES", "JOINTS", "MOTIONS", "PARENTS", "Skeleton", "pose"]

ARM = math.radians(48)  # from the vertical, in the bind pose
SOLES = 0.003  # m, over which the lowest point of the feet is smoothed in time


def _skeleton() -> tuple[dict[str, Reals], dict[str, str]]:
    joints = {
        "pelvis": (0, 0, 0.95),
        "spine": (0, 0.005, 1.03),
        "chest": (0, 0.01, 1.17),
        "neck": (0, 0.012, 1.43),
        "head": (0, 0.0, 1.515),
    }
    parents = {"pelvis": "", "spine": "pelvis", "chest": "spine", "neck": "chest", "head": "neck"}
    way = np.array([math.sin(ARM), 0.0, -math.cos(ARM)])
    shoulder = np.array([0.172, 0.008, 1.388])
    own = {
        "arm": shoulder,
        "forearm": shoulder + 0.275 * way,
        "hand": shoulder + 0.515 * way + [0, -0.02, 0],
        "thigh": (0.092, 0.002, 0.9),
        "shin": (0.1, -0.004, 0.485),
        "foot": (0.106, 0.014, 0.085),
    }
    for end, side in (("_left", 1.0), ("_right", -1.0)):
        for name, joint in own.items():
            joints[name + end] = tuple(np.array(joint) * [side, 1, 1])
        for first, second, third, trunk in (("arm", "forearm", "hand", "chest"), ("thigh", "shin", "foot", "pelvis")):
            parents.update({first + end: trunk, second + end: first + end, third + end: second + end})
    return {name: np.array(joint, float) for name, joint in joints.items()}, parents


JOINTS, _parent = _skeleton()
BONES = list(JOINTS)
PARENTS = [BONES.index(_parent[name]) if _parent[name] else -1 for name in BONES]  #: index of a bone's parent, -1: none
SOLE = ((0.052, 0.0), (0.04, 0.022), (0.04, -0.022), (-0.1, -0.025), (-0.1, 0.04), (-0.17, 0.01))  # m, from the ankle


def _soles() -> tuple[Reals, Reals]:
    made = []
    for end, side in (("_left", 1.0), ("_right", -1.0)):
        x, y, _ = JOINTS["foot" + end]
        made.append(np.array([[x + side * across, y + along, 0.0] for along, across in SOLE]))
    return made[0], made[1]


@dataclass(frozen=True)
class Skeleton:
    """Bones of a body of 1.7 m, in the pose that it starts from."""

    joints: Mapping[str, Reals]  #: [3] m, of each bone where it begins
    soles: tuple[Reals, Reals]  #: points [k, 3] under the left and the right foot, m
    turns: Mapping[str, Reals] = field(default_factory=dict)  #: axis times angle, rad, [3], that brings a bone from the
    #: starting pose to that of the generated body, to which the angles of the motions belong


GENERATED = Skeleton(JOINTS, _soles())  #: of the generated body


class _Pose:
    """Angles of all bones at the times of an animation."""

    def __init__(self, count: int) -> None:
        self.count, self.angles, self.shift = (
            count,
            {name: np.zeros((count, 3)) for name in BONES},
            np.zeros((count, 3)),
        )

    def turn(self, bone: str, x: object = 0.0, y: object = 0.0, z: object = 0.0) -> None:
        """Adds angles to a bone, degrees."""
        self.angles[bone] += np.stack([np.broadcast_to(np.asarray(a, float), self.count) for a in (x, y, z)], axis=1)

    def both(self, bone: str, x: object = 0.0, y: object = 0.0, z: object = 0.0) -> None:
        """Adds angles to the left bone, and their mirror image to the right one, degrees."""
        self.turn(bone + "_left", x, y, z)
        self.turn(bone + "_right", x, -np.asarray(y, float), -np.asarray(z, float))

    def sway(self, side: Reals) -> None:
        """Shifts the pelvis to its left [t], m, over feet that stay where they are."""
        self.shift[:, 0] += side
        lean = np.degrees(np.arcsin(np.clip(side / 0.82, -0.5, 0.5)))
        for end in ("_left", "_right"):
            self.turn("thigh" + end, y=lean)
            self.turn("foot" + end, y=-lean)


def _bump(x: Reals) -> Reals:
    """Returns a smooth bump over the first half of each round of x [t], 1 at its middle; three times differentiable."""
    return np.maximum(np.sin(2 * np.pi * x), 0) ** 4


def _stand(p: _Pose, x: Reals) -> None:
    breath, slow = np.sin(4 * np.pi * x), np.sin(2 * np.pi * x)
    p.both("arm", y=28 + 0.8 * breath)
    p.both("forearm", x=-9 - breath)
    p.turn("chest", x=-1.2 * breath)
    p.turn("spine", y=1.0 * slow)
    p.turn("head", x=1.0 * breath, z=5 * slow)
    p.sway(0.012 * slow)


def _walk(p: _Pose, x: Reals) -> None:
    s, c = np.sin(2 * np.pi * x), np.cos(2 * np.pi * x)
    p.turn("pelvis", y=2 * c, z=5 * s)
    p.turn("spine", x=1.5, y=-1.5 * c, z=-6 * s)
    p.turn("chest", z=-5 * s)
    p.turn("head", z=5 * s)
    for end, side in (("_left", 1.0), ("_right", -1.0)):
        ahead, lifted = side * s, np.maximum(side * c, 0) ** 2
        p.turn("thigh" + end, x=-24 * ahead - 10 * lifted, y=-2 * c, z=-4 * s)
        p.turn("shin" + end, x=44 * lifted + 5)
        p.turn("foot" + end, x=-16 * lifted + 5 + 6 * ahead)
        p.turn("arm" + end, x=20 * ahead, y=side * 24)
        p.turn("forearm" + end, x=-20 + 10 * ahead)


def _dance(p: _Pose, x: Reals) -> None:
    s, c, fast = np.sin(2 * np.pi * x), np.cos(2 * np.pi * x), np.sin(4 * np.pi * x)
    p.sway(0.07 * s)
    p.turn("pelvis", y=5 * s, z=14 * c)
    p.turn("spine", y=-6 * s, z=-10 * c)
    p.turn("chest", x=2 * fast, y=-5 * s, z=-12 * c)
    p.turn("neck", y=4 * s)
    p.turn("head", y=4 * s, z=10 * c)
    for end, side in (("_left", 1.0), ("_right", -1.0)):
        lifted = _bump(x if side < 0 else x + 0.5)  # the foot that carries no weight
        p.turn("thigh" + end, x=-30 * lifted - 5 + 3 * fast, y=side * -6 - 5 * s, z=-14 * c * 0.8)
        p.turn("shin" + end, x=52 * lifted + 10 - 6 * fast)
        p.turn("foot" + end, x=-18 * lifted - 5 + 3 * fast, y=side * 6)
        p.turn("arm" + end, x=-12 + 10 * side * c, y=-side * 14 + 16 * s, z=-side * 4)
        p.turn("forearm" + end, x=-40 + 12 * fast, y=-side * 22 - 8 * s)
        p.turn("hand" + end, y=side * 10 * fast)


def _kick(p: _Pose, x: Reals) -> None:
    lift, strike, breath = _bump(x), np.maximum(np.sin(2 * np.pi * (x - 0.04)), 0) ** 10, np.sin(2 * np.pi * x)
    p.sway(0.045 * lift)
    p.turn("pelvis", x=6 * lift, z=8 * lift)
    p.turn("spine", x=8 * lift, y=1 * breath)
    p.turn("chest", x=-6 * lift, z=-10 * lift)
    p.turn("head", x=-6 * lift)
    p.turn("thigh_left", x=-6 * lift - 4, z=-8 * lift)
    p.turn("shin_left", x=8 + 4 * lift)
    p.turn("foot_left", x=-4 - 4 * lift)
    p.turn("thigh_right", x=-72 * lift - 4)
    p.turn("shin_right", x=8 + 75 * lift - 78 * strike)
    p.turn("foot_right", x=-4 + 25 * lift)
    p.both("arm", x=-12 - 14 * lift, y=18 - 10 * lift)
    p.both("forearm", x=-48 - 10 * lift)


def _turn(p: _Pose, x: Reals) -> None:
    p.turn("pelvis", z=360 * x)
    steps = 8 * np.pi * x  # four steps of each foot in a round
    s, c = np.sin(steps), np.cos(steps)
    p.turn("pelvis", y=1.5 * c)
    p.turn("spine", z=6 * np.sin(2 * np.pi * x), y=-1.5 * c)
    for end, side in (("_left", 1.0), ("_right", -1.0)):
        lifted = np.maximum(side * c, 0) ** 2
        p.turn("thigh" + end, x=-14 * lifted - 3, y=-side * 3, z=8 * side * s)
        p.turn("shin" + end, x=28 * lifted + 6)
        p.turn("foot" + end, x=-14 * lifted - 3, y=side * 3)
        p.turn("arm" + end, x=6 * side * s, y=side * 12)
        p.turn("forearm" + end, x=-18)


def _window(x: Reals, centre: float, width: float) -> Reals:
    """Returns a bump of x [t] around a part of each round, 1 at its centre, 0 from half the width on."""
    away = np.abs((x - centre + 0.5) % 1 - 0.5) / width
    return np.where(away < 0.5, np.cos(np.pi * np.minimum(away, 0.5)) ** 4, 0)


def _swing(p: _Pose, x: Reals) -> None:
    beat = 12 * np.pi * x  # six steps in a round
    spin, rocking = _eased((x % 1 - 0.55) / 0.3), 1 - _window(x, 0.7, 0.5)
    s, c, bounce = np.sin(beat / 2), np.cos(beat / 2), np.sin(beat)
    p.sway(0.05 * s * rocking)
    p.turn("pelvis", y=4 * s * rocking, z=360 * (np.floor(x) + spin) + 18 * c * rocking - 18)
    p.turn("spine", x=3 + 2 * bounce, y=-5 * s * rocking, z=-10 * c * rocking)
    p.turn("chest", x=2, z=-10 * c * rocking)
    p.turn("head", z=8 * c * rocking)
    turning = _window(x, 0.7, 0.5)
    for end, side in (("_left", 1.0), ("_right", -1.0)):
        lifted = np.maximum(side * s, 0) ** 4 * (1 - 0.6 * turning)
        p.turn("thigh" + end, x=-34 * lifted - 8 + 4 * bounce, y=-side * 5, z=-8 * c * rocking)
        p.turn("shin" + end, x=58 * lifted + 15 - 8 * bounce)
        p.turn("foot" + end, x=-20 * lifted - 7 + 4 * bounce, y=side * 5)
        p.turn("arm" + end, x=-16 + 12 * side * c * rocking, y=-side * (14 + 16 * turning) + 8 * s * rocking)
        p.turn("forearm" + end, x=-36 * (1 - 0.7 * turning) + 8 * bounce, y=-side * 14)


def _kungfu(p: _Pose, x: Reals) -> None:
    front, side_kick = _window(x, 0.16, 0.3), _window(x, 0.46, 0.3)
    front_strike, side_strike = _window(x, 0.175, 0.14), _window(x, 0.475, 0.14)
    right, left = _window(x, 0.32, 0.16), _window(x, 0.62, 0.16)  # punches
    spin, turning = _eased((x % 1 - 0.7) / 0.24), _window(x, 0.82, 0.26)
    p.sway(0.05 * front - 0.05 * side_kick)
    p.turn("pelvis", x=8 * front, y=-16 * side_kick, z=360 * (np.floor(x) + spin) + 14 * right - 14 * left)
    p.turn("spine", x=8 * front + 4, y=6 * side_kick, z=8 * right - 8 * left)
    p.turn("chest", x=-4 * front, y=6 * side_kick, z=14 * right - 14 * left)
    p.turn("head", x=-6 * front, z=-22 * right + 22 * left)
    kicks = {"_right": (front, front_strike, 0.0, 0.0), "_left": (0.0, 0.0, side_kick, side_strike)}
    for end, side in (("_left", 1.0), ("_right", -1.0)):
        ahead, ahead_strike, aside, aside_strike = kicks[end]
        lifted = 0.35 * turning * (side > 0)
        p.turn("thigh" + end, x=-80 * ahead - 20 * aside - 12 - 60 * lifted, y=-side * (6 + 58 * aside))
        p.turn("shin" + end, x=22 + 70 * ahead - 88 * ahead_strike + 66 * aside - 84 * aside_strike + 90 * lifted)
        p.turn("foot" + end, x=-10 + 20 * ahead, y=side * 6 * (1 - aside))
        punch = right if side < 0 else left
        p.turn("arm" + end, x=-22 - 50 * punch, y=side * (10 - 12 * punch - 22 * turning - 10 * aside - 8 * front))
        p.turn("forearm" + end, x=-62 + 44 * punch + 40 * turning, y=-side * 6 * (1 - punch))


def _fall(p: _Pose, x: Reals) -> None:
    x = np.clip(x, 0, 1)  # it ends on the ground
    tipped = _eased((x - 0.02) / 0.42) ** 1.5
    rolled, sat = _eased((x - 0.52) / 0.4), _window(np.minimum(x, 0.6), 0.26, 0.44)
    flung, lying = _window(np.minimum(x, 0.6), 0.24, 0.46), _eased((x - 0.3) / 0.2)
    close = _eased((x - 0.42) / 0.14) * _eased((1 - x) / 0.2)  # arms along the body while it rolls
    p.turn("pelvis", x=-90 * tipped, y=180 * rolled)
    p.turn("spine", x=14 * sat)
    p.turn("chest", x=10 * sat)
    p.turn("head", x=16 * sat)
    for end, side in (("_left", 1.0), ("_right", -1.0)):
        p.turn("thigh" + end, x=-52 * sat - (8 if side > 0 else 4) * sat, y=-side * (5 * lying + 4 * sat))
        p.turn("shin" + end, x=64 * sat + side * 6 * sat)
        p.turn("foot" + end, x=-8 * sat + 45 * rolled)
        p.turn("arm" + end, x=-34 * flung, y=-side * (20 * flung + 4 * lying - 40 * close))
        p.turn("forearm" + end, x=-30 * flung)


MOTIONS: dict[str, Callable[[_Pose, Reals], None]] = {
    "stand": _stand,
    "walk": _walk,
    "dance": _dance,
    "kick": _kick,
    "turn": _turn,
    "swing": _swing,
    "kungfu": _kungfu,
    "fall": _fall,
}
periods = {"stand": 4.0, "walk": 1.15, "dance": 1.6, "kick": 2.4, "turn": 4.0}  #: s, of one round
periods.update(swing=3.6, kungfu=4.8, fall=3.2)
LYING = ("fall",)  #: motions that leave the feet, whose height the lowest vertex of the body gives
SETTLING = 0.025  # s, over which that height is smoothed


def _eased(t: Reals) -> Reals:
    """Returns 0 to 1 with two vanishing derivatives at both ends."""
    t = np.clip(t, 0, 1)
    return t**3 * (10 + t * (6 * t - 15))


def _matrices(angles: Reals) -> Reals:
    """Returns the rotation matrices [t, 3, 3] about x, then y, then z of angles [t, 3], degrees."""
    (cx, cy, cz), (sx, sy, sz) = np.cos(np.radians(angles)).T, np.sin(np.radians(angles)).T
    rows = [
        [cy * cz, sx * sy * cz - cx * sz, cx * sy * cz + sx * sz],
        [cy * sz, sx * sy * sz + cx * cz, cx * sy * sz - sx * cz],
        [-sy, sx * cy, cx * cy],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def _turned(turn: Reals, amount: Reals) -> Reals:
    """Returns the rotation matrices [t, 3, 3] of parts [t] of a turn, axis times angle [3] in rad (Rodrigues)."""
    angle = float(np.linalg.norm(turn))
    axis = turn / max(angle, 1e-12)
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    part = (amount * angle)[:, None, None]
    return np.eye(3) + np.sin(part) * cross + (1 - np.cos(part)) * (cross @ cross)


def pose(
    motion: str, times: Reals, lead_in: float, start: str, period: float, skeleton: Skeleton = GENERATED
) -> tuple[Reals, Reals]:
    """Returns the rotations [t, bones, 3, 3] and translations [t, bones, 3] of the bones: x becomes R x + t.

    Args:
        motion: A name in `MOTIONS`.
        times: Times [t], s.
        lead_in: Time in which the motion grows out of the starting pose, s.
        start: "A" or "T", the starting pose.
        period: Duration of one round of the motion, s.
        skeleton: The bones.
    """
    moving = _Pose(len(times))
    share = times / lead_in if lead_in > 0 else np.full(len(times), 1.0)
    amount = _eased(share)
    begun = np.clip(share, 0, 1)  # the motion starts slowly: its phase is the integral of `amount`
    phase = np.maximum(times - lead_in, 0) + (lead_in * begun**4 * (2.5 + begun * (begun - 3)) if lead_in > 0 else 0)
    MOTIONS[motion](moving, phase / period)
    for name in BONES:
        moving.angles[name] *= amount[:, None]
    if start == "T":
        moving.both("arm", y=-42 * (1 - amount))
    moving.shift *= amount[:, None]
    turned = np.empty((len(times), len(BONES), 3, 3))  # from the bind pose of the generated body
    rotations = np.empty((len(times), len(BONES), 3, 3))
    translations = np.empty((len(times), len(BONES), 3))
    for bone, (name, parent) in enumerate(zip(BONES, PARENTS)):
        own, joint = _matrices(moving.angles[name]), skeleton.joints[name]
        turned[:, bone] = own if parent < 0 else turned[:, parent] @ own
        rotations[:, bone] = turned[:, bone]
        if name in skeleton.turns:
            rotations[:, bone] = turned[:, bone] @ _turned(skeleton.turns[name], amount)
        at = moving.shift + joint if parent < 0 else translations[:, parent] + rotations[:, parent] @ joint
        translations[:, bone] = at - rotations[:, bone] @ joint
    if motion not in LYING:
        translations[:, :, 2] -= _lowest(rotations, translations, skeleton.soles)[:, None]
    return rotations, translations


def on_ground(times: Reals, positions: Reals) -> Reals:
    """Returns positions [t, n, 3] at the times [t], s, lowered so that their lowest point stays on the ground."""
    lowest = positions[:, :, 2].min(axis=1)
    weight = np.exp(-0.5 * ((times[:, None] - times[None]) / SETTLING) ** 2)
    lowest = weight @ lowest / weight.sum(axis=1)
    return positions - lowest[:, None, None] * np.array([0.0, 0.0, 1.0])


def _lowest(rotations: Reals, translations: Reals, soles: tuple[Reals, Reals]) -> Reals:
    """Returns the height [t] of the lowest point of the soles, smoothed where one foot takes over from the other, m."""
    heights = []
    for end, points in zip(("_left", "_right"), soles):
        bone = BONES.index("foot" + end)
        for point in points:
            heights.append((rotations[:, bone] @ point + translations[:, bone])[:, 2])
    stacked = np.stack(heights)
    least = stacked.min(axis=0)
    share = np.exp(-(stacked - least) / SOLES).sum(axis=0) / (len(heights) // 2)  # 1 on one flat foot
    return least - SOLES * np.log(share)
