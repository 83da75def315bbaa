# SPDX-License-Identifier: Apache-2.0
"""Uses the add-on in Blender, and writes what it finds: python blender_addon.py FOLDER PYTHONPATH; see its test."""

import contextlib
import json
import os
import sys
import time
from pathlib import Path

import bpy
import numpy as np

FOLDER = Path(sys.argv[1])
os.environ["PYTHONPATH"] = sys.argv[2]
OPERATORS = ("simulate", "cancel", "remove")


def fresh():
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.ops.preferences.addon_enable(module="cama_cloth")
    bpy.context.scene.render.fps = 25


def sheet(cells=8, size=1.0, **place):
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=cells, y_subdivisions=cells, size=size, **place)
    item = bpy.context.active_object
    item.name = "sheet"
    item.cama.level, item.cama.frames = "preview", 4
    return item


def wall(**place):
    """A collider in a collection of its own."""
    cloth = bpy.context.active_object
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=4, y_subdivisions=4, size=2, **place)
    item = bpy.context.active_object
    item.name = "wall"
    group = cloth.cama.colliders or bpy.data.collections.new("colliders")
    if cloth.cama.colliders is None:
        bpy.context.scene.collection.children.link(group)
        cloth.cama.colliders = group
    group.objects.link(item)
    bpy.context.view_layer.objects.active = cloth
    return item


def shown(item):
    """Positions [vertices, 3] in the world, as modifiers give them in this frame."""
    seen = item.evaluated_get(bpy.context.evaluated_depsgraph_get())
    return np.array([seen.matrix_world @ v.co for v in seen.data.vertices])


def simulate():
    """The result of the operator, or what it reports as an error."""
    try:
        return sorted(bpy.ops.cama.simulate())
    except RuntimeError as problem:
        return str(problem)


def plays():
    item, scene = sheet(location=(1, 2, 0.5), rotation=(0.2, 0.1, 0.7), scale=(1, 1, 1)), bpy.context.scene
    item.scale = (0.5, 0.8, 1.0)
    item.keyframe_insert("location", frame=1)
    item.location.z += 0.2
    item.keyframe_insert("location", frame=9)
    item.shape_key_add(name="Basis")
    bent = item.shape_key_add(name="bent")
    bent.data[0].co.z += 0.1
    for frame, value in ((1, 0.0), (9, 1.0)):
        bent.value = value
        bent.keyframe_insert("value", frame=frame)
    first = item.modifiers.new("first", "SUBSURF")
    first.levels = first.render_levels = 1
    group = item.vertex_groups.new(name="held")
    group.add([0, 1], 1.0, "ADD")
    group.add([8], 0.2, "ADD")
    item.cama.pins, item.cama.frames, item.cama.folder = "held", 8, str(FOLDER / "plays")
    scene.frame_set(5)
    path = []
    for frame in range(1, 10):
        scene.frame_set(frame)
        path.append(shown(item))
    found = {"result": simulate()}
    after = item.modifiers.new("after", "SUBSURF")
    after.levels, after.render_levels = 1, 2
    found["result"] = simulate()  # once more: what lies below the cache is not simulated
    found["modifiers"] = [row.name for row in item.modifiers]
    after.show_viewport = False
    found["world"], found["matrices"] = [], []
    for frame in range(1, 10):
        scene.frame_set(frame)
        found["world"].append(shown(item).tolist())
        found["matrices"].append([list(row) for row in item.matrix_world])
    pinned = [k for k in range(len(path[0])) if weight_of(item, k) >= 0.5]
    found["pinned"], found["pin_path"] = pinned, [points[pinned].tolist() for points in path]
    return found


def weight_of(item, vertex):
    item.modifiers["cama"].show_viewport = False
    seen = item.evaluated_get(bpy.context.evaluated_depsgraph_get())
    weights = [g.weight for g in seen.data.vertices[vertex].groups]
    item.modifiers["cama"].show_viewport = True
    return max(weights, default=0)


def carries():
    item, scene = sheet(cells=10, location=(0, 0, 0.02)), bpy.context.scene
    item.cama.frames, item.cama.folder = 20, str(FOLDER / "carries")
    plate = wall()
    plate.shape_key_add(name="Basis")
    up = plate.shape_key_add(name="up")
    for point in up.data:
        point.co.z += 0.3
    for frame, value in ((1, 0.0), (21, 1.0)):
        up.value = value
        up.keyframe_insert("value", frame=frame)
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.1, location=(0, 0, -0.2), segments=16, ring_count=12)
    ball = bpy.context.active_object
    ball.keyframe_insert("location", frame=1)
    ball.location.z, ball.rotation_euler.z = 0.35, 2.0
    ball.keyframe_insert("location", frame=21)
    ball.keyframe_insert("rotation_euler", frame=21)
    item.cama.colliders.objects.link(ball)
    bpy.context.view_layer.objects.active = item
    for curve in curves_of(ball) + curves_of(plate.data.shape_keys):
        for key in curve.keyframe_points:
            key.interpolation = "LINEAR"
    found = {"result": simulate()}
    scene.frame_set(21)
    points = shown(item)
    found["lowest"], found["top"] = float(points[:, 2].min()), float(points[:, 2].max())
    picture(item, ball)
    fresh()
    bpy.context.scene.unit_settings.scale_length = 0.01
    item = sheet(size=100.0)
    item.cama.folder = str(FOLDER / "unit")
    simulate()
    bpy.context.scene.frame_set(5)
    found["unit"] = 0.01 * float(shown(item)[:, 2].mean())
    return found


def curves_of(item):
    action = item.animation_data.action
    if hasattr(action, "fcurves"):
        return list(action.fcurves)
    return [
        curve for layer in action.layers for strip in layer.strips for bag in strip.channelbags for curve in bag.fcurves
    ]


def picture(item, ball):
    scene = bpy.context.scene
    for each, color in ((item, (0.1, 0.2, 0.8, 1)), (ball, (0.5, 0.4, 0.3, 1))):
        material = bpy.data.materials.new(each.name)
        if material.node_tree is None:  # before Blender 5
            material.use_nodes = True
        material.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = color
        each.data.materials.append(material)
        each.data.shade_smooth()
    bpy.ops.object.camera_add(location=(1.2, -1.6, 1.2), rotation=(1.1, 0, 0.64))
    scene.camera = bpy.context.object
    bpy.ops.object.light_add(type="SUN", rotation=(0.7, 0.2, 0.5))
    bpy.context.object.data.energy = 3
    scene.render.engine, scene.cycles.samples, scene.cycles.use_denoising = "CYCLES", 12, False
    scene.render.resolution_x, scene.render.resolution_y = 480, 360
    scene.render.filepath = str(FOLDER / "picture.png")
    bpy.ops.render.render(write_still=True)


def errors():
    found, item = {}, sheet(location=(0, 0, 0.5))
    item.cama.folder = str(FOLDER / "errors")
    barrier = wall(location=(0, 0, 0.5), rotation=(np.pi / 2, 0, 0))
    found["intersecting"] = simulate()
    barrier.hide_set(True)
    found["hidden"] = simulate()
    item.cama.colliders = None
    item.cama.pins = "nothing"
    found["no group"] = simulate()
    item.cama.pins, item.cama.rest = "", "uv"
    bpy.ops.mesh.uv_texture_remove()
    found["no map"] = simulate()
    item.cama.rest = "start"
    both = item.modifiers.new("both", "SUBSURF")
    both.levels, both.render_levels = 1, 2
    found["levels"] = simulate()
    item.modifiers.remove(both)
    os.environ["CAMA_PYTHON"] = str(FOLDER / "no python")
    found["python"] = simulate()
    os.environ["CAMA_PYTHON"], kept = sys.executable, os.environ.pop("PYTHONPATH")
    found["no cama"] = simulate()
    del os.environ["CAMA_PYTHON"]
    os.environ["PYTHONPATH"] = kept
    item.cama.folder = "//cache"
    found["unsaved"] = simulate()
    bpy.ops.object.mode_set(mode="EDIT")
    found["mode"] = not bpy.ops.cama.simulate.poll()
    bpy.ops.object.mode_set(mode="OBJECT")
    item.cama.folder = str(FOLDER / "errors")
    last = item.modifiers.new("cama", "MESH_CACHE")
    item.modifiers.new("after", "SUBSURF")
    item.cama.pins = "nothing"
    simulate()
    found["state"] = "after" if last.show_viewport and item.modifiers["after"].show_viewport else "hidden"
    return found


def cancels():
    from cama_cloth.running import Run

    item, found = sheet(location=(0, 0, 0.5)), {}
    item.cama.frames, item.cama.folder = 2000, str(FOLDER / "cancels")
    run, slowest = Run(item), 0.0
    assert not bpy.ops.cama.simulate.poll()
    while True:
        began = time.monotonic()
        more = run.advance()
        slowest = max(slowest, time.monotonic() - began)
        if not more:
            break
        if run.frames >= 2 and not run.cancelled:
            bpy.ops.cama.cancel()
        time.sleep(0.02)
    found["slowest"], found["frames"] = slowest, run.frames
    found["ended"] = run._process.poll() is not None and Run.current is None and not run.problem
    found["cached"] = int.from_bytes((run.folder / "cloth.pc2").read_bytes()[28:32], "little") - 1
    assert [row.name for row in item.modifiers] == ["cama"]
    bpy.ops.cama.remove()
    found["removed"] = [row.name for row in item.modifiers]
    found["files"] = [path.name for path in run.folder.glob("*")]
    return found


def leaves():
    before = len(bpy.app.handlers.load_pre)
    bpy.ops.preferences.addon_disable(module="cama_cloth")
    found = {"property": hasattr(bpy.types.Object, "cama")}
    found["handlers"] = len(bpy.app.handlers.load_pre) - (before - 1)
    found["operators"] = [name for name in OPERATORS if name in dir(bpy.ops.cama)]
    bpy.ops.preferences.addon_enable(module="cama_cloth")
    found["again"] = hasattr(bpy.types.Object, "cama")
    return found


def main():
    bpy.ops.preferences.addon_install(filepath=str(FOLDER / "cama_cloth.zip"))
    seen = {}
    for each in (plays, carries, errors, cancels, leaves):
        fresh()
        with contextlib.redirect_stdout(sys.stderr):
            seen[each.__name__] = each()
    (FOLDER / "seen.json").write_text(json.dumps(seen))


if __name__ == "__main__":
    main()
