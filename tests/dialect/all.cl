/* SPDX-License-Identifier: Apache-2.0 */
/* Every kernel header as OpenCL C 1.2. */
#include "all.c"
