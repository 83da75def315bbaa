// SPDX-License-Identifier: Apache-2.0
// OpenCL's loader, libOpenCL.so.1, opened at run time: the library needs OpenCL's headers to build, and starts where no
// OpenCL is installed.
#pragma once
#define CL_TARGET_OPENCL_VERSION 120
#include <CL/cl.h>

namespace cama::opencl {

/// OpenCL's functions under their own names.
struct Api {
#define CAMA_OPENCL_FUNCTION(name) decltype(&::name) name = nullptr;
#include "functions.def"
#undef CAMA_OPENCL_FUNCTION
};

/// The functions of the file that CAMA_OPENCL_LIBRARY names, else of libOpenCL.so.1. Opened by the first call that
/// finds the file, and never closed. Throws BackendError where there is no such file or it is older than OpenCL 1.2.
const Api &api();

}  // namespace cama::opencl
