/* SPDX-License-Identifier: Apache-2.0 */
/* The values of the matrix in BCSR with 3x3 blocks (paper, section 3.2, Algorithm 1, lines 18-23), and the naive
   assembly that the paper compares with. pattern.h makes the pattern. */
#ifndef CAMA_KERNELS_SYSTEM_ASSEMBLY_H
#define CAMA_KERNELS_SYSTEM_ASSEMBLY_H
#include "../dialect/dvec3.h"
#include "../dialect/lang.h"
#include "../dialect/vec3.h"
#include "../elements/bending.h"
#include "../elements/elasticity.h"
#include "incidence.h"
#include "pattern.h"
#include "term.h"

/* location(s, t) of Algorithm 1, line 21. */
DEVICE int locate(GLOBAL const int *row, GLOBAL const int *column, int s, int t)
{
  int lo = row[s], hi = row[s + 1] - 1;
  while (lo < hi) {
    int middle = (lo + hi) / 2;
    if (column[middle] < t)
      lo = middle + 1;
    else
      hi = middle;
  }
  return lo;
}

/* The rows of M: zero except for the masses on the diagonal. */
KERNEL set_mass_rows(int n, GLOBAL const int *row, GLOBAL const int *column, GLOBAL const real *mass,
                     GLOBAL mat3 *block)
{
  FOR_EACH(i, n) {
    int k;
    for (k = row[i]; k < row[i + 1]; ++k) block[k] = column[k] == i ? mat3_diagonal(mass[i]) : mat3_zero();
  }
}

/* Returns sum plus the block of a source (pattern.h). terms: 0 if there are none. */
DEVICE mat3 add_source(mat3 sum, int source, GLOBAL const real *mass, int triangles,
                       GLOBAL const triangle_factor *triangle, int hinges, GLOBAL const hinge_factor *hinge,
                       GLOBAL const term *terms, int form)
{
  int e = source >> 4, a = (source >> 2) & 3, b = source & 3;
  if (source < 0) return mat3_add(sum, mat3_diagonal(mass[-1 - source]));
  if (e < triangles) return mat3_add(sum, triangle_block(triangle[e], a, b));
  e -= triangles;
  if (terms && e >= hinges) return mat3_add(sum, term_block(terms[e - hinges], form, a, b));
  return mat3_add_outer(sum, hinge[e].coefficient, hinge[e].gradient[a], hinge[e].gradient[b]);
}

/* Data filling without atomics: each block adds up its own sources in order. */
KERNEL gather_blocks(int n, GLOBAL const int *start, GLOBAL const int *source, GLOBAL const real *mass, int triangles,
                     GLOBAL const triangle_factor *triangle, GLOBAL const hinge_factor *hinge, GLOBAL mat3 *block)
{
  FOR_EACH(i, n) {
    const int end = start[i + 1];
    mat3 sum = mat3_zero();
    int k = start[i], next = k < end ? source[k] : 0;
    for (; k < end; ++k) {
      const int own = AT_ONCE(2) > 1 ? next : source[k];
      if (AT_ONCE(2) > 1 && k + 1 < end) next = source[k + 1]; /* before what `own` points to */
      sum = add_source(sum, own, mass, triangles, triangle, 0, hinge, 0, 0);
    }
    block[i] = sum;
  }
}
KERNEL gather_blocks_and_terms(int n, GLOBAL const int *start, GLOBAL const int *source, GLOBAL const real *mass,
                               int triangles, GLOBAL const triangle_factor *triangle, int hinges,
                               GLOBAL const hinge_factor *hinge, GLOBAL const term *terms, int form, GLOBAL mat3 *block)
{
  FOR_EACH(i, n) {
    mat3 sum = mat3_zero();
    int k;
    for (k = start[i]; k < start[i + 1]; ++k)
      sum = add_source(sum, source[k], mass, triangles, triangle, hinges, hinge, terms, form);
    block[i] = sum;
  }
}

/* Algorithm 1, line 21, as printed: nine atomic additions a block. */
DEVICE_ATOMIC void atomic_add_block(GLOBAL mat3 *block, mat3 m)
{
  GLOBAL real *p = (GLOBAL real *)block;
  ATOMIC_ADD_REAL(p, m.row[0].x);
  ATOMIC_ADD_REAL(p + 1, m.row[0].y);
  ATOMIC_ADD_REAL(p + 2, m.row[0].z);
  ATOMIC_ADD_REAL(p + 3, m.row[1].x);
  ATOMIC_ADD_REAL(p + 4, m.row[1].y);
  ATOMIC_ADD_REAL(p + 5, m.row[1].z);
  ATOMIC_ADD_REAL(p + 6, m.row[2].x);
  ATOMIC_ADD_REAL(p + 7, m.row[2].y);
  ATOMIC_ADD_REAL(p + 8, m.row[2].z);
}
KERNEL scatter_triangles(int n, GLOBAL const element_nodes *nodes, GLOBAL const triangle_factor *factor, int rows,
                         GLOBAL const int *row, GLOBAL const int *column, GLOBAL mat3 *block)
{
  FOR_EACH(i, n) {
    int a, b;
    for (a = 0; a < 3; ++a)
      for (b = 0; b < 3; ++b)
        if (in_matrix(nodes[i].node[a], rows) && nodes[i].node[b] >= 0)
          atomic_add_block(&block[locate(row, column, nodes[i].node[a], nodes[i].node[b])],
                           triangle_block(factor[i], a, b));
  }
}
KERNEL scatter_hinges(int n, GLOBAL const element_nodes *nodes, GLOBAL const hinge_factor *factor, int rows,
                      GLOBAL const int *row, GLOBAL const int *column, GLOBAL mat3 *block)
{
  FOR_EACH(i, n) {
    int a, b;
    for (a = 0; a < 4; ++a)
      for (b = 0; b < 4; ++b)
        if (in_matrix(nodes[i].node[a], rows) && nodes[i].node[b] >= 0)
          atomic_add_block(&block[locate(row, column, nodes[i].node[a], nodes[i].node[b])],
                           hinge_block(factor[i], a, b));
  }
}
KERNEL scatter_terms(int n, GLOBAL const element_nodes *nodes, GLOBAL const int *split, GLOBAL const term *terms,
                     int form, int rows, GLOBAL const int *row, GLOBAL const int *column, GLOBAL mat3 *block)
{
  FOR_EACH(i, n) {
    int a, b;
    for (a = 0; a < 4; ++a)
      for (b = 0; b < 4; ++b)
        if (in_matrix(nodes[i].node[a], rows) && nodes[i].node[b] >= 0 && couples(split, i, a, b))
          atomic_add_block(&block[locate(row, column, nodes[i].node[a], nodes[i].node[b])],
                           term_block(terms[i], form, a, b));
  }
}

/* The naive assembly that the paper compares with: collect every (row, column) key with its entry, sort, reduce.
   Entry = 16 (first + element) + 4 a + b; entries outside the matrix get a key behind all rows. */
KERNEL collect_entries(int n, GLOBAL const element_nodes *nodes, GLOBAL const int *split, int rows, int first,
                       GLOBAL key64 *key, GLOBAL int *entry)
{
  FOR_EACH(i, n) {
    int a, b;
    for (a = 0; a < 4; ++a)
      for (b = 0; b < 4; ++b) {
        int at = 16 * (first + i) + 4 * a + b, s = nodes[i].node[a], t = nodes[i].node[b];
        int used = in_matrix(s, rows) && t >= 0 && couples(split, i, a, b);
        key[at] = used ? ((key64)s << 31) | (key64)t : ((key64)rows << 31);
        entry[at] = at;
      }
  }
}
KERNEL collect_diagonal(int n, int first, GLOBAL key64 *key, GLOBAL int *entry)
{
  FOR_EACH(i, n) {
    key[first + i] = ((key64)i << 31) | (key64)i;
    entry[first + i] = -1 - i;
  }
}
/* head[i] = 1 at the first of equal keys. */
KERNEL mark_heads(int n, GLOBAL const key64 *key, int rows, GLOBAL int *head)
{
  FOR_EACH(i, n) {
    head[i] = (key[i] >> 31) < (key64)rows && (i == 0 || key[i] != key[i - 1]);
  }
}
KERNEL reduce_sorted(int n, GLOBAL const key64 *key, GLOBAL const int *entry, GLOBAL const int *place, int total,
                     int rows, GLOBAL const real *mass, int triangles, GLOBAL const triangle_factor *triangle,
                     int hinges, GLOBAL const hinge_factor *hinge, GLOBAL const term *terms, int form, GLOBAL int *row,
                     GLOBAL int *column, GLOBAL mat3 *block)
{
  FOR_EACH(i, n) {
    int s = (int)(key[i] >> 31), at = place[i], k = i;
    mat3 sum = mat3_zero();
    if (i == 0) row[rows] = total;
    if (place[i + 1] == at) continue;
    for (; k < n && key[k] == key[i]; ++k)
      sum = add_source(sum, entry[k], mass, triangles, triangle, hinges, hinge, terms, form);
    column[at] = (int)(key[i] & 0x7fffffff);
    block[at] = sum;
    if (i == 0 || (int)(key[i - 1] >> 31) != s) row[s] = at;
  }
}

/* start + sum of the forces [3 triangles], [4 hinges] of the elements at vertex i */
DEVICE vec3 gathered_force(int i, vec3 start, GLOBAL const int *triangle_row, GLOBAL const int *triangle_incidence,
                           GLOBAL const vec3 *triangle_force, GLOBAL const int *hinge_row,
                           GLOBAL const int *hinge_incidence, GLOBAL const vec3 *hinge_force, int hinges)
{
  vec3 sum = start;
  int k, end = triangle_row[i + 1];
  for (k = triangle_row[i]; k < end; k += AT_ONCE(4)) {
    vec3 own[AT_ONCE(4)];
    FOR_AT_ONCE(q, 4, end - k)
      own[q] = triangle_force[3 * (triangle_incidence[k + q] >> 2) + (triangle_incidence[k + q] & 3)];
    FOR_AT_ONCE(q, 4, end - k) sum = add(sum, own[q]);
  }
  end = hinges ? hinge_row[i + 1] : 0;
  for (k = hinges ? hinge_row[i] : 0; k < end; k += AT_ONCE(4)) {
    vec3 own[AT_ONCE(4)];
    FOR_AT_ONCE(q, 4, end - k) own[q] = hinge_force[hinge_incidence[k + q]];
    FOR_AT_ONCE(q, 4, end - k) sum = add(sum, own[q]);
  }
  return sum;
}

/* f_i = sum over its elements' forces + m g. outer: sum of outer_triangle and outer_hinge alone, or null; with
   `together` f_i has it too. */
KERNEL gather_forces(int n, GLOBAL const int *triangle_row, GLOBAL const int *triangle_incidence,
                     GLOBAL const vec3 *triangle_force, GLOBAL const int *hinge_row, GLOBAL const int *hinge_incidence,
                     GLOBAL const vec3 *hinge_force, int hinges, GLOBAL const real *mass, GLOBAL const dvec3 *gravity,
                     GLOBAL vec3 *force, int together, GLOBAL const vec3 *outer_triangle,
                     GLOBAL const vec3 *outer_hinge, GLOBAL vec3 *outer)
{
  FOR_EACH(i, n) {
    vec3 sum = gathered_force(i, scale(mass[i], to_vec3(gravity[0])), triangle_row, triangle_incidence, triangle_force,
                              hinge_row, hinge_incidence, hinge_force, hinges);
    if (outer) {
      const vec3 own = gathered_force(i, vec3_make((real)0, (real)0, (real)0), triangle_row, triangle_incidence,
                                      outer_triangle, hinge_row, hinge_incidence, outer_hinge, hinges);
      outer[i] = own;
      if (together) sum = add(sum, own);
    }
    force[i] = sum;
  }
}

#endif
