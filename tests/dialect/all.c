/* SPDX-License-Identifier: Apache-2.0 */
/* Every kernel header as C99 and C++17 (all.cpp includes this); -Dreal=double or -Dreal=float picks the precision. */
#define ADD_OF_double atomic_add_double
#define ADD_OF_float atomic_add_float
#define JOIN(a, b) a##b
#define ADD_OF(type) JOIN(ADD_OF_, type)
#define ATOMIC_ADD_REAL ADD_OF(real)
#include "../../libcama/kernels/dialect/lang.h"
#include "../../libcama/kernels/double.h"
#include "../../libcama/kernels/real.h"
