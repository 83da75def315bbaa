# SPDX-License-Identifier: Apache-2.0
"""What the add-on takes from Blender: the cloth, its pins and its colliders in every frame."""

import json

import bpy
import numpy as np

MODIFIER = "cama"  # plays the cache; those above it are simulated
PINNED = 0.5  # smallest weight of a pinned vertex
SOLID = {"MESH", "CURVE", "SURFACE", "FONT", "META"}


class Problem(Exception):
    """What the user can mend; its text is shown."""


def mesh_of(item, graph, read):
    """Returns read(mesh) of an object's evaluated mesh, in the object's space."""
    seen = item.evaluated_get(graph)
    mesh = seen.to_mesh(preserve_all_data_layers=True, depsgraph=graph)
    try:
        return read(mesh)
    finally:
        seen.to_mesh_clear()


def numbers(collection, name, width, kind):
    """Returns an attribute [items, width] of a collection such as mesh.vertices."""
    values = np.empty(len(collection) * width, kind)
    collection.foreach_get(name, values)
    return values.reshape(-1, width)


def positions_of(mesh):
    return numbers(mesh.vertices, "co", 3, np.float32)


def triangles_of(mesh):
    mesh.calc_loop_triangles()
    return numbers(mesh.loop_triangles, "vertices", 3, np.int32)


def texture_of(mesh):
    """Returns texture coordinates [k, 2] and triangles [m, 3] of them, one for each vertex and place in the map."""
    if mesh.uv_layers.active is None:
        raise Problem("the mesh has no UV map, which Rest asks for; unwrap it, or choose Start")
    mesh.calc_loop_triangles()
    corners = numbers(mesh.loop_triangles, "loops", 3, np.int32).ravel()
    uv = numbers(mesh.uv_layers.active.uv, "vector", 2, np.float32)[corners]
    rows = np.column_stack([numbers(mesh.loops, "vertex_index", 1, np.int32)[corners], uv])
    kept, index = np.unique(rows, axis=0, return_inverse=True)
    return kept[:, 1:].astype(float), index.reshape(-1, 3).astype(np.int32)


def pinned_of(mesh, group):
    """Returns the vertices [k] whose weight in a vertex group is at least PINNED."""
    return np.array(
        [v.index for v in mesh.vertices if any(g.group == group and g.weight >= PINNED for g in v.groups)], np.int32
    )


def matrix_of(item, metre):
    """Returns the matrix [4, 4] from an object's space to the world in m; metre: m of a unit of Blender."""
    return np.array(item.matrix_world) * np.array([[metre]] * 3 + [[1]])


def named(name):
    """Returns an object, which Undo may have replaced. Raises Problem if it is gone."""
    item = bpy.data.objects.get(name)
    if item is None:
        raise Problem(f"{name} was removed or renamed meanwhile")
    return item


def own_modifiers(item):
    """Returns the modifiers that are simulated, and those that come after: the one named MODIFIER and what is below."""
    at = item.modifiers.find(MODIFIER)
    rows = list(item.modifiers)
    return (rows, []) if at < 0 else (rows[:at], rows[at:])


def check_modifiers(rows):
    """Raises Problem for a modifier that makes another mesh in renders than in the viewport: a cache fits only one."""
    for row in rows:
        counts = [getattr(row, key, 0) for key in ("levels", "render_levels")]
        if row.show_viewport != row.show_render or (row.show_viewport and counts[0] != counts[1]):
            raise Problem(
                f"modifier {row.name} differs between viewport and render; give both the same levels and visibility, "
                f'or move it below "{MODIFIER}"'
            )


def colliders_of(item):
    """Returns the objects that an object collides with. Raises Problem."""
    if item.cama.colliders is None:
        return []
    found = [o for o in item.cama.colliders.all_objects if o.type in SOLID and o != item]
    for other in found:
        if other.hide_get() or other.hide_viewport:
            raise Problem(f"collider {other.name} is hidden; show it, or take it out of the collection")
    return found


def sample(name, folder):
    """Writes job.json and job.npz of an object to a folder; yields the part that is done after every frame.

    Raises Problem.
    """
    scene, item = bpy.context.scene, named(name)
    own, later = own_modifiers(item)
    check_modifiers(own)
    metre = scene.unit_settings.scale_length if scene.unit_settings.system != "NONE" else 1.0
    frames, first, shown = item.cama.frames, scene.frame_start, scene.frame_current
    names = [o.name for o in colliders_of(item)]
    settings = job_of(item, scene, names)
    visible = {row.name: row.show_viewport for row in later}
    data, places, pin_positions, moved = {}, [], [], [([], [], []) for _ in names]
    try:
        for row in later:
            row.show_viewport = False
        for frame in range(frames + 1):
            scene.frame_set(first + frame)
            graph, item = bpy.context.evaluated_depsgraph_get(), named(name)
            matrix = matrix_of(item.evaluated_get(graph), metre)
            places.append(np.linalg.inv(matrix))
            if not frame:
                data = cloth_of(item, graph, matrix, metre)
            if len(data["pins"]):
                points = mesh_of(item, graph, positions_of)[data["pins"]]
                pin_positions.append(points @ matrix[:3, :3].T + matrix[:3, 3])
            for other, kept in zip(names, moved):
                sample_collider(named(other), graph, metre, frame, *kept)
            yield (frame + 1) / (frames + 1)
    finally:
        item = bpy.data.objects.get(name)
        for row in item.modifiers if item else ():
            row.show_viewport = visible.get(row.name, row.show_viewport)
        scene.frame_set(shown)
    if pin_positions and all(np.allclose(p, pin_positions[0], rtol=0, atol=1e-7) for p in pin_positions):
        pin_positions = pin_positions[:1]
    data.update(to_object=np.array(places), pin_positions=np.array(pin_positions or np.zeros((1, 0, 3))))
    for index, (faces, local, matrices) in enumerate(moved):
        data[f"collider_{index}_faces"], data[f"collider_{index}_matrices"] = faces[0], np.array(matrices)
        still = all(points is local[0] for points in local)
        data[f"collider_{index}_local"] = np.array(local[:1] if still else local)
    np.savez(folder / "job.npz", **data)
    (folder / "job.json").write_text(json.dumps(settings), encoding="utf-8")


def job_of(item, scene, colliders):
    """Returns what job.json has."""
    own = item.cama
    return {
        "name": item.name,
        "frames": own.frames,
        "fps": scene.render.fps / scene.render.fps_base,
        "gravity": list(scene.gravity) if scene.use_gravity else [0, 0, 0],
        "fabric": bpy.path.abspath(own.fabric_file) if own.fabric_file else own.fabric,
        "level": own.level,
        "self_contact": own.self_contact,
        "thickness": own.thickness,
        "friction": own.friction,
        "intersections": own.intersections,
        "pinch": own.pinch,
        "colliders": colliders,
    }


def cloth_of(item, graph, matrix, metre):
    """Returns the arrays of the cloth at the start."""
    local, faces = mesh_of(item, graph, positions_of), mesh_of(item, graph, triangles_of)
    if not len(faces):
        raise Problem(f"{item.name} has no faces")
    data = {"vertices": local @ matrix[:3, :3].T + matrix[:3, 3], "faces": faces, "pins": np.zeros(0, np.int32)}
    if item.cama.rest == "uv":
        texture, data["material_faces"] = mesh_of(item, graph, texture_of)
        data["material_vertices"] = texture * item.cama.uv_size * metre
    if item.cama.pins:
        group = item.vertex_groups.get(item.cama.pins)
        if group is None:
            raise Problem(f"{item.name} has no vertex group {item.cama.pins}; choose another for Pins")
        data["pins"] = mesh_of(item, graph, lambda mesh: pinned_of(mesh, group.index))
        if not len(data["pins"]):
            raise Problem(f"vertex group {group.name}: no vertex has a weight of {PINNED} or more")
    return data


def sample_collider(item, graph, metre, frame, faces, local, matrices):
    """Adds a frame of a collider to lists; positions that have not changed are the same array."""
    points = mesh_of(item, graph, positions_of)
    if not frame:
        faces.append(mesh_of(item, graph, triangles_of))
        if not len(faces[0]):
            raise Problem(f"collider {item.name} has no faces")
    elif len(points) != len(local[0]):
        raise Problem(
            f"collider {item.name} has {len(points)} vertices in frame {bpy.context.scene.frame_current} and "
            f"{len(local[0])} at the start; use one whose number of vertices stays"
        )
    local.append(local[-1] if local and np.array_equal(points, local[-1]) else points)
    matrices.append(matrix_of(item.evaluated_get(graph), metre))
