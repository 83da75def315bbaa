// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cuda_runtime.h>

#include <memory>

#include "device/for_backends.hpp"

namespace cama {

/// Runs worlds by an Interpreter. queue: of the backend. team_bytes: memory that a team of a kernel shares. Null where
/// the device has too little of it.
std::unique_ptr<WorldRunner> make_world_runner(int device, cudaStream_t queue, int (*team_bytes)(const KernelKey &));

}  // namespace cama
