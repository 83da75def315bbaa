/* SPDX-License-Identifier: Apache-2.0 */
/* Lanes: numbers that a CPU computes with together as one vector; one number where a member of a team is a thread of
   its own. Part of the dialect.
     LANES_TYPE(real, lanes)           a type of LANES numbers; + - * / with each other and with one number,
                                       comparisons; int_lanes also & | ^ >>
     LANES_LOAD(lanes, p), LANES_STORE(lanes, p, v)
                                       p points to GLOBAL or LOCAL numbers; `lanes` is then GLOBAL lanes or LOCAL lanes
     LANES_ALL(lanes, number)          the number in every lane
     LANE(v, q)                        the number in lane q
     LANES_LOAD_ONCE(lanes, p)         LANES_LOAD with the hint of LOAD_ONCE (caching.h)
     LANES_SELECT(lanes, c, a, b)      a where the comparison c holds, b elsewhere
     LANES_TO(type, lanes, v)          v converted to lanes, whose numbers are of that type
     FLOAT_LANES_BITS(v), BITS_FLOAT_LANES(v)
     FOR_EACH_LANES(i, n)              FOR_EACH for every LANES-th element, the first of the LANES that are worked on
                                       together; those beyond n are left out by the loop's body
     PREFETCH(p)                       prefetches what is read at p soon, where the language can
     LANES_GATHER(real, lanes, vec4)   defines gather_lanes(v, at, &x, &y, &z): x, y and z of v[at[0]], v[at[1]], ...;
                                       scatter_lanes(v, at, count, x, y, z) writes the first `count` of them there,
                                       with zeros behind
     LANES_COLUMNS(real, lanes)        defines dot_columns(column, runs, v, &sums), products of LANES columns with v
   over `runs` runs of 16 rows: column[k] is the first column of run k, the next is 16 numbers further, and v + 16 k its
   part of v. Products with a row are summed over the runs, then the sums of rows by halves. Not with one lane */
#ifndef CAMA_KERNELS_DIALECT_LANES_H
#define CAMA_KERNELS_DIALECT_LANES_H
#include "caching.h"
#include "lang.h"

#if defined(__CUDACC__) || (defined(__OPENCL_C_VERSION__) && !defined(CAMA_CHUNKED))   /* one */
#define LANES 1
#define FOR_EACH_LANES(i, n) FOR_EACH(i, n)
#define PREFETCH(p) ((void)(p))
#define LANES_TYPE(type, lanes) typedef type lanes
#define LANES_LOAD(lanes, p) (*(p))
#define LANES_LOAD_ONCE(lanes, p) LOAD_ONCE(p)
#define LANES_STORE(lanes, p, v) (*(p) = (v))
#define LANES_ALL(lanes, v) (v)
#define LANE(v, q) (v)
#define LANES_SELECT(lanes, c, a, b) ((c) ? (a) : (b))
#define LANES_TO(type, lanes, v) ((type)(v))
#define FLOAT_LANES_BITS(v) float_bits(v)
#define BITS_FLOAT_LANES(v) bits_float(v)
#define LANES_GATHER(real, lanes, vec4)                                                                         \
  DEVICE INLINED void gather_lanes(GLOBAL const vec4 *v, GLOBAL const int *at, lanes *x, lanes *y, lanes *z)    \
  {                                                                                                             \
    const vec4 a = v[*at];                                                                                      \
    *x = a.x;                                                                                                   \
    *y = a.y;                                                                                                   \
    *z = a.z;                                                                                                   \
  }                                                                                                             \
  DEVICE INLINED void scatter_lanes(GLOBAL vec4 *v, GLOBAL const int *at, int count, lanes x, lanes y, lanes z) \
  {                                                                                                             \
    vec4 a;                                                                                                     \
    a.x = x;                                                                                                    \
    a.y = y;                                                                                                    \
    a.z = z;                                                                                                    \
    a.w = (real)0;                                                                                              \
    if (count > 0) v[*at] = a;                                                                                  \
  }

#else
/* As many floats as a register holds: where numbers of longer vectors change places, compilers move them one by one. */
#if defined(__OPENCL_C_VERSION__) || defined(__AVX512F__)
#define LANES 16
#elif defined(__AVX__)
#define LANES 8
#else
#define LANES 4
#endif
#define LANES_LOAD_ONCE LANES_LOAD

#if defined(__OPENCL_C_VERSION__)
#define FOR_EACH_LANES(i, n)                     \
  FOR_EACH(i##_group, ((n) + LANES - 1) / LANES) \
    for (int i = i##_group * LANES, i##_once = 1; i##_once; i##_once = 0)
#define PREFETCH(p) ((void)(p))
#define LANES_TYPE(type, lanes) typedef type lanes __attribute__((ext_vector_type(LANES), aligned(sizeof(type))))
#define LANES_LOAD(lanes, p) (*(const lanes *)(p))
#define LANES_STORE(lanes, p, v) (*(lanes *)(p) = (v))
#define LANES_ALL(lanes, v) ((lanes)(v))
#define LANE(v, q) (v)[q]
#define LANES_SELECT(lanes, c, a, b) ((c) ? (a) : (b))
#define LANES_CONVERT(type, v) convert_##type##16(v)
#define LANES_TO(type, lanes, v) LANES_CONVERT(type, v)
#define FLOAT_LANES_BITS(v) as_int16(v)
#define BITS_FLOAT_LANES(v) as_float16(v)
#define LANES_FOUR(q) \
  gather_from[gather_at[q]], gather_from[gather_at[q + 1]], gather_from[gather_at[q + 2]], gather_from[gather_at[q + 3]]
#define LANES_GATHER(real, lanes, vec4)                                     \
  typedef real lanes_quad __attribute__((ext_vector_type(4), aligned(16))); \
  typedef lanes gathered;
#define gather_lanes(v, at, x, y, z) /* a macro, since a call would keep every vector in memory */ \
  do {                                                                                             \
    GLOBAL const lanes_quad *gather_from = (GLOBAL const lanes_quad *)(v);                         \
    GLOBAL const int *gather_at = (at);                                                            \
    const gathered a = (gathered)(LANES_FOUR(0)), b = (gathered)(LANES_FOUR(4));                   \
    const gathered c = (gathered)(LANES_FOUR(8)), d = (gathered)(LANES_FOUR(12));                  \
    *(x) = (gathered)(a.s048c, b.s048c, c.s048c, d.s048c);                                         \
    *(y) = (gathered)(a.s159d, b.s159d, c.s159d, d.s159d);                                         \
    *(z) = (gathered)(a.s26ae, b.s26ae, c.s26ae, d.s26ae);                                         \
  } while (0)
#define scatter_lanes(v, at, count, x, y, z)                                                           \
  do {                                                                                                 \
    GLOBAL lanes_quad *scatter_to = (GLOBAL lanes_quad *)(v);                                          \
    GLOBAL const int *scatter_at = (at);                                                               \
    int q;                                                                                             \
    for (q = 0; q < (count); ++q) scatter_to[scatter_at[q]] = (lanes_quad)((x)[q], (y)[q], (z)[q], 0); \
  } while (0)
/* FOLD_n: in each run of 2 n numbers of a, then of b, the first n plus the last n. Four folds of sixteen vectors give
   their sums. */
#define FOLD_8(lanes, a, b) ((lanes)((a).lo, (b).lo) + (lanes)((a).hi, (b).hi))
#define FOLD_4(lanes, a, b) \
  ((lanes)((a).s0123, (a).s89ab, (b).s0123, (b).s89ab) + (lanes)((a).s4567, (a).scdef, (b).s4567, (b).scdef))
#define FOLD_2(lanes, a, b) ((lanes)((a).s014589cd, (b).s014589cd) + (lanes)((a).s2367abef, (b).s2367abef))
#define FOLD_1(lanes, a, b) ((lanes)((a).even, (b).even) + (lanes)((a).odd, (b).odd))
#define LANES_COLUMNS(real, lanes)                                                                             \
  DEVICE INLINED void dot_columns(LOCAL const real *const *column, int runs, LOCAL const real *v, lanes *sums) \
  {                                                                                                            \
    lanes at[16]; /* the rows of one column */                                                                 \
    int k, run;                                                                                                \
    for (k = 0; k < 16; ++k) at[k] = (lanes)(0);                                                               \
    for (run = 0; run < runs; ++run)                                                                           \
      for (k = 0; k < 16; ++k)                                                                                 \
        at[k] += LANES_LOAD(LOCAL lanes, column[run] + 16 * k) * LANES_LOAD(LOCAL lanes, v + 16 * run);        \
    for (k = 0; k < 8; ++k) at[k] = FOLD_8(lanes, at[2 * k], at[2 * k + 1]);                                   \
    for (k = 0; k < 4; ++k) at[k] = FOLD_4(lanes, at[2 * k], at[2 * k + 1]);                                   \
    for (k = 0; k < 2; ++k) at[k] = FOLD_2(lanes, at[2 * k], at[2 * k + 1]);                                   \
    *sums = FOLD_1(lanes, at[0], at[1]);                                                                       \
  }

#else
#if defined(CAMA_PARALLEL)
#define FOR_EACH_LANES(i, n) \
  CAMA_PRAGMA(omp parallel for schedule(static) if ((n) > 512)) for (int i = 0; i < (n); i += LANES)
#else
#define FOR_EACH_LANES(i, n) for (int i = 0; i < (n); i += LANES)
#endif
#define PREFETCH(p) __builtin_prefetch(p)
#define LANES_TYPE(type, lanes) \
  typedef type lanes __attribute__((vector_size(LANES * sizeof(type)), aligned(sizeof(type)), may_alias))
#define LANES_LOAD(lanes, p) (*(const lanes *)(p))
#define LANES_STORE(lanes, p, v) (*(lanes *)(p) = (v))
#define LANES_ALL(lanes, v) ((lanes){0} + (v))
#define LANE(v, q) (v)[q]
#if defined(__cplusplus)
#define LANES_SELECT(lanes, c, a, b) ((c) ? (a) : (b))
#else   /* C cannot select by vectors; a comparison has lanes of integers of the size of what it compares */
#define LANES_SELECT(lanes, c, a, b) ((lanes)(((__typeof__(c))(a) & (c)) | ((__typeof__(c))(b) & ~(c))))
#endif
#define LANES_TO(type, lanes, v) __builtin_convertvector(v, lanes)
#define FLOAT_LANES_BITS(v) ((int_lanes)(v))
#define BITS_FLOAT_LANES(v) ((float_lanes)(v))
#if !defined(__clang__)
#pragma GCC diagnostic ignored "-Wpsabi"   /* every function that takes or returns lanes is inlined */
#endif
#if defined(__has_builtin)
#if __has_builtin(__builtin_shufflevector)
#define LANES_SHUFFLE(a, b, ...) __builtin_shufflevector(a, b, __VA_ARGS__)
#endif
#endif
#if !defined(LANES_SHUFFLE)   /* GCC before 12, which cannot join quads in registers either */
#define LANES_SHUFFLE(a, b, ...) __builtin_shuffle(a, b, (__typeof__((a) < (b))){__VA_ARGS__})
#define LANES_JOIN_IN_MEMORY
#endif

/* A quad is four numbers side by side, which change places within a register: from each quad of a its numbers i, j, k
   and l, or, from 4 on, those of the quad of b. */
#define QUAD_PLACE(g, i) ((i) < 4 ? 4 * (g) + (i) : LANES - 4 + 4 * (g) + (i))
#define QUAD_PLACES(g, i, j, k, l) QUAD_PLACE(g, i), QUAD_PLACE(g, j), QUAD_PLACE(g, k), QUAD_PLACE(g, l)
#if LANES == 4
#define QUAD_SHUFFLE(a, b, i, j, k, l) LANES_SHUFFLE(a, b, QUAD_PLACES(0, i, j, k, l))
#elif LANES == 8
#define QUAD_SHUFFLE(a, b, i, j, k, l) LANES_SHUFFLE(a, b, QUAD_PLACES(0, i, j, k, l), QUAD_PLACES(1, i, j, k, l))
#else
#define QUAD_SHUFFLE(a, b, i, j, k, l)                                                                    \
  LANES_SHUFFLE(a, b, QUAD_PLACES(0, i, j, k, l), QUAD_PLACES(1, i, j, k, l), QUAD_PLACES(2, i, j, k, l), \
                QUAD_PLACES(3, i, j, k, l))
#endif

/* Vectors at[0], at[4], ..., one in each quad. */
#if defined(LANES_JOIN_IN_MEMORY)
#define LOAD_QUADS(real, lanes, vec4)                                                              \
  DEVICE INLINED void load_quads(const vec4 *v, const int *at, lanes *out)                         \
  {                                                                                                \
    int g;                                                                                         \
    for (g = 0; g < LANES / 4; ++g) ((lanes_quad *)out)[g] = *(const lanes_quad *)(v + at[4 * g]); \
  }
#elif LANES == 4
#define LOAD_QUADS(real, lanes, vec4) \
  DEVICE INLINED void load_quads(const vec4 *v, const int *at, lanes *out) { *out = *(const lanes *)(v + at[0]); }
#elif LANES == 8
#define LOAD_QUADS(real, lanes, vec4)                                                            \
  DEVICE INLINED void load_quads(const vec4 *v, const int *at, lanes *out)                       \
  {                                                                                              \
    const lanes_quad p = *(const lanes_quad *)(v + at[0]), q = *(const lanes_quad *)(v + at[4]); \
    *out = __builtin_shufflevector(p, q, 0, 1, 2, 3, 4, 5, 6, 7);                                \
  }
#else
#define LOAD_QUADS(real, lanes, vec4)                                                                        \
  typedef real lanes_octet __attribute__((vector_size(8 * sizeof(real)), aligned(sizeof(real)), may_alias)); \
  DEVICE INLINED void load_quads(const vec4 *v, const int *at, lanes *out)                                   \
  {                                                                                                          \
    const lanes_quad p = *(const lanes_quad *)(v + at[0]), q = *(const lanes_quad *)(v + at[4]);             \
    const lanes_quad r = *(const lanes_quad *)(v + at[8]), s = *(const lanes_quad *)(v + at[12]);            \
    const lanes_octet pq = __builtin_shufflevector(p, q, 0, 1, 2, 3, 4, 5, 6, 7);                            \
    const lanes_octet rs = __builtin_shufflevector(r, s, 0, 1, 2, 3, 4, 5, 6, 7);                            \
    *out = __builtin_shufflevector(pq, rs, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);            \
  }
#endif
#define LANES_GATHER(real, lanes, vec4)                                                                     \
  typedef real lanes_quad __attribute__((vector_size(4 * sizeof(real)), aligned(sizeof(real)), may_alias)); \
  LOAD_QUADS(real, lanes, vec4)                                                                             \
  DEVICE INLINED void gather_lanes(const vec4 *v, const int *at, lanes *x, lanes *y, lanes *z)              \
  {                                                                                                         \
    lanes a, b, c, d;                                                                                       \
    load_quads(v, at, &a);                                                                                  \
    load_quads(v, at + 1, &b);                                                                              \
    load_quads(v, at + 2, &c);                                                                              \
    load_quads(v, at + 3, &d);                                                                              \
    const lanes ab = QUAD_SHUFFLE(a, b, 0, 4, 1, 5), cd = QUAD_SHUFFLE(c, d, 0, 4, 1, 5);                   \
    const lanes ab_z = QUAD_SHUFFLE(a, b, 2, 6, 3, 7), cd_z = QUAD_SHUFFLE(c, d, 2, 6, 3, 7);               \
    *x = QUAD_SHUFFLE(ab, cd, 0, 1, 4, 5);                                                                  \
    *y = QUAD_SHUFFLE(ab, cd, 2, 3, 6, 7);                                                                  \
    *z = QUAD_SHUFFLE(ab_z, cd_z, 0, 1, 4, 5);                                                              \
  }                                                                                                         \
  DEVICE INLINED void scatter_lanes(vec4 *v, const int *at, int count, lanes x, lanes y, lanes z)           \
  {                                                                                                         \
    const lanes zero = LANES_ALL(lanes, (real)0);                                                           \
    const lanes xy = QUAD_SHUFFLE(x, y, 0, 4, 1, 5), z0 = QUAD_SHUFFLE(z, zero, 0, 4, 1, 5);                \
    const lanes xy_last = QUAD_SHUFFLE(x, y, 2, 6, 3, 7), z0_last = QUAD_SHUFFLE(z, zero, 2, 6, 3, 7);      \
    lanes rows[4]; /* rows k, k + 4, ..., one in each quad */                                               \
    int q;                                                                                                  \
    rows[0] = QUAD_SHUFFLE(xy, z0, 0, 1, 4, 5);                                                             \
    rows[1] = QUAD_SHUFFLE(xy, z0, 2, 3, 6, 7);                                                             \
    rows[2] = QUAD_SHUFFLE(xy_last, z0_last, 0, 1, 4, 5);                                                   \
    rows[3] = QUAD_SHUFFLE(xy_last, z0_last, 2, 3, 6, 7);                                                   \
    for (q = 0; q < count; ++q) *(lanes_quad *)(v + at[q]) = *((const lanes_quad *)&rows[q % 4] + q / 4);   \
  }

/* sum = the first eight rows plus the last, of these the first four plus the last, of columns k, k + 4, ..., one in
   each quad. at: the rows of the first of these columns, in as many vectors as they fill, then those of the next. */
#if LANES == 4
#define SUM_QUADS(lanes, at, sum) (sum) = (at)[0] + (at)[2] + ((at)[1] + (at)[3])
#elif LANES == 8
#define SUM_QUADS(lanes, at, sum)                                                                            \
  do {                                                                                                       \
    const lanes a = (at)[0] + (at)[1], b = (at)[2] + (at)[3];                                                \
    (sum) = LANES_SHUFFLE(a, b, 0, 1, 2, 3, 8, 9, 10, 11) + LANES_SHUFFLE(a, b, 4, 5, 6, 7, 12, 13, 14, 15); \
  } while (0)
#else
#define FOLD_8(a, b)                                                             \
  (LANES_SHUFFLE(a, b, 0, 1, 2, 3, 4, 5, 6, 7, 16, 17, 18, 19, 20, 21, 22, 23) + \
   LANES_SHUFFLE(a, b, 8, 9, 10, 11, 12, 13, 14, 15, 24, 25, 26, 27, 28, 29, 30, 31))
#define SUM_QUADS(lanes, at, sum)                                                            \
  do {                                                                                       \
    const lanes a = FOLD_8((at)[0], (at)[1]), b = FOLD_8((at)[2], (at)[3]);                  \
    (sum) = LANES_SHUFFLE(a, b, 0, 1, 2, 3, 8, 9, 10, 11, 16, 17, 18, 19, 24, 25, 26, 27) +  \
            LANES_SHUFFLE(a, b, 4, 5, 6, 7, 12, 13, 14, 15, 20, 21, 22, 23, 28, 29, 30, 31); \
  } while (0)
#endif
#define LANES_COLUMNS(real, lanes)                                                                       \
  DEVICE INLINED void dot_columns(const real *const *column, int runs, const real *v, lanes *sums)       \
  {                                                                                                      \
    lanes quads[4], first, last;                                                                         \
    int k, run, j;                                                                                       \
    for (k = 0; k < 4; ++k) {                                                                            \
      lanes at[4]; /* so few that they stay in registers */                                              \
      for (j = 0; j < 4; ++j) at[j] = LANES_ALL(lanes, (real)0);                                         \
      for (run = 0; run < runs; ++run)                                                                   \
        for (j = 0; j < 4; ++j) {                                                                        \
          const int place = j % (16 / LANES) * LANES;                                                    \
          at[j] += LANES_LOAD(lanes, column[run] + 16 * (k + j / (16 / LANES) * 4) + place) *            \
                   LANES_LOAD(lanes, v + 16 * run + place);                                              \
        }                                                                                                \
      SUM_QUADS(lanes, at, quads[k]);                                                                    \
    }                                                                                                    \
    first = QUAD_SHUFFLE(quads[0], quads[1], 0, 1, 4, 5) + QUAD_SHUFFLE(quads[0], quads[1], 2, 3, 6, 7); \
    last = QUAD_SHUFFLE(quads[2], quads[3], 0, 1, 4, 5) + QUAD_SHUFFLE(quads[2], quads[3], 2, 3, 6, 7);  \
    *sums = QUAD_SHUFFLE(first, last, 0, 2, 4, 6) + QUAD_SHUFFLE(first, last, 1, 3, 5, 7);               \
  }
#endif
#endif

LANES_TYPE(short, short_lanes);
LANES_TYPE(int, int_lanes);
LANES_TYPE(float, float_lanes);
LANES_TYPE(double, double_lanes);

#endif
