// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace cama {

/// Memory on a device; only its backend knows what the pointer means.
using Buffer = void *;

/// The compiled version of a kernel: kernels that use `real` exist once per precision, the others once.
enum class KernelPrecision { none, f32, f64 };

struct KernelKey {
  int index;            ///< position in kernels.def
  KernelPrecision precision;
  const char *name;
  int team = 0;         ///< members of a team; 0: the kernel has none
};

/// Largest number of arguments of a kernel; checked at compile time.
inline constexpr int max_kernel_arguments = 40;

/// Where the memory of a backend is, for other libraries on the same device.
struct DeviceMemory {
  enum class Kind {
    host,   ///< a Buffer is an address of the host
    cuda,   ///< a Buffer is an address of a CUDA device
    opaque  ///< a Buffer is a handle that only the backend understands
  };
  Kind kind = Kind::opaque;
  int device = 0;             ///< index of the CUDA device
  std::uintptr_t queue = 0;   ///< with CUDA: the cudaStream_t of the backend's work
};

class OperationQueue;

/// Runs what worlds have recorded while the host goes on. A thread that serves worlds has one of its own.
class WorldRunner {
public:
  virtual ~WorldRunner() = default;
  /// worlds: that run at once, of all threads. What begins from now on begins after what the backend was asked before.
  virtual void follow(int worlds) = 0;
  /// Whether a queue runs faster so than launch by launch.
  virtual bool suits(const OperationQueue &queue) const = 0;
  /// Each queue in its order, the queues side by side. They stay as they are until they have ended.
  virtual void begin(const std::vector<OperationQueue *> &queues) = 0;
  /// Whether all of a queue is done; what was downloaded is then there. Throws ListOverflow as `scan` does.
  virtual bool ended(OperationQueue &queue) = 0;
  virtual void check() = 0;  ///< throws BackendError if the device does not go on
  virtual void wait() noexcept = 0;  ///< until nothing runs
  virtual long launches() const = 0;
};

/// One kernel argument: a scalar's address, or a buffer.
struct Argument {
  const void *scalar = nullptr;
  std::size_t size = 0;  ///< of the scalar, bytes
  Buffer buffer = nullptr;
  bool is_buffer = false;
};

/// Memory, launches, prefix sums and sorting on one device. A backend knows nothing about cloth. All calls enqueue in
/// order; `download` and `synchronize` wait.
class Backend {
public:
  virtual ~Backend() = default;
  virtual std::string_view name() const = 0;  ///< "cpu", "opencl", "cuda"
  virtual std::string device() const = 0;  ///< name of the hardware, for users

  virtual bool wide_workers() const = 0;  ///< work items are CPU cores with vector registers, not thousands of threads
  virtual int workers() const = 0;  ///< work items that run at the same time

  virtual Buffer allocate(std::size_t bytes) = 0;  ///< throws MemoryError
  virtual void release(Buffer buffer) noexcept = 0;
  virtual void upload(Buffer to, const void *from, std::size_t bytes) = 0;
  virtual void download(void *to, Buffer from, std::size_t bytes, std::size_t offset = 0) = 0;
  virtual void copy(Buffer to, Buffer from, std::size_t bytes) = 0;
  virtual void fill(Buffer buffer, unsigned char byte, std::size_t bytes) = 0;

  /// Launches n work items, or n teams if the kernel has teams.
  virtual void launch(const KernelKey &kernel, int n, const Argument *arguments, int count) = 0;
  /// What is launched between begin_batches and end_batches may be held back, at the latest until the host waits.
  virtual void begin_batches() {}
  virtual void hand_over() {}  ///< hands what is held back to the device
  virtual void end_batches() noexcept {}  ///< likewise; errors are reported by a later call
  /// Launches between these two do not depend on each other, and may run at the same time: none accesses what another
  /// one writes, but for atomic operations whose order has no effect. Scopes do not nest.
  virtual void begin_side_by_side() {}
  virtual void end_side_by_side() {}
  virtual bool forks() const { return false; }  ///< whether work aside runs at another time than in its place
  /// What is asked between begin_aside and end_aside, without waits, scans and sorts, begins after what was asked
  /// before `fork`, and may run at the same time as what else is asked until `meet`. Forks do not nest.
  virtual void fork() {}
  virtual void begin_aside() {}
  virtual void end_aside() {}
  /// Errors of the device are reported by a later call.
  virtual void meet() noexcept {}
  /// Runs `work`, which only launches kernels, `times` times; a backend may record it once and replay it.
  virtual void repeat(int times, const std::function<void()> &work)
  {
    for (int i = 0; i < times; ++i) work();
  }
  /// to[i] = sum of from[0..i), to[n] = total. `to` holds n + 1 ints and may not alias `from`. A total beyond 2^31 - 1
  /// throws ListOverflow, here or, on backends that do not wait, at the next `download` or `synchronize`.
  virtual void scan(Buffer from, Buffer to, int n) = 0;
  /// Stable radix sort of n 64-bit keys, with their values, by the low `bits` bits.
  virtual void sort(Buffer keys, Buffer values, int n, int bits) = 0;
  virtual void synchronize() = 0;

  // For other libraries that use the same device.

  virtual DeviceMemory memory() const { return {}; }
  /// Whether kernels of this backend can read at an address that another library has given.
  virtual bool reaches(const void *address) const { return address != nullptr; }
  virtual void synchronize_device() {}  ///< waits for all work on the device, also of other libraries
  /// Makes the device that of the calling thread; returns the index of the one before, or -1 if there is nothing to
  /// change back.
  virtual int make_current() const { return -1; }
  virtual void leave_to(int device) const { static_cast<void>(device); }  ///< with what one of these has returned
  virtual int device_before() const { return -1; }  ///< that of the thread which made this backend, before that

  /// Null where worlds are served one after the other. Several runners may be called at the same time.
  virtual std::unique_ptr<WorldRunner> make_runner() { return nullptr; }

  std::size_t allocated_bytes() const { return allocated_; }
  std::size_t peak_bytes() const { return peak_; }
  long launches() const { return launches_; }
  long waits() const { return waits_; }  ///< times the host waited for the device

protected:
  std::size_t allocated_ = 0, peak_ = 0;
  long launches_ = 0, waits_ = 0;
};

/// Launches as long as this lives may be handed to the device several at a time, which small scenes gain from.
class Batches {
public:
  explicit Batches(Backend &backend) : backend_(backend) { backend_.begin_batches(); }
  ~Batches() { backend_.end_batches(); }
  Batches(const Batches &) = delete;
  Batches &operator=(const Batches &) = delete;

private:
  Backend &backend_;
};

/// Launches as long as this lives are side by side.
class SideBySide {
public:
  explicit SideBySide(Backend &backend) : backend_(backend) { backend_.begin_side_by_side(); }
  ~SideBySide() { backend_.end_side_by_side(); }
  SideBySide(const SideBySide &) = delete;
  SideBySide &operator=(const SideBySide &) = delete;

private:
  Backend &backend_;
};

/// Work aside may run at the same time as other work that is asked as long as this lives. There is one at a time.
class Fork {
public:
  explicit Fork(Backend &backend) : backend_(backend) { backend_.fork(); }
  ~Fork() { backend_.meet(); }
  Fork(const Fork &) = delete;
  Fork &operator=(const Fork &) = delete;
  template <class Work> void aside(Work &&work)
  {
    backend_.begin_aside();
    try {
      work();
    } catch (...) {
      backend_.end_aside();
      throw;
    }
    backend_.end_aside();
  }

private:
  Backend &backend_;
};

/// The device of a backend is that of the calling thread as long as this lives; then the one before is again.
class OnDevice {
public:
  explicit OnDevice(const Backend &backend) : backend_(backend), before_(backend.make_current()) {}
  ~OnDevice() { backend_.leave_to(before_); }
  OnDevice(const OnDevice &) = delete;
  OnDevice &operator=(const OnDevice &) = delete;

private:
  const Backend &backend_;
  int before_;
};

/// Number of CPUs of this process, at most the quota of its container and OMP_NUM_THREADS if that is set: what threads
/// = 0 of the CPU backend means. While other programs use them too, fewer compute: results do not depend on it.
int cpu_count();
/// Threads that a scene of so many cloth triangles keeps busy: one for every 1,000, at least 1, at most cpu_count().
/// Kernels are short; with more threads they wait for each other.
int useful_threads(int triangles);

/// name: "auto" (the backend named by the environment variable CAMA_BACKEND, else cuda or opencl with a GPU, else cpu),
/// "cpu", "opencl" or "cuda". device: index among the backend's usable devices. threads: of the CPU backend, 0 =
/// cpu_count(). Throws BackendError, which lists the available backends.
std::unique_ptr<Backend> make_backend(const std::string &name, int device = 0, int threads = 0);

struct BackendInfo {
  std::string name;
  bool available;
  std::vector<std::string> devices;
  std::string note;
};
std::vector<BackendInfo> list_backends();

}  // namespace cama
