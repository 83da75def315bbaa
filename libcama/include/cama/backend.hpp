// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <chrono>
#include <cstddef>
#include <cstdlib>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace cama {

/// Memory on a device; what it points to is the backend's business.
using Buffer = void *;

/// Which compilation of a kernel: kernels that use `real` exist once per precision, the others once.
enum class Precision { none, f32, f64 };

struct KernelKey {
  int index;            ///< position in kernels.def
  Precision precision;
  const char *name;
  int team = 0;         ///< members of a team; 0: the kernel has none
};

/// One kernel argument: a scalar's address, or a buffer.
struct Argument {
  const void *scalar = nullptr;
  std::size_t size = 0;   ///< of the scalar, bytes
  Buffer buffer = nullptr;
  bool is_buffer = false;
};

/// Memory, launching, prefix sums and sorting on one device. Knows nothing about cloth.
/// All calls enqueue in order; `download` and `synchronize` wait.
class Backend {
public:
  virtual ~Backend() = default;
  virtual std::string_view name() const = 0;     ///< "cpu", "opencl", "cuda"
  virtual std::string device() const = 0;        ///< what a user calls the hardware

  virtual bool wide_workers() const = 0;  ///< work items are cores with vector registers, not thousands of threads

  virtual Buffer allocate(std::size_t bytes) = 0;  ///< throws MemoryError
  virtual void release(Buffer buffer) noexcept = 0;
  virtual void upload(Buffer to, const void *from, std::size_t bytes) = 0;
  virtual void download(void *to, Buffer from, std::size_t bytes, std::size_t offset = 0) = 0;
  virtual void copy(Buffer to, Buffer from, std::size_t bytes) = 0;
  virtual void fill(Buffer buffer, unsigned char byte, std::size_t bytes) = 0;

  /// n work items, or n teams where the kernel has teams.
  virtual void launch(const KernelKey &kernel, int n, const Argument *arguments, int count) = 0;
  /// Runs `work`, which only launches, `times` times; a backend may record it once and replay it. again: it is the work
  /// of the last call.
  virtual void repeat(int times, const std::function<void()> &work, bool again = false)
  {
    static_cast<void>(again);
    for (int i = 0; i < times; ++i) work();
  }
  /// to[i] = sum of from[0..i), to[n] = total. `to` holds n + 1 ints and may not alias `from`.
  /// A total beyond 2^31 - 1 is a MemoryError, here or, on backends that do not wait, at the next `download` or
  /// `synchronize`.
  virtual void scan(Buffer from, Buffer to, int n) = 0;
  /// Stable radix sort of n 64-bit keys by their low `bits` bits, values moved along.
  virtual void sort(Buffer keys, Buffer values, int n, int bits) = 0;
  virtual void synchronize() = 0;

  std::size_t allocated_bytes() const { return allocated_; }
  std::size_t peak_bytes() const { return peak_; }
  long launches() const { return launches_; }
  long waits() const { return waits_; }  ///< times the host waited for the device

  struct KernelTime {
    long launches = 0;
    double milliseconds = 0;
  };
  /// Every kernel's share, where the environment variable CAMA_KERNEL_TIMES is set: launches then wait for each other.
  const std::map<std::string, KernelTime> &kernel_times() const { return kernel_times_; }

protected:
  /// Runs the launch of one kernel, timed where times are wanted.
  template <class Launch> void timed(const char *kernel, Launch &&launch)
  {
    if (!timing_) return launch();
    synchronize();
    const auto start = std::chrono::steady_clock::now();
    launch();
    synchronize();
    KernelTime &time = kernel_times_[kernel];
    ++time.launches;
    time.milliseconds += std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
  }
  const bool timing_ = std::getenv("CAMA_KERNEL_TIMES") != nullptr;
  std::map<std::string, KernelTime> kernel_times_;
  std::size_t allocated_ = 0, peak_ = 0;
  long launches_ = 0, waits_ = 0;
};

/// Processors of this process, at most OMP_NUM_THREADS where that is set: what threads = 0 of the CPU backend means.
int cpu_count();
/// Threads that a scene of so many cloth triangles keeps busy: one for every 1,000, at least 1, at most cpu_count().
/// Kernels are short; with more threads they wait for each other.
int useful_threads(int triangles);

/// name: "auto" (what the environment variable CAMA_BACKEND names, else cpu), "cpu", "opencl" or "cuda".
/// device: index over the backend's usable devices. threads: of the CPU backend, 0 = cpu_count(). Throws BackendError
/// listing what is there.
std::unique_ptr<Backend> make_backend(const std::string &name, int device = 0, int threads = 0);

struct BackendInfo {
  std::string name;
  bool available;
  std::vector<std::string> devices;
  std::string note;
};
std::vector<BackendInfo> list_backends();

}  // namespace cama
