/* SPDX-License-Identifier: Apache-2.0 */
/* The conjugate gradient in one reduction an iteration (Chronopoulos and Gear 1989) on a matrix in slices; its preconditioner is in
   schwarz.h. Rows are free vertices. */

#define SLICE_ROWS 32   /* rows of the sliced matrix that share a width */
#define TEAM_ROWS 128   /* rows of a team in the matrix product */

LANES_TYPE(real, lanes);

/* Scalars of the conjugate gradient in one reduction. */
#define CG_GAMMA 0       /* r' z */
#define CG_ALPHA 1
#define CG_GOAL 2        /* of r' z */
#define CG_DONE 3        /* 1: nothing more changes */
#define CG_BROKEN 4      /* 1: not positive definite, or not finite */
#define CG_ITERATIONS 5
#define CG_START 6       /* r' z at the start */
#define CG_FORCES 7      /* f' P f of the forces without penalties */
#define CG_INNER 8       /* r' z that working precision can reach from this start */
#define CG_COUNT 9
#define CG_TEAM 256
#define CG_NUMBERS 1024  /* numbers of the vectors that a team advances */

#define CG_MEASURE_FORCES 0
#define CG_MEASURE_START 1  /* sets the goal */
#define CG_MEASURE_CHECK 2  /* the goal stays: a residual computed afresh */

/* rz[0], zw[0] = sums of the partial r'z and z'w, in an order that depends on their number alone. */
DEVICE_TEAM void sum_partials(int partials, GLOBAL const double *partial, LOCAL double *rz, LOCAL double *zw)
{
  int span;
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
}

/* Starts from a residual whose products are in `partial`. goal: tolerance^2; slack: (of the forces) a tolerance relative to huge
   penalties would leave gravity unsolved; rounding: (of slack times the forces) what is left of a solution that was right from the start;
   inner: least r'z relative to this start that working precision can reach. One team. */
KERNEL cg_start(int n, int mode, int partials, GLOBAL const double *partial, double goal, double slack, double rounding, double inner,
                GLOBAL double *scalar)
{
  TEAM_LOCAL(double, rz, CG_TEAM);
  TEAM_LOCAL(double, zw, CG_TEAM);
  FOR_EACH_TEAM(t, n)
  {
    sum_partials(partials, partial, rz, zw);
    TEAM_FOR(l, 1)
    {
      double gamma = rz[0], forces = scalar[CG_FORCES];
      if (mode == CG_MEASURE_FORCES) {
        scalar[CG_FORCES] = gamma;
      } else {
        if (mode == CG_MEASURE_START) {
          scalar[CG_START] = gamma;
          scalar[CG_GOAL] = forces > 0.0 ? max_double(goal * min_double(gamma, slack * forces), rounding * slack * forces) : goal * gamma;
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

/* One iteration's scalars and vectors: alpha and beta from the partial sums (each team for itself), then p = z + beta p, s = w + beta s,
   x += alpha p, r -= alpha s. The scalars at `from` become those at `to`. numbers: 3 rows. */
KERNEL cg_advance(int n, int numbers, int partials, GLOBAL const double *partial, int most, int from, int to, GLOBAL double *scalar,
                  GLOBAL const real *RESTRICT z, GLOBAL const real *RESTRICT w, GLOBAL real *RESTRICT p, GLOBAL real *RESTRICT s,
                  GLOBAL real *RESTRICT x, GLOBAL real *RESTRICT r)
{
  TEAM_LOCAL(double, rz, CG_TEAM);
  TEAM_LOCAL(double, zw, CG_TEAM);
  FOR_EACH_TEAM(t, n)
  {
    double before = scalar[from + CG_GAMMA], alpha = scalar[from + CG_ALPHA], done = scalar[from + CG_DONE], broken = scalar[from + CG_BROKEN];
    double iterations = scalar[from + CG_ITERATIONS], least = max_double(scalar[from + CG_GOAL], scalar[from + CG_INNER]), beta = 0.0;
    TEAM_BARRIER;
    if (done == 0.0) {
      double gamma, denominator;
      sum_partials(partials, partial, rz, zw);
      gamma = rz[0];
      denominator = zw[0];
      beta = before > 0.0 ? gamma / before : 0.0;
      if (before > 0.0) denominator -= beta * gamma / alpha;
      alpha = gamma / denominator;
      if (gamma <= least || iterations >= (double)most) done = 1.0;
      else if (!(gamma > 0.0) || !(denominator > 0.0) || !(gamma < 1e300)) done = broken = 1.0;
      else iterations += 1.0;
      before = gamma;
    }
    if (t == 0)
      TEAM_FOR(l, 1)
      {
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
    if (done == 0.0) {
      const int first = t * CG_NUMBERS, count = min_int(numbers - first, CG_NUMBERS), restart = beta == 0.0;
      const real a = (real)alpha, b = (real)beta;
      TEAM_FOR(l, count)
      {
        int i = first + l;
        real pi = restart ? z[i] : z[i] + b * p[i], si = restart ? w[i] : w[i] + b * s[i];
        p[i] = pi;
        s[i] = si;
        x[i] = (restart ? (real)0 : x[i]) + a * pi;
        r[i] -= a * si;
      }
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

#define SLICE_NUMBER(v, c) LANES_LOAD(lanes, (v) + (c) * SLICE_ROWS)

/* w = A z with the terms; partial[2 t], partial[2 t + 1] = r'z and z'w over the TEAM_ROWS rows of team t. */
KERNEL cg_multiply(int n, int rows, GLOBAL const int *slice_start, GLOBAL const int *RESTRICT column, GLOBAL const real *RESTRICT value,
                   int terms, GLOBAL const int *order, GLOBAL const int *term_row, GLOBAL const int *term_entry,
                   GLOBAL const real *coefficient, GLOBAL const vec3 *product, int at, GLOBAL const double *scalar,
                   GLOBAL const vec3 *RESTRICT z, GLOBAL const vec3 *r, GLOBAL vec3 *w, GLOBAL double *partial)
{
  TEAM_LOCAL(double, rz, TEAM_ROWS);
  TEAM_LOCAL(double, zw, TEAM_ROWS);
  if (scalar[at + CG_DONE] != 0.0) return;
  FOR_EACH_TEAM(t, n)
  {
    int span;
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

/* r of rows from vertices: r = b - q, or r = b where plain = 1; the conjugate gradient is no longer done. */
KERNEL gather_residual(int n, GLOBAL const int *order, int plain, int wide, GLOBAL const double *b64, GLOBAL const double *q64,
                       GLOBAL const float *b32, GLOBAL const float *q32, GLOBAL real *r, GLOBAL double *scalar)
{
  FOR_EACH(i, n)
  {
    int c, at = 3 * order[i];
    if (i == 0) scalar[CG_DONE] = 0.0;
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
