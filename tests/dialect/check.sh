#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# check.sh c99 | cxx17 | opencl | cuda: all kernel headers in one language. check.sh alone: each header by itself.
# check.sh table: kernels.def against the headers. check.sh waits: kernels wait before they read. Exit code 77: skipped,
# with the reason.
set -eu
cd "$(dirname "$0")"
kernels=${CAMA_KERNELS:-../../libcama/kernels}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

skip() { echo "SKIP: $1"; exit 77; }

both() { for real in double float; do echo "$* -Dreal=$real"; "$@" -Dreal=$real; done; }

# Names in kernels.def must be exactly the KERNEL functions, in the list that the header belongs to.
table() {
  for list in double:DOUBLE real:REAL; do
    headers=$(sed -n 's/^#include "\(.*\)"/\1/p' "$1/${list%:*}.h")
    (cd "$1" && cat $headers) | sed -E '/^KERNEL_OF\([^)]*\)$/{N;s/\n/ /;}' |
      sed -nE 's/^KERNEL(_OF\([^)]*\))?  *([a-z_0-9]*).*/\2/p' | sort > "$work/headers"
    sed -n "s/^CAMA_${list#*:}_KERNEL(\([a-z_0-9]*\)).*/\1/p" "$1/kernels.def" | sort > "$work/listed"
    diff "$work/headers" "$work/listed" > "$work/diff" || { echo "$1: headers (<) and kernels.def (>) differ:"; cat "$work/diff"; return 1; }
    echo "$1: $(wc -l < "$work/listed") kernels of ${list%:*}.h"
  done
}

case "$1" in
c99) both "${CC:-gcc}" -std=c99 -Wall -Werror -fsyntax-only all.c ;;
cxx17) both "${CXX:-g++}" -std=c++17 -Wall -Wextra -Werror -fsyntax-only all.cpp ;;
opencl)
  if command -v clang > /dev/null; then
    for device in "spir64" "x86_64 -DCAMA_CHUNKED=1"; do
      both clang -x cl -cl-std=CL1.2 -target $device -Xclang -finclude-default-header -Wall -Werror -fsyntax-only all.cl
    done
  elif "${CC:-gcc}" -o "$work/build_program" build_program.c -lOpenCL 2> /dev/null; then
    for real in double float; do
      "${CC:-gcc}" -E -P -x c -undef -D__OPENCL_C_VERSION__=120 -Dreal=$real all.cl > "$work/all.cl"
      "$work/build_program" "$work/all.cl"
    done
  else
    skip "neither clang nor an OpenCL library to compile OpenCL C with"
  fi ;;
alone)
  # stands_alone HEADER: it includes what it uses, in C and in C++.
  stands_alone() {
    "${CC:-gcc}" -std=c99 -x c -Wall -Werror -Wno-unused-function -fsyntax-only "$1" &&
      "${CXX:-g++}" -std=c++17 -x c++ -Wall -Werror -Wno-unused-function -fsyntax-only "$1"
  }
  for header in "$kernels"/*/*.h; do stands_alone "$header"; done
  # The check itself is seen to fail: a header without its includes.
  mkdir "$work/collision"
  grep -v '^#include' "$kernels/collision/commit.h" > "$work/collision/commit.h"
  if stands_alone "$work/collision/commit.h" 2> "$work/said"; then echo "a header without its includes was not noticed"; exit 1; fi
  echo "$(ls "$kernels"/*/*.h | wc -l) headers stand alone; one without its includes was noticed" ;;
cuda)
  nvcc=$(command -v nvcc || ls /usr/local/cuda/bin/nvcc 2> /dev/null || true)
  [ -n "$nvcc" ] || skip "no nvcc"
  both "$nvcc" -std=c++17 -x cu -c -arch="${CAMA_CUDA_ARCH:-sm_90}" --fmad=false -o "$work/all.o" all.cu ;;
table)
  table "$kernels"
  # The check itself is seen to fail: one kernel more in the headers, one more in the list, one in the wrong list.
  for edit in 's/^CAMA_REAL_KERNEL(bcsr_multiply)//' '$a CAMA_DOUBLE_KERNEL(no_such_kernel)' 's/REAL_KERNEL(add_wind)/DOUBLE_KERNEL(add_wind)/'; do
    rm -rf "$work/edited"
    cp -r "$kernels" "$work/edited"
    sed -i "$edit" "$work/edited/kernels.def"
    if cmp -s "$kernels/kernels.def" "$work/edited/kernels.def"; then echo "the edit $edit changed nothing"; exit 1; fi
    if table "$work/edited" > "$work/said"; then echo "not noticed: $edit"; exit 1; fi
    grep -qE 'bcsr_multiply|no_such_kernel|add_wind' "$work/said"
  done
  echo "a missing, an extra and a misplaced kernel were each noticed" ;;
waits)
  command -v python3 > /dev/null || skip "no python3"
  python3 waits.py "$kernels" ;;
*) echo "usage: $0 c99|cxx17|opencl|cuda|alone|table|waits"; exit 2 ;;
esac
