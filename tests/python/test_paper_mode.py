# SPDX-License-Identifier: Apache-2.0
"""The level `paper` survives the paper's scenes: no commit, and still next to no intersections (their Figure 17)."""

import numpy as np
import pytest

import cama


@pytest.mark.parametrize("name", ["funnel", "sphere", "twisting"])
def test_paper_mode_ends_its_scenes_without_a_tangle(name):
    scene = cama.Scene.load(name, resolution=600)
    simulation = cama.Simulation(scene, accuracy="paper", time_step=1 / 200)
    passes, strain = [], 0.0
    for _ in range(120):
        simulation.step()
        assert simulation.count_intersections() == 0, f"step {simulation.report['step']}"
        passes.append(simulation.report["impact_passes"])
        strain = max(strain, simulation.max_strain)
    assert np.isfinite(simulation.positions).all()
    assert max(passes) > 0, "the projection had something to do"
    assert max(passes) < 30, "and it is bounded in time"
    assert strain < 1


def test_an_impact_that_a_step_is_too_long_for_divides_it():
    """Three layers land in a funnel at 2.4 m/s: an edge of 30 mm in a step of 1/80 s, undivided strained by 125 %."""
    scene = cama.Scene.load("funnel", resolution=2000)
    simulation = cama.Simulation(scene, accuracy="paper", time_step=1 / 80)
    divided, strain = 0, 0.0
    for _ in range(60):
        simulation.step()
        divided += simulation.report["retries"] > 0
        strain = max(strain, simulation.max_strain)
    assert simulation.count_intersections() == 0
    assert 0 < divided < 30
    assert strain < 1
