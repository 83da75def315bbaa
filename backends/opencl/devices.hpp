// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <vector>

#include "cl.hpp"

namespace cama::opencl {

struct Device {
  cl_platform_id platform = nullptr;
  cl_device_id id = nullptr;
  std::string name, driver;   ///< driver: name of its platform and version
  std::string version;        ///< full version text of the platform
  std::string lacks;          ///< empty: usable
};

/// Every device of every platform, usable or not.
std::vector<Device> find_devices();
/// Largest work-group in the first dimension by the device's limits; kernels may have lower ones.
size_t max_work_items(cl_device_id id);
/// Chooses by index among usable devices; with 0, CAMA_OPENCL_DEVICE decides. Throws BackendError, which names the
/// devices and what they lack.
Device choose_device(int index);

}  // namespace cama::opencl
