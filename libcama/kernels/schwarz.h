/* SPDX-License-Identifier: Apache-2.0 */
/* The multilevel additive Schwarz preconditioner (Wu et al. 2022, "A GPU-based multilevel additive Schwarz preconditioner for cloth and
   deformable body simulation") and the conjugate gradient around it, in one reduction an iteration (Chronopoulos and Gear 1989).
   Rows are free vertices, ordered so that each block's are neighbours. A block has at most BLOCK_ROWS rows; its dense inverse is
   kept whole. */

#define BLOCK_ROWS 16
#define BLOCK_SIZE 48
#define SLICE_ROWS 32   /* rows of the sliced matrix that share a width */
#define TEAM_ROWS 128   /* rows of a team in the matrix product */
#define BLOCK_TEAM 64   /* members of a team that has a block */
/* Column c, row l of an inverse: 16 rows at a time, so that processors read it from front to back. */
#define INVERSE_AT(c, l) (((l) / 16 * BLOCK_SIZE + (c)) * 16 + (l) % 16)

LANES_TYPE(real, lanes);

/* Scalars of the conjugate gradient in one reduction. */
#define CG_GAMMA 0       /* r' z */
#define CG_ALPHA 1
#define CG_BETA 2
#define CG_GOAL 3        /* of r' z */
#define CG_DONE 4        /* 1: nothing more changes */
#define CG_BROKEN 5      /* 1: not positive definite, or not finite */
#define CG_ITERATIONS 6
#define CG_START 7       /* r' z at the start */
#define CG_FORCES 8      /* f' P f of the forces without penalties */
#define CG_INNER 9       /* r' z that working precision can reach from this start */
#define CG_COUNT 10
#define CG_TEAM 256

#define CG_MEASURE_FORCES 0
#define CG_MEASURE_START 1  /* sets the goal */
#define CG_MEASURE_CHECK 2  /* the goal stays: a residual computed afresh */
#define CG_ITERATE 3

/* The next alpha and beta from the partial sums of r'z and z'w, or the end. One team.
   goal: tolerance^2; slack: (of the forces) a tolerance relative to huge penalties would leave gravity unsolved; restart = 1: beta is 0.
   inner: least r'z relative to this start that working precision can reach. */
KERNEL cg_scalars(int n, int mode, int partials, GLOBAL const double *partial, double goal, double slack, double inner, int most, GLOBAL double *scalar)
{
  TEAM_LOCAL(double, rz, CG_TEAM);
  TEAM_LOCAL(double, zw, CG_TEAM);
  FOR_EACH_TEAM(t, n)
  {
    int span;
    if (mode == CG_ITERATE && scalar[CG_DONE] != 0.0) continue;
    TEAM_FOR(l, CG_TEAM)
    {
      double a = 0.0, b = 0.0;
      int k;
      for (k = l; k < partials; k += CG_TEAM) {
        a += partial[2 * k];
        b += partial[2 * k + 1];
      }
      rz[l] = a;
      zw[l] = b;
    }
    TEAM_BARRIER;
    for (span = CG_TEAM / 2; span > 0; span /= 2) {
      TEAM_FOR(l, span)
      {
        rz[l] += rz[l + span];
        zw[l] += zw[l + span];
      }
      TEAM_BARRIER;
    }
    TEAM_FOR(l, 1)
    {
      double before = scalar[CG_GAMMA], alpha = scalar[CG_ALPHA], least = scalar[CG_GOAL], reached = scalar[CG_INNER];
      double forces = scalar[CG_FORCES], iterations = scalar[CG_ITERATIONS], gamma = rz[0], denominator = zw[0], beta = 0.0;
      if (mode == CG_MEASURE_FORCES) {
        scalar[CG_FORCES] = gamma;
        continue;
      }
      if (mode == CG_MEASURE_START) {
        iterations = 0.0;
        least = goal * (forces > 0.0 ? min_double(gamma, slack * forces) : gamma);
        scalar[CG_START] = gamma;
        scalar[CG_GOAL] = least;
      }
      if (mode == CG_ITERATE) {
        beta = before > 0.0 ? gamma / before : 0.0;
        denominator -= beta * gamma / alpha;
      } else {
        reached = inner * gamma;
        scalar[CG_INNER] = reached;
        scalar[CG_DONE] = 0.0;
        scalar[CG_BROKEN] = 0.0;
      }
      scalar[CG_BETA] = beta;
      scalar[CG_GAMMA] = gamma;
      if (gamma <= max_double(least, reached) || iterations >= (double)most) {
        scalar[CG_DONE] = 1.0;
      } else if (!(gamma > 0.0) || !(denominator > 0.0) || !(gamma < 1e300)) {
        scalar[CG_DONE] = 1.0;
        scalar[CG_BROKEN] = 1.0;
      } else {
        scalar[CG_ALPHA] = gamma / denominator;
        iterations += 1.0;
      }
      scalar[CG_ITERATIONS] = iterations;
    }
  }
}

/* A residual computed afresh is about to be measured. One work item. */
KERNEL cg_resume(int n, GLOBAL double *scalar) { FOR_EACH(i, n) { scalar[CG_DONE] = 0.0; } }

/* Strength of a vertex: 1 / sqrt(trace of its diagonal block). */
KERNEL vertex_strengths(int n, GLOBAL const mat3 *diagonal, GLOBAL float *strength)
{
  FOR_EACH(i, n)
  {
    real trace = diagonal[i].row[0].x + diagonal[i].row[1].y + diagonal[i].row[2].z;
    strength[i] = trace > (real)0 ? (float)((real)1 / (real)sqrt(trace)) : 0.0f;
  }
}

/* Entries of the graph: |A_ij| / sqrt(tr A_ii tr A_jj) for free cloth vertices i and j. n: cloth vertices; entry k of the graph is block k.
   number: of free vertices; -1: fixed. */
KERNEL matrix_entries(int n, GLOBAL const int *row, GLOBAL const int *column, GLOBAL const mat3 *block, GLOBAL const int *number, int numbers,
                      GLOBAL const float *strength, GLOBAL key64 *key, GLOBAL int *entry, GLOBAL float *weight)
{
  FOR_EACH(i, n)
  {
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

/* The same for the 16 couplings of each term, behind the `first` entries of the matrix. */
KERNEL term_entries(int n, int first, int vertices, GLOBAL const term *terms, GLOBAL const int *number, int numbers,
                    GLOBAL const float *strength, GLOBAL key64 *key, GLOBAL int *entry, GLOBAL float *weight)
{
  FOR_EACH(i, n)
  {
    int a, b;
    for (a = 0; a < 4; ++a)
      for (b = 0; b < 4; ++b) {
        int at = first + 16 * i + 4 * a + b, u = terms[i].node[a], v = terms[i].node[b];
        int used = u != v && u >= 0 && v >= 0 && u < vertices && v < vertices && number[u] >= 0 && number[v] >= 0;
        real w = terms[i].weight[a] * terms[i].weight[b] * (terms[i].along + (real)3 * terms[i].around);
        key[at] = used ? ((key64)number[u] << 31) | (key64)number[v] : (key64)numbers << 31;
        entry[at] = at;
        weight[at] = used ? (float)(w < (real)0 ? -w : w) * strength[u] * strength[v] : 0.0f;
      }
  }
}

/* Terms on rows: nodes as rows (-1: not free), and 4 weights, normal, along, around in double or single, whichever is there. */
KERNEL pack_terms(int n, GLOBAL const term *terms, int vertices, GLOBAL const int *place, int wide, GLOBAL element_nodes *nodes,
                  GLOBAL double *to64, GLOBAL float *to32)
{
  FOR_EACH(i, n)
  {
    real x[9];
    int c;
    for (c = 0; c < 4; ++c) {
      int v = terms[i].node[c];
      nodes[i].node[c] = v >= 0 && v < vertices ? place[v] : -1;
      x[c] = terms[i].weight[c];
    }
    x[4] = terms[i].normal.x; x[5] = terms[i].normal.y; x[6] = terms[i].normal.z;
    x[7] = terms[i].along; x[8] = terms[i].around;
    for (c = 0; c < 9; ++c)
      if (wide) to64[9 * i + c] = (double)x[c]; else to32[9 * i + c] = (float)x[c];
  }
}

/* Widths of the slices: the longest row without columns that are not free. n: slices. */
KERNEL slice_widths(int n, int rows, GLOBAL const int *order, GLOBAL const int *row, GLOBAL const int *column, int vertices,
                    GLOBAL const int *place, GLOBAL int *width)
{
  FOR_EACH(s, n)
  {
    int l, widest = 0;
    for (l = 0; l < SLICE_ROWS && s * SLICE_ROWS + l < rows; ++l) {
      int v = order[s * SLICE_ROWS + l], k, count = 0;
      for (k = row[v]; k < row[v + 1]; ++k) count += column[k] < vertices && place[column[k]] >= 0;
      widest = max_int(widest, count);
    }
    width[s] = (widest + 1) / 2 * 2;   /* the product takes two entries at once */
  }
}

/* Columns and source blocks of the sliced matrix; entry k of lane l of slice s is at SLICE_ROWS (start[s] + k) + l. n: lanes. */
KERNEL fill_slices(int n, int rows, GLOBAL const int *order, GLOBAL const int *row, GLOBAL const int *column, int vertices,
                   GLOBAL const int *place, GLOBAL const int *start, GLOBAL int *slice_column, GLOBAL int *source)
{
  FOR_EACH(i, n)
  {
    int s = i / SLICE_ROWS, l = i - s * SLICE_ROWS, at = start[s], k;
    if (i < rows) {
      int v = order[i];
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

/* Blocks into slices: number c of entry e of lane l is at SLICE_ROWS (9 e + c) + l. n: entries of all lanes. */
KERNEL fill_slice_values(int n, GLOBAL const int *source, int wide, GLOBAL const double *from64, GLOBAL const float *from32, GLOBAL real *value)
{
  FOR_EACH(i, n)
  {
    int e = i / SLICE_ROWS, l = i - e * SLICE_ROWS, c;
    for (c = 0; c < 9; ++c) {
      real v = (real)0;
      if (source[i] >= 0) v = wide ? (real)from64[9 * source[i] + c] : (real)from32[9 * source[i] + c];
      value[SLICE_ROWS * (9 * e + c) + l] = v;
    }
  }
}

/* a: a symmetric positive definite matrix of m rows in BLOCK_SIZE columns, scaled to a unit diagonal by the outer product of `scaling`;
   zero elsewhere. Leaves its inverse, unscaled, in `inverse`: Gauss-Jordan sweeps in symmetric form; pivots are held above rounding. */
DEVICE_TEAM void sweep_block(int m, LOCAL real *a, LOCAL real *pivot_column, LOCAL double *scaling, GLOBAL real *inverse)
{
  const real least = sizeof(real) == 8 ? (real)1e-14 : (real)1e-6;
  int k;
  for (k = 0; k < m; ++k) {
    real p;
    TEAM_FOR(l, BLOCK_SIZE) pivot_column[l] = a[k * BLOCK_SIZE + l];
    TEAM_BARRIER;
    p = (real)1 / max_real(pivot_column[k], least);
    TEAM_FOR_LANES(j, m)
    {
      int i;
      lanes own = LANES_LOAD(lanes, pivot_column + j);
      for (i = 0; i < m; ++i) {
        LOCAL real *at = a + i * BLOCK_SIZE + j;
        LANES_STORE(lanes, at, LANES_LOAD(lanes, at) - own * pivot_column[i] * p);
      }
    }
    TEAM_BARRIER;
    TEAM_FOR(l, m)
    {
      real v = l == k ? -p : pivot_column[l] * p;
      a[k * BLOCK_SIZE + l] = v;
      a[l * BLOCK_SIZE + k] = v;
    }
    TEAM_BARRIER;
  }
  for (k = 0; k < BLOCK_SIZE; ++k)
    TEAM_FOR(l, BLOCK_SIZE)
      inverse[INVERSE_AT(k, l)] = l < m && k < m ? (real)(-(double)a[k * BLOCK_SIZE + l] * (scaling[l] * scaling[k])) : (real)0;
}

/* Inverses of the finest blocks: the matrix's entries within a block, and the terms'. */
KERNEL invert_fine_blocks(int n, GLOBAL const int *block_start, GLOBAL const int *slice_start, GLOBAL const int *column,
                          GLOBAL const real *value, int terms, GLOBAL const int *order, GLOBAL const int *term_row,
                          GLOBAL const int *term_entry, GLOBAL const element_nodes *nodes, GLOBAL const real *coefficient,
                          GLOBAL real *inverse)
{
  TEAM_LOCAL(real, a, BLOCK_SIZE * BLOCK_SIZE);
  TEAM_LOCAL(real, pivot_column, BLOCK_SIZE);
  TEAM_LOCAL(double, scaling, BLOCK_SIZE);
  FOR_EACH_TEAM(t, n)
  {
    int first = block_start[t], last = block_start[t + 1], m = 3 * (last - first);
    TEAM_BARRIER;
    TEAM_FOR(l, BLOCK_SIZE * BLOCK_SIZE) a[l] = (real)0;
    TEAM_BARRIER;
    TEAM_FOR(l, last - first)
    {
      int i = first + l, s = i / SLICE_ROWS, lane = i - s * SLICE_ROWS, e, k, b, c, d;
      for (e = slice_start[s]; e < slice_start[s + 1]; ++e) {
        int j = column[SLICE_ROWS * e + lane];
        if (j < first || j > i) continue;
        for (c = 0; c < 3; ++c)
          for (d = 0; d < 3; ++d) a[(3 * l + c) * BLOCK_SIZE + 3 * (j - first) + d] += value[SLICE_ROWS * (9 * e + 3 * c + d) + lane];
      }
      if (terms)
        for (k = term_row[order[i]]; k < term_row[order[i] + 1]; ++k) {
          int term_index = term_entry[k] >> 2;
          GLOBAL const real *x = coefficient + 9 * term_index;
          for (b = 0; b < 4; ++b) {
            int j = nodes[term_index].node[b];
            real w = x[term_entry[k] & 3] * x[b];
            if (j < first || j > i) continue;
            for (c = 0; c < 3; ++c)
              for (d = 0; d < 3; ++d)
                a[(3 * l + c) * BLOCK_SIZE + 3 * (j - first) + d] += w * (x[7] * (x[4 + c] * x[4 + d]) + (c == d ? x[8] : (real)0));
          }
        }
    }
    TEAM_BARRIER;
    TEAM_FOR(l, m)
    {
      double d = (double)a[l * BLOCK_SIZE + l];
      scaling[l] = d > 0.0 ? 1.0 / sqrt(d) : 0.0;
    }
    TEAM_BARRIER;
    TEAM_FOR(l, m)
    {
      int c;
      for (c = 0; c <= l; ++c) {
        real v = (real)((double)a[l * BLOCK_SIZE + c] * (scaling[l] * scaling[c]));
        a[l * BLOCK_SIZE + c] = v;
        a[c * BLOCK_SIZE + l] = v;
      }
    }
    TEAM_BARRIER;
    sweep_block(m, a, pivot_column, scaling, inverse + (size_t)t * BLOCK_SIZE * BLOCK_SIZE);
  }
}

/* Inverses of the blocks of one coarse level, whose nodes are coupled by row, column and value; terms = 1: with their diagonals.
   Block t is at `at` + t of the inverses. */
KERNEL invert_coarse_blocks(int n, int at, GLOBAL const int *block_start, GLOBAL const int *row, GLOBAL const int *column,
                            GLOBAL const double *value, int terms, GLOBAL const double *diagonal, GLOBAL real *inverse)
{
  TEAM_LOCAL(real, a, BLOCK_SIZE * BLOCK_SIZE);
  TEAM_LOCAL(real, pivot_column, BLOCK_SIZE);
  TEAM_LOCAL(double, scaling, BLOCK_SIZE);
  FOR_EACH_TEAM(t, n)
  {
    int first = block_start[t], last = block_start[t + 1], m = 3 * (last - first);
    TEAM_BARRIER;
    TEAM_FOR(l, BLOCK_SIZE * BLOCK_SIZE) a[l] = (real)0;
    TEAM_FOR(l, BLOCK_SIZE)
    {
      int k, i = first + l / 3, d = l - l / 3 * 3;
      scaling[l] = 0.0;
      if (l < m)
        for (k = row[i]; k < row[i + 1]; ++k)
          if (column[k] == i) {
            const int packed[3] = {0, 3, 5};
            double v = value[9 * k + 4 * d] + (terms ? diagonal[6 * i + packed[d]] : 0.0);
            scaling[l] = v > 0.0 ? 1.0 / sqrt(v) : 0.0;
          }
    }
    TEAM_BARRIER;
    TEAM_FOR(l, m)
    {
      int i = first + l / 3, r = l - l / 3 * 3, k, d;
      for (k = row[i]; k < row[i + 1]; ++k) {
        int j = column[k];
        if (j < first || j > i) continue;
        for (d = 0; d < 3; ++d) {
          int c = 3 * (j - first) + d, low = min_int(r, d), high = max_int(r, d);
          double v = value[9 * k + 3 * r + d];
          if (c > l) continue;
          if (terms && j == i) v += diagonal[6 * i + (low == 0 ? high : low + high + 1)];
          v *= scaling[l] * scaling[c];
          a[l * BLOCK_SIZE + c] = (real)v;
          a[c * BLOCK_SIZE + l] = (real)v;
        }
      }
    }
    TEAM_BARRIER;
    sweep_block(m, a, pivot_column, scaling, inverse + (size_t)(at + t) * BLOCK_SIZE * BLOCK_SIZE);
  }
}

/* p = z + beta p, s = w + beta s, x += alpha p, r -= alpha s; start = 1: r is what is there, and the rest is made zero. n: 3 rows. */
KERNEL cg_update(int n, int start, GLOBAL const double *scalar, GLOBAL const real *RESTRICT z, GLOBAL const real *RESTRICT w,
                 GLOBAL real *RESTRICT p, GLOBAL real *RESTRICT s, GLOBAL real *RESTRICT x, GLOBAL real *RESTRICT r)
{
  FOR_EACH(i, n)
  {
    if (start) {
      p[i] = (real)0;
      s[i] = (real)0;
      x[i] = (real)0;
    } else if (scalar[CG_DONE] == 0.0) {
      real alpha = (real)scalar[CG_ALPHA], beta = (real)scalar[CG_BETA], pi = z[i] + beta * p[i], si = w[i] + beta * s[i];
      p[i] = pi;
      s[i] = si;
      x[i] += alpha * pi;
      r[i] -= alpha * si;
    }
  }
}

#define COLUMN_STEP 12   /* columns read at once; r has as many numbers more than rows */

/* z = inverse of each block times r; sums = 1: coarse[t] = the sum of r over block t. n: BLOCK_SIZE blocks. */
KERNEL apply_blocks(int n, GLOBAL const int *block_start, GLOBAL const double *scalar, GLOBAL const real *RESTRICT inverse,
                    GLOBAL const real *RESTRICT r, GLOBAL real *RESTRICT z, int sums, GLOBAL real *RESTRICT coarse)
{
  FOR_EACH_LANES(at, n)
  {
    int t = at / BLOCK_SIZE, j = at - t * BLOCK_SIZE, first = 3 * block_start[t], m = 3 * block_start[t + 1] - first, c, k;
    GLOBAL const real *RESTRICT v = inverse + (size_t)t * BLOCK_SIZE * BLOCK_SIZE + INVERSE_AT(0, j);
    GLOBAL const real *RESTRICT x = r + first;
    lanes even = LANES_ALL(lanes, (real)0), odd = even;
    if (j >= m || scalar[CG_DONE] != 0.0) continue;
    for (c = 0; c < m; c += COLUMN_STEP)
      for (k = c; k < c + COLUMN_STEP; k += 2) {
        even += LANES_LOAD(lanes, v + 16 * k) * x[k];
        odd += LANES_LOAD(lanes, v + 16 * k + 16) * x[k + 1];
      }
    even += odd;
    FOR_LANES(q)
    {
      if (j + q < m) z[first + j + q] = LANE(even, q);
      if (sums && j + q < 3) {
        real sum = (real)0;
        for (k = j + q; k < m; k += 3) sum += x[k];
        coarse[3 * t + j + q] = sum;
      }
    }
  }
}

#define SUM_TEAM 64

/* residual[node] = the sum over the finest blocks that it covers, for nodes from `node` on. */
KERNEL restrict_residual(int n, int node, GLOBAL const int *first, GLOBAL const int *last, GLOBAL const double *scalar, GLOBAL real *residual)
{
  TEAM_LOCAL(real, sum, 3 * SUM_TEAM);
  FOR_EACH_TEAM(t, n)
  {
    int span;
    if (scalar[CG_DONE] != 0.0) continue;
    TEAM_BARRIER;
    TEAM_FOR(l, SUM_TEAM)
    {
      int k, end = last[node + t];
      real x = (real)0, y = (real)0, u = (real)0;
      for (k = first[node + t] + l; k < end; k += SUM_TEAM) {
        x += residual[3 * k];
        y += residual[3 * k + 1];
        u += residual[3 * k + 2];
      }
      sum[l] = x;
      sum[SUM_TEAM + l] = y;
      sum[2 * SUM_TEAM + l] = u;
    }
    TEAM_BARRIER;
    for (span = SUM_TEAM / 2; span > 0; span /= 2) {
      TEAM_FOR(l, span)
      {
        sum[l] += sum[l + span];
        sum[SUM_TEAM + l] += sum[SUM_TEAM + l + span];
        sum[2 * SUM_TEAM + l] += sum[2 * SUM_TEAM + l + span];
      }
      TEAM_BARRIER;
    }
    TEAM_FOR(c, 3) residual[3 * (node + t) + c] = sum[c * SUM_TEAM];
  }
}

/* path[levels b + k]: the coarse nodes above finest block b. parent: of coarse nodes; the first are the finest blocks. */
KERNEL coarse_paths(int n, int levels, GLOBAL const int *parent, GLOBAL int *path)
{
  FOR_EACH(i, n)
  {
    int k, node = i;
    for (k = 0; k < levels; ++k, node = parent[node]) path[levels * i + k] = node;
  }
}

/* z += the corrections of all coarse levels. block: of rows. n: 3 rows. */
KERNEL add_corrections(int n, int levels, GLOBAL const int *block, GLOBAL const int *RESTRICT path, GLOBAL const double *scalar,
                       GLOBAL const real *RESTRICT correction, GLOBAL real *RESTRICT z)
{
  FOR_EACH(i, n)
  {
    int row = i / 3, c = i - 3 * row, k;
    GLOBAL const int *RESTRICT own = path + levels * block[row];
    real sum = z[i];
    if (scalar[CG_DONE] != 0.0) continue;
    for (k = 0; k < levels; ++k) sum += correction[3 * own[k] + c];
    z[i] = sum;
  }
}

/* (along n n' + around I) sum_k w_k z_k of each term. */
KERNEL cg_term_products(int n, GLOBAL const element_nodes *nodes, GLOBAL const real *coefficient, GLOBAL const double *scalar,
                        GLOBAL const vec3 *z, GLOBAL vec3 *product)
{
  FOR_EACH(i, n)
  {
    GLOBAL const real *x = coefficient + 9 * i;
    vec3 normal = vec3_make(x[4], x[5], x[6]), s = vec3_make((real)0, (real)0, (real)0);
    int a;
    if (scalar[CG_DONE] != 0.0) continue;
    for (a = 0; a < 4; ++a)
      if (nodes[i].node[a] >= 0) s = axpy(s, x[a], z[nodes[i].node[a]]);
    product[i] = axpy(scale(x[8], s), x[7] * dot(normal, s), normal);
  }
}

#define SLICE_NUMBER(v, c) LANES_LOAD(lanes, (v) + (c) * SLICE_ROWS)

/* w = A z with the terms; partial[2 t], partial[2 t + 1] = r'z and z'w over the TEAM_ROWS rows of team t. */
KERNEL cg_multiply(int n, int rows, GLOBAL const int *slice_start, GLOBAL const int *RESTRICT column, GLOBAL const real *RESTRICT value,
                   int terms, GLOBAL const int *order, GLOBAL const int *term_row, GLOBAL const int *term_entry,
                   GLOBAL const real *coefficient, GLOBAL const vec3 *product, GLOBAL const double *scalar,
                   GLOBAL const vec3 *RESTRICT z, GLOBAL const vec3 *r, GLOBAL vec3 *w, GLOBAL double *partial)
{
  TEAM_LOCAL(double, rz, TEAM_ROWS);
  TEAM_LOCAL(double, zw, TEAM_ROWS);
  FOR_EACH_TEAM(t, n)
  {
    int span;
    if (scalar[CG_DONE] != 0.0) continue;
    TEAM_BARRIER;
    TEAM_FOR_LANES(row, TEAM_ROWS)
    {
      lanes x = LANES_ALL(lanes, (real)0), y = x, u = x;
      int first = t * TEAM_ROWS + row, s = first / SLICE_ROWS, lane = first - s * SLICE_ROWS, e;
      if (first < rows)
        for (e = slice_start[s]; e < slice_start[s + 1]; e += 2) {
          GLOBAL const real *RESTRICT v = value + (size_t)SLICE_ROWS * 9 * e + lane;
          GLOBAL const int *RESTRICT c = column + (size_t)SLICE_ROWS * e + lane;
          lanes ax, ay, az, bx, by, bz;
          FOR_LANES(q)
          {
            vec3 a = z[c[q]], b = z[c[q + SLICE_ROWS]];
            LANE(ax, q) = a.x; LANE(ay, q) = a.y; LANE(az, q) = a.z;
            LANE(bx, q) = b.x; LANE(by, q) = b.y; LANE(bz, q) = b.z;
          }
          x += SLICE_NUMBER(v, 0) * ax + SLICE_NUMBER(v, 1) * ay + SLICE_NUMBER(v, 2) * az +
               (SLICE_NUMBER(v, 9) * bx + SLICE_NUMBER(v, 10) * by + SLICE_NUMBER(v, 11) * bz);
          y += SLICE_NUMBER(v, 3) * ax + SLICE_NUMBER(v, 4) * ay + SLICE_NUMBER(v, 5) * az +
               (SLICE_NUMBER(v, 12) * bx + SLICE_NUMBER(v, 13) * by + SLICE_NUMBER(v, 14) * bz);
          u += SLICE_NUMBER(v, 6) * ax + SLICE_NUMBER(v, 7) * ay + SLICE_NUMBER(v, 8) * az +
               (SLICE_NUMBER(v, 15) * bx + SLICE_NUMBER(v, 16) * by + SLICE_NUMBER(v, 17) * bz);
        }
      FOR_LANES(q)
      {
        int i = first + q;
        rz[row + q] = 0.0;
        zw[row + q] = 0.0;
        if (i < rows) {
          vec3 sum = vec3_make(LANE(x, q), LANE(y, q), LANE(u, q)), zi = z[i], ri = r[i];
          if (terms) {
            int v = order[i], k = term_row[v], end = term_row[v + 1];
            for (; k + 3 < end; k += 4) {   /* four at once: their loads do not wait for each other */
              int e0 = term_entry[k], e1 = term_entry[k + 1], e2 = term_entry[k + 2], e3 = term_entry[k + 3];
              real w0 = coefficient[9 * (e0 >> 2) + (e0 & 3)], w1 = coefficient[9 * (e1 >> 2) + (e1 & 3)];
              real w2 = coefficient[9 * (e2 >> 2) + (e2 & 3)], w3 = coefficient[9 * (e3 >> 2) + (e3 & 3)];
              vec3 p0 = product[e0 >> 2], p1 = product[e1 >> 2], p2 = product[e2 >> 2], p3 = product[e3 >> 2];
              sum = axpy(axpy(axpy(axpy(sum, w0, p0), w1, p1), w2, p2), w3, p3);
            }
            for (; k < end; ++k) sum = axpy(sum, coefficient[9 * (term_entry[k] >> 2) + (term_entry[k] & 3)], product[term_entry[k] >> 2]);
          }
          w[i] = sum;
          rz[row + q] = (double)ri.x * (double)zi.x + (double)ri.y * (double)zi.y + (double)ri.z * (double)zi.z;
          zw[row + q] = (double)sum.x * (double)zi.x + (double)sum.y * (double)zi.y + (double)sum.z * (double)zi.z;
        }
      }
    }
    TEAM_BARRIER;
    for (span = TEAM_ROWS / 2; span > 0; span /= 2) {
      TEAM_FOR(l, span)
      {
        rz[l] += rz[l + span];
        zw[l] += zw[l + span];
      }
      TEAM_BARRIER;
    }
    TEAM_FOR(l, 1)
    {
      partial[2 * t] = rz[0];
      partial[2 * t + 1] = zw[0];
    }
  }
}

/* r of rows from vertices: r = b - q, or r = b where plain = 1. */
KERNEL gather_residual(int n, GLOBAL const int *order, int plain, int wide, GLOBAL const double *b64, GLOBAL const double *q64,
                       GLOBAL const float *b32, GLOBAL const float *q32, GLOBAL real *r)
{
  FOR_EACH(i, n)
  {
    int c, at = 3 * order[i];
    for (c = 0; c < 3; ++c, ++at)
      r[3 * i + c] = wide ? (real)(plain ? b64[at] : b64[at] - q64[at]) : (real)(plain ? b32[at] : b32[at] - q32[at]);
  }
}

/* The correction joins the solution of vertices. */
KERNEL add_solution(int n, GLOBAL const int *order, GLOBAL const real *x, int wide, GLOBAL double *solution64, GLOBAL float *solution32)
{
  FOR_EACH(i, n)
  {
    int c, at = 3 * order[i];
    for (c = 0; c < 3; ++c, ++at)
      if (wide) solution64[at] += (double)x[3 * i + c]; else solution32[at] += (float)x[3 * i + c];
  }
}
