// SPDX-License-Identifier: Apache-2.0
// How the CPU backend calls the kernels.
#pragma once
#include <cstddef>
#include <type_traits>
#include <utility>

#include "cama/backend.hpp"

namespace cama::cpu {

using Trampoline = void (*)(int, const Argument *);

template <class P> P unpack(const Argument &argument)
{
  if constexpr (std::is_pointer_v<P>)
    return static_cast<P>(argument.buffer);
  else
    return *static_cast<const P *>(argument.scalar);
}

template <auto function, class... P, std::size_t... I>
void call(int n, const Argument *arguments, void (*)(int, P...), std::index_sequence<I...>)
{
  function(n, unpack<P>(arguments[I])...);
}

template <auto function, class... P> constexpr std::size_t parameter_count(void (*)(int, P...)) { return sizeof...(P); }

template <auto function> void trampoline(int n, const Argument *arguments)
{
  call<function>(n, arguments, function, std::make_index_sequence<parameter_count<function>(function)>{});
}

/// The functions of a kernel, which exists once or in both precisions.
struct Functions {
  Trampoline once, f32, f64;
};

/// By the index of a kernel's key: the kernels without parallel loops, whose start costs small scenes 5 % of their
/// time.
extern const Functions serial_kernels[];

}  // namespace cama::cpu
