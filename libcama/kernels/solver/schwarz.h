/* SPDX-License-Identifier: Apache-2.0 */
/* Application of the multilevel additive Schwarz preconditioner: blocks of all levels, residuals of coarse nodes,
   corrections; its factors are in factors.h. */
#ifndef CAMA_KERNELS_SOLVER_SCHWARZ_H
#define CAMA_KERNELS_SOLVER_SCHWARZ_H
#include "../dialect/caching.h"
#include "../dialect/lanes.h"
#include "../dialect/lang.h"
#include "../dialect/vec3.h"
#include "../system/incidence.h"
#include "conjugate_gradient.h"
#include "factors.h"

/* Local memory in which a team works on the columns of a factor. Members with one lane each keep packed words, half the
   memory, with columns 17 words apart and those from 32 on another 16: no two members access the same bank. */
#if LANES == 1
typedef int staged_factor;
#define FACTOR_STRIDE 17
#define STAGED_SIZE (48 * 17 + 16)
#define STAGED_COLUMN(column) ((column) % 48 * 17 + (column) % 48 / 32 * 16)
/* A number of a column: from the upper half of the word if the column is in the last group. */
#define STAGED_NUMBER(p, upper) ((real)(short)(*(p) >> ((upper) ? 16 : 0)))
typedef struct ALIGNED(16) {
  int word[4];
} factor_words;

DEVICE_TEAM void stage_factor(GLOBAL const int *factor, LOCAL staged_factor *g)
{
  TEAM_FOR(l, APPLY_TEAM) {
    GLOBAL const factor_words *from = (GLOBAL const factor_words *)factor;
    factor_words own[FACTOR_WORDS / APPLY_TEAM / 4]; /* all are read before the first is stored */
    int k, part;
    for (k = 0; k < FACTOR_WORDS / APPLY_TEAM / 4; ++k) own[k] = LOAD_ONCE_NEAR(from + l + k * APPLY_TEAM);
    for (k = 0; k < FACTOR_WORDS / APPLY_TEAM / 4; ++k)
      for (part = 0; part < 4; ++part)
        g[STAGED_COLUMN((l + k * APPLY_TEAM) / 4) + (l + k * APPLY_TEAM) % 4 * 4 + part] = own[k].word[part];
  }
}

/* y = G u. Rows in three groups of 16 have 16, 32 and 48 columns; a member has a row of the last group, or one row of
   each of the others: 48 columns in three turns. */
DEVICE_TEAM void multiply_factor(GLOBAL const int *factor, int groups, LOCAL const real *u, LOCAL staged_factor *g,
                                 LOCAL real *y)
{
  (void)factor;
  TEAM_FOR(j, APPLY_TEAM) {
    const int last = j < 16, turns = groups == 1 ? 1 : 3;
    real even = (real)0, odd = even;
    int turn, c;
    if (!last || groups == 3)
      for (turn = 0; turn < turns; ++turn) {
        const int group = last ? 2 : turn > 0, first = last ? 16 * turn : turn == 2 ? 16 : 0, lane = last ? j : j - 16;
        LOCAL const staged_factor *column = g + STAGED_COLUMN(FACTOR_COLUMN(group, first)) + lane;
        LOCAL const real *v = u + first;
        for (c = 0; c < 16; c += 4) {
          even += STAGED_NUMBER(column + c * FACTOR_STRIDE, last) * v[c];
          odd += STAGED_NUMBER(column + (c + 1) * FACTOR_STRIDE, last) * v[c + 1];
          even += STAGED_NUMBER(column + (c + 2) * FACTOR_STRIDE, last) * v[c + 2];
          odd += STAGED_NUMBER(column + (c + 3) * FACTOR_STRIDE, last) * v[c + 3];
        }
        if (turn == 2 || (turn == 0 && !last)) {
          y[16 * group + lane] = even + odd;
          even = odd = (real)0;
        }
      }
  }
}

/* u = S G' y. Columns in three groups have 48, 32 and 16 rows; a member has those of 48 columns. */
DEVICE_TEAM void multiply_transposed(int groups, LOCAL const staged_factor *g, LOCAL const real *y,
                                     GLOBAL const real *w, LOCAL real *u)
{
  TEAM_FOR(l, APPLY_TEAM) {
    real at[16]; /* rows */
    int turn, row;
    for (row = 0; row < 16; ++row) at[row] = (real)0;
    for (turn = 0; turn < 3; ++turn) {
      const int c = l >= 16 && turn == 2 ? l + 16 : l, group = l < 16 ? turn : turn == 0 ? 1 : 2;
      if (group < groups) {
        LOCAL const staged_factor *column = g + STAGED_COLUMN(FACTOR_COLUMN(group, c));
        for (row = 0; row < 16; ++row) at[row] += STAGED_NUMBER(column + row, group == 2) * y[16 * group + row];
      }
      if (turn == 2 || (turn == 1 && l >= 16)) {
        for (row = 0; row < 8; ++row) at[row] += at[row + 8];
        for (row = 0; row < 4; ++row) at[row] += at[row + 4];
        u[c] = w[c] * (at[0] + at[2] + (at[1] + at[3]));
        for (row = 0; row < 16; ++row) at[row] = (real)0;
      }
    }
  }
}
#else
typedef real staged_factor;
#define STAGED_SIZE (2 * FACTOR_WORDS)
#define STAGED_COLUMN(column) ((column) * 16)
#define stage_factor(factor, g) ((void)(g)) /* multiply_factor does it */

/* y = G u, and G as numbers to g. */
DEVICE_TEAM void multiply_factor(GLOBAL const int *factor, int groups, LOCAL const real *u, LOCAL staged_factor *g,
                                 LOCAL real *y)
{
  int group, c, odd, part;
  for (group = 0; group < groups; ++group) {
    lanes sum[2][16 / LANES]; /* of even and odd columns */
    for (odd = 0; odd < 2; ++odd)
      for (part = 0; part < 16 / LANES; ++part) sum[odd][part] = LANES_ALL(lanes, (real)0);
    for (c = 0; c < 16 * (group + 1); c += 2)
      for (odd = 0; odd < 2; ++odd)
        for (part = 0; part < 16 / LANES; ++part) {
          const int at = STAGED_COLUMN(FACTOR_COLUMN(group, c + odd)) + LANES * part;
          const short_lanes packed = LANES_LOAD(GLOBAL short_lanes, (GLOBAL const short *)factor + at);
          const lanes own = LANES_TO(real, lanes, LANES_TO(int, int_lanes, packed));
          LANES_STORE(LOCAL lanes, g + at, own);
          sum[odd][part] += own * u[c + odd];
        }
    for (part = 0; part < 16 / LANES; ++part)
      LANES_STORE(LOCAL lanes, y + 16 * group + LANES * part, sum[0][part] + sum[1][part]);
  }
}

/* u = S G' y. */
DEVICE_TEAM void multiply_transposed(int groups, LOCAL const staged_factor *g, LOCAL const real *y,
                                     GLOBAL const real *w, LOCAL real *u)
{
  TEAM_FOR_LANES(c, 16 * groups) {
    LOCAL const real *column[3] = {g, g, g};
    const int first = c / 16;
    int group;
    lanes sums;
    for (group = first; group < groups; ++group) column[group - first] = g + STAGED_COLUMN(FACTOR_COLUMN(group, c));
    if (groups - first == 3) /* so that the number of runs is known to the compiler */
      dot_columns(column, 3, y + 16 * first, &sums);
    else if (groups - first == 2)
      dot_columns(column, 2, y + 16 * first, &sums);
    else
      dot_columns(column, 1, y + 16 * first, &sums);
    LANES_STORE(LOCAL lanes, u + c, LANES_LOAD(GLOBAL lanes, w + c) * sums);
  }
}
#endif

/* Up to so many, kernels of the solve read what they need together with CG_DONE; those of more end without reading it.
 */
#define FEW_ROWS 65536

/* z = S G' G S r for each block of all levels; the nodes of a coarse level are numbered behind those of the finer one.
   at: place of the scalars. */
KERNEL apply_blocks(int n, GLOBAL const int *block_start, int at, GLOBAL const double *scalar,
                    GLOBAL const int *RESTRICT factor, GLOBAL const real *RESTRICT weight,
                    GLOBAL const vec4 *RESTRICT residual, GLOBAL vec4 *RESTRICT result)
{
  TEAM_LOCAL(staged_factor, own_factor, STAGED_SIZE);
  TEAM_LOCAL(real, own_residual, BLOCK_SIZE);
  TEAM_LOCAL(real, own_product, BLOCK_SIZE);
  if (!BEGINS_EARLY && scalar[at + CG_DONE] != 0.0) return;
  FOR_EACH_TEAM_EARLY(t, n) {
    const int node = block_start[t], rows = block_start[t + 1] - node, groups = (3 * rows + 15) / 16;
    int done;
    GLOBAL const real *RESTRICT w = weight + t * BLOCK_SIZE;
    LOCAL staged_factor *RESTRICT g = TEAM_POINTER(staged_factor, own_factor);
    LOCAL real *RESTRICT u = TEAM_POINTER(real, own_residual), *RESTRICT y = TEAM_POINTER(real, own_product);
    TEAM_BARRIER;
    stage_factor(factor + (size_t)t * FACTOR_WORDS, g);
    AWAIT_LAUNCHES;
    done = BEGINS_EARLY && scalar[at + CG_DONE] != 0.0;
    if (n > FEW_ROWS / BLOCK_ROWS && done) continue;
    TEAM_FOR(l, BLOCK_ROWS) {
      const vec4 r = l < rows ? residual[node + l] : vec4_make((real)0, (real)0, (real)0);
      u[3 * l] = w[3 * l] * r.x;
      u[3 * l + 1] = w[3 * l + 1] * r.y;
      u[3 * l + 2] = w[3 * l + 2] * r.z;
    }
    if (done) continue;
    TEAM_BARRIER;
    multiply_factor(factor + (size_t)t * FACTOR_WORDS, groups, u, g, y);
    TEAM_BARRIER;
    multiply_transposed(groups, g, y, w, u);
    TEAM_BARRIER;
    TEAM_FOR(l, rows) result[node + l] = vec4_make(u[3 * l], u[3 * l + 1], u[3 * l + 2]);
  }
}

/* For a team that works on the rows of the blocks of one block of the next level; `own` holds their residuals. The sums
   of r over each block, and over all of them, become the residuals of the nodes on coarse levels. */
DEVICE_TEAM void sum_blocks(int t, int levels, int rows, int blocks, int first_block, int last_block,
                            GLOBAL const int *block_start, LOCAL const vec4 *own, LOCAL vec4 *sums, GLOBAL vec4 *r)
{
  const int first = block_start[first_block];
  if (levels < 2) return;
  TEAM_FOR(l, last_block - first_block) {
    const int end = block_start[first_block + l + 1] - first;
    int k;
    vec4 sum = vec4_make((real)0, (real)0, (real)0);
    for (k = block_start[first_block + l] - first; k < end; ++k) sum = vec4_axpy(sum, (real)1, own[k]);
    sums[l] = sum;
    r[rows + first_block + l] = sum;
  }
  TEAM_BARRIER;
  if (levels < 3) return;
  TEAM_FOR(l, 1) {
    vec4 sum = vec4_make((real)0, (real)0, (real)0);
    int k;
    for (k = 0; k < last_block - first_block; ++k) sum = vec4_axpy(sum, (real)1, sums[k]);
    r[rows + blocks + t] = sum;
  }
}

/* r of rows from vertices, and of coarse nodes. Clears CG_DONE. Team t: the blocks [group_start[t], group_start[t + 1])
   of the finest level, at most BLOCK_ROWS. */
KERNEL gather_block_residuals(int n, int levels, int rows, int blocks, GLOBAL const int *group_start,
                              GLOBAL const int *block_start, GLOBAL const int *order, int plain, int is_double,
                              GLOBAL const double *b64, GLOBAL const double *q64, GLOBAL const float *b32,
                              GLOBAL const float *q32, GLOBAL vec4 *r, GLOBAL double *scalar)
{
  TEAM_LOCAL(vec4, own, BLOCK_ROWS * BLOCK_ROWS);
  TEAM_LOCAL(vec4, sums, BLOCK_ROWS);
  FOR_EACH_TEAM_EARLY(t, n) {
    const int first_block = group_start[t], last_block = group_start[t + 1], first = block_start[first_block];
    AWAIT_LAUNCHES;
    TEAM_BARRIER;
    TEAM_FOR(l, block_start[last_block] - first) {
      own[l] = residual_of(order[first + l], plain, is_double, b64, q64, b32, q32);
      r[first + l] = own[l];
      if (first + l == 0) scalar[CG_DONE] = 0.0;
    }
    TEAM_BARRIER;
    sum_blocks(t, levels, rows, blocks, first_block, last_block, block_start, own, sums, r);
  }
}

/* Row i of p = z + beta p, s = w + beta s, x += alpha p, r -= alpha s; the first iteration has beta = 0 and reads no
   previous p, s and x. Returns r. */
DEVICE vec4 advance_row(int i, cg_step step, GLOBAL const vec4 *RESTRICT z, GLOBAL const vec4 *RESTRICT w,
                        GLOBAL vec4 *RESTRICT p, GLOBAL vec4 *RESTRICT s, GLOBAL vec4 *RESTRICT x,
                        GLOBAL vec4 *RESTRICT r)
{
  const int first = step.beta == 0.0;
  const real a = (real)step.alpha, b = (real)step.beta;
  const vec4 zi = LOAD_KEPT(z + i), wi = LOAD_KEPT(w + i), before = LOAD_KEPT(r + i);
  vec4 pi = zi, si = wi, xi = vec4_make((real)0, (real)0, (real)0), ri;
  if (!first) {
    const vec4 p0 = LOAD_KEPT(p + i), s0 = LOAD_KEPT(s + i);
    xi = LOAD_KEPT(x + i);
    pi = vec4_axpy(zi, b, p0);
    si = vec4_axpy(wi, b, s0);
  }
  ri = vec4_axpy(before, -a, si);
  STORE_KEPT(p + i, pi);
  STORE_KEPT(s + i, si);
  STORE_KEPT(x + i, vec4_axpy(xi, a, pi));
  STORE_KEPT(r + i, ri);
  return ri;
}

/* The same for `count` rows from `first` on; their r is also written to `own`. */
DEVICE_TEAM void advance_rows(int first, int count, cg_step step, GLOBAL const vec4 *RESTRICT z,
                              GLOBAL const vec4 *RESTRICT w, GLOBAL vec4 *RESTRICT p, GLOBAL vec4 *RESTRICT s,
                              GLOBAL vec4 *RESTRICT x, GLOBAL vec4 *RESTRICT r, LOCAL vec4 *own)
{
  int done = 0; /* rows */
#if LANES > 1
  const int begins = step.beta == 0.0;
  const real a = (real)step.alpha, b = (real)step.beta;
  for (; done + LANES / 4 <= count; done += LANES / 4) { /* zeros behind the three numbers of a row remain zeros */
    const int i = first + done;
    lanes pi = LANES_LOAD(GLOBAL lanes, (GLOBAL const real *)(z + i)), xi = LANES_ALL(lanes, (real)0),
          si = LANES_LOAD(GLOBAL lanes, (GLOBAL const real *)(w + i)),
          ri = LANES_LOAD(GLOBAL lanes, (GLOBAL const real *)(r + i));
    if (!begins) {
      pi = pi + b * LANES_LOAD(GLOBAL lanes, (GLOBAL const real *)(p + i));
      si = si + b * LANES_LOAD(GLOBAL lanes, (GLOBAL const real *)(s + i));
      xi = LANES_LOAD(GLOBAL lanes, (GLOBAL const real *)(x + i));
    }
    ri = ri + -a * si;
    LANES_STORE(GLOBAL lanes, (GLOBAL real *)(p + i), pi);
    LANES_STORE(GLOBAL lanes, (GLOBAL real *)(s + i), si);
    LANES_STORE(GLOBAL lanes, (GLOBAL real *)(x + i), xi + a * pi);
    LANES_STORE(GLOBAL lanes, (GLOBAL real *)(r + i), ri);
    LANES_STORE(LOCAL lanes, (LOCAL real *)(own + done), ri);
  }
#endif
  TEAM_FOR(l, count - done) own[done + l] = advance_row(first + done + l, step, z, w, p, s, x, r);
}

/* One iteration's scalars and vectors, and the residuals of coarse nodes. Teams as in
   gather_block_residuals. */
KERNEL cg_advance_blocks(int n, int levels, int rows, int blocks, GLOBAL const int *group_start,
                         GLOBAL const int *block_start, int partials, GLOBAL const double *partial, int most, int from,
                         int to, GLOBAL double *scalar, GLOBAL const vec4 *RESTRICT z, GLOBAL const vec4 *RESTRICT w,
                         GLOBAL vec4 *RESTRICT p, GLOBAL vec4 *RESTRICT s, GLOBAL vec4 *RESTRICT x,
                         GLOBAL vec4 *RESTRICT r)
{
  TEAM_LOCAL(double, products, 2 * CG_TEAM);
  TEAM_LOCAL(vec4, own_residuals, BLOCK_ROWS * BLOCK_ROWS);
  TEAM_LOCAL(vec4, sums, BLOCK_ROWS);
  FOR_EACH_TEAM_EARLY(t, n) {
    const int first_block = group_start[t], last_block = group_start[t + 1], first = block_start[first_block];
    LOCAL vec4 *RESTRICT own = TEAM_POINTER(vec4, own_residuals);
    cg_step step;
    AWAIT_LAUNCHES;
    step = next_step(t, partials, partial, most, from, to, scalar, products);
    if (!step.done) {
      advance_rows(first, block_start[last_block] - first, step, z, w, p, s, x, r, own);
      TEAM_BARRIER;
      sum_blocks(t, levels, rows, blocks, first_block, last_block, block_start, own, sums, r);
    }
  }
}

/* Places in z: of a row, and of its corrections by the coarse levels. A row that is not free has those of row 0. */
typedef struct {
  int row, block, group;
} row_places;

/* block: block of each row; parent: parent of each block. */
DEVICE row_places places_of(int row, int levels, int rows, int blocks, GLOBAL const int *block,
                            GLOBAL const int *parent)
{
  row_places p;
  p.row = p.block = p.group = max_int(row, 0);
  if (levels > 1) {
    const int own = block[p.row];
    p.block = rows + own;
    if (levels > 2) p.group = rows + blocks + parent[own];
  }
  return p;
}

/* z of a row with its corrections; all are read before the first sum. */
DEVICE vec4 corrected(row_places p, int levels, GLOBAL const vec4 *z)
{
  vec4 sum = z[p.row], of_block = sum, of_group = sum;
  if (levels > 1) of_block = z[p.block];
  if (levels > 2) of_group = z[p.group];
  if (levels > 1) sum = vec4_axpy(sum, (real)1, of_block);
  if (levels > 2) sum = vec4_axpy(sum, (real)1, of_group);
  return sum;
}

/* total = z with the corrections, for rows; then product = (along n n' + around I) sum_k w_k total_k of each term. n:
   rows_here and terms. */
KERNEL combine_levels(int n, int rows_here, int levels, int rows, int blocks, GLOBAL const int *RESTRICT block,
                      GLOBAL const int *RESTRICT parent, int at, GLOBAL const double *scalar,
                      GLOBAL const vec4 *RESTRICT z, GLOBAL const element_nodes *RESTRICT nodes,
                      GLOBAL const real *RESTRICT coefficient, GLOBAL vec4 *RESTRICT total,
                      GLOBAL vec4 *RESTRICT product)
{
  if (!BEGINS_EARLY && scalar[at + CG_DONE] != 0.0) return;
  FOR_EACH_EARLY(i, n) {
    int done;
    if (i < rows_here) {
      const row_places own = places_of(i, levels, rows, blocks, block, parent);
      vec4 sum;
      AWAIT_LAUNCHES;
      done = BEGINS_EARLY && scalar[at + CG_DONE] != 0.0;
      if (rows > FEW_ROWS && done) continue;
      sum = corrected(own, levels, z);
      if (!done) total[i] = sum;
    } else {
      GLOBAL const real *RESTRICT x = coefficient + 9 * (i - rows_here);
      element_nodes own = nodes[i - rows_here];
      vec4 normal = vec4_make(x[4], x[5], x[6]), s = vec4_make((real)0, (real)0, (real)0);
      row_places place[4];
      vec4 value[4];
      int c;
      for (c = 0; c < 4; ++c) place[c] = places_of(own.node[c], levels, rows, blocks, block, parent);
      AWAIT_LAUNCHES;
      done = BEGINS_EARLY && scalar[at + CG_DONE] != 0.0;
      if (rows > FEW_ROWS && done) continue;
      if (LANES == 1) /* loads do not wait for each other */
        for (c = 0; c < 4; ++c) value[c] = corrected(place[c], levels, z);
      if (done) continue;
      for (c = 0; c < 4; ++c)
        if (own.node[c] >= 0) s = vec4_axpy(s, x[c], LANES == 1 ? value[c] : corrected(place[c], levels, z));
      product[i - rows_here] =
          vec4_axpy(vec4_make(x[8] * s.x, x[8] * s.y, x[8] * s.z), x[7] * vec4_dot(normal, s), normal);
    }
  }
}

#endif
