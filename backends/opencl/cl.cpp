// SPDX-License-Identifier: Apache-2.0
#include "cl.hpp"

#include "cama/error.hpp"

namespace cama::opencl {
namespace {

struct Code {
  cl_int code;
  const char *name, *advice;
};

constexpr const char *lower = "lower the resolution, or choose a device with more memory";
constexpr const char *reset =
    "the device may be lost; make a new simulation, and read the system log if it happens again";
constexpr const char *driver = "check with clinfo that the driver is installed for this user";
constexpr const char *bug = "this is a bug of cama or of the driver; report it with the device's name";

constexpr Code codes[] = {
    {CL_DEVICE_NOT_FOUND, "CL_DEVICE_NOT_FOUND", driver},
    {CL_DEVICE_NOT_AVAILABLE, "CL_DEVICE_NOT_AVAILABLE", reset},
    {CL_COMPILER_NOT_AVAILABLE, "CL_COMPILER_NOT_AVAILABLE", driver},
    {CL_MEM_OBJECT_ALLOCATION_FAILURE, "CL_MEM_OBJECT_ALLOCATION_FAILURE", lower},
    {CL_OUT_OF_RESOURCES, "CL_OUT_OF_RESOURCES",
     "the device ran out of memory or was reset by its watchdog; lower the resolution, or choose another device"},
    {CL_OUT_OF_HOST_MEMORY, "CL_OUT_OF_HOST_MEMORY", lower},
    {CL_MEM_COPY_OVERLAP, "CL_MEM_COPY_OVERLAP", bug},
    {CL_BUILD_PROGRAM_FAILURE, "CL_BUILD_PROGRAM_FAILURE", bug},
    {CL_MISALIGNED_SUB_BUFFER_OFFSET, "CL_MISALIGNED_SUB_BUFFER_OFFSET", bug},
    {CL_EXEC_STATUS_ERROR_FOR_EVENTS_IN_WAIT_LIST, "CL_EXEC_STATUS_ERROR_FOR_EVENTS_IN_WAIT_LIST", reset},
    {CL_LINK_PROGRAM_FAILURE, "CL_LINK_PROGRAM_FAILURE", bug},
    {CL_INVALID_VALUE, "CL_INVALID_VALUE", bug},
    {CL_INVALID_PLATFORM, "CL_INVALID_PLATFORM", driver},
    {CL_INVALID_DEVICE, "CL_INVALID_DEVICE", reset},
    {CL_INVALID_CONTEXT, "CL_INVALID_CONTEXT", reset},
    {CL_INVALID_COMMAND_QUEUE, "CL_INVALID_COMMAND_QUEUE", reset},
    {CL_INVALID_MEM_OBJECT, "CL_INVALID_MEM_OBJECT", bug},
    {CL_INVALID_BINARY, "CL_INVALID_BINARY", bug},
    {CL_INVALID_BUILD_OPTIONS, "CL_INVALID_BUILD_OPTIONS", bug},
    {CL_INVALID_PROGRAM, "CL_INVALID_PROGRAM", bug},
    {CL_INVALID_PROGRAM_EXECUTABLE, "CL_INVALID_PROGRAM_EXECUTABLE", bug},
    {CL_INVALID_KERNEL_NAME, "CL_INVALID_KERNEL_NAME", bug},
    {CL_INVALID_KERNEL, "CL_INVALID_KERNEL", bug},
    {CL_INVALID_ARG_INDEX, "CL_INVALID_ARG_INDEX", bug},
    {CL_INVALID_ARG_VALUE, "CL_INVALID_ARG_VALUE", bug},
    {CL_INVALID_ARG_SIZE, "CL_INVALID_ARG_SIZE", bug},
    {CL_INVALID_KERNEL_ARGS, "CL_INVALID_KERNEL_ARGS", bug},
    {CL_INVALID_WORK_DIMENSION, "CL_INVALID_WORK_DIMENSION", bug},
    {CL_INVALID_WORK_GROUP_SIZE, "CL_INVALID_WORK_GROUP_SIZE", bug},
    {CL_INVALID_WORK_ITEM_SIZE, "CL_INVALID_WORK_ITEM_SIZE", bug},
    {CL_INVALID_BUFFER_SIZE, "CL_INVALID_BUFFER_SIZE", lower},
    {CL_INVALID_EVENT, "CL_INVALID_EVENT", bug},
    {CL_INVALID_OPERATION, "CL_INVALID_OPERATION", bug},
    {CL_INVALID_GLOBAL_OFFSET, "CL_INVALID_GLOBAL_OFFSET", bug},
    {CL_INVALID_EVENT_WAIT_LIST, "CL_INVALID_EVENT_WAIT_LIST", bug},
    {CL_INVALID_GLOBAL_WORK_SIZE, "CL_INVALID_GLOBAL_WORK_SIZE", bug},
    {CL_INVALID_PROPERTY, "CL_INVALID_PROPERTY", bug},
    {-1001, "CL_PLATFORM_NOT_FOUND_KHR",
     "no OpenCL driver is installed; pocl (package pocl-opencl-icd) runs on any CPU"},
    {-9999, "NVIDIA's illegal read or write", bug},
};

}  // namespace

std::string code_name(cl_int code)
{
  for (const Code &c : codes)
    if (c.code == code) return std::string(c.name) + " (" + std::to_string(code) + ")";
  return "OpenCL error " + std::to_string(code);
}

bool means_lost(cl_int code)
{
  for (cl_int lost : {CL_DEVICE_NOT_AVAILABLE, CL_OUT_OF_RESOURCES, CL_EXEC_STATUS_ERROR_FOR_EVENTS_IN_WAIT_LIST,
                      CL_INVALID_DEVICE, CL_INVALID_CONTEXT, CL_INVALID_COMMAND_QUEUE, -9999})
    if (code == lost) return true;
  return false;
}

void fail(cl_int code, const char *call, const std::string &what)
{
  const char *advice = "see the driver's documentation";
  for (const Code &c : codes)
    if (c.code == code) advice = c.advice;
  const std::string message =
      "OpenCL: " + std::string(call) + " failed, " + what + ": " + code_name(code) + "; " + advice;
  if (code == CL_MEM_OBJECT_ALLOCATION_FAILURE || code == CL_OUT_OF_HOST_MEMORY || code == CL_INVALID_BUFFER_SIZE)
    throw MemoryError(message);
  throw BackendError(message);
}

}  // namespace cama::opencl
