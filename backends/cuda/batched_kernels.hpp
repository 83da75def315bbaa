// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cuda_runtime.h>

#include "device/operations.hpp"

namespace cama {

/// The kernel that runs a kernel for several worlds at once: (const Slot *table, int stride). Block y reads its
/// arguments from table + y * stride.
const void *batched_kernel(const KernelKey &kernel);

}  // namespace cama
