// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <vector>

#include "cl.hpp"

namespace cama::opencl {

struct Device {
  cl_platform_id platform = nullptr;
  cl_device_id id = nullptr;
  std::string name, driver;   ///< driver: its platform's name and its version
  std::string version;        ///< all that the platform says of itself
  std::string lacks;          ///< empty: usable
};

/// Every device of every platform, usable or not.
std::vector<Device> find_devices();
/// Of a work-group in its first dimension, by the device's limits; kernels may have lower ones.
size_t max_work_items(cl_device_id id);
/// By index over the usable ones; with 0, CAMA_OPENCL_DEVICE decides. Throws BackendError naming what is there and what
/// it lacks.
Device choose_device(int index);

}  // namespace cama::opencl
