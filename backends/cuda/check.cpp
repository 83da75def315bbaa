// SPDX-License-Identifier: Apache-2.0
#include "check.hpp"

#include <string>

#include "cama/error.hpp"

namespace cama {
namespace {

/// What a user can do about a CUDA error.
const char *advice(cudaError_t status)
{
  switch (status) {
  case cudaErrorMemoryAllocation: return "lower the resolution or use a larger device";
  case cudaErrorNoDevice: return "use backend cpu or opencl, or check with nvidia-smi that the device is visible";
  case cudaErrorInsufficientDriver:
  case cudaErrorSystemDriverMismatch: return "update NVIDIA's driver, or use backend cpu or opencl";
  case cudaErrorNoKernelImageForDevice:
  case cudaErrorUnsupportedPtxVersion:
    return "the driver cannot compile for this device; update it, or build with the device's CMAKE_CUDA_ARCHITECTURES";
  case cudaErrorDevicesUnavailable:
    return "another process uses the device exclusively, or it is being reset; choose another device, or try again";
  case cudaErrorECCUncorrectable:
    return "the device's memory is faulty; choose another device, and read the system log";
  case cudaErrorIllegalAddress:
  case cudaErrorMisalignedAddress:
  case cudaErrorIllegalInstruction:
  case cudaErrorInvalidValue:
  case cudaErrorInvalidConfiguration:
    return "this is a bug of cama; report it with the scene. A new process can use the device again";
  default: return "the device may be lost; start a new process, and read the system log if it happens again";
  }
}

}  // namespace

void check(cudaError_t status, const char *call)
{
  if (status == cudaSuccess) return;
  cudaGetLastError();  // clears the error, so that a later call does not report it again
  const std::string text = std::string(call) + ": " + cudaGetErrorName(status) + " " + std::to_string(status) + " (" +
                           cudaGetErrorString(status) + "); " + advice(status);
  if (status == cudaErrorMemoryAllocation) throw MemoryError(text);
  throw BackendError(text);
}

}  // namespace cama
