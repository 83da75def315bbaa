// SPDX-License-Identifier: Apache-2.0
// The OpenCL 1.2 interface, with error codes as exceptions.
#pragma once
#include <string>

#include "loader.hpp"

namespace cama::opencl {

/// "CL_OUT_OF_RESOURCES (-5)".
std::string code_name(cl_int code);
/// Whether a context may be unusable after this code: the device was reset or removed.
bool means_lost(cl_int code);
/// Throws MemoryError or BackendError with the call that failed, its purpose, the code and what to do.
[[noreturn]] void fail(cl_int code, const char *call, const std::string &what);
inline void check(cl_int code, const char *call, const std::string &what)
{
  if (code != CL_SUCCESS) fail(code, call, what);
}

/// A text property of a device, platform, ...: text(clGetDeviceInfo, device, CL_DEVICE_NAME).
template <class Get, class Object> std::string text(Get get, Object object, cl_uint property)
{
  size_t size = 0;
  if (get(object, property, 0, nullptr, &size) != CL_SUCCESS || size == 0) return "";
  std::string value(size, '\0');
  if (get(object, property, size, value.data(), nullptr) != CL_SUCCESS) return "";
  while (!value.empty() && (value.back() == '\0' || value.back() == ' ')) value.pop_back();
  return value;
}

template <class T> T number(cl_device_id device, cl_device_info property)
{
  T value{};
  api().clGetDeviceInfo(device, property, sizeof value, &value, nullptr);
  return value;
}

}  // namespace cama::opencl
