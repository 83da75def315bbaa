// SPDX-License-Identifier: Apache-2.0
// Every kernel header as CUDA C++17.
#include "all.c"
