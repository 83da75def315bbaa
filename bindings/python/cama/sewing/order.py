# SPDX-License-Identifier: Apache-2.0
"""Which seams of a pattern wait for others."""

from __future__ import annotations

import numpy as np

from .meshing import PatternMesh

BAND = 3.0  # times the area of a band, such as a cuff, has at least what holds it
RISE = 0.1  # m, of a panel's middle above that of another, from which on it holds it


def held_vertices(mesh: PatternMesh) -> np.ndarray:
    """Whether each vertex is sewn to a panel whose middle is higher than that of its own."""
    panels = mesh.panel_of_vertex
    middle = np.bincount(panels, mesh.positions[:, 2]) / np.bincount(panels)
    held = np.zeros(len(panels), bool)
    for first, second in (mesh.pairs.T, mesh.pairs.T[::-1]):
        held[first[middle[panels[second]] > middle[panels[first]] + RISE]] = True
    return held


def ends_of_bands(mesh: PatternMesh) -> np.ndarray:
    """Whether each pair [pairs] closes a band around a limb, such as a cuff: of two panels that hang by larger ones.

    Such a band is sewn to the sleeve before its ends meet, or it closes beside the arm.
    """
    area = np.array([abs(panel.area) for panel in mesh.pattern.panels])
    height = np.bincount(mesh.panel_of_vertex, mesh.positions[:, 2]) / np.bincount(mesh.panel_of_vertex)
    band = np.zeros(len(area), bool)
    for seam in mesh.pattern.seams:
        for own, other in ((seam.first[0], seam.second[0]), (seam.second[0], seam.first[0])):
            band[own] |= area[other] > BAND * area[own] and height[other] > height[own]
    return np.asarray(band[mesh.panel_of_vertex[mesh.pairs]].all(axis=1))
