// SPDX-License-Identifier: Apache-2.0
// CAMA_LAUNCH(backend, kernel, n, arguments...) checks every argument's type against the kernel's own C++ signature.
#pragma once
#include <tuple>
#include <type_traits>

#include "cama/backend.hpp"
#include "cama/stream.hpp"
#include "device/kernels.hpp"

namespace cama {

enum class KernelId : int {
#define CAMA_DOUBLE_KERNEL(name) name,
#define CAMA_REAL_KERNEL(name) name,
#include "kernels/kernels.def"
  count
};

/// Function and key of a kernel; Real is void for kernels that exist once.
template <KernelId id, class Real> struct Kernel;
#define CAMA_KERNEL_ENTRY(kernel, Real, scope, tag)                                                    \
  template <> struct Kernel<KernelId::kernel, Real> {                                                  \
    static constexpr auto function = &kernels::scope kernel;                                           \
    static constexpr KernelKey key{static_cast<int>(KernelId::kernel), KernelPrecision::tag, #kernel}; \
  };
#define CAMA_DOUBLE_KERNEL(name) CAMA_KERNEL_ENTRY(name, void, , none)
#define CAMA_REAL_KERNEL(name) CAMA_KERNEL_ENTRY(name, double, f64::, f64) CAMA_KERNEL_ENTRY(name, float, f32::, f32)
#include "kernels/kernels.def"

/// Value is const where the kernel only reads it.
template <class Parameter, class Value> void pack(Argument &argument, Parameter &scalar, Value &value)
{
  if constexpr (std::is_pointer_v<Parameter>) {
    using Element = std::remove_const_t<std::remove_pointer_t<Parameter>>;
    static_assert(std::is_same_v<std::remove_const_t<Value>, Stream<Element>>,
                  "a kernel's pointer parameter takes a Stream of exactly its element type");
    static_assert(std::is_const_v<std::remove_pointer_t<Parameter>> || !std::is_const_v<Value>,
                  "the kernel writes to this stream, which its caller may only read");
    argument.is_buffer = true;
    argument.buffer = value.buffer();
  } else {
    static_assert(std::is_arithmetic_v<Value> && std::is_integral_v<Value> == std::is_integral_v<Parameter>,
                  "a kernel's scalar parameter takes a number of its kind");
    scalar = static_cast<Parameter>(value);
    argument.scalar = &scalar;
    argument.size = sizeof scalar;
  }
}

/// A stream whose values consist of numbers of one type, as an array of these numbers.
template <class Number> struct Components {
  Buffer buffer;
};
template <class Number, class T> Components<Number> components(const Stream<T> &stream)
{
  static_assert(sizeof(T) % sizeof(Number) == 0 && std::is_trivially_copyable_v<T>, "not made of such numbers");
  return {stream.buffer()};
}
/// An argument for a buffer that this launch does not have.
template <class Number> Components<Number> nothing() { return {nullptr}; }
template <class Parameter, class Number> void pack(Argument &argument, Parameter &, Components<Number> &value)
{
  static_assert(std::is_same_v<std::remove_const_t<std::remove_pointer_t<Parameter>>, Number>,
                "components of another type");
  argument.is_buffer = true;
  argument.buffer = value.buffer;
}

template <class K, class... Parameters, class... Values, std::size_t... I>
void launch_with(Backend &backend, int team, int n, void (*)(int, Parameters...), std::index_sequence<I...>,
                 Values &&...values)
{
  static_assert(sizeof...(Parameters) == sizeof...(Values), "wrong number of kernel arguments");
  static_assert(sizeof...(Values) <= max_kernel_arguments, "more arguments than backends pass");
  if (n <= 0) return;
  std::tuple<Parameters...> scalars{};
  Argument arguments[sizeof...(Values) + 1];
  (pack<Parameters>(arguments[I], std::get<I>(scalars), values), ...);
  KernelKey key = K::key;
  key.team = team;
  backend.launch(key, n, arguments, static_cast<int>(sizeof...(Values)));
}

template <class K, class... Values> void launch(Backend &backend, int n, Values &&...values)
{
  launch_with<K>(backend, 0, n, K::function, std::index_sequence_for<Values...>{}, values...);
}
template <class K, class... Values> void launch_teams(Backend &backend, int team, int n, Values &&...values)
{
  launch_with<K>(backend, team, n, K::function, std::index_sequence_for<Values...>{}, values...);
}

}  // namespace cama

#define CAMA_LAUNCH(backend, name, n, ...) \
  ::cama::launch<::cama::Kernel<::cama::KernelId::name, void>>(backend, n, __VA_ARGS__)
#define CAMA_LAUNCH_REAL(Real, backend, name, n, ...) \
  ::cama::launch<::cama::Kernel<::cama::KernelId::name, Real>>(backend, n, __VA_ARGS__)
/// Launches n teams of `team` members, for kernels with FOR_EACH_TEAM.
#define CAMA_LAUNCH_TEAMS(Real, backend, name, team, n, ...) \
  ::cama::launch_teams<::cama::Kernel<::cama::KernelId::name, Real>>(backend, team, n, __VA_ARGS__)
