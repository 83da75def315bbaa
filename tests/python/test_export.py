# SPDX-License-Identifier: Apache-2.0
"""Recordings in formats of other programs, opened again by libraries of each format, or by their published layout."""

import json
import os
import signal
import struct
import subprocess
import sys
import time
import xml.etree.ElementTree as xml

import h5py
import numpy as np
import pytest

import cama
from cama.io.exporting import export
from cama.io.recording import Recording
from conftest import grid

AS_IT_IS = {"process": False, "fix_texture": False}  # for trimesh
SINGLE = 2.0**-23  # relative error of a number in single precision, and some room


def textured_obj(path):
    """A square of two panels whose seam is open in its texture coordinates."""
    path.write_text(
        "v 0 0 1\nv 0.1 0 1\nv 0.2 0 1\nv 0 0.1 1\nv 0.1 0.1 1\nv 0.2 0.1 1\n"
        "vt 0 0\nvt 0.5 0\nvt 0 1\nvt 0.5 1\nvt 0.6 0\nvt 1 0\nvt 0.6 1\nvt 1 1\n"
        "f 1/1 2/2 5/4\nf 1/1 5/4 4/3\nf 2/5 3/6 6/8\nf 2/5 6/8 5/7\n"
    )
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A recording of a sheet, a seamed cloth, a fixed and a moving obstacle and an exact sphere: 5 frames."""
    path = tmp_path_factory.mktemp("formats")
    scene = {
        "name": "two cloths",
        "frame_time": 0.02,
        "frames": 4,
        "cloth": [
            {"name": "sheet", "grid": {"size": [0.4, 0.3], "cells": [6, 5]}, "material": "silk"},
            {"name": "my patch", "file": "patch.obj", "material": "cotton"},
        ],
        "obstacles": [
            {"name": "floor", "plane": {"size": [1, 1], "triangles": 8}, "transform": {"translate": [0, 0, -0.3]}},
            {
                "name": "wall",
                "mesh": {"position": [[2, 0, 0], [2, 1, 0], [2, 0, 1]], "face": [[0, 1, 2]]},
                "motion": {"velocity": [0.5, 0, 0]},
            },
            {"name": "ball", "shape": {"sphere": {"radius": 0.1}}, "transform": {"translate": [1, 0, 0.5]}},
        ],
    }
    (path / "scene.json").write_text(json.dumps(scene))
    textured_obj(path / "patch.obj")
    command = [sys.executable, "-m", "cama", "run", str(path), "--accuracy", "preview", "-o", str(path / "out")]
    subprocess.run(command, check=True, capture_output=True)
    return path / "out"


@pytest.fixture(scope="module")
def recorded(folder):
    """Positions [frames, vertices, 3] of the recording, read by h5py alone."""
    with h5py.File(folder / "frames.h5") as file:
        return file["positions"][:]


def parts(recorded):
    """Positions of the sheet, the patch, the floor and the wall, [frames, vertices, 3] each."""
    return recorded[:, :42], recorded[:, 42:48], recorded[:, 48:57], recorded[:, 57:60]


def on_ball(points):
    return np.allclose(np.linalg.norm(np.asarray(points) - [1, 0, 0.5], axis=1), 0.1, atol=1e-6)


def obj_points(file):
    """Vertices [n, 3] of an OBJ file in its order."""
    return np.array([line.split()[1:] for line in file.read_text().splitlines() if line.startswith("v ")], float)


def close(exported, expected, scale=1.0):
    """Whether positions are equal in single precision; `scale` is the largest number they were computed from."""
    return np.allclose(exported, expected, rtol=SINGLE, atol=SINGLE * scale)


# Texture coordinates [faces, 3, 2] as the files give them: those of the OBJ file above, and metres of the sheet.
PATCH = np.array(
    [
        [[0, 0], [0.5, 0], [0.5, 1]],
        [[0, 0], [0.5, 1], [0, 1]],
        [[0.6, 0], [1, 0], [1, 1]],
        [[0.6, 0], [1, 1], [0.6, 1]],
    ]
)
PATCH_FACES = [[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]]


def sheet_texture(recorded, faces):
    """Texture coordinates of the corners of the flat sheet: its positions at the start up to a shift, m."""
    return recorded[0, :42, :2][faces]


def same_up_to_a_shift(a, b):
    difference = (a - b).reshape(-1, 2)
    return np.allclose(difference, difference[0], atol=1e-6)


@pytest.mark.parametrize("save_after", [1 << 28, 1])  # bytes; 1: after every frame
def test_usd_is_what_was_recorded(folder, recorded, tmp_path, monkeypatch, save_after):
    pytest.importorskip("pxr")
    from pxr import Usd, UsdGeom, UsdShade

    monkeypatch.setattr("cama.io.exporting.usd.SAVE_AFTER", save_after)
    result = export(folder, "usd", tmp_path)
    assert [f.name for f in result.files] == ["out.usdc"] and result.frames == 5 and result.fps == 50
    stage = Usd.Stage.Open(str(result.files[0]))
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1 and UsdGeom.GetStageUpAxis(stage) == "Z"
    assert stage.GetTimeCodesPerSecond() == stage.GetFramesPerSecond() == 50
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (0, 4)
    root = stage.GetDefaultPrim()
    meshes = {p.GetDisplayName(): UsdGeom.Mesh(p) for p in stage.Traverse() if p.IsA(UsdGeom.Mesh)}
    assert list(meshes) == ["sheet", "my patch", "floor", "wall", "ball"]
    assert meshes["my patch"].GetPath() == root.GetPath().AppendChild("my_patch")
    for name, expected in zip(meshes, parts(recorded)):
        points = meshes[name].GetPointsAttr()
        assert points.GetNumTimeSamples() == (0 if name == "floor" else 5)
        for code in range(5):
            assert close(points.Get(code), expected[code])
            low, high = meshes[name].GetExtentAttr().Get(code)
            assert np.allclose(low, expected[code].min(axis=0)) and np.allclose(high, expected[code].max(axis=0))
    assert on_ball(meshes["ball"].GetPointsAttr().Get())
    assert np.array_equal(np.reshape(meshes["my patch"].GetFaceVertexIndicesAttr().Get(), (-1, 3)), PATCH_FACES)
    st = UsdGeom.PrimvarsAPI(meshes["my patch"]).GetPrimvar("st")
    assert st.GetInterpolation() == "faceVarying" and st.GetTypeName() == "texCoord2f[]"
    assert np.allclose(np.reshape(st.ComputeFlattened(), (-1, 3, 2)), PATCH)
    faces = np.reshape(meshes["sheet"].GetFaceVertexIndicesAttr().Get(), (-1, 3))
    st = np.reshape(UsdGeom.PrimvarsAPI(meshes["sheet"]).GetPrimvar("st").ComputeFlattened(), (-1, 3, 2))
    assert same_up_to_a_shift(st, sheet_texture(recorded, faces))
    for name, material in (("sheet", "silk"), ("my patch", "cotton"), ("wall", None)):
        bound, _ = UsdShade.MaterialBindingAPI(meshes[name]).ComputeBoundMaterial()
        assert (bound.GetPrim().GetDisplayName() if bound else None) == material


def test_usd_in_centimetres_is_the_same_size(folder, recorded, tmp_path):
    pytest.importorskip("pxr")
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.Open(str(export(folder, "usd", tmp_path, units="cm", cloth_only=True).files[0]))
    assert UsdGeom.GetStageMetersPerUnit(stage) == 0.01
    meshes = [UsdGeom.Mesh(p) for p in stage.Traverse() if p.IsA(UsdGeom.Mesh)]
    assert len(meshes) == 2 and close(meshes[0].GetPointsAttr().Get(3), 100 * recorded[3, :42])


def glb_frames(file):
    """Corners [faces, 3, 3] of each mesh of a GLB in each frame, as pygltflib reads the arrays, turned to z up."""
    pygltflib = pytest.importorskip("pygltflib")
    gltf = pygltflib.GLTF2().load(str(file))
    data = gltf.binary_blob()

    def array(number):
        a = gltf.accessors[number]
        width, kind = {"SCALAR": 1, "VEC2": 2, "VEC3": 3}[a.type], {5126: "<f4", 5125: "<u4"}[a.componentType]
        view = gltf.bufferViews[a.bufferView]
        values = np.frombuffer(data, kind, a.count * width, view.byteOffset + (a.byteOffset or 0)).reshape(-1, width)
        if a.min:
            assert np.array_equal(values.min(axis=0), np.float32(a.min))
            assert np.array_equal(values.max(axis=0), np.float32(a.max))
        return values

    assert gltf.nodes[0].rotation == pytest.approx([-np.sqrt(0.5), 0, 0, np.sqrt(0.5)])
    weights, times = {}, None
    for animation in gltf.animations:
        for channel in animation.channels:
            sampler = animation.samplers[channel.sampler]
            times = array(sampler.input)[:, 0]
            weights[channel.target.node] = array(sampler.output).reshape(len(times), -1)
    result = {}
    for number, node in enumerate(gltf.nodes):
        if node.mesh is None:
            continue
        mesh = gltf.meshes[node.mesh]
        primitive = mesh.primitives[0]
        base, faces = array(primitive.attributes.POSITION), array(primitive.indices).reshape(-1, 3)
        targets = np.array([array(t["POSITION"]) for t in primitive.targets]).reshape(-1, *base.shape)
        frames = [base + np.tensordot(w, targets, 1) for w in weights.get(number, np.zeros((1, 0)))]
        uv = primitive.attributes.TEXCOORD_0
        result[node.name] = (
            [f[faces] for f in frames],
            None if uv is None else (array(uv) * [1, -1] + [0, 1])[faces],
            None if primitive.material is None else gltf.materials[primitive.material].name,
        )
    return result, times


def test_gltf_is_what_was_recorded(folder, recorded, tmp_path):
    trimesh = pytest.importorskip("trimesh")
    result = export(folder, "gltf", tmp_path)
    assert [f.name for f in result.files] == ["out.glb"]
    meshes, times = glb_frames(result.files[0])
    assert list(meshes) == ["sheet", "my patch", "floor", "wall", "ball"]
    assert np.allclose(times, 0.02 * np.arange(5))
    with Recording(folder) as recording:
        faces = [part.faces for part in recording.cloths + recording.obstacles]
    for name, expected, own in zip(meshes, parts(recorded), faces):
        frames, _, _ = meshes[name]
        assert len(frames) == (1 if name == "floor" else 5)
        assert all(close(corners, x[own], np.abs(expected).max()) for corners, x in zip(frames, expected))
    assert np.allclose(meshes["my patch"][1], PATCH, atol=1e-6)
    assert [meshes[name][2] for name in ("sheet", "my patch", "wall")] == ["silk", "cotton", None]
    scene = trimesh.load(result.files[0])  # y is up for its reader
    ball = scene.geometry["ball"]
    assert ball.is_watertight and 0.98 < ball.volume / (4 / 3 * np.pi * 0.1**3) < 1  # within the sphere
    turned = recorded[0, :42][:, [0, 2, 1]] * [1, 1, -1]
    sheet = [m for m in scene.dump() if len(m.faces) == 60][0]
    assert np.allclose(
        sorted(map(tuple, np.round(sheet.vertices, 5))), sorted(map(tuple, np.round(turned, 5))), atol=2e-5
    )


def test_gltf_says_how_much_it_holds(tmp_path):
    from cama.io.exporting import gltf

    class Long:
        def __len__(self):
            return 4000

    with pytest.raises(cama.SceneError, match=r"4000 frames of 100000 moving vertices take 4.5 GiB.*--?usd|usd"):
        gltf._check_size(Long(), [100000], [True])


def test_obj_sequence_is_what_was_recorded(folder, recorded, tmp_path):
    trimesh = pytest.importorskip("trimesh")
    result = export(folder, "obj", tmp_path)
    assert [f.name for f in result.files] == ["out.mtl"] + [f"out_{i:04d}.obj" for i in range(5)]
    count = parts(recorded)[0].shape[1] + 6 + 9 + 3
    for frame in range(5):
        points = obj_points(result.files[1 + frame])
        assert np.allclose(points[:count], recorded[frame, :count], rtol=1e-8, atol=1e-9)
        assert on_ball(points[count:])
    scene = trimesh.load(result.files[5], split_objects=True, process=False)
    objects = ["sheet_silk", "my_patch_cotton", "floor_obstacle", "wall_obstacle", "ball_obstacle"]
    assert sorted(scene.geometry) == sorted(objects)  # trimesh adds the material to the name
    patch = scene.geometry["my_patch_cotton"]
    corners = recorded[4, 42:48][np.array(PATCH_FACES)]
    assert np.allclose(patch.vertices[patch.faces], corners, atol=1e-8)
    assert np.allclose(patch.visual.uv[patch.faces], PATCH)
    # Read by cama's own reader, the patch keeps its order of vertices and its texture coordinates.
    alone = export(folder, "obj", tmp_path / "alone", cloth_only=True, first=2, last=2)
    mesh = cama.Scene().add_cloth(alone.files[1], rest="uv")
    assert np.allclose(mesh.vertices, recorded[2, :48], rtol=1e-8, atol=1e-9)
    assert np.allclose(mesh.material_vertices[mesh.material_faces][60:], PATCH)


def test_ply_sequence_is_what_was_recorded(folder, recorded, tmp_path):
    trimesh = pytest.importorskip("trimesh")
    files = export(folder, "ply", tmp_path).files
    assert [f.name for f in files] == [f"out_{i:04d}.ply" for i in range(5)]
    for frame, file in enumerate(files):
        mesh = trimesh.load(file, **AS_IT_IS)
        assert close(mesh.vertices[:60], recorded[frame, :60])
        assert np.array_equal(mesh.faces[60:64], np.array(PATCH_FACES) + 42)
        records = mesh.metadata["_ply_raw"]["face"]["data"]
        assert np.allclose(records["texcoord"]["f1"][60:64].reshape(-1, 3, 2), PATCH)
        assert np.bincount(records["object"])[:4].tolist() == [60, 4, 8, 1]
    cloth = trimesh.load(export(folder, "ply", tmp_path / "cloth", cloth_only=True).files[3], **AS_IT_IS)
    assert close(cloth.vertices, recorded[3, :48])
    header = files[0].read_bytes().split(b"end_header")[0].decode()
    assert "comment object 1: my patch, cotton, vertices 42 to 47\n" in header


def test_pc2_and_mdd_follow_their_published_layout(folder, recorded, tmp_path):
    names = ["sheet", "my_patch", "floor", "wall"]
    pc2, mdd = export(folder, "pc2", tmp_path / "pc2"), export(folder, "mdd", tmp_path / "mdd")
    assert {f.name for f in pc2.files} == {f"{n}.{e}" for n in [*names, "ball"] for e in ("pc2", "obj")} | {"out.mtl"}
    assert len(mdd.files) == 11
    for name, expected in zip(names, parts(recorded)):
        data = (tmp_path / "pc2" / f"{name}.pc2").read_bytes()
        # char signature[12]; int version, points; float start, rate; int samples; float x, y, z of each: little-endian
        assert struct.unpack("<12siiffi", data[:32]) == (b"POINTCACHE2\0", 1, expected.shape[1], 0, 1, 5)
        assert close(np.frombuffer(data[32:], "<f4").reshape(expected.shape), expected)
        data = (tmp_path / "mdd" / f"{name}.mdd").read_bytes()
        # int frames, points; float time of each frame, s; float x, y, z of each: big-endian
        assert struct.unpack(">ii5f", data[:28]) == pytest.approx((5, expected.shape[1], 0, 0.02, 0.04, 0.06, 0.08))
        assert close(np.frombuffer(data[28:], ">f4").reshape(expected.shape), expected)
        for kind in ("pc2", "mdd"):
            assert np.allclose(obj_points(tmp_path / kind / f"{name}.obj"), expected[0], atol=1e-8)


def test_vtk_series_is_what_was_recorded(folder, recorded, tmp_path):
    pyvista = pytest.importorskip("pyvista")
    export(folder, "vtk", tmp_path)
    entries = xml.parse(tmp_path / "out.pvd").getroot().findall("Collection/DataSet")
    assert [float(e.get("timestep")) for e in entries] == pytest.approx(0.02 * np.arange(5))
    with h5py.File(folder / "frames.h5") as file:
        contacts = file["contacts"][:]
    for frame, entry in enumerate(entries):
        mesh = pyvista.read(tmp_path / entry.get("file"))
        assert np.array_equal(mesh.points[:60], recorded[frame, :60])  # double precision
        assert np.array_equal(mesh.regular_faces[60:64], np.array(PATCH_FACES) + 42)
        assert list(mesh.field_data["objects"]) == ["sheet", "my patch", "floor", "wall", "ball"]
        assert list(mesh.field_data["materials"])[:3] == ["silk", "cotton", ""]
        assert mesh.field_data["contacts"] == contacts[frame] and mesh.field_data["intersections"] == 0
        assert np.bincount(mesh.cell_data["object"])[:4].tolist() == [60, 4, 8, 1]
        assert np.allclose(mesh.cell_data["texture_coordinates"][60:64].reshape(-1, 3, 2), PATCH)
    reader = pyvista.get_reader(tmp_path / "out.pvd")
    assert reader.time_values == pytest.approx(0.02 * np.arange(5))


def seamless(tmp_path):
    """A recording of one sheet with texture coordinates but no seam, of 3 frames at 0, 0.1 and 0.2 s."""
    scene = cama.Scene(time_step=0.01, frame_time=0.1, frames=2, contact=False)
    scene.add_cloth(shape={"grid": {"size": [1, 1], "cells": [2, 2]}}, name="sheet")
    scene.save(tmp_path / "scene.json")
    subprocess.run(
        [sys.executable, "-m", "cama", "run", str(tmp_path), "-o", str(tmp_path / "out")],
        check=True,
        capture_output=True,
    )
    return tmp_path / "out"


def test_frames_axis_and_unit_are_chosen(tmp_path):
    pyvista = pytest.importorskip("pyvista")
    folder = seamless(tmp_path)
    with h5py.File(folder / "frames.h5") as file:
        positions = file["positions"][:]
    mesh = pyvista.read(export(folder, "vtk").files[2])  # one texture coordinate a vertex: VTK's own place for them
    assert same_up_to_a_shift(mesh.active_texture_coordinates, positions[0, :, :2])
    result = export(folder, "ply", fps=20, up="y", units="cm")
    assert result.frames == 5 and result.fps == 20  # at 0, 0.05, ... 0.2 s
    half = 50 * (positions[0] + positions[1])[:, [0, 2, 1]] * [1, 1, -1]
    trimesh = pytest.importorskip("trimesh")
    assert close(trimesh.load(result.files[1], **AS_IT_IS).vertices, half, 100)
    again = export(folder, "ply", every=2)
    assert again.frames == 2 and again.fps == 5
    assert [f.name for f in (folder / "export" / "ply").iterdir() if f.suffix == ".ply"].__len__() == 2
    assert close(trimesh.load(again.files[1], **AS_IT_IS).vertices, positions[2])


def test_arguments_that_do_not_fit_are_named(folder, tmp_path):
    for arguments, text in (
        (dict(to="usdz"), "no format 'usdz'.*did you mean 'usd'"),
        (dict(to="usd", up="y"), "up: a USD file says"),
        (dict(to="gltf", units="cm"), "units: lengths in glTF are metres"),
        (dict(to="obj", up="x"), "up: 'x'"),
        (dict(to="obj", units="km"), "units: 'km' is none of m, metre"),
        (dict(to="obj", first=3, last=9), "frames 3 to 9 are not all there; frames 0 to 4"),
        (dict(to="obj", fps=10, every=2), "give one of them"),
        (dict(to="obj", fps=-1), "fps: -1 is not above 0"),
        (dict(to="obj", every=0), "every: 0"),
    ):
        with pytest.raises(cama.SceneError, match=text):
            export(folder, output=tmp_path / "none", **arguments)
    with pytest.raises(cama.FileError, match="no such file"):
        export(tmp_path / "nothing", "obj")
    assert not (tmp_path / "none").exists()


@pytest.mark.parametrize("to", ["usd", "gltf", "obj", "ply", "pc2", "mdd", "vtk"])
def test_what_stops_leaves_nothing_half_written(folder, tmp_path, to):
    def stop(done, total):
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        export(folder, to, tmp_path, progress=stop)
    assert not list(tmp_path.iterdir())
    (tmp_path / "file").write_text("")
    with pytest.raises(cama.FileError, match="writing failed"):
        export(folder, to, tmp_path / "file" / "below")


def test_a_full_disk_leaves_nothing_half_written(folder, tmp_path):
    """Files may have 500 bytes, as if the disk were full then."""
    program = """
import resource, sys
import cama, pxr.Usd, vtkmodules.vtkIOXML
from cama.io.exporting import FORMATS, export
resource.setrlimit(resource.RLIMIT_FSIZE, (500, 500))
for to in FORMATS:
    try:
        export(sys.argv[1], to, f"{sys.argv[2]}/{to}")
    except cama.FileError as problem:
        print(to, problem)
"""
    command = [sys.executable, "-c", program, str(folder), str(tmp_path)]
    said = subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()
    assert [line.split()[0] for line in said] == ["usd", "gltf", "obj", "ply", "pc2", "mdd", "vtk"]
    assert all("writing failed (" in line and line.endswith("is the disk full?") for line in said)
    assert len(list(tmp_path.iterdir())) == 7 and not list(tmp_path.glob("*/*"))


def test_a_library_that_is_missing_is_named(folder, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pxr", None)
    with pytest.raises(cama.BackendError, match="exporting USD needs usd-core, not installed here; install with"):
        export(folder, "usd", tmp_path)


def test_an_old_recording_without_texture_coordinates_is_exported(folder, tmp_path):
    pytest.importorskip("pxr")
    from pxr import Usd, UsdGeom

    with h5py.File(folder / "frames.h5") as file, h5py.File(tmp_path / "frames.h5", "w") as old:
        for name in file:
            if name != "texture":
                file.copy(name, old)
        del old["cloth_ranges"].attrs["materials"]
    for to in ("gltf", "obj", "ply", "pc2", "mdd", "vtk"):
        assert export(tmp_path, to).files
    stage = Usd.Stage.Open(str(export(tmp_path, "usd").files[0]))
    mesh = [UsdGeom.Mesh(p) for p in stage.Traverse() if p.IsA(UsdGeom.Mesh)][1]
    assert not UsdGeom.PrimvarsAPI(mesh).HasPrimvar("st") and close(
        mesh.GetPointsAttr().Get(4), file_positions(folder)[4, 42:48]
    )


def file_positions(folder):
    with h5py.File(folder / "frames.h5") as file:
        return file["positions"][:]


@pytest.mark.parametrize("to", ["usd", "gltf", "obj", "ply", "pc2", "mdd", "vtk"])
def test_one_frame_and_any_names(tmp_path, to):
    """Two cloths of one name, and names that are no names in any format."""
    vertices, faces = grid(2)
    names = ["cloth", "cloth", "Cloth", "1/ä:\n", ""]
    with h5py.File(tmp_path / "frames.h5", "w") as file:
        file["positions"] = np.concatenate([vertices + [0, 0, k] for k in range(5)])[None]
        file["times"], file["faces"] = [0.0], np.concatenate([faces + 9 * k for k in range(5)]).astype(np.int32)
        for kind, ranges, own in (
            ("cloth", [[9 * k, 9 * k + 9] for k in range(5)], names),
            ("obstacle", np.zeros((0, 2), int), []),
        ):
            file[f"{kind}_ranges"] = np.asarray(ranges)
            file[f"{kind}_ranges"].attrs["names"] = np.array(own, dtype=h5py.string_dtype())
        file["cloth_ranges"].attrs["materials"] = np.array(["a b", "a b", "", "ä", "/"], dtype=h5py.string_dtype())
    result = export(tmp_path, to, tmp_path / "files")
    assert result.frames == 1
    if to == "usd":
        from pxr import Usd, UsdGeom

        stage = Usd.Stage.Open(str(result.files[0]))
        meshes = [p for p in stage.Traverse() if p.IsA(UsdGeom.Mesh)]
        assert [p.GetName() for p in meshes] == ["cloth", "cloth_2", "Cloth_3", "_1", "object"]
        assert [p.GetDisplayName() for p in meshes][:4] == names[:4]
        heights = [UsdGeom.Mesh(p).GetPointsAttr().Get()[0][2] for p in meshes]
    elif to == "gltf":
        meshes = glb_meshes(result.files[0])
        assert [name for name, _ in meshes] == names
        heights = [corners[0, 0, 2] for _, corners in meshes]
    elif to in ("pc2", "mdd"):
        assert sorted({f.stem for f in result.files if f.suffix != ".mtl"}) == [
            "Cloth_3",
            "_1",
            "cloth",
            "cloth_2",
            "object",
        ]
        stems = ["cloth", "cloth_2", "Cloth_3", "_1", "object"]
        heights = [obj_points(tmp_path / "files" / f"{stem}.obj")[0, 2] for stem in stems]
    elif to == "obj":
        heights = obj_points(result.files[1])[::9, 2]
    elif to == "ply":
        heights = pytest.importorskip("trimesh").load(result.files[0], **AS_IT_IS).vertices[::9, 2]
    else:
        heights = pytest.importorskip("pyvista").read(result.files[1]).points[::9, 2]
    assert np.allclose(heights, [0, 1, 2, 3, 4])


def glb_meshes(file):
    """(name, corners [faces, 3, 3]) of each mesh of a GLB as trimesh reads it, at the start, with z up again."""
    trimesh = pytest.importorskip("trimesh")
    pygltflib = pytest.importorskip("pygltflib")
    names = [node.name for node in pygltflib.GLTF2().load(str(file)).nodes[1:]]
    scene = trimesh.load(file, **AS_IT_IS)
    turned = sorted((m.triangles[..., [0, 2, 1]] * [1, -1, 1] for m in scene.dump()), key=lambda t: t[0, 0, 2])
    return list(zip(names, turned))


def test_the_command_writes_and_says_what(folder, tmp_path):
    command = [sys.executable, "-m", "cama", "export", str(folder), "--to", "pc2", "-o", str(tmp_path), "--cloth-only"]
    said = subprocess.run(command, check=True, capture_output=True, text=True)
    assert said.stdout == f"5 frames at 50 frames per second: 4 files in {tmp_path}\n"
    assert "frame 5/5" in said.stderr
    wrong = subprocess.run([*command, "--first", "7"], capture_output=True, text=True)
    assert wrong.returncode == 2 and wrong.stderr.startswith("SceneError: export: frames 7 to 4")


def write_by_hand(file, positions, times, faces):
    """Writes the frames of one sheet as a recording of an early version: without texture coordinates and materials."""
    file["positions"], file["times"], file["faces"] = positions, times, faces.astype(np.int32)
    for kind, ranges, names in (
        ("cloth", [[0, positions.shape[1]]], ["sheet"]),
        ("obstacle", np.zeros((0, 2), int), []),
    ):
        file[f"{kind}_ranges"] = np.asarray(ranges)
        file[f"{kind}_ranges"].attrs["names"] = np.array(names, dtype=h5py.string_dtype())


def test_ctrl_c_ends_the_command_without_a_trace(tmp_path):
    """A recording long enough that the export is still at work."""
    vertices, faces = grid(60)
    with h5py.File(tmp_path / "frames.h5", "w") as file:
        positions = np.broadcast_to(vertices.astype(np.float32), (4000, *vertices.shape))
        write_by_hand(file, positions, np.arange(4000) / 100, faces)
    out = tmp_path / "files"
    command = [sys.executable, "-m", "cama", "export", str(tmp_path), "--to", "obj", "-o", str(out)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        while process.poll() is None and not list(out.glob(".partial-*/*.obj")):
            time.sleep(0.01)
        os.kill(process.pid, signal.SIGINT)
        said = process.communicate(timeout=60)[1]
    assert process.returncode == 130 and "Traceback" not in said
    assert not list(out.iterdir())


@pytest.mark.long
@pytest.mark.parametrize("to", ["usd", "gltf", "obj", "ply", "pc2", "mdd", "vtk"])
def test_twenty_thousand_triangles_in_every_format(tmp_path, to):
    """A wave of closed form, z = sin(8 x + t) / 10 on a square of 1 m, over 60 frames."""
    vertices, faces = grid(100)
    assert len(faces) == 20000
    times = np.arange(60) / 30
    with h5py.File(tmp_path / "frames.h5", "w") as file:
        write_by_hand(file, np.array([wave(vertices, t) for t in times]), times, faces)
    files = export(tmp_path, to, tmp_path / "files").files
    for frame in (0, 1, 37, 59):
        assert np.allclose(read_back(to, files, frame), wave(vertices, times[frame])[faces], rtol=0, atol=2e-7)


def wave(vertices, t):
    return np.column_stack([vertices[:, :2], np.sin(8 * vertices[:, 0] + t) / 10])


def read_back(to, files, frame):
    """Corners [faces, 3, 3] of the only mesh in a frame."""
    if to == "usd":
        from pxr import Usd, UsdGeom

        stage = Usd.Stage.Open(str(files[0]))
        mesh = next(UsdGeom.Mesh(p) for p in stage.Traverse() if p.IsA(UsdGeom.Mesh))
        faces = np.reshape(mesh.GetFaceVertexIndicesAttr().Get(), (-1, 3))
        return np.array(mesh.GetPointsAttr().Get(frame))[faces]
    if to == "gltf":
        return glb_frames(files[0])[0]["sheet"][0][frame]
    if to in ("pc2", "mdd"):
        start, kind = (32, "<f4") if to == "pc2" else (8 + 4 * 60, ">f4")
        cache = next(f for f in files if f.suffix == f".{to}").read_bytes()
        mesh = cama.Scene().add_cloth(next(f for f in files if f.suffix == ".obj"))
        return np.frombuffer(cache[start:], kind).reshape(60, -1, 3)[frame][mesh.faces]
    numbered = [f for f in files if f"_{frame:04d}." in f.name]
    if to == "vtk":
        import pyvista

        mesh = pyvista.read(numbered[0])
        return np.asarray(mesh.points)[mesh.regular_faces]
    import trimesh

    mesh = trimesh.load(numbered[0], **AS_IT_IS)
    return mesh.vertices[mesh.faces]
