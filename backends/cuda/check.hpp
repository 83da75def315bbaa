// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cuda_runtime.h>

namespace cama {

/// Throws BackendError or MemoryError with the call and what a user can do, unless the status is success.
void check(cudaError_t status, const char *call);

}  // namespace cama
