// SPDX-License-Identifier: Apache-2.0
#include "cama/backend.hpp"

#include "../../backends/cpu/cpu_backend.hpp"
#include "cama/error.hpp"

namespace cama {

std::vector<BackendInfo> list_backends()
{
  return {{"cpu", true, {make_cpu_backend(0)->device()}, "OpenMP"}};
}

std::unique_ptr<Backend> make_backend(const std::string &name, int device, int threads)
{
  if (threads < 0) throw BackendError("threads: " + std::to_string(threads) + " is below 0; use 0 for all threads");
  if (name == "auto" || name == "cpu") {
    if (device != 0) throw BackendError("device: " + std::to_string(device) + " is out of range; backend cpu has one device, 0");
    return make_cpu_backend(threads);
  }
  std::string known;
  for (const BackendInfo &info : list_backends()) known += (known.empty() ? "" : ", ") + info.name;
  throw BackendError("backend: '" + name + "' is not in this build; available: auto, " + known);
}

}  // namespace cama
