# SPDX-License-Identifier: Apache-2.0
"""Tools that are loaded on first use: accuracy, tradeoff, tune."""

from typing import Optional

import cama

scene = cama.Scene(time_step=0.01, contact=False)
cloth = scene.add_cloth([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]], [[0, 1, 2]], material="silk", translate=(0, 0, 1))
scene.pin(cloth.name, vertices=[0])

reference = cama.accuracy.reference(scene, window=0.02, windows=2, time_step=0.0025)
error = cama.accuracy.restart_error(reference, scene, backend="cpu", tolerance=1e-3)
edges: float = error.rms_edges
angle: float = cama.accuracy.friction_angle(friction=0.3, seconds=0.05, width=4.0, backend="cpu")
area: float = cama.accuracy.shadow_area(cloth.vertices, cloth.faces)
front: list[int] = cama.tradeoff.pareto([(1.0, 2.0), (2.0, 1.0), (None, 0.0)])
setup = cama.tradeoff.Setup(backends=("cpu",), jobs=0)
budget = cama.tune.Budget(error=1e-3)
limit: Optional[float] = budget.limit(reference.edge)
print(edges, angle, area, front, setup.limit, limit)
