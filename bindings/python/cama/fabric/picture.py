# SPDX-License-Identifier: Apache-2.0
"""A picture of a drape: from the side, and its shadow on the disc from above."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np

from ..errors import FileError
from ..hints import require
from .draping import DISC, SPECIMEN, Drape
from .writing import write

SIZE = [1400, 700]  # of both views together
CLOTH, SHADOW, STAND = "#4f7cac", "#31475e", "#b9b4ac"


def check(path: Path) -> None:
    """Raises BackendError if the picture cannot be drawn, FileError if its name is not that of a PNG file."""
    require("a picture of the drape", "pyvista")
    if path.suffix.lower() != ".png":
        raise FileError(f"{path}: a picture of a drape is a PNG file; give a name that ends in .png")


def draw(drape: Drape, path: Path) -> None:
    """Draws a drape into a PNG file, whole or not at all. Raises FileError."""
    check(path)
    import pyvista
    from vtkmodules.vtkCommonCore import vtkLogger

    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
    plotter = pyvista.Plotter(off_screen=True, shape=(1, 2), window_size=SIZE, border=False)
    faces = np.column_stack([np.full(len(drape.faces), 3), drape.faces]).ravel()
    cloth = pyvista.PolyData(drape.vertices, faces).compute_normals(consistent_normals=False, split_vertices=False)
    plotter.subplot(0, 0)
    plotter.background_color = "white"
    stand = pyvista.Cylinder(center=(0, 0, -0.003), direction=(0, 0, 1), radius=DISC - 0.003, height=0.004)
    foot = pyvista.Cylinder(center=(0, 0, -0.045), direction=(0, 0, 1), radius=0.012, height=0.085)
    for part in (stand, foot):
        plotter.add_mesh(part, color=STAND)
    plotter.add_mesh(cloth, color=CLOTH, smooth_shading=True, specular=0.1)
    plotter.camera_position = [(0.0, -0.55, 0.22), (0, 0, -0.025), (0, 0, 1)]
    plotter.subplot(0, 1)
    plotter.background_color = "white"
    shadow = drape.vertices * [1, 1, 0]
    plotter.add_mesh(pyvista.PolyData(shadow, faces), color=SHADOW, lighting=False)
    for radius in (DISC, SPECIMEN):
        turn = np.linspace(0, 2 * np.pi, 200)
        ring = np.column_stack([radius * np.cos(turn), radius * np.sin(turn), np.full(200, 0.001)])
        plotter.add_mesh(pyvista.lines_from_points(ring), color="#c0392b", line_width=2)
    plotter.add_text(f"{100 * drape.coefficient:.1f} %, {drape.nodes} nodes", color="black", font_size=12)
    plotter.view_xy()
    plotter.camera.zoom(1.25)
    image = io.BytesIO()
    try:
        plotter.screenshot(image)
    finally:
        plotter.close()
    write(path, image.getvalue())
