#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Installs the build folder given as $1 to a temporary prefix, then builds and runs two projects of users against it: consumer.cpp, whose
# result has a closed form, and examples/05_cpp, whose printed claims are checked here.
set -euo pipefail
build=$1
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
cmake --install "$build" --prefix "$scratch/prefix" --component library >/dev/null

# make FOLDER NAME: configures and builds a project against the prefix.
make() {
  cmake -S "$1" -B "$scratch/$2" -G Ninja -DCMAKE_BUILD_TYPE=Release -DCMAKE_PREFIX_PATH="$scratch/prefix" >/dev/null
  cmake --build "$scratch/$2"
}

make "$here" consumer
"$scratch/consumer/consumer"

make "$here/../../examples/05_cpp" example
"$scratch/example/drop" | tee "$scratch/said"
# A grid of 1 m x 1 m aimed at 500 triangles has 16 x 16 cells of two: 512.
grep -qx "triangles: 512" "$scratch/said"
grep -qx "intersections: 0" "$scratch/said"
