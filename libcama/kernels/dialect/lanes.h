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
     PREFETCH(p)                       prefetches what is read at p soon, where the language can
     LANES_GATHER(real, lanes, vec4)   defines gather_lanes(v, at, &x, &y, &z): x, y and z of v[at[0]], v[at[1]], ...
     LANES_COLUMNS(real, lanes)        defines lanes_columns, sums over 16 rows of LANES columns times a vector:
                                       clear_columns(&c), add_columns(&c, column, stride, v), sum_columns(&c, &sums);
                                       `column` is the first, the next is `stride` further. With one lane c.at holds
                                       the sums of the 16 rows, and there is no add_columns */
#ifndef CAMA_KERNELS_DIALECT_LANES_H
#define CAMA_KERNELS_DIALECT_LANES_H
#include "caching.h"
#include "lang.h"

#if defined(__CUDACC__) || (defined(__OPENCL_C_VERSION__) && !defined(CAMA_CHUNKED))   /* one */
#define LANES 1
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
#define LANES_GATHER(real, lanes, vec4)                                                                      \
  DEVICE INLINED void gather_lanes(GLOBAL const vec4 *v, GLOBAL const int *at, lanes *x, lanes *y, lanes *z) \
  {                                                                                                          \
    const vec4 a = v[*at];                                                                                   \
    *x = a.x;                                                                                                \
    *y = a.y;                                                                                                \
    *z = a.z;                                                                                                \
  }
#define LANES_COLUMNS(real, lanes)                               \
  typedef struct {                                               \
    real at[16];                                                 \
  } lanes_columns;   /* rows */                                    \
  DEVICE INLINED void clear_columns(lanes_columns *c)            \
  {                                                              \
    int q;                                                       \
    for (q = 0; q < 16; ++q) c->at[q] = (real)0;                 \
  }                                                              \
  DEVICE INLINED void sum_columns(lanes_columns *c, lanes *sums) \
  {                                                              \
    int q;                                                       \
    for (q = 0; q < 8; ++q) c->at[q] += c->at[q + 8];            \
    for (q = 0; q < 4; ++q) c->at[q] += c->at[q + 4];            \
    *sums = c->at[0] + c->at[2] + (c->at[1] + c->at[3]);         \
  }

#else
#define LANES 16
#define LANES_LOAD_ONCE LANES_LOAD

#if defined(__OPENCL_C_VERSION__)
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
#define FOLD_8(lanes, a, b) ((lanes)((a).lo, (b).lo) + (lanes)((a).hi, (b).hi))
#define FOLD_4(lanes, a, b) \
  ((lanes)((a).s0123, (a).s89ab, (b).s0123, (b).s89ab) + (lanes)((a).s4567, (a).scdef, (b).s4567, (b).scdef))
#define FOLD_2(lanes, a, b) ((lanes)((a).s014589cd, (b).s014589cd) + (lanes)((a).s2367abef, (b).s2367abef))
#define FOLD_1(lanes, a, b) ((lanes)((a).even, (b).even) + (lanes)((a).odd, (b).odd))

#else
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
#define LANES_SHUFFLES
#endif
#endif
#if defined(LANES_SHUFFLES)   /* four numbers at a time, transposed in registers */
#define LANES_GATHER(real, lanes, vec4)                                                                           \
  typedef real lanes_quad __attribute__((vector_size(4 * sizeof(real)), aligned(16), may_alias));                 \
  typedef real lanes_octet __attribute__((vector_size(8 * sizeof(real)), aligned(16), may_alias));                \
  DEVICE INLINED void load_four(const vec4 *v, const int *at, lanes *out)                                         \
  {                                                                                                               \
    const lanes_quad p = *(const lanes_quad *)(v + at[0]), q = *(const lanes_quad *)(v + at[1]);                  \
    const lanes_quad r = *(const lanes_quad *)(v + at[2]), s = *(const lanes_quad *)(v + at[3]);                  \
    const lanes_octet pq = __builtin_shufflevector(p, q, 0, 1, 2, 3, 4, 5, 6, 7);                                 \
    const lanes_octet rs = __builtin_shufflevector(r, s, 0, 1, 2, 3, 4, 5, 6, 7);                                 \
    *out = __builtin_shufflevector(pq, rs, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);                 \
  }                                                                                                               \
  DEVICE INLINED void gather_lanes(const vec4 *v, const int *at, lanes *x, lanes *y, lanes *z)                    \
  {                                                                                                               \
    lanes a, b, c, d;                                                                                             \
    load_four(v, at, &a);                                                                                         \
    load_four(v, at + 4, &b);                                                                                     \
    load_four(v, at + 8, &c);                                                                                     \
    load_four(v, at + 12, &d);                                                                                    \
    const lanes ab = __builtin_shufflevector(a, b, 0, 4, 8, 12, 16, 20, 24, 28, 1, 5, 9, 13, 17, 21, 25, 29);     \
    const lanes cd = __builtin_shufflevector(c, d, 0, 4, 8, 12, 16, 20, 24, 28, 1, 5, 9, 13, 17, 21, 25, 29);     \
    const lanes ab_z = __builtin_shufflevector(a, b, 2, 6, 10, 14, 18, 22, 26, 30, 2, 6, 10, 14, 18, 22, 26, 30); \
    const lanes cd_z = __builtin_shufflevector(c, d, 2, 6, 10, 14, 18, 22, 26, 30, 2, 6, 10, 14, 18, 22, 26, 30); \
    *x = __builtin_shufflevector(ab, cd, 0, 1, 2, 3, 4, 5, 6, 7, 16, 17, 18, 19, 20, 21, 22, 23);                 \
    *y = __builtin_shufflevector(ab, cd, 8, 9, 10, 11, 12, 13, 14, 15, 24, 25, 26, 27, 28, 29, 30, 31);           \
    *z = __builtin_shufflevector(ab_z, cd_z, 0, 1, 2, 3, 4, 5, 6, 7, 16, 17, 18, 19, 20, 21, 22, 23);             \
  }
#define FOLD_8(lanes, a, b)                                                                \
  (__builtin_shufflevector(a, b, 0, 1, 2, 3, 4, 5, 6, 7, 16, 17, 18, 19, 20, 21, 22, 23) + \
   __builtin_shufflevector(a, b, 8, 9, 10, 11, 12, 13, 14, 15, 24, 25, 26, 27, 28, 29, 30, 31))
#define FOLD_4(lanes, a, b)                                                                  \
  (__builtin_shufflevector(a, b, 0, 1, 2, 3, 8, 9, 10, 11, 16, 17, 18, 19, 24, 25, 26, 27) + \
   __builtin_shufflevector(a, b, 4, 5, 6, 7, 12, 13, 14, 15, 20, 21, 22, 23, 28, 29, 30, 31))
#define FOLD_2(lanes, a, b)                                                                  \
  (__builtin_shufflevector(a, b, 0, 1, 4, 5, 8, 9, 12, 13, 16, 17, 20, 21, 24, 25, 28, 29) + \
   __builtin_shufflevector(a, b, 2, 3, 6, 7, 10, 11, 14, 15, 18, 19, 22, 23, 26, 27, 30, 31))
#define FOLD_1(lanes, a, b)                                                                   \
  (__builtin_shufflevector(a, b, 0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30) + \
   __builtin_shufflevector(a, b, 1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27, 29, 31))
#else
#define LANES_GATHER(real, lanes, vec4)                                                        \
  DEVICE INLINED void gather_lanes(const vec4 *v, const int *at, lanes *x, lanes *y, lanes *z) \
  {                                                                                            \
    int q;                                                                                     \
    for (q = 0; q < LANES; ++q) {                                                              \
      (*x)[q] = v[at[q]].x;                                                                    \
      (*y)[q] = v[at[q]].y;                                                                    \
      (*z)[q] = v[at[q]].z;                                                                    \
    }                                                                                          \
  }
#define FOLD_EACH(lanes, a, b, width)                                             \
  ({                                                                              \
    lanes fold_a = (a), fold_b = (b), fold_sum;                                   \
    int fold_q;                                                                   \
    for (fold_q = 0; fold_q < LANES / 2; ++fold_q) {                              \
      const int fold_at = fold_q % (width) + 2 * (width) * (fold_q / (width));    \
      fold_sum[fold_q] = fold_a[fold_at] + fold_a[fold_at + (width)];             \
      fold_sum[LANES / 2 + fold_q] = fold_b[fold_at] + fold_b[fold_at + (width)]; \
    }                                                                             \
    fold_sum;                                                                     \
  })
#define FOLD_8(lanes, a, b) FOLD_EACH(lanes, a, b, 8)
#define FOLD_4(lanes, a, b) FOLD_EACH(lanes, a, b, 4)
#define FOLD_2(lanes, a, b) FOLD_EACH(lanes, a, b, 2)
#define FOLD_1(lanes, a, b) FOLD_EACH(lanes, a, b, 1)
#endif
#endif

/* FOLD_n: in each run of 2 n numbers of a, then of b, the first n plus the last n. Four folds of sixteen vectors give
   their sums. */
#define LANES_COLUMNS(real, lanes)                                                                             \
  typedef struct {                                                                                             \
    lanes at[16];                                                                                              \
  } lanes_columns;   /* columns */                                                                               \
  DEVICE INLINED void clear_columns(lanes_columns *c)                                                          \
  {                                                                                                            \
    int k;                                                                                                     \
    for (k = 0; k < 16; ++k) c->at[k] = LANES_ALL(lanes, (real)0);                                             \
  }                                                                                                            \
  DEVICE INLINED void add_columns(lanes_columns *c, LOCAL const real *column, int stride, LOCAL const real *v) \
  {                                                                                                            \
    const lanes own = LANES_LOAD(LOCAL lanes, v);                                                              \
    int k;                                                                                                     \
    for (k = 0; k < 16; ++k) c->at[k] += LANES_LOAD(LOCAL lanes, column + k * stride) * own;                   \
  }                                                                                                            \
  DEVICE INLINED void sum_columns(lanes_columns *c, lanes *sums)                                               \
  {                                                                                                            \
    int k;                                                                                                     \
    for (k = 0; k < 8; ++k) c->at[k] = FOLD_8(lanes, c->at[2 * k], c->at[2 * k + 1]);                          \
    for (k = 0; k < 4; ++k) c->at[k] = FOLD_4(lanes, c->at[2 * k], c->at[2 * k + 1]);                          \
    for (k = 0; k < 2; ++k) c->at[k] = FOLD_2(lanes, c->at[2 * k], c->at[2 * k + 1]);                          \
    *sums = FOLD_1(lanes, c->at[0], c->at[1]);                                                                 \
  }
#endif

LANES_TYPE(int, int_lanes);
LANES_TYPE(float, float_lanes);
LANES_TYPE(double, double_lanes);

#endif
