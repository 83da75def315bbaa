# SPDX-License-Identifier: Apache-2.0
"""A user of a wheel, started by script/wheel: python installed_wheel.py [LIBRARY...], in the wheel's environment.

Each LIBRARY, such as libOpenCL.so.1, must be absent here. Ends with 1 and the reason where something does not hold.
"""

import ctypes
import hashlib  # noqa: F401  (loads a library of the system, which is Python's and not the wheel's)
import re
import shutil
import sys
import tempfile
from pathlib import Path

# What every Linux system of the wheel's tag has: the C and C++ libraries, and zlib, which Python itself needs.
OF_THE_SYSTEM = {"libc", "libm", "libdl", "librt", "libpthread", "libutil", "libstdc++", "libgcc_s", "libz"}
GRAVITY = 9.81  # m/s^2


def loaded():
    """Paths of the shared libraries in this process."""
    return {Path(path) for path in re.findall(r"(/\S+\.so[\d.]*)$", Path("/proc/self/maps").read_text(), re.M)}


def is_absent(library):
    try:
        ctypes.CDLL(library)
    except OSError:
        return True
    return False


for library in sys.argv[1:]:
    assert is_absent(library), f"{library} is here: it was to be hidden"
for compiler in ("cc", "gcc", "g++", "c++", "clang", "nvcc", "cmake"):
    assert shutil.which(compiler) is None, f"{compiler} is here: it was to be hidden"
before = loaded()

import cama  # noqa: E402

ROOT = Path(cama.__file__).parent
assert Path(sys.prefix) in ROOT.parents, f"cama is not that of the wheel: {ROOT}"

backends = {backend["name"]: backend for backend in cama.backends()}
assert backends["cpu"]["available"]
if "libOpenCL.so.1" in sys.argv:
    assert backends["opencl"]["note"].startswith("OpenCL loader not found: install "), backends["opencl"]
for name, backend in backends.items():
    print(f"{name}: {', '.join(backend['devices']) or backend['note']}")

# One triangle in free fall: BDF2 after one step of backward Euler falls 3/4 g dt^2 (1 - 3^-n) more than g (n dt)^2 / 2.
scene = cama.Scene(thickness=1e-3, time_step=1 / 200)
scene.add_cloth([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], material="cotton")
simulation = cama.Simulation(scene, backend="cpu")
simulation.step(10)
exact = -GRAVITY / 200**2 * (10**2 / 2 + 0.75 * (1 - 3.0**-10))
z = float(simulation.positions[0, 2])
assert abs(z - exact) < 1e-12, f"a free fall ends at {z}, not at {exact}"
print(f"free fall: {z:.12f} m, exact {exact:.12f} m")

# A format that assimp reads: the reader is in the wheel.
with tempfile.TemporaryDirectory() as folder:
    file = Path(folder) / "triangle.stl"
    file.write_text(
        "solid t\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 2 0 0\nvertex 0 3 0\nendloop\nendfacet\n"
        "endsolid t\n"
    )
    scene = cama.Scene(thickness=1e-3)
    scene.add_cloth(file, material="cotton")
    positions = cama.Simulation(scene, backend="cpu").positions
assert sorted(map(tuple, positions.tolist())) == [(0, 0, 0), (0, 3, 0), (2, 0, 0)], positions
print("STL: read")

foreign = sorted(
    str(path)
    for path in loaded() - before
    if Path(sys.prefix) not in path.parents
    and Path(sys.base_prefix) not in path.parents
    and path.name.split(".so")[0] not in OF_THE_SYSTEM
)
assert not foreign, f"libraries from outside the wheel and its environment: {foreign}"
print(
    f"libraries: {len(loaded() - before)} more than Python's own, none from outside the environment but the C library's"
)
