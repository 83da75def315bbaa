// SPDX-License-Identifier: Apache-2.0
// All kernels once more, as functions that a kernel for many worlds calls: each world is a row of blocks.
#define CAMA_BATCHED 1
#include "batched_kernels.hpp"

#include <utility>

#include "device/for_backends.hpp"

namespace cama {
namespace {

constexpr int largest_team = 256;

template <class P> __device__ P argument(const Slot &slot) { return *reinterpret_cast<const P *>(&slot); }

template <auto function, class... P, std::size_t... I>
__device__ void call(const Slot *slots, void (*)(int, P...), std::index_sequence<I...>)
{
  function(argument<int>(slots[0]), argument<P>(slots[I + 1])...);
}

template <class... P> __host__ __device__ constexpr std::size_t parameter_count(void (*)(int, P...))
{
  return sizeof...(P);
}

template <auto function> __global__ void __launch_bounds__(largest_team) batched(const Slot *table, int stride)
{
  call<function>(table + static_cast<std::size_t>(blockIdx.y) * static_cast<std::size_t>(stride), function,
                 std::make_index_sequence<parameter_count(decltype(function)(nullptr))>{});
}

struct Entry {
  const void *once, *f32, *f64;
};

const Entry entries[] = {
#define CAMA_DOUBLE_KERNEL(name) {reinterpret_cast<const void *>(&batched<&kernels::name>), nullptr, nullptr},
#define CAMA_REAL_KERNEL(name)                                             \
  {nullptr, reinterpret_cast<const void *>(&batched<&kernels::f32::name>), \
   reinterpret_cast<const void *>(&batched<&kernels::f64::name>)},
#include "kernels/kernels.def"
};

}  // namespace

const void *batched_kernel(const KernelKey &kernel)
{
  const Entry &entry = entries[kernel.index];
  return kernel.precision == KernelPrecision::none  ? entry.once
         : kernel.precision == KernelPrecision::f32 ? entry.f32
                                                    : entry.f64;
}

}  // namespace cama
