# SPDX-License-Identifier: Apache-2.0
# What script/demo and script/test share: phases with times, system packages, .venv, build. Sourced, not run.

cd "$(dirname "${BASH_SOURCE[0]}")/.."
JOBS=${CAMA_JOBS:-$(nproc)}
PYTHON=$PWD/.venv/bin/python

SYSTEM_PACKAGES=(
  ca-certificates cmake ninja-build g++ git ccache
  libassimp-dev nlohmann-json3-dev libeigen3-dev
  python3 python3-venv python3-dev
  libgl1 libegl1 libgl1-mesa-dri
  opencl-c-headers ocl-icd-libopencl1 pocl-opencl-icd)
TEST_SYSTEM_PACKAGES=(catch2 libfcl-dev libccd-dev ocl-icd-opencl-dev)
LONG_TEST_SYSTEM_PACKAGES=(chromium)
PYTHON_LISTS=(requires dependencies render view export tradeoff)   # of pyproject.toml: to build, to run, and what all commands need

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

# requirements LIST...: the packages in lists of pyproject.toml, such as `dependencies` or the extra `test`, one a line.
requirements() {
  python3 - "$@" <<'READ'
import re, sys
text = open("pyproject.toml", encoding="utf-8").read()
for name in sys.argv[1:]:
    found = re.search(rf"^{name} = \[(.*?)\]", text, re.M | re.S)
    print(*re.findall(r'"([^"]+)"', found[1] if found else sys.exit(f"pyproject.toml has no list {name}")), sep="\n")
READ
}

# python_packages LIST...: what .venv lacks of these lists of pyproject.toml; the network is asked only then.
python_packages() {
  [ -x "$PYTHON" ] || python3 -m venv .venv
  local wanted missing
  wanted=$(requirements "$@")
  mapfile -t wanted <<< "$wanted"
  missing=$("$PYTHON" - "${wanted[@]}" <<'CHECK'
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
