# SPDX-License-Identifier: Apache-2.0
"""Room between the limbs of an animated body that pass through each other, so that cloth between them has a way out.

Clips are made for pictures: an arm sinks into a hip, one thigh into the other, and nobody sees it. Cloth there would be
pinched between two parts of one obstacle. `clear` bends whole limbs aside in every frame, until they keep a gap.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .types import Integers, Reals

__all__ = ["Cleared", "clear", "limbs"]

GAP = 0.01  # m, the default distance between limbs
ROUNDS = 6  # of search and correction in a frame
COARSE = 0.05  # s, between the frames that are looked at first; then all frames around those that were changed
SETTLE = 0.12  # s, over which displacements are smoothed in time
# Lengths below are fractions of the body's extent in the bind pose.
LIMB = 0.15  # what sticks out by less is no limb
SPACING = 0.018  # between the points that stand for the surface
CLUSTER = 0.05  # size of the groups of points that are compared first
REACH = 0.045  # how deep a limb may be inside of another part
CLOSING = 0.02  # by how much two points are closer than in the bind pose, if their parts touch
CLOSER = 2.5  # how many times as far apart they are in the bind pose
BEND = 0.6  # of a limb's length, over which its displacement grows from its root


@dataclass(frozen=True)
class Cleared:
    """What `clear` did."""

    positions: Reals  #: [frames, vertices, 3] m
    frames: int  #: frames that were changed
    vertices: int  #: vertices that were moved by more than a tenth of a millimetre in some frame
    largest: float  #: largest displacement, m


class _Limbs:
    """The limbs of a triangle mesh: what sticks out from its middle, measured over the surface.

    Vertices join in the order of their distance from the middle, farthest first. Where two growing parts that both
    reach far enough meet, both are limbs, and this distance is that of their roots (the merge tree of the distance,
    Edelsbrunner and Harer 2010, chapter VII).
    """

    def __init__(self, bind: Reals, faces: Integers, least: float = LIMB) -> None:
        self.extent, self.least = float(np.ptp(bind, axis=0).max()), least
        edges = np.unique(
            np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1), axis=0
        )
        self.outwards, joined = _distance_from_middle(bind, faces, edges)
        self.label = np.zeros(len(bind), int)  # [vertices] 0: the trunk
        self.root: list[float] = [0.0]
        self.tip: list[float] = [0.0]
        self._grow(edges, joined)
        first, length = np.array(self.root)[self.label], (np.array(self.tip) - np.array(self.root))[self.label]
        grown = np.clip((self.outwards - first) / np.maximum(BEND * length, 1e-12), 0, 1)
        self.bend = np.where(self.label > 0, grown**2 * (3 - 2 * grown), 0.0)  # [vertices] from 0 at the root to 1
        self.count = len(self.root)

    def _grow(self, edges: Integers, joined: Reals) -> None:
        outwards = self.outwards
        lower = np.where(outwards[edges[:, 0]] < outwards[edges[:, 1]], edges[:, 0], edges[:, 1])
        order = np.argsort(-outwards[lower], kind="stable")
        parent = np.arange(len(outwards))
        members: dict[int, list[int]] = {int(vertex): [int(vertex)] for vertex in np.flatnonzero(joined)}
        tip = {vertex: float(outwards[vertex]) for vertex in members}
        ended: set[int] = set()  # parts of the trunk

        def find(vertex: int) -> int:
            while parent[vertex] != vertex:
                parent[vertex] = parent[parent[vertex]]
                vertex = parent[vertex]
            return vertex

        for edge in order:
            a, b = find(int(edges[edge, 0])), find(int(edges[edge, 1]))
            if a == b or a not in members or b not in members:
                continue
            here = float(outwards[lower[edge]])
            long = [part for part in (a, b) if part in ended or tip[part] - here > self.least * self.extent]
            if len(long) == 2:
                for part in (a, b):
                    if part not in ended:
                        self.label[members[part]] = len(self.root)
                        self.root.append(here)
                        self.tip.append(tip[part])
            keep, drop = (a, b) if tip[a] >= tip[b] else (b, a)
            parent[drop] = keep
            if len(long) == 2 or keep in ended or drop in ended:
                ended.add(keep)
                members[keep] = []
            elif len(members[keep]) >= len(members[drop]):
                members[keep] += members[drop]
            else:
                members[keep] = members[drop] + members[keep]
            members.pop(drop)


def limbs(bind: Reals, faces: Integers, least: float = LIMB) -> tuple[Integers, Reals]:
    """Returns the limb [vertices] of each vertex, 0: the trunk, and its distance [vertices] from the middle, m.

    The distance is that over the edges of the triangles [m, 3] of the mesh with the vertices `bind` [n, 3], m. What
    sticks out by less than `least` times the extent is no limb.
    """
    found = _Limbs(bind, faces, least)
    return found.label, found.outwards


def _distance_from_middle(bind: Reals, faces: Integers, edges: Integers) -> tuple[Reals, Reals]:
    """Returns the shortest way over edges from the middle [vertices], m, and which vertices have one."""
    length = np.linalg.norm(bind[edges[:, 0]] - bind[edges[:, 1]], axis=1)
    away = np.linalg.norm(bind - 0.5 * (bind.min(axis=0) + bind.max(axis=0)), axis=1)
    used = np.zeros(len(bind), bool)
    used[faces] = True
    distance = np.full(len(bind), np.inf)
    distance[np.argmin(np.where(used, away, np.inf))] = 0.0
    both = np.concatenate([edges, edges[:, ::-1]])
    order = np.argsort(both[:, 1], kind="stable")
    near, own, length = both[order, 0], both[order, 1], np.tile(length, 2)[order]
    vertices, starts = np.unique(own, return_index=True)
    while len(edges):
        nearer = distance.copy()
        nearer[vertices] = np.minimum(distance[vertices], np.minimum.reduceat(distance[near] + length, starts))
        if (nearer == distance).all():
            break
        distance = nearer
    joined = np.isfinite(distance)
    return np.where(joined, distance, 0.0), joined


class _Surface:
    """Points that stand for a triangle mesh, the centres of its faces or of parts of large ones, in groups."""

    def __init__(self, bind: Reals, faces: Integers, limbs: _Limbs) -> None:
        self.faces, self.limbs, self.extent = faces, limbs, limbs.extent
        corners = bind[faces]
        longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
        parts = np.clip(np.ceil(longest / (SPACING * self.extent)), 1, 4).astype(int)
        owners, weights = [], []
        for count in np.unique(parts):
            own, inside = np.flatnonzero(parts == count), _subdivision(int(count))
            owners.append(np.repeat(own, len(inside)))
            weights.append(np.tile(inside, (len(own), 1)))
        self.owner = np.concatenate(owners)  # [points] face of a point
        self.weight = np.concatenate(weights)[:, :, None]  # [points, 3, 1] barycentric coordinates
        self.corner = faces[self.owner]  # [points, 3]
        self.bind_points = self.points(bind)
        self.label = limbs.label[self.corner].min(axis=1)
        self.label[(limbs.label[self.corner] != self.label[:, None]).any(axis=1)] = 0
        self.bend = self.points(limbs.bend[:, None])[:, 0]
        self.outwards = self.points(limbs.outwards[:, None])[:, 0]
        cell = np.floor(self.bind_points / (CLUSTER * self.extent)).astype(int)
        _, cluster = np.unique(np.column_stack([cell, self.label]), axis=0, return_inverse=True)
        self.cluster = cluster.ravel()
        self.order = np.argsort(self.cluster, kind="stable")
        self.cluster_start = np.concatenate([[0], np.cumsum(np.bincount(self.cluster))])
        self.cluster_label = self.label[self.order[self.cluster_start[:-1]]]
        centres = self._centres(self.bind_points)
        self.limb_clusters = np.flatnonzero(self.cluster_label > 0)
        self.apart = np.sqrt(_squared_distances(centres[self.limb_clusters], centres))

    def points(self, values: Reals) -> Reals:
        """Returns values [points, k] at the points from those at the vertices."""
        corner, weight = self.corner, self.weight
        return (
            values[corner[:, 0]] * weight[:, 0]
            + values[corner[:, 1]] * weight[:, 1]
            + values[corner[:, 2]] * weight[:, 2]
        )

    def normals(self, vertices: Reals) -> Reals:
        """Returns the unit normals [points, 3]."""
        a, b, c = (vertices[self.faces[:, k]] for k in range(3))
        normal = np.cross(b - a, c - a)
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
        return normal[self.owner]

    def _centres(self, points: Reals) -> Reals:
        return np.add.reduceat(points[self.order], self.cluster_start[:-1]) / np.diff(self.cluster_start)[:, None]

    def _members(self, cluster: int) -> Integers:
        return self.order[self.cluster_start[cluster] : self.cluster_start[cluster + 1]]

    def near(self, points: Reals) -> list[tuple[Integers, Integers]]:
        """Returns points of a group of a limb, and those of other parts that came close since the bind pose."""
        centres = self._centres(points)
        distance = np.sqrt(((points - centres[self.cluster]) ** 2).sum(axis=1))
        radius = np.maximum.reduceat(distance[self.order], self.cluster_start[:-1])
        own = self.limb_clusters
        apart = np.sqrt(_squared_distances(centres[own], centres))
        close = (apart - radius[own, None] - radius[None] < 0.5 * REACH * self.extent) & (
            self.apart - apart > 0.5 * CLOSING * self.extent
        )
        close &= self.cluster_label[own, None] != self.cluster_label[None]
        return [
            (self._members(own[row]), np.concatenate([self._members(other) for other in np.flatnonzero(close[row])]))
            for row in np.flatnonzero(close.any(axis=1))
        ]


def _subdivision(count: int) -> Reals:
    """Returns the barycentric coordinates [count^2, 3] of the centres of a triangle's equal parts."""
    inside = []
    for i in range(count):
        for j in range(count - i):
            inside.append((i + 1 / 3, j + 1 / 3))
            if i + j < count - 1:
                inside.append((i + 2 / 3, j + 2 / 3))
    u, v = np.array(inside).T / count
    return np.stack([1 - u - v, u, v], axis=1)


def _squared_distances(first: Reals, second: Reals) -> Reals:
    product = first @ second.T
    return np.maximum((first**2).sum(axis=1)[:, None] + (second**2).sum(axis=1)[None] - 2 * product, 0)


def _ways_out(surface: _Surface, vertices: Reals, gap: float) -> tuple[Integers, Reals]:
    """Returns points of limbs that are in another part or closer to it than the gap, and their ways out [points, 3]."""
    points, normals = surface.points(vertices), surface.normals(vertices)
    reach, bind = REACH * surface.extent + gap, surface.bind_points
    found, ways = [np.zeros(0, int)], [np.zeros((0, 3))]
    for own, other in surface.near(points):
        squared = _squared_distances(points[own], points[other])
        bind_squared = _squared_distances(bind[own], bind[other])
        allowed = (
            (squared < reach**2)
            & (bind_squared > CLOSER**2 * np.maximum(squared, gap**2))
            & (bind_squared > (CLOSING * surface.extent + np.sqrt(squared)) ** 2)
        )
        nearest = np.where(allowed, squared, np.inf).argmin(axis=1)
        row = np.flatnonzero(allowed[np.arange(len(own)), nearest] & (surface.bend[own] > 0.2))
        a, b = own[row], other[nearest[row]]
        height = np.einsum("ij,ij->i", points[a] - points[b], normals[b])
        aside = np.sqrt(np.maximum(squared[row, nearest[row]] - height**2, 0))
        facing = np.einsum("ij,ij->i", normals[a], normals[b])
        lead = (surface.outwards[a] - surface.outwards[b]) / (0.15 * surface.extent)
        share = np.clip(0.5 + 0.5 * lead, 0, 1)  # the part that is further out gives way
        share[surface.label[b] == 0] = 1
        wrong = (height < gap) & (aside < SPACING * surface.extent) & ((height < 0) | (facing < 0)) & (share > 0)
        found.append(a[wrong])
        ways.append(((gap - height) * share)[wrong, None] * normals[b][wrong])
    return np.concatenate(found), np.concatenate(ways)


def _displace(surface: _Surface, vertices: Reals, moved: Reals) -> Reals:
    """Returns the vertices with limbs displaced by [limbs, 3]."""
    return vertices + surface.limbs.bend[:, None] * moved[surface.limbs.label]


def _clear_frame(surface: _Surface, vertices: Reals, moved: Reals, gap: float) -> Reals:
    """Returns displacements of limbs [limbs, 3], from given ones on, after which the limbs of a frame keep the gap."""
    for _ in range(ROUNDS):
        found, ways = _ways_out(surface, _displace(surface, vertices, moved), gap)
        step = np.zeros_like(moved)
        for limb in np.unique(surface.label[found]):
            own = surface.label[found] == limb
            depth = np.linalg.norm(ways[own], axis=1)
            direction = (ways[own] * depth[:, None]).sum(axis=0)
            direction /= max(float(np.linalg.norm(direction)), 1e-30)
            along = np.maximum((ways[own] @ direction) / depth, 0.5) * surface.bend[found[own]]
            step[limb] = direction * np.quantile(depth / np.maximum(along, 0.5), 0.8)  # the rest in the next rounds
        if np.linalg.norm(step, axis=1).max() < 0.1 * gap:
            break
        moved = moved + step
    return moved


def _between(moved: Reals, known: Reals, times: Reals) -> Reals:
    """Returns displacements [frames, limbs, 3] at the times from those at some of them."""
    flat = moved.reshape(len(known), -1)
    return np.stack([np.interp(times, known, column) for column in flat.T], axis=1).reshape(
        len(times), *moved.shape[1:]
    )


def _smoothed(moved: Reals, times: Reals) -> Reals:
    """Returns displacements [frames, limbs, 3] averaged over time with a Gaussian of `SETTLE`."""
    apart = (times[:, None] - times[None]) / (0.5 * SETTLE)
    weight = np.exp(-0.5 * apart**2)
    weight[np.abs(apart) > 4] = 0
    return np.tensordot(weight / weight.sum(axis=1, keepdims=True), moved, axes=1)


def clear(
    bind: Reals, faces: Integers, times: Reals, positions: Reals, gap: float = GAP, still: bool = False
) -> Cleared:
    """Bends the limbs of an animated mesh aside where they pass through each other or through the trunk.

    Two points touch if they are much closer to each other than in the bind pose. Of two limbs the one that touches
    further out gives way, such as a hand at a hip; equal ones share the way. The displacement grows from the root of a
    limb on, and is smooth in time. Places within a limb, such as the hollow of a knee, and at its root, such as an
    armpit, stay as they are.

    Args:
        bind: Vertices in the bind pose [n, 3], m.
        faces: Triangles [m, 3], with outward normals.
        times: Times of the frames [t], s.
        positions: Vertices of the frames [t, n, 3], m.
        gap: Distance that is kept, m.
        still: True: the first frame is not changed.
    """
    limbs = _Limbs(np.asarray(bind, float), np.asarray(faces))
    if not 0 < limbs.extent < np.inf:  # nothing to keep apart
        return Cleared(positions, 0, 0, 0.0)
    surface = _Surface(np.asarray(bind, float), np.asarray(faces), limbs)
    moved = np.zeros((len(times), limbs.count, 3))
    stride = max(1, round(COARSE * (len(times) - 1) / max(times[-1] - times[0], 1e-9)))
    looked = np.unique(np.append(np.arange(0, len(times), stride), len(times) - 1))
    for frame in looked:
        moved[frame] = _clear_frame(surface, positions[frame], moved[frame], gap)
    if not moved.any():
        return Cleared(positions, 0, 0, 0.0)
    moved = _smoothed(_between(moved[looked], times[looked], times), times)
    for frame in np.flatnonzero((np.linalg.norm(moved, axis=2) > 1e-3 * gap).any(axis=1)):
        moved[frame] = _clear_frame(surface, positions[frame], moved[frame], gap)
    moved = _smoothed(moved, times)
    if still:
        moved = moved - moved[0] * np.exp(-0.5 * ((times - times[0]) / (0.5 * SETTLE)) ** 2)[:, None, None]
    size = np.linalg.norm(moved, axis=2)[:, limbs.label] * limbs.bend
    return Cleared(
        positions + limbs.bend[:, None] * moved[:, limbs.label],
        int((size.max(axis=1) > 1e-4).sum()),
        int((size.max(axis=0) > 1e-4).sum()),
        float(size.max()),
    )
