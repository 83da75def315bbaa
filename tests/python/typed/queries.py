# SPDX-License-Identifier: Apache-2.0
"""Geometry on arrays, and errors."""

import numpy as np
import numpy.typing as npt

import cama

start = np.zeros((1, 4, 3))
start[0] = [[0.2, 0.2, 1.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
end = start.copy()
end[0, 0, 2] = -1
hit, time = cama.collision.vertex_face_ccd(start, end, minimum_distance=0.1)
first: npt.NDArray[np.float64] = time[hit]
distance: npt.NDArray[np.float64] = cama.collision.vertex_face_distance(start)
both, weights = cama.collision.vertex_face_distance(start, return_weights=True)
crossing: npt.NDArray[np.int32] = cama.collision.intersections([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
print(first, distance, both, weights, len(crossing))

try:
    cama.collision.edge_edge_ccd(start, end[:0], method="cubic")
except cama.ArrayError as problem:
    text: str = str(problem)
    assert isinstance(problem, (cama.Error, ValueError)), text
