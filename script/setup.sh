# SPDX-License-Identifier: Apache-2.0
# What script/demo and script/test share: phases with times, system packages, .venv, build. Sourced, not run.

cd "$(dirname "${BASH_SOURCE[0]}")/.."
JOBS=${CAMA_JOBS:-$(nproc)}
PYTHON=$PWD/.venv/bin/python

SYSTEM_PACKAGES=(
  ca-certificates cmake ninja-build g++ git ccache
  libassimp-dev libfcl-dev libccd-dev nlohmann-json3-dev catch2 libeigen3-dev
  python3 python3-venv python3-dev
  libgl1 libegl1 libgl1-mesa-dri
  ocl-icd-opencl-dev opencl-headers pocl-opencl-icd)
PYTHON_PACKAGES=(
  "scikit-build-core>=0.10" "pybind11>=2.12" "numpy>=1.22" "h5py>=3.6" "typer>=0.12" "rich>=13"
  "pyvista>=0.43" "imageio>=2.30" "imageio-ffmpeg>=0.4")
TEST_PACKAGES=("matplotlib>=3.6" "pytest>=7" "jsonschema>=4" "ipctk>=1.3" "scipy>=1.8" "trimesh>=4"
  "mypy>=1.11" "typing_extensions>=4.5" "ruff==0.17.6" "clang-format==19.1.7")

# phase NAME COMMAND...: runs it and says how long it took.
phase() {
  local name=$1 start=$SECONDS
  shift
  echo "== $name"
  "$@"
  echo "== $name: $((SECONDS - start)) s"
}

as_root() {
  if [ "$(id -u)" -eq 0 ]; then "$@"; else sudo "$@"; fi
}

system_packages() {
  local missing=() package
  for package in "${SYSTEM_PACKAGES[@]}"; do
    dpkg-query -W -f '${Status}' "$package" 2>/dev/null | grep -q 'ok installed' || missing+=("$package")
  done
  if [ ${#missing[@]} -gt 0 ]; then
    echo "installing ${missing[*]}"
    as_root apt-get update -q
    as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends "${missing[@]}"
  fi
}

# python_packages NAME...: what .venv lacks; the network is asked only then.
python_packages() {
  [ -x "$PYTHON" ] || python3 -m venv .venv
  local missing
  missing=$("$PYTHON" - "$@" <<'CHECK'
import importlib.metadata, re, sys
def number(text):
    return [int(part) for part in re.findall(r"\d+", text)[:3]]
for wanted in sys.argv[1:]:
    name, relation, version = re.fullmatch("(.+)([>=]=)(.+)", wanted).groups()
    try:
        there = number(importlib.metadata.version(name))
        present = there == number(version) if relation == "==" else there >= number(version)
    except importlib.metadata.PackageNotFoundError:
        present = False
    if not present:
        print(wanted)
CHECK
)
  if [ -n "$missing" ]; then
    # shellcheck disable=SC2086
    "$PYTHON" -m pip install -q --disable-pip-version-check $missing
  fi
}

# configure ON|OFF [OPTION...]: with or without the C++ tests. One build folder serves the library, the tests and the package.
configure() {
  # Without a card, the code of one architecture shows that the CUDA backend compiles; the driver makes others of it.
  nvidia-smi -L > /dev/null 2>&1 || set -- "$@" -DCMAKE_CUDA_ARCHITECTURES=75-virtual
  cmake -S . -B build -G Ninja -DCMAKE_BUILD_TYPE=Release -DCAMA_BUILD_TESTS="$1" "${@:2}" -DCAMA_BUILD_PYTHON=ON \
    -DPython_EXECUTABLE="$PYTHON" -Dpybind11_DIR="$("$PYTHON" -m pybind11 --cmakedir)" --log-level=WARNING >/dev/null
  TESTS=$1
}

build() {
  cmake --build build -j "$JOBS"
}

# Installs what `build` made: the same folder and options, so nothing is compiled again.
install_package() {
  "$PYTHON" -m pip install -q --disable-pip-version-check --no-build-isolation --no-deps --force-reinstall \
    --config-settings=build-dir=build --config-settings=cmake.define.CAMA_BUILD_TESTS="$TESTS" \
    --config-settings=cmake.define.CAMA_NATIVE=ON .
}
