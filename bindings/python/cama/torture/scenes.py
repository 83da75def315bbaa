# SPDX-License-Identifier: Apache-2.0
"""The extreme cases: `case(resolution, seed)` gives a cama.Scene whose `frames` steps are the run.

resolution: cloth triangles aimed at.  seed: of the jitter of the start; another seed is another run of the same case.
"""

import json

import numpy as np

import cama

from .. import shipped
from ..options import level_time_step
from . import shapes

THICKNESS = 1.5e-3


def _scene(name, steps, time_step=0.005, **more):
    scene = cama.Scene(name=name, time_step=time_step, frames=steps, thickness=THICKNESS, **more)
    scene.frame_time = 0.0
    return scene


def _add(scene, mesh, rest=None, **more):
    vertices, faces = mesh
    rest = vertices[:, :2] if rest is None else rest
    return scene.add_cloth(vertices, faces, material_vertices=rest, material_faces=faces, **more)


def _placed(mesh, turn=None, shift=(0, 0, 0)):
    turn = np.eye(3) if turn is None else np.asarray(turn)
    return mesh[0] @ turn.T + np.asarray(shift), mesh[1]


def _shipped(name, resolution, seed, steps, degrees=3.0, offset=4e-3, time_step=None):
    """A scene that cama ships, its cloths shifted and turned about z by a little. time_step: s, None: the paper's."""
    folder = shipped.folder() / name
    described = json.loads((folder / "scene.json").read_text())
    described["frames"] = steps
    random = np.random.default_rng(seed)
    for cloth in described["cloth"]:
        transform = cloth.setdefault("transform", {})
        moved = np.array(transform.get("translate", [0, 0, 0])) + random.uniform(-offset, offset, 3) * [1, 1, 0]
        transform["translate"] = moved.tolist()
        turned = transform.get("rotate", {"axis": [0, 0, 1], "angle_deg": 0})
        transform["rotate"] = dict(turned, angle_deg=turned["angle_deg"] + random.uniform(-degrees, degrees))
    scene = cama.Scene.parse(described, folder, resolution)
    scene.time_step = time_step or level_time_step("paper", scene)
    return scene


def sphere(resolution=1500, seed=0):
    """The paper's Figure 10: three hanging sheets hit by a ball that swings."""
    return _shipped("sphere", resolution, seed, 600, degrees=1.5)


def funnel(resolution=1500, seed=0):
    """The paper's Figure 11 (b): three silk layers through a funnel."""
    return _shipped("funnel", resolution, seed, 600)


def drape(resolution=1500, seed=0):
    """Three ordered layers on a fixed ball."""
    return _shipped("drape", resolution, seed, 400)


def twisting(resolution=1500, seed=0):
    """The paper's Figure 11 (c), to its end: the ball has wound three crossed strips up by two turns."""
    return _shipped("twisting", resolution, seed, 1200, time_step=1 / 400)


def rope(resolution=1000, seed=0, turns=10, seconds=4.0):
    """A sheet whose ends turn against each other, ten turns in all, and come nearer by a third: a rope."""
    random = np.random.default_rng(seed)
    steps = round(seconds / 0.005)
    scene = _scene("rope", steps, gravity=(0, 0, 0))
    length = 0.6
    mesh = shapes.sheet(length, 0.15, resolution)
    left, right = (np.flatnonzero(mesh[0][:, 0] == x) for x in (mesh[0][:, 0].min(), mesh[0][:, 0].max()))
    vertices = mesh[0].copy()
    free = np.setdiff1d(np.arange(len(vertices)), np.concatenate([left, right]))
    vertices[free, 2] += random.uniform(-1e-3, 1e-3, len(free))
    cloth = _add(scene, (vertices, mesh[1]), mesh[0][:, :2], name="rope", material="silk")
    for side, group in ((1, left), (-1, right)):
        scene.pin(
            cloth,
            group,
            dict(velocity=(side * length / 6 / seconds, 0, 0), rotation_rate=(side * np.pi * turns / seconds, 0, 0)),
        )
    return scene


def pile(resolution=1600, seed=0, sheets=50, seconds=1.5):
    """Sheets dropped on a floor, each a little turned, tilted and shifted."""
    random = np.random.default_rng(seed)
    scene = _scene("pile", round(seconds / 0.005))
    scene.add_obstacle(
        shape={"plane": {"size": [2, 2], "triangles": 8}}, friction=0.4, name="floor", translate=(0.0131, 0.0177, 0)
    )
    for k in range(sheets):
        turn = shapes.rotation((0, 0, 1), random.uniform(-0.15, 0.15)) @ shapes.rotation(
            (*random.normal(size=2), 0), random.uniform(0, 0.012)
        )
        shift = (*random.uniform(-0.01, 0.01, 2), 0.01 + 0.008 * k)
        mesh = shapes.sheet(0.3, 0.3, resolution / sheets)
        _add(scene, _placed(mesh, turn, shift), mesh[0][:, :2], name=f"sheet {k}", material="cotton")
    return scene


def needle_bed(resolution=1000, seed=0, needles=6):
    """A sheet laid on thin cones, 80 mm high and 12 mm wide at the base."""
    random = np.random.default_rng(seed)
    scene = _scene("needle_bed", 300)
    line = 0.09 * (np.arange(needles) - (needles - 1) / 2)
    tips = np.stack(np.meshgrid(line, line), 2).reshape(-1, 2) + random.uniform(-8e-3, 8e-3, (needles**2, 2))
    bed = shapes.join([_placed(shapes.cone(6e-3, 0.08, 6), shift=(*p, 0)) for p in tips])
    scene.add_obstacle(*bed, name="needles", friction=0.3)
    scene.add_obstacle(
        shape={"plane": {"size": [2, 2], "triangles": 8}}, name="floor", translate=(0, 0, -1e-5), friction=0.3
    )
    mesh = shapes.sheet(0.5, 0.5, resolution)
    _add(
        scene,
        _placed(mesh, shapes.rotation((0, 0, 1), random.uniform(-0.2, 0.2)), (0, 0, 0.085)),
        mesh[0][:, :2],
        name="sheet",
    )
    return scene


def knife(resolution=1000, seed=0, speed=300.0):
    """A sheet thrown at 300 m/s onto the edge of a thin wedge (opening angle 4 degrees)."""
    random = np.random.default_rng(seed)
    scene = _scene("knife", 200, time_step=1e-3)
    scene.add_obstacle(*shapes.wedge(0.2, 3.0, 1.0, 40), name="knife", friction=0.3)
    mesh = shapes.sheet(0.4, 0.4, resolution)
    turn = shapes.rotation((0, 0, 1), random.uniform(0, 0.5)) @ shapes.rotation(
        (*random.normal(size=2), 0), random.uniform(0, 0.05)
    )
    _add(
        scene,
        _placed(mesh, turn, (*random.uniform(-0.02, 0.02, 2), 0.03)),
        mesh[0][:, :2],
        name="sheet",
        velocity=(0, 0, -speed),
    )
    return scene


def needle_shot(resolution=1000, seed=0, speed=300.0):
    """A sheet thrown at 300 m/s onto a bed of needles."""
    random = np.random.default_rng(seed)
    scene = _scene("needle_shot", 200, time_step=1e-3)
    line = 0.1 * (np.arange(4) - 1.5)
    tips = np.stack(np.meshgrid(line, line), 2).reshape(-1, 2) + random.uniform(-8e-3, 8e-3, (16, 2))
    bed = shapes.join([_placed(shapes.cone(6e-3, 0.2, 6), shift=(*p, 0)) for p in tips])
    scene.add_obstacle(*bed, name="needles", friction=0.3)
    scene.add_obstacle(
        shape={"plane": {"size": [4, 4], "triangles": 8}}, name="floor", translate=(0, 0, -1e-5), friction=0.3
    )
    mesh = shapes.sheet(0.5, 0.5, resolution)
    _add(
        scene,
        _placed(mesh, shapes.rotation((0, 0, 1), random.uniform(-0.2, 0.2)), (0, 0, 0.23)),
        mesh[0][:, :2],
        name="sheet",
        velocity=(0, 0, -speed),
    )
    return scene


def _press(name, gap, resolution, seed, seconds=1.5):
    """A pleated sheet between two plates; the upper one comes down until `gap` is left."""
    random = np.random.default_rng(seed)
    scene = _scene(name, round((seconds + 0.4) / 0.005))
    opening, plate = 0.12, (0.6, 0.6, 0.02)
    scene.add_obstacle(
        *_placed(shapes.box(plate, (8, 8, 1)), shift=(0, 0, -plate[2] / 2)), name="lower plate", friction=0.3
    )
    scene.add_obstacle(
        *_placed(shapes.box(plate, (7, 7, 1)), shift=(0.003, 0.007, opening + plate[2] / 2)),
        name="upper plate",
        friction=0.3,
        motion=dict(velocity=(0, 0, (gap - opening) / seconds), stop=seconds),
    )
    mesh = shapes.sheet(0.3, 0.3, resolution)
    pleats, fine = 2.5, np.linspace(0, 1, 2001)
    curve = np.stack([0.18 * (fine - 0.5), 0 * fine, 0.04 * np.sin(2 * np.pi * pleats * fine)], 1)
    curve, length = shapes.resample(curve, 4001)
    along = mesh[0][:, 0] / 0.3 + 0.5
    vertices = np.stack(
        [
            np.interp(along, np.linspace(0, 1, 4001), curve[:, 0]),
            mesh[0][:, 1],
            np.interp(along, np.linspace(0, 1, 4001), curve[:, 2]) + 0.055,
        ],
        1,
    )
    vertices[:, 2] += random.uniform(-1e-3, 1e-3, len(vertices))
    _add(scene, (vertices, mesh[1]), mesh[0][:, :2] * [length / 0.3, 1], name="sheet")
    return scene


def press(resolution=1000, seed=0):
    """Two plates close on a pleated sheet until 6 mm are left, four thicknesses."""
    return _press("press", 4 * THICKNESS, resolution, seed)


def press_tight(resolution=1000, seed=0):
    """The same until half a thickness is left: more than the certified distance on both sides, so cloth can escape."""
    return _press("press_tight", 0.5 * THICKNESS, resolution, seed)


def press_shut(resolution=1000, seed=0):
    """The same until the plates would be 1 mm inside each other: no way out."""
    return _press("press_shut", -1e-3, resolution, seed)


def clamp(resolution=1000, seed=0):
    """A hanging sheet between two slanted plates that close on it from the sides until 3 mm are left."""
    random = np.random.default_rng(seed)
    scene = _scene("clamp", 300)
    plate, opening, gap, seconds = (0.02, 0.5, 0.5), 0.08, 3e-3, 0.5
    for side, name in ((1, "right"), (-1, "left")):
        turn = shapes.rotation((0, 0, 1), 0.02 * side)
        reach = 0.25 * 0.02
        scene.add_obstacle(
            *_placed(
                shapes.box(plate, (1, 6 + side, 6 + side)), turn, (side * (opening / 2 + plate[0] / 2 + reach), 0, -0.3)
            ),
            name=name,
            friction=0.3,
            motion=dict(velocity=(-side * (opening - gap) / 2 / seconds, 0, 0), stop=seconds),
        )
    mesh = shapes.sheet(0.4, 0.4, resolution)
    upright = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0.0]])
    vertices, faces = _placed(mesh, upright, (0, 0, -0.2))
    vertices[:, 0] += 0.02 * np.sin(25 * vertices[:, 1]) * (vertices[:, 2] / -0.4) + random.uniform(
        -1e-3, 1e-3, len(vertices)
    )
    cloth = _add(scene, (vertices, faces), mesh[0][:, :2], name="sheet")
    scene.pin(cloth, np.flatnonzero(mesh[0][:, 1] == mesh[0][:, 1].max()))
    return scene


HOLE_SHARE, HOLE_SIDE = 0.03, 0.4


def hole(resolution=1000, seed=0):
    """A sheet pulled at its middle through a hole of 3 % of its area."""
    random = np.random.default_rng(seed)
    scene = _scene("hole", 300)
    radius = np.sqrt(HOLE_SHARE * HOLE_SIDE**2 / np.pi)
    scene.add_obstacle(*shapes.plate_with_hole(0.35, radius, 0.012, 48), name="plate", friction=0.1)
    mesh = shapes.sheet(HOLE_SIDE, HOLE_SIDE, resolution)
    cloth = _add(
        scene,
        _placed(mesh, shapes.rotation((0, 0, 1), random.uniform(0, 0.8)), (*random.uniform(-5e-3, 5e-3, 2), 0.01)),
        mesh[0][:, :2],
        name="sheet",
        material="silk",
    )
    middle = np.flatnonzero(np.linalg.norm(mesh[0][:, :2], axis=1) < 0.35 * radius)
    scene.pin(
        cloth,
        middle if len(middle) else [int(np.argmin(np.linalg.norm(mesh[0], axis=1)))],
        dict(velocity=(0, 0, -0.35), stop=1.3),
    )
    return scene


KNOT_SCALE, KNOT_WIDTH = 0.09, 0.02


def knot(resolution=900, seed=0):
    """A strip 20 mm wide, tied loosely as an overhand knot and pulled tight at its ends."""
    random = np.random.default_rng(seed)
    curve = KNOT_SCALE * shapes.overhand()
    length = shapes.resample(curve, 2)[1]
    columns = max(2, round(np.sqrt(resolution / 2 * KNOT_WIDTH / length)))
    points, _ = shapes.resample(curve, max(60, round(resolution / 2 / columns)) + 1)
    angle = random.uniform(0, 2 * np.pi)
    vertices, faces, rest = shapes.ribbon(points, KNOT_WIDTH, columns, (np.cos(angle), np.sin(angle), 0))
    seconds, stretch = 3.0, length - 0.15
    scene = _scene("knot", round((seconds + 0.5) / 0.005), gravity=(0, 0, 0))
    cloth = _add(scene, (vertices, faces), rest, name="strip")
    away = points[-1] - points[0]
    target = stretch * np.array([away[0], 0, away[2]]) / np.hypot(away[0], away[2])
    middle = (points[0] + points[-1]) / 2
    for group, side in ((np.arange(columns + 1), -1), (np.arange(len(vertices) - columns - 1, len(vertices)), 1)):
        shift = middle + side * target / 2 - (points[0] if side < 0 else points[-1])
        scene.pin(cloth, group, dict(velocity=tuple(shift / seconds), stop=seconds))
    return scene


def chain(resolution=900, seed=0, rings=3):
    """Interlocked bands that hang in each other; the first is held at its top."""
    random = np.random.default_rng(seed)
    radius, width = 0.05, 0.02
    scene = _scene("chain", 400)
    rows = 2
    around = max(16, round(resolution / rings / rows / 2))
    angle = 2 * np.pi * np.arange(around) / around
    u, v = np.meshgrid(angle, np.linspace(-width / 2, width / 2, rows + 1), indexing="xy")
    band = np.stack([radius * np.cos(u), v, radius * np.sin(u)], 2).reshape(-1, 3)
    faces = shapes.cells(around, rows, wrap=True)
    for k in range(rings):
        turn = shapes.rotation((0, 0, 1), np.pi / 2 * (k % 2) + random.uniform(-0.15, 0.15))
        ring = scene.add_cloth(
            *_placed((band, faces), turn, (*random.uniform(-2e-3, 2e-3, 2), -1.5 * radius * k)),
            name=f"ring {k}",
            material="denim",
        )
        if k == 0:
            scene.pin(ring, np.flatnonzero(band[:, 2] > 0.93 * radius))
    return scene


def coincident(resolution=1000, seed=0, gap=1e-6):
    """Two equal sheets one micrometre apart fall together on a floor and a ball."""
    random = np.random.default_rng(seed)
    scene = _scene("coincident", 300)
    scene.add_obstacle(
        shape={"sphere": {"radius": 0.1, "triangles": 1280}},
        name="ball",
        translate=(*random.uniform(-0.02, 0.02, 2), 0.1),
    )
    mesh = shapes.sheet(0.4, 0.4, resolution / 2)
    turn = shapes.rotation((0, 0, 1), random.uniform(0, 0.7))
    for k in range(2):
        _add(scene, _placed(mesh, turn, (0, 0, 0.25 + gap * k)), mesh[0][:, :2], name=("lower", "upper")[k])
    return scene


def touching(resolution=1000, seed=0):
    """The same at distance 0: every vertex lies on another."""
    scene = coincident(resolution, seed, gap=0.0)
    scene.name = "touching"
    return scene


def thick(resolution=1000, seed=0):
    """A sheet whose contact thickness, 30 mm, is longer than its edges, on a ball and a floor of two triangles."""
    random = np.random.default_rng(seed)
    scene = _scene("thick", 300)
    scene.add_obstacle(shape={"sphere": {"radius": 0.1, "triangles": 1280}}, name="ball", translate=(0, 0, 0.15))
    scene.add_obstacle(
        [[-500, -500, 0], [500, -500, 0], [500, 500, 0], [-500, 500, 0]],
        [[0, 1, 2], [0, 2, 3]],
        name="floor",
        friction=0.4,
    )
    mesh = shapes.sheet(0.4, 0.4, resolution)
    _add(
        scene,
        _placed(mesh, shapes.rotation((0, 0, 1), random.uniform(0, 0.7)), (*random.uniform(-0.03, 0.03, 2), 0.27)),
        mesh[0][:, :2],
        name="sheet",
        thickness=0.03,
    )
    return scene


def _upright(resolution, seed, scene, pinned):
    """Adds a sheet in the plane y = 0, 0.4 m wide and high, its upper corners held if `pinned`."""
    random = np.random.default_rng(seed)
    mesh = shapes.sheet(0.4, 0.4, resolution)
    turn = shapes.rotation((0, 0, 1), random.uniform(-0.1, 0.1)) @ shapes.rotation((1, 0, 0), np.pi / 2)
    cloth = _add(scene, _placed(mesh, turn, random.uniform(-0.02, 0.02, 3)), mesh[0][:, :2], name="sheet")
    if pinned:
        top = np.flatnonzero(mesh[0][:, 1] == mesh[0][:, 1].max())
        scene.pin(cloth, top[[0, -1]])
    return scene


def bullet(resolution=1000, seed=0, speed=1000.0):
    """A ball of 40 mm at 1000 m/s meets a free sheet and carries it for 2 m; one metre a step."""
    scene = _scene("bullet", 150, time_step=1e-3, gravity=(0, 0, 0))
    scene.add_obstacle(
        shape={"sphere": {"radius": 0.02, "triangles": 320}},
        name="bullet",
        translate=(0, -0.5, 0),
        motion=dict(velocity=(0, speed, 0), stop=2.5 / speed),
    )
    return _upright(resolution, seed, scene, pinned=False)


def teleport(resolution=1000, seed=0, distance=0.5):
    """A ball of 0.2 m is half a metre farther within one step, on the other side of a sheet held at its corners."""
    scene = _scene("teleport", 200)
    scene.add_obstacle(
        shape={"sphere": {"radius": 0.1, "triangles": 1280}},
        name="ball",
        translate=(0, -0.2, 0),
        motion=dict(velocity=(0, distance / 0.005, 0), start=0.1, stop=0.105),
    )
    return _upright(resolution, seed, scene, pinned=True)


def flip(resolution=1000, seed=0):
    """A bar under a draped sheet turns by 180 degrees about its length in one step, and again after half a second."""
    random = np.random.default_rng(seed)
    scene = _scene("flip", 300)
    half = [np.cos(np.pi / 2), 0, np.sin(np.pi / 2), 0]
    keys = [
        dict(time=t, rotation=q) for t, q in ((0.5, (1, 0, 0, 0)), (0.505, half), (1.0, half), (1.005, (-1, 0, 0, 0)))
    ]
    scene.add_obstacle(*shapes.box((0.2, 0.5, 0.04), (4, 10, 1)), name="bar", friction=0.3, motion=dict(keys=keys))
    mesh = shapes.sheet(0.4, 0.4, resolution)
    _add(
        scene,
        _placed(mesh, shapes.rotation((0, 0, 1), random.uniform(0, 0.7)), (*random.uniform(-0.02, 0.02, 2), 0.03)),
        mesh[0][:, :2],
        name="sheet",
    )
    return scene


def stack(resolution=4000, seed=0, sheets=5, seconds=4.0):
    """Sheets laid on a floor, to come to rest."""
    random = np.random.default_rng(seed)
    scene = _scene("stack", round(seconds / 0.005))
    scene.add_obstacle(
        shape={"plane": {"size": [1, 1], "triangles": 8}}, friction=0.4, name="floor", translate=(0.0131, 0.0177, 0)
    )
    mesh = shapes.sheet(0.3, 0.3, resolution / sheets)
    for k in range(sheets):
        turn = shapes.rotation((0, 0, 1), random.uniform(-0.2, 0.2))
        _add(
            scene,
            _placed(mesh, turn, (*random.uniform(-0.01, 0.01, 2), 0.004 + 0.004 * k)),
            mesh[0][:, :2],
            name=f"sheet {k}",
        )
    return scene


def flight(resolution=400, seed=0, gravity=(0, 0, 0), velocity=(0, 0, 0)):
    """One sheet and nothing else, contact on."""
    random = np.random.default_rng(seed)
    scene = _scene("flight", 100, gravity=gravity)
    mesh = shapes.sheet(0.5, 0.5, resolution)
    _add(
        scene,
        _placed(mesh, shapes.rotation(random.normal(size=3), random.uniform(0, 3))),
        mesh[0][:, :2],
        name="sheet",
        velocity=velocity,
    )
    return scene
