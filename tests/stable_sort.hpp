// SPDX-License-Identifier: Apache-2.0
// Sorts of a backend against std::stable_sort.
#pragma once
#include <algorithm>
#include <numeric>
#include <vector>

#include "cama/stream.hpp"
#include "device/launch.hpp"

/// Whether the backend sorts keys, of so many bits, as the standard library does, equal ones in their order.
inline bool sorts_stably(cama::Backend &backend, const std::vector<key64> &keys, int bits)
{
  std::vector<int> order(keys.size());
  std::iota(order.begin(), order.end(), 0);
  cama::Stream<key64> key(backend, keys);
  cama::Stream<int> value(backend, order);
  backend.sort(key.buffer(), value.buffer(), key.size(), bits);
  std::stable_sort(order.begin(), order.end(),
                   [&](int a, int b) { return keys[static_cast<std::size_t>(a)] < keys[static_cast<std::size_t>(b)]; });
  std::vector<key64> sorted = keys;
  std::sort(sorted.begin(), sorted.end());
  return value.download() == order && key.download() == sorted;
}
