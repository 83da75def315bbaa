// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <memory>

#include "cama/backend.hpp"

namespace cama {
std::unique_ptr<Backend> make_cpu_backend(int threads);   ///< threads = 0: cpu_count() threads
int cpu_backend_count();                                     ///< see cpu_count()
}  // namespace cama
