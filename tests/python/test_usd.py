# SPDX-License-Identifier: Apache-2.0
"""USD files as meshes of scenes: unit, up axis, transforms, polygons, texture coordinates and animation."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

import cama

pxr = pytest.importorskip("pxr")
from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel  # noqa: E402

DATA = Path(os.environ.get("CAMA_TEST_DATA", Path(__file__).resolve().parents[2] / ".." / "shared" / "data"))
SHIRT = DATA / "garments" / "newton" / "unisex_shirt.usd"

# A square of a quadrilateral in centimetres with y up, and beside it a triangle: in its plane z = 0.
POINTS = [(0, 0, 0), (100, 0, 0), (100, 100, 0), (0, 100, 0), (200, 0, 0)]
ST = [(0, 0), (1, 0), (1, 1), (0, 1), (0.5, 0), (1, 0.5), (1, 1)]  # of the seven corners


def write(path, animated=False, **changes):
    """The file described above; returns the stage, saved, and its mesh."""
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, changes.get("up", "Y"))
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    stage.SetTimeCodesPerSecond(24)
    root = UsdGeom.Xform.Define(stage, "/body")
    mesh = UsdGeom.Mesh.Define(stage, "/body/square")
    mesh.CreatePointsAttr(changes.get("points", POINTS))
    mesh.CreateFaceVertexCountsAttr(changes.get("counts", [4, 3]))
    mesh.CreateFaceVertexIndicesAttr(changes.get("indices", [0, 1, 2, 3, 1, 4, 2]))
    st = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "faceVarying")
    st.Set(changes.get("st", ST))
    if animated:  # from 0 to 240 cm upwards within 2 s; the points of one mesh are sampled too
        lift = root.AddTranslateOp()
        lift.Set(Gf.Vec3d(0, 0, 0), 10)
        lift.Set(Gf.Vec3d(0, 240, 0), 58)
        mesh.GetPointsAttr().Set(POINTS, 10)
        mesh.GetPointsAttr().Set([(x, 2 * y, z) for x, y, z in POINTS], 34)
    for change in changes.get("then", []):
        change(stage, mesh)
    stage.GetRootLayer().Save()
    return path


def in_metres(points):
    """Centimetres with y up as metres with z up: (x, y, z) becomes (x, -z, y)."""
    return np.array(points, float)[:, [0, 2, 1]] * [0.01, -0.01, 0.01]


@pytest.mark.parametrize("extension", ["usd", "usda", "usdc"])
def test_unit_axis_and_polygons_are_read(tmp_path, extension):
    file = write(tmp_path / f"square.{extension}")
    cloth = cama.Scene().add_cloth(file, name="square")
    assert np.allclose(cloth.vertices, in_metres(POINTS), atol=1e-12)
    assert cloth.faces.tolist() == [[0, 1, 2], [0, 2, 3], [1, 4, 2]]
    assert cloth.rest_shape == "start" and cloth.source == str(file)
    again = cama.Scene().add_cloth(shape={"file": {"path": str(file), "rest": "uv"}})
    assert np.array_equal(again.vertices, cloth.vertices) and again.rest_shape == "uv, 1 m a unit"


def test_z_up_is_not_turned(tmp_path):
    cloth = cama.Scene().add_cloth(write(tmp_path / "square.usda", up="Z"))
    assert np.allclose(cloth.vertices, 0.01 * np.array(POINTS), atol=1e-12)


def test_texture_coordinates_are_the_rest_shape_where_asked_for(tmp_path):
    cloth = cama.Scene().add_cloth(write(tmp_path / "square.usda"), rest="uv", material_scale=0.5)
    corners = cloth.material_vertices[cloth.material_faces]
    assert np.allclose(corners, 0.5 * np.array([[ST[k] for k in face] for face in ([0, 1, 2], [0, 2, 3], [4, 5, 6])]))
    assert cloth.rest_shape == "uv, 0.5 m a unit"

    def indexed(stage, mesh):
        st = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex")
        st.Set([(0, 1), (1, 1), (1, 0), (0, 0), (2, 0)])
        st.SetIndices([3, 2, 1, 0, 4])

    cloth = cama.Scene().add_cloth(write(tmp_path / "indexed.usda", then=[indexed]), rest="uv")
    corners = cloth.material_vertices[cloth.material_faces]
    assert corners[2].tolist() == [[1, 0], [2, 0], [1, 1]]  # vertices 1, 4, 2


def test_transforms_orientation_holes_and_what_is_hidden(tmp_path):
    def change(stage, mesh):
        UsdGeom.Xformable(mesh).AddScaleOp().Set(Gf.Vec3f(2, 1, 1))
        UsdGeom.Xform.Get(stage, "/body").AddTranslateOp().Set(Gf.Vec3d(0, 0, 50))
        mesh.CreateOrientationAttr("leftHanded")
        mesh.CreateHoleIndicesAttr([2])
        for path, hide in (
            ("/hidden", lambda m: m.MakeInvisible()),
            ("/guide", lambda m: m.CreatePurposeAttr("guide")),
        ):
            other = UsdGeom.Mesh.Define(stage, path)
            other.CreatePointsAttr(POINTS)
            other.CreateFaceVertexCountsAttr([3])
            other.CreateFaceVertexIndicesAttr([0, 1, 2])
            hide(other)

    cloth = cama.Scene().add_cloth(
        write(tmp_path / "square.usda", counts=[4, 3, 3], indices=[0, 1, 2, 3, 1, 4, 2, 0, 1, 2], then=[change])
    )
    assert np.allclose(cloth.vertices, in_metres(np.array(POINTS) * [2, 1, 1] + [0, 0, 50]), atol=1e-12)
    assert cloth.faces.tolist() == [[0, 2, 1], [0, 3, 2], [1, 2, 4]]


def test_an_obstacle_moves_as_the_file_says(tmp_path):
    scene = cama.Scene(time_step=0.1, gravity=(0, 0, 0))
    scene.add_cloth([[9, 0, 0], [9.1, 0, 0], [9, 0.1, 0]], [[0, 1, 2]])
    body = scene.add_obstacle(write(tmp_path / "lift.usdc", animated=True), scale=0.5)
    assert np.allclose(body.vertices, 0.5 * in_metres(POINTS), atol=1e-12)
    simulation = cama.Simulation(scene, accuracy="preview", time_step=0.1)
    stretched = np.array(POINTS) * [1, 2, 1]
    for _ in range(5):
        simulation.step()
    half = 0.5 * (np.array(POINTS) + stretched)  # 0.5 s, 12 of 48 time codes: halfway to code 34
    assert np.allclose(simulation.positions[3:], 0.5 * in_metres(half + [0, 60, 0]), atol=1e-9)
    for _ in range(20):
        simulation.step()
    assert np.allclose(simulation.positions[3:], 0.5 * in_metres(stretched + [0, 240, 0]), atol=1e-9)
    still = cama.Scene().add_obstacle(tmp_path / "lift.usdc", clip="bind")
    assert np.allclose(still.vertices, in_metres(POINTS), atol=1e-12)
    with pytest.raises(cama.SceneError, match="body: clip, lead_in and loops are for glTF, FBX and DAE"):
        scene.add_obstacle(tmp_path / "lift.usdc", loops=2, name="body")


def skinned(path, instance=False):
    """A triangle in centimetres; a knee at a height of 50 turns its third vertex about z by 90 degrees within 1 s."""
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, "Y")
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    stage.SetTimeCodesPerSecond(24)
    where = "/prototype" if instance else ""
    UsdSkel.Root.Define(stage, f"{where}/person")
    skeleton = UsdSkel.Skeleton.Define(stage, f"{where}/person/bones")
    skeleton.CreateJointsAttr(["hip", "hip/knee"])
    pose = [Gf.Matrix4d(1), Gf.Matrix4d().SetTranslate(Gf.Vec3d(0, 50, 0))]
    skeleton.CreateBindTransformsAttr(pose)
    skeleton.CreateRestTransformsAttr(pose)
    mesh = UsdGeom.Mesh.Define(stage, f"{where}/person/body")
    mesh.CreatePointsAttr([(0, 0, 0), (10, 0, 0), (0, 100, 0)])
    mesh.CreateFaceVertexCountsAttr([3])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2])
    binding = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
    binding.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
    binding.CreateJointIndicesPrimvar(False, 1).Set([0, 0, 1])
    binding.CreateJointWeightsPrimvar(False, 1).Set([1, 1, 1])
    motion = UsdSkel.Animation.Define(stage, f"{where}/person/bones/motion")
    motion.CreateJointsAttr(["hip", "hip/knee"])
    motion.CreateTranslationsAttr([Gf.Vec3f(0, 0, 0), Gf.Vec3f(0, 50, 0)])
    motion.CreateScalesAttr([Gf.Vec3h(1)] * 2)
    for code in range(0, 25, 6):
        turned = Gf.Rotation(Gf.Vec3d(0, 0, 1), 90 * code / 24).GetQuat()
        motion.CreateRotationsAttr().Set([Gf.Quatf(1), Gf.Quatf(turned)], code)
    UsdSkel.BindingAPI.Apply(skeleton.GetPrim()).CreateAnimationSourceRel().SetTargets([motion.GetPath()])
    if instance:
        copy = stage.DefinePrim("/copy")
        copy.GetReferences().AddInternalReference("/prototype")
        copy.SetInstanceable(True)
    stage.GetRootLayer().Save()
    return path


@pytest.mark.filterwarnings("ignore::cama.PlausibilityWarning")  # steps of a quarter of a second
def test_a_skeleton_moves_an_obstacle(tmp_path):
    file = skinned(tmp_path / "person.usda")
    before = file.read_bytes()
    scene = cama.Scene(gravity=(0, 0, 0))
    scene.add_cloth([[9, 0, 0], [9.1, 0, 0], [9, 0.1, 0]], [[0, 1, 2]])
    scene.add_obstacle(file)
    simulation = cama.Simulation(scene, accuracy="preview", time_step=0.25)
    for quarter in range(1, 5):
        simulation.step()
        angle = np.pi / 8 * quarter
        third = [-50 * np.sin(angle), 50 + 50 * np.cos(angle), 0]
        assert np.allclose(simulation.positions[3:], in_metres([(0, 0, 0), (10, 0, 0), third]), atol=1e-6)
    bind = cama.Scene().add_obstacle(file, clip="bind")
    assert np.allclose(bind.vertices, in_metres([(0, 0, 0), (10, 0, 0), (0, 100, 0)]), atol=1e-9)
    assert file.read_bytes() == before
    with pytest.raises(cama.MeshError, match="/copy/person/body: is moved by a skeleton and part of an instance"):
        cama.Scene().add_obstacle(skinned(tmp_path / "instance.usda", instance=True))


def test_scene_files_name_usd_files(tmp_path):
    write(tmp_path / "square.usda")
    write(tmp_path / "lift.usdc", animated=True)
    lift = {"translate": [0, 0, 5]}
    scene = {
        "cloth": [
            {"name": "a", "grid": {"size": [1, 1], "cells": [2, 2]}, "transform": lift},
            {"name": "b", "file": {"path": "square.usda", "rest": "uv", "material_scale": 1.1}},
            {"name": "c", "file": "square.usda", "transform": {"translate": [0, 3, 0]}},
        ],
        "obstacles": [
            {"name": "still", "file": {"path": "lift.usdc", "scale": 2}},
            {"name": "moving", "character": {"file": "lift.usdc"}, "transform": lift},
        ],
    }
    (tmp_path / "scene.json").write_text("// with remarks\n" + json.dumps(scene))
    loaded = cama.Scene.load(tmp_path)
    _, b, c = loaded.cloths
    assert b.source == "square.usda" and b.rest_shape == "uv, 1.1 m a unit" and c.rest_shape == "start"
    assert np.allclose(b.material_vertices[b.material_faces][0], 1.1 * np.array(ST[:3]))
    assert np.allclose(c.vertices, in_metres(POINTS) + [0, 3, 0], atol=1e-12)
    assert np.allclose(loaded.obstacles[0].vertices, 2 * in_metres(POINTS), atol=1e-12)
    simulation = cama.Simulation(loaded, accuracy="preview", time_step=0.1, intersections="exempt")
    for _ in range(25):
        simulation.step()
    end = in_metres(np.array(POINTS) * [1, 2, 1] + [0, 240, 0]) + [0, 0, 5]
    assert np.allclose(simulation.positions[-5:], end, atol=1e-9)
    assert cama.Scene.parse(scene, tmp_path).triangle_count == loaded.triangle_count
    for part, text in (
        ({"cloth": [{"file": {"path": "square.usda", "stitches": False}}]}, r"cloth\[0\].file.stitches: other keys"),
        (
            {"cloth": [{"file": {"path": "square.usda", "scale": 0}}]},
            r"cloth\[0\].file.scale: must be a number greater",
        ),
        ({"cloth": [{"file": {"path": "square.usda", "rest": "x"}}]}, r"cloth\[0\].file.rest: 'x' is neither"),
        ({"obstacles": [{"character": {"file": "lift.usdc", "loops": 2}}]}, r"obstacles\[0\].character.loops: a USD"),
    ):
        (tmp_path / "scene.json").write_text(json.dumps(part))
        with pytest.raises(cama.SceneError, match="scene.json: " + text):
            cama.Scene.load(tmp_path)


def test_what_is_broken_is_named(tmp_path):
    def changing(stage, mesh):
        mesh.GetFaceVertexIndicesAttr().Set([0, 1, 2, 3, 1, 4, 2], 1)
        mesh.GetFaceVertexIndicesAttr().Set([0, 1, 2, 3, 1, 4, 3], 2)

    cases = [
        (dict(indices=[0, 1, 2, 3, 1, 4, 9]), cama.MeshError, "/body/square: uses vertex 9, but has 5 vertices"),
        (dict(counts=[4, 2]), cama.MeshError, "/body/square: face 1 has 2 corners"),
        (dict(counts=[4, 4]), cama.MeshError, "/body/square: its faces have 8 corners, and there are 7 indices"),
        (dict(counts=[], indices=[]), cama.MeshError, "/body/square: has no faces"),
        (dict(points=[(0, 0, 0), (0, 0, float("nan")), *POINTS[2:]]), cama.MeshError, "vertex 1 is not finite"),
        (
            dict(points=[(0, 0, 0), (90, 80, 0), *POINTS[2:]], indices=[0, 2, 1, 3, 0, 1, 2]),
            cama.MeshError,
            "face 0 is a con",
        ),
        (dict(then=[changing]), cama.MeshError, "/body/square: its faces change in time"),
        (dict(then=[lambda stage, mesh: mesh.MakeInvisible()]), cama.FileError, "no visible mesh"),
    ]
    for number, (changes, kind, text) in enumerate(cases):
        with pytest.raises(kind, match=text):
            cama.Scene().add_cloth(write(tmp_path / f"{number}.usda", **changes))
    with pytest.raises(cama.MeshError, match="primvars:st: does not have a value for each corner"):
        cama.Scene().add_cloth(write(tmp_path / "short.usda", st=ST[:5]), rest="uv")
    (tmp_path / "text.usda").write_text("no stage")
    with pytest.raises(cama.FileError, match="text.usda: cannot be read"):
        cama.Scene().add_cloth(tmp_path / "text.usda")
    with pytest.raises(cama.FileError, match="missing.usd: no such file"):
        cama.Scene().add_cloth(tmp_path / "missing.usd")
    (tmp_path / "bytes.usdc").write_bytes(b"PXR-USDC" + bytes(range(200)))
    with pytest.raises(cama.FileError, match="bytes.usdc: cannot be read"):
        cama.Scene().add_cloth(tmp_path / "bytes.usdc")


def test_an_export_is_read_again(tmp_path):
    """What `cama export` writes as USD, in inches, moves as an obstacle as it was recorded."""
    from cama.cli.loop import run
    from cama.io.exporting import export

    scene = cama.Scene(time_step=0.01, frame_time=0.1, frames=3, contact=False)
    scene.add_cloth(shape={"grid": {"size": [1, 1], "cells": [2, 2]}}, name="sheet")
    falling = cama.Simulation(scene)
    run(falling, tmp_path, 3)
    file = export(tmp_path, "usd", units="in").files[0]
    other = cama.Scene(gravity=(0, 0, 0))
    other.add_cloth([[9, 0, 0], [9.1, 0, 0], [9, 0.1, 0]], [[0, 1, 2]])
    other.add_obstacle(file)
    again = cama.Simulation(other, accuracy="preview", time_step=0.1)
    for _ in range(3):
        again.step()
    assert np.allclose(again.positions[3:], falling.positions, rtol=0, atol=1e-6)


@pytest.mark.skipif(not SHIRT.is_file(), reason=f"SKIPPED: no test data {SHIRT}")
def test_a_garment_of_another_program_is_read():
    shirt = cama.Scene().add_cloth(SHIRT)
    assert (len(shirt.vertices), len(shirt.faces)) == (6436, 12736)
    stage = Usd.Stage.Open(str(SHIRT))
    points = UsdGeom.Mesh(stage.GetPrimAtPath("/root/shirt")).GetPointsAttr()
    assert np.allclose(shirt.vertices, in_metres(points.Get(Usd.TimeCode.EarliestTime())), atol=1e-9)
    assert 0.5 < np.ptp(shirt.vertices[:, 2]) < 1  # m
