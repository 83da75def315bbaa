// SPDX-License-Identifier: Apache-2.0
// The OpenCL 1.2 backend: one in-order queue on one device. Programs are shared by all backends of the process
// (program.hpp).
#include "opencl_backend.hpp"

#include <algorithm>
#include <array>
#include <cstdint>
#include <map>
#include <vector>

#include "cama/error.hpp"
#include "program.hpp"

namespace cama {
namespace {

using opencl::api;
using opencl::Library;
using opencl::Text;

/// A kernel object holds its arguments, so every backend has its own.
struct OwnKernel {
  cl_kernel kernel = nullptr;
  size_t group = 1;   ///< work-items per work-group
  size_t most = 1;    ///< largest group of this kernel
};

cl_mem as_memory(Buffer buffer) { return static_cast<cl_mem>(buffer); }

constexpr int scan_chunk = 4096;  // elements that a work-group of a GPU scans
constexpr int max_summed_chunks = 4096;  // of a list each of whose groups sums the chunks before its own
// MAX_ITEMS, SORT_BITS and SORT_RUN of primitives.cl.
constexpr size_t max_group_items = 128;
constexpr int sort_bits = 6, sort_run = 16;
constexpr int items_of_unit = 2048;  // that a compute unit of a GPU runs at the same time, about: OpenCL does not say

/// Device memory that only grows.
class Scratch {
public:
  explicit Scratch(Backend &backend) : backend_(backend) {}
  ~Scratch()
  {
    if (buffer_) backend_.release(buffer_);
  }
  Scratch(const Scratch &) = delete;
  Buffer get(std::size_t bytes)
  {
    if (bytes <= bytes_) return buffer_;
    if (buffer_) backend_.release(buffer_);
    buffer_ = nullptr;
    bytes_ = 0;
    buffer_ = backend_.allocate(bytes + bytes / 2);
    bytes_ = bytes + bytes / 2;
    return buffer_;
  }

private:
  Backend &backend_;
  Buffer buffer_ = nullptr;
  std::size_t bytes_ = 0;
};

class OpenclBackend final : public Backend {
public:
  explicit OpenclBackend(const opencl::Device &device) : library_(Library::of(device))
  {
    cl_int code = CL_SUCCESS;
    queue_ = api().clCreateCommandQueue(library_.context, device.id, 0, &code);
    check(code, "clCreateCommandQueue", "device '" + device.name + "'");
    units_ = static_cast<int>(std::max<cl_uint>(1, opencl::number<cl_uint>(device.id, CL_DEVICE_MAX_COMPUTE_UNITS)));
    max_bytes_ = opencl::number<cl_ulong>(device.id, CL_DEVICE_MAX_MEM_ALLOC_SIZE);
    all_bytes_ = opencl::number<cl_ulong>(device.id, CL_DEVICE_GLOBAL_MEM_SIZE);
    max_items_ = opencl::max_work_items(device.id);
  }
  ~OpenclBackend() override
  {
    if (queue_) api().clFinish(queue_);
    for (auto &entry : kernels_)
      if (entry.second.kernel) api().clReleaseKernel(entry.second.kernel);
    if (queue_) api().clReleaseCommandQueue(queue_);
  }

  std::string_view name() const override { return "opencl"; }
  std::string device() const override { return library_.device.name + " (" + library_.device.driver + ")"; }

  bool wide_workers() const override { return library_.is_cpu; }
  int workers() const override { return library_.is_cpu ? units_ : items_of_unit * units_; }

  Buffer allocate(std::size_t bytes) override
  {
    const std::string what = "allocating " + std::to_string(bytes) + " bytes on top of " + std::to_string(allocated_) +
                             " on device '" + library_.device.name + "'";
    // Drivers that allocate lazily would fail in the middle of a step.
    if (bytes > max_bytes_) opencl::fail(CL_INVALID_BUFFER_SIZE, "clCreateBuffer", what);
    if (bytes > all_bytes_ - std::min<std::size_t>(allocated_, all_bytes_))
      opencl::fail(CL_MEM_OBJECT_ALLOCATION_FAILURE, "clCreateBuffer", what);
    cl_int code = CL_SUCCESS;
    cl_mem buffer = api().clCreateBuffer(library_.context, CL_MEM_READ_WRITE, bytes, nullptr, &code);
    if (code == CL_OUT_OF_RESOURCES) code = CL_MEM_OBJECT_ALLOCATION_FAILURE;
    check(code, "clCreateBuffer", what);
    allocated_ += bytes;
    peak_ = std::max(peak_, allocated_);
#ifndef NDEBUG
    try {
      fill(buffer, 0xff, bytes);  // every double and float of a new stream is NaN
    } catch (...) {
      release(buffer);
      throw;
    }
#endif
    return buffer;
  }
  void release(Buffer buffer) noexcept override
  {
    size_t bytes = 0;
    api().clGetMemObjectInfo(as_memory(buffer), CL_MEM_SIZE, sizeof bytes, &bytes, nullptr);
    allocated_ -= bytes;
    api().clReleaseMemObject(as_memory(buffer));
  }
  void upload(Buffer to, const void *from, std::size_t bytes) override
  {
    if (bytes == 0) return;
    check(api().clEnqueueWriteBuffer(queue_, as_memory(to), CL_TRUE, 0, bytes, from, 0, nullptr, nullptr),
          "clEnqueueWriteBuffer", size_of(bytes));
  }
  void download(void *to, Buffer from, std::size_t bytes, std::size_t offset) override
  {
    if (bytes == 0) return;
    ++waits_;
    cl_int overflow = 0;
    if (scans_)
      check(api().clEnqueueReadBuffer(queue_, as_memory(overflow_.get(sizeof overflow)), CL_FALSE, 0, sizeof overflow,
                                      &overflow, 0, nullptr, nullptr),
            "clEnqueueReadBuffer", "the scans' overflow");
    const cl_int code =
        api().clEnqueueReadBuffer(queue_, as_memory(from), CL_TRUE, offset, bytes, to, 0, nullptr, nullptr);
    if (code != CL_SUCCESS) {
      api().clFinish(queue_);  // `overflow` is still being read
      fail(code, "clEnqueueReadBuffer", size_of(bytes));
    }
    report_overflow(overflow);
  }
  void copy(Buffer to, Buffer from, std::size_t bytes) override
  {
    if (bytes == 0 || to == from) return;
    check(api().clEnqueueCopyBuffer(queue_, as_memory(from), as_memory(to), 0, 0, bytes, 0, nullptr, nullptr),
          "clEnqueueCopyBuffer", size_of(bytes));
  }
  void fill(Buffer buffer, unsigned char byte, std::size_t bytes) override
  {
    if (bytes == 0) return;
    std::array<unsigned char, 16> pattern;
    pattern.fill(byte);
    const size_t width = bytes % 16 == 0 ? 16 : bytes % 4 == 0 ? 4 : 1;
    check(api().clEnqueueFillBuffer(queue_, as_memory(buffer), pattern.data(), width, 0, bytes, 0, nullptr, nullptr),
          "clEnqueueFillBuffer", size_of(bytes));
  }

  void launch(const KernelKey &key, int n, const Argument *arguments, int count) override
  {
    const Text text = key.precision == KernelPrecision::none  ? Text::once
                      : key.precision == KernelPrecision::f32 ? Text::f32
                                                              : Text::f64;
    const OwnKernel &kernel = find(text, key.index, key.name);
    set(kernel, key.name, 0, sizeof n, &n);
    for (int i = 0; i < count; ++i) {
      const Argument &a = arguments[i];
      if (a.is_buffer)
        set_buffer(kernel, key.name, i + 1, a.buffer);
      else
        set(kernel, key.name, i + 1, a.size, a.scalar);
    }
    if (key.team == 0)
      enqueue(kernel, key.name, n);
    else
      enqueue_teams(kernel, key.name, n, key.team);
  }

  void scan(Buffer from, Buffer to, int n) override
  {
    Buffer overflow = overflow_.get(sizeof(cl_int));
    if (!scans_) fill(overflow, 0, sizeof(cl_int));
    scans_ = true;
    if (n <= (library_.is_cpu ? 32768 : 2 * scan_chunk)) return run_group(scan_small, {&n, from, to, overflow});
    if (library_.is_cpu) {
      Buffer sums = sums_.get(sizeof(cl_long) * static_cast<std::size_t>(units_));
      run(scan_sums, units_, {&units_, &n, from, sums});
      run_group(scan_offsets, {&units_, sums, overflow});
      return run(scan_write, units_, {&units_, &n, from, sums, to});
    }
    const int chunks = (n - 1) / scan_chunk + 1, offsets = chunks > max_summed_chunks ? 1 : 0;
    Buffer sums = sums_.get(sizeof(cl_long) * static_cast<std::size_t>(chunks));
    run_groups(chunk_sums, chunks, items_of(chunk_sums), {&n, &scan_chunk, from, sums});
    if (offsets) run_group(scan_offsets, {&chunks, sums, overflow});
    run_groups(scan_chunks, chunks, items_of(scan_chunks), {&n, &scan_chunk, &offsets, from, sums, to, overflow});
  }

  void sort(Buffer keys, Buffer values, int n, int bits) override
  {
    if (n <= 1) return;
    if (library_.is_cpu)
      sort_on_cpu(keys, values, n, bits);
    else
      sort_on_gpu(keys, values, n, bits);
  }

  void synchronize() override
  {
    ++waits_;
    check(api().clFinish(queue_), "clFinish", "pausing for device '" + library_.device.name + "'");
    if (!scans_) return;
    cl_int overflow = 0;
    Buffer flag = overflow_.get(sizeof overflow);
    check(
        api().clEnqueueReadBuffer(queue_, as_memory(flag), CL_TRUE, 0, sizeof overflow, &overflow, 0, nullptr, nullptr),
        "clEnqueueReadBuffer", "the scans' overflow");
    report_overflow(overflow);
  }

private:
  /// An argument of a primitive: an int or a buffer.
  struct Value {
    Value(const int *number) : number(number) {}
    Value(Buffer buffer) : buffer(buffer) {}
    const int *number = nullptr;
    Buffer buffer = nullptr;
  };

  [[noreturn]] void fail(cl_int code, const char *call, const std::string &what)
  {
    if (opencl::means_lost(code)) library_.lose();
    opencl::fail(code, call, what);
  }
  void check(cl_int code, const char *call, const std::string &what)
  {
    if (code != CL_SUCCESS) fail(code, call, what);
  }
  static std::string size_of(std::size_t bytes) { return std::to_string(bytes) + " bytes"; }

  void report_overflow(cl_int overflow)
  {
    scans_ = false;
    if (overflow) throw ListOverflow();
  }

  /// Kernels of primitives.cl.
  struct Primitive {
    int index;
    const char *name;
  };
  static constexpr Primitive scan_small{0, "scan_small"};
  static constexpr Primitive scan_sums{1, "scan_sums"};
  static constexpr Primitive scan_offsets{2, "scan_offsets"};
  static constexpr Primitive scan_write{3, "scan_write"};
  static constexpr Primitive chunk_sums{4, "chunk_sums"};
  static constexpr Primitive scan_chunks{5, "scan_chunks"};
  static constexpr Primitive sort_count{6, "sort_count"};
  static constexpr Primitive sort_move{7, "sort_move"};
  static constexpr Primitive sort_small{8, "sort_small"};
  static constexpr Primitive sort_chunks_count{9, "sort_chunks_count"};
  static constexpr Primitive sort_chunks_move{10, "sort_chunks_move"};
  static constexpr Primitive sort_chunk{11, "sort_chunk"};
  const OwnKernel &find(const Primitive &p) { return find(Text::primitives, p.index, p.name); }

  /// Work-items of a group that runs the primitive.
  size_t items_of(const Primitive &primitive)
  {
    const OwnKernel &kernel = find(primitive);
    return library_.is_cpu ? std::min<size_t>(4, kernel.most) : kernel.group;
  }

  const OwnKernel &find(Text text, int index, const char *kernel_name)
  {
    OwnKernel &own = kernels_[static_cast<int>(text) * 1024 + index];
    if (own.kernel) return own;
    cl_int code = CL_SUCCESS;
    own.kernel = api().clCreateKernel(library_.program(text), kernel_name, &code);
    check(code, "clCreateKernel", kernel_name);
    size_t multiple = 0;
    const cl_device_id id = library_.device.id;
    check(
        api().clGetKernelWorkGroupInfo(own.kernel, id, CL_KERNEL_WORK_GROUP_SIZE, sizeof own.most, &own.most, nullptr),
        "clGetKernelWorkGroupInfo", kernel_name);
    own.most = std::clamp<size_t>(own.most, 1, max_items_);
    if (library_.is_cpu) return own;
    api().clGetKernelWorkGroupInfo(own.kernel, id, CL_KERNEL_PREFERRED_WORK_GROUP_SIZE_MULTIPLE, sizeof multiple,
                                   &multiple, nullptr);
    multiple = std::max<size_t>(multiple, 1);
    own.group = std::min(own.most, max_group_items);
    if (own.group > multiple) own.group -= own.group % multiple;
    return own;
  }

  void set(const OwnKernel &kernel, const char *kernel_name, int index, size_t size, const void *value)
  {
    const cl_int code = api().clSetKernelArg(kernel.kernel, static_cast<cl_uint>(index), size, value);
    if (code != CL_SUCCESS)
      fail(code, "clSetKernelArg", "argument " + std::to_string(index) + " of kernel " + kernel_name);
  }
  void set_buffer(const OwnKernel &kernel, const char *kernel_name, int index, Buffer buffer)
  {
    const cl_mem handle = as_memory(buffer);
    set(kernel, kernel_name, index, sizeof handle, handle ? &handle : nullptr);
  }

  /// Kernels with FOR_EACH accept any number of work-items: on CPUs a few with a contiguous run each, on GPUs up to one
  /// per element.
  void enqueue(const OwnKernel &kernel, const char *kernel_name, int n)
  {
    size_t local = kernel.group, global;
    if (library_.is_cpu) {
      global = n <= 256 ? 1 : static_cast<size_t>(std::min(n / 64, units_ * 8));
    } else {
      const size_t wanted = (static_cast<size_t>(n) + local - 1) / local, most = static_cast<size_t>(units_) * 64;
      global = std::min(wanted, most) * local;
    }
    enqueue(kernel, kernel_name, global, local);
  }
  /// On CPUs a team is one work-item; on GPUs a work-group, smaller if the device requires it.
  void enqueue_teams(const OwnKernel &kernel, const char *kernel_name, int n, int team)
  {
    if (library_.is_cpu) {
      enqueue(kernel, kernel_name, static_cast<size_t>(std::min(n, units_ * 8)), 1);
      return;
    }
    const size_t local = std::min(static_cast<size_t>(team), kernel.most);
    enqueue(kernel, kernel_name, static_cast<size_t>(std::min(n, units_ * 256)) * local, local);
  }
  void enqueue(const OwnKernel &kernel, const char *kernel_name, size_t global, size_t local)
  {
    ++launches_;
    const cl_int code =
        api().clEnqueueNDRangeKernel(queue_, kernel.kernel, 1, nullptr, &global, &local, 0, nullptr, nullptr);
    if (code != CL_SUCCESS)
      fail(code, "clEnqueueNDRangeKernel",
           "kernel " + std::string(kernel_name) + " on device '" + library_.device.name + "'");
  }

  /// By `width` bits at a time: count(shift, digits, key, counts) for each worker, then
  /// move(shift, digits, key, value, other key, other value, places).
  template <class Count, class Move>
  void sort_by_digits(Buffer keys, Buffer values, int n, int bits, int width, int workers, Count &&count, Move &&move)
  {
    const std::size_t size = static_cast<std::size_t>(n);
    Buffer key = keys, value = values, other_key = keys_.get(sizeof(std::uint64_t) * size),
           other_value = values_.get(sizeof(cl_int) * size);
    for (int shift = 0; shift < bits; shift += width) {
      const int digits = 1 << std::min(width, bits - shift), cells = digits * workers;
      Buffer counts = counts_.get(sizeof(cl_int) * static_cast<std::size_t>(cells));
      Buffer places = places_.get(sizeof(cl_int) * static_cast<std::size_t>(cells + 1));
      count(shift, digits, key, counts);
      scan(counts, places, cells);
      move(shift, digits, key, value, other_key, other_value, places);
      std::swap(key, other_key);
      std::swap(value, other_value);
    }
    if (key == keys) return;
    copy(keys, key, sizeof(std::uint64_t) * size);
    copy(values, value, sizeof(cl_int) * size);
  }
  void sort_on_cpu(Buffer keys, Buffer values, int n, int bits)
  {
    if (n <= 32768) {
      const int width = n <= 512 ? 8 : 11;
      return run(sort_small, 1,
                 {&n, &bits, &width, keys, values, keys_.get(sizeof(std::uint64_t) * static_cast<std::size_t>(n)),
                  values_.get(sizeof(cl_int) * static_cast<std::size_t>(n)), counts_.get(sizeof(cl_int) * 2049)});
    }
    sort_by_digits(
        keys, values, n, bits, units_ <= 16 ? 11 : 8, units_,
        [&](int shift, int digits, Buffer key, Buffer counts) {
          run(sort_count, units_, {&units_, &n, &shift, &digits, key, counts});
        },
        [&](int shift, int digits, Buffer key, Buffer value, Buffer other_key, Buffer other_value, Buffer places) {
          run(sort_move, units_, {&units_, &n, &shift, &digits, key, value, other_key, other_value, places});
        });
  }
  void sort_on_gpu(Buffer keys, Buffer values, int n, int bits)
  {
    // The groups of all kernels have the same chunks.
    const size_t items = std::min({items_of(sort_chunk), items_of(sort_chunks_count), items_of(sort_chunks_move)});
    const int chunk = sort_run * static_cast<int>(items), groups = (n - 1) / chunk + 1;
    if (groups == 1)
      return run_groups(sort_chunk, 1, items,
                        {&n, &bits, keys, values, keys_.get(sizeof(std::uint64_t) * static_cast<std::size_t>(n)),
                         values_.get(sizeof(cl_int) * static_cast<std::size_t>(n))});
    sort_by_digits(
        keys, values, n, bits, sort_bits, groups,
        [&](int shift, int digits, Buffer key, Buffer counts) {
          run_groups(sort_chunks_count, groups, items, {&n, &shift, &digits, key, counts});
        },
        [&](int shift, int digits, Buffer key, Buffer value, Buffer other_key, Buffer other_value, Buffer places) {
          run_groups(sort_chunks_move, groups, items,
                     {&n, &shift, &digits, key, value, other_key, other_value, places});
        });
  }

  void set_values(const OwnKernel &kernel, const char *kernel_name, const std::vector<Value> &values)
  {
    for (int i = 0; i < static_cast<int>(values.size()); ++i) {
      const Value &v = values[static_cast<std::size_t>(i)];
      if (v.number)
        set(kernel, kernel_name, i, sizeof(int), v.number);
      else
        set_buffer(kernel, kernel_name, i, v.buffer);
    }
  }
  void run_groups(const Primitive &primitive, int groups, size_t items, const std::vector<Value> &values)
  {
    const OwnKernel &kernel = find(primitive);
    set_values(kernel, primitive.name, values);
    enqueue(kernel, primitive.name, static_cast<size_t>(groups) * items, items);
  }
  void run_group(const Primitive &primitive, const std::vector<Value> &values)
  {
    run_groups(primitive, 1, items_of(primitive), values);
  }
  /// On CPUs, where workers are work-items.
  void run(const Primitive &primitive, int workers, const std::vector<Value> &values)
  {
    run_groups(primitive, workers, 1, values);
  }

  Library &library_;
  cl_command_queue queue_ = nullptr;
  int units_ = 1;
  std::size_t max_bytes_ = 0, all_bytes_ = 0, max_items_ = 1;
  std::map<int, OwnKernel> kernels_;
  bool scans_ = false;  ///< a scan has run since the overflow flag was read
  Scratch sums_{*this}, overflow_{*this}, keys_{*this}, values_{*this}, counts_{*this}, places_{*this};
};

}  // namespace

std::unique_ptr<Backend> make_opencl_backend(int device)
{
  return std::make_unique<OpenclBackend>(opencl::choose_device(device));
}

bool opencl_has_gpu()
{
  try {
    const opencl::Device device = opencl::choose_device(0);
    return (opencl::number<cl_device_type>(device.id, CL_DEVICE_TYPE) & CL_DEVICE_TYPE_GPU) != 0;
  } catch (const BackendError &) {
    return false;
  }
}

BackendInfo opencl_info()
{
  BackendInfo info{"opencl", false, {}, ""};
  try {
    const std::vector<opencl::Device> devices = opencl::find_devices();
    for (const opencl::Device &d : devices) {
      if (d.lacks.empty())
        info.devices.push_back(d.name);
      else
        info.note += (info.note.empty() ? "" : "; ") + ("device '" + d.name + "' lacks " + d.lacks);
    }
    info.available = !info.devices.empty();
    if (devices.empty())
      info.note = "no OpenCL device; install a driver, such as pocl-opencl-icd";
    else if (info.note.empty())
      info.note = "OpenCL 1.2";
  } catch (const Error &e) {
    info.note = e.what();
  }
  return info;
}

}  // namespace cama
