/* SPDX-License-Identifier: Apache-2.0 */
/* The working precision `real` and its atomic addition. A file that compiles the kernels of one precision defines both
   before it includes real.h; a header that is compiled alone is compiled in double. */
#ifndef ATOMIC_ADD_REAL
#define ATOMIC_ADD_REAL atomic_add_double
typedef double real;
#endif
