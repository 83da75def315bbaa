// SPDX-License-Identifier: Apache-2.0
#include "devices.hpp"

#include <algorithm>
#include <cctype>
#include <cstdlib>

#include "cama/error.hpp"

namespace cama::opencl {
namespace {

bool has_word(const std::string &words, const std::string &word)
{
  return (" " + words + " ").find(" " + word + " ") != std::string::npos;
}

std::string lower_case(std::string s)
{
  std::transform(s.begin(), s.end(), s.begin(), [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return s;
}

std::string missing_features(cl_device_id id)
{
  const std::string extensions = text(api().clGetDeviceInfo, id, CL_DEVICE_EXTENSIONS),
                    version = text(api().clGetDeviceInfo, id, CL_DEVICE_VERSION);
  std::string lacks;
  const auto need = [&](bool there, const char *what) {
    if (!there) lacks += std::string(lacks.empty() ? "" : ", ") + what;
  };
  need(number<cl_bool>(id, CL_DEVICE_AVAILABLE), "availability");
  need(number<cl_bool>(id, CL_DEVICE_COMPILER_AVAILABLE), "a compiler");
  need(version.rfind("OpenCL 1.0", 0) != 0 && version.rfind("OpenCL 1.1", 0) != 0, "OpenCL 1.2");
  need(number<cl_device_fp_config>(id, CL_DEVICE_DOUBLE_FP_CONFIG) != 0, "double precision (cl_khr_fp64)");
  need(has_word(extensions, "cl_khr_int64_base_atomics"), "64-bit atomics (cl_khr_int64_base_atomics)");
  need(number<cl_bool>(id, CL_DEVICE_ENDIAN_LITTLE), "little-endian memory");
  return lacks;
}

}  // namespace

std::vector<Device> find_devices()
{
  std::vector<Device> devices;
  cl_uint platforms = 0;
  const cl_int status = api().clGetPlatformIDs(0, nullptr, &platforms);
  if (status == -1001 || platforms == 0) return devices;   // the loader's code for: no driver is installed
  check(status, "clGetPlatformIDs", "listing the drivers");
  std::vector<cl_platform_id> platform(platforms);
  check(api().clGetPlatformIDs(platforms, platform.data(), nullptr), "clGetPlatformIDs", "listing the drivers");
  for (cl_platform_id p : platform) {
    cl_uint count = 0;
    if (api().clGetDeviceIDs(p, CL_DEVICE_TYPE_ALL, 0, nullptr, &count) != CL_SUCCESS || count == 0) continue;
    std::vector<cl_device_id> ids(count);
    if (api().clGetDeviceIDs(p, CL_DEVICE_TYPE_ALL, count, ids.data(), nullptr) != CL_SUCCESS) continue;
    for (cl_device_id id : ids)
      devices.push_back({p, id, text(api().clGetDeviceInfo, id, CL_DEVICE_NAME),
                         text(api().clGetPlatformInfo, p, CL_PLATFORM_NAME) + " " +
                             text(api().clGetDeviceInfo, id, CL_DRIVER_VERSION),
                         text(api().clGetPlatformInfo, p, CL_PLATFORM_VERSION), missing_features(id)});
  }
  return devices;
}

size_t max_work_items(cl_device_id id)
{
  std::vector<size_t> sizes(std::max<cl_uint>(1, number<cl_uint>(id, CL_DEVICE_MAX_WORK_ITEM_DIMENSIONS)), 1);
  api().clGetDeviceInfo(id, CL_DEVICE_MAX_WORK_ITEM_SIZES, sizes.size() * sizeof(size_t), sizes.data(), nullptr);
  return std::max<size_t>(1, std::min(sizes[0], number<size_t>(id, CL_DEVICE_MAX_WORK_GROUP_SIZE)));
}

Device choose_device(int index)
{
  std::vector<Device> usable;
  std::string names, others;
  const std::vector<Device> all = find_devices();
  for (const Device &d : all) {
    if (d.lacks.empty()) {
      names += (usable.empty() ? "" : ", ") + std::to_string(usable.size()) + " " + d.name;
      usable.push_back(d);
    } else {
      others += "; device '" + d.name + "' lacks " + d.lacks;
    }
  }
  if (all.empty())
    throw BackendError(
        "backend opencl: no OpenCL device; install a driver (pocl, package pocl-opencl-icd, runs on any CPU)");
  if (usable.empty()) throw BackendError("backend opencl: no usable device" + others);
  const std::string there = "; available: " + names + others;

  const char *environment = std::getenv("CAMA_OPENCL_DEVICE");
  if (index == 0 && environment && *environment) {
    const std::string wanted = environment;
    if (std::all_of(wanted.begin(), wanted.end(), [](unsigned char c) { return std::isdigit(c); }) &&
        wanted.size() < 6) {
      index = std::stoi(wanted);
    } else {
      for (const Device &d : usable)
        if (lower_case(d.name + " " + d.driver).find(lower_case(wanted)) != std::string::npos) return d;
      for (const Device &d : all)
        if (lower_case(d.name + " " + d.driver).find(lower_case(wanted)) != std::string::npos)
          throw BackendError("CAMA_OPENCL_DEVICE: '" + wanted + "' is device '" + d.name + "', which lacks " + d.lacks +
                             there);
      throw BackendError("CAMA_OPENCL_DEVICE: no OpenCL device has '" + wanted + "' in its name" + there);
    }
  }
  if (index < 0 || index >= static_cast<int>(usable.size()))
    throw BackendError("device: " + std::to_string(index) + " is out of range for backend opencl" + there);
  return usable[static_cast<std::size_t>(index)];
}

}  // namespace cama::opencl
