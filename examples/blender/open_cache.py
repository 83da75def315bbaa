# SPDX-License-Identifier: Apache-2.0
"""Opens what `cama export OUT --to mdd` wrote in Blender: every mesh, moved by a Mesh Cache modifier.

Run it in Blender 4.2 or later, or with Python and the package bpy:

    blender --python examples/blender/open_cache.py -- out/drape/export/mdd
    python examples/blender/open_cache.py out/drape/export/mdd --save drape.blend

Options after the folder: --save FILE.blend, and --render FILE.png, which draws the last frame.
"""

import argparse
import struct
import sys
from pathlib import Path

import bpy
from mathutils import Vector


def read_times(file):
    """Returns the times of the frames of an MDD file, s."""
    with open(file, "rb") as mdd:
        (frames,) = struct.unpack(">i", mdd.read(4))
        mdd.read(4)  # number of points
        return struct.unpack(f">{frames}f", mdd.read(4 * frames))


def open_cache(folder):
    """Imports every mesh of a folder with its cache, first frame at 1. Returns the objects."""
    objects = []
    for cache in sorted(Path(folder).glob("*.mdd")):
        bpy.ops.wm.obj_import(filepath=str(cache.with_suffix(".obj")), forward_axis="Y", up_axis="Z")
        mesh = bpy.context.selected_objects[0]
        mesh.data.shade_smooth()
        modifier = mesh.modifiers.new("cama", "MESH_CACHE")
        modifier.cache_format = "MDD"
        modifier.filepath = str(cache.resolve())
        modifier.forward_axis, modifier.up_axis = "POS_Y", "POS_Z"  # axes of the file are Blender's
        modifier.frame_start = 1
        objects.append(mesh)
        set_frames(read_times(cache))
    return objects


def set_frames(times):
    """Sets range and rate of the frames, so that playback has the simulation's speed."""
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, len(times)
    if len(times) > 1:
        rate = (len(times) - 1) / (times[-1] - times[0])
        scene.render.fps = max(1, round(rate))
        scene.render.fps_base = scene.render.fps / rate


def render(objects, file):
    """Draws the last frame with Cycles: a camera that sees all, and one lamp."""
    scene = bpy.context.scene
    scene.frame_set(scene.frame_end)
    graph = bpy.context.evaluated_depsgraph_get()
    points = [mesh.matrix_world @ v.co for mesh in objects for v in mesh.evaluated_get(graph).data.vertices]
    low, high = (Vector(f(p[k] for p in points) for k in range(3)) for f in (min, max))
    center, size = (low + high) / 2, (high - low).length
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.location = center + size * Vector((0.6, -1.1, 0.5))
    camera.rotation_euler = (center - camera.location).to_track_quat("-Z", "Y").to_euler()
    lamp = bpy.data.objects.new("lamp", bpy.data.lights.new("lamp", "SUN"))
    lamp.data.energy, lamp.rotation_euler = 2, (0.8, 0.1, 0.6)
    for new in (camera, lamp):
        scene.collection.objects.link(new)
    scene.camera = camera
    scene.world = bpy.data.worlds.new("world")
    if scene.world.node_tree is None:  # before Blender 5
        scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.8, 0.8, 0.8, 1)
    scene.render.engine, scene.cycles.samples, scene.cycles.use_denoising = "CYCLES", 16, False
    scene.render.resolution_x, scene.render.resolution_y = 640, 480
    scene.render.filepath = str(Path(file).resolve())
    bpy.ops.render.render(write_still=True)


def main():
    """Reads the command line, which Blender gives after `--`."""
    own = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    parser = argparse.ArgumentParser(description="Opens caches that cama has exported.")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--save", type=Path, metavar="FILE.blend")
    parser.add_argument("--render", type=Path, metavar="FILE.png")
    chosen = parser.parse_args(own)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    objects = open_cache(chosen.folder)
    if not objects:
        sys.exit(f"{chosen.folder}: no .mdd file; `cama export OUT --to mdd` writes them")
    print(f"{len(objects)} meshes, {bpy.context.scene.frame_end} frames")
    if chosen.render:
        render(objects, chosen.render)
    if chosen.save:
        bpy.ops.wm.save_as_mainfile(filepath=str(chosen.save.resolve()))


if __name__ == "__main__":
    main()
