/* SPDX-License-Identifier: Apache-2.0 */
/* Hints for the cache: which data a loop only streams through, and which are read again. Part of the dialect.
     LOAD_ONCE(p)                      *p, which is read once and may be evicted first
     LOAD_ONCE_NEAR(p)                 *p, which is read again only when a small cache has lost it
     LOAD_KEPT(p), STORE_KEPT(p, v)    *p, which the next kernels read again
   They change no value and no bit, and are plain accesses where the language has no such hints. */
#ifndef CAMA_KERNELS_DIALECT_CACHING_H
#define CAMA_KERNELS_DIALECT_CACHING_H
#include "lang.h"

#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 800 && !defined(CAMA_INTERPRETED) /* which writes what it loads */
typedef unsigned long long cache_policy;
static __device__ __forceinline__ cache_policy once_policy()
{
  cache_policy p;
  asm("createpolicy.fractional.L2::evict_first.b64 %0, 1.0;" : "=l"(p));
  return p;
}
static __device__ __forceinline__ cache_policy kept_policy()
{
  cache_policy p;
  asm("createpolicy.fractional.L2::evict_last.b64 %0, 1.0;" : "=l"(p));
  return p;
}
template <class T> static __device__ __forceinline__ T LOAD_ONCE(const T *from)
{
  static_assert(sizeof(T) == 4 || sizeof(T) == 8, "a number");
  T v;
  if constexpr (sizeof(T) == 4) {
    unsigned int bits;
    asm volatile("ld.global.nc.L1::no_allocate.L2::cache_hint.b32 %0, [%1], %2;"
                 : "=r"(bits)
                 : "l"(from), "l"(once_policy()));
    memcpy(&v, &bits, sizeof v);
  } else {
    unsigned long long bits;
    asm volatile("ld.global.nc.L1::no_allocate.L2::cache_hint.b64 %0, [%1], %2;"
                 : "=l"(bits)
                 : "l"(from), "l"(once_policy()));
    memcpy(&v, &bits, sizeof v);
  }
  return v;
}
template <class T> static __device__ __forceinline__ T LOAD_KEPT(const T *from)
{
  static_assert(sizeof(T) == 4 || sizeof(T) == 8 || sizeof(T) % 16 == 0, "a number or a vector of the solve");
  T v;
  if constexpr (sizeof(T) == 4) {
    unsigned int bits;
    asm volatile("ld.global.L2::cache_hint.b32 %0, [%1], %2;" : "=r"(bits) : "l"(from), "l"(kept_policy()));
    memcpy(&v, &bits, sizeof v);
  } else if constexpr (sizeof(T) == 8) {
    unsigned long long bits;
    asm volatile("ld.global.L2::cache_hint.b64 %0, [%1], %2;" : "=l"(bits) : "l"(from), "l"(kept_policy()));
    memcpy(&v, &bits, sizeof v);
  } else {
    unsigned long long bits[sizeof(T) / 8];
    for (unsigned int i = 0; i < sizeof(T) / 8; i += 2)
      asm volatile("ld.global.L2::cache_hint.v2.b64 {%0, %1}, [%2], %3;"
                   : "=l"(bits[i]), "=l"(bits[i + 1])
                   : "l"(reinterpret_cast<const unsigned long long *>(from) + i), "l"(kept_policy()));
    memcpy(&v, bits, sizeof v);
  }
  return v;
}
template <class T> static __device__ __forceinline__ void STORE_KEPT(T *to, const T &v)
{
  static_assert(sizeof(T) == 4 || sizeof(T) == 8 || sizeof(T) % 16 == 0, "a number or a vector of the solve");
  if constexpr (sizeof(T) == 4) {
    unsigned int bits;
    memcpy(&bits, &v, sizeof v);
    asm volatile("st.global.L2::cache_hint.b32 [%0], %1, %2;" ::"l"(to), "r"(bits), "l"(kept_policy()) : "memory");
  } else if constexpr (sizeof(T) == 8) {
    unsigned long long bits;
    memcpy(&bits, &v, sizeof v);
    asm volatile("st.global.L2::cache_hint.b64 [%0], %1, %2;" ::"l"(to), "l"(bits), "l"(kept_policy()) : "memory");
  } else {
    unsigned long long bits[sizeof(T) / 8];
    memcpy(bits, &v, sizeof v);
    for (unsigned int i = 0; i < sizeof(T) / 8; i += 2)
      asm volatile(
          "st.global.L2::cache_hint.v2.b64 [%0], {%1, %2}, %3;" ::"l"(reinterpret_cast<unsigned long long *>(to) + i),
          "l"(bits[i]), "l"(bits[i + 1]), "l"(kept_policy())
          : "memory");
  }
}
#else
#if defined(__CUDA_ARCH__) && defined(CAMA_INTERPRETED) /* worlds share the cache of a multiprocessor */
template <class T> static __device__ __forceinline__ T LOAD_ONCE(const T *from)
{
  static_assert(sizeof(T) == 4 || sizeof(T) == 8 || sizeof(T) == 16, "a number or four words");
  T v;
  if constexpr (sizeof(T) == 4) {
    unsigned int bits;
    asm volatile("ld.global.L1::no_allocate.b32 %0, [%1];" : "=r"(bits) : "l"(from));
    memcpy(&v, &bits, sizeof v);
  } else if constexpr (sizeof(T) == 8) {
    unsigned long long bits;
    asm volatile("ld.global.L1::no_allocate.b64 %0, [%1];" : "=l"(bits) : "l"(from));
    memcpy(&v, &bits, sizeof v);
  } else {
    unsigned long long bits[2];
    asm volatile("ld.global.L1::no_allocate.v2.b64 {%0, %1}, [%2];" : "=l"(bits[0]), "=l"(bits[1]) : "l"(from));
    memcpy(&v, bits, sizeof v);
  }
  return v;
}
#define LOAD_ONCE_NEAR LOAD_ONCE
#else
#define LOAD_ONCE(p) (*(p))
#endif
#define LOAD_KEPT(p) (*(p))
#define STORE_KEPT(p, v) (*(p) = (v))
#endif
#if !defined(LOAD_ONCE_NEAR)
#define LOAD_ONCE_NEAR(p) (*(p))
#endif

#endif
