# SPDX-License-Identifier: Apache-2.0
"""Textile tests and fits."""

import cama

report = cama.fabric.test("cotton", ["picture_frame"], progress=print)
rigidity: float = report.value("shear rigidity")
for row in report.rows:
    if row.published is not None:
        print(row.quantity, row.published.low <= row.value, row.verdict.upper())
length: float = cama.fabric.cantilever(cama.Material.fabric("wool"), "weft", cells=8).bending_length
strip = cama.fabric.tensile("wool", stretches=[0.01], cells=8)
forces: tuple[float, ...] = strip.force
hanging = cama.fabric.drape("wool", seed=1, sectors=24, seconds=0.5)
print(hanging.coefficient, hanging.nodes, hanging.vertices.shape, rigidity, length, forces)
found = cama.fabric.fit(
    {
        "density": 0.2,
        "tensile": {"warp": [[0.02, 90]], "weft": [[0.02, 70]]},
        "shear_rigidity": {"value": 40, "scatter": 4},
        "bending_length": {"warp": 0.018, "weft": 0.017},
    }
)
stiffness: float = found.values["bending_warp"]
material: cama.Material = found.material
print(stiffness, material.density, found.measured[0].residual)
