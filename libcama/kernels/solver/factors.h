/* SPDX-License-Identifier: Apache-2.0 */
/* The multilevel additive Schwarz preconditioner (Wu et al. 2022, "A GPU-based multilevel additive Schwarz
   preconditioner for cloth and deformable body simulation"). Rows are free vertices, ordered so that those of each
   block are neighbours. A block B has at most BLOCK_ROWS rows; with S B S = L D L' of unit diagonal, its inverse is
   applied as S G' G S with G = D^-1/2 L^-1, which is positive definite however coarsely G is stored: 16 bits an entry,
   each column in units of its largest. */
#ifndef CAMA_KERNELS_SOLVER_FACTORS_H
#define CAMA_KERNELS_SOLVER_FACTORS_H
#include "../dialect/lanes.h"
#include "../dialect/lang.h"
#include "../dialect/vec3.h"
#include "../system/incidence.h"
#include "../system/slices.h"
#include "../system/term.h"
#include "conjugate_gradient.h"

#define BLOCK_ROWS 16
#define BLOCK_SIZE 48
#define BLOCK_TEAM 192  /* members of a team that factors a block: ROW_TURNS of BLOCK_SIZE */
#define APPLY_TEAM 32   /* members of a team that applies it */
#define ROW_TURNS (LANES == 1 ? 4 : 1)     /* rows that are eliminated at once */
#define ROW_MEMBERS (LANES == 1 ? 9 : 1)   /* members that gather the entries of a vertex */
#define NODE_MEMBERS (LANES == 1 ? 3 : 1)  /* members that gather those of one row of a coarse node */
/* Added whole, the corrections of the coarse levels overshoot: they are added by half. */
#define COARSE_SHARE 0.5
/* Words of G: for 16 rows at a time, the columns up to the diagonal, 16 numbers each. With one lane word k holds
   entries k and k + FACTOR_WORDS; otherwise entries are side by side. */
#define FACTOR_WORDS 768
#define FACTOR_COLUMN(group, c) (8 * (group) * ((group) + 1) + (c))
#if LANES == 1
#define STORE_FACTOR(factor, at, v) ((factor)[at] = (v))
#else
#define STORE_FACTOR(factor, at, v) \
  LANES_STORE(GLOBAL short_lanes, (GLOBAL short *)(factor) + (at), LANES_TO(short, short_lanes, v))
#endif

/* Strength of a vertex: 1 / sqrt(trace of its diagonal block). */
KERNEL vertex_strengths(int n, GLOBAL const mat3 *diagonal, GLOBAL float *strength)
{
  FOR_EACH(i, n) {
    real trace = diagonal[i].row[0].x + diagonal[i].row[1].y + diagonal[i].row[2].z;
    strength[i] = trace > (real)0 ? (float)((real)1 / (real)sqrt(trace)) : 0.0f;
  }
}

/* Entries of the graph: |A_ij| / sqrt(tr A_ii tr A_jj) for free cloth vertices i and j. n: cloth vertices; entry k of
   the graph is block k. number: index among free vertices; -1: fixed. */
KERNEL matrix_entries(int n, GLOBAL const int *row, GLOBAL const int *column, GLOBAL const mat3 *block,
                      GLOBAL const int *number, int numbers, GLOBAL const float *strength, GLOBAL key64 *key,
                      GLOBAL int *entry, GLOBAL float *weight)
{
  FOR_EACH(i, n) {
    int k, a;
    for (k = row[i]; k < row[i + 1]; ++k) {
      int j = column[k], used = j < n && j != i && number[i] >= 0 && number[j] >= 0;
      real squares = (real)0;
      for (a = 0; a < 3; ++a) squares += dot(block[k].row[a], block[k].row[a]);
      key[k] = used ? ((key64)number[i] << 31) | (key64)number[j] : (key64)numbers << 31;
      entry[k] = k;
      weight[k] = used ? (float)sqrt(squares) * strength[i] * strength[j] : 0.0f;
    }
  }
}

#define TERM_ENTRIES 8

/* The same for the vertices that each term couples across its sides, behind the `first` entries of the matrix: at most
   four pairs, in both directions. Vertices of one side are neighbours in the matrix already. */
KERNEL term_entries(int n, int first, int vertices, GLOBAL const term *terms, GLOBAL const int *number, int numbers,
                    GLOBAL const float *strength, GLOBAL key64 *key, GLOBAL int *entry, GLOBAL float *weight)
{
  FOR_EACH(i, n) {
    int a, b, at = first + TERM_ENTRIES * i;
    for (a = 0; a < 4; ++a)
      for (b = 0; b < 4; ++b) {
        int u = terms[i].node[a], v = terms[i].node[b];
        int used = u >= 0 && v >= 0 && u < vertices && v < vertices && number[u] >= 0 && number[v] >= 0;
        real w = terms[i].weight[a] * terms[i].weight[b];
        if (!used || !(w < (real)0)) continue;
        key[at] = ((key64)number[u] << 31) | (key64)number[v];
        entry[at] = at;
        weight[at++] = (float)(-w * (terms[i].along + (real)3 * terms[i].around)) * strength[u] * strength[v];
      }
    for (; at < first + TERM_ENTRIES * (i + 1); ++at) {
      key[at] = (key64)numbers << 31;
      entry[at] = at;
      weight[at] = 0.0f;
    }
  }
}

/* Eliminates the rows of `a`, two at once: the part of a row behind the diagonal is also its column, since the
   remaining matrix is symmetric. `second` is row k + 1 without its share of row k; `root` and `unit` are the shares of
   rows k and k + 1 in each row. Behind an odd m there is a row of zeros. Pivots are kept above rounding. */
#if LANES == 1
/* Each member finds the shares for itself, and row k + 1 is stored a turn later, so that a turn has one barrier. */
DEVICE_TEAM void eliminate_rows(int m, LOCAL real *a, LOCAL real *unit, LOCAL real *root, LOCAL real *second)
{
  const real least = sizeof(real) == 8 ? (real)1e-14 : (real)1e-6;
  int k;
  (void)unit;
  (void)root;
  for (k = 0; k < m; k += 2) {
    LOCAL const real *first = a + k * BLOCK_SIZE, *next = first + BLOCK_SIZE;
    const real p = (real)1 / max_real(first[k], least), share = first[k + 1] * p,
               p1 = (real)1 / max_real(next[k + 1] - first[k + 1] * share, least);
    TEAM_FOR(item, ROW_TURNS * BLOCK_SIZE) {
      const int turn = item / BLOCK_SIZE, j = item - turn * BLOCK_SIZE, end = j > k + 1 ? min_int(j + 1, m) : m,
                begins = j == k || j == k + 1; /* columns of L^-1 that begin in these rows */
      const real row = j == k ? -share : next[j] - first[j] * share, behind = j == k + 1 ? (real)1 : row,
                 own = j == k       ? (real)1
                       : j == k + 1 ? (real)0
                                    : first[j];
      int i;
      if (turn == 0) {
        if (k > 0) a[(k - 1) * BLOCK_SIZE + j] = second[j];
        second[j] = row;
      }
      for (i = k + 2 + turn; i < end; i += ROW_TURNS) {
        const real from = first[i], of_first = from * p, of_next = (next[i] - from * share) * p1;
        LOCAL real *at = a + i * BLOCK_SIZE + j;
        *at = (begins ? (real)0 : *at) - own * of_first - behind * of_next;
      }
    }
    TEAM_BARRIER;
  }
  TEAM_FOR(j, BLOCK_SIZE) a[(k - 1) * BLOCK_SIZE + j] = second[j];
  TEAM_BARRIER;
}
#else
DEVICE_TEAM void eliminate_rows(int m, LOCAL real *a, LOCAL real *unit, LOCAL real *root, LOCAL real *second)
{
  const real least = sizeof(real) == 8 ? (real)1e-14 : (real)1e-6;
  int k, i;
  for (k = 0; k < m; k += 2) {
    LOCAL const real *first = a + k * BLOCK_SIZE;
    const real p = (real)1 / max_real(first[k], least), share = first[k + 1] * p,
               p1 = (real)1 / max_real(first[BLOCK_SIZE + k + 1] - first[k + 1] * share, least);
    TEAM_FOR_LANES(j, m) {
      const lanes own = LANES_LOAD(LOCAL lanes, first + j),
                  behind = LANES_LOAD(LOCAL lanes, first + BLOCK_SIZE + j) - own * share;
      LANES_STORE(LOCAL lanes, root + j, own * p);
      LANES_STORE(LOCAL lanes, second + j, behind);
      LANES_STORE(LOCAL lanes, unit + j, behind * p1);
    }
    TEAM_FOR_LANES(j, m) {
      const lanes own = LANES_LOAD(LOCAL lanes, first + j), behind = LANES_LOAD(LOCAL lanes, second + j);
      const int end = j > k + 1 ? min_int(j + LANES, m) : m;
      LANES_STORE(LOCAL lanes, a + (k + 1) * BLOCK_SIZE + j, behind);
      for (i = k + 2; i < end; ++i) {
        LOCAL real *at = a + i * BLOCK_SIZE + j;
        LANES_STORE(LOCAL lanes, at, LANES_LOAD(LOCAL lanes, at) - own * root[i] - behind * unit[i]);
      }
    }
    a[(k + 1) * BLOCK_SIZE + k] = -share;
    for (i = k + 2; i < m; ++i) {
      a[i * BLOCK_SIZE + k] = share * unit[i] - root[i];
      a[i * BLOCK_SIZE + k + 1] = -unit[i];
    }
  }
}
#endif

/* a: the upper part of a symmetric positive definite matrix of m rows in BLOCK_SIZE columns, scaled to a unit diagonal
   by the outer product of `scaling`; zero elsewhere. Writes G to `factor`, and its columns' units times the scaling to
   `weight`. L^-1 builds up below the diagonal of a as rows are eliminated. unit, root and second: [BLOCK_SIZE]. */
DEVICE_TEAM void factor_block(int m, LOCAL real *a, LOCAL real *unit, LOCAL real *root, LOCAL real *second,
                              LOCAL double *scaling, GLOBAL int *factor, GLOBAL real *weight)
{
  const real least = sizeof(real) == 8 ? (real)1e-14 : (real)1e-6;
  eliminate_rows(m, a, unit, root, second);
  TEAM_FOR(l, m) root[l] = (real)sqrt((real)1 / max_real(a[l * BLOCK_SIZE + l], least));
  TEAM_BARRIER;
  /* L^-1, whose rows are multiplied by root next: ones on the diagonal, zeros above it. */
  TEAM_FOR(item, ROW_TURNS * BLOCK_SIZE) {
    const int turn = item / BLOCK_SIZE, l = item - turn * BLOCK_SIZE;
    int c;
    if (l >= m) continue;
    if (turn == 0) a[l * BLOCK_SIZE + l] = (real)1;
    for (c = l + 1 + turn; c < m; c += ROW_TURNS) a[l * BLOCK_SIZE + c] = (real)0;
  }
  TEAM_BARRIER;
  TEAM_FOR_LANES(c, BLOCK_SIZE) {
    const lanes zero = LANES_ALL(lanes, (real)0);
    lanes largest = zero;
    int l;
    for (l = LANES == 1 ? c : 0; l < m; ++l) {
      LOCAL real *at = a + l * BLOCK_SIZE + c;
      const lanes v = LANES_LOAD(LOCAL lanes, at) * root[l], size = LANES_SELECT(lanes, v < zero, -v, v);
      LANES_STORE(LOCAL lanes, at, v);
      largest = LANES_SELECT(lanes, largest > size, largest, size);
    }
    LANES_STORE(LOCAL lanes, unit + c, largest);
  }
  TEAM_BARRIER;
  TEAM_FOR(c, BLOCK_SIZE) {
    weight[c] = c < m ? (real)((double)unit[c] * (1.0 / 32767.0) * scaling[c]) : (real)0;
    unit[c] = unit[c] > (real)0 && unit[c] < (real)1e30 ? (real)32767 / unit[c] : (real)0;
  }
  TEAM_BARRIER;
  TEAM_FOR_LANES(item, LANES == 1 ? FACTOR_WORDS : 2 * FACTOR_WORDS) {
    int_lanes both = LANES_ALL(int_lanes, 0);
    int part;
    for (part = LANES == 1 ? 1 : 0; part >= 0; --part) {
      const int at = item + part * FACTOR_WORDS, column = at / 16, group = column < 16 ? 0 : column < 48 ? 1 : 2;
      const int c = column - FACTOR_COLUMN(group, 0), l = 16 * group + at % 16;
      real row[LANES];
      int_lanes q = LANES_ALL(int_lanes, 0);
      if (unit[c] > (real)0) {
        lanes v;
        FOR_LANES(k) row[k] = a[(l + k) * BLOCK_SIZE + c] * unit[c];
        v = LANES_LOAD(lanes, row);
        q = LANES_TO(int, int_lanes, LANES_SELECT(lanes, v < LANES_ALL(lanes, (real)0), v - (real)0.5, v + (real)0.5));
      }
      both = both << 16 | (q & (LANES == 1 ? 0xffff : -1));
    }
    STORE_FACTOR(factor, item, both);
  }
}

/* For factor_block, from the entries of matrix and terms within the block of rows [first, last). */
DEVICE_TEAM void gather_fine_block(int first, int last, GLOBAL const int *slice_start, GLOBAL const int *slice_place,
                                   GLOBAL const int *column, GLOBAL const real *value, int terms,
                                   GLOBAL const int *order, GLOBAL const int *term_row, GLOBAL const int *term_entry,
                                   GLOBAL const element_nodes *nodes, GLOBAL const real *coefficient, LOCAL real *a,
                                   LOCAL double *scaling)
{
  const int m = 3 * (last - first);
  TEAM_FOR(item, (last - first) * ROW_MEMBERS) {
    const int l = item / ROW_MEMBERS, i = first + l, place = slice_place[i], s = place / SLICE_ROWS,
              lane = place - s * SLICE_ROWS;
    int e, k, b, c, end = slice_start[s + 1];
    for (e = slice_start[s]; e < end; e += AT_ONCE(4)) {
      int j[AT_ONCE(4)];
      FOR_AT_ONCE(q, 4, end - e) j[q] = column[SLICE_ROWS * (e + q) + lane];
      for (c = item % ROW_MEMBERS; c < 9; c += ROW_MEMBERS) {
        real v[AT_ONCE(4)];
        FOR_AT_ONCE(q, 4, end - e)
          if (j[q] >= first && j[q] <= i) v[q] = value[SLICE_ROWS * (9 * (e + q) + c) + lane];
        FOR_AT_ONCE(q, 4, end - e)
          if (j[q] >= first && j[q] <= i) a[(3 * (j[q] - first) + c % 3) * BLOCK_SIZE + 3 * l + c / 3] += v[q];
      }
    }
    end = terms ? term_row[order[i] + 1] : 0;
    for (k = terms ? term_row[order[i]] : 0; k < end; k += AT_ONCE(2)) {
      int at[AT_ONCE(2)];
      element_nodes rows[AT_ONCE(2)];
      real x[AT_ONCE(2)][10]; /* as in `coefficient`, and the weight of row i */
      FOR_AT_ONCE(q, 2, end - k) at[q] = term_entry[k + q];
      FOR_AT_ONCE(q, 2, end - k) {
        rows[q] = nodes[at[q] >> 2];
        for (c = 0; c < 9; ++c) x[q][c] = coefficient[9 * (at[q] >> 2) + c];
        x[q][9] = coefficient[9 * (at[q] >> 2) + (at[q] & 3)];
      }
      FOR_AT_ONCE(q, 2, end - k)
        for (b = 0; b < 4; ++b) {
          const int j = rows[q].node[b];
          const real w = x[q][9] * x[q][b];
          if (j < first || j > i) continue;
          for (c = item % ROW_MEMBERS; c < 9; c += ROW_MEMBERS) {
            const real left = c < 3   ? x[q][4]
                              : c < 6 ? x[q][5]
                                      : x[q][6],
                       right = c % 3 == 0   ? x[q][4]
                               : c % 3 == 1 ? x[q][5]
                                            : x[q][6];
            a[(3 * (j - first) + c % 3) * BLOCK_SIZE + 3 * l + c / 3] +=
                w * (x[q][7] * (left * right) + (c % 4 == 0 ? x[q][8] : (real)0));
          }
        }
    }
  }
  TEAM_BARRIER;
  TEAM_FOR(l, BLOCK_SIZE) {
    /* not a number where the matrix is not positive; the solve reports that */
    scaling[l] = l < m ? 1.0 / sqrt((double)a[l * BLOCK_SIZE + l]) : 0.0;
  }
  TEAM_BARRIER;
  TEAM_FOR_LANES(item, ROW_TURNS * BLOCK_SIZE) {
    const int turn = item / BLOCK_SIZE, l = item - turn * BLOCK_SIZE, end = min_int(l + LANES, m);
    const double_lanes own = LANES_LOAD(LOCAL double_lanes, scaling + l);
    int c;
    for (c = turn; c < end; c += ROW_TURNS) {
      LOCAL real *at = a + c * BLOCK_SIZE + l;
      const double_lanes v = LANES_TO(double, double_lanes, LANES_LOAD(LOCAL lanes, at));
      LANES_STORE(LOCAL lanes, at, LANES_TO(real, lanes, v * (own * scaling[c])));
    }
  }
}

/* The same for the block of nodes [first, last) of a coarse level, which are coupled by row, column and value; terms =
   1: the diagonals of the terms are added. */
DEVICE_TEAM void gather_coarse_block(int first, int last, GLOBAL const int *row, GLOBAL const int *column,
                                     GLOBAL const double *value, int terms, GLOBAL const double *diagonal,
                                     LOCAL real *a, LOCAL double *scaling)
{
  const int m = 3 * (last - first);
  TEAM_FOR(l, BLOCK_SIZE) {
    const int i = first + l / 3, d = l - l / 3 * 3, end = l < m ? row[i + 1] : 0;
    int k, place = -1;
    for (k = l < m ? row[i] : 0; k < end; k += AT_ONCE(8)) {
      int j[AT_ONCE(8)];
      FOR_AT_ONCE(q, 8, end - k) j[q] = column[k + q];
      FOR_AT_ONCE(q, 8, end - k)
        if (j[q] == i) place = k + q;
    }
    scaling[l] = 0.0;
    if (place >= 0) {
      const int packed = d == 0 ? 0 : d == 1 ? 3 : 5;
      scaling[l] = 1.0 / sqrt(value[9 * place + 4 * d] + (terms ? diagonal[6 * i + packed] : 0.0));
    }
  }
  TEAM_BARRIER;
  TEAM_FOR(item, NODE_MEMBERS * m) {
    const int l = item / NODE_MEMBERS, i = first + l / 3, r = l - l / 3 * 3, end = row[i + 1];
    int k, d;
    for (k = row[i]; k < end; k += AT_ONCE(4)) {
      int j[AT_ONCE(4)];
      FOR_AT_ONCE(q, 4, end - k) j[q] = column[k + q];
      for (d = item % NODE_MEMBERS; d < 3; d += NODE_MEMBERS) {
        double v[AT_ONCE(4)];
        FOR_AT_ONCE(q, 4, end - k)
          if (j[q] >= first && 3 * (j[q] - first) + d <= l) v[q] = value[9 * (k + q) + 3 * r + d];
        FOR_AT_ONCE(q, 4, end - k)
          if (j[q] >= first && 3 * (j[q] - first) + d <= l) {
            const int c = 3 * (j[q] - first) + d, low = min_int(r, d), high = max_int(r, d);
            if (terms && j[q] == i) v[q] += diagonal[6 * i + (low == 0 ? high : low + high + 1)];
            a[c * BLOCK_SIZE + l] = (real)(v[q] * (scaling[l] * scaling[c]));
          }
      }
    }
  }
  TEAM_BARRIER;
  TEAM_FOR(l, m) scaling[l] *= sqrt(COARSE_SHARE);
}

/* Factors of n blocks from `begin` on. Blocks before `fine` have rows, those before `middle` the nodes of level 1, and
   the others those of level 2; block_start: [n + 1] their first rows and nodes, numbered on from level to level. */
KERNEL_OF(BLOCK_TEAM, 6)
factor_blocks(int n, int begin, int fine, int middle, GLOBAL const int *block_start, GLOBAL const int *slice_start,
              GLOBAL const int *slice_place, GLOBAL const int *column, GLOBAL const real *value, int terms,
              GLOBAL const int *order, GLOBAL const int *term_row, GLOBAL const int *term_entry,
              GLOBAL const element_nodes *nodes, GLOBAL const real *coefficient, GLOBAL const int *row1,
              GLOBAL const int *column1, GLOBAL const double *value1, GLOBAL const double *diagonal1,
              GLOBAL const int *row2, GLOBAL const int *column2, GLOBAL const double *value2,
              GLOBAL const double *diagonal2, GLOBAL int *factor, GLOBAL real *weight)
{
  TEAM_LOCAL(real, own_block, BLOCK_SIZE * BLOCK_SIZE);
  TEAM_LOCAL(real, own_unit, BLOCK_SIZE);
  TEAM_LOCAL(real, own_root, BLOCK_SIZE);
  TEAM_LOCAL(real, own_second, BLOCK_SIZE);
  TEAM_LOCAL(double, own_scaling, BLOCK_SIZE);
  FOR_EACH_TEAM(own, n) {
    LOCAL real *RESTRICT a = TEAM_POINTER(real, own_block), *RESTRICT unit = TEAM_POINTER(real, own_unit),
                         *RESTRICT root = TEAM_POINTER(real, own_root),
                         *RESTRICT second = TEAM_POINTER(real, own_second);
    LOCAL double *RESTRICT scaling = TEAM_POINTER(double, own_scaling);
    const int t = begin + own, before = t < fine ? 0 : block_start[t < middle ? fine : middle],
              first = block_start[t] - before, last = block_start[t + 1] - before;
    TEAM_BARRIER;
    TEAM_FOR(l, BLOCK_SIZE * BLOCK_SIZE) a[l] = (real)0;
    TEAM_BARRIER;
    if (t < fine)
      gather_fine_block(first, last, slice_start, slice_place, column, value, terms, order, term_row, term_entry, nodes,
                        coefficient, a, scaling);
    else /* one call for both levels: pocl 3.1 ran neither of two in branches */
      gather_coarse_block(first, last, t < middle ? row1 : row2, t < middle ? column1 : column2,
                          t < middle ? value1 : value2, terms, t < middle ? diagonal1 : diagonal2, a, scaling);
    TEAM_BARRIER;
    factor_block(3 * (last - first), a, unit, root, second, scaling, factor + (size_t)t * FACTOR_WORDS,
                 weight + (size_t)t * BLOCK_SIZE);
  }
}

#endif
