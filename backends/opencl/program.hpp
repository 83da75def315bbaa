// SPDX-License-Identifier: Apache-2.0
// Programs made from the text of the kernels: one per precision, built on first use, shared by all backends of the
// process, and cached on disk.
#pragma once
#include <atomic>
#include <map>
#include <mutex>

#include "devices.hpp"

namespace cama::opencl {

/// once: double.h. f32, f64: real.h. primitives: scan and sort.
enum class Text { once, f32, f64, primitives };

/// One device with its context and programs. Never destroyed, since drivers differ in what they allow at exit.
class Library {
public:
  static Library &of(const Device &device);   ///< the only one of the process; a new one after the device was lost
  explicit Library(const Device &d);

  /// Throws BackendError with file and line of the first errors.
  cl_program program(Text text);

  /// Marks the context as lost: the next simulation opens the device again.
  void lose() { lost_ = true; }

  const Device device;
  cl_context context = nullptr;
  const bool is_cpu;      ///< a CPU: few work-items with a contiguous run of elements each

private:
  cl_program build(const std::string &source, const std::string &title);
  cl_program load(const std::string &file);
  void store(cl_program program, const std::string &file) const;

  std::string options_;
  std::atomic<bool> lost_{false};
  std::mutex mutex_;
  std::map<std::string, cl_program> programs_;   // by source text
};

/// The whole text with #line directives. CAMA_KERNELS names a folder to read kernels from instead of those built in.
std::string source(Text text);

}  // namespace cama::opencl
