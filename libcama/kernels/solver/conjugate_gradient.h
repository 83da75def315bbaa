/* SPDX-License-Identifier: Apache-2.0 */
/* The conjugate gradient method with one reduction an iteration (Chronopoulos and Gear 1989) on a sliced matrix; its
   preconditioner is in schwarz.h. Rows are free vertices. */
#ifndef CAMA_KERNELS_SOLVER_CONJUGATE_GRADIENT_H
#define CAMA_KERNELS_SOLVER_CONJUGATE_GRADIENT_H
#include "../dialect/caching.h"
#include "../dialect/lanes.h"
#include "../dialect/lang.h"
#include "../dialect/vec3.h"
#include "../system/incidence.h"
#include "../system/slices.h"
#include "../system/term.h"
#include "scalars.h"

#define ROW_PARTS 2     /* members of a team that share a row, each with every second entry of it */

/* Vectors of the solve: three numbers and a zero, so that one load reads them. */
typedef struct ALIGNED(16) {
  real x, y, z, w;
} vec4;

LANES_TYPE(real, lanes);
LANES_GATHER(real, lanes, vec4)
#if LANES > 1
LANES_COLUMNS(real, lanes)
#endif

DEVICE vec4 vec4_make(real x, real y, real z)
{
  vec4 v;
  v.x = x;
  v.y = y;
  v.z = z;
  v.w = (real)0;
  return v;
}
DEVICE vec4 vec4_axpy(vec4 v, real a, vec4 w) { return vec4_make(v.x + a * w.x, v.y + a * w.y, v.z + a * w.z); }
DEVICE real vec4_dot(vec4 v, vec4 w) { return v.x * w.x + v.y * w.y + v.z * w.z; }
DEVICE double vec4_double_dot(vec4 v, vec4 w)
{
  return (double)v.x * (double)w.x + (double)v.y * (double)w.y + (double)v.z * (double)w.z;
}

/* Scalars of the conjugate gradient method with one reduction. */
#define CG_GAMMA 0       /* r' z */
#define CG_ALPHA 1
#define CG_GOAL 2        /* at which r' z ends the solve */
#define CG_DONE 3        /* 1: the solve has ended */
#define CG_BROKEN 4      /* 1: not positive definite, or not finite */
#define CG_ITERATIONS 5
#define CG_START 6       /* r' z at the start */
#define CG_FORCES 7      /* f' P f of the forces without penalties */
#define CG_INNER 8       /* r' z that the working precision can reach from this start */
#define CG_COUNT 9
#define CG_TEAM 128     /* members of a team, so few that all teams run at once */
#define CG_ROWS 256      /* rows of the vectors that a team advances */

#define CG_MEASURE_FORCES 0
#define CG_MEASURE_START 1  /* sets the goal */
#define CG_MEASURE_CHECK 2  /* keeps the goal: the residual was computed afresh */

/* Starts from a residual whose products are in `partial`. goal: tolerance^2. slack: upper bound of the start that the
   goal is relative to, over the forces: a tolerance relative to huge penalties would leave gravity unsolved. rounding:
   lower bound of the goal, over slack times the forces, for a solution that is right from the start. inner: smallest
   r'z, relative to this start, that the working precision can reach. One team. */
KERNEL cg_start(int n, int mode, int partials, GLOBAL const double *partial, double goal, double slack, double rounding,
                double inner, GLOBAL double *scalar)
{
  TEAM_LOCAL(double, sums, 2 * CG_TEAM);
  FOR_EACH_TEAM(t, n) {
    sum_of_teams(CG_TEAM, 2, partials, partial, sums);
    TEAM_FOR(l, 1) {
      double gamma = sums[0], forces = scalar[CG_FORCES];
      if (mode == CG_MEASURE_FORCES) {
        scalar[CG_FORCES] = gamma;
      } else {
        if (mode == CG_MEASURE_START) {
          scalar[CG_START] = gamma;
          scalar[CG_GOAL] = forces > 0.0
                                ? max_double(goal * min_double(gamma, slack * forces), rounding * slack * forces)
                                : goal * gamma;
          scalar[CG_ITERATIONS] = 0.0;
        }
        scalar[CG_GAMMA] = 0.0;
        scalar[CG_INNER] = inner * gamma;
        scalar[CG_BROKEN] = 0.0;
      }
      scalar[CG_DONE] = 0.0;
    }
  }
}

typedef struct {
  double alpha, beta;
  int done;
} cg_step;

/* alpha and beta of one iteration from the partial sums; every team computes them for itself. The scalars at `from` are
   updated to those at `to`. */
DEVICE_TEAM cg_step next_step(int t, int partials, GLOBAL const double *partial, int most, int from, int to,
                              GLOBAL double *scalar, LOCAL double *sums)
{
  double before = scalar[from + CG_GAMMA], alpha = scalar[from + CG_ALPHA], done = scalar[from + CG_DONE],
         broken = scalar[from + CG_BROKEN];
  double iterations = scalar[from + CG_ITERATIONS], least = max_double(scalar[from + CG_GOAL], scalar[from + CG_INNER]);
  cg_step step;
  step.beta = 0.0;
  TEAM_BARRIER;
  sum_of_teams(CG_TEAM, 2, partials, partial, sums); /* at once, so that it does not wait for `done` */
  if (done == 0.0) {
    double gamma, denominator;
    gamma = sums[0];
    denominator = sums[CG_TEAM];
    step.beta = before > 0.0 ? gamma / before : 0.0;
    if (before > 0.0) denominator -= step.beta * gamma / alpha;
    alpha = gamma / denominator;
    if (!(gamma >= 0.0) || !(gamma < 1e300))
      done = broken = 1.0;
    else if (gamma <= least || iterations >= (double)most)
      done = 1.0;
    else if (!(denominator > 0.0))
      done = broken = 1.0;
    else
      iterations += 1.0;
    before = gamma;
  }
  if (t == 0)
    TEAM_FOR(l, 1) {
      scalar[to + CG_GAMMA] = before;
      scalar[to + CG_ALPHA] = alpha;
      scalar[to + CG_DONE] = done;
      scalar[to + CG_BROKEN] = broken;
      scalar[to + CG_ITERATIONS] = iterations;
      scalar[to + CG_GOAL] = scalar[from + CG_GOAL];
      scalar[to + CG_INNER] = scalar[from + CG_INNER];
      scalar[to + CG_START] = scalar[from + CG_START];
      scalar[to + CG_FORCES] = scalar[from + CG_FORCES];
    }
  step.alpha = alpha;
  step.done = done != 0.0;
  return step;
}

/* With a diagonal preconditioner all vectors but z are stored in columns: all x, all y, all z, `component_stride`
   numbers from each other, so that neighbours read neighbours. With the Schwarz preconditioner they are rows of vec4
   (component_stride = 0). */
DEVICE vec4 load_row(GLOBAL const real *v, int component_stride, int i)
{
  if (component_stride == 0) return LOAD_KEPT((GLOBAL const vec4 *)v + i);
  return vec4_make(LOAD_KEPT(v + i), LOAD_KEPT(v + component_stride + i), LOAD_KEPT(v + 2 * component_stride + i));
}
DEVICE void store_row(GLOBAL real *v, int component_stride, int i, vec4 own)
{
  if (component_stride == 0) {
    STORE_KEPT((GLOBAL vec4 *)v + i, own);
  } else {
    STORE_KEPT(v + i, own.x);
    STORE_KEPT(v + component_stride + i, own.y);
    STORE_KEPT(v + 2 * component_stride + i, own.z);
  }
}

/* P of a row: its diagonal (block_rows = 1) in the first row, or a block (block_rows = 3); stored in columns. */
typedef struct {
  vec4 row[3];
} row_inverse;
DEVICE row_inverse load_inverse(int i, int block_rows, int component_stride, GLOBAL const real *RESTRICT inverse)
{
  row_inverse own;
  own.row[0] = load_row(inverse, component_stride, i);
  own.row[1] = own.row[2] = own.row[0];
  if (block_rows == 3) {
    own.row[1] = load_row(inverse + 3 * (size_t)component_stride, component_stride, i);
    own.row[2] = load_row(inverse + 6 * (size_t)component_stride, component_stride, i);
  }
  return own;
}
DEVICE vec4 apply_inverse(int block_rows, row_inverse own, vec4 r)
{
  if (block_rows == 1) return vec4_make(own.row[0].x * r.x, own.row[0].y * r.y, own.row[0].z * r.z);
  return vec4_make(vec4_dot(own.row[0], r), vec4_dot(own.row[1], r), vec4_dot(own.row[2], r));
}

/* One iteration's scalars and vectors, and z = P r. */
KERNEL_OF(CG_TEAM, 4)
cg_advance(int n, int rows, int component_stride, int block_rows, GLOBAL const real *RESTRICT inverse, int partials,
           GLOBAL const double *partial, int most, int from, int to, GLOBAL double *scalar, GLOBAL vec4 *RESTRICT z,
           GLOBAL const real *RESTRICT w, GLOBAL real *RESTRICT p, GLOBAL real *RESTRICT s, GLOBAL real *RESTRICT x,
           GLOBAL real *RESTRICT r)
{
  TEAM_LOCAL(double, sums, 2 * CG_TEAM);
  FOR_EACH_TEAM(t, n) {
    const int begin = t * CG_ROWS, count = min_int(rows - begin, CG_ROWS);
    cg_step step = next_step(t, partials, partial, most, from, to, scalar, sums);
    const int first = step.beta == 0.0;
    const real a = (real)step.alpha, b = (real)step.beta;
    if (!step.done)
      TEAM_FOR(l, count) {
        const int i = begin + l;
        const row_inverse own = load_inverse(i, block_rows, component_stride, inverse);
        vec4 ri = load_row(r, component_stride, i), si = load_row(w, component_stride, i),
             xi = vec4_make((real)0, (real)0, (real)0);
        vec4 pi = apply_inverse(block_rows, own, ri); /* z */
        if (!first) {
          const vec4 p0 = load_row(p, component_stride, i), s0 = load_row(s, component_stride, i);
          xi = load_row(x, component_stride, i);
          pi = vec4_axpy(pi, b, p0);
          si = vec4_axpy(si, b, s0);
        }
        ri = vec4_axpy(ri, -a, si);
        store_row(p, component_stride, i, pi);
        store_row(s, component_stride, i, si);
        store_row(x, component_stride, i, vec4_axpy(xi, a, pi));
        store_row(r, component_stride, i, ri);
        pi = apply_inverse(block_rows, own, ri);
        STORE_KEPT(z + i, pi);
      }
  }
}

/* z = P r with P as in cg_advance. n: rows. */
KERNEL apply_diagonal(int n, int component_stride, int block_rows, GLOBAL const real *RESTRICT inverse,
                      GLOBAL const real *RESTRICT r, GLOBAL vec4 *RESTRICT z)
{
  FOR_EACH(i, n)
    z[i] = apply_inverse(block_rows, load_inverse(i, block_rows, component_stride, inverse),
                         load_row(r, component_stride, i));
}

#define CG_MULTIPLY_TEAM (ROW_PARTS * TEAM_ROWS)

/* A team's blocks are read part by part, at strides that no hardware prefetcher predicts: those of the next team are
   prefetched meanwhile. */
#define BLOCK_PREFETCH(v)                                                       \
  do {                                                                          \
    int number;                                                                 \
    for (number = 0; number < 9; ++number) PREFETCH((v) + number * SLICE_ROWS); \
  } while (0)
#define FIRST_OF_ENTRY(value, e, lane) ((value) + (size_t)SLICE_ROWS * 9 * (e) + (lane))
#define BLOCK_NUMBER(v, c) LANES_LOAD_ONCE(GLOBAL lanes, (v) + (c) * SLICE_ROWS)
#define LOAD_BLOCK(q, v)                                                          \
  do {                                                                            \
    int number;                                                                   \
    for (number = 0; number < 9; ++number) (q)[number] = BLOCK_NUMBER(v, number); \
  } while (0)

#define READS_AHEAD (AT_ONCE(2) > 1) /* on GPUs */

/* w = A z with the terms; partial[2 t], partial[2 t + 1] = r'z and z'w over the TEAM_ROWS rows of team t. entry_weight:
   weights of the terms' entries. Loads do not wait for each other: two entries are read at once, all their numbers
   before the first product, on a GPU those of the first two before the launches that this one waits for; where a row is
   a thread, columns are read two entries early, since the vectors at these columns are loaded after them. */
KERNEL_OF(CG_MULTIPLY_TEAM, 3)
cg_multiply(int n, int rows, GLOBAL const int *slice_start, GLOBAL const int *slice_row,
            GLOBAL const int *RESTRICT column, GLOBAL const real *RESTRICT value, int terms, GLOBAL const int *order,
            GLOBAL const int *term_row, GLOBAL const int *term_entry, GLOBAL const real *entry_weight,
            GLOBAL const vec4 *RESTRICT product, int at, GLOBAL const double *scalar, GLOBAL const vec4 *RESTRICT z,
            int component_stride, GLOBAL const real *RESTRICT r, GLOBAL real *RESTRICT w, GLOBAL double *partial)
{
  TEAM_LOCAL(real, own_sum, ROW_PARTS * 3 * TEAM_ROWS);
  TEAM_LOCAL(double, own_products, 2 * TEAM_ROWS);
  if (!BEGINS_EARLY && scalar[at + CG_DONE] != 0.0) return;
  FOR_EACH_TEAM_EARLY(t, n) {
    LOCAL real *RESTRICT sum = TEAM_POINTER(real, own_sum);
    LOCAL double *RESTRICT products = TEAM_POINTER(double, own_products);
    TEAM_BARRIER;
    TEAM_FOR_LANES(item, ROW_PARTS * TEAM_ROWS) {
      lanes x = LANES_ALL(lanes, (real)0), y = x, u = x;
      int part = item / TEAM_ROWS, first = t * TEAM_ROWS + item - part * TEAM_ROWS, s = first / SLICE_ROWS;
      int lane = first - s * SLICE_ROWS, e, end, early = 0, early1 = 0, place = 0, term_begin = 0, term_end = 0;
      if (first < rows) {
        const size_t ahead = first + TEAM_ROWS < rows
                                 ? (size_t)SLICE_ROWS * 9 * (slice_start[s + TEAM_ROWS / SLICE_ROWS] - slice_start[s])
                                 : 0;
        lanes p[9], q[9];
        vec4 a = vec4_make((real)0, (real)0, (real)0), b = a;
        end = slice_start[s + 1];
        e = slice_start[s] + part;
        if (LANES == 1) {
          place = slice_row[first];
          if (terms) {
            term_begin = term_row[order[place]] + part;
            term_end = term_row[order[place] + 1];
          }
          if (e < end) {
            early = LOAD_ONCE(column + (size_t)SLICE_ROWS * e + lane);
            early1 = LOAD_ONCE(column + (size_t)SLICE_ROWS * (e + ROW_PARTS < end ? e + ROW_PARTS : e) + lane);
          }
        }
        if (READS_AHEAD && e < end) {
          LOAD_BLOCK(p, FIRST_OF_ENTRY(value, e, lane));
          LOAD_BLOCK(q, FIRST_OF_ENTRY(value, e + ROW_PARTS < end ? e + ROW_PARTS : e, lane));
        }
        AWAIT_LAUNCHES;
        if (LANES == 1 && e < end) {
          a = LOAD_KEPT(z + early);
          b = LOAD_KEPT(z + early1);
        }
        if (BEGINS_EARLY && scalar[at + CG_DONE] != 0.0) continue;
        while (e < end) {
          const int next = e + ROW_PARTS < end ? ROW_PARTS : 0, then = e + 2 * ROW_PARTS;
          lanes ax, ay, az, bx, by, bz;
          if (LANES == 1) {
            if (then < end) {
              early = LOAD_ONCE(column + (size_t)SLICE_ROWS * then + lane);
              early1 =
                  LOAD_ONCE(column + (size_t)SLICE_ROWS * (then + ROW_PARTS < end ? then + ROW_PARTS : then) + lane);
            }
            ax = LANES_ALL(lanes, a.x);
            ay = LANES_ALL(lanes, a.y);
            az = LANES_ALL(lanes, a.z);
            bx = LANES_ALL(lanes, b.x);
            by = LANES_ALL(lanes, b.y);
            bz = LANES_ALL(lanes, b.z);
          } else {
            GLOBAL const int *RESTRICT c = column + (size_t)SLICE_ROWS * e + lane;
            gather_lanes(z, c, &ax, &ay, &az);
            gather_lanes(z, c + SLICE_ROWS * next, &bx, &by, &bz);
          }
          if (!next) bx = by = bz = LANES_ALL(lanes, (real)0);
          BLOCK_PREFETCH(FIRST_OF_ENTRY(value, e, lane) + ahead);
          BLOCK_PREFETCH(FIRST_OF_ENTRY(value, e + next, lane) + ahead);
          if (!READS_AHEAD) {
            LOAD_BLOCK(p, FIRST_OF_ENTRY(value, e, lane));
            LOAD_BLOCK(q, FIRST_OF_ENTRY(value, e + next, lane));
          }
          x += p[0] * ax + p[1] * ay + p[2] * az + (q[0] * bx + q[1] * by + q[2] * bz);
          y += p[3] * ax + p[4] * ay + p[5] * az + (q[3] * bx + q[4] * by + q[5] * bz);
          u += p[6] * ax + p[7] * ay + p[8] * az + (q[6] * bx + q[7] * by + q[8] * bz);
          e = then;
          if (e < end) {
            if (LANES == 1) {
              a = LOAD_KEPT(z + early);
              b = LOAD_KEPT(z + early1);
            }
            if (READS_AHEAD) {
              LOAD_BLOCK(p, FIRST_OF_ENTRY(value, e, lane));
              LOAD_BLOCK(q, FIRST_OF_ENTRY(value, e + ROW_PARTS < end ? e + ROW_PARTS : e, lane));
            }
          }
        }
      }
      if (LANES > 1 && first < rows) {
        LOCAL real *own = sum + 3 * part * TEAM_ROWS + first - t * TEAM_ROWS;
        LANES_STORE(LOCAL lanes, own, x);
        LANES_STORE(LOCAL lanes, own + TEAM_ROWS, y);
        LANES_STORE(LOCAL lanes, own + 2 * TEAM_ROWS, u);
      }
      if (LANES == 1 || terms)
        FOR_LANES(q)
          if (first + q < rows) {
            const int i = LANES == 1 ? place : slice_row[first + q];
            LOCAL real *own = sum + 3 * part * TEAM_ROWS + (LANES == 1 ? i : first + q) - t * TEAM_ROWS;
            vec4 all = vec4_make(LANE(x, q), LANE(y, q), LANE(u, q));
            if (terms) {
              int k = term_begin;
              if (LANES > 1) {
                k = term_row[order[i]] + part;
                term_end = term_row[order[i] + 1];
                if (k >= term_end) continue;
              }
              for (; k < term_end; k += AT_ONCE(4) * ROW_PARTS) {
                int term_at[AT_ONCE(4)];
                real weight[AT_ONCE(4)];
                vec4 own_product[AT_ONCE(4)];
                FOR_AT_ONCE(b, 4, (term_end - k + ROW_PARTS - 1) / ROW_PARTS) {
                  term_at[b] = term_entry[k + ROW_PARTS * b];
                  weight[b] = entry_weight[k + ROW_PARTS * b];
                }
                FOR_AT_ONCE(b, 4, (term_end - k + ROW_PARTS - 1) / ROW_PARTS) own_product[b] = product[term_at[b] >> 2];
                FOR_AT_ONCE(b, 4, (term_end - k + ROW_PARTS - 1) / ROW_PARTS)
                  all = vec4_axpy(all, weight[b], own_product[b]);
              }
            }
            own[0] = all.x;
            own[TEAM_ROWS] = all.y;
            own[2 * TEAM_ROWS] = all.z;
          }
    }
    AWAIT_LAUNCHES;
    if (BEGINS_EARLY && scalar[at + CG_DONE] != 0.0) continue;
    TEAM_BARRIER;
    TEAM_FOR_LANES(l, TEAM_ROWS) {
      const int first = t * TEAM_ROWS + l; /* the first of LANES places, or with one lane the row */
      LOCAL const real *own = sum + l;
      if (LANES == 1) {
        products[l] = products[TEAM_ROWS + l] = 0.0;
        if (first < rows) {
          const vec4 zi = LOAD_KEPT(z + first), ri = load_row(r, component_stride, first);
          const vec4 all = vec4_make(own[0] + own[3 * TEAM_ROWS], own[TEAM_ROWS] + own[4 * TEAM_ROWS],
                                     own[2 * TEAM_ROWS] + own[5 * TEAM_ROWS]);
          store_row(w, component_stride, first, all);
          products[l] = vec4_double_dot(ri, zi);
          products[TEAM_ROWS + l] = vec4_double_dot(all, zi);
        }
      } else if (first < rows) {
        const int count = min_int(rows - first, LANES);
        const lanes x = LANES_LOAD(LOCAL lanes, own) + LANES_LOAD(LOCAL lanes, own + 3 * TEAM_ROWS),
                    y = LANES_LOAD(LOCAL lanes, own + TEAM_ROWS) + LANES_LOAD(LOCAL lanes, own + 4 * TEAM_ROWS),
                    u = LANES_LOAD(LOCAL lanes, own + 2 * TEAM_ROWS) + LANES_LOAD(LOCAL lanes, own + 5 * TEAM_ROWS);
        lanes zx, zy, zz, rx, ry, rz;
        double_lanes dx, dy, dz, rz_products, wz_products;
        gather_lanes(z, slice_row + first, &zx, &zy, &zz);
        dx = LANES_TO(double, double_lanes, zx);
        dy = LANES_TO(double, double_lanes, zy);
        dz = LANES_TO(double, double_lanes, zz);
        if (component_stride == 0) {
          gather_lanes((GLOBAL const vec4 *)r, slice_row + first, &rx, &ry, &rz);
          scatter_lanes((GLOBAL vec4 *)w, slice_row + first, count, x, y, u);
        } else {
          real row[3][LANES];
          FOR_LANES(q) {
            const vec4 ri = load_row(r, component_stride, slice_row[first + q]);
            row[0][q] = ri.x;
            row[1][q] = ri.y;
            row[2][q] = ri.z;
            if (q < count)
              store_row(w, component_stride, slice_row[first + q], vec4_make(LANE(x, q), LANE(y, q), LANE(u, q)));
          }
          rx = LANES_LOAD(lanes, row[0]);
          ry = LANES_LOAD(lanes, row[1]);
          rz = LANES_LOAD(lanes, row[2]);
        }
        rz_products = LANES_TO(double, double_lanes, rx) * dx + LANES_TO(double, double_lanes, ry) * dy +
                      LANES_TO(double, double_lanes, rz) * dz;
        wz_products = LANES_TO(double, double_lanes, x) * dx + LANES_TO(double, double_lanes, y) * dy +
                      LANES_TO(double, double_lanes, u) * dz;
        FOR_LANES(q) {
          const int i = q < count ? slice_row[first + q] - t * TEAM_ROWS : l + q;
          products[i] = q < count ? LANE(rz_products, q) : 0.0;
          products[TEAM_ROWS + i] = q < count ? LANE(wz_products, q) : 0.0;
        }
      } else {
        FOR_LANES(q) products[l + q] = products[TEAM_ROWS + l + q] = 0.0;
      }
    }
    tree_sums(TEAM_ROWS, 2, products);
    TEAM_FOR(l, 1) {
      partial[2 * t] = products[0];
      partial[2 * t + 1] = products[TEAM_ROWS];
    }
  }
}

/* b - q of vertex v, or b with plain = 1. */
DEVICE vec4 residual_of(int v, int plain, int is_double, GLOBAL const double *b64, GLOBAL const double *q64,
                        GLOBAL const float *b32, GLOBAL const float *q32)
{
  real r[3];
  int c, at = 3 * v;
  for (c = 0; c < 3; ++c, ++at)
    r[c] = is_double ? (real)(plain ? b64[at] : b64[at] - q64[at]) : (real)(plain ? b32[at] : b32[at] - q32[at]);
  return vec4_make(r[0], r[1], r[2]);
}

/* r of rows from vertices. Clears CG_DONE. */
KERNEL gather_residual(int n, GLOBAL const int *order, int component_stride, int plain, int is_double,
                       GLOBAL const double *b64, GLOBAL const double *q64, GLOBAL const float *b32,
                       GLOBAL const float *q32, GLOBAL real *r, GLOBAL double *scalar)
{
  FOR_EACH(i, n) {
    if (i == 0) scalar[CG_DONE] = 0.0;
    store_row(r, component_stride, i, residual_of(order[i], plain, is_double, b64, q64, b32, q32));
  }
}

/* Adds the correction to the solution of vertices. */
KERNEL add_solution(int n, GLOBAL const int *order, int component_stride, GLOBAL const real *x, int is_double,
                    GLOBAL double *solution64, GLOBAL float *solution32)
{
  FOR_EACH(i, n) {
    int at = 3 * order[i];
    vec4 v = load_row(x, component_stride, i);
    if (is_double) {
      solution64[at] += (double)v.x;
      solution64[at + 1] += (double)v.y;
      solution64[at + 2] += (double)v.z;
    } else {
      solution32[at] += (float)v.x;
      solution32[at + 1] += (float)v.y;
      solution32[at + 2] += (float)v.z;
    }
  }
}

#endif
