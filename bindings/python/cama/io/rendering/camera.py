# SPDX-License-Identifier: Apache-2.0
"""Where the camera stands."""

import numpy as np

VIEW_ANGLE = 30.0  # vertical, degrees
MARGIN = 1.12  # of the half picture that the points fill, the rest is margin
STEADY = 0.05  # standard deviation of the Gaussian that smooths the way of a camera that follows, of the film's length


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


class Way:
    """The way of a camera that follows: that of a point, without what is quick in it.

    Args:
        moments: Of the images, equally spaced, s.
        points: Where the point is at them, [images, 3] m.
    """

    def __init__(self, moments, points):
        self._moments = np.asarray(moments)
        reach = min(round(3 * STEADY * len(points)), len(points) - 1)
        before = 2 * points[0] - points[reach:0:-1]  # mirrored, so that both ends stay
        after = 2 * points[-1] - points[-2 : -2 - reach : -1]
        bell = np.exp(-0.5 * (np.arange(-reach, reach + 1) / max(STEADY * len(points), 1e-9)) ** 2)
        padded = np.concatenate([before, points, after])
        self._shifts = np.stack([np.convolve(line, bell / bell.sum(), "valid") for line in padded.T], axis=1)
        self._shifts -= self._shifts[0]

    def at(self, moment):
        """How far it has come since the first moment, [3] m."""
        return np.array([np.interp(moment, self._moments, line) for line in self._shifts.T])


class Orbit:
    """A camera that stands, or that turns about what it sees at a constant rate, or that follows it.

    Args:
        points: What it sees in the whole film, [n, 3] m; seen from a camera that follows.
        look: The Look with the angles, target, distance and turntable.
        way: The Way of a camera that follows; None: it does not.
    """

    def __init__(self, points, look, way=None):
        self._points, self._look, self._way = points, look, way
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

    def at(self, seconds, moment):
        """Position, focal point and up vector at a time of the film, s, that shows this moment, s."""
        eye, focus, up = self._place(self._look.turntable * seconds)
        shift = self._way.at(moment) if self._way else 0.0
        return eye + shift, focus + shift, up
