// SPDX-License-Identifier: Apache-2.0
#include "plan_runner.hpp"

#include <cub/cub.cuh>

#include <algorithm>
#include <utility>

#include "batched_kernels.hpp"
#include "cama/error.hpp"
#include "check.hpp"
#include "kernels/dialect/lang.h"

namespace cama {
namespace {

constexpr int threads_per_block = 256, most_rows = 65535;

/// Slots of a world: bytes, to, from.
__global__ void move_bytes(const Slot *table, int stride)
{
  const Slot *slots = table + static_cast<std::size_t>(blockIdx.y) * stride;
  const Slot first = blockIdx.x * blockDim.x + threadIdx.x, step = gridDim.x * blockDim.x;
  if ((slots[0] | slots[1] | slots[2]) % sizeof(Slot) == 0) {
    const auto *from = reinterpret_cast<const Slot *>(slots[2]);
    auto *to = reinterpret_cast<Slot *>(slots[1]);
    for (Slot i = first; i < slots[0] / sizeof(Slot); i += step) to[i] = from[i];
  } else {
    const auto *from = reinterpret_cast<const unsigned char *>(slots[2]);
    auto *to = reinterpret_cast<unsigned char *>(slots[1]);
    for (Slot i = first; i < slots[0]; i += step) to[i] = from[i];
  }
}

/// Slots of a world: bytes, buffer, byte. Buffers begin at multiples of 8 bytes.
__global__ void fill_bytes(const Slot *table, int stride)
{
  const Slot *slots = table + static_cast<std::size_t>(blockIdx.y) * stride;
  const Slot first = blockIdx.x * blockDim.x + threadIdx.x, step = gridDim.x * blockDim.x;
  const Slot words = slots[0] / sizeof(Slot);
  const Slot byte = slots[2] & 0xff;
  for (Slot i = first; i < words; i += step) reinterpret_cast<Slot *>(slots[1])[i] = byte * 0x0101010101010101ull;
  for (Slot i = words * sizeof(Slot) + first; i < slots[0]; i += step)
    reinterpret_cast<unsigned char *>(slots[1])[i] = static_cast<unsigned char>(byte);
}

/// Slots of a world: n, from, to. A world is one block.
__global__ void __launch_bounds__(threads_per_block) scan_ints(const Slot *table, int stride, int *overflow)
{
  using Scan = cub::BlockScan<long long, threads_per_block>;
  __shared__ typename Scan::TempStorage storage;
  const Slot *slots = table + static_cast<std::size_t>(blockIdx.x) * stride;
  const int n = static_cast<int>(slots[0]);
  const auto *from = reinterpret_cast<const int *>(slots[1]);
  auto *to = reinterpret_cast<int *>(slots[2]);
  long long before = 0;
  for (int begin = 0; begin < n; begin += threads_per_block) {
    const int i = begin + static_cast<int>(threadIdx.x);
    const long long value = i < n ? from[i] : 0;
    long long sum, total;
    Scan(storage).ExclusiveSum(value, sum, total);
    if (i < n) to[i] = static_cast<int>(before + sum);
    before += total;
    __syncthreads();
  }
  if (threadIdx.x > 0) return;
  to[n] = static_cast<int>(before);
  if (before > 0x7fffffffll) *overflow = 1;
}

/// Slots of a world: n, keys, values. Copies keys and values of all worlds to or from one array of each.
template <bool gather>
__global__ void move_pairs(const Slot *table, int stride, const int *bounds, key64 *all_keys, int *all_values)
{
  const Slot *slots = table + static_cast<std::size_t>(blockIdx.y) * stride;
  const int n = static_cast<int>(slots[0]), first = bounds[blockIdx.y];
  auto *keys = reinterpret_cast<key64 *>(slots[1]);
  auto *values = reinterpret_cast<int *>(slots[2]);
  for (int i = static_cast<int>(blockIdx.x * blockDim.x + threadIdx.x); i < n;
       i += static_cast<int>(gridDim.x * blockDim.x)) {
    if (gather) {
      all_keys[first + i] = keys[i];
      all_values[first + i] = values[i];
    } else {
      keys[i] = all_keys[first + i];
      values[i] = all_values[first + i];
    }
  }
}

int blocks_for(int n, int most) { return std::clamp((n - 1) / threads_per_block + 1, 1, most); }

}  // namespace

GrowingMemory::~GrowingMemory() { on_host_ ? cudaFreeHost(memory_) : cudaFree(memory_); }

unsigned char *GrowingMemory::get(std::size_t bytes)
{
  if (bytes <= bytes_) return memory_;
  on_host_ ? cudaFreeHost(memory_) : cudaFree(memory_);   // both wait for the device
  memory_ = nullptr;
  bytes_ = 0;
  void *memory = nullptr;
  const std::size_t room = bytes + bytes / 2;
  check(on_host_ ? cudaMallocHost(&memory, room) : cudaMalloc(&memory, room), "memory for the tables of worlds");
  memory_ = static_cast<unsigned char *>(memory);
  bytes_ = room;
  return memory_;
}

PlanRunner::PlanRunner(cudaStream_t queue, int most_blocks, int *overflow)
    : queue_(queue), most_blocks_(most_blocks), overflow_(overflow)
{
  check(cudaEventCreateWithFlags(&copied_, cudaEventDisableTiming), "cudaEventCreate");
}

PlanRunner::~PlanRunner() { cudaEventDestroy(copied_); }

void PlanRunner::prepare(PlanTables &tables)
{
  check(cudaEventSynchronize(copied_), "cudaEventSynchronize");
  unsigned char *block = block_.get(tables.bytes()), *device = device_.get(tables.bytes());
  tables.write(block, device, gathered_.get(tables.downloaded_bytes()));
  if (tables.bytes() > 0)
    check(cudaMemcpyAsync(device, block, tables.bytes(), cudaMemcpyHostToDevice, queue_), "cudaMemcpy to the device");
  check(cudaEventRecord(copied_, queue_), "cudaEventRecord");
}

/// Returns the number of launches.
int PlanRunner::launch(const Operation &what, const PlanTables::Table &table, int worlds)
{
  const auto *all = reinterpret_cast<const Slot *>(device_.get(0) + table.offset);
  if (what.kind == OperationKind::sort) {
    sort(what, table, all, worlds);
    return 3;
  }
  int launches = 0;
  for (int first = 0; first < worlds; first += most_rows, ++launches) {
    const auto rows = static_cast<unsigned int>(std::min(worlds - first, most_rows));
    const Slot *slots = all + static_cast<std::size_t>(first) * static_cast<std::size_t>(what.slots);
    const dim3 grid(static_cast<unsigned int>(blocks_for(table.largest / 8 + 1, most_blocks_)), rows);
    switch (what.kind) {
    case OperationKind::launch: launch_kernel(what, table, slots, static_cast<int>(rows)); continue;
    case OperationKind::scan:
      scan_ints<<<rows, threads_per_block, 0, queue_>>>(slots, what.slots, overflow_);
      break;
    case OperationKind::copy:
    case OperationKind::upload:
    case OperationKind::download: move_bytes<<<grid, threads_per_block, 0, queue_>>>(slots, what.slots); break;
    case OperationKind::fill: fill_bytes<<<grid, threads_per_block, 0, queue_>>>(slots, what.slots); break;
    default: break;
    }
    check(cudaGetLastError(), "an operation of several worlds");
  }
  return launches;
}

void PlanRunner::launch_kernel(const Operation &what, const PlanTables::Table &table, const Slot *slots, int rows)
{
  const int n = table.largest, team = what.kernel.team;
  const int blocks = team > 0 ? n : blocks_for(n, most_blocks_);
  const int threads = team > 0 ? team : n < threads_per_block ? (n + 31) / 32 * 32 : threads_per_block;
  int stride = what.slots;
  void *parameters[] = {&slots, &stride};
  check(cudaLaunchKernel(batched_kernel(what.kernel),
                         dim3(static_cast<unsigned int>(blocks), static_cast<unsigned int>(rows)),
                         dim3(static_cast<unsigned int>(threads)), parameters, 0, queue_),
        what.kernel.name);
}

void PlanRunner::sort(const Operation &what, const PlanTables::Table &table, const Slot *slots, int worlds)
{
  const auto *bounds = reinterpret_cast<const int *>(device_.get(0) + table.bounds);
  const auto items = static_cast<std::size_t>(table.items);
  unsigned char *memory = sorted_.get(2 * items * (sizeof(key64) + sizeof(int)));
  auto *keys = reinterpret_cast<key64 *>(memory), *other_keys = keys + items;
  auto *values = reinterpret_cast<int *>(other_keys + items), *other_values = values + items;
  const unsigned int blocks = static_cast<unsigned int>(blocks_for(table.largest, most_blocks_));
  const auto move = [&](auto kernel, key64 *all_keys, int *all_values) {
    for (int first = 0; first < worlds; first += most_rows) {
      const auto rows = static_cast<unsigned int>(std::min(worlds - first, most_rows));
      kernel<<<dim3(blocks, rows), threads_per_block, 0, queue_>>>(
          slots + static_cast<std::size_t>(first) * static_cast<std::size_t>(what.slots), what.slots, bounds + first,
          all_keys, all_values);
      check(cudaGetLastError(), "sort of several worlds");
    }
  };
  move(move_pairs<true>, keys, values);
  const auto sort_pairs = [&](void *scratch, std::size_t &bytes) {
    return cub::DeviceSegmentedRadixSort::SortPairs(scratch, bytes, keys, other_keys, values, other_values, table.items,
                                                    worlds, bounds, bounds + 1, 0, what.extra, queue_);
  };
  std::size_t bytes = 0;
  check(sort_pairs(nullptr, bytes), "sort of several worlds");
  void *scratch = scratch_.get(bytes);
  check(sort_pairs(scratch, bytes), "sort of several worlds");
  move(move_pairs<false>, other_keys, other_values);
}

bool PlanRunner::finish(const PlanTables &tables)
{
  const std::size_t bytes = tables.downloaded_bytes();
  if (bytes == 0) return false;
  unsigned char *downloaded = downloaded_.get(bytes);
  check(cudaMemcpyAsync(downloaded, gathered_.get(0), bytes, cudaMemcpyDeviceToHost, queue_), "cudaMemcpy to the host");
  check(cudaStreamSynchronize(queue_), "synchronize");
  tables.deliver(downloaded);
  return true;
}

}  // namespace cama
