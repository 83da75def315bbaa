# SPDX-License-Identifier: Apache-2.0
"""Pictures of a run: moments side by side, drawn by cama's own renderer."""

import numpy as np

from ..io import render
from ..io.recording import Part

SIZE = (640, 480)


class Moments:
    """The kept moments of a run, as `cama.io.render.Stage` reads a recording."""

    def __init__(self, run, hide=()):
        s = run.simulation
        self.times = [0.0] + [t for t, _ in run.kept] + [s.time]
        self._positions = [run.start] + [p for _, p in run.kept] + [run.positions]
        self.cloths = [Part(c.name, slice(*r), c.faces) for c, r in zip(run.scene.cloths, s.cloth_ranges)]
        self.obstacles = [
            Part(o.name, slice(*r), o.faces)
            for o, r in zip(run.scene.obstacles, s.obstacle_ranges)
            if o.name not in hide
        ]

    def __len__(self):
        return len(self.times)

    def frame(self, index):
        """[vertices, 3] m."""
        return self._positions[index]


def strip(run, path, count=4, azimuth=-60.0, elevation=22.0, hide=()):
    """Writes a PNG of `count` moments from start to end, side by side. hide: names of obstacles left out."""
    render.needs()
    import imageio.v2 as imageio

    moments = Moments(run, hide)
    shown = np.array(moments.times)[np.unique(np.linspace(0, len(moments) - 1, count).round().astype(int))]
    stage = render.Stage(moments, shown, render.Look(size=SIZE, azimuth=azimuth, elevation=elevation))
    images = [stage.draw(time, f"{run.scene.name}  {time:.3f} s") for time in shown]
    stage.close()
    imageio.imwrite(path, np.concatenate(images, axis=1))
