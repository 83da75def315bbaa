# SPDX-License-Identifier: Apache-2.0
"""Every accuracy level on every backend that is there."""

import cama

scene = cama.Scene.parse(
    {"cloth": [{"grid": {"size": [0.2, 0.2], "cells": [2, 2]}, "material": "cotton"}], "contact": {"enabled": False}}
)
devices: dict[str, list[str]] = {row["name"]: row["devices"] for row in cama.backends() if row["available"]}
for level in cama.accuracy_levels():
    simulation = cama.Simulation(scene, accuracy=level, backend="cpu", time_step=0.01)
    simulation.step()
    stages: list[tuple[str, str]] = simulation.explain()
    first, last = simulation.cloth_ranges[0]
    print(level, simulation.time_step, len(stages), last - first, simulation.options["tolerance"])
names: list[str] = cama.scenes() + cama.fabrics()
print(devices, names)
