/* SPDX-License-Identifier: Apache-2.0 */
/* Vertex-to-element lists in CSR form, by count, scan, fill; each row sorted, so that sums over it have the same order
   everywhere. An entry is 4 * element + local index of the vertex in the element. Only vertices below `vertex_count`
   have rows. */
#ifndef CAMA_KERNELS_SYSTEM_INCIDENCE_H
#define CAMA_KERNELS_SYSTEM_INCIDENCE_H
#include "../dialect/lang.h"

typedef struct {
  int node[4];
} element_nodes; /* -1: unused */

KERNEL count_incidence(int n, GLOBAL const element_nodes *nodes, int vertex_count, GLOBAL int *count)
{
  FOR_EACH(i, n) {
    int a;
    for (a = 0; a < 4; ++a)
      if (nodes[i].node[a] >= 0 && nodes[i].node[a] < vertex_count) atomic_add_int(&count[nodes[i].node[a]], 1);
  }
}

/* left: the numbers of count_incidence; zero at the end. */
KERNEL fill_incidence(int n, GLOBAL const element_nodes *nodes, int vertex_count, GLOBAL const int *row,
                      GLOBAL int *left, GLOBAL int *incidence)
{
  FOR_EACH(i, n) {
    int a;
    for (a = 0; a < 4; ++a) {
      int v = nodes[i].node[a];
      if (v >= 0 && v < vertex_count) incidence[row[v] + atomic_add_int(&left[v], -1) - 1] = 4 * i + a;
    }
  }
}

DEVICE void sift_down(GLOBAL int *value, int root, int n)
{
  for (;;) {
    int child = 2 * root + 1, kept;
    if (child >= n) return;
    if (child + 1 < n && value[child + 1] > value[child]) ++child;
    if (value[root] >= value[child]) return;
    kept = value[root];
    value[root] = value[child];
    value[child] = kept;
    root = child;
  }
}

/* Ascending, in place: insertion for short runs, heap sort beyond, so that long rows take O(n log n). */
DEVICE void sort_ints(GLOBAL int *value, int n)
{
  int i;
  if (n <= 24) {
    for (i = 1; i < n; ++i) {
      int kept = value[i], j = i;
      for (; j > 0 && value[j - 1] > kept; --j) value[j] = value[j - 1];
      value[j] = kept;
    }
    return;
  }
  for (i = n / 2 - 1; i >= 0; --i) sift_down(value, i, n);
  for (i = n - 1; i > 0; --i) {
    int kept = value[0];
    value[0] = value[i];
    value[i] = kept;
    sift_down(value, 0, i);
  }
}

/* Keys by which entries are sorted into rows, where that is faster; unused nodes come last. */
KERNEL incidence_keys(int n, GLOBAL const element_nodes *nodes, int vertex_count, GLOBAL key64 *key,
                      GLOBAL int *incidence)
{
  FOR_EACH(i, n) {
    int a;
    for (a = 0; a < 4; ++a) {
      int v = nodes[i].node[a];
      key[4 * i + a] = (key64)(v >= 0 && v < vertex_count ? v : vertex_count);
      incidence[4 * i + a] = 4 * i + a;
    }
  }
}

/* row[i] = first of `count` sorted keys that is at least i. n: rows + 1. */
KERNEL incidence_rows(int n, int count, GLOBAL const key64 *key, GLOBAL int *row)
{
  FOR_EACH(i, n) {
    int lo = 0, hi = count;
    while (lo < hi) {
      int middle = lo + (hi - lo) / 2;
      if (key[middle] < (key64)i)
        lo = middle + 1;
      else
        hi = middle;
    }
    row[i] = lo;
  }
}

/* sorted: the entries of every row, ascending, from those of fill_incidence, each of which counts the smaller ones of
   its row. Faster than sort_rows where a work-item is slow and there are many of them. n: 4 times the elements. */
KERNEL rank_incidence(int n, GLOBAL const element_nodes *nodes, int vertex_count, GLOBAL const int *row,
                      GLOBAL const int *incidence, GLOBAL int *sorted)
{
  FOR_EACH(i, n) {
    const int v = nodes[i >> 2].node[i & 3], present = v >= 0 && v < vertex_count, begin = present ? row[v] : 0,
              end = present ? row[v + 1] : 0;
    int k, rank = 0;
    for (k = begin; k < end; k += AT_ONCE(8)) {
      int other[AT_ONCE(8)];
      FOR_AT_ONCE(q, 8, end - k) other[q] = incidence[k + q];
      FOR_AT_ONCE(q, 8, end - k) rank += other[q] < i;
    }
    if (present) sorted[begin + rank] = i;
  }
}

KERNEL sort_rows(int n, GLOBAL const int *row, GLOBAL int *value)
{
  FOR_EACH_UNEVEN(i, n) {
    sort_ints(value + row[i], row[i + 1] - row[i]);
  }
}

/* out[first .. first + n) = value */
KERNEL set_int(int n, int first, int value, GLOBAL int *out)
{
  FOR_EACH(i, n) {
    out[first + i] = value;
  }
}

#endif
