/* SPDX-License-Identifier: Apache-2.0 */
/* The kernel dialect: one text, valid as C99, C++17, CUDA C++ and OpenCL C 1.2. Only the dialect (this file, lanes.h
   and caching.h) has #if on the language. `real` is the working precision, double or float; it is defined by the file
   that includes the kernels. */
#ifndef CAMA_KERNELS_DIALECT_LANG_H
#define CAMA_KERNELS_DIALECT_LANG_H

#if defined(__OPENCL_C_VERSION__)
#pragma OPENCL EXTENSION cl_khr_fp64 : enable
#pragma OPENCL EXTENSION cl_khr_int64_base_atomics : enable
#pragma OPENCL FP_CONTRACT OFF
#define KERNEL __kernel void
#define KERNEL_OF(members, teams) KERNEL
#define DEVICE static inline
#define DEVICE_ATOMIC DEVICE /* element functions that use atomics */
#define DEVICE_TEAM DEVICE   /* functions that a whole team calls */
#define GLOBAL __global
#define RESTRICT restrict
#if defined(CAMA_CHUNKED) /* on CPUs: every work-item has a contiguous run of elements */
#define CHUNK_BEGIN(n, item) ((int)((long)(n) * (long)(item) / (long)get_global_size(0)))
#define FOR_EACH(i, n) \
  for (int i = CHUNK_BEGIN(n, get_global_id(0)), i##_end = CHUNK_BEGIN(n, get_global_id(0) + 1); i < i##_end; ++i)
#else
#define FOR_EACH(i, n) for (int i = (int)get_global_id(0); i < (n); i += (int)get_global_size(0))
#endif
#define FOR_EACH_UNEVEN(i, n) FOR_EACH(i, n)
#define LOCAL __local
#define ALIGNED(n) __attribute__((aligned(n)))
#define TEAM_LOCAL_MEMORY(type, name, count) __local type name[count] ALIGNED(64)
#define TEAM_LOCAL TEAM_LOCAL_MEMORY
#if defined(CAMA_CHUNKED) /* a team is one work-item */
#define AT_ONCE(most) 1
#define FOR_EACH_TEAM(t, n) FOR_EACH(t, n)
#define TEAM_FOR(l, m) for (int l = 0; l < (m); ++l)
#define SIMD
#define TEAM_BARRIER
static inline int local_add_int(LOCAL int *p, int v)
{
  *p += v;
  return *p - v;
}
static inline void local_or_int(LOCAL int *p, int v) { *p |= v; }
#else
static inline int local_add_int(volatile LOCAL int *p, int v) { return atomic_add(p, v); }
static inline void local_or_int(volatile LOCAL int *p, int v) { atomic_or(p, v); }
#define FOR_EACH_TEAM(t, n) for (int t = (int)get_group_id(0); t < (n); t += (int)get_num_groups(0))
#define TEAM_FOR(l, m) for (int l = (int)get_local_id(0); l < (m); l += (int)get_local_size(0))
#define SIMD
#define TEAM_BARRIER barrier(CLK_LOCAL_MEM_FENCE | CLK_GLOBAL_MEM_FENCE)
#endif
typedef ulong key64;
DEVICE int atomic_add_int(volatile GLOBAL int *p, int v) { return atomic_add(p, v); }
DEVICE int atomic_min_int(volatile GLOBAL int *p, int v) { return atomic_min(p, v); }
DEVICE int atomic_max_int(volatile GLOBAL int *p, int v) { return atomic_max(p, v); }
DEVICE int float_bits(float x) { return as_int(x); }
DEVICE float bits_float(int i) { return as_float(i); }
DEVICE int lowest_bit(key64 v) { return (int)popcount((v & -v) - 1); }
DEVICE void atomic_add_double(volatile GLOBAL double *p, double v)
{
  volatile GLOBAL ulong *word = (volatile GLOBAL ulong *)p;
  ulong old = *word, seen;
  do {
    seen = old;
    old = atom_cmpxchg(word, seen, as_ulong(as_double(seen) + v));
  } while (old != seen);
}
DEVICE void atomic_add_float(volatile GLOBAL float *p, float v)
{
  volatile GLOBAL uint *word = (volatile GLOBAL uint *)p;
  uint old = *word, seen;
  do {
    seen = old;
    old = atomic_cmpxchg(word, seen, as_uint(as_float(seen) + v));
  } while (old != seen);
}

#else
#include <math.h>
#include <stdint.h>
#include <string.h>
#define GLOBAL
#define LOCAL
typedef unsigned long long key64;

#if defined(__CUDACC__)
#if defined(CAMA_INTERPRETED) /* the functions of interpreted_teams.h; KERNEL is called by the interpreter */
#define KERNEL static __device__ inline void
#define KERNEL_OF(members, teams) KERNEL
#else
#define KERNEL static __global__ void
#define KERNEL_OF(members, teams) static __global__ void __launch_bounds__(members, teams)
#endif
#define DEVICE static __host__ __device__ inline
#define DEVICE_ATOMIC static __device__ inline
#define DEVICE_TEAM static __device__ inline
#define RESTRICT __restrict__
#if !defined(CAMA_INTERPRETED) && defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 900
#define BEGINS_EARLY 1
static __device__ __forceinline__ void await_launches(void)
{
  asm volatile("griddepcontrol.wait;\n\tgriddepcontrol.launch_dependents;" ::: "memory");
}
#define AWAIT_LAUNCHES await_launches()
/* A launch beside the one before it (Backend::begin_side_by_side) has dynamic memory, which kernels use for nothing
   else. It waits when it ends, so that the one behind it waits for both. What was written before the first of these
   launches has arrived when that one let the others begin; the fence leaves nothing older in the cache. */
static __device__ __forceinline__ bool launched_beside(void)
{
  unsigned int bytes;
  asm volatile("mov.u32 %0, %%dynamic_smem_size;" : "=r"(bytes));
  return bytes != 0;
}
struct launch_order {
  __device__ __forceinline__ launch_order()
  {
    if (launched_beside())
      asm volatile("griddepcontrol.launch_dependents;\n\tfence.acq_rel.gpu;" ::: "memory");
    else
      await_launches();
  }
  __device__ __forceinline__ ~launch_order()
  {
    if (launched_beside()) asm volatile("griddepcontrol.wait;" ::: "memory");
  }
};
#define ORDER_NAME(line) ORDER_NAMED(line)
#define ORDER_NAMED(line) order_##line
#define AWAIT_IN_ORDER const launch_order ORDER_NAME(__LINE__)
#endif
#define FOR_EACH_EARLY(i, n) \
  for (int i = (int)(blockIdx.x * blockDim.x + threadIdx.x); i < (n); i += (int)(gridDim.x * blockDim.x))
#define ALIGNED(n) __align__(n)
#define SIMD
#if defined(CAMA_INTERPRETED)
#define TEAM_LOCAL(type, name, count) type *const name = team_memory<type>(count)
#define FOR_EACH_TEAM_EARLY(t, n) for (int t = first_team(); t < (n); t += teams_at_once())
#define TEAM_FOR(l, m) for (int l = team_member(); l < (m); l += team_size())
#define TEAM_BARRIER team_barrier()
#else
#define TEAM_LOCAL(type, name, count) __shared__ ALIGNED(16) type name[count]
#define FOR_EACH_TEAM_EARLY(t, n) for (int t = (int)blockIdx.x; t < (n); t += (int)gridDim.x)
#define TEAM_FOR(l, m) for (int l = (int)threadIdx.x; l < (m); l += (int)blockDim.x)
#define TEAM_BARRIER __syncthreads()
#endif
#define WHILE_ANY(c) for (unsigned int side_by_side = __activemask(); __any_sync(side_by_side, c);)
#if defined(__CUDA_ARCH__)
DEVICE int lowest_bit(key64 v) { return __ffsll((long long)v) - 1; }
#else
DEVICE int lowest_bit(key64 v) { return __builtin_ctzll(v); }
#endif
static __device__ inline int atomic_add_int(int *p, int v) { return atomicAdd(p, v); }
static __device__ inline int local_add_int(int *p, int v) { return atomicAdd(p, v); }
static __device__ inline void local_or_int(int *p, int v) { atomicOr(p, v); }
static __device__ inline int atomic_min_int(int *p, int v) { return atomicMin(p, v); }
static __device__ inline int atomic_max_int(int *p, int v) { return atomicMax(p, v); }
DEVICE int float_bits(float x)
{
  int i;
  memcpy(&i, &x, sizeof i);
  return i;
}
DEVICE float bits_float(int i)
{
  float x;
  memcpy(&x, &i, sizeof x);
  return x;
}
static __device__ inline void atomic_add_double(double *p, double v) { atomicAdd(p, v); }
static __device__ inline void atomic_add_float(float *p, float v) { atomicAdd(p, v); }

#else
#if defined(__cplusplus)
#define KERNEL inline void
#define DEVICE inline
#define DEVICE_SELDOM inline __attribute__((noinline))
#define RESTRICT __restrict__
#else
#define KERNEL static inline void
#define DEVICE static inline
#define DEVICE_SELDOM static __attribute__((noinline, unused))
#define RESTRICT restrict
#endif
#define KERNEL_OF(members, teams) KERNEL
#define AT_ONCE(most) 1
#define DEVICE_ATOMIC DEVICE
#define DEVICE_TEAM DEVICE
#define CAMA_PRAGMA(text) _Pragma(#text)
#if defined(_OPENMP) && !defined(CAMA_SERIAL) /* a caller with one thread has kernels without parallel loops */
#define CAMA_PARALLEL
#endif
#if defined(CAMA_PARALLEL)
#define FOR_EACH(i, n) CAMA_PRAGMA(omp parallel for schedule(static) if ((n) > 512)) for (int i = 0; i < (n); ++i)
#define FOR_EACH_UNEVEN(i, n) \
  CAMA_PRAGMA(omp parallel for schedule(dynamic, 64) if ((n) > 64)) for (int i = 0; i < (n); ++i)
#else
#define FOR_EACH(i, n) for (int i = 0; i < (n); ++i)
#define FOR_EACH_UNEVEN(i, n) FOR_EACH(i, n)
#endif
#define ALIGNED(n) __attribute__((aligned(n)))
#define TEAM_LOCAL(type, name, count) static __thread type name[count] ALIGNED(64)
#if defined(CAMA_PARALLEL)
#define FOR_EACH_TEAM(t, n) CAMA_PRAGMA(omp parallel for schedule(static) if ((n) > 8)) for (int t = 0; t < (n); ++t)
#define FOR_EACH_UNEVEN_TEAM(t, n) \
  CAMA_PRAGMA(omp parallel for schedule(dynamic) if ((n) > 1)) for (int t = 0; t < (n); ++t)
#else
#define FOR_EACH_TEAM(t, n) for (int t = 0; t < (n); ++t)
#endif
#define TEAM_FOR(l, m) for (int l = 0; l < (m); ++l)
DEVICE void *team_pointer(void *p)
{
#if defined(__GNUC__)
  __asm__("" : "+r"(p));
#endif
  return p;
}
#define TEAM_POINTER(type, p) ((type *)team_pointer(p))
#if defined(_OPENMP)
#define SIMD CAMA_PRAGMA(omp simd)   /* before a loop whose iterations are independent */
#else
#define SIMD
#endif
#define TEAM_BARRIER
DEVICE int lowest_bit(key64 v) { return __builtin_ctzll(v); }
#if defined(__AVX2__) && defined(__GNUC__)
#define EIGHT_BITS
DEVICE int eight_bits(const int *flag)
{
  typedef int ints __attribute__((vector_size(32)));
  typedef float floats __attribute__((vector_size(32)));
  ints flags;
  memcpy(&flags, flag, sizeof flags);
  return __builtin_ia32_movmskps256((floats)(flags << 31));
}
#endif
/* A team is one thread. */
DEVICE int local_add_int(int *p, int v)
{
  *p += v;
  return *p - v;
}
DEVICE void local_or_int(int *p, int v) { *p |= v; }
DEVICE int atomic_add_int(int *p, int v) { return __atomic_fetch_add(p, v, __ATOMIC_RELAXED); }
DEVICE int atomic_min_int(int *p, int v)
{
  int seen = __atomic_load_n(p, __ATOMIC_RELAXED);
  while (v < seen && !__atomic_compare_exchange_n(p, &seen, v, 0, __ATOMIC_RELAXED, __ATOMIC_RELAXED)) {
  }
  return seen;
}
DEVICE int atomic_max_int(int *p, int v)
{
  int seen = __atomic_load_n(p, __ATOMIC_RELAXED);
  while (v > seen && !__atomic_compare_exchange_n(p, &seen, v, 0, __ATOMIC_RELAXED, __ATOMIC_RELAXED)) {
  }
  return seen;
}
DEVICE int float_bits(float x)
{
  int i;
  memcpy(&i, &x, sizeof i);
  return i;
}
DEVICE float bits_float(int i)
{
  float x;
  memcpy(&x, &i, sizeof x);
  return x;
}
DEVICE void atomic_add_double(double *p, double v)
{
  int64_t seen, next;
  double sum;
  memcpy(&seen, p, sizeof seen);
  do {
    memcpy(&sum, &seen, sizeof sum);
    sum += v;
    memcpy(&next, &sum, sizeof next);
  } while (!__atomic_compare_exchange_n((int64_t *)p, &seen, next, 0, __ATOMIC_RELAXED, __ATOMIC_RELAXED));
}
DEVICE void atomic_add_float(float *p, float v)
{
  int32_t seen, next;
  float sum;
  memcpy(&seen, p, sizeof seen);
  do {
    memcpy(&sum, &seen, sizeof sum);
    sum += v;
    memcpy(&next, &sum, sizeof next);
  } while (!__atomic_compare_exchange_n((int32_t *)p, &seen, next, 0, __ATOMIC_RELAXED, __ATOMIC_RELAXED));
}
#endif
#endif

/* Where BEGINS_EARLY is 1, a launch begins while the one before it ends; AWAIT_LAUNCHES waits for that one. FOR_EACH
   and FOR_EACH_TEAM wait before their first element, or, in a launch beside that one, when they end; a kernel that
   reads memory before these waits first. After FOR_EACH_EARLY and FOR_EACH_TEAM_EARLY each work-item waits by itself:
   before, it reads only what was written two launches ago or earlier, and writes nothing. */
#if !defined(BEGINS_EARLY)
#define BEGINS_EARLY 0
#define AWAIT_LAUNCHES (void)0
#endif
#if !defined(AWAIT_IN_ORDER)
#define AWAIT_IN_ORDER AWAIT_LAUNCHES
#endif
#if defined(FOR_EACH_EARLY)
#define FOR_EACH(i, n) \
  AWAIT_IN_ORDER;      \
  FOR_EACH_EARLY(i, n)
#define FOR_EACH_UNEVEN(i, n) FOR_EACH(i, n)
#define FOR_EACH_TEAM(t, n) \
  AWAIT_IN_ORDER;           \
  FOR_EACH_TEAM_EARLY(t, n)
#else
#define FOR_EACH_EARLY(i, n) FOR_EACH(i, n)
#define FOR_EACH_TEAM_EARLY(t, n) FOR_EACH_TEAM(t, n)
#endif

/* A sum over a list whose loads do not wait for each other: a work-item of a GPU reads up to `most` elements before it
   adds the first, one of a CPU a single element.

     for (k = begin; k < end; k += AT_ONCE(8)) {
       real own[AT_ONCE(8)];
       FOR_AT_ONCE(q, 8, end - k) own[q] = value[list[k + q]];
       FOR_AT_ONCE(q, 8, end - k) sum += own[q];
     } */
#if !defined(AT_ONCE)
#define AT_ONCE(most) (most)
#endif
#define FOR_AT_ONCE(q, most, left)        \
  for (int q = 0; q < AT_ONCE(most); ++q) \
    if (q < (left))

/* A function that few iterations of a loop call: CPUs do not compile it into the loop. */
#if !defined(DEVICE_SELDOM)
#define DEVICE_SELDOM DEVICE
#endif

/* WHILE_ANY(c) { if (c) ... }: a loop that work-items leave at different times. Where work-items run in lockstep, they
   stay together until the last has left, and execute the common part of each iteration at the same time. lowest_bit(v):
   number of the lowest bit of v that is 1; v != 0. eight_bits(flag): bit k is flag[k], which is 0 or 1. */
#if !defined(WHILE_ANY)
#define WHILE_ANY(c) while (c)
#endif
#if !defined(EIGHT_BITS)
DEVICE int eight_bits(const int *flag)
{
  int bits = 0;
  for (int k = 0; k < 8; ++k) bits |= flag[k] << k;
  return bits;
}
#endif

/* Teams: the work-items of one group share TEAM_LOCAL memory. Between two TEAM_BARRIERs a member writes only what no
   other member reads.

     KERNEL k(int n, ...)
     {
       TEAM_LOCAL(real, a, 128);
       FOR_EACH_TEAM(t, n) {
         TEAM_FOR(l, 128) a[l] = ...;
         TEAM_BARRIER;
       }
     }

   KERNEL_OF(members, teams) k(int n, ...) has teams of that many members, and so few registers that that many teams fit
   on a multiprocessor. Kernels that wait for memory have few teams, each with more loads in flight.
   TEAM_POINTER(type, a) points to TEAM_LOCAL memory: on a CPU the address of a thread's own memory takes a call, which
   compilers otherwise repeat in inner loops.
   On a CPU a team is one thread: its loops run over all members, LANES of them together as one vector where the kernel
   is written for that (lanes.h):

     TEAM_FOR_LANES(j, m) { lanes sum = LANES_ALL(lanes, 0); sum += LANES_LOAD(lanes, p + j) * x; } */
#if !defined(FOR_EACH_UNEVEN_TEAM)
#define FOR_EACH_UNEVEN_TEAM(t, n) FOR_EACH_TEAM(t, n)
#endif
#if !defined(TEAM_POINTER)
#define TEAM_POINTER(type, p) (p)
#endif
#define TEAM_FOR_LANES(j, m)                     \
  TEAM_FOR(j##_group, ((m) + LANES - 1) / LANES) \
    for (int j = j##_group * LANES, j##_once = 1; j##_once; j##_once = 0)
#define FOR_LANES(q) for (int q = 0; q < LANES; ++q)

#if defined(__GNUC__) && !defined(__CUDACC__) && !(defined(__OPENCL_C_VERSION__) && !defined(CAMA_CHUNKED))
#define INLINED __attribute__((always_inline)) /* called in a loop whose iterations run in lanes */
#else
#define INLINED
#endif

/* Comparisons written out: fmin and fmax treat signed zeros differently in different languages. */
DEVICE double min_double(double a, double b) { return a < b ? a : b; }
DEVICE double max_double(double a, double b) { return a > b ? a : b; }
DEVICE double clamp_double(double x, double lo, double hi) { return min_double(max_double(x, lo), hi); }
DEVICE int min_int(int a, int b) { return a < b ? a : b; }
DEVICE int max_int(int a, int b) { return a > b ? a : b; }

#endif
