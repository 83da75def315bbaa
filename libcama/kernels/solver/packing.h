/* SPDX-License-Identifier: Apache-2.0 */
/* What the conjugate gradient works on, in its precision and its order of rows: inverses of diagonal blocks, terms and
   their weights, and the values of the sliced matrix. */
#ifndef CAMA_KERNELS_SOLVER_PACKING_H
#define CAMA_KERNELS_SOLVER_PACKING_H
#include "../dialect/lang.h"
#include "../dialect/vec3.h"
#include "../system/incidence.h"
#include "../system/slices.h"
#include "../system/term.h"

/* The inverses of diagonal blocks as P of the rows: their diagonals (block_rows = 1), or whole; stored in columns. */
KERNEL pack_diagonal(int n, GLOBAL const int *order, int component_stride, int block_rows, int is_double,
                     GLOBAL const double *from64, GLOBAL const float *from32, GLOBAL real *inverse)
{
  FOR_EACH(i, n) {
    int k, at = 9 * order[i];
    for (k = 0; k < 3 * block_rows; ++k) {
      int number = at + (block_rows == 1 ? 4 * k : k);
      inverse[k * (size_t)component_stride + i] = is_double ? (real)from64[number] : (real)from32[number];
    }
  }
}

/* Terms on rows: nodes as rows (-1: not free), and 4 weights, normal, along and around, in double or single. */
KERNEL pack_terms(int n, GLOBAL const term *terms, int vertices, GLOBAL const int *place, int is_double,
                  GLOBAL element_nodes *nodes, GLOBAL double *to64, GLOBAL float *to32)
{
  FOR_EACH(i, n) {
    real x[9];
    int c;
    for (c = 0; c < 4; ++c) {
      int v = terms[i].node[c];
      nodes[i].node[c] = v >= 0 && v < vertices ? place[v] : -1;
      x[c] = terms[i].weight[c];
    }
    x[4] = terms[i].normal.x;
    x[5] = terms[i].normal.y;
    x[6] = terms[i].normal.z;
    x[7] = terms[i].along;
    x[8] = terms[i].around;
    for (c = 0; c < 9; ++c)
      if (is_double)
        to64[9 * i + c] = (double)x[c];
      else
        to32[9 * i + c] = (float)x[c];
  }
}

/* The weight of each entry of the terms' incidence lists. n: vertices. */
KERNEL pack_weights(int n, GLOBAL const int *row, GLOBAL const int *entry, GLOBAL const real *coefficient,
                    GLOBAL real *weight)
{
  FOR_EACH(i, n) {
    const int end = row[i + 1];
    int k;
    for (k = row[i]; k < end; k += AT_ONCE(8)) {
      int at[AT_ONCE(8)];
      real own[AT_ONCE(8)];
      FOR_AT_ONCE(q, 8, end - k) at[q] = entry[k + q];
      FOR_AT_ONCE(q, 8, end - k) own[q] = coefficient[9 * (at[q] >> 2) + (at[q] & 3)];
      FOR_AT_ONCE(q, 8, end - k) weight[k + q] = own[q];
    }
  }
}

/* Blocks into slices: number c of entry e of lane l is at SLICE_ROWS (9 e + c) + l. n: entries of all lanes. */
KERNEL fill_slice_values(int n, GLOBAL const int *source, int is_double, GLOBAL const double *from64,
                         GLOBAL const float *from32, GLOBAL real *value)
{
  FOR_EACH(i, n) {
    const int e = i / SLICE_ROWS, l = i - e * SLICE_ROWS, own = source[i];
    real v[9];
    int c;
    for (c = 0; c < 9; ++c) {
      v[c] = (real)0;
      if (own >= 0) v[c] = is_double ? (real)from64[9 * own + c] : (real)from32[9 * own + c];
    }
    for (c = 0; c < 9; ++c) value[SLICE_ROWS * (9 * e + c) + l] = v[c];
  }
}

#endif
