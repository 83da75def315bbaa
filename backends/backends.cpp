// SPDX-License-Identifier: Apache-2.0
#include "cama/backend.hpp"

#include <algorithm>
#include <cstdlib>

#include "cama/error.hpp"
#include "cpu/cpu_backend.hpp"
#if CAMA_HAS_OPENCL
#include "opencl/opencl_backend.hpp"
#endif
#if CAMA_HAS_CUDA
#include "cuda/cuda_backend.hpp"
#endif

namespace cama {

std::vector<BackendInfo> list_backends()
{
  std::vector<BackendInfo> list{{"cpu", true, {make_cpu_backend(0)->device()}, "OpenMP"}};
#if CAMA_HAS_OPENCL
  list.push_back(opencl_info());
#else
  list.push_back({"opencl", false, {}, "not in this build: OpenCL's headers were not found"});
#endif
#if CAMA_HAS_CUDA
  BackendInfo cuda{"cuda", false, {}, ""};
  cuda.devices = cuda_devices(cuda.note);
  cuda.available = !cuda.devices.empty();
  list.push_back(cuda);
#else
  list.push_back({"cuda", false, {}, "not in this build: nvcc was not found"});
#endif
  return list;
}

int cpu_count() { return cpu_backend_count(); }

int useful_threads(int triangles)
{
  constexpr int triangles_per_thread = 1000;
  return std::clamp(triangles / triangles_per_thread, 1, cpu_count());
}

namespace {

/// The fastest backend that works here: a GPU by CUDA, a GPU by OpenCL, else the CPU.
std::string best_backend()
{
#if CAMA_HAS_CUDA
  std::string note;
  if (!cuda_devices(note).empty()) return "cuda";
#endif
#if CAMA_HAS_OPENCL
  if (opencl_has_gpu()) return "opencl";
#endif
  return "cpu";
}

}  // namespace

std::unique_ptr<Backend> make_backend(const std::string &name, int device, int threads)
{
  if (name == "auto") {
    const char *chosen = std::getenv("CAMA_BACKEND");
    return make_backend(chosen && *chosen && std::string(chosen) != "auto" ? chosen : best_backend(), device, threads);
  }
  if (threads < 0)
    throw BackendError("threads: " + std::to_string(threads) + " is below 0; use 0 for an automatic number");
  if (name == "cpu") {
    if (device != 0)
      throw BackendError("device: " + std::to_string(device) + " is out of range; backend cpu has one device, 0");
    return make_cpu_backend(threads);
  }
#if CAMA_HAS_OPENCL
  if (name == "opencl") return make_opencl_backend(device);
#endif
#if CAMA_HAS_CUDA
  if (name == "cuda") return make_cuda_backend(device);
#endif
  std::string known;
  for (const BackendInfo &info : list_backends())
    if (info.available) known += ", " + info.name;
  throw BackendError("backend: '" + name + "' is not in this build; available: auto" + known);
}

}  // namespace cama
