/* SPDX-License-Identifier: Apache-2.0 */
/* Scalars of the conjugate gradient method stay on the device, always in double. Dot products are summed over chunks of
   neighbours, then over chunks of these sums: the order is the same on every backend, and zero entries do not change
   it. */
#ifndef CAMA_KERNELS_SOLVER_SCALARS_H
#define CAMA_KERNELS_SOLVER_SCALARS_H
#include "../dialect/lang.h"

#define DOT_CHUNK 256 /* of the union of boxes over a level of a tree */
#define PARTIAL_CHUNK 64

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

/* The same for up to four lists at once, the sums of one behind those of the other, from reduced[at] on. List k:
   count_k numbers of a_k, from first_k on. */
KERNEL reduce_lists(int n, int count0, int count1, int count2, int count3, int first0, int first1, int first2,
                    int first3, GLOBAL const double *a0, GLOBAL const double *a1, GLOBAL const double *a2,
                    GLOBAL const double *a3, int at, GLOBAL double *reduced)
{
  const int count[4] = {count0, count1, count2, count3}, first[4] = {first0, first1, first2, first3};
  FOR_EACH(i, n) {
    int chunk = i, k = 0, j, end;
    GLOBAL const double *a;
    double sum = 0.0;
    for (; k < 3 && chunk >= (count[k] + PARTIAL_CHUNK - 1) / PARTIAL_CHUNK; ++k)
      chunk -= (count[k] + PARTIAL_CHUNK - 1) / PARTIAL_CHUNK;
    a = k == 0 ? a0 : k == 1 ? a1 : k == 2 ? a2 : a3;
    end = first[k] + min_int((chunk + 1) * PARTIAL_CHUNK, count[k]);
    for (j = first[k] + chunk * PARTIAL_CHUNK; j < end; ++j) sum += a[j];
    reduced[at + i] = sum;
  }
}

/* a[c size] = the sum of the `size` numbers from a[c size] on, for each of `columns` columns, by halving, in the same
   order on every backend. size: a power of two. Two halvings have one barrier. */
DEVICE_TEAM void tree_sums(int size, int columns, LOCAL double *a)
{
  int span = size / 2, c, levels = 0;
  while (size >> levels > 1) ++levels;
  TEAM_BARRIER;
  if (levels % 2 == 1) {
    TEAM_FOR(l, span)
      for (c = 0; c < columns; ++c) a[c * size + l] += a[c * size + l + span];
    TEAM_BARRIER;
    span /= 2;
  }
  for (; span > 0; span /= 4) {
    const int quarter = span / 2;
    TEAM_FOR(l, quarter)
      for (c = 0; c < columns; ++c) {
        LOCAL double *own = a + c * size + l;
        *own = *own + own[span] + (own[quarter] + own[quarter + span]);
      }
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
