// SPDX-License-Identifier: Apache-2.0
// The OpenMP backend: each kernel is an ordinary loop. With one thread it is the serial reference.
#include "cpu_backend.hpp"

#include <omp.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <new>
#include <thread>

#include "cama/error.hpp"
#include "cpu_kernels.hpp"
#include "device/for_backends.hpp"
#include "thread_governor.hpp"

namespace cama {
namespace {

const cpu::Functions parallel_kernels[] = {
#define CAMA_DOUBLE_KERNEL(name) {&cpu::trampoline<&kernels::name>, nullptr, nullptr},
#define CAMA_REAL_KERNEL(name) {nullptr, &cpu::trampoline<&kernels::f32::name>, &cpu::trampoline<&kernels::f64::name>},
#include "kernels/kernels.def"
};

constexpr std::size_t header = 64;   // holds the size in front of every allocation, and keeps 64-byte alignment

#if defined(_WIN32)
void *aligned(std::size_t bytes) { return _aligned_malloc(bytes, header); }
void free_aligned(void *memory) { _aligned_free(memory); }
#else
void *aligned(std::size_t bytes) { return std::aligned_alloc(header, bytes); }
void free_aligned(void *memory) { std::free(memory); }
#endif

std::string cpu_name()
{
  std::ifstream file("/proc/cpuinfo");
  for (std::string line; std::getline(file, line);)
    if (line.rfind("model name", 0) == 0) return line.substr(line.find(':') + 2);
  return "CPU";
}

class CpuBackend final : public Backend {
public:
  explicit CpuBackend(int threads) : governor_(threads > 0 ? threads : cpu_backend_count()) {}

  std::string_view name() const override { return "cpu"; }
  std::string device() const override
  {
    return cpu_name() + ", " + std::to_string(governor_.most()) + (governor_.most() == 1 ? " thread" : " threads");
  }

  bool wide_workers() const override { return true; }
  int workers() const override { return governor_.most(); }

  Buffer allocate(std::size_t bytes) override
  {
    const std::size_t whole = (bytes + header + 63) / 64 * 64;
    auto *memory = static_cast<unsigned char *>(aligned(whole));
    if (!memory)
      throw MemoryError("out of memory: " + std::to_string(bytes) + " bytes requested in addition to " +
                        std::to_string(allocated_) + "; lower the resolution");
    std::memcpy(memory, &bytes, sizeof bytes);
#ifndef NDEBUG
    std::memset(memory + header, 0xff, bytes);   // every double and float of a new stream is NaN
#endif
    allocated_ += bytes;
    peak_ = std::max(peak_, allocated_);
    return memory + header;
  }
  void release(Buffer buffer) noexcept override
  {
    auto *memory = static_cast<unsigned char *>(buffer) - header;
    std::size_t bytes;
    std::memcpy(&bytes, memory, sizeof bytes);
    allocated_ -= bytes;
    free_aligned(memory);
  }
  void upload(Buffer to, const void *from, std::size_t bytes) override { std::memcpy(to, from, bytes); }
  void download(void *to, Buffer from, std::size_t bytes, std::size_t offset) override
  {
    ++waits_;
    std::memcpy(to, static_cast<const char *>(from) + offset, bytes);
  }
  void copy(Buffer to, Buffer from, std::size_t bytes) override { std::memcpy(to, from, bytes); }
  void fill(Buffer buffer, unsigned char byte, std::size_t bytes) override { std::memset(buffer, byte, bytes); }

  void launch(const KernelKey &kernel, int n, const Argument *arguments, int) override
  {
    ++launches_;
    if (governor_.most() > 1 && launches_ % launches_per_look == 0) look_at_threads();
    const HostThreads host(governor_.threads());
    const cpu::Functions &own = (governor_.threads() == 1 ? cpu::serial_kernels : parallel_kernels)[kernel.index];
    const cpu::Trampoline function = kernel.precision == KernelPrecision::none  ? own.once
                                     : kernel.precision == KernelPrecision::f32 ? own.f32
                                                                                : own.f64;
    function(n, arguments);
  }

  void scan(Buffer from, Buffer to, int n) override
  {
    const int *in = static_cast<const int *>(from);
    int *out = static_cast<int *>(to);
    long long sum = 0;
    for (int i = 0; i < n; ++i) {
      out[i] = static_cast<int>(sum);
      sum += in[i];
    }
    if (sum > 0x7fffffff) throw ListOverflow();
    out[n] = static_cast<int>(sum);
  }

  void sort(Buffer keys, Buffer values, int n, int bits) override
  {
    const std::size_t count = static_cast<std::size_t>(n);
    if (values_.size() < count) {
      try {
        keys_.resize(count);
        values_.resize(count);
      } catch (const std::bad_alloc &) {
        throw MemoryError("out of memory: sorting " + std::to_string(n) + " keys; lower the resolution");
      }
    }
    key64 *key = static_cast<key64 *>(keys), *other_key = keys_.data();
    int *value = static_cast<int *>(values), *other_value = values_.data();
    for (int shift = 0; shift < bits; shift += 11) {
      std::size_t start[2049] = {};
      for (std::size_t i = 0; i < count; ++i) ++start[((key[i] >> shift) & 2047) + 1];
      for (int d = 0; d < 2048; ++d) start[d + 1] += start[d];
      for (std::size_t i = 0; i < count; ++i) {
        const std::size_t at = start[(key[i] >> shift) & 2047]++;
        other_key[at] = key[i];
        other_value[at] = value[i];
      }
      std::swap(key, other_key);
      std::swap(value, other_value);
    }
    if (key != keys) {
      std::copy_n(key, count, static_cast<key64 *>(keys));
      std::copy_n(value, count, static_cast<int *>(values));
    }
  }
  void synchronize() override {}
  DeviceMemory memory() const override { return {DeviceMemory::Kind::host, 0, 0}; }

private:
  static constexpr int launches_per_look = 16;
  static constexpr double look_every = 0.02;   // s

  /// Tells the governor how long the threads waited for a CPU.
  void look_at_threads()
  {
    const auto now = std::chrono::steady_clock::now();
    const double elapsed = std::chrono::duration<double>(now - looked_).count();
    if (elapsed < look_every) return;
    looked_ = now;
    double waited = 0;
#pragma omp parallel num_threads(governor_.threads()) reduction(+ : waited)
    {
      static thread_local double before = waited_for_cpu();
      const double total = waited_for_cpu();
      waited += total - before;
      before = total;
    }
    governor_.observe(elapsed, waited);
  }

  ThreadGovernor governor_;
  std::chrono::steady_clock::time_point looked_ = std::chrono::steady_clock::now();
  std::vector<key64> keys_;   // scratch memory of sort
  std::vector<int> values_;
};

}  // namespace

int cpu_backend_count()
{
  static const double quota = std::ceil(cpu_quota());
  const int processors = std::min(omp_get_num_procs(), omp_get_max_threads());
  return std::max(1, quota < processors ? static_cast<int>(quota) : processors);
}

std::unique_ptr<Backend> make_cpu_backend(int threads) { return std::make_unique<CpuBackend>(threads); }

}  // namespace cama
