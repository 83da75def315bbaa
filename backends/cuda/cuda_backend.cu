// SPDX-License-Identifier: Apache-2.0
// The CUDA backend: the shared kernels compiled by nvcc, CUB for scan and sort; launch_queue.hpp says when launches go
// to the device. `download` and `synchronize` wait. A short download is a kernel that writes to memory of the host,
// which looks for it there: it takes half as long as a copy and a wait for the stream.
#include "cuda_backend.hpp"

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <cstring>
#include <exception>
#include <memory>
#include <stdexcept>
#include <thread>
#include <unordered_map>
#include <utility>
#include <vector>

#include "cama/error.hpp"
#include "check.hpp"
#include "device/for_backends.hpp"
#include "launch_queue.hpp"
#include "primitives.cuh"
#include "world_runner.hpp"

namespace cama {
namespace {

constexpr std::size_t most_bytes = std::size_t(1) << 20;  // of a copy that is a kernel
constexpr std::size_t most_answer_bytes = 8192;  // of a download that a kernel writes to the host
constexpr int threads_of_answer = 256;
constexpr unsigned int looks_until_query = 4096;
constexpr std::size_t freed_until_wait = std::size_t(1) << 26;  // bytes, which the pool may return at a wait alone
constexpr int fewest_threads = 32, most_threads = 256, blocks_per_processor = 16;

struct Entry {
  const void *once, *f32, *f64;
};

const Entry entries[] = {
#define CAMA_DOUBLE_KERNEL(name) {reinterpret_cast<const void *>(&kernels::name), nullptr, nullptr},
#define CAMA_REAL_KERNEL(name) \
  {nullptr, reinterpret_cast<const void *>(&kernels::f32::name), reinterpret_cast<const void *>(&kernels::f64::name)},
#include "kernels/kernels.def"
};

const void *function_of(const KernelKey &kernel)
{
  const Entry &entry = entries[kernel.index];
  return kernel.precision == KernelPrecision::none  ? entry.once
         : kernel.precision == KernelPrecision::f32 ? entry.f32
                                                    : entry.f64;
}

/// Of a kernel's TEAM_LOCAL memory.
int team_bytes(const KernelKey &kernel)
{
  static std::atomic<int> known[3 * sizeof entries / sizeof *entries];  // one more than the bytes
  std::atomic<int> &own =
      known[3 * static_cast<std::size_t>(kernel.index) + static_cast<std::size_t>(kernel.precision)];
  if (own == 0) {
    cudaFuncAttributes attributes;
    check(cudaFuncGetAttributes(&attributes, function_of(kernel)), "cudaFuncGetAttributes");
    own = static_cast<int>(attributes.sharedSizeBytes) + 1;
  }
  return own - 1;
}

/// Whether launches of the device, which is the current one, may begin while the one before ends (AWAIT_LAUNCHES in
/// lang.h): devices before 9.0 cannot, and graphs before CUDA 12.3.
bool begins_early(int device)
{
  int major = 0, driver = 0;
  check(cudaDeviceGetAttribute(&major, cudaDevAttrComputeCapabilityMajor, device), "cudaDeviceGetAttribute");
  cudaFuncAttributes compiled;
  check(cudaFuncGetAttributes(&compiled, copy_words), "cudaFuncGetAttributes");
  check(cudaDriverGetVersion(&driver), "cudaDriverGetVersion");
  return compiled.ptxVersion >= 90 && major >= 9 && std::min(driver, CUDART_VERSION) >= 12030;
}

class CudaBackend final : public Backend {
public:
  explicit CudaBackend(int device) : index_(device), before_(make_current()), queue_(begins_early(device))
  {
    cudaDeviceProp properties;
    check(cudaGetDeviceProperties(&properties, device), "cudaGetDeviceProperties");
    device_ = properties.name;
    processors_ = properties.multiProcessorCount;
    workers_ = processors_ * properties.maxThreadsPerMultiProcessor;
    blocks_ = processors_ * blocks_per_processor;
    cudaMemPool_t pool = nullptr;
    check(cudaDeviceGetDefaultMemPool(&pool, device), "cudaDeviceGetDefaultMemPool");
    std::uint64_t kept = std::uint64_t(1) << 30;  // bytes that are not returned to the driver at a wait
    check(cudaMemPoolSetAttribute(pool, cudaMemPoolAttrReleaseThreshold, &kept), "cudaMemPoolSetAttribute");
    check(cudaMalloc(&total_, most_chunks * sizeof(long long)), "cudaMalloc");
    void *shared = nullptr;
    check(cudaHostAlloc(&shared, sizeof(Shared), cudaHostAllocMapped), "cudaHostAlloc");
    shared_ = static_cast<Shared *>(shared);
    shared_->overflow = shared_->answers = 0;
  }
  ~CudaBackend() override
  {
    queue_.stop();
    for (void *scratch : {scratch_, other_keys_, other_values_, total_}) cudaFree(scratch);
    cudaFreeHost(shared_);
  }

  std::string_view name() const override { return "cuda"; }
  std::string device() const override { return device_; }

  bool wide_workers() const override { return false; }
  int workers() const override { return workers_; }

  Buffer allocate(std::size_t bytes) override
  {
    void *memory = nullptr;
    check(cudaMallocAsync(&memory, std::max<std::size_t>(bytes, 1), queue_.stream()),
          ("cudaMallocAsync of " + std::to_string(bytes) + " bytes").c_str());
#ifndef NDEBUG
    check(cudaMemsetAsync(memory, 0xff, bytes, queue_.stream()),
          "cudaMemset");  // every double and float of a new stream is NaN
#endif
    sizes_[memory] = bytes;
    allocated_ += bytes;
    peak_ = std::max(peak_, allocated_);
    return memory;
  }
  void release(Buffer buffer) noexcept override
  {
    const auto found = sizes_.find(buffer);
    std::size_t bytes = 0;
    if (found != sizes_.end()) {
      bytes = found->second;
      allocated_ -= bytes;
      freed_ += bytes;
      sizes_.erase(found);
    }
    queue_.free(buffer, bytes);
  }
  void upload(Buffer to, const void *from, std::size_t bytes) override
  {
    hand_over();
    check(cudaMemcpyAsync(to, from, bytes, cudaMemcpyHostToDevice, queue_.stream()), "cudaMemcpy to the device");
    check(cudaStreamSynchronize(queue_.stream()), "upload");  // the caller may free its memory
    queue_.note_wait();
  }
  void download(void *to, Buffer from, std::size_t bytes, std::size_t offset) override
  {
    const bool in_words = bytes % sizeof(int) == 0 && offset % sizeof(int) == 0;
    if (in_words && bytes <= most_answer_bytes && freed_ < freed_until_wait)
      return receive(to, static_cast<const char *>(from) + offset, bytes);
    hand_over();
    check(cudaMemcpyAsync(to, static_cast<const char *>(from) + offset, bytes, cudaMemcpyDeviceToHost, queue_.stream()),
          "cudaMemcpy to the host");
    synchronize();
  }
  void copy(Buffer to, Buffer from, std::size_t bytes) override
  {
    if (bytes > most_bytes || bytes % sizeof(int) != 0) {
      hand_over();
      check(cudaMemcpyAsync(to, from, bytes, cudaMemcpyDeviceToDevice, queue_.stream()), "cudaMemcpy on the device");
    } else if (bytes > 0) {
      launch_words("copy", copy_words, bytes, static_cast<const int *>(from), static_cast<int *>(to));
    }
  }
  void fill(Buffer buffer, unsigned char byte, std::size_t bytes) override
  {
    if (bytes > most_bytes || bytes % sizeof(int) != 0) {
      hand_over();
      check(cudaMemsetAsync(buffer, byte, bytes, queue_.stream()), "cudaMemset");
    } else if (bytes > 0) {
      launch_words("fill", fill_words, bytes, 0x01010101 * byte, static_cast<int *>(buffer));
    }
  }

  void launch(const KernelKey &kernel, int n, const Argument *arguments, int count) override
  {
    ++launches_;
    const int threads = kernel.team > 0 ? kernel.team : threads_for(n);
    const int blocks = kernel.team > 0 ? n : std::min((n - 1) / threads + 1, blocks_);
    Slot slots[max_kernel_arguments + 1] = {to_slot(n)};
    for (int i = 0; i < count; ++i) slots[i + 1] = slot_of(arguments[i]);
    queue_.launch(function_of(kernel), kernel.name, blocks, threads, slots, count + 1);
  }

  void begin_batches() override { queue_.begin_batches(); }
  void hand_over() override { queue_.hand_over(); }
  void end_batches() noexcept override { queue_.end_batches(); }
  void begin_side_by_side() override { queue_.begin_side_by_side(); }
  void end_side_by_side() override { queue_.end_side_by_side(); }
  bool forks() const override { return true; }
  void fork() override { queue_.fork(); }
  void begin_aside() override { queue_.begin_aside(); }
  void end_aside() override { queue_.end_aside(); }
  void meet() noexcept override { queue_.meet(); }

  /// As a graph.
  void repeat(int times, const std::function<void()> &work) override
  {
    if (times < 1) return;
    queue_.begin_repetition();
    const long before = launches_;
    try {
      work();
    } catch (...) {
      queue_.give_up_repetition();
      throw;
    }
    launches_ += (launches_ - before) * (times - 1);
    queue_.run_repetition(times);
  }

  void scan(Buffer from, Buffer to, int n) override
  {
    const int *in = static_cast<const int *>(from);
    int *out = static_cast<int *>(to);
    auto *total = static_cast<long long *>(total_);
    if (n <= longest_block_scan)
      return launch_own("scan_by_block", scan_by_block, 1, block_scan_threads, n, in, out, flag());
    const int chunks = (n - 1) / scan_chunk + 1;
    if (chunks <= most_chunks) {
      launch_own("sum_chunks", sum_chunks, chunks, block_scan_threads, n, in, total);
      return launch_own("scan_chunks", scan_chunks, chunks, block_scan_threads, n, in, total, out, flag());
    }
    hand_over();
    with_scratch(
        [&](void *scratch, std::size_t &bytes) {
          return cub::DeviceScan::ExclusiveSum(scratch, bytes, in, out, n, queue_.stream());
        },
        "scan");
    with_scratch(
        [&](void *scratch, std::size_t &bytes) {
          return cub::DeviceReduce::Reduce(scratch, bytes, in, total, n, AddLong{}, 0ll, queue_.stream());
        },
        "scan");
    finish_scan<<<1, 1, 0, queue_.stream()>>>(n, in, out, total, flag());
    check(cudaGetLastError(), "finish_scan");
  }

  void sort(Buffer keys, Buffer values, int n, int bits) override
  {
    if (n <= 1) return;
    if (n <= longest_block_sort) return sort_short(static_cast<key64 *>(keys), static_cast<int *>(values), n, bits);
    hand_over();
    if (n > other_size_) {
      cudaFree(std::exchange(other_keys_, nullptr));
      cudaFree(std::exchange(other_values_, nullptr));
      other_size_ = 0;
      const std::size_t room = static_cast<std::size_t>(n) + static_cast<std::size_t>(n) / 2;
      check(cudaMalloc(&other_keys_, room * sizeof(key64)), "cudaMalloc for sort");
      check(cudaMalloc(&other_values_, room * sizeof(int)), "cudaMalloc for sort");
      other_size_ = static_cast<long long>(room);
    }
    cub::DoubleBuffer<key64> key(static_cast<key64 *>(keys), static_cast<key64 *>(other_keys_));
    cub::DoubleBuffer<int> value(static_cast<int *>(values), static_cast<int *>(other_values_));
    with_scratch(
        [&](void *scratch, std::size_t &bytes) {
          return cub::DeviceRadixSort::SortPairs(scratch, bytes, key, value, n, 0, bits, queue_.stream());
        },
        "sort");
    if (key.Current() != keys) copy(keys, key.Current(), sizeof(key64) * static_cast<std::size_t>(n));
    if (value.Current() != values) copy(values, value.Current(), sizeof(int) * static_cast<std::size_t>(n));
  }
  /// Waits for the device; throws MemoryError if a scan has overflowed since the last wait.
  void synchronize() override
  {
    ++waits_;
    hand_over();
    check(cudaStreamSynchronize(queue_.stream()), "synchronize");
    queue_.note_wait();
    freed_ = 0;
    report_overflow();
  }

  DeviceMemory memory() const override
  {
    return {DeviceMemory::Kind::cuda, index_, reinterpret_cast<std::uintptr_t>(queue_.stream())};
  }
  bool reaches(const void *address) const override
  {
    cudaPointerAttributes attributes{};
    if (cudaPointerGetAttributes(&attributes, address) != cudaSuccess) {
      cudaGetLastError();
      return false;
    }
    return attributes.type == cudaMemoryTypeManaged ||
           (attributes.type == cudaMemoryTypeDevice && attributes.device == index_);
  }
  void synchronize_device() override
  {
    const OnDevice device(*this);
    hand_over();
    check(cudaDeviceSynchronize(), "cudaDeviceSynchronize");
    queue_.note_wait();
  }
  int make_current() const override
  {
    int before = -1;
    if (cudaGetDevice(&before) == cudaSuccess && before == index_) return -1;
    check(cudaSetDevice(index_), "cudaSetDevice");
    return before;
  }
  void leave_to(int device) const override
  {
    if (device >= 0) cudaSetDevice(device);
  }
  int device_before() const override { return before_; }

  std::unique_ptr<WorldRunner> make_runner() override
  {
    return make_world_runner(index_, queue_.stream(), &team_bytes);
  }

private:
  /// On the host, where the device reaches it.
  struct Shared {
    volatile int overflow;  // of a scan
    volatile unsigned int answers;  // that have arrived
    volatile int words[most_answer_bytes / sizeof(int)];
  };

  /// A short download.
  void receive(void *to, const void *from, std::size_t bytes)
  {
    if (bytes == 0) return synchronize();
    ++waits_;
    ++asked_;
    launch_own("download", answer_words, 1, threads_of_answer, static_cast<int>(bytes / sizeof(int)),
               static_cast<const int *>(from), shared_->words, &shared_->answers, asked_);
    hand_over();
    bool ended = false;
    for (unsigned int looks = 1; shared_->answers != asked_; ++looks) {
      rest();
      if (looks % looks_until_query != 0) continue;
      if (ended) throw BackendError("download: the device has ended its work without an answer; start a new process");
      const cudaError_t status = cudaStreamQuery(queue_.stream());
      if (status == cudaErrorNotReady)
        cudaGetLastError();  // not an error
      else
        check(status, "download");
      ended = status == cudaSuccess;
      std::this_thread::yield();
    }
    std::atomic_thread_fence(std::memory_order_acquire);
    queue_.note_wait();
    std::memcpy(to, const_cast<const int *>(shared_->words), bytes);
    report_overflow();
  }

  void sort_short(key64 *keys, int *values, int n, int bits)
  {
    const auto launch = [&](auto kernel, int threads) {
      launch_own("sort_by_block", kernel, 1, threads, n, bits, keys, values);
    };
    if (n <= 64 * block_sort_items)
      launch(&sort_by_block<64>, 64);
    else if (n <= 256 * block_sort_items)
      launch(&sort_by_block<256>, 256);
    else
      launch(&sort_by_block<512>, 512);
  }

  /// Threads of a block: so few that a short launch has a block or two for every processor.
  int threads_for(int n) const
  {
    int threads = fewest_threads;
    while (threads < most_threads && n > 2 * threads * processors_) threads *= 2;
    return threads;
  }

  template <class... P, class... A>
  void launch_own(const char *name, void (*kernel)(P...), int blocks, int threads, A... arguments)
  {
    const Slot slots[] = {to_slot(static_cast<P>(arguments))...};
    queue_.launch(reinterpret_cast<const void *>(kernel), name, blocks, threads, slots, sizeof...(P));
  }
  template <class From>
  void launch_words(const char *name, void (*kernel)(int, From, int *), std::size_t bytes, From from, int *to)
  {
    const int n = static_cast<int>(bytes / sizeof(int)), threads = threads_for(n);
    launch_own(name, kernel, std::min((n - 1) / threads + 1, blocks_), threads, n, from, to);
  }

  /// After a wait.
  void report_overflow()
  {
    if (!shared_->overflow) return;
    shared_->overflow = 0;
    throw ListOverflow();
  }
  int *flag() const { return const_cast<int *>(&shared_->overflow); }

  /// Calls CUB twice: for the size of its scratch memory, then for the work.
  template <class F> void with_scratch(F &&call, const char *what)
  {
    std::size_t bytes = 0;
    check(call(nullptr, bytes), what);
    if (bytes > scratch_size_) {
      cudaFree(std::exchange(scratch_, nullptr));
      scratch_size_ = 0;
      check(cudaMalloc(&scratch_, bytes + bytes / 2), "cudaMalloc for scratch");
      scratch_size_ = bytes + bytes / 2;
    }
    bytes = scratch_size_;
    check(call(scratch_, bytes), what);
  }

  const int index_, before_;  // of the device, and of the one before it
  std::string device_;
  int processors_ = 1, workers_ = 1, blocks_ = 1;
  LaunchQueue queue_;
  std::unordered_map<Buffer, std::size_t> sizes_;
  void *scratch_ = nullptr, *other_keys_ = nullptr, *other_values_ = nullptr;
  void *total_ = nullptr;  // of a scan, or of its chunks, 64 bits each
  Shared *shared_ = nullptr;
  unsigned int asked_ = 0;  // answers
  std::size_t freed_ = 0;  // bytes since the last wait for the stream
  std::size_t scratch_size_ = 0;
  long long other_size_ = 0;
};

}  // namespace

std::vector<std::string> cuda_devices(std::string &note)
{
  int count = 0;
  const cudaError_t status = cudaGetDeviceCount(&count);
  if (status != cudaSuccess) {
    cudaGetLastError();
    note = std::string(cudaGetErrorName(status)) + ": " + cudaGetErrorString(status);
    return {};
  }
  std::vector<std::string> names;
  for (int i = 0; i < count; ++i) {
    cudaDeviceProp properties;
    if (cudaGetDeviceProperties(&properties, i) == cudaSuccess) names.push_back(properties.name);
  }
  return names;
}

std::unique_ptr<Backend> make_cuda_backend(int device)
{
  std::string note;
  const std::vector<std::string> devices = cuda_devices(note);
  if (devices.empty())
    throw BackendError("backend cuda: no usable device (" + note + "); use cpu, or install NVIDIA's driver");
  if (device < 0 || device >= static_cast<int>(devices.size()))
    throw BackendError("device: " + std::to_string(device) + " is out of range; backend cuda has " +
                       std::to_string(devices.size()) + " devices, counted from 0");
  return std::make_unique<CudaBackend>(device);
}

}  // namespace cama
