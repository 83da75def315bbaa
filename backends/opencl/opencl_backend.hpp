// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <memory>

#include "cama/backend.hpp"

namespace cama {
/// device: index among the usable OpenCL devices of all platforms. With 0, CAMA_OPENCL_DEVICE (an index or a part of a
/// name) decides.
std::unique_ptr<Backend> make_opencl_backend(int device);
BackendInfo opencl_info();
/// Whether device 0 is there and a GPU.
bool opencl_has_gpu();
}  // namespace cama
