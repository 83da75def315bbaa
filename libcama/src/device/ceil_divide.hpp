// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace cama {

/// The number of chunks of `size` that hold n elements.
constexpr int ceil_divide(int n, int size) { return (n + size - 1) / size; }

}  // namespace cama
