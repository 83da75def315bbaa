// SPDX-License-Identifier: Apache-2.0
#include "program.hpp"

#include <algorithm>
#include <cstring>

#include "check.hpp"
#include "interpreter.hpp"

namespace cama {
namespace {

constexpr std::size_t alignment = 16, scratch_per_key = 12;
constexpr std::size_t host_header = 64;  // bytes: number of the last program that has ended, overflow
constexpr std::size_t overflow_at = 4, arrived_bytes = 16, least_room = std::size_t(1) << 16;

std::size_t aligned(std::size_t bytes) { return (bytes + alignment - 1) / alignment * alignment; }

}  // namespace

ProgramRoom::~ProgramRoom()
{
  if (device_) cudaFreeAsync(device_, queue_);
  if (host_) cudaFreeHost(host_);
}

void ProgramRoom::grow(std::size_t host_bytes, std::size_t device_bytes)
{
  void *memory = nullptr;
  if (host_bytes > host_bytes_) {
    const std::size_t room = std::max(host_bytes + host_bytes / 2, least_room);
    check(cudaHostAlloc(&memory, room, cudaHostAllocMapped), "cudaHostAlloc for a world");
    if (host_) cudaFreeHost(host_);
    host_ = static_cast<unsigned char *>(memory);
    host_bytes_ = room;
    std::memset(host_, 0, host_header);
    std::memcpy(host_, &number_, sizeof number_);
  }
  if (device_bytes > device_bytes_) {
    const std::size_t room = std::max(device_bytes + device_bytes / 2, least_room);
    check(cudaMallocAsync(&memory, room, queue_), "cudaMallocAsync for a world");
    if (device_) cudaFreeAsync(device_, queue_);
    device_ = static_cast<unsigned char *>(memory);
    device_bytes_ = room;
    check(cudaMemsetAsync(device_, 0, arrived_bytes, queue_), "cudaMemset");
    grown_ = true;
  }
}

bool ProgramRoom::ended() const
{
  const unsigned int done = __atomic_load_n(reinterpret_cast<const unsigned int *>(host_), __ATOMIC_ACQUIRE);
  return done == number_;
}

bool ProgramRoom::take_overflow()
{
  int overflow = 0;
  std::memcpy(&overflow, host_ + overflow_at, sizeof overflow);
  if (overflow) std::memset(host_ + overflow_at, 0, sizeof overflow);
  return overflow != 0;
}

WorldProgram ProgramRoom::write(const OperationQueue &queue, int blocks, const Interpreter &interpreter)
{
  const int count = queue.size();
  const std::size_t slots_at = aligned(sizeof(Instruction) * static_cast<std::size_t>(count)),
                    data_at = slots_at + aligned(sizeof(Slot) * queue.slot_count()),
                    bytes = data_at + queue.kept_bytes(),
                    scratch_at = arrived_bytes + aligned(sizeof(long long) * static_cast<std::size_t>(blocks)),
                    program_at = scratch_at + aligned(scratch_per_key * static_cast<std::size_t>(queue.largest_sort()));
  grow(host_header + bytes + queue.downloaded_bytes(), program_at + bytes);
  downloads_ = host_header + bytes;
  unsigned char *host = host_ + host_header, *device = device_ + program_at;
  auto *instruction = reinterpret_cast<Instruction *>(host);
  auto *slots = reinterpret_cast<Slot *>(host + slots_at);
  std::copy_n(queue.slots(0), queue.slot_count(), slots);
  std::size_t data = data_at, down = downloads_;
  for (int i = 0; i < count; ++i, ++instruction) {
    const Operation &o = queue.operation(i);
    const auto first = static_cast<int>(queue.slots(i) - queue.slots(0));
    Slot *own = slots + first;
    *instruction = {static_cast<std::uint8_t>(o.kind), 0, 0, first, o.slots, o.extra};
    if (o.kind == OperationKind::launch) {
      instruction->function = static_cast<std::uint16_t>(interpreter.place(o.kernel));
      if (o.kernel.team > 0)
        instruction->team_shift =
            static_cast<std::uint8_t>(interpreter.team_shift(o.kernel, (from_slot<int>(own[0]) - 1) / blocks + 1));
    }
    switch (o.kind) {
    case OperationKind::repeat:
      instruction->first = from_slot<int>(own[0]);
      instruction->slots = 0;
      break;
    case OperationKind::upload:
      std::memcpy(host + data, from_slot<const void *>(own[2]), own[0]);
      own[2] = to_slot(device + data);
      data += aligned(own[0]);
      break;
    case OperationKind::download:
      own[1] = to_slot(host_ + down);
      own[2] += own[3];   // the address of what is read
      down += aligned(own[0]);
      break;
    case OperationKind::sort: own[3] = to_slot(device_ + scratch_at); break;
    default: break;
    }
  }
  ++number_;
  return {reinterpret_cast<const uint4 *>(host),      reinterpret_cast<uint4 *>(device),
          static_cast<int>(bytes / sizeof(uint4)),    count,
          static_cast<int>(slots_at / sizeof(uint4)), number_,
          reinterpret_cast<unsigned int *>(host_),    reinterpret_cast<int *>(host_ + overflow_at),
          reinterpret_cast<unsigned int *>(device_),  reinterpret_cast<long long *>(device_ + arrived_bytes)};
}

}  // namespace cama
