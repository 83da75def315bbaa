# SPDX-License-Identifier: Apache-2.0
"""Where the camera stands."""

import numpy as np

VIEW_ANGLE = 30.0  # vertical, degrees
MARGIN = 1.12  # of the half picture that the points fill, the rest is margin


def directions(azimuth, elevation):
    """Unit vectors from the focal point: back to the camera, to the right and up in the picture; angles in degrees."""
    a, e = np.radians([azimuth, elevation])
    back = np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)])
    right = np.array([-np.sin(a), np.cos(a), 0.0])
    return back, right, np.cross(back, right)


def frame_camera(points, azimuth, elevation, aspect, target=None, distance=None):
    """Position, focal point and up vector of a camera that sees all points [n, 3], m.

    target: a focal point in place of the middle of what is seen. distance: from the focal point in place of the
    shortest from which all points are in the picture, m.
    """
    back, right, up = directions(azimuth, elevation)
    x, y, z = points @ right, points @ up, points @ back
    tangent = np.tan(np.radians(VIEW_ANGLE / 2)) / MARGIN
    if target is None:
        target = right * (x.min() + x.max()) / 2 + up * (y.min() + y.max()) / 2 + back * (z.min() + z.max()) / 2
    target = np.asarray(target, float)
    if distance is None:
        x, y, z = x - target @ right, y - target @ up, z - target @ back
        distance = max((np.abs(x) / (tangent * aspect) + z).max(), (np.abs(y) / tangent + z).max(), 1e-3)
    return target + back * distance, target, up


class Orbit:
    """A camera that stands, or that turns about what it sees at a constant rate.

    Args:
        points: What it sees in the whole film, [n, 3] m.
        look: The Look with the angles, target, distance and turntable.
    """

    def __init__(self, points, look):
        self._points, self._look = points, look
        self._aspect = look.size[0] / look.size[1]
        self._target, self._distance = look.target, look.distance
        if look.turntable:
            if self._target is None:
                self._target = (points.min(axis=0) + points.max(axis=0)) / 2
            if self._distance is None:
                views = (self._place(turn) for turn in range(0, 360, 15))
                self._distance = max(np.linalg.norm(eye - focus) for eye, focus, _ in views)

    def _place(self, turn):
        azimuth, elevation = self._look.azimuth + turn, self._look.elevation
        return frame_camera(self._points, azimuth, elevation, self._aspect, self._target, self._distance)

    def at(self, seconds):
        """Position, focal point and up vector at a time of the film, s."""
        return self._place(self._look.turntable * seconds)
