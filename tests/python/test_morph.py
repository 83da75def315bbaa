# SPDX-License-Identifier: Apache-2.0
"""Bodies of glTF files that morph targets animate, written by pygltflib; expected positions by the format's rules."""

import json
import warnings

import numpy as np
import pytest

import cama
from cama.cli.loop import run
from cama.io import morph
from cama.io.exporting import export
from cama.io.recording import Recording

gltf = pytest.importorskip("pygltflib")

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 0, 1], [0, 2, 0]], np.float32)
FACES = np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]], np.uint16)
WIDER = np.array([[0, 0, 0], [0.5, 0, 0], [0, 0, 0.25], [0, 0, 0]], np.float32)
TALLER = np.array([0, 3, 0], np.float32)  # of the last corner, the only one that it moves
TIMES = np.array([0.5, 1.0, 2.0], np.float32)
WEIGHTS = np.array([[0, 0], [1, 0.5], [0.25, 1]], np.float32)


class Writer:
    """Puts arrays into a glTF file."""

    def __init__(self):
        self.file, self.data = gltf.GLTF2(scene=0, scenes=[gltf.Scene(nodes=[0])]), b""

    def view(self, array):
        self.file.bufferViews.append(gltf.BufferView(buffer=0, byteOffset=len(self.data), byteLength=array.nbytes))
        self.data += array.tobytes() + b"\0" * (-array.nbytes % 4)
        return len(self.file.bufferViews) - 1

    def accessor(self, array, kind, **more):
        names = {"f": gltf.FLOAT, "u": gltf.UNSIGNED_SHORT, "b": gltf.UNSIGNED_BYTE}
        component = names["b" if array.dtype == np.uint8 else array.dtype.kind]
        count = array.size // {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[kind]
        row = gltf.Accessor(bufferView=self.view(array), componentType=component, count=count, type=kind, **more)
        self.file.accessors.append(row)
        return len(self.file.accessors) - 1

    def sparse(self, count, rows, values):
        """An accessor of `count` rows [3] of zeros but for some."""
        self.file.accessors.append(
            gltf.Accessor(
                componentType=gltf.FLOAT, count=count, type="VEC3",
                sparse=gltf.Sparse(
                    count=len(rows),
                    indices=gltf.AccessorSparseIndices(
                        bufferView=self.view(np.array(rows, np.uint16)), componentType=gltf.UNSIGNED_SHORT
                    ),
                    values=gltf.AccessorSparseValues(bufferView=self.view(np.asarray(values, np.float32))),
                ),
            )
        )  # fmt: skip
        return len(self.file.accessors) - 1

    def save(self, path):
        self.file.buffers = [gltf.Buffer(byteLength=len(self.data))]
        self.file.set_binary_blob(self.data)
        if path.suffix == ".gltf":
            self.file.convert_buffers(gltf.BufferFormat.DATAURI)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            self.file.save(path)
        return path


def write(path, weights=WEIGHTS, how="LINEAR", corners=CORNERS, faces=FACES, node=None, channels=(), **more):
    """A tetrahedron with two targets, the second sparse, and a clip "grow"."""
    to = Writer()
    primitive = gltf.Primitive(
        attributes=gltf.Attributes(POSITION=to.accessor(corners, "VEC3")),
        indices=to.accessor(faces.ravel(), "SCALAR"),
        targets=[
            {"POSITION": to.accessor(WIDER[: len(corners)] if len(corners) == 4 else wider(corners), "VEC3")},
            {"POSITION": to.sparse(len(corners), [3], [TALLER])},
        ],
    )
    to.file.meshes = [gltf.Mesh(primitives=[primitive], weights=[0, 0.5])]
    to.file.nodes = node or [gltf.Node(mesh=0)]
    own = next(k for k, row in enumerate(to.file.nodes) if row.mesh == 0)
    clip = gltf.Animation(name="grow")
    rows = [("weights", own, TIMES, np.asarray(weights), how, "SCALAR"), *channels]
    for path_, target, times, values, interpolation, kind in rows:
        given = {"normalized": True} if values.dtype == np.uint8 else {}
        clip.samplers.append(
            gltf.AnimationSampler(
                input=to.accessor(times, "SCALAR"),
                output=to.accessor(values, kind, **given),
                interpolation=interpolation,
            )
        )
        sampler = len(clip.samplers) - 1
        clip.channels.append(
            gltf.AnimationChannel(sampler=sampler, target=gltf.AnimationChannelTarget(node=target, path=path_))
        )
    to.file.animations = [clip]
    for key, value in more.items():
        setattr(to.file, key, value)
    return to.save(path)


def wider(corners):
    """WIDER of corners of which some are there twice."""
    return WIDER[[int(np.flatnonzero((row == CORNERS).all(axis=1))[0]) for row in corners]]


def blended(weights):
    """Positions [4, 3] in the scene: z is up."""
    points = CORNERS + weights[0] * WIDER
    points[3] += weights[1] * TALLER
    return np.stack([points[:, 0], -points[:, 2], points[:, 1]], 1)


def moved(body, time):
    return body.motion.evaluate(time, body.vertices)


@pytest.mark.parametrize("ending", [".glb", ".gltf"])
def test_morph_targets_move_a_body(tmp_path, ending):
    """The clip begins with its first key; between keys the weights go straight."""
    file = write(tmp_path / f"growing{ending}")
    body = cama.Scene().add_obstacle(file, name="body")
    np.testing.assert_allclose(body.vertices, blended(WEIGHTS[0]), atol=1e-6)
    for time, weights in (
        (0.25, (0.5, 0.25)),
        (0.5, (1, 0.5)),
        (0.75, (0.8125, 0.625)),
        (1.5, (0.25, 1)),
        (9, (0.25, 1)),
    ):
        np.testing.assert_allclose(moved(body, time), blended(weights), atol=1e-6, err_msg=str(time))
    assert np.array_equal(body.faces, FACES)
    rest = cama.Scene().add_obstacle(file, clip="bind")
    np.testing.assert_array_equal(moved(rest, 1.0), rest.vertices)


def test_steps_splines_and_fractions(tmp_path):
    whole = np.array([[0, 0], [255, 51], [0, 255]], np.uint8)
    body = cama.Scene().add_obstacle(write(tmp_path / "fractions.glb", whole))
    np.testing.assert_allclose(moved(body, 0.5), blended((1, 0.2)), atol=1e-6)
    tangents = np.zeros((3, 3, 2), np.float32)
    tangents[:, 1], tangents[1, 0], tangents[0, 2] = WEIGHTS, (2, -1), (1, 3)
    body = cama.Scene().add_obstacle(write(tmp_path / "spline.glb", tangents, "CUBICSPLINE"), samples_per_second=240)
    # Hermite at the middle of half a second: (a + b) / 2 + span (tangent of a - tangent of b) / 8.
    expected = (WEIGHTS[0] + WEIGHTS[1]) / 2 + 0.5 * (np.array([1, 3]) - [2, -1]) / 8
    np.testing.assert_allclose(moved(body, 0.25), blended(expected), atol=1e-6)
    body = cama.Scene().add_obstacle(write(tmp_path / "steps.glb", WEIGHTS, "STEP"))
    np.testing.assert_allclose(moved(body, 0.4), blended(WEIGHTS[0]), atol=1e-6)
    np.testing.assert_allclose(moved(body, 1.0), blended(WEIGHTS[1]), atol=1e-6)


def test_nodes_above_and_their_animation(tmp_path):
    """A node that turns by a quarter about y within a second and rises, above one that is scaled and mirrored."""
    quarter = np.array([[0, 0, 0, 1], [0, 0.5**0.5, 0, 0.5**0.5]], np.float32)
    moments = np.array([0.5, 1.5], np.float32)
    rise = np.array([[0, 0, 0], [0, 4, 0]], np.float32)
    nodes = [gltf.Node(children=[1]), gltf.Node(mesh=0, scale=[2, 2, -2])]
    channels = [
        ("rotation", 0, moments, quarter, "LINEAR", "VEC4"),
        ("translation", 0, moments, rise, "LINEAR", "VEC3"),
    ]
    file = write(tmp_path / "turning.glb", node=nodes, channels=channels)
    body = cama.Scene().add_obstacle(file, samples_per_second=100)
    for part in (0, 0.5, 1):
        angle = part * np.pi / 2
        weights = {0: WEIGHTS[0], 0.5: WEIGHTS[1], 1: (WEIGHTS[1] + WEIGHTS[2]) / 2}[part]
        x, y, z = (2 * blended(weights)).T  # mirrored in z of the file, y of the scene
        y = -y
        c, s = np.cos(angle), np.sin(angle)  # about the scene's z: x and -y of the scene are x and z of the file
        expected = np.stack([c * x - s * y, s * x + c * y, z + 4 * part], 1)
        np.testing.assert_allclose(moved(body, part), expected, atol=1e-5)
    assert volume(body.vertices, body.faces) == pytest.approx(
        8 * volume(blended(WEIGHTS[0]), FACES)
    )  # not turned inward


def volume(points, faces):
    a, b, c = points[faces].transpose(1, 0, 2)
    return np.einsum("ij,ij->", np.cross(a, b), c) / 6


def test_lead_in_loops_units_and_seams(tmp_path):
    """Vertices that only a texture tells apart are one; a loop takes the length of the clip."""
    seam = np.concatenate([CORNERS, CORNERS[:1]])
    faces = np.array([[4, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]], np.uint16)
    file = write(tmp_path / "seam.glb", corners=seam, faces=faces)
    body = cama.Scene().add_obstacle(file, lead_in=1.0, loops=2, units="cm", name="body")
    assert len(body.vertices) == 4 and np.array_equal(body.faces, FACES)
    np.testing.assert_allclose(body.vertices, 0.01 * blended((0, 0.5)), atol=1e-8)  # the mesh's own weights
    for time, weights in (
        (1.0, WEIGHTS[0]),
        (1.5, WEIGHTS[1]),
        (2.5, WEIGHTS[2]),
        (3.0, WEIGHTS[1]),
        (4.0, WEIGHTS[2]),
    ):
        np.testing.assert_allclose(moved(body, time), 0.01 * blended(weights), atol=1e-8, err_msg=str(time))
    written = {"character": {"file": file.name, "lead_in": 1.0, "loops": 2, "units": "cm"}, "name": "body"}
    (tmp_path / "scene.json").write_text(json.dumps({"obstacles": [written]}))
    loaded = cama.Scene.load(tmp_path).obstacles[0]
    for time in (0, 0.5, 1.2, 3.1, 5):
        np.testing.assert_allclose(moved(loaded, time), moved(body, time), atol=1e-12)
    assert loaded.source == f"character {file.name}"


@pytest.mark.parametrize(
    "change, words",
    [
        ({"leave_out": ["arm"]}, "leave_out: needs a skeleton"),
        ({"clearance": 0.1}, "clearance: is for skeletons"),
        ({"units": "yard"}, "units: 'yard' is none of m, metre"),
        ({"loops": 1.5}, "loops: 1.5 does not fit"),
        ({"y_up": 1}, "y_up: 1 is neither true nor false"),
        ({"nothing": 1}, "nothing: not known"),
        ({"[" * 100_000: 1}, r"character.\[{57}\.\.\.: not known"),
        ({"scale": [0] * 100_000}, r"scale: \[0, 0.*\.\.\. does not fit"),
    ],
)
def test_what_a_scene_file_must_not_say(tmp_path, change, words):
    file = write(tmp_path / "growing.glb")
    with pytest.raises(cama.SceneError, match=words):
        cama.Scene.parse({"obstacles": [{"character": {"file": str(file), **change}}]})
    if "leave_out" in change or "clearance" in change:
        with pytest.raises(cama.SceneError, match="need a skeleton"):
            cama.Scene().add_obstacle(file, **change)


def damage(path, how):
    """A .gltf file whose JSON a function has changed."""
    file = write(path)
    data = json.loads(file.read_text())
    how(data)
    file.write_text(json.dumps(data))
    return file


DAMAGES = {
    "an accessor outside": lambda d: d["meshes"][0]["primitives"][0]["targets"][0].update(POSITION=99),
    "too many rows": lambda d: d["accessors"][2].update(count=10**9),
    "rows before the buffer": lambda d: d["bufferViews"][2].update(byteOffset=-8),
    "a sparse index outside": lambda d: d["accessors"][3].update(count=2),
    "times that go back": lambda d: d["animations"][0]["samplers"][0].update(input=5),
    "a node below itself": lambda d: d["nodes"][0].update(children=[0]),
    "no times": lambda d: d["animations"][0]["samplers"][0].pop("input"),
    "a mesh that is not there": lambda d: d["nodes"][0].update(mesh=7),
    "Draco": lambda d: d["meshes"][0]["primitives"][0].update(extensions={"KHR_draco_mesh_compression": {}}),
    "an extension": lambda d: d.update(extensionsRequired=["EXT_meshopt_compression"]),
    "no numbers": lambda d: d["nodes"][0].update(rotation=["a", 0, 0, 1]),
    "weights for nothing": lambda d: d["meshes"][0].update(weights=[1, 2, 3]),
}


@pytest.mark.parametrize("what", DAMAGES)
def test_damaged_files_are_errors_that_name_them(tmp_path, what):
    file = damage(tmp_path / "damaged.gltf", DAMAGES[what])
    with pytest.raises(cama.FileError, match="damaged.gltf") as problem:
        cama.Scene().add_obstacle(file, name="body")
    assert "export it" in str(problem.value)


def test_json_that_is_nested_without_end_is_refused(tmp_path):
    """As the fuzzer has found it: Python's reader gives up by RecursionError."""
    file = tmp_path / "deep.gltf"
    file.write_text('{"animations": ' + "[" * 100_000)
    with pytest.raises(cama.FileError):
        cama.Scene().add_obstacle(file)


def test_a_skeleton_leaves_morph_targets_at_rest_and_says_so(tmp_path):
    from test_characters import write_gltf

    file = write_gltf(tmp_path / "rising.gltf")
    data = json.loads(file.read_text())
    assert morph.REMARK not in cama.Scene().add_obstacle(file).source
    data["meshes"][0]["primitives"][0]["targets"] = [{"POSITION": 0}]
    data["animations"][0]["samplers"].append({"input": 4, "output": 4})
    data["animations"][0]["channels"].append({"sampler": 1, "target": {"node": 0, "path": "weights"}})
    file.write_text(json.dumps(data))
    body = cama.Scene().add_obstacle(file)
    assert body.source.endswith(morph.REMARK)
    np.testing.assert_allclose(moved(body, 2.0) - body.vertices, np.tile([0, 0, 4], (4, 1)), atol=1e-6)


def test_an_export_comes_back_as_it_moved(tmp_path):
    """What `cama export` writes is a body, its seams closed: positions at every frame in single precision."""
    scene = cama.Scene(frame_time=0.04, frames=3)
    scene.add_cloth(shape={"grid": {"size": [0.4, 0.3], "cells": [6, 5]}}, translate=(0, 0, 0.02), name="sheet")
    scene.add_obstacle(shape={"box": {"size": [0.2, 0.2, 0.02], "triangles": 12}}, name="box")
    run(cama.Simulation(scene, accuracy="preview"), tmp_path / "out", 3)
    file = export(tmp_path / "out", "gltf", tmp_path, cloth_only=True).files[0]
    body = cama.Scene().add_obstacle(file)
    with Recording(tmp_path / "out") as recording:
        for frame, time in enumerate(recording.times):
            expected = recording.frame(frame)[:42]
            got = moved(body, time)
            order = [int(np.argmin(((body.vertices - x) ** 2).sum(axis=1))) for x in recording.frame(0)[:42]]
            np.testing.assert_allclose(got[order], expected, atol=1e-6)
    assert len(body.vertices) == 42
