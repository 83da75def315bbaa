# SPDX-License-Identifier: Apache-2.0
"""Small valid files of every kind that cama reads, written by the project itself: what `mutate` damages."""

import base64
import json
import struct
from pathlib import Path

import numpy as np

import cama
from cama import _core
from cama.io.recording import NAME as RECORDING
from cama.io.recording import Recorder

LIST = "seeds.list"
SPHERE = {"sphere": {"radius": 0.1, "triangles": 80}}
GRID = {"name": "sheet", "grid": {"size": [0.4, 0.4], "cells": [5, 5]}, "transform": {"translate": [0, 0, 0.12]}}


def scenes():
    """{name: JSON text} of scenes of a few hundred triangles that use every key of a scene file."""
    ball = {"name": "ball", **SPHERE, "friction": 0.3, "static_friction": 0.4, "thickness": 0.002}
    sheet = {**GRID, "material": "cotton", "velocity": [0, 0, -0.1], "thickness": 0.001}
    pin = {"cloth": "sheet", "corners": ["top_left", "top_right"], "release": 0.5}
    turned = {"axis": [0, 0, 1], "angle_deg": 30}
    keys = [{"time": 0}, {"time": 0.1, "translate": [0.1, 0, 0], "rotate": turned, "scale": 1.0}]
    material = {"isotropic": {"youngs_modulus": 1000, "poisson_ratio": 0.3, "bending": 1e-5, "density": 0.2}}
    ramp = {"name": "ramp", "box": {"size": [1, 1, 0.1], "triangles": 48}, "motion": {"keys": keys}}
    inline = {"position": [[0, 0, 0.3], [0.2, 0, 0.3], [0.2, 0.2, 0.3], [0, 0.2, 0.3]], "face": [0, 1, 2, 0, 2, 3]}
    orthotropic = {"youngs_warp": 900, "youngs_weft": 700, "shear": 200, "poisson_ratio": 0.2}
    stitch = {"a": {"cloth": 0, "vertex": 0}, "b": {"cloth": 0, "vertex": 30, "other": 31, "ratio": 0.5}}
    walker = {"walker": {"height": 1.6, "cell": 0.06, "rest": 0.1, "period": 1, "duration": 0.5}}
    up = {"transform": {"translate": [0, 0, 1], "quaternion": [1, 0, 0, 0]}}
    top = {"time_step": 0.005, "frame_time": 0.01, "frames": 1, "options": {"accuracy": "preview"}}
    return {
        "drape": {
            **top,
            "name": "drape",
            "gravity": [0, 0, -9.81],
            "wind": {"velocity": [1, 0, 0], "density": 1.2, "drag": 0.1},
            "contact": {"enabled": True, "self": True, "thickness": 0.001, "stiffness": 1e6, "friction": 0.2},
            "cloth": [sheet],
            "obstacles": [ball],
            "pins": [pin],
        },
        "moving": {
            **top,
            "resolution": 60,
            "materials": {"canvas": material, "twill": {"orthotropic": orthotropic}},
            "cloth": [
                {"name": "tube", "tube": {"radius": 0.2, "height": 0.3, "seams": 2}, "material": "canvas", **up},
                {"name": "patch", "mesh": inline, "material": "twill"},
            ],
            "obstacles": [
                ramp,
                {"shape": {"capsule": {"radius": 0.05, "length": 0.2}}, "transform": {"translate": [0, 0, 3]}},
                {"shape": {"plane": {"normal": [0, 0, 1]}}, "transform": {"translate": [0, 0, -1]}},
                {"capsule": {"radius": 0.05, "length": 0.2, "triangles": 60}, "transform": {"translate": [3, 0, 0]}},
                {"funnel": {"triangles": 300}, "transform": {"translate": [9, 0, 0]}},
            ],
            "pins": [{"cloth": "patch", "vertices": [0], "attach": "ramp"}],
            "stitches": [stitch],
        },
        "walker": {
            **top,
            "resolution": 100,
            "obstacles": [{"name": "body", **walker}],
            "cloth": [{"name": "skirt", "garment": {"skirt": {"body": "body", "panels": 4, "length": 0.4}}}],
        },
        "files": {
            **top,
            "cloth": [{"name": "sheet", "file": {"path": "sheet.obj", "scale": 1, "weld": True, "units": "m"}}],
            "obstacles": [
                {"name": "ball", "file": {"path": "ball.ply", "up": "z"}, "transform": {"translate": [0, 0, -1]}},
                {
                    "name": "body",
                    "character": {"file": "body.gltf", "clip": "rise", "samples_per_second": 5, "loops": 2},
                },
                {
                    "name": "blended",
                    "character": {"file": "morph.gltf", "samples_per_second": 5, "lead_in": 0.5, "units": "cm"},
                    "transform": {"translate": [0, 0, -5]},
                },
            ],
        },
    }


def ball():
    """Vertices [n, 3] and triangles [m, 3] of a sphere."""
    part = cama.Scene().add_obstacle(shape=SPHERE)
    return part.vertices, part.faces


def obj(vertices, faces):
    lines = ["v {:.17g} {:.17g} {:.17g}".format(*v) for v in vertices] + [f"vt {v[0]:g} {v[1]:g}" for v in vertices]
    lines += ["f " + " ".join(f"{i + 1}/{i + 1}" for i in face) for face in faces] + ["stitch 0 3 4 0.5"]
    return "\n".join(lines).encode() + b"\n"


def ply(vertices, faces, binary):
    kind = "binary_little_endian" if binary else "ascii"
    head = f"ply\nformat {kind} 1.0\nelement vertex {len(vertices)}\n"
    head += "".join(f"property float {axis}\n" for axis in "xyz")
    head += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    if not binary:
        lines = [" ".join(f"{x:.9g}" for x in v) for v in vertices] + ["3 " + " ".join(map(str, f)) for f in faces]
        return (head + "\n".join(lines) + "\n").encode()
    rows = np.zeros(len(faces), dtype=[("count", "u1"), ("corner", "<i4", 3)])
    rows["count"], rows["corner"] = 3, faces
    return head.encode() + vertices.astype("<f4").tobytes() + rows.tobytes()


def stl(vertices, faces, binary):
    corners = vertices[faces]
    if not binary:
        body = "".join(
            "facet normal 0 0 0\nouter loop\n"
            + "".join("vertex {:.9g} {:.9g} {:.9g}\n".format(*v) for v in t)
            + "endloop\nendfacet\n"
            for t in corners
        )
        return f"solid ball\n{body}endsolid ball\n".encode()
    rows = np.zeros(len(faces), dtype=[("normal", "<f4", 3), ("corner", "<f4", (3, 3)), ("attribute", "<u2")])
    rows["corner"] = corners
    return b"ball".ljust(80, b"\0") + struct.pack("<I", len(faces)) + rows.tobytes()


def gltf_parts():
    """JSON and buffer of a skinned tetrahedron whose clip "rise" lifts its bone."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]], np.float32)
    arrays = [
        (corners, "VEC3", 5126),
        (np.array([0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3], np.uint16), "SCALAR", 5123),
        (np.zeros((4, 4), np.uint8), "VEC4", 5121),
        (np.tile(np.array([1, 0, 0, 0], np.float32), (4, 1)), "VEC4", 5126),
        (np.array([0, 2], np.float32), "SCALAR", 5126),
        (np.array([[0, 0, 0], [0, 4, 0]], np.float32), "VEC3", 5126),
        (np.eye(4, dtype=np.float32)[None], "MAT4", 5126),
    ]
    data, views, accessors = b"", [], []
    for number, (array, kind, component) in enumerate(arrays):
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": array.nbytes})
        data += array.tobytes() + b"\0" * (-array.nbytes % 4)
        accessors.append({"bufferView": number, "componentType": component, "count": len(array), "type": kind})
    file = {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": len(data)}],
        "bufferViews": views,
        "accessors": accessors,
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "JOINTS_0": 2, "WEIGHTS_0": 3}, "indices": 1}]}],
        "skins": [{"joints": [1], "inverseBindMatrices": 6}],
        "nodes": [{"name": "body", "mesh": 0, "skin": 0}, {"name": "bone"}],
        "scenes": [{"nodes": [0, 1]}],
        "scene": 0,
        "animations": [
            {
                "name": "rise",
                "samplers": [{"input": 4, "output": 5}],
                "channels": [{"sampler": 0, "target": {"node": 1, "path": "translation"}}],
            }
        ],
    }
    return file, data


def morph_parts():
    """As gltf_parts, but two morph targets, one of them sparse, and a node that turns by a cubic spline move it."""
    file, data = gltf_parts()
    file["skins"], file["nodes"] = [], [{"name": "body", "mesh": 0}]
    file["scenes"] = [{"nodes": [0]}]
    arrays = [
        (np.array([[0, 0, 0], [0.5, 0, 0], [0, 0, 0], [0, 0, 0.5]], np.float32), "VEC3", 5126),
        (np.array([3], np.uint16), "SCALAR", 5123),
        (np.array([[0, 1, 0]], np.float32), "VEC3", 5126),
        (np.array([0, 255, 128, 0], np.uint8), "SCALAR", 5121),
        (np.array([[0, 0, 0, 0], [0, 0, 0, 1], [0, 0.1, 0, 0]] * 2, np.float32), "VEC4", 5126),
    ]
    for array, kind, component in arrays:
        view = len(file["bufferViews"])
        file["bufferViews"].append({"buffer": 0, "byteOffset": len(data), "byteLength": array.nbytes})
        data += array.tobytes() + b"\0" * (-array.nbytes % 4)
        row = {"bufferView": view, "componentType": component, "count": len(array), "type": kind}
        file["accessors"].append({**row, "normalized": True} if component == 5121 else row)
    where = {"bufferView": 8, "componentType": 5123}
    sparse = {"count": 1, "indices": where, "values": {"bufferView": 9}}
    file["accessors"].append({"componentType": 5126, "count": 4, "type": "VEC3", "sparse": sparse})
    primitive = {"attributes": {"POSITION": 0}, "indices": 1, "targets": [{"POSITION": 7}, {"POSITION": 12}]}
    file["meshes"] = [{"primitives": [primitive], "weights": [0, 0]}]
    file["buffers"] = [{"byteLength": len(data)}]
    spline = {"input": 4, "output": 11, "interpolation": "CUBICSPLINE"}
    file["animations"][0]["samplers"] = [{"input": 4, "output": 10}, spline]
    file["animations"][0]["channels"] = [
        {"sampler": number, "target": {"node": 0, "path": path}} for number, path in enumerate(("weights", "rotation"))
    ]
    return file, data


def gltf(parts):
    file, data = parts
    file["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    return json.dumps(file, indent=1).encode()


def glb(parts):
    file, data = parts
    text = json.dumps(file).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(data), 0x004E4942) + data
    return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks


def dae(vertices, faces):
    numbers, corners = (" ".join(f"{x:.9g}" for x in np.ravel(a)) for a in (vertices, faces))
    return f"""<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit meter="1" name="meter"/><up_axis>Y_UP</up_axis></asset>
<library_geometries><geometry id="ball" name="ball"><mesh>
<source id="p"><float_array id="a" count="{vertices.size}">{numbers}</float_array><technique_common>
<accessor source="#a" count="{len(vertices)}" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
<param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="{len(faces)}"><input semantic="VERTEX" source="#v" offset="0"/><p>{corners}</p></triangles>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node id="n"><instance_geometry url="#ball"/></node></visual_scene>
</library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>
""".encode()


def fbx(vertices, faces):
    """ASCII, version 7.3."""
    numbers = ",".join(f"{x:.9g}" for x in vertices.ravel())
    corners = ",".join(f"{a},{b},{-c - 1}" for a, b, c in faces)
    return f"""; FBX 7.3.0 project file
FBXHeaderExtension:  {{
 FBXHeaderVersion: 1003
 FBXVersion: 7300
}}
GlobalSettings:  {{
 Version: 1000
}}
Objects:  {{
 Geometry: 1, "Geometry::ball", "Mesh" {{
  Vertices: *{vertices.size} {{
   a: {numbers}
  }}
  PolygonVertexIndex: *{faces.size} {{
   a: {corners}
  }}
  GeometryVersion: 124
 }}
 Model: 2, "Model::ball", "Mesh" {{
  Version: 232
 }}
}}
Connections:  {{
 C: "OO",1,2
 C: "OO",2,0
}}
""".encode()


def meshes():
    """{file name: bytes} of a mesh in every format that cama reads."""
    body = ball()
    return {
        "sheet.obj": obj(*sheet()),
        "ball.ply": ply(*body, binary=False),
        "binary.ply": ply(*body, binary=True),
        "ball.stl": stl(*body, binary=False),
        "binary.stl": stl(*body, binary=True),
        "body.gltf": gltf(gltf_parts()),
        "body.glb": glb(gltf_parts()),
        "morph.gltf": gltf(morph_parts()),
        "morph.glb": glb(morph_parts()),
        "ball.dae": dae(*body),
        "ball.fbx": fbx(*body),
    }


def sheet():
    part = cama.Scene().add_cloth(shape={"grid": {"size": [0.4, 0.4], "cells": [4, 4]}})
    return part.vertices + [0, 0, 0.5], part.faces


def material():
    """The text of a material file, with every table of a fabric."""
    cotton = _core.Material.fabric("cotton")
    return json.dumps(
        {
            "density": cotton.density,
            "stretching": [list(row) for row in cotton.stretching],
            "bending": [list(row) for row in cotton.bending],
            "damping": 0.001,
        }
    )


def falling():
    """The simulation that the checkpoint and the recording are of."""
    scene = cama.Scene.parse(scenes()["drape"])
    return cama.Simulation(scene, backend="cpu", threads=1, accuracy="preview")


def listed(folder):
    """{kind: list of files} of the seeds that `write` has written."""
    return {
        kind: [Path(name) for name in names] for kind, names in json.loads((Path(folder) / LIST).read_text()).items()
    }


def write(folder):
    """Writes all seeds; returns {kind: list of files}. Kinds: scene, mesh, material, checkpoint, recording."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    kinds = {"scene": [], "mesh": [], "material": [], "checkpoint": [], "recording": []}

    def put(kind, name, content):
        path = folder / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        kinds[kind].append(path)

    for name, content in meshes().items():
        put("mesh", name, content)
    for name, scene in scenes().items():
        put("scene", f"{name}.json", json.dumps(scene, indent=1))
    put("scene", "saved.json", cama.Scene.parse(scenes()["drape"]).to_json())
    put("material", "fabric.json", material())
    simulation = falling()
    with Recorder(folder / RECORDING, simulation, {"scene": "drape", "frame_time": 0.01}) as recorder:
        for _ in range(3):
            recorder.add(simulation.time, simulation.positions, 0, 0)
            simulation.step()
    simulation.save_checkpoint(folder / "checkpoint.h5")
    kinds["checkpoint"].append(folder / "checkpoint.h5")
    kinds["recording"].append(folder / RECORDING)
    (folder / LIST).write_text(json.dumps({kind: [str(path) for path in paths] for kind, paths in kinds.items()}))
    return kinds
