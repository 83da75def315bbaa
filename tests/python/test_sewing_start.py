# SPDX-License-Identifier: Apache-2.0
"""Panels of a sewing pattern that cross each other where its file places them."""

import numpy as np
import pytest

import cama
from cama.sewing.meshing import mesh_pattern
from cama.sewing.wearer import Wearer
from cama.sewing.work import PARTING, PARTINGS, Dressing

UPRIGHT, LEANING = [90, 0, 0], [86, 0, 0]  # degrees


def dressing(panels, under=()):
    pattern = cama.SewingPattern.parse({"panels": panels})
    # a thin body along z through the origin; the panels hang at y = -0.2
    body = np.array([[0.01, 0, 0], [-0.01, 0.01, 0], [0, 0, 1.5]])
    wearer = Wearer(body, np.array([[0, 1, 2]]), {}, {}, None)
    return Dressing("garment", mesh_pattern(pattern, 0.05), wearer, cama.Material.fabric("cotton"), under, {}, None)


def panel(width, height, at, rotate):
    half = width / 2
    corners = [[-half, 0], [half, 0], [half, height], [-half, height]]
    return {"corners": corners, "rotate": rotate, "translate": at}


def crossings(work):
    scene = work._sewing_scene(np.full(len(work.pairs), 0.005))
    return sum(pair.count for pair in scene.intersections())


def test_the_lower_of_two_panels_that_cross_moves_outward_as_a_whole():
    panels = {
        "sleeve": panel(0.3, 0.5, [0.1, -0.2, 0.9], UPRIGHT),
        "skirt": panel(0.8, 0.3, [0, -0.217, 0.7], LEANING),  # crosses the plane of the sleeve at its upper part
    }
    work = dressing(panels)
    start, of = work.positions, work.mesh.panel_of_vertex
    assert crossings(work) > 0
    work._part_panels()
    assert crossings(work) == 0
    way = work.positions - start
    assert not way[of == 0].any()
    skirt = way[of == 1]
    assert np.ptp(skirt, axis=0) == pytest.approx(0, abs=1e-12)  # not bent
    assert skirt[0] == pytest.approx([0, skirt[0, 1], 0], abs=1e-12) and skirt[0, 1] < 0  # away from the body
    steps = -skirt[0, 1] / PARTING
    assert steps == pytest.approx(round(steps)) and 1 <= steps <= PARTINGS


def test_panels_that_do_not_cross_stay():
    panels = {
        "front": panel(0.4, 0.4, [0, -0.2, 0.8], UPRIGHT),
        "back": panel(0.4, 0.4, [0, 0.2, 0.8], UPRIGHT),
    }
    work = dressing(panels)
    start = work.positions.copy()
    work._part_panels()
    assert np.array_equal(work.positions, start)


def test_panels_that_cannot_be_parted_are_where_they_cross_least():
    """They cross at a right angle, in the way that the lower one moves: what is left is for `untangle`."""
    panels = {
        "wall": panel(2.0, 0.6, [0, -1.0, 0.9], [90, 0, 90]),
        "skirt": panel(0.8, 0.3, [0, -0.2, 0.7], UPRIGHT),
    }
    work, tried = dressing(panels), dressing(panels)
    start, skirt = work.positions, work.mesh.panel_of_vertex == 1
    counts = []
    for step in range(PARTINGS + 1):
        tried.positions = start - PARTING * step * skirt[:, None] * (0, 1, 0)
        counts.append(crossings(tried))
    assert min(counts) > 0
    work._part_panels()
    assert crossings(work) == min(counts)
    away = PARTING * counts.index(min(counts))
    assert work.positions == pytest.approx(start - away * skirt[:, None] * (0, 1, 0), abs=1e-12)
