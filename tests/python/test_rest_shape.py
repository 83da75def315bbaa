# SPDX-License-Identifier: Apache-2.0
"""Rest shapes of cloth from mesh files; expected values are lengths of the meshes."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

import cama
from cama.cli.main import app
from conftest import grid

SIDE = 0.5  # m, of the plane whose texture coordinates run from 0 to 1


def obj(path, vertices, faces, texture=None, more=()):
    """Writes an OBJ file; texture [m, 2] has the indices of the vertices."""
    lines = [f"v {x} {y} {z}" for x, y, z in vertices.tolist()]
    lines += [f"vt {u} {v}" for u, v in (() if texture is None else texture.tolist())]
    corner = "{0}/{0}" if texture is not None else "{0}"
    lines += ["f " + " ".join(corner.format(int(k) + 1) for k in face) for face in faces]
    path.write_text("\n".join([*lines, *more]) + "\n")
    return path


@pytest.fixture
def plane(tmp_path):
    """A plane as programs export it: 0.5 m wide, with an atlas from 0 to 1."""
    vertices, faces = grid(8, SIDE)
    return obj(tmp_path / "plane.obj", vertices, faces, (vertices[:, :2] - vertices[0, :2]) / SIDE)


def from_json(folder, file, **more):
    return cama.Scene.parse({"cloth": [{"name": "sheet", "file": file, **more}]}, folder)


def from_python(file, **more):
    scene = cama.Scene()
    scene.add_cloth(file, name="sheet", **more)
    return scene


@pytest.mark.parametrize("way", ["python", "json"])
def test_a_textured_plane_keeps_its_size(plane, way):
    """It falls freely for 0.25 s: 0.5 m wide as it was, and lower by g t^2 / 2 (backward Euler: a step more)."""
    scene = from_python(plane) if way == "python" else from_json(plane.parent, plane.name)
    assert scene.cloths[0].rest_area == pytest.approx(SIDE**2, rel=1e-12)
    simulation = cama.Simulation(scene, backend="cpu", threads=1, time_step=1 / 400)
    simulation.step(100)
    assert np.ptp(simulation.positions, axis=0) == pytest.approx([SIDE, SIDE, 0], abs=1e-6)
    assert simulation.positions[:, 2].mean() == pytest.approx(-9.81 * 0.25**2 / 2, rel=0.02)


@pytest.mark.filterwarnings("ignore::cama.PlausibilityWarning")
@pytest.mark.parametrize("way", ["python", "json"])
def test_texture_coordinates_are_the_rest_shape_where_asked_for(plane, way):
    unit = 0.8
    scene = (
        from_python(plane, rest="uv", material_scale=unit)
        if way == "python"
        else from_json(plane.parent, {"path": plane.name, "rest": "uv", "material_scale": unit})
    )
    cloth = scene.cloths[0]
    assert cloth.rest_area == pytest.approx(unit**2, rel=1e-12)
    assert cloth.start_strain == pytest.approx((SIDE / unit - 1,) * 2, rel=1e-9)
    assert cloth.rest_shape == "uv, 0.8 m a unit"
    assert from_python(plane).cloths[0].rest_shape == "start"
    cama.Simulation(scene, backend="cpu", threads=1)


def test_scale_scales_both(plane):
    assert from_python(plane, scale=2).cloths[0].rest_area == pytest.approx(1.0)
    assert from_python(plane, scale=2, rest="uv").cloths[0].rest_area == pytest.approx(4.0)
    assert from_json(plane.parent, plane.name, transform={"scale": 2}).cloths[0].rest_area == pytest.approx(1.0)


def test_saved_scenes_move_alike(plane):
    for scene in (from_python(plane), from_python(plane, rest="uv", material_scale=0.55)):
        scene.pin("sheet", [0])
        again = cama.Scene.parse(scene.to_json())
        hashes = set()
        for one in (scene, again):
            simulation = cama.Simulation(one, backend="cpu", threads=1)
            simulation.step(5)
            hashes.add(simulation.state_hash)
        assert len(hashes) == 1


def test_arrays_have_the_material_coordinates_that_are_passed():
    vertices, faces = grid(4)
    scene = cama.Scene()
    assert scene.add_cloth(vertices, faces).rest_area == pytest.approx(1.0)
    assert scene.add_cloth(vertices, faces, material_vertices=1.1 * vertices[:, :2]).rest_area == pytest.approx(1.21)


ERRORS = {
    "scale without uv": (cama.SceneError, 'sheet: material_scale is the length .*rest="uv"', {"material_scale": 0.5}),
    "a wrong word": (cama.SceneError, "sheet: rest: 'texture' is neither", {"rest": "texture"}),
    "no length": (cama.SceneError, "sheet: material_scale: must be greater", {"rest": "uv", "material_scale": 0}),
    "beside a file": (cama.SceneError, "sheet: material_vertices .*beside the file", {"material_vertices": [[0, 0]]}),
}


@pytest.mark.parametrize("case", ERRORS)
def test_python_names_what_is_wrong(plane, case):
    kind, text, given = ERRORS[case]
    with pytest.raises(kind, match=text):
        from_python(plane, **given)


def test_uv_needs_texture_coordinates(tmp_path):
    plain = obj(tmp_path / "plain.obj", *grid(2))
    text = 'plain.obj: has no texture coordinates, which rest "uv" takes as the rest shape; unwrap it'
    with pytest.raises(cama.MeshError, match=f"sheet: .*{text}"):
        from_python(plain, rest="uv")
    with pytest.raises(cama.SceneError, match=rf"cloth\[0\].file: .*{text}"):
        from_json(tmp_path, {"path": "plain.obj", "rest": "uv"})
    with pytest.raises(cama.SceneError, match='rest="uv" takes the texture coordinates of a mesh file'):
        cama.Scene().add_cloth(*grid(2), rest="uv")
    for more in ({"rest": "uv"}, {"material_vertices": [[0, 0]]}):
        with pytest.raises(cama.SceneError, match="a generated shape has a rest shape of its own"):
            cama.Scene().add_cloth(shape={"grid": {"size": [1, 1]}}, **more)


@pytest.mark.parametrize(
    ("keys", "text"),
    [
        ({"material_space": True}, r'material_space: is "rest" now; write "rest": "uv" in its place'),
        ({"material_space": False}, r'material_space: is "rest" now; leave it out'),
        ({"material_scale": 0.5}, r'material_scale: is the length of a texture unit.*write "rest": "uv"'),
        ({"rest": "start", "material_scale": 1}, "material_scale: is the length of a texture unit"),
        ({"rest": "both"}, r'rest: must be "start" or "uv", got "both"'),
    ],
)
def test_scene_files_name_what_is_wrong(plane, keys, text):
    with pytest.raises(cama.SceneError, match=r"cloth\[0\].file." + text):
        from_json(plane.parent, {"path": plane.name, **keys})


def test_texture_coordinates_of_another_size_are_said(plane):
    """Of the 0.5 m plane they are twice as long; 0.5 m a unit is right, whatever the unit is now."""
    words = ["cloth 'sheet': rest \"uv\"", "2 times as long", "4 times as large", "set `material_scale` to 0.5"]
    with pytest.warns(cama.PlausibilityWarning) as caught:
        cama.Simulation(from_python(plane, rest="uv"), backend="cpu", threads=1)
    assert len(caught) == 1 and all(word in str(caught[0].message) for word in words), str(caught[0].message)
    with pytest.warns(cama.PlausibilityWarning, match="2.4 times.*set `material_scale` to 0.5"):
        cama.Simulation(from_python(plane, rest="uv", material_scale=1.2), backend="cpu", threads=1)
    with pytest.raises(cama.MeshError, match="100 times as large as its start.*material_scale 0.5 would"):
        from_python(plane, rest="uv", material_scale=50).validate()


def test_commands_say_the_rest_shape(plane, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    folder = plane.parent
    for file, rest, far in (
        (plane.name, "start", False),
        ({"path": plane.name, "rest": "uv"}, "uv, 1 m a unit", True),
    ):
        scene = {"cloth": [{"name": "sheet", "file": file}], "frames": 1, "frame_time": 0.01}
        (folder / "scene.json").write_text(json.dumps(scene))
        check = CliRunner().invoke(app, ["check", str(folder)]).output
        assert f"sheet: the rest shape is {rest.replace('start', 'the start')}" in check
        run = CliRunner().invoke(app, ["run", str(folder), "-o", str(folder / f"out_{far}")])
        assert run.exit_code == 0, run.output
        for text in (check, " ".join(run.output.split())):
            assert ("2 times as long" in text) == far, text
        assert json.loads((folder / f"out_{far}" / "summary.json").read_text())["rest_shapes"] == {"sheet": rest}


def test_strain_and_area_of_slivers():
    """A rest triangle 1 m long and 1 nm high: its start, of 1 m, is stretched by as much; NumPy called it singular."""
    start, height = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], float), 1e-9
    cloth = cama.Scene().add_cloth(start, [[0, 1, 2]], material_vertices=[[0, 0], [1, 0], [0.3, height]])
    inverse = np.linalg.inv(np.array([[1, 0.3], [0, height]]))
    assert cloth.rest_area == pytest.approx(height / 2, rel=1e-12)
    expected = np.linalg.svd(inverse, compute_uv=False)
    assert cloth.start_strain[1] == pytest.approx(expected[0] - 1, rel=1e-9)
    assert cloth.start_strain[0] == pytest.approx(1 / (height * expected[0]) - 1, rel=1e-6)  # det is 1 / height
