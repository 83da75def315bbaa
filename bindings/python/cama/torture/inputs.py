# SPDX-License-Identifier: Apache-2.0
"""Checks of what must be refused before a kernel runs: empty, degenerate and duplicate meshes, NaN and Inf anywhere,
sizes.
"""

import math

import numpy as np

import cama

from . import shapes

NOT_FINITE = (math.nan, math.inf, -math.inf)


def _one_cloth(p, vertices, faces, **more):
    def attempt():
        scene = cama.Scene()
        scene.add_cloth(vertices, faces, name="cloth", **more)
        p.simulation(scene)

    return attempt


def empty_scene(p):
    p.refused(cama.SceneError, ["cloth"], lambda: p.simulation(cama.Scene()), "no cloth")


def no_triangles(p):
    none = np.zeros((0, 3))
    for vertices in (none, np.zeros((1, 3)), np.eye(3)):
        p.refused(
            cama.MeshError,
            ["cloth"],
            _one_cloth(p, vertices, none.astype(int)),
            f"{len(vertices)} vertices, no triangle",
        )


def isolated_vertices(p):
    vertices, faces = shapes.sheet(0.2, 0.2, 8)
    for extra, words in (([[9, 9, 9]], [str(len(vertices))]), (vertices[:3] + [0, 0, 1], [str(len(vertices))])):
        p.refused(
            cama.MeshError, ["cloth", *words], _one_cloth(p, np.vstack([vertices, extra]), faces), "unused vertices"
        )


def _changed(array, row, value):
    result = array.copy()
    result[row] = value
    return result


def degenerate_triangles(p):
    """Zero area by equal corners and by corners in a line, a corner named twice; each error names the face."""
    vertices, faces = shapes.sheet(0.2, 0.2, 8)
    a, b, c = faces[3]
    line = _changed(vertices, c, vertices[a] + 0.25 * (vertices[b] - vertices[a]))
    for what, attempt in (
        ("equal corners", _one_cloth(p, _changed(vertices, b, vertices[a]), faces)),
        ("corners in a line", _one_cloth(p, line, faces)),
        ("a corner twice", _one_cloth(p, vertices, _changed(faces, 3, [a, b, b]))),
    ):
        p.refused(cama.MeshError, ["cloth", "face"], attempt, what)


def duplicate_triangles(p):
    vertices, faces = shapes.sheet(0.2, 0.2, 8)
    for again in (faces[5], faces[5][[1, 2, 0]], faces[5][::-1]):
        p.refused(
            cama.MeshError,
            ["cloth", str(len(faces))],
            _one_cloth(p, vertices, np.vstack([faces, again])),
            f"face {again} again",
        )


def indices(p):
    """Outside the vertices, below 0 and beyond 32 bits."""
    vertices, faces = shapes.sheet(0.2, 0.2, 8)
    for value, error in (
        (len(vertices), cama.MeshError),
        (-1, cama.MeshError),
        (2**31, cama.Error),
        (2**40, cama.ArrayError),
    ):
        p.refused(error, ["cloth", "3"], _one_cloth(p, vertices, _changed(faces, (3, 0), value)), f"index {value}")


def _attempts(p, bad):
    """{what: attempt} to bring a number that is not finite into every input."""
    mesh = shapes.sheet(0.2, 0.2, 8)
    row = [bad, 0, 0]

    def scene_with(change):
        def attempt():
            scene = cama.Scene()
            scene.add_cloth(*mesh, name="cloth")
            scene.add_obstacle(shape={"sphere": {"radius": 0.05, "triangles": 80}}, translate=(0, 0, -0.2), name="ball")
            change(scene)
            p.simulation(scene)

        return attempt

    def material_with(name, value):
        def change():
            material = cama.Material.isotropic(1000, 0.3, 1e-5, 0.2)
            setattr(material, name, value)
            scene = cama.Scene()
            scene.add_cloth(*mesh, material=material, name="cloth")
            p.simulation(scene)

        return change

    def ball(**more):
        return scene_with(
            lambda s: s.add_obstacle(
                shape={"sphere": {"radius": 0.05, "triangles": 80}}, name="other", **{"translate": (0, 0, -0.5), **more}
            )
        )

    def state(velocities):
        def attempt():
            scene = cama.Scene()
            scene.add_cloth(*mesh)
            arrays = [mesh[0], mesh[0] * 0]
            arrays[velocities] = _changed(arrays[velocities], (4, 1), bad)
            p.simulation(scene).set_state(*arrays)

        return attempt

    samples = np.stack([mesh[0] + [0, 0, -0.5]] * 2)
    result = {
        "vertices": _one_cloth(p, _changed(mesh[0], (4, 1), bad), mesh[1]),
        "material vertices": _one_cloth(
            p, *mesh, material_vertices=_changed(mesh[0][:, :2], (4, 1), bad), material_faces=mesh[1]
        ),
        "cloth velocity": _one_cloth(p, *mesh, velocity=row),
        "cloth thickness": _one_cloth(p, *mesh, thickness=bad),
        "cloth translate": _one_cloth(p, *mesh, translate=row),
        "cloth rotate": _one_cloth(p, *mesh, rotate=[bad, 0, 0, 0]),
        "cloth scale": _one_cloth(p, *mesh, scale=bad),
        "cloth transform": _one_cloth(p, *mesh, transform=np.diag([bad, 1, 1, 1])),
        "gravity": scene_with(lambda s: setattr(s, "gravity", row)),
        "time_step": scene_with(lambda s: setattr(s, "time_step", bad)),
        "thickness": scene_with(lambda s: setattr(s, "thickness", bad)),
        "stiffness": scene_with(lambda s: setattr(s, "stiffness", bad)),
        "friction": scene_with(lambda s: setattr(s, "friction", bad)),
        "static_friction": scene_with(lambda s: setattr(s, "static_friction", bad)),
        "wind velocity": scene_with(lambda s: setattr(s, "wind", {"velocity": row})),
        "wind density": scene_with(lambda s: setattr(s, "wind", {"density": bad})),
        "wind drag": scene_with(lambda s: setattr(s, "wind", {"drag": bad})),
        "obstacle vertices": scene_with(
            lambda s: s.add_obstacle(_changed(mesh[0] + [0, 0, -0.5], (4, 1), bad), mesh[1])
        ),
        "obstacle friction": ball(friction=bad),
        "obstacle static_friction": ball(static_friction=bad),
        "obstacle thickness": ball(thickness=bad),
        "obstacle contact_stiffness": ball(contact_stiffness=bad),
        "obstacle translate": ball(translate=row),
        "obstacle transform": ball(transform=np.diag([1, 1, bad, 1])),
        "sphere radius": scene_with(lambda s: s.add_obstacle(shape={"shape": {"sphere": {"radius": bad}}})),
        "motion velocity": ball(motion={"velocity": row}),
        "motion rotation_rate": ball(motion={"rotation_rate": row}),
        "motion oscillation": ball(motion={"oscillation": row}),
        "motion period": ball(motion={"period": bad}),
        "motion center": ball(motion={"center": row}),
        "key time": ball(motion={"keys": [{"time": bad}]}),
        "key translation": ball(motion={"keys": [{"time": 0, "translation": row}]}),
        "key rotation": ball(motion={"keys": [{"time": 0, "rotation": [bad, 0, 0, 0]}]}),
        "key scale": ball(motion={"keys": [{"time": 0, "scale": bad}]}),
        "sample times": scene_with(
            lambda s: s.add_obstacle(samples[0], mesh[1], motion={"times": [0, bad], "positions": samples})
        ),
        "sample positions": scene_with(
            lambda s: s.add_obstacle(
                samples[0], mesh[1], motion={"times": [0, 1], "positions": _changed(samples, (1, 4, 1), bad)}
            )
        ),
        "pin motion": scene_with(lambda s: s.pin("cloth", [0], {"velocity": row})),
        "stitch ratio": scene_with(lambda s: s.stitch("cloth", 0, "cloth", 5, 6, ratio=bad)),
        "stitch stiffness": scene_with(lambda s: s.stitch("cloth", 0, "cloth", 5, stiffness=bad)),
        "state positions": state(False),
        "state velocities": state(True),
        "ccd": lambda: cama.collision.vertex_face_ccd(np.zeros((1, 4, 3)), np.full((1, 4, 3), bad)),
        "intersections": lambda: cama.collision.intersections(_changed(mesh[0], (4, 1), bad), mesh[1]),
    }
    for name, value in (
        ("density", bad),
        ("damping", bad),
        ("mass_damping", bad),
        ("strain_limit", bad),
        ("limit_stiffening", bad),
        ("yield_curvature", bad),
        ("hardening", bad),
        ("friction", bad),
        ("static_friction", bad),
        ("thickness", bad),
        ("contact_stiffness", bad),
        ("stretching", [[1000.0, 300.0, bad, 700.0]] * 6),
        ("bending", [[1e-5, bad, 1e-5, 1e-5, 1e-5]] * 3),
    ):
        result[f"material {name}"] = material_with(name, value)
    for name in ("tolerance",):

        def option(name=name):
            scene = cama.Scene()
            scene.add_cloth(*mesh)
            p.simulation(scene, **{name: bad})

        result[f"option {name}"] = option
    if not math.isinf(bad):
        result["pin release"] = scene_with(lambda s: s.pin("cloth", [0], release=bad))
    return result


def not_finite(p):
    """NaN, Inf and -Inf in every input, each refused by a subclass of cama.Error."""
    tried, taken = 0, []
    for bad in NOT_FINITE:
        for what, attempt in _attempts(p, bad).items():
            tried += 1
            try:
                attempt()
                taken.append(f"{what} = {bad}")
            except cama.Error as problem:
                p.seen.error = type(problem).__name__
            except Exception as problem:  # not one of ours: refused, but not by name
                taken.append(f"{what} = {bad} ({type(problem).__name__}: {problem})")
    p.seen.note = f"{tried} inputs"
    p.require(not taken, f"{len(taken)} of {tried} not refused with an error of cama: {', '.join(taken)}")
