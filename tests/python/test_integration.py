# SPDX-License-Identifier: Apache-2.0
"""The order in the time step of one linearised solve a step."""

import numpy as np
import pytest

import cama


def end_of_swing(steps, **options):
    """Positions [vertices, 3] of a sheet that is let go flat, held at two corners, after 0.1 s."""
    scene = cama.Scene(self_contact=False)
    scene.add_cloth(shape={"grid": {"size": [0.3, 0.3], "cells": [5, 5]}}, material="cotton", name="sheet")
    scene.pin("sheet", [0, 5])
    simulation = cama.Simulation(
        scene, accuracy="interactive", precision="double", time_step=0.1 / steps, tolerance=1e-8, **options
    )
    simulation.step(steps)
    return simulation.positions


@pytest.mark.parametrize("integrator, least, most", [("backward_euler", 0.6, 1.3), ("bdf2", 1.7, 2.6)])
def test_the_order_of_one_solve_a_step(integrator, least, most):
    exact = end_of_swing(3200, integrator="bdf2", newton_iterations=10, newton_tolerance=1e-9)
    errors = [np.abs(end_of_swing(steps, integrator=integrator) - exact).max() for steps in (100, 200, 400)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert least < orders[-1] < most, (errors, orders)
