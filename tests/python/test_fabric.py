# SPDX-License-Identifier: Apache-2.0
"""Textile tests of fabrics against closed forms, and fabrics from measured values."""

import json
import math
import os

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from typer.testing import CliRunner

import cama
from cama import fabric
from cama.cli import app, common
from cama.fabric import bending, draping, shear

RUNNER = CliRunner()
G = 9.81
COTTON = dict(warp=8000.0, weft=4500.0, poisson=0.2, shear=55.0, bending_warp=1e-5, bending_weft=7e-6, density=0.12)


def call(*words):
    return RUNNER.invoke(app, [str(w) for w in words], catch_exceptions=False)


def isotropic(stiffness=1e-5, density=0.12, youngs=8000.0, poisson=0.0):
    return cama.Material.isotropic(youngs, poisson, stiffness, density)


# --- Cantilever -------------------------------------------------------------------------------------------------------


def chord(gamma):
    """Slope of the chord of the heavy elastica theta'' = gamma (1 - s) cos(theta), degrees."""

    def shoot(curvature):
        return solve_ivp(
            lambda s, y: [y[1], -gamma * (1 - s) * np.cos(y[0]), np.cos(y[0]), np.sin(y[0])],
            (0, 1),
            [0, curvature, 0, 0],
            rtol=1e-10,
            atol=1e-12,
        ).y[:, -1]

    _, _, reach, drop = shoot(brentq(lambda k: shoot(k)[1], 0.0, gamma / 2))
    return math.degrees(math.atan2(drop, reach))


def test_the_number_of_the_elastica():
    """At the slope of 41.5 degrees; ASTM D1388 rounds it to 8, for which G = w c^3 with c half the overhang."""
    assert brentq(lambda g: chord(g) - 41.5, 7.0, 9.0) == pytest.approx(bending.ELASTICA, rel=1e-6)
    c = bending.bending_length_of(3e-5, 0.2)
    assert bending.flexural_rigidity_of(c, 0.2) == pytest.approx(3e-5, rel=1e-3)


@pytest.mark.parametrize("gamma", [2.0, 5.0])
def test_a_strip_hangs_as_the_elastica(gamma):
    """Hinges of a grid bend a wide strip up to 4 % more stiffly (docs/guide/materials.md)."""
    overhang = 0.04
    stiffness = 0.12 * G * overhang**3 / gamma
    errors = [abs(bending.slope(isotropic(stiffness), overhang, cells=cells) / chord(gamma) - 1) for cells in (8, 24)]
    assert errors[1] < errors[0] and errors[1] < 0.04


@pytest.mark.parametrize("direction", ["warp", "weft", "bias"])
def test_bending_length(direction):
    """Of an orthotropic cloth each direction has its own stiffness; along the bias it is the mean."""
    material = cama.Material.orthotropic(8000, 8000, 0.0, 4000, 2e-5, 1.6e-5, 0.15)
    stiffness = {"warp": 2e-5, "weft": 1.6e-5, "bias": 1.8e-5}[direction]
    found = fabric.cantilever(material, direction, cells=16)
    expected = (8.0042 * stiffness / (0.15 * G)) ** (1 / 3) / 2
    assert found.expected == pytest.approx(expected, rel=1e-5)
    assert found.bending_length == pytest.approx(expected, rel=0.05)
    assert found.flexural_rigidity == pytest.approx(0.15 * G * found.bending_length**3)


def test_cloth_without_stiffness_has_no_bending_length():
    with pytest.raises(cama.MaterialError, match="no bending stiffness"):
        fabric.cantilever(isotropic(0.0))
    with pytest.raises(cama.ArrayError, match="'wrap' is not one of warp, weft and bias; did you mean 'warp'"):
        fabric.cantilever("cotton", "wrap")


# --- Strip tensile test -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("direction, young", [("warp", 8000.0), ("weft", 4500.0)])
def test_force_of_a_strip_that_does_not_narrow(direction, young):
    """Without a Poisson ratio the jaws change nothing: P = Y (1 + e) (e + e^2 / 2)."""
    material = cama.Material.orthotropic(8000, 4500, 0.0, 55, 1e-5, 7e-6, 0.12)
    found = fabric.tensile(material, direction, (0.01, 0.1), cells=16)
    for stretch, force in zip(found.stretch, found.force):
        green = ((1 + stretch) ** 2 - 1) / 2
        assert force == pytest.approx(young * (1 + stretch) * green, rel=1e-6)


@pytest.mark.parametrize("direction", ["warp", "bias"])
def test_force_of_a_long_strip_is_the_constitutive_law(direction):
    """Far from the jaws the stress is uniaxial; along the bias 4/Y = 1/Yu + 1/Yv - 2 nu / sqrt(Yu Yv) + 1/G."""
    warp, weft, poisson, stiffness = 3000.0, 2000.0, 0.3, 100.0
    material = cama.Material.orthotropic(warp, weft, poisson, stiffness, 1e-5, 7e-6, 0.12)
    bias = 4 / (1 / warp + 1 / weft - 2 * poisson / math.sqrt(warp * weft) + 1 / stiffness)
    found = fabric.tensile(material, direction, (0.03,), length=0.4, width=0.05, cells=64)
    (middle,) = found.middle_stretch
    expected = {"warp": warp, "bias": bias}[direction] * (1 + middle) * ((1 + middle) ** 2 - 1) / 2
    assert found.force[0] == pytest.approx(expected, rel=1e-3)
    assert found.expected[0] == pytest.approx(expected, rel=1e-9)


def test_stretches_must_rise():
    with pytest.raises(cama.ArrayError, match="do not rise"):
        fabric.tensile("cotton", stretches=(0.02, 0.01))


# --- Picture frame ----------------------------------------------------------------------------------------------------


def test_force_of_the_picture_frame():
    """The force along the diagonal d = 2 L cos(pi/4 - a/2) is dU/dd of the energy U = L^2 G sin(a)^2 / 2."""
    found = fabric.picture_frame("cotton", (2.0, 10.0, 30.0, 60.0), cells=4)

    def energy(diagonal):
        angle = math.pi / 2 - 2 * math.acos(diagonal / (2 * shear.SIDE))
        return shear.SIDE**2 * COTTON["shear"] * math.sin(angle) ** 2 / 2

    for angle, force in zip(found.angle, found.force):
        d, h = 2 * shear.SIDE * math.cos(math.pi / 4 - math.radians(angle) / 2), 1e-6
        assert force == pytest.approx((energy(d + h) - energy(d - h)) / (2 * h), rel=1e-5)
    assert found.shear_rigidity == pytest.approx(COTTON["shear"], rel=2e-3)
    with pytest.raises(cama.ArrayError, match="below 90"):
        fabric.picture_frame("cotton", (95.0,))


# --- Drape ------------------------------------------------------------------------------------------------------------


def droop(stiffness, load, poisson, inner=0.09, outer=0.15):
    """Deflection of the rim of an annular plate, clamped inside and free outside, under its weight (Kirchhoff).

    w = q r^4 / 64 B + c0 ln r + c1 r^2 ln r + c2 r^2 + c3, with w = w' = 0 inside, no moment and no shear outside.
    """
    a, b, q = outer, inner, load / stiffness
    rows = [
        [math.log(b), b * b * math.log(b), b * b, 1],
        [1 / b, 2 * b * math.log(b) + b, 2 * b, 0],
        [(poisson - 1) / a**2, 2 * math.log(a) + 3 + poisson * (2 * math.log(a) + 1), 2 * (1 + poisson), 0],
        [0, 4 / a, 0, 0],
    ]
    right = [-q * b**4 / 64, -q * b**3 / 16, -q * (3 + poisson) * a * a / 16, -q * a / 2]
    c = np.linalg.solve(rows, right)
    return q * a**4 / 64 + c @ [math.log(a), a * a * math.log(a), a * a, 1]


def test_a_board_has_a_drape_coefficient_of_one():
    """And its rim sinks as that of a plate that is clamped at the disc."""
    for sectors, tolerance in (36, 0.08), (72, 0.02):
        found = fabric.drape(isotropic(1e-2, density=0.1, youngs=1e5), sectors=sectors)
        assert found.coefficient == pytest.approx(1, abs=1e-3) and found.nodes == 0 and found.at_rest
        sunk = -found.vertices[-sectors - 1 : -1, 2].mean()
        assert sunk == pytest.approx(droop(1e-2, 0.1 * G, 0.0), rel=tolerance)


def test_limp_cloth_drapes_more():
    found = [
        fabric.drape(isotropic(b, density=0.15, youngs=500.0, poisson=0.2), sectors=sectors)
        for b, sectors in ((1e-4, 60), (2e-5, 60), (1e-7, 120))  # folds of the last are narrower than cells of 60
    ]
    stiff, medium, limp = (d.coefficient for d in found)
    assert 1 > stiff > medium + 0.1 and medium > limp + 0.2
    assert limp < 0.5
    assert found[0].nodes < found[1].nodes < found[2].nodes
    assert all(d.at_rest and (np.hypot(*d.vertices.T[:2]) < 0.151).all() for d in found)
    assert cama.collision.intersections(found[2].vertices, found[2].faces).size == 0


def test_a_drape_depends_on_its_seed_alone():
    one, same, other = (fabric.drape("wool", seed, sectors=30, seconds=1.0) for seed in (4, 4, 5))
    assert (one.vertices == same.vertices).all() and (one.vertices != other.vertices).any()
    with pytest.raises(cama.ArrayError, match="at least 24"):
        fabric.drape("wool", sectors=10)


def test_a_drape_is_the_same_on_every_backend():
    one, other = (fabric.drape("wool", sectors=24, seconds=0.1, backend=backend) for backend in ("cpu", "opencl"))
    assert (one.vertices == other.vertices).all() and one.vertices[:, 2].min() < -5e-3  # it has fallen
    with pytest.raises(cama.BackendError, match="'gpu' is not in this build; available"):
        fabric.drape("wool", sectors=24, backend="gpu")


@pytest.mark.parametrize("nodes", [0, 1, 2, 5, 12])
def test_nodes_are_counted(nodes):
    angle = 2 * np.pi * np.arange(144) / 144
    radius = 0.12 + 0.01 * np.cos(nodes * angle + 1.0) * (nodes > 0) + 0.0005 * np.cos(40 * angle)
    assert draping.count_nodes(radius) == nodes
    assert draping.count_nodes(np.roll(radius, 17)[::-1]) == nodes


def test_the_shadow_of_waves():
    """A rim r = a + b cos(n phi) encloses pi (a^2 + b^2 / 2)."""
    sectors, a, b = 360, 0.12, 0.012
    vertices, faces = draping.annulus_mesh(draping.DISC, draping.SPECIMEN, sectors, 12)
    angle, radius = np.arctan2(*vertices.T[::-1]), np.hypot(*vertices.T)
    part = np.clip((radius - draping.DISC) / (draping.SPECIMEN - draping.DISC), None, 1)
    moved = draping.DISC + part * (a + b * np.cos(6 * angle) - draping.DISC)
    positions = np.column_stack([moved * np.cos(angle), moved * np.sin(angle), -part * 0.03])
    found = draping._measured(positions, vertices, faces, sectors, True)
    expected = (a * a + b * b / 2 - draping.DISC**2) / (draping.SPECIMEN**2 - draping.DISC**2)
    assert found.coefficient == pytest.approx(expected, abs=2e-3) and found.nodes == 6


# --- The report -------------------------------------------------------------------------------------------------------


def test_a_report_puts_values_beside_what_is_published():
    report = fabric.test("cotton", ["picture_frame"])
    assert {row.test for row in report.rows} == {"picture_frame"}
    assert report.value("shear rigidity") == pytest.approx(55, rel=2e-3)
    (row,) = (row for row in report.rows if row.quantity == "shear rigidity")
    assert row.verdict == "within" and (row.published.low, row.published.high) == (28, 84) and row.expected == 55
    stiff = cama.Material.orthotropic(8000, 4500, 0.2, 300, 1e-5, 7e-6, 0.12)
    stiff.name = "cotton"
    (row,) = (row for row in fabric.test(stiff, ["picture_frame"]).rows if row.quantity == "shear rigidity")
    assert row.verdict == "above"
    assert json.loads(json.dumps(report.to_dict()))["rows"][0]["unit"] == "N"
    with pytest.raises(cama.ArrayError, match="no weft bending length"):
        report.value("bending length", "weft")
    with pytest.raises(cama.ArrayError, match="'tensil' is not one of .*did you mean 'tensile'"):
        fabric.test("cotton", ["tensil"])
    with pytest.raises(cama.MaterialError, match="kevlar"):
        fabric.test("kevlar")


def test_every_shipped_fabric_is_published_about():
    for name in cama.fabrics():
        assert fabric.published(name, "tensile stiffness", "warp").low > 0
    assert fabric.published("cotton", "no such quantity") is None


def test_a_material_of_tables_is_tested_without_closed_forms():
    table = cama.Material.fabric("jersey")
    rows = np.array(table.stretching)
    rows[1:] *= 2
    table.stretching = rows.tolist()
    report = fabric.test(table, ["tensile", "picture_frame"])
    assert all(row.expected is None for row in report.rows)
    assert report.value("tensile stiffness", "warp") > fabric.tensile("jersey", stretches=(0.05,)).force[0] / 0.05
    curved = isotropic()
    curved.bending = [[1e-5, 2e-5, 3e-5, 4e-5, 5e-5]] * 3
    found = fabric.cantilever(curved, cells=8)
    assert found.expected is None and found.bending_length > 0


# --- Fits -------------------------------------------------------------------------------------------------------------


def measured_of(material, scatter=0.01):
    """What a laboratory would measure of COTTON; the strips are simulated, the rest are closed forms."""
    weight = COTTON["density"] * G
    strips = {d: fabric.tensile(material, d, (0.02, 0.05), cells=32) for d in ("warp", "weft", "bias")}
    return {
        "name": "again",
        "density": {"value": COTTON["density"], "scatter": 0.001},
        "tensile": {d: [[e, f, scatter * f] for e, f in zip(s.stretch, s.force)] for d, s in strips.items()},
        "picture_frame": [[a, shear.SIDE * 55 * math.sin(t) * math.cos(t) / math.sin(math.pi / 4 - t / 2)]
                          for a, t in ((5.0, math.radians(5.0)), (15.0, math.radians(15.0)))],
        "poisson_ratio": {"value": COTTON["poisson"], "scatter": 0.01},
        "bending_length": {
            d: {"value": (8.0042 * COTTON[f"bending_{d}"] / weight) ** (1 / 3) / 2, "scatter": 0.0005}
            for d in ("warp", "weft")
        },
    }  # fmt: skip


@pytest.fixture(scope="module")
def cotton_again():
    return measured_of(cama.Material.fabric("cotton"))


def test_a_fit_finds_the_fabric_that_was_measured(cotton_again, tmp_path):
    found = fabric.fit(cotton_again)
    assert found.values["youngs_warp"] == pytest.approx(8000, rel=2e-3)
    assert found.values["youngs_weft"] == pytest.approx(4500, rel=2e-3)
    assert found.values["shear"] == pytest.approx(55, rel=5e-3)
    assert found.values["poisson_ratio"] == pytest.approx(0.2, abs=2e-3)
    assert found.values["bending_warp"] == pytest.approx(1e-5, rel=1e-3)
    assert found.values["bending_weft"] == pytest.approx(7e-6, rel=1e-3)
    assert all(abs(row.residual) < 0.5 for row in found.measured)
    found.write(tmp_path / "again.json")
    read = cama.Material.load(tmp_path / "again.json")
    assert read.name == "again" and read.stretching[0] == pytest.approx(found.material.stretching[0], rel=1e-5)
    scene = cama.Scene.parse(
        {
            "materials": {"mine": {"file": "again.json"}},
            "cloth": [{"grid": {"size": [0.1, 0.1], "cells": [2, 2]}, "material": "mine"}],
        },
        tmp_path,
    )
    assert scene.cloths[0].material.bending == read.bending


def test_uncertainties_are_those_of_propagation(cotton_again):
    """B = w (2 c)^3 / 8.0042: its relative variance is 9 of the length's and one of the weight's. Two forces of 1 %
    determine a modulus to 1 % / sqrt(2), while the Poisson ratio is nearly known."""
    found = fabric.fit(cotton_again)
    for d in ("warp", "weft"):
        length = cotton_again["bending_length"][d]["value"]
        relative = math.hypot(3 * 0.0005 / length, 0.001 / 0.12)
        assert found.uncertainties[f"bending_{d}"] / found.values[f"bending_{d}"] == pytest.approx(relative, rel=0.01)
        relative = 0.01 / math.sqrt(2)
        assert found.uncertainties[f"youngs_{d}"] / found.values[f"youngs_{d}"] == pytest.approx(relative, rel=0.02)
    assert np.diag(found.covariance) == pytest.approx(np.square(list(found.uncertainties.values())))
    assert found.covariance[0, 5] > 0  # a heavier cloth of the same bending length is stiffer


def test_what_is_not_measured_is_as_uncertain_as_it_is_assumed(cotton_again):
    few = {key: value for key, value in cotton_again.items() if key not in ("poisson_ratio", "picture_frame")}
    found = fabric.fit(few)
    assert found.values["poisson_ratio"] == pytest.approx(0.25, abs=0.02)
    assert found.uncertainties["poisson_ratio"] == pytest.approx(0.1, rel=0.1)
    assert found.values["shear"] == pytest.approx(55, rel=0.03)  # from the bias
    assert "was assumed" in found.description["evidence"]["poisson_ratio"]


def test_a_fit_by_the_drape_coefficient(cotton_again):
    """What another disturbance of the start drapes is found back, from a start that is far off."""
    sectors = 48
    known = cama.Material.orthotropic(8000, 4500, 0.2, 55, 4e-5, 4e-5, 0.12)
    draped = float(np.mean([fabric.drape(known, seed, sectors).coefficient for seed in (7, 8, 9)]))
    given = {key: value for key, value in cotton_again.items() if key != "bending_length"}
    given["drape_coefficient"] = {"value": draped, "scatter": 0.01}
    found = fabric.fit(given, sectors=sectors)
    assert abs(math.log(found.values["bending_warp"] / 4e-5)) < 0.5
    row = found.measured[-1]
    assert row.quantity == "drape coefficient" and row.method == "simulation" and abs(row.residual) < 1
    # one of the two directions would be known much better if both were measured
    assert found.uncertainties["bending_warp"] > 0.2 * found.values["bending_warp"]


def test_a_drape_that_no_stiffness_gives(cotton_again):
    """Coarse cloth whose yarns hardly stretch does not hang straight down, however limp it is."""
    given = {key: value for key, value in cotton_again.items() if key != "bending_length"}
    given["drape_coefficient"] = {"value": 0.05, "scatter": 0.01}
    with pytest.raises(cama.MaterialError, match="drape_coefficient: 0.05 is out of reach"):
        fabric.fit(given, drapes=1, sectors=24)


@pytest.mark.parametrize(
    "change, text",
    [
        ({"bending_length": 0.02}, "bending_length: 0.02 is not an object with warp, weft"),
        ({"density": None}, "lacks density"),
        ({"tensile": {"warp": [[0.02, 100]]}}, "lacks tensile: weft"),
        ({"bending_length": {"warp": 0.02}}, r"lacks bending_length: weft \(or flexural_rigidity"),
        ({"drape_coeficient": 0.6}, "unknown key 'drape_coeficient'.*did you mean 'drape_coefficient'"),
        ({"density": -1}, "density: -1 is not above 0"),
        ({"density": {"value": 0.1, "sd": 1}}, "density: unknown key 'sd'"),
        ({"tensile": {"warp": [[0.02]], "weft": [[0.02, 9]]}}, r"tensile: warp\[0\].*not a pair"),
        ({"tensile": {"wrap": [[0.02, 9]]}}, "unknown direction 'wrap'"),
        ({"drape_coefficient": 62}, "62 is not below 1"),
        ({"gauge": 0.2}, "gauge: 0.2 is not"),
        ({"picture_frame": [[95, 1]]}, "95 is not below 90"),
    ],
)
def test_measured_values_that_cannot_be_used(cotton_again, change, text):
    given = {key: value for key, value in {**cotton_again, **change}.items() if value is not None}
    with pytest.raises(cama.MaterialError, match=text):
        fabric.fit(given)


# --- The command line -------------------------------------------------------------------------------------------------


def test_list_and_show():
    listed = call("fabric", "list")
    assert listed.exit_code == 0 and all(name in listed.output for name in cama.fabrics())
    assert {row["name"] for row in json.loads(call("fabric", "list", "--json").output)} == set(cama.fabrics())
    shown = call("fabric", "show", "denim")
    assert "70 to 90 %" in shown.output and "400 g/m²" in shown.output
    assert json.loads(call("fabric", "show", "denim", "--json").output)["density"] == 0.4


def test_the_table_and_the_json_of_a_test(tmp_path):
    words = ("fabric", "test", "silk", "--only", "drape", "--sectors", 24, "--drapes", 2)
    shown = call(*words)
    assert shown.exit_code == 0 and "ISO 9073-9" in shown.output and "20 to 40 %" in shown.output
    read = json.loads(call(*words, "--json").output)
    assert [row["quantity"] for row in read["rows"]] == ["drape coefficient", "nodes"]
    assert read["rows"][0]["scatter"] >= 0 and read["rows"][0]["published"]["high"] == 0.4
    refused = call("fabric", "test", "kevlar")
    assert refused.exit_code == 2
    assert call("fabric", "test", "silk", "--only", "tensile", "--picture", tmp_path / "a.png").exit_code == 2
    assert call("fabric", "test", "silk", "--picture", tmp_path / "a.jpg").exit_code == 2
    assert not os.listdir(tmp_path)


def test_a_fit_on_the_command_line(tmp_path):
    example = json.loads(call("fabric", "fit", "--example").output)
    assert call("fabric", "fit", "--example", "-o", tmp_path / "example.json").exit_code == 0
    assert json.loads((tmp_path / "example.json").read_text()) == example
    del example["drape_coefficient"]
    (tmp_path / "measured.json").write_text("// a comment\n" + json.dumps(example))
    out = tmp_path / "made" / "twill.json"
    done = call("fabric", "fit", tmp_path / "measured.json", "-o", out)
    assert done.exit_code == 0 and "uncertainty" in done.output
    assert cama.Material.load(out).name == "my-twill"
    assert os.listdir(out.parent) == ["twill.json"]
    (tmp_path / "bad.json").write_text("{")
    assert call("fabric", "fit", tmp_path / "bad.json", "-o", tmp_path / "no.json").exit_code == 2
    assert call("fabric", "fit", "-o", tmp_path / "no.json").exit_code == 2
    assert not (tmp_path / "no.json").exists()


def test_a_run_takes_a_material(tmp_path):
    """As the scene would with that material; each cloth keeps its contact thickness."""
    scene = {
        "cloth": [
            {"name": n, "grid": {"size": [0.1, 0.1], "cells": [2, 2]}, "material": "denim", "thickness": 0.002,
             "transform": {"translate": [0, 0, z]}}
            for n, z in (("low", 0.0), ("high", 0.1))
        ]
    }  # fmt: skip
    (tmp_path / "scene.json").write_text(json.dumps(scene))
    loaded = cama.Scene.load(tmp_path)
    common.put_materials(loaded, ["high=silk"])
    low, high = (cloth.material for cloth in loaded.cloths)
    assert low.density == 0.4 and high.density == 0.052 and high.thickness == 0.002
    common.put_materials(loaded, ["wool", "low=cotton"])
    assert [cloth.material.density for cloth in loaded.cloths] == [0.12, 0.2]
    with pytest.raises(cama.SceneError, match=r"no cloth 'lwo'; there are \['low', 'high'\]"):
        common.put_materials(loaded, ["lwo=silk"])
    out = tmp_path / "out"
    assert call("run", tmp_path, "--material", "high=silk", "--frames", 1, "-o", out).exit_code == 0
    assert call("run", tmp_path, "--material", "kevlar", "--frames", 1, "-o", tmp_path / "no").exit_code == 2
    assert not (tmp_path / "no").exists()


def test_a_picture_of_the_drape(tmp_path):
    pyvista = pytest.importorskip("pyvista")
    path = tmp_path / "drape.png"
    done = call("fabric", "test", "wool", "--only", "drape", "--sectors", 24, "--drapes", 1, "--picture", path)
    assert done.exit_code == 0
    image = np.asarray(pyvista.read(path)["PNGImage"]).reshape(700, 1400, -1)[..., :3].astype(float)
    dark = np.abs(image - 255).sum(axis=2) > 150
    assert dark[:, :700].mean() > 0.05 and dark[:, 700:].mean() > 0.3
    assert os.listdir(tmp_path) == ["drape.png"]
