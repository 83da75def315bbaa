/* SPDX-License-Identifier: Apache-2.0 */
/* Scalars of the conjugate gradient method stay on the device, always in double. Dot products are summed over chunks of
   neighbours, then over chunks of these sums: the order is the same on every backend, and zero entries do not change
   it. */
#ifndef CAMA_KERNELS_SOLVER_SCALARS_H
#define CAMA_KERNELS_SOLVER_SCALARS_H
#include "../dialect/lang.h"

#define DOT_CHUNK 256 /* of the union of boxes over a level of a tree */
#define VECTOR_CHUNK 32 /* vectors in a chunk of the linear solve */
#define PARTIAL_CHUNK 64

#define SCALAR_RZ 0 /* r' z of this iteration */
#define SCALAR_PQ 1 /* p' A p */
#define SCALAR_ALPHA 2
#define SCALAR_BETA 3
#define SCALAR_BROKEN 4 /* 1: p' A p <= 0 or not finite */
#define SCALAR_COUNT 8

/* reduced[i] = sum over the i-th PARTIAL_CHUNK of `count` partials. */
KERNEL reduce_partials(int n, int count, GLOBAL const double *partial, GLOBAL double *reduced)
{
  FOR_EACH(i, n) {
    int j, end = min_int((i + 1) * PARTIAL_CHUNK, count);
    double sum = 0.0;
    for (j = i * PARTIAL_CHUNK; j < end; ++j) sum += partial[j];
    reduced[i] = sum;
  }
}

/* scalar[SCALAR_PQ] = sum of partials; alpha = rz / pq, or 0 with SCALAR_BROKEN set. One work item. */
KERNEL finish_alpha(int n, int chunks, GLOBAL const double *partial, GLOBAL double *scalar)
{
  FOR_EACH(i, n) {
    double sum = 0.0;
    int j;
    for (j = 0; j < chunks; ++j) sum += partial[j];
    scalar[SCALAR_PQ] = sum;
    if (sum > 0.0) {
      scalar[SCALAR_ALPHA] = scalar[SCALAR_RZ] / sum;
    } else {
      scalar[SCALAR_ALPHA] = 0.0;
      if (scalar[SCALAR_RZ] != 0.0) scalar[SCALAR_BROKEN] = 1.0;
    }
  }
}

/* beta = rz_new / rz, rz = rz_new (start: only rz). One work item. */
KERNEL finish_beta(int n, int chunks, int start, GLOBAL const double *partial, GLOBAL double *scalar)
{
  FOR_EACH(i, n) {
    double sum = 0.0;
    int j;
    for (j = 0; j < chunks; ++j) sum += partial[j];
    scalar[SCALAR_BETA] = !start && scalar[SCALAR_RZ] > 0.0 ? sum / scalar[SCALAR_RZ] : 0.0;
    scalar[SCALAR_RZ] = sum;
    if (!(sum >= 0.0)) scalar[SCALAR_BROKEN] = 1.0;
    if (start) scalar[SCALAR_BROKEN] = 0.0;
  }
}

/* a[c size] = the sum of the `size` numbers from a[c size] on, for each of `columns` columns, by halving, in the same
   order on every backend. size: a power of two. */
DEVICE_TEAM void tree_sums(int size, int columns, LOCAL double *a)
{
  int span, c;
  TEAM_BARRIER;
  for (span = size / 2; span > 0; span /= 2) {
    TEAM_FOR(l, span)
      for (c = 0; c < columns; ++c) a[c * size + l] += a[c * size + l + span];
    TEAM_BARRIER;
  }
}

/* The same for the sums of teams, partial[columns k + c]; every team of `size` members computes it for itself. */
DEVICE_TEAM void sum_of_teams(int size, int columns, int teams, GLOBAL const double *partial, LOCAL double *a)
{
  TEAM_FOR(l, size) {
    int k, c;
    for (c = 0; c < columns; ++c) {
      double sum = 0.0; /* in a register, so that loads do not wait for each other */
      for (k = l; k < teams; k += size) sum += partial[columns * k + c];
      a[c * size + l] = sum;
    }
  }
  tree_sums(size, columns, a);
}

#endif
