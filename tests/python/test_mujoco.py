# SPDX-License-Identifier: Apache-2.0
"""examples/10_mujoco.py: a robot of MuJoCo lifts a towel and feels its weight."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("mujoco", reason="mujoco is not installed")

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "10_mujoco.py"


def test_the_servo_feels_the_weight_of_the_towel():
    done = subprocess.run([sys.executable, str(EXAMPLE)], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0 and "PlausibilityWarning" not in done.stderr, done.stderr
    claims = dict(line.split(": ", 1) for line in done.stdout.splitlines())

    def numbers(name):
        return [float(word) for word in re.findall(r"-?\d+\.\d+", claims[name])]

    weight = 0.24**2 * 0.12 * 9.81  # N: side, density of cotton
    assert numbers("weight of the towel") == [pytest.approx(weight, rel=1e-4)]
    assert numbers("force of the lift servo, mean of the last second") == [pytest.approx(weight, rel=0.02)]
    lowest, fingers = numbers("lowest point of the towel")
    assert fingers == pytest.approx(0.3, abs=0.006)  # the lower one, by half of pad and gap
    assert lowest > 0.02, "it hangs free"
    assert claims["intersections"] == "0"
