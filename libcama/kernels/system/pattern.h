/* SPDX-License-Identifier: Apache-2.0 */
/* The pattern of the matrix (paper, section 3.2, Algorithm 1, lines 1-16). Rows are cloth vertices, [0, rows); columns
   are all vertices, obstacles' too, so that moving obstacles act on the cloth. Elements are element_nodes; FORM_STAR
   leaves out pairs on the same side (weights of one sign). An index holds its source in the bits below its column: a
   row's sorted indices give the sources of its blocks as well. */
#ifndef CAMA_KERNELS_SYSTEM_PATTERN_H
#define CAMA_KERNELS_SYSTEM_PATTERN_H
#include "../dialect/lang.h"
#include "incidence.h"

/* A source of a block: 16 * (first + element) + 4 a + b for nodes a and b, where hinges are numbered behind triangles
   and terms behind hinges; -1 - row: the mass on the diagonal, which comes first. */
DEVICE key64 index_of(int column, int source) { return ((key64)column << 32) | (key64)(source + 1); }
DEVICE key64 index_of_mass(int row) { return (key64)row << 32; }
DEVICE int index_column(key64 index) { return (int)(index >> 32); }
DEVICE int index_source(key64 index)
{
  int source = (int)(index & (key64)0x7fffffff) - 1;
  return source < 0 ? -1 - index_column(index) : source;
}

DEVICE int in_matrix(int node, int rows) { return node >= 0 && node < rows; }

/* 1 if nodes a and b of element i couple. split: [elements] or none; nodes below it are side A, and only pairs across
   the sides couple; 0, or no split: every pair couples. */
DEVICE int couples(GLOBAL const int *split, int i, int a, int b)
{
  return !split || split[i] == 0 || a == b || (a < split[i]) != (b < split[i]);
}

/* Blocks of node a of element i. */
DEVICE int entry_count(GLOBAL const element_nodes *nodes, GLOBAL const int *split, int i, int a)
{
  int b, entries = 0;
  for (b = 0; b < 4; ++b) entries += nodes[i].node[b] >= 0 && couples(split, i, a, b);
  return entries;
}

/* Lines 2-4: entries per row. split: [n] or none, see couples. */
KERNEL count_entries(int n, GLOBAL const element_nodes *nodes, GLOBAL const int *split, int rows, GLOBAL int *count)
{
  FOR_EACH(i, n) {
    int a;
    for (a = 0; a < 4; ++a)
      if (in_matrix(nodes[i].node[a], rows)) atomic_add_int(&count[nodes[i].node[a]], entry_count(nodes, split, i, a));
  }
}

/* Lines 7-9: writes the indices to each row's space, in any order. */
KERNEL fill_entries(int n, int first, GLOBAL const element_nodes *nodes, GLOBAL const int *split, int rows,
                    GLOBAL const int *space, GLOBAL int *cursor, GLOBAL key64 *index)
{
  FOR_EACH(i, n) {
    int a, b;
    for (a = 0; a < 4; ++a) {
      int s = nodes[i].node[a], at;
      if (!in_matrix(s, rows)) continue;
      at = space[s] + atomic_add_int(&cursor[s], entry_count(nodes, split, i, a));
      for (b = 0; b < 4; ++b)
        if (nodes[i].node[b] >= 0 && couples(split, i, a, b))
          index[at++] = index_of(nodes[i].node[b], 16 * (first + i) + 4 * a + b);
    }
  }
}

/* One entry per row, so that vertices without elements keep their diagonal. */
KERNEL fill_diagonal(int n, GLOBAL const int *space, GLOBAL int *cursor, GLOBAL key64 *index)
{
  FOR_EACH(i, n) {
    index[space[i]] = index_of_mass(i);
    cursor[i] = 1;
  }
}

/* Ascending, in place, with gaps of 1, 4, 13, 40, ... (Shell; Knuth 1973): O(n^1.5) in the worst case. */
DEVICE void sort_keys(GLOBAL key64 *value, int n)
{
  int gap = 1, i;
  while (gap < n / 3) gap = 3 * gap + 1;
  for (; gap > 0; gap /= 3)
    for (i = gap; i < n; ++i) {
      key64 kept = value[i];
      int j = i;
      for (; j >= gap && value[j - gap] > kept; j -= gap) value[j] = value[j - gap];
      value[j] = kept;
    }
}

/* Lines 11-13: sorts each row's indices, one row by a work-item here, by a team below. */
KERNEL sort_indices(int n, GLOBAL const int *space, GLOBAL key64 *index)
{
  FOR_EACH_UNEVEN(i, n) {
    sort_keys(index + space[i], space[i + 1] - space[i]);
  }
}

#define SORT_TEAM 64
/* Largest row that a team sorts by counting: the place of each index is the number of smaller ones, and no two are
   equal. */
#define SORT_ROOM 1024

KERNEL sort_indices_by_teams(int n, GLOBAL const int *space, GLOBAL key64 *index)
{
  TEAM_LOCAL(key64, unsorted, SORT_ROOM);
  FOR_EACH_TEAM(t, n) {
    int begin = space[t], count = space[t + 1] - begin, fits = count <= SORT_ROOM;
    if (fits)
      TEAM_FOR(l, count) unsorted[l] = index[begin + l];
    else
      TEAM_FOR(l, 1) sort_keys(index + begin, count);
    TEAM_BARRIER;
    if (fits)
      TEAM_FOR(l, count) {
        key64 own = unsorted[l];
        int place = 0, k;
        for (k = 0; k < count; ++k) place += unsorted[k] < own;
        index[begin + place] = own;
      }
    TEAM_BARRIER;
  }
}

/* Columns of each row, without duplicates. */
KERNEL count_columns(int n, GLOBAL const int *space, GLOBAL const key64 *index, GLOBAL int *count)
{
  FOR_EACH(i, n) {
    int k, columns = 0;
    for (k = space[i]; k < space[i + 1]; ++k)
      columns += k == space[i] || index_column(index[k]) != index_column(index[k - 1]);
    count[i] = columns;
  }
}

/* Lines 15-16: the compact index, and the sources of every block k, from start[k] to start[k + 1]. */
KERNEL list_columns(int n, GLOBAL const int *space, GLOBAL const key64 *index, GLOBAL const int *row,
                    GLOBAL int *column, GLOBAL int *start, GLOBAL int *source)
{
  FOR_EACH(i, n) {
    int at = row[i], last = -1, k;
    for (k = space[i]; k < space[i + 1]; ++k) {
      key64 own = index[k];
      source[k] = index_source(own);
      if (index_column(own) == last) continue;
      last = index_column(own);
      start[at] = k;
      column[at++] = last;
    }
    if (i == n - 1) start[at] = k;
  }
}

#endif
