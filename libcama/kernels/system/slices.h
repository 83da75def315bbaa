/* SPDX-License-Identifier: Apache-2.0 */
/* The pattern of a matrix in slices of SLICE_ROWS rows that share a width (sliced ELLPACK), so that neighbours read
   neighbours. The rows of a team are placed in its slices by length, which keeps slices full; slice_row: row of each
   place, slice_place: place of each row. */
#ifndef CAMA_KERNELS_SYSTEM_SLICES_H
#define CAMA_KERNELS_SYSTEM_SLICES_H
#include "../dialect/lang.h"

#define SLICE_ROWS 32
#define TEAM_ROWS 128   /* rows of a team in the matrix product */
#define ROW_WINDOW 512  /* rows that are sorted by length among themselves where their order is free */

/* Keys of rows by windows of ROW_WINDOW, within a window the longest first, so that the rows of a slice have similar
   lengths. n: rows. */
KERNEL length_keys(int n, GLOBAL const int *vertex, GLOBAL const int *row, GLOBAL key64 *key)
{
  FOR_EACH(i, n)
    key[i] = ((key64)(i / ROW_WINDOW) << 12) | (key64)(4095 - min_int(row[vertex[i] + 1] - row[vertex[i]], 4095));
}

/* The same for the places of rows, by windows of TEAM_ROWS; slice_row: rows by number, to be sorted with their keys. n:
   rows. */
KERNEL place_keys(int n, GLOBAL const int *order, GLOBAL const int *row, GLOBAL key64 *key, GLOBAL int *slice_row)
{
  FOR_EACH(i, n) {
    key[i] = ((key64)(i / TEAM_ROWS) << 12) | (key64)(4095 - min_int(row[order[i] + 1] - row[order[i]], 4095));
    slice_row[i] = i;
  }
}

/* Widths of the slices: the length of the longest row, counting free columns only. n: slices. */
KERNEL slice_widths(int n, int rows, GLOBAL const int *slice_row, GLOBAL const int *order, GLOBAL const int *row,
                    GLOBAL const int *column, int vertices, GLOBAL const int *place, GLOBAL int *width)
{
  FOR_EACH(s, n) {
    int l, widest = 0;
    for (l = 0; l < SLICE_ROWS && s * SLICE_ROWS + l < rows; ++l) {
      int v = order[slice_row[s * SLICE_ROWS + l]], k, count = 0;
      for (k = row[v]; k < row[v + 1]; ++k) count += column[k] < vertices && place[column[k]] >= 0;
      widest = max_int(widest, count);
    }
    width[s] = widest;
  }
}

/* Columns and source blocks of the sliced matrix; entry k of lane l of slice s is at SLICE_ROWS (start[s] + k) + l. n:
   lanes. */
KERNEL fill_slices(int n, int rows, GLOBAL const int *slice_row, GLOBAL const int *order, GLOBAL const int *row,
                   GLOBAL const int *column, int vertices, GLOBAL const int *place, GLOBAL const int *start,
                   GLOBAL int *slice_column, GLOBAL int *source)
{
  FOR_EACH(i, n) {
    int s = i / SLICE_ROWS, l = i - s * SLICE_ROWS, at = start[s], k;
    if (i < rows) {
      int v = order[slice_row[i]];
      for (k = row[v]; k < row[v + 1]; ++k)
        if (column[k] < vertices && place[column[k]] >= 0) {
          slice_column[SLICE_ROWS * at + l] = place[column[k]];
          source[SLICE_ROWS * at + l] = k;
          ++at;
        }
    }
    for (; at < start[s + 1]; ++at) {
      slice_column[SLICE_ROWS * at + l] = 0;
      source[SLICE_ROWS * at + l] = -1;
    }
  }
}

#endif
