# SPDX-License-Identifier: Apache-2.0
"""What benchmarks/ reads, counts and writes; step_times itself where it is built."""

import itertools
import math
import sys
from pathlib import Path

import numpy as np
import pytest

import cama

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "benchmarks"))
import paper_figures  # noqa: E402
import paper_scenes  # noqa: E402
import paper_tables  # noqa: E402
import peers  # noqa: E402
import performance_page  # noqa: E402
import scene_pack  # noqa: E402
import times  # noqa: E402
import worlds  # noqa: E402

HEADER = (
    "scene,triangles,accuracy,backend,device,precision,options,time_step,skipped,steps,stage,mean_ms,median_ms,stddev_ms,p95_ms,bytes,"
    "bandwidth_gbs,floor_ms,ratio,iterations,launches,waits,contacts,candidates,intersections,peak_mib,hash\n"
)


def rows(step, parts, iterations=100, triangles=200000):
    """CSV of one run: milliseconds of the step and of its stages."""
    start = f'sphere,{triangles},paper,cpu,"a device, 1 thread",double,"",0.005,1,2,'
    text = f'{start}"step",{step},{step},0,{step},1e6,1.0,1.0,{step},{iterations},10,,5,50,0,12.5,00ff\n'
    return text + "".join(f'{start}"{name}",{ms},{ms},0,{ms},,,,,,,,,,,,\n' for name, ms in parts.items())


PARTS = {
    "proximity checking": 2,
    "matrix assembly": 4,
    "matrix assembly/matrix assembly": 3,
    "linear solve": 10,
    "penetration handling": 3,
    "finish step": 1,
}


def test_csv_is_read_run_by_run():
    runs = times.parse(HEADER + rows(20, PARTS) + "# remark\n" + HEADER + rows(40, PARTS, triangles=400000))
    assert [r["triangles"] for r in runs] == [200000, 400000] and [r["median_ms"] for r in runs] == [20, 40]
    assert runs[0]["device"] == "a device, 1 thread" and math.isnan(runs[0]["waits"]) and runs[0]["peak_mib"] == 12.5
    assert list(runs[0].top()) == [
        "proximity checking",
        "matrix assembly",
        "linear solve",
        "penetration handling",
        "finish step",
    ]
    assert "matrix assembly" not in runs[0].leaves() and "matrix assembly/matrix assembly" in runs[0].leaves()


def test_exponent_of_a_power_law():
    assert times.exponent([(x, 3 * x**1.37) for x in (16e3, 64e3, 256e3, 1e6)]) == pytest.approx(1.37)
    figure16 = np.log([(16e3, 0.27), (64e3, 1.22), (256e3, 5.30), (1e6, 35.57)])  # of the paper: 1.17
    assert times.exponent(np.exp(figure16).tolist()) == pytest.approx(np.polyfit(*figure16.T, 1)[0])
    assert math.isnan(times.exponent([(1000, 1.0), (1000, 2.0)]))


def test_shares_and_claims_are_those_of_the_times():
    base = times.parse(HEADER + rows(20, PARTS))[0]
    assert paper_tables.shares(base) == {"PC": 2, "MA": 4, "LS": 10, "PH": 3, "Misc": 1}
    plain = times.parse(HEADER + rows(26, {**PARTS, "linear solve": 16}, iterations=125))[0]
    sort = times.parse(HEADER + rows(29, {**PARTS, "matrix assembly/matrix assembly": 12}))[0]
    whole = times.parse(HEADER + rows(23, {**PARTS, "penetration handling": 6}))[0]
    tight = times.parse(HEADER + rows(26, PARTS))[0]
    found = paper_tables.claims(
        {
            "paper": base,
            "no preconditioner": plain,
            "sorted assembly": sort,
            "search not localized": whole,
            "tolerance 1e-11": tight,
        }
    )
    assert found == ["20 %", "30 %", "4.00x", None, "50 %", "30 %"]


def test_a_section_of_the_page_is_replaced_and_nothing_else():
    page = "a\n<!-- section gpu -->\nold\n<!-- end gpu -->\nb\n"
    assert (
        performance_page.replace_section(page, "gpu", r"new \1")
        == "a\n<!-- section gpu -->\n\nnew \\1\n\n<!-- end gpu -->\nb\n"
    )
    with pytest.raises(ValueError, match="no section 'cpu'"):
        performance_page.replace_section(page, "cpu", "new")


def test_published_figures_stand_beside_runs_of_their_size_alone():
    large, small = times.parse(HEADER + rows(20, PARTS) + rows(2, PARTS, triangles=2000))
    assert performance_page.published(large) == "2,840 (CAMA, K40c)" and performance_page.published(small) == ""


def test_sizes_are_compared_from_the_same_step_on_alone():
    text = (
        HEADER
        + rows(20, PARTS)
        + rows(80, PARTS, triangles=800000)
        + rows(1, PARTS, triangles=2000).replace(",1,2,", ",9,2,")
    )
    table = performance_page.scaling(times.parse(text)).splitlines()
    assert len(table) == 3 and "200,000 / 800,000 | 20 / 80 | 1.00 |" in table[2]


def step_times(**settings):
    """Runs of the program; skips where it is not built."""
    try:
        program = times.find_program()
    except FileNotFoundError as missing:
        pytest.skip(str(missing))
    text, said = times.run(program, str(ROOT / "scenes" / "drape"), 60, threads=1, bandwidth=10, **settings)
    assert text.startswith(HEADER), said
    return times.parse(text), said


def test_bytes_of_a_solve_are_those_of_the_mesh():
    """Before the layers touch anything: blocks counted from the faces, three-kernel conjugate gradient in double."""
    (run,), _ = step_times(resolutions=600, skip=0, steps=1, preconditioner="block_jacobi")
    simulation = cama.Simulation(cama.Scene.load("drape", 600), backend="cpu", threads=1)
    cloth, faces = simulation.cloth_vertex_count, simulation.faces
    opposite, pairs = {}, set()
    for face in faces[(faces < cloth).all(axis=1)].tolist():
        pairs |= set(itertools.permutations(face, 2))
        for k in range(3):
            edge = frozenset((face[k], face[k - 1]))
            opposite.setdefault(edge, []).append(face[k - 2])
    for ends in opposite.values():
        pairs |= set(itertools.permutations(ends, 2))
    blocks, i = cloth + len(pairs), run["iterations"]
    multiply = blocks * (9 * 8 + 4) + cloth * (4 + 2 * 24)
    vectors = 12 * 24 - 2 * 24 + 72  # update and direction, the preconditioner's block
    assert run["contacts"] == 0 and i > 0
    assert run.stages["linear solve"]["bytes"] == (i + 1) * multiply + i * vectors * cloth


def test_floors_times_and_counts_fit_together():
    (run,), said = step_times(resolutions=600, skip=60, steps=4, audit=1)
    top, leaves = run.top(), run.leaves()
    assert run["bytes"] == pytest.approx(sum(r["bytes"] for r in top.values()), rel=0.05)  # medians
    assert run["bytes"] == pytest.approx(sum(r["bytes"] for r in leaves.values()), rel=0.05)
    assert run["floor_ms"] == pytest.approx(run["bytes"] / 10e9 * 1e3, rel=1e-3)
    assert run["mean_ms"] >= sum(r["mean_ms"] for r in top.values()) >= 0.5 * run["mean_ms"]
    assert run["contacts"] > 0 and run["candidates"] > run["contacts"] and run["intersections"] == 0
    assert run["hash"] in said and run["skipped"] == "60" and run["steps"] == "4"


def test_several_resolutions_give_an_exponent():
    runs, said = step_times(resolutions="200,800", skip=0, steps=1)
    assert [r["triangles"] for r in runs] == [3 * 2 * 6 * 6, 3 * 2 * 12 * 11]
    assert "# exponent" in said


def test_an_unknown_name_or_value_is_refused():
    try:
        program = times.find_program()
    except FileNotFoundError as missing:
        pytest.skip(str(missing))
    for settings, words in (
        ({"colour": 1}, "'colour' is not known"),
        ({"steps": "1.5"}, "not a whole number"),
        ({"paper.search": "x"}, "tree or fronts"),
    ):
        text, said = times.run(program, str(ROOT / "scenes" / "drape"), 20, **settings)
        assert text == "" and words in said


def test_a_packed_scene_is_the_scene(tmp_path):
    """Positions to single precision, animations to 2^-17 m, and all else as it was."""
    scene = cama.Scene.load("garment", 500)
    scene.frames = 20
    scene_pack.write(scene, tmp_path / "garment.npz")
    packed = scene_pack.read(tmp_path / "garment.npz")
    (skirt, body), (own, same) = ((of.cloths[0], of.obstacles[0]) for of in (scene, packed))
    np.testing.assert_allclose(own.vertices, skirt.vertices, atol=2e-7)
    np.testing.assert_allclose(own.material_vertices, skirt.material_vertices, atol=2e-7)
    assert (own.faces == skirt.faces).all() and (same.faces == body.faces).all()
    for time in (0.0, 0.2, 0.39):
        moved = body.motion.evaluate(time, body.vertices)
        np.testing.assert_allclose(same.motion.evaluate(time, same.vertices), moved, atol=2.0**-17)
    assert (packed.pins[0]["vertices"] == scene.pins[0]["vertices"]).all() and packed.pins[0]["obstacle"] == 0
    assert packed.frames == 20 and packed.thickness == scene.thickness and same.friction == body.friction


def test_frames_are_kept_evenly_and_in_small_steps(tmp_path):
    kept = paper_scenes.Kept(8)
    positions = np.linspace(-1, 1, 300).reshape(100, 3)
    for number in range(101):
        kept.add(number, 0.02 * number, positions + 0.001 * number)
    kept.write(tmp_path / "frames.npz")
    with np.load(tmp_path / "frames.npz") as file:
        assert 4 <= len(file["number"]) <= 8 and (np.diff(file["number"]) == file["number"][1]).all()
        found = paper_scenes.kept_positions(file)[2]
        np.testing.assert_allclose(found, positions + 0.001 * file["number"][2], atol=2.0**-14 + 1e-12)


def test_a_checkpoint_lets_every_device_of_a_figure_measure_the_same_steps(tmp_path):
    start = tmp_path / "start.h5"

    def counts(**options):
        row, _ = paper_figures.measured("sphere", 200, 40, 3, paper_figures.Clock(60), **options)
        return [row[key] for key in ("triangles", "skipped", "steps", "iterations", "contacts")]

    expected = counts()
    assert not start.exists() and expected[1:3] == [40, 3] and expected[4] > 0
    assert counts(threads=2, start=start) == expected and start.exists()
    assert counts(threads=1, start=start) == expected


def test_energy_of_a_sheet_in_free_fall(tmp_path):
    peers.write_case(tmp_path / "case.npz", "drape", 200, 0.1, 40)
    with np.load(tmp_path / "case.npz") as case:
        fallen = [case["vertices"] - [0, 0, 0.5 * 9.81 * (k / 40) ** 2] for k in range(1, 5)]
        found = peers.energy(case, np.stack(fallen))
    mass, speed = 0.15, 9.81 * 3.5 / 40  # of 1 m^2; the mean speed of the last frame
    assert found["kinetic_mj"] == pytest.approx(500 * mass * speed**2, abs=1e-3)
    assert found["height_mj"] == pytest.approx(-1e3 * mass * 9.81 * 0.5 * 9.81 * 0.1**2, abs=1e-3)


def test_options_of_the_figures_are_those_of_a_simulation():
    changed = {"paper.assembly": "sorted", "paper.localized_search": "false", "tolerance": "1e-11"}
    options = paper_figures.options_of(changed)
    assert options == {"tolerance": 1e-11, "paper": {"assembly": "sorted", "localized_search": False}}
    simulation = cama.Simulation(cama.Scene.load("sphere", 100), accuracy="paper", **options)
    assert simulation.options["paper.assembly"] == "sorted" and simulation.options["tolerance"] == 1e-11
    assert simulation.options["paper.localized_search"] is False


def test_worlds_are_measured_by_steps_and_by_episodes(capsys, monkeypatch):
    common = ["worlds.py", "--backend", "cpu", "--worlds", "2", "--layers", "2", "--set", "tolerance=2e-2"]
    monkeypatch.setattr(sys, "argv", [*common, "--warm", "1", "--steps", "2", "--compare", "2"])
    worlds.main()
    assert "2 worlds compared with themselves alone: 0 differ; 0 intersections" in capsys.readouterr().out
    monkeypatch.setattr(sys, "argv", [*common, "--episodes", "2", "--length", "3", "--accuracy", "interactive"])
    worlds.main()
    first, second = capsys.readouterr().out.splitlines()
    assert "episode 0" in first and "episode 1" in second
    assert first.endswith(" 0 frozen") and second.endswith(" 0 frozen")
    sheets = worlds.scene(3, layers=2).cloths
    assert [len(sheet.faces) for sheet in sheets] == [256, 256]
