// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cuda_runtime.h>

#include <memory>

#include "device/for_backends.hpp"

namespace cama {

/// Runs recorded operations of worlds: a kernel that stays on the device and calls the kernels as functions. Each
/// world has blocks of its own, which wait for each other between operations, and tells the host by itself when it has
/// ended. Small scenes, for which a launch lasts longer than its work, gain most.
/// queue: of the backend. team_bytes: memory that a team of a kernel shares. Null where the device has too little of
/// it.
std::unique_ptr<WorldRunner> make_interpreter(int device, cudaStream_t queue, int (*team_bytes)(const KernelKey &));

}  // namespace cama
