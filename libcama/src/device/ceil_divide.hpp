// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace cama {

/// How many chunks of `size` hold n things.
constexpr int ceil_divide(int n, int size) { return (n + size - 1) / size; }

}  // namespace cama
