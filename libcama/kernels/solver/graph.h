/* SPDX-License-Identifier: Apache-2.0 */
/* Strength-of-connection graphs and their coarsening by handshake matching, which makes the aggregates of the Schwarz
   preconditioner (factors.h, schwarz.h). An entry is directed; its key is row << 31 | column. Unused entries have a row
   behind all nodes. */
#ifndef CAMA_KERNELS_SOLVER_GRAPH_H
#define CAMA_KERNELS_SOLVER_GRAPH_H
#include "../dialect/lang.h"
#include "../system/incidence.h"

/* head[i] = 1 at the first of equal sorted keys. */
KERNEL key_heads(int n, GLOBAL const key64 *key, int nodes, GLOBAL int *head)
{
  FOR_EACH(i, n) {
    head[i] = (key[i] >> 31) < (key64)nodes && (i == 0 || key[i] != key[i - 1]);
  }
}

/* Equal keys become one entry with the sum of their weights. entry: unsorted places. */
KERNEL merge_entries(int n, GLOBAL const key64 *key, GLOBAL const int *entry, GLOBAL const int *place,
                     GLOBAL const float *weight, GLOBAL key64 *merged_key, GLOBAL int *column,
                     GLOBAL float *merged_weight)
{
  FOR_EACH(i, n) {
    int at = place[i], k = i;
    float sum = 0.0f;
    if (place[i + 1] == at) continue;
    for (; k < n && key[k] == key[i]; ++k) sum += weight[entry[k]];
    merged_key[at] = key[i];
    column[at] = (int)(key[i] & 0x7fffffff);
    merged_weight[at] = sum;
  }
}

/* start[i] = first of `count` sorted keys whose row is at least i. n: rows + 1. */
KERNEL row_starts(int n, int count, GLOBAL const key64 *key, GLOBAL int *start)
{
  FOR_EACH(i, n) {
    int lo = 0, hi = count;
    while (lo < hi) {
      int middle = lo + (hi - lo) / 2;
      if ((key[middle] >> 31) < (key64)i)
        lo = middle + 1;
      else
        hi = middle;
    }
    start[i] = lo;
  }
}

/* A number in [0, 1) from an unordered pair, which breaks ties so that the proposals of neighbours do not form
   chains. */
DEVICE float pair_noise(int i, int j)
{
  unsigned int a = (unsigned int)min_int(i, j), b = (unsigned int)max_int(i, j),
               h = a * 0x9e3779b1u ^ (b + 0x7f4a7c15u) * 0x85ebca6bu;
  h ^= h >> 15;
  h *= 0x2c1b3c6du;
  h ^= h >> 13;
  return (float)(h & 0xffffu) * (1.0f / 65536.0f);
}

/* proposal[i]: the strongest neighbour that is also unmatched and small enough to join; -1: none. */
KERNEL propose_matches(int n, GLOBAL const int *row, GLOBAL const int *column, GLOBAL const float *weight,
                       GLOBAL const int *size, int most, GLOBAL const int *mate, GLOBAL int *proposal)
{
  FOR_EACH(i, n) {
    int best = -1, k;
    float strongest = 0.0f;
    if (mate[i] < 0)
      for (k = row[i]; k < row[i + 1]; ++k) {
        int j = column[k];
        if (mate[j] < 0 && size[i] + size[j] <= most) {
          float strength = weight[k] * (1.0f + 0.25f * pair_noise(i, j));
          if (strength > strongest) {
            strongest = strength;
            best = j;
          }
        }
      }
    proposal[i] = best;
  }
}

/* Two nodes that propose to each other are a match. */
KERNEL accept_matches(int n, GLOBAL const int *proposal, GLOBAL int *mate)
{
  FOR_EACH(i, n) {
    if (proposal[i] >= 0 && proposal[proposal[i]] == i) mate[i] = proposal[i];
  }
}

KERNEL first_of_matches(int n, GLOBAL const int *mate, GLOBAL int *head)
{
  FOR_EACH(i, n) {
    head[i] = mate[i] < 0 || i < mate[i];
  }
}

/* Matched nodes become one node. place: number of the first node of each match. */
KERNEL join_matches(int n, GLOBAL const int *mate, GLOBAL const int *place, GLOBAL const int *size, GLOBAL int *parent,
                    GLOBAL int *joined_size)
{
  FOR_EACH(i, n) {
    int first = mate[i] >= 0 ? min_int(i, mate[i]) : i;
    parent[i] = place[first];
    if (first == i) joined_size[place[i]] = size[i] + (mate[i] >= 0 ? size[mate[i]] : 0);
  }
}

/* Entries of the graph of parents; inner = 1: also those within a parent. A negative parent is not in the graph. n:
   rows. */
KERNEL parent_keys(int n, GLOBAL const int *row, GLOBAL const int *column, GLOBAL const int *parent, int columns,
                   int nodes, int inner, GLOBAL key64 *key, GLOBAL int *entry)
{
  FOR_EACH(i, n) {
    int k, a = parent[i];
    for (k = row[i]; k < row[i + 1]; ++k) {
      int b = column[k] < columns ? parent[column[k]] : -1;
      key[k] = a >= 0 && b >= 0 && (inner || a != b) ? ((key64)a << 31) | (key64)b : (key64)nodes << 31;
      entry[k] = k;
    }
  }
}

/* cluster = parent of cluster. */
KERNEL follow_parents(int n, GLOBAL const int *parent, GLOBAL int *cluster)
{
  FOR_EACH(i, n) {
    if (cluster[i] >= 0) cluster[i] = parent[cluster[i]];
  }
}

/* Keys that sort nodes by the place of their parent, then by number. */
KERNEL order_keys(int n, GLOBAL const int *parent, GLOBAL const int *parent_place, GLOBAL key64 *key, GLOBAL int *node)
{
  FOR_EACH(i, n) {
    key[i] = ((key64)parent_place[parent[i]] << 31) | (key64)i;
    node[i] = i;
  }
}

/* place[order[k]] = k. */
KERNEL invert_order(int n, GLOBAL const int *order, GLOBAL int *place)
{
  FOR_EACH(k, n) {
    place[order[k]] = k;
  }
}

/* to[place[i]] = parent_place[parent[i]]. */
KERNEL place_parents(int n, GLOBAL const int *place, GLOBAL const int *parent, GLOBAL const int *parent_place,
                     GLOBAL int *to)
{
  FOR_EACH(i, n) {
    to[place[i]] = parent_place[parent[i]];
  }
}

/* to[first + i] = from[i] + shift. */
KERNEL shift_items(int n, GLOBAL const int *from, int shift, int first, GLOBAL int *to)
{
  FOR_EACH(i, n) {
    to[first + i] = from[i] + shift;
  }
}

/* parent[v] of vertices: the block of their row; -1: fixed. */
KERNEL vertex_parents(int n, GLOBAL const int *place, GLOBAL const int *row_parent, GLOBAL int *parent)
{
  FOR_EACH(i, n) {
    parent[i] = place[i] >= 0 ? row_parent[place[i]] : -1;
  }
}

KERNEL number_items(int n, GLOBAL int *out)
{
  FOR_EACH(i, n) {
    out[i] = i;
  }
}

/* out[i] = value[index[i]]. */
KERNEL take_items(int n, GLOBAL const int *index, GLOBAL const int *value, GLOBAL int *out)
{
  FOR_EACH(i, n) {
    out[i] = value[index[i]];
  }
}

KERNEL free_flags(int n, GLOBAL const int *fixed, GLOBAL int *flag)
{
  FOR_EACH(i, n) {
    flag[i] = !fixed[i];
  }
}

/* Numbers of flagged items (-1: not flagged), and the items by number. */
KERNEL number_free(int n, GLOBAL const int *flag, GLOBAL const int *place, GLOBAL int *number, GLOBAL int *item)
{
  FOR_EACH(i, n) {
    number[i] = flag[i] ? place[i] : -1;
    if (flag[i]) item[place[i]] = i;
  }
}

/* The coarse matrix's pattern: sources [source_start[e], source_start[e + 1]) of entry e, in sorted order. */
KERNEL coarse_pattern(int n, GLOBAL const key64 *key, GLOBAL const int *place, int nodes, GLOBAL key64 *coarse_key,
                      GLOBAL int *column, GLOBAL int *source_start)
{
  FOR_EACH(i, n) {
    if ((key[i] >> 31) >= (key64)nodes) continue;
    if (place[i + 1] != place[i]) {
      coarse_key[place[i]] = key[i];
      column[place[i]] = (int)(key[i] & 0x7fffffff);
      source_start[place[i]] = i;
    }
    if (i + 1 == n || (key[i + 1] >> 31) >= (key64)nodes) source_start[place[i + 1]] = i + 1;
  }
}

/* value[9 e + c] = sum over the sources of entry e, from blocks in double (is_double) or single. n: 9 entries. */
KERNEL coarse_values(int n, GLOBAL const int *source_start, GLOBAL const int *source, int is_double,
                     GLOBAL const double *from64, GLOBAL const float *from32, GLOBAL double *value)
{
  FOR_EACH(i, n) {
    const int e = i / 9, c = i - 9 * e, end = source_start[e + 1];
    int k;
    double sum = 0.0;
    for (k = source_start[e]; k < end; k += AT_ONCE(8)) {
      int own[AT_ONCE(8)];
      double entry[AT_ONCE(8)];
      FOR_AT_ONCE(q, 8, end - k) own[q] = source[k + q];
      if (is_double) {
        FOR_AT_ONCE(q, 8, end - k) entry[q] = from64[9 * own[q] + c];
      } else {
        FOR_AT_ONCE(q, 8, end - k) entry[q] = (double)from32[9 * own[q] + c];
      }
      FOR_AT_ONCE(q, 8, end - k) sum += entry[q];
    }
    value[i] = sum;
  }
}

/* What the terms at each row add to the diagonal block of the row's ancestor: w_a (sum of w over nodes of one ancestor)
   (along n n' + around I), as xx xy xz yy yz zz. order: vertices of the rows. n: the rows, then the rows once more for
   ancestors two levels up. */
KERNEL term_diagonals(int n, int rows, GLOBAL const int *order, GLOBAL const int *term_row,
                      GLOBAL const int *term_entry, GLOBAL const element_nodes *nodes, GLOBAL const int *ancestor1,
                      GLOBAL const int *ancestor2, int is_double, GLOBAL const double *value64,
                      GLOBAL const float *value32, GLOBAL double *diagonal)
{
  FOR_EACH(i, n) {
    GLOBAL const int *ancestor = i < rows ? ancestor1 : ancestor2;
    double sum[6] = {0.0, 0.0, 0.0, 0.0, 0.0, 0.0};
    int k, b, c, row = i < rows ? i : i - rows, v = order[row];
    for (k = term_row[v]; k < term_row[v + 1]; ++k) {
      int t = term_entry[k] >> 2, a = term_entry[k] & 3;
      double x[9], w = 0.0, along, around;
      for (c = 0; c < 9; ++c) x[c] = is_double ? value64[9 * t + c] : (double)value32[9 * t + c];
      for (b = 0; b < 4; ++b)
        if (nodes[t].node[b] >= 0 && ancestor[nodes[t].node[b]] == ancestor[row]) w += x[b];
      w *= x[a];
      along = w * x[7];
      around = w * x[8];
      sum[0] += along * x[4] * x[4] + around;
      sum[1] += along * x[4] * x[5];
      sum[2] += along * x[4] * x[6];
      sum[3] += along * x[5] * x[5] + around;
      sum[4] += along * x[5] * x[6];
      sum[5] += along * x[6] * x[6] + around;
    }
    for (c = 0; c < 6; ++c) diagonal[6 * i + c] = sum[c];
  }
}

/* to[6 b + c] = sum over the children of b, which begin with child `first` of `from`. n: 6 parents. */
KERNEL sum_children(int n, int first, GLOBAL const int *start, GLOBAL const double *from, GLOBAL double *to)
{
  FOR_EACH(i, n) {
    int b = i / 6, c = i - 6 * b, k;
    double sum = 0.0;
    for (k = start[b]; k < start[b + 1]; ++k) sum += from[6 * (first + k) + c];
    to[i] = sum;
  }
}

#endif
