#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# fused.sh OBJECT...: no fused multiply-add in a strict build but where the text asks for one (double_double.h, predicates.hpp).
# GCC 12 makes vfmaddsub of products beside sums and differences in spite of -ffp-contract=off. Exit 77: skipped, and said so.
set -eu
command -v objdump > /dev/null || { echo "SKIP: no objdump"; exit 77; }
case "$(uname -m)" in x86_64) ;; *) echo "SKIP: knows the instructions of x86-64 alone"; exit 77 ;; esac
found=$(objdump -d --no-show-raw-insn "$@" | awk '
  /^[^ ]+\.o: +file format/ { object = $1; sub(/.*\//, "", object) }
  /^[0-9a-f]+ <.*>:$/ { name = $2 }
  /[\t ]vf(maddsub|msubadd)[0-9]/ { print object, name, $2; next }
  /[\t ]vfn?m(add|sub)[0-9]/ && object !~ /^(geometry|exact_audit|cpu_backend)\./ { print object, name, $2 }' | sort | uniq -c | head -20)
[ -z "$found" ] && { echo "no fused multiply-add in $# object files"; exit 0; }
echo "fused multiply-add in a strict build; compile the file with -fno-tree-slp-vectorize, or write the products apart:"
echo "$found"
exit 1
