/* SPDX-License-Identifier: Apache-2.0 */
/* The linear system in BCSR with 3x3 blocks: products, diagonal preconditioners, right-hand side and vectors on
   vertices. Scalars stay on the device (scalars.h). */
#ifndef CAMA_KERNELS_SYSTEM_LINEAR_SYSTEM_H
#define CAMA_KERNELS_SYSTEM_LINEAR_SYSTEM_H
#include "../dialect/dvec3.h"
#include "../dialect/lang.h"
#include "../dialect/vec3.h"
#include "../solver/scalars.h"
#include "term.h"

#define PRECONDITIONER_JACOBI 1
#define PRECONDITIONER_BLOCK_JACOBI 2

/* y = A x for a matrix of 3x3 blocks in BCSR form and what is kept beside it; rows of fixed vertices give zero. mass:
   [n] or none. With it, y = M x + sum A_ij (x_j - x_i), so that rounding is relative to differences; this needs rows
   that add up to zero apart from the masses, as those of elements do. drag: [n] diagonal blocks that do not, or none.
   term_count: number of terms that are not in the matrix; product: of each of them with x (term_products). n: rows, or
   with parts = 3 their components, which neighbours find side by side. */
KERNEL bcsr_multiply(int n, int parts, GLOBAL const int *row, GLOBAL const int *column, GLOBAL const mat3 *block,
                     GLOBAL const int *fixed, GLOBAL const real *mass, GLOBAL const mat3 *drag, int term_count,
                     GLOBAL const int *term_row, GLOBAL const int *term_incidence, GLOBAL const term *terms,
                     GLOBAL const vec3 *product, GLOBAL const vec3 *x, GLOBAL vec3 *y)
{
  FOR_EACH(item, n) {
    const int i = item / parts;
    const vec3 none = vec3_make((real)0, (real)0, (real)0), own = mass ? x[i] : none;
    int k, end = fixed[i] ? row[i] : row[i + 1];
    if (parts == 1) {
      vec3 sum = mass && !fixed[i] ? scale(mass[i], own) : none;
      for (k = row[i]; k < end; ++k) sum = add(sum, mat3_multiply(block[k], sub(x[column[k]], own)));
      if (drag && !fixed[i]) sum = add(sum, mat3_multiply(drag[i], x[i]));
      if (term_count && !fixed[i])
        sum = add_term_products(i, term_count, term_row, term_incidence, terms, product, sum);
      y[i] = sum;
    } else {
      const int c = item - 3 * i;
      real sum = mass && !fixed[i] ? mass[i] * component(own, c) : (real)0;
      for (k = row[i]; k < end; k += AT_ONCE(2)) {
        vec3 line[AT_ONCE(2)], there[AT_ONCE(2)];
        FOR_AT_ONCE(q, 2, end - k) {
          line[q] = block[k + q].row[c];
          there[q] = x[column[k + q]];
        }
        FOR_AT_ONCE(q, 2, end - k) sum += dot(line[q], sub(there[q], own));
      }
      if (drag && !fixed[i]) sum += dot(drag[i].row[c], x[i]);
      end = term_count && !fixed[i] ? term_row[i + 1] : 0;
      for (k = end > 0 ? term_row[i] : 0; k < end; k += AT_ONCE(4)) {
        int at[AT_ONCE(4)];
        real part[AT_ONCE(4)];
        FOR_AT_ONCE(q, 4, end - k) at[q] = term_incidence[k + q];
        FOR_AT_ONCE(q, 4, end - k)
          part[q] = terms[at[q] >> 2].weight[at[q] & 3] * ((GLOBAL const real *)product)[3 * (at[q] >> 2) + c];
        FOR_AT_ONCE(q, 4, end - k) sum += part[q];
      }
      ((GLOBAL real *)y)[item] = sum;
    }
  }
}

/* Where row i has its diagonal. */
DEVICE int diagonal_place(GLOBAL const int *row, GLOBAL const int *column, int i)
{
  int lo = row[i], hi = row[i + 1] - 1;
  while (lo < hi) {
    int middle = (lo + hi) / 2;
    if (column[middle] < i)
      lo = middle + 1;
    else
      hi = middle;
  }
  return lo;
}

KERNEL extract_diagonal(int n, GLOBAL const int *row, GLOBAL const int *column, GLOBAL const mat3 *block,
                        GLOBAL mat3 *diagonal)
{
  FOR_EACH(i, n) {
    diagonal[i] = block[diagonal_place(row, column, i)];
  }
}

KERNEL add_to_diagonal(int n, GLOBAL const int *row, GLOBAL const int *column, GLOBAL const mat3 *diagonal,
                       GLOBAL mat3 *block)
{
  FOR_EACH(i, n) {
    int at = diagonal_place(row, column, i);
    block[at] = mat3_add(block[at], diagonal[i]);
  }
}

/* Replaces diagonal blocks by the preconditioner. */
KERNEL invert_diagonal(int n, int kind, GLOBAL mat3 *diagonal)
{
  FOR_EACH(i, n) {
    mat3 d = diagonal[i], m = mat3_diagonal((real)1);
    if (kind == PRECONDITIONER_JACOBI) {
      m.row[0].x = (real)1 / d.row[0].x;
      m.row[1].y = (real)1 / d.row[1].y;
      m.row[2].z = (real)1 / d.row[2].z;
    } else if (kind == PRECONDITIONER_BLOCK_JACOBI) {
      m = mat3_inverse_spd(d);
    }
    diagonal[i] = m;
  }
}

/* b = dt f + M v, and of the terms, if any, the pushes and friction that holds (hold: one vector a term, or none). */
KERNEL make_right_side(int n, real time_step, GLOBAL const real *mass, GLOBAL const dvec3 *velocity,
                       GLOBAL const dvec3 *prescribed, GLOBAL const int *fixed, GLOBAL const vec3 *force,
                       int with_terms, GLOBAL const int *term_row, GLOBAL const int *term_incidence,
                       GLOBAL const term *terms, GLOBAL const vec3 *hold, GLOBAL vec3 *b)
{
  FOR_EACH(i, n) {
    vec3 sum = axpy(scale(mass[i], to_vec3(fixed[i] ? prescribed[i] : velocity[i])), time_step, force[i]);
    int k;
    if (with_terms) sum = add_term_pushes(i, term_row, term_incidence, terms, sum);
    if (with_terms && hold && !fixed[i])
      for (k = term_row[i]; k < term_row[i + 1]; ++k)
        sum = axpy(sum, terms[term_incidence[k] >> 2].weight[term_incidence[k] & 3], hold[term_incidence[k] >> 2]);
    b[i] = sum;
  }
}

/* The starting guess: v of free vertices, the prescribed velocity of fixed ones. n: all vertices. */
KERNEL start_solution(int n, GLOBAL const dvec3 *velocity, GLOBAL const dvec3 *prescribed, GLOBAL const int *fixed,
                      GLOBAL vec3 *x)
{
  FOR_EACH(i, n) {
    x[i] = to_vec3(fixed[i] ? prescribed[i] : velocity[i]);
  }
}

/* The solved velocities become the next ones; fixed vertices keep their prescribed ones. n: cloth vertices. */
KERNEL store_velocity(int n, GLOBAL const int *fixed, GLOBAL const vec3 *x, GLOBAL dvec3 *velocity_next)
{
  FOR_EACH(i, n) {
    if (!fixed[i]) velocity_next[i] = to_dvec3(x[i]);
  }
}

/* The solved changes of velocity are added; fixed vertices keep their prescribed velocity. n: cloth vertices. */
KERNEL add_velocity(int n, GLOBAL const int *fixed, GLOBAL const vec3 *x, GLOBAL dvec3 *velocity_next)
{
  FOR_EACH(i, n) {
    if (!fixed[i]) velocity_next[i] = dadd(velocity_next[i], to_dvec3(x[i]));
  }
}

/* Velocity after this step from forces other than contact, with the elastic response left out: v + dt f / m. n: all
   vertices. */
KERNEL free_velocities(int n, int rows, real time_step, GLOBAL const real *mass, GLOBAL const int *fixed,
                       GLOBAL const dvec3 *velocity, GLOBAL const dvec3 *prescribed, GLOBAL const vec3 *force,
                       GLOBAL dvec3 *free_velocity)
{
  FOR_EACH(i, n) {
    free_velocity[i] =
        i < rows && !fixed[i] ? daxpy(velocity[i], (double)(time_step / mass[i]), to_dvec3(force[i])) : prescribed[i];
  }
}

#define SUM_ROWS 128

/* r = b - q on free rows, or b without q; d = what gravity does in a step on free rows, zero elsewhere. n: vertices. */
KERNEL falling_direction(int n, int rows, double time_step, GLOBAL const dvec3 *gravity, GLOBAL const int *fixed,
                         GLOBAL const vec3 *b, GLOBAL const vec3 *q, GLOBAL vec3 *r, GLOBAL vec3 *d)
{
  FOR_EACH(i, n) {
    const vec3 none = vec3_make((real)0, (real)0, (real)0);
    const int free = i < rows && !fixed[i];
    if (i < rows) r[i] = !free ? none : q ? sub(b[i], q[i]) : b[i];
    d[i] = free ? to_vec3(dscale(time_step, gravity[0])) : none;
  }
}

/* r = b - q on free rows; partial[3 t ...] = the sum of r over the SUM_ROWS rows of team t. */
KERNEL sum_residuals(int n, int rows, GLOBAL const int *fixed, GLOBAL const vec3 *b, GLOBAL const vec3 *q,
                     GLOBAL vec3 *r, GLOBAL double *partial)
{
  TEAM_LOCAL(double, sum, 3 * SUM_ROWS);
  FOR_EACH_TEAM(t, n) {
    TEAM_BARRIER;
    TEAM_FOR(l, SUM_ROWS) {
      const int i = t * SUM_ROWS + l;
      vec3 own = vec3_make((real)0, (real)0, (real)0);
      if (i < rows) {
        if (!fixed[i]) own = sub(b[i], q[i]);
        r[i] = own;
      }
      sum[l] = (double)own.x;
      sum[SUM_ROWS + l] = (double)own.y;
      sum[2 * SUM_ROWS + l] = (double)own.z;
    }
    tree_sums(SUM_ROWS, 3, sum);
    TEAM_FOR(c, 3) partial[3 * t + c] = sum[c * SUM_ROWS];
  }
}

/* d = the sum of the `partials` vectors in `partial` on every free row, zero elsewhere. Teams of SUM_ROWS of the
   `vertices`. */
KERNEL uniform_direction(int n, int vertices, int rows, int partials, GLOBAL const double *partial,
                         GLOBAL const int *fixed, GLOBAL vec3 *d)
{
  TEAM_LOCAL(double, sum, 3 * SUM_ROWS);
  FOR_EACH_TEAM(t, n) {
    TEAM_BARRIER;
    sum_of_teams(SUM_ROWS, 3, partials, partial, sum);
    TEAM_FOR(l, SUM_ROWS) {
      const int i = t * SUM_ROWS + l;
      vec3 own = vec3_make((real)0, (real)0, (real)0);
      if (i < rows && !fixed[i]) own = vec3_make((real)sum[0], (real)sum[SUM_ROWS], (real)sum[2 * SUM_ROWS]);
      if (i < vertices) d[i] = own;
    }
  }
}

/* partial[2 t], partial[2 t + 1] = r'd and d'q over the SUM_ROWS rows of team t. */
KERNEL direction_products(int n, int rows, GLOBAL const vec3 *r, GLOBAL const vec3 *d, GLOBAL const vec3 *q,
                          GLOBAL double *partial)
{
  TEAM_LOCAL(double, sum, 2 * SUM_ROWS);
  FOR_EACH_TEAM(t, n) {
    TEAM_BARRIER;
    TEAM_FOR(l, SUM_ROWS) {
      const int i = t * SUM_ROWS + l;
      sum[l] = i < rows ? ddot(to_dvec3(r[i]), to_dvec3(d[i])) : 0.0;
      sum[SUM_ROWS + l] = i < rows ? ddot(to_dvec3(d[i]), to_dvec3(q[i])) : 0.0;
    }
    tree_sums(SUM_ROWS, 2, sum);
    TEAM_FOR(c, 2) partial[2 * t + c] = sum[c * SUM_ROWS];
  }
}

/* x += alpha d, r -= alpha q with alpha = r'd / d'q, or 0 where d'q is not positive; an alpha that differs from 1 only
   by the rounding of its sums is set to 1, whatever else is in the scene. q = A d. Teams of SUM_ROWS rows. */
KERNEL move_along(int n, int rows, int partials, GLOBAL const double *partial, GLOBAL const vec3 *d,
                  GLOBAL const vec3 *q, GLOBAL vec3 *x, GLOBAL vec3 *r)
{
  TEAM_LOCAL(double, sum, 2 * SUM_ROWS);
  FOR_EACH_TEAM(t, n) {
    TEAM_BARRIER;
    sum_of_teams(SUM_ROWS, 2, partials, partial, sum);
    TEAM_FOR(l, SUM_ROWS) {
      const int i = t * SUM_ROWS + l;
      double alpha = sum[SUM_ROWS] > 0.0 ? sum[0] / sum[SUM_ROWS] : 0.0;
      if (fabs(alpha - 1.0) < 1e-12) alpha = 1.0;
      if (i < rows) {
        x[i] = axpy(x[i], (real)alpha, d[i]);
        r[i] = axpy(r[i], -(real)alpha, q[i]);
      }
    }
  }
}

#endif
