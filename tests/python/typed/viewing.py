# SPDX-License-Identifier: Apache-2.0
"""A recorded and a shown simulation."""

import tempfile

import cama

scene = cama.Scene()
sheet = scene.add_cloth(shape={"grid": {"size": [0.2, 0.2], "cells": [2, 2]}})
simulation = cama.Simulation(scene, accuracy="preview")
with tempfile.TemporaryDirectory() as folder:
    summary = cama.record(simulation, folder, frames=1, store="single")
    steps: int = summary["steps"]
with simulation.show() as viewer:
    url: str = viewer.url
    viewer.run()
    viewer.pause()
    viewer.update()
area: float = float(sheet.rest_corners[:, 1, 0].sum())
