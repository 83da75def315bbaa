/* SPDX-License-Identifier: Apache-2.0 */
/* The working precision `real` and its atomic addition. Whoever compiles the kernels of one precision defines both
   before real.h; a header that is compiled alone is compiled in double. */
#ifndef ATOMIC_ADD_REAL
#define ATOMIC_ADD_REAL atomic_add_double
typedef double real;
#endif
