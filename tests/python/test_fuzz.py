# SPDX-License-Identifier: Apache-2.0
"""Damaged files of every kind end with a result or an error of cama: tests/fuzz/fuzz.py."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = Path(__file__).parents[1] / "fuzz" / "fuzz.py"


def fuzz(*words):
    done = subprocess.run([sys.executable, str(PROGRAM), *map(str, words)], capture_output=True, text=True)
    total = re.search(r"^(\d+) cases of seed \d+ in \d+ s, (\d+) problems$", done.stdout, re.M)
    assert total, done.stdout + done.stderr
    return done.returncode, int(total[1]), done.stdout


def test_a_hundred_damaged_files():
    code, count, said = fuzz("--cases", 100, "--jobs", 1)
    assert code == 0 and count == 100, said


@pytest.mark.long
def test_ten_thousand_damaged_files():
    code, count, said = fuzz("--cases", 10_000)
    assert code == 0 and count == 10_000, said
