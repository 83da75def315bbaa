# SPDX-License-Identifier: Apache-2.0
"""Scenes as one compressed file, for machines that have NumPy but not what makes bodies and garments (VTK, SciPy).

Positions are stored in single precision and animations in steps of 2^-17 m, 60 frames a second: both are below what a
contact thickness resolves, and the intersections at the start are counted again after reading.
"""

import json
from pathlib import Path

import numpy as np

import cama
from cama import _core

STEP = 2.0**-17  # m
RATE = 60  # 1/s, as bodies are sampled


def _take_numbers(node, arrays):
    """Replaces long lists of numbers in JSON by the names of arrays, in place."""
    for key, value in node.items() if isinstance(node, dict) else enumerate(node):
        if isinstance(value, list) and len(value) > 60 and isinstance(value[0], (int, float)):
            kind = np.int32 if all(isinstance(v, int) for v in value) else np.float32
            name = f"array{len(arrays)}"
            arrays[name] = np.array(value, kind)
            node[key] = f"@{name}"
        elif isinstance(value, (dict, list)):
            _take_numbers(value, arrays)


def _put_numbers(node, arrays):
    for key, value in node.items() if isinstance(node, dict) else enumerate(node):
        if isinstance(value, str) and value.startswith("@array"):
            node[key] = arrays[value[1:]].tolist()
        elif isinstance(value, (dict, list)):
            _put_numbers(value, arrays)


def write(scene, path):
    """Writes a scene, with what its obstacles do during its frames."""
    scene, arrays = scene.copy(), {}
    duration = scene.frames * scene.seconds_per_frame
    times = np.linspace(0, duration, max(2, round(RATE * duration) + 1))
    for index, obstacle in enumerate(scene.obstacles):
        core = scene._core.obstacle(index)
        if obstacle.motion.is_rigid:
            continue
        positions = np.stack([obstacle.motion.evaluate(time, obstacle.vertices) for time in times])
        whole = np.round(positions / STEP).astype(np.int32)
        whole[1:] -= whole[:-1].copy()
        whole[2:] -= whole[1:-1].copy()
        narrow = np.abs(whole[1:]).max() < 2**15
        arrays[f"first{index}"] = whole[0]
        arrays[f"later{index}"] = whole[1:].astype(np.int16 if narrow else np.int32)
        core.motion = _core.Motion()
    arrays["times"] = times
    text = json.loads(scene.to_json())
    _take_numbers(text, arrays)
    np.savez_compressed(path, scene=np.frombuffer(json.dumps(text).encode(), np.uint8), **arrays)


def read(path):
    """Returns the scene of a file that `write` wrote."""
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}
    text = json.loads(bytes(arrays["scene"]))
    _put_numbers(text, arrays)
    scene = cama.Scene.parse(text, Path(path).parent)
    for name in [name for name in arrays if name.startswith("first")]:
        whole = np.concatenate([arrays[name][None], arrays["later" + name[5:]].astype(np.int32)])
        whole[1:] = np.cumsum(whole[1:], axis=0)
        obstacle, motion = scene._core.obstacle(int(name[5:])), _core.Motion()
        motion.set_samples(arrays["times"], STEP * np.cumsum(whole, axis=0))
        obstacle.motion = motion
    return scene
