/* SPDX-License-Identifier: Apache-2.0 */
/* Sparse matrix assembly to BCSR with 3x3 blocks (paper, section 3.2, Algorithm 1). Rows are cloth vertices, [0, rows); columns are all
   vertices, obstacles' too, so that moving obstacles act on the cloth. Elements are element_nodes; FORM_STAR leaves out pairs on the
   same side (weights of one sign). */

DEVICE int in_matrix(int node, int rows) { return node >= 0 && node < rows; }

/* Do nodes a and b of element i couple? split: [elements] nodes below it are side A, 0: every pair couples; none: so do all elements'. */
DEVICE int couples(GLOBAL const int *split, int i, int a, int b)
{
  return !split || split[i] == 0 || a == b || (a < split[i]) != (b < split[i]);
}

/* Algorithm 1, lines 2-4: entries per row. split: [n] or none, see couples. */
KERNEL count_entries(int n, GLOBAL const element_nodes *nodes, GLOBAL const int *split, int rows, GLOBAL int *count)
{
  FOR_EACH(i, n)
  {
    int a, b;
    for (a = 0; a < 4; ++a)
      if (in_matrix(nodes[i].node[a], rows)) {
        int entries = 0;
        for (b = 0; b < 4; ++b) entries += nodes[i].node[b] >= 0 && couples(split, i, a, b);
        atomic_add_int(&count[nodes[i].node[a]], entries);
      }
  }
}

/* Algorithm 1, lines 7-9: column indices into each row's space. */
KERNEL fill_entries(int n, GLOBAL const element_nodes *nodes, GLOBAL const int *split, int rows, GLOBAL const int *space,
                    GLOBAL int *cursor, GLOBAL int *index)
{
  FOR_EACH(i, n)
  {
    int a, b;
    for (a = 0; a < 4; ++a)
      if (in_matrix(nodes[i].node[a], rows))
        for (b = 0; b < 4; ++b)
          if (nodes[i].node[b] >= 0 && couples(split, i, a, b)) {
            int s = nodes[i].node[a];
            index[space[s] + atomic_add_int(&cursor[s], 1)] = nodes[i].node[b];
          }
  }
}

/* Algorithm 1, lines 11-13: sorts each row's indices, removes duplicates in place, counts what is left. The diagonal is always kept. */
KERNEL remove_duplicates(int n, GLOBAL const int *space, GLOBAL int *index, GLOBAL int *count)
{
  FOR_EACH_UNEVEN(i, n)
  {
    int begin = space[i], end = space[i + 1], kept = 0, k;
    sort_ints(index + begin, end - begin);
    for (k = begin; k < end; ++k)
      if (k == begin || index[k] != index[k - 1]) ++kept;
    count[i] = kept;
  }
}

/* Algorithm 1, lines 15-16: the compact index. */
KERNEL reduce_entries(int n, GLOBAL const int *space, GLOBAL const int *index, GLOBAL const int *row, GLOBAL int *column)
{
  FOR_EACH(i, n)
  {
    int at = row[i], k;
    for (k = space[i]; k < space[i + 1]; ++k)
      if (k == space[i] || index[k] != index[k - 1]) column[at++] = index[k];
  }
}

/* One entry per row: vertices that no element touches keep their diagonal. */
KERNEL fill_diagonal(int n, GLOBAL const int *space, GLOBAL int *cursor, GLOBAL int *index)
{
  FOR_EACH(i, n) { index[space[i]] = i; cursor[i] = 1; }
}

/* location(s, t) of Algorithm 1, line 21. */
DEVICE int locate(GLOBAL const int *row, GLOBAL const int *column, int s, int t)
{
  int lo = row[s], hi = row[s + 1] - 1;
  while (lo < hi) {
    int middle = (lo + hi) / 2;
    if (column[middle] < t) lo = middle + 1; else hi = middle;
  }
  return lo;
}

/* slot[4 k + b]: place of block (vertex of incidence k, node b of its element); -1 where there is none. */
KERNEL locate_slots(int n, GLOBAL const int *incidence_row, GLOBAL const int *incidence, GLOBAL const element_nodes *nodes,
                    GLOBAL const int *split, GLOBAL const int *row, GLOBAL const int *column, GLOBAL int *slot)
{
  FOR_EACH(i, n)
  {
    int k, b;
    for (k = incidence_row[i]; k < incidence_row[i + 1]; ++k) {
      int e = incidence[k] >> 2, a = incidence[k] & 3;
      for (b = 0; b < 4; ++b) {
        int t = nodes[e].node[b];
        slot[4 * k + b] = t >= 0 && couples(split, e, a, b) ? locate(row, column, i, t) : -1;
      }
    }
  }
}

/* The rows of M: zero but for the masses on the diagonal. */
KERNEL set_mass_rows(int n, GLOBAL const int *row, GLOBAL const int *column, GLOBAL const real *mass, GLOBAL mat3 *block)
{
  FOR_EACH(i, n)
  {
    int k;
    for (k = row[i]; k < row[i + 1]; ++k) block[k] = column[k] == i ? mat3_diagonal(mass[i]) : mat3_zero();
  }
}

/* Data filling without atomics: each row adds the blocks of its own elements in the order of the sorted incidence. */
KERNEL gather_triangles(int n, GLOBAL const int *incidence_row, GLOBAL const int *incidence, GLOBAL const int *slot,
                        GLOBAL const triangle_factor *factor, GLOBAL mat3 *block)
{
  FOR_EACH(i, n)
  {
    int k, b;
    for (k = incidence_row[i]; k < incidence_row[i + 1]; ++k) {
      triangle_factor t = factor[incidence[k] >> 2];
      for (b = 0; b < 3; ++b)
        if (slot[4 * k + b] >= 0) block[slot[4 * k + b]] = mat3_add(block[slot[4 * k + b]], triangle_block(t, incidence[k] & 3, b));
    }
  }
}
KERNEL gather_hinges(int n, GLOBAL const int *incidence_row, GLOBAL const int *incidence, GLOBAL const int *slot,
                     GLOBAL const hinge_factor *factor, GLOBAL mat3 *block)
{
  FOR_EACH(i, n)
  {
    int k, b;
    for (k = incidence_row[i]; k < incidence_row[i + 1]; ++k) {
      hinge_factor f = factor[incidence[k] >> 2];
      for (b = 0; b < 4; ++b)
        if (slot[4 * k + b] >= 0) block[slot[4 * k + b]] = mat3_add(block[slot[4 * k + b]], hinge_block(f, incidence[k] & 3, b));
    }
  }
}
KERNEL gather_terms(int n, GLOBAL const int *incidence_row, GLOBAL const int *incidence, GLOBAL const int *slot,
                    GLOBAL const term *terms, int form, GLOBAL mat3 *block)
{
  FOR_EACH(i, n)
  {
    int k, b;
    for (k = incidence_row[i]; k < incidence_row[i + 1]; ++k) {
      term t = terms[incidence[k] >> 2];
      for (b = 0; b < 4; ++b)
        if (slot[4 * k + b] >= 0) block[slot[4 * k + b]] = mat3_add(block[slot[4 * k + b]], term_block(t, form, incidence[k] & 3, b));
    }
  }
}

/* The same by blocks: each adds up its own sources, sorted. A source is 16 * (first + element) + 4 a + b, hinges behind triangles, or -1 - row
   for the mass on the diagonal. */
KERNEL count_diagonal_sources(int n, GLOBAL const int *row, GLOBAL const int *column, GLOBAL int *count)
{
  FOR_EACH(i, n) { count[locate(row, column, i, i)] = 1; }
}
KERNEL count_sources(int n, GLOBAL const int *incidence_row, GLOBAL const int *slot, GLOBAL int *count)
{
  FOR_EACH(i, n)
  {
    int k;
    for (k = 4 * incidence_row[i]; k < 4 * incidence_row[i + 1]; ++k)
      if (slot[k] >= 0) atomic_add_int(&count[slot[k]], 1);
  }
}
KERNEL fill_diagonal_sources(int n, GLOBAL const int *row, GLOBAL const int *column, GLOBAL const int *start, GLOBAL int *cursor, GLOBAL int *source)
{
  FOR_EACH(i, n)
  {
    int at = locate(row, column, i, i);
    source[start[at] + atomic_add_int(&cursor[at], 1)] = -1 - i;
  }
}
KERNEL fill_sources(int n, int first, GLOBAL const int *incidence_row, GLOBAL const int *incidence, GLOBAL const int *slot,
                    GLOBAL const int *start, GLOBAL int *cursor, GLOBAL int *source)
{
  FOR_EACH(i, n)
  {
    int k, b;
    for (k = incidence_row[i]; k < incidence_row[i + 1]; ++k)
      for (b = 0; b < 4; ++b) {
        int at = slot[4 * k + b];
        if (at >= 0) source[start[at] + atomic_add_int(&cursor[at], 1)] = 16 * (first + (incidence[k] >> 2)) + 4 * (incidence[k] & 3) + b;
      }
  }
}
KERNEL gather_blocks(int n, GLOBAL const int *start, GLOBAL const int *source, GLOBAL const real *mass, int triangles,
                     GLOBAL const triangle_factor *triangle, GLOBAL const hinge_factor *hinge, GLOBAL mat3 *block)
{
  FOR_EACH(i, n)
  {
    mat3 sum = mat3_zero();
    int k;
    for (k = start[i]; k < start[i + 1]; ++k) {
      int e = source[k] >> 4, a = (source[k] >> 2) & 3, b = source[k] & 3;
      if (source[k] < 0) sum = mat3_add(sum, mat3_diagonal(mass[-1 - source[k]]));
      else if (e < triangles) sum = mat3_add(sum, triangle_block(triangle[e], a, b));
      else sum = mat3_add_outer(sum, hinge[e - triangles].coefficient, hinge[e - triangles].gradient[a], hinge[e - triangles].gradient[b]);
    }
    block[i] = sum;
  }
}

/* Algorithm 1, line 21, as printed: nine atomic additions a block. */
DEVICE_ATOMIC void atomic_add_block(GLOBAL mat3 *block, mat3 m)
{
  GLOBAL real *p = (GLOBAL real *)block;
  ATOMIC_ADD_REAL(p, m.row[0].x); ATOMIC_ADD_REAL(p + 1, m.row[0].y); ATOMIC_ADD_REAL(p + 2, m.row[0].z);
  ATOMIC_ADD_REAL(p + 3, m.row[1].x); ATOMIC_ADD_REAL(p + 4, m.row[1].y); ATOMIC_ADD_REAL(p + 5, m.row[1].z);
  ATOMIC_ADD_REAL(p + 6, m.row[2].x); ATOMIC_ADD_REAL(p + 7, m.row[2].y); ATOMIC_ADD_REAL(p + 8, m.row[2].z);
}
KERNEL scatter_triangles(int n, GLOBAL const element_nodes *nodes, GLOBAL const triangle_factor *factor, int rows,
                         GLOBAL const int *row, GLOBAL const int *column, GLOBAL mat3 *block)
{
  FOR_EACH(i, n)
  {
    int a, b;
    for (a = 0; a < 3; ++a)
      for (b = 0; b < 3; ++b)
        if (in_matrix(nodes[i].node[a], rows) && nodes[i].node[b] >= 0)
          atomic_add_block(&block[locate(row, column, nodes[i].node[a], nodes[i].node[b])], triangle_block(factor[i], a, b));
  }
}
KERNEL scatter_hinges(int n, GLOBAL const element_nodes *nodes, GLOBAL const hinge_factor *factor, int rows,
                      GLOBAL const int *row, GLOBAL const int *column, GLOBAL mat3 *block)
{
  FOR_EACH(i, n)
  {
    int a, b;
    for (a = 0; a < 4; ++a)
      for (b = 0; b < 4; ++b)
        if (in_matrix(nodes[i].node[a], rows) && nodes[i].node[b] >= 0)
          atomic_add_block(&block[locate(row, column, nodes[i].node[a], nodes[i].node[b])], hinge_block(factor[i], a, b));
  }
}
KERNEL scatter_terms(int n, GLOBAL const element_nodes *nodes, GLOBAL const int *split, GLOBAL const term *terms, int form, int rows,
                     GLOBAL const int *row, GLOBAL const int *column, GLOBAL mat3 *block)
{
  FOR_EACH(i, n)
  {
    int a, b;
    for (a = 0; a < 4; ++a)
      for (b = 0; b < 4; ++b)
        if (in_matrix(nodes[i].node[a], rows) && nodes[i].node[b] >= 0 && couples(split, i, a, b))
          atomic_add_block(&block[locate(row, column, nodes[i].node[a], nodes[i].node[b])], term_block(terms[i], form, a, b));
  }
}

/* The naive assembly that the paper compares with: collect every (row, column) key with its entry, sort, reduce.
   Entry = 16 (first + element) + 4 a + b; entries outside the matrix get a key behind all rows. */
KERNEL collect_entries(int n, GLOBAL const element_nodes *nodes, GLOBAL const int *split, int rows, int first, GLOBAL key64 *key,
                       GLOBAL int *entry)
{
  FOR_EACH(i, n)
  {
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
  FOR_EACH(i, n) { key[first + i] = ((key64)i << 31) | (key64)i; entry[first + i] = -1 - i; }
}
/* head[i] = 1 at the first of equal keys. */
KERNEL mark_heads(int n, GLOBAL const key64 *key, int rows, GLOBAL int *head)
{
  FOR_EACH(i, n) { head[i] = (key[i] >> 31) < (key64)rows && (i == 0 || key[i] != key[i - 1]); }
}
KERNEL reduce_sorted(int n, GLOBAL const key64 *key, GLOBAL const int *entry, GLOBAL const int *place, int total, int rows,
                     GLOBAL const real *mass, int triangles, GLOBAL const triangle_factor *triangle, int hinges,
                     GLOBAL const hinge_factor *hinge, GLOBAL const term *terms, int form, GLOBAL int *row, GLOBAL int *column,
                     GLOBAL mat3 *block)
{
  FOR_EACH(i, n)
  {
    int s = (int)(key[i] >> 31), at = place[i], k = i;
    mat3 sum = mat3_zero();
    if (i == 0) row[rows] = total;
    if (place[i + 1] == at) continue;
    for (; k < n && key[k] == key[i]; ++k) {
      int e = entry[k] >> 4, a = (entry[k] >> 2) & 3, b = entry[k] & 3;
      if (entry[k] < 0) sum = mat3_add(sum, mat3_diagonal(mass[-1 - entry[k]]));
      else if (e < triangles) sum = mat3_add(sum, triangle_block(triangle[e], a, b));
      else if (e < triangles + hinges) sum = mat3_add(sum, hinge_block(hinge[e - triangles], a, b));
      else sum = mat3_add(sum, term_block(terms[e - triangles - hinges], form, a, b));
    }
    column[at] = (int)(key[i] & 0x7fffffff);
    block[at] = sum;
    if (i == 0 || (int)(key[i - 1] >> 31) != s) row[s] = at;
  }
}

/* f_i = sum over its elements' forces + m g. */
KERNEL gather_forces(int n, GLOBAL const int *triangle_row, GLOBAL const int *triangle_incidence, GLOBAL const vec3 *triangle_force,
                     GLOBAL const int *hinge_row, GLOBAL const int *hinge_incidence, GLOBAL const vec3 *hinge_force, int hinges,
                     GLOBAL const real *mass, GLOBAL const dvec3 *gravity, GLOBAL vec3 *force)
{
  FOR_EACH(i, n)
  {
    vec3 sum = scale(mass[i], to_vec3(gravity[0]));
    int k;
    for (k = triangle_row[i]; k < triangle_row[i + 1]; ++k)
      sum = add(sum, triangle_force[3 * (triangle_incidence[k] >> 2) + (triangle_incidence[k] & 3)]);
    if (hinges)
      for (k = hinge_row[i]; k < hinge_row[i + 1]; ++k) sum = add(sum, hinge_force[hinge_incidence[k]]);
    force[i] = sum;
  }
}
