// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <memory>
#include <string>
#include <vector>

#include "cama/backend.hpp"

namespace cama {
std::unique_ptr<Backend> make_cuda_backend(int device);   ///< throws BackendError with the driver's message
std::vector<std::string> cuda_devices(std::string &note); ///< names of the devices; note: why there are none
}  // namespace cama
