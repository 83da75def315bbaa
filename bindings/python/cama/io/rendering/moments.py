# SPDX-License-Identifier: Apache-2.0
"""The moments of a film's images, and where everything is at a moment."""

import numpy as np

SHORTEST = 4.0  # s of video below which the automatic speed slows down


def speed_text(speed):
    """For people: "real time", "1/4 speed"."""
    if speed == 1:
        return "real time"
    return (
        f"1/{round(1 / speed)} speed"
        if speed < 1 and abs(1 / speed - round(1 / speed)) < 1e-9
        else f"{speed:g} x speed"
    )


def choose_speed(duration, interval, fps):
    """Real time, or the first of 1/2, 1/4, ... that makes the video long enough, while images still differ."""
    speed = 1.0
    while duration / speed < SHORTEST and speed / fps > interval:
        speed /= 2
    return speed


def moments_of(times, fps, speed):
    """The moments of the images of a video, s: equally spaced from the first recorded frame on."""
    count = max(1, int(np.floor((times[-1] - times[0]) / speed * fps + 1e-9)) + 1)
    return times[0] + np.arange(count) * speed / fps


def place_of(times, moment):
    """(index, part): a moment lies this part of the way from recorded frame `index` to the next; 0: on the frame."""
    index = int(np.clip(np.searchsorted(times, moment, side="right") - 1, 0, max(0, len(times) - 2)))
    if len(times) == 1:
        return 0, 0.0
    part = float(np.clip((moment - times[index]) / (times[index + 1] - times[index]), 0, 1))
    return (index, 0.0) if part < 1e-6 else (index + 1, 0.0) if part > 1 - 1e-6 else (index, part)


def positions_at(recording, moment):
    """Positions [vertices, 3] at a moment, m: those of a recorded frame, or on the line between two."""
    index, part = place_of(recording.times, moment)
    if part == 0:
        return recording.frame(index)
    return (1 - part) * recording.frame(index) + part * recording.frame(index + 1)


def sample(moments, count=24):
    """At most `count` of the moments, spread from the first to the last."""
    return np.asarray(moments)[np.unique(np.linspace(0, len(moments) - 1, min(len(moments), count)).astype(int))]
