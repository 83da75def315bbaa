# SPDX-License-Identifier: Apache-2.0
"""Values of the whole scene: times, gravity, wind."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from .finding import Finding, number
from .objects import SPEED

if TYPE_CHECKING:
    from ..scene import Scene

TIME_STEP = 0.1  # s
FRAME_TIME = 10.0  # s
GRAVITY = 50.0  # m/s^2
AIR = 50.0  # kg/m^3


def of_scene(scene: Scene, time_step: float) -> Iterator[Finding]:
    """Looks at the values of a scene that is computed in this time step, s."""
    if time_step > TIME_STEP:
        yield Finding(
            "time step",
            "the scene",
            "time_step",
            f"{number(time_step)} s",
            "cloth is computed in steps of 0.0001 to 0.02 s; leave it out, and the accuracy level chooses it",
        )
    if scene.seconds_per_frame > FRAME_TIME:
        yield Finding(
            "frame time",
            "the scene",
            "frame_time",
            f"{number(scene.seconds_per_frame)} s",
            "it is the time between two recorded frames in seconds, for example 1/60",
        )
    gravity = math.hypot(*scene.gravity)
    if gravity > GRAVITY:
        yield Finding(
            "gravity",
            "the scene",
            "gravity",
            f"{number(gravity)} m/s^2",
            "on Earth it is 9.81 m/s^2; lengths are metres",
        )
    wind = scene.wind
    if wind is not None:
        if math.hypot(*wind["velocity"]) > SPEED:
            yield Finding(
                "wind",
                "the scene",
                "wind.velocity",
                f"{number(math.hypot(*wind['velocity']))} m/s",
                "a hurricane has 50 m/s; give metres per second",
            )
        if wind["density"] > AIR:
            yield Finding(
                "air",
                "the scene",
                "wind.density",
                f"{number(wind['density'])} kg/m^3",
                "air has 1.2 kg/m^3; give kilograms per cubic metre",
            )
