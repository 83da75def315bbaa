// SPDX-License-Identifier: Apache-2.0
#include "loader.hpp"

#include <dlfcn.h>

#include <cstdlib>
#include <string>

#include "cama/error.hpp"

namespace cama::opencl {
namespace {

void *open_library()
{
  const char *chosen = std::getenv("CAMA_OPENCL_LIBRARY");
  if (chosen && *chosen) {
    if (void *library = dlopen(chosen, RTLD_NOW | RTLD_LOCAL)) return library;
    throw BackendError("OpenCL loader not found: CAMA_OPENCL_LIBRARY is '" + std::string(chosen) +
                       "', which cannot be opened (" + dlerror() + "); correct the variable or unset it");
  }
  for (const char *name : {"libOpenCL.so.1", "libOpenCL.so"})
    if (void *library = dlopen(name, RTLD_NOW | RTLD_LOCAL)) return library;
  throw BackendError(
      "OpenCL loader not found: install libOpenCL.so.1 (Debian, Ubuntu: ocl-icd-libopencl1) and a driver, "
      "or name the file in CAMA_OPENCL_LIBRARY");
}

template <class Function> void find(void *library, const char *name, Function &function)
{
  function = reinterpret_cast<Function>(dlsym(library, name));
  if (!function)
    throw BackendError("OpenCL loader without " + std::string(name) +
                       ": it is older than OpenCL 1.2; install a newer one (Debian, Ubuntu: ocl-icd-libopencl1)");
}

Api load()
{
  void *library = open_library();
  Api functions;
#define CAMA_OPENCL_FUNCTION(name) find(library, #name, functions.name);
#include "functions.def"
#undef CAMA_OPENCL_FUNCTION
  return functions;
}

}  // namespace

const Api &api()
{
  static const Api loaded = load();   // a call that throws leaves the next one to try again
  return loaded;
}

}  // namespace cama::opencl
