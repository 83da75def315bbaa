# SPDX-License-Identifier: Apache-2.0
"""Mistakes that mypy must report, one in every line that says which. Not run."""

import cama

scene = cama.Scene(time_step="fast")  # expect: arg-type
scene.frames = "all"  # expect: assignment
sheet = scene.add_cloth("sheet.obj", colour="red")  # expect: call-arg
sheet.vertices = sheet.faces  # expect: misc, assignment
simulation = cama.Simulation(scene, backend="gpu")  # expect: arg-type
other = cama.Simulation(scene, solver="cholesky")  # expect: arg-type
third = cama.Simulation(scene, tolerence=1e-3)  # expect: call-arg
simulation.step("twice")  # expect: arg-type
count: str = simulation.report["contacts"]  # expect: assignment
impulse = simulation.report["impulse"]  # expect: typeddict-item
hit = cama.collision.vertex_face_ccd([], [], method="magic")  # expect: arg-type
cama.tune.Budget(error="1mm")  # expect: arg-type
print(cama.no_such_thing)  # expect: attr-defined
