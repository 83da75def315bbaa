// SPDX-License-Identifier: Apache-2.0
#define CAMA_INTERPRETED 1
#include "interpreted_teams.h"

#include "interpreter.hpp"

#include <cub/cub.cuh>

#include <algorithm>
#include <utility>

#include "check.hpp"

namespace cama {
namespace {

constexpr int most_slots = max_kernel_arguments + 8, blocks_per_processor = 2;
// Bytes that the teams of a block share: most that helps, since the rest is a cache, and least, which a sort of
// rank_sort_room keys needs.
constexpr int most_team_memory = 60 * 1024, least_team_memory = 24 * 1024;
constexpr int rank_sort_room = 2048, digit_bits = 4, digits = 1 << digit_bits;
/// An operation of more items than a quarter of the interpreter's threads, for each of the worlds that run at once, is
/// faster launched: one world after the other, but with all threads of the device.
constexpr long long interpreted_part = 4;

// Functions.

template <class P> __device__ P argument(const Slot &slot) { return *reinterpret_cast<const P *>(&slot); }

template <auto function, class... P, std::size_t... I>
__device__ void call(const Slot *slots, void (*)(int, P...), std::index_sequence<I...>)
{
  function(argument<int>(slots[0]), argument<P>(slots[I + 1])...);
}

template <class... P> __host__ __device__ constexpr std::size_t parameter_count(void (*)(int, P...))
{
  return sizeof...(P);
}

template <auto function> __device__ __noinline__ void call_kernel(const Slot *slots)
{
  call<function>(slots, function, std::make_index_sequence<parameter_count(decltype(function)(nullptr))>{});
}

enum Function : int {   // two for each kernel: that of floats, or the only one, and that of doubles
#define CAMA_DOUBLE_KERNEL(name) name##_f32, name##_f64,
#define CAMA_REAL_KERNEL(name) name##_f32, name##_f64,
#include "kernels/kernels.def"
};

__device__ void call_function(int function, const Slot *slots)
{
  switch (function) {
#define CAMA_DOUBLE_KERNEL(name) \
  case name##_f32: return call_kernel<&kernels::name>(slots);
#define CAMA_REAL_KERNEL(name)                                     \
  case name##_f32: return call_kernel<&kernels::f32::name>(slots); \
  case name##_f64: return call_kernel<&kernels::f64::name>(slots);
#include "kernels/kernels.def"
  default: return;
  }
}

// The other operations, by all blocks of a world.

__device__ Slot first_item() { return blockIdx.x * blockDim.x + threadIdx.x; }
__device__ Slot items_at_once() { return gridDim.x * blockDim.x; }

/// bytes, to, from
__device__ __noinline__ void move_bytes(const Slot *slots)
{
  if ((slots[0] | slots[1] | slots[2]) % sizeof(Slot) == 0) {
    const auto *from = reinterpret_cast<const Slot *>(slots[2]);
    auto *to = reinterpret_cast<Slot *>(slots[1]);
    for (Slot i = first_item(); i < slots[0] / sizeof(Slot); i += items_at_once()) to[i] = from[i];
  } else if ((slots[0] | slots[1] | slots[2]) % sizeof(int) == 0) {
    const auto *from = reinterpret_cast<const int *>(slots[2]);
    auto *to = reinterpret_cast<int *>(slots[1]);
    for (Slot i = first_item(); i < slots[0] / sizeof(int); i += items_at_once()) to[i] = from[i];
  } else {
    const auto *from = reinterpret_cast<const unsigned char *>(slots[2]);
    auto *to = reinterpret_cast<unsigned char *>(slots[1]);
    for (Slot i = first_item(); i < slots[0]; i += items_at_once()) to[i] = from[i];
  }
}

/// bytes, buffer, byte; buffers begin at multiples of 8 bytes
__device__ __noinline__ void fill_bytes(const Slot *slots)
{
  const Slot words = slots[0] / sizeof(Slot), byte = slots[2] & 0xff;
  for (Slot i = first_item(); i < words; i += items_at_once())
    reinterpret_cast<Slot *>(slots[1])[i] = byte * 0x0101010101010101ull;
  for (Slot i = words * sizeof(Slot) + first_item(); i < slots[0]; i += items_at_once())
    reinterpret_cast<unsigned char *>(slots[1])[i] = static_cast<unsigned char>(byte);
}

__shared__ unsigned int expected;  // arrivals that end a wait of the first thread

/// Where the blocks of a world wait for each other.
struct Meeting {
  unsigned int *arrived;
  __device__ void wait() const
  {
    __syncthreads();
    if (gridDim.x == 1) return;
    if (threadIdx.x == 0) {
      expected += gridDim.x;
      __threadfence();
      atomicAdd(arrived, 1);
      while (*reinterpret_cast<volatile unsigned int *>(arrived) < expected) {
      }
      __threadfence();
    }
    __syncthreads();
  }
  /// Whether this thread is the last of the first threads of all blocks to call it, after all have waited. The next
  /// program begins with zeros again.
  __device__ bool end() const
  {
    if (threadIdx.x > 0) return false;
    if (gridDim.x == 1) return true;
    if (atomicAdd(arrived + 1, 1) < gridDim.x - 1) return false;
    arrived[0] = arrived[1] = 0;
    return true;
  }
};

/// n, from, to. partial: [blocks of the world]
__device__ __noinline__ void scan_ints(const Slot *slots, Meeting meeting, long long *partial, int *overflow)
{
  using Reduce = cub::BlockReduce<long long, interpreter_threads>;
  using Scan = cub::BlockScan<long long, interpreter_threads>;
  constexpr int items = 4, tile = items * interpreter_threads;
  __shared__ union {
    typename Reduce::TempStorage reduce;
    typename Scan::TempStorage scan;
  } storage;
  __shared__ long long before_all;
  const int n = static_cast<int>(slots[0]), blocks = static_cast<int>(gridDim.x), block = static_cast<int>(blockIdx.x);
  const auto *from = reinterpret_cast<const int *>(slots[1]);
  auto *to = reinterpret_cast<int *>(slots[2]);
  const int chunk = ((n - 1) / blocks / tile + 1) * tile;
  const int begin = static_cast<int>(min(static_cast<long long>(block) * chunk, static_cast<long long>(n)));
  const int end = min(begin + chunk, n);
  if (threadIdx.x == 0) before_all = 0;
  if (blocks > 1) {
    long long sum = 0;
    for (int i = begin + static_cast<int>(threadIdx.x); i < end; i += interpreter_threads) sum += from[i];
    sum = Reduce(storage.reduce).Sum(sum);
    if (threadIdx.x == 0) partial[block] = sum;
    meeting.wait();
    sum = 0;
    for (int b = static_cast<int>(threadIdx.x); b < block; b += interpreter_threads) sum += partial[b];
    sum = Reduce(storage.reduce).Sum(sum);
    if (threadIdx.x == 0) before_all = sum;
  }
  __syncthreads();
  long long before = before_all;
  for (int tile_begin = begin; tile_begin < end; tile_begin += tile) {
    long long value[items], total;
    const int first = tile_begin + static_cast<int>(threadIdx.x) * items;
    for (int k = 0; k < items; ++k) value[k] = first + k < end ? from[first + k] : 0;
    Scan(storage.scan).ExclusiveSum(value, value, total);
    for (int k = 0; k < items; ++k)
      if (first + k < end) to[first + k] = static_cast<int>(before + value[k]);
    before += total;
    __syncthreads();
  }
  if (threadIdx.x > 0 || (end < n || (begin == n && block > 0))) return;
  to[n] = static_cast<int>(before);
  if (before > 0x7fffffffll) *overflow = 1;
}

/// Up to rank_sort_room keys: the place of each is the number of those before it.
__device__ void sort_by_rank(int n, key64 *key, int *value, key64 mask)
{
  auto *keys = reinterpret_cast<key64 *>(all_team_memory);
  auto *values = reinterpret_cast<int *>(keys + rank_sort_room);
  for (int i = static_cast<int>(threadIdx.x); i < n; i += interpreter_threads) {
    keys[i] = key[i];
    values[i] = value[i];
  }
  __syncthreads();
  for (int i = static_cast<int>(threadIdx.x); i < n; i += interpreter_threads) {
    const key64 own = keys[i] & mask;
    int place = 0;
    for (int j = 0; j < n; ++j) {
      const key64 other = keys[j] & mask;
      place += other < own || (other == own && j < i);
    }
    key[place] = keys[i];
    value[place] = values[i];
  }
}

/// Digit by digit: each thread counts and moves a run of keys.
__device__ void sort_by_digits(int n, key64 *key, int *value, key64 *other_key, int *other_value, int bits)
{
  using Scan = cub::BlockScan<int, interpreter_threads>;
  __shared__ typename Scan::TempStorage storage;
  auto *counts = reinterpret_cast<int *>(all_team_memory);   // [digits][threads]
  const int thread = static_cast<int>(threadIdx.x), run = (n - 1) / interpreter_threads + 1;
  const int begin = min(thread * run, n), end = min(begin + run, n);
  key64 *const result = key;
  int *const result_value = value;
  for (int shift = 0; shift < bits; shift += digit_bits) {
    const key64 mask = (key64(1) << min(digit_bits, bits - shift)) - 1;
    for (int d = 0; d < digits; ++d) counts[d * interpreter_threads + thread] = 0;
    for (int i = begin; i < end; ++i) ++counts[static_cast<int>(key[i] >> shift & mask) * interpreter_threads + thread];
    __syncthreads();
    int own[digits];
    for (int k = 0; k < digits; ++k) own[k] = counts[thread * digits + k];
    Scan(storage).ExclusiveSum(own, own);
    for (int k = 0; k < digits; ++k) counts[thread * digits + k] = own[k];
    __syncthreads();
    for (int i = begin; i < end; ++i) {
      const int place = counts[static_cast<int>(key[i] >> shift & mask) * interpreter_threads + thread]++;
      other_key[place] = key[i];
      other_value[place] = value[i];
    }
    __syncthreads();
    key64 *const keys = key;
    int *const values = value;
    key = other_key;
    value = other_value;
    other_key = keys;
    other_value = values;
  }
  if (key == result) return;
  for (int i = thread; i < n; i += interpreter_threads) {
    result[i] = key[i];
    result_value[i] = value[i];
  }
}

/// n, keys, values, room for as many of both. By one block.
__device__ __noinline__ void sort_pairs(const Slot *slots, int bits)
{
  const int n = static_cast<int>(slots[0]);
  auto *key = reinterpret_cast<key64 *>(slots[1]);
  auto *value = reinterpret_cast<int *>(slots[2]);
  if (n <= rank_sort_room) return sort_by_rank(n, key, value, bits >= 64 ? ~key64(0) : (key64(1) << bits) - 1);
  auto *room = reinterpret_cast<key64 *>(slots[3]);
  sort_by_digits(n, key, value, room, reinterpret_cast<int *>(room + n), bits);
}

/// Walks through the instructions of a world, and through those of a repetition as often as it says.
struct Walk {
  int place, left, body, body_end;
  __device__ void begin()
  {
    place = left = body = 0;
    body_end = -1;
  }
  /// Behind the instruction, which is the one at `place`.
  __device__ void leave(const Instruction &instruction)
  {
    ++place;
    if (instruction.kind == static_cast<int>(OperationKind::repeat)) {
      left = instruction.first;
      body = place;
      body_end = place + instruction.extra;
    } else if (place == body_end) {
      if (--left > 0)
        place = body;
      else
        body_end = -1;
    }
  }
};

/// Copies to the memory of the block meanwhile; the thread sees it after await_copies, others after a barrier.
template <class T> __device__ void start_copy(T *to, const T *from)
{
  static_assert((sizeof(T) == 8 || sizeof(T) == 16) && alignof(T) == sizeof(T), "what cp.async copies");
#if __CUDA_ARCH__ >= 800
  asm volatile(
      "cp.async.ca.shared.global [%0], [%1], %2;" ::"r"(static_cast<unsigned int>(__cvta_generic_to_shared(to))),
      "l"(from), "n"(sizeof(T))
      : "memory");
#else
  *to = *from;
#endif
}
__device__ void await_copies()
{
#if __CUDA_ARCH__ >= 800
  asm volatile("cp.async.wait_all;" ::: "memory");
#endif
}

/// Of the warp, whose threads have left the kernel before.
__device__ void set_team(const Instruction &instruction)
{
  __syncwarp();
  if (threadIdx.x % 32 == 0) {
    team_shifts[threadIdx.x / 32] = instruction.team_shift;
    used_memory[threadIdx.x / 32] = 0;
  }
  __syncwarp();
}

__device__ void execute(const Instruction &instruction, const Slot *slots, Meeting meeting, long long *partial,
                        int *overflow)
{
  switch (static_cast<OperationKind>(instruction.kind)) {
  case OperationKind::launch: return call_function(instruction.function, slots);
  case OperationKind::scan: return scan_ints(slots, meeting, partial, overflow);
  case OperationKind::sort:
    if (blockIdx.x == 0) sort_pairs(slots, instruction.extra);
    return;
  case OperationKind::copy:
  case OperationKind::upload:
  case OperationKind::download: return move_bytes(slots);
  case OperationKind::fill: return fill_bytes(slots);
  default: return;   // what the host does, and repetitions
  }
}

/// The programs of worlds, in blocks (x, world). While one instruction runs, the slots of the next and the instruction
/// after it are on their way. What a thread remembers meanwhile is in the memory of its block: the kernels leave no
/// registers.
__global__ void __launch_bounds__(interpreter_threads, blocks_per_processor)
    interpret(const __grid_constant__ Batch batch)
{
  constexpr unsigned int kept = 4;
  __shared__ Slot slots[2][most_slots];
  __shared__ Instruction instructions[kept];
  __shared__ Walk walk;  // of the last thread, to the instruction after the next
  __shared__ unsigned int is_last[kept];
  __shared__ unsigned int turns[interpreter_threads / 32];  // of each warp: instructions before the one that runs
  const WorldProgram &program = batch.world[blockIdx.y];
  const auto thread = [] { return static_cast<int>(threadIdx.x); };
  const auto own_turn = []() -> volatile unsigned int & { return turns[threadIdx.x / 32]; };
  const auto all_instructions = [&] { return reinterpret_cast<const Instruction *>(program.to); };
  const auto fetch_slots = [&](unsigned int turn) {
    const Instruction &of = instructions[turn % kept];
    const Slot *from = reinterpret_cast<const Slot *>(program.to + program.slots) + of.first;
    if (thread() < of.slots) start_copy(slots[turn % 2] + thread(), from + thread());
  };
  const Meeting meeting{program.arrived};
  {
    const uint4 *__restrict__ from = program.from;
    uint4 *__restrict__ to = program.to;
    for (int i = static_cast<int>(first_item()); i < program.words; i += static_cast<int>(items_at_once()))
      to[i] = from[i];
  }
  if (thread() == 0) expected = 0;
  if (thread() % 32 == 0) own_turn() = 0;
  meeting.wait();
  if (thread() < 2) instructions[thread()] = all_instructions()[min(thread(), program.count - 1)];
  __syncthreads();
  fetch_slots(0);
  set_team(instructions[0]);
  if (thread() == interpreter_threads - 1) {
    walk.begin();
    walk.leave(instructions[0]);
    is_last[0] = walk.place >= program.count;
  }
  await_copies();
  __syncthreads();
  while (true) {
    {
      const unsigned int turn = own_turn();
      if (!is_last[turn % kept]) {
        fetch_slots(turn + 1);
        if (thread() == interpreter_threads - 1) {
          walk.leave(instructions[(turn + 1) % kept]);
          is_last[(turn + 1) % kept] = walk.place >= program.count;
          if (walk.place < program.count) start_copy(instructions + (turn + 2) % kept, all_instructions() + walk.place);
        }
      }
      execute(instructions[turn % kept], slots[turn % 2], meeting, program.partials, program.overflow);
    }
    const unsigned int turn = own_turn();
    if (is_last[turn % kept]) break;
    await_copies();
    if (instructions[(turn + 1) % kept].team_shift > 0) set_team(instructions[(turn + 1) % kept]);
    __syncwarp();
    if (thread() % 32 == 0) own_turn() = turn + 1;
    if (instructions[turn % kept].kind == static_cast<int>(OperationKind::repeat))
      __syncthreads();
    else
      meeting.wait();
  }
  meeting.wait();
  if (!meeting.end()) return;
  __threadfence_system();  // for what all threads have written: this one has waited for them
  *static_cast<volatile unsigned int *>(program.done) = program.number;
}

}  // namespace

Interpreter::Interpreter(int device, int (*team_bytes)(const KernelKey &)) : team_bytes_(team_bytes)
{
  const auto attribute = [device](cudaDeviceAttr which) {
    int value = 0;
    check(cudaDeviceGetAttribute(&value, which, device), "cudaDeviceGetAttribute");
    return value;
  };
  cudaFuncAttributes own;
  check(cudaFuncGetAttributes(&own, interpret), "cudaFuncGetAttributes");
  const int reserved = static_cast<int>(own.sharedSizeBytes) + attribute(cudaDevAttrReservedSharedMemoryPerBlock);
  const int room = std::min(attribute(cudaDevAttrMaxSharedMemoryPerMultiprocessor) / blocks_per_processor,
                            attribute(cudaDevAttrMaxSharedMemoryPerBlockOptin));
  memory_ = std::min(most_team_memory, (room - reserved) / 1024 * 1024);
  if (memory_ < least_team_memory || !attribute(cudaDevAttrCooperativeLaunch)) return;
  check(cudaFuncSetAttribute(interpret, cudaFuncAttributeMaxDynamicSharedMemorySize, memory_), "cudaFuncSetAttribute");
  int per_processor = 0;
  check(cudaOccupancyMaxActiveBlocksPerMultiprocessor(&per_processor, interpret, interpreter_threads,
                                                      static_cast<std::size_t>(memory_)),
        "cudaOccupancy");
  together_ = attribute(cudaDevAttrMultiProcessorCount) * per_processor;
}

int Interpreter::place(const KernelKey &kernel) const
{
  return 2 * kernel.index + (kernel.precision == KernelPrecision::f64);
}

int Interpreter::team_shift(const KernelKey &kernel, int teams) const
{
  constexpr int smallest = 5, largest = 8;  // a warp, a block
  static_assert(1 << largest == interpreter_threads);
  int shift = smallest;
  while (shift < largest && 1 << shift < kernel.team) ++shift;
  constexpr int padding = 64;  // bytes
  const int most = memory_ / (team_bytes_(kernel) + padding);  // at once
  const auto at_once = [&] { return interpreter_threads >> shift; };
  while (shift < largest && at_once() > most) ++shift;
  while (shift > smallest && at_once() < teams && 2 * at_once() <= most) --shift;
  return shift;
}

int Interpreter::blocks_for(const OperationQueue &queue, int worlds) const
{
  return std::clamp((queue.largest() - 1) / interpreter_threads + 1, 1, std::max(1, together_ / worlds));
}

bool Interpreter::suits(const OperationQueue &queue, int worlds) const
{
  return interpreted_part * queue.largest() <= static_cast<long long>(together_) * interpreter_threads * worlds;
}

void Interpreter::launch(const Batch &batch, int worlds, int blocks, cudaStream_t stream) const
{
  const dim3 grid(static_cast<unsigned int>(blocks), static_cast<unsigned int>(worlds));
  void *arguments[] = {const_cast<Batch *>(&batch)};
  const auto *kernel = reinterpret_cast<const void *>(&interpret);
  const auto bytes = static_cast<std::size_t>(memory_);
  // Blocks that wait for each other run at once, whatever else is on the device.
  check(blocks > 1 ? cudaLaunchCooperativeKernel(kernel, grid, dim3(interpreter_threads), arguments, bytes, stream)
                   : cudaLaunchKernel(kernel, grid, dim3(interpreter_threads), arguments, bytes, stream),
        "recorded operations");
}

}  // namespace cama
