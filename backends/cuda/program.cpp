// SPDX-License-Identifier: Apache-2.0
#include "program.hpp"

#include <algorithm>
#include <cstring>

namespace cama {
namespace {

constexpr int largest_team_shift = 7;   // members of a team that the interpreter has at most: 128
constexpr std::size_t alignment = 16, scratch_per_key = 12;

std::size_t aligned(std::size_t bytes) { return (bytes + alignment - 1) / alignment * alignment; }

std::uint8_t shift_of(int team)
{
  std::uint8_t shift = 0;
  while (1 << shift < team && shift < largest_team_shift) ++shift;
  return shift;
}

}  // namespace

Programs::Programs(const std::vector<OperationQueue *> &queues, int (*function_of)(const KernelKey &))
    : queues_(queues), function_of_(function_of), places_(queues.size())
{
  bytes_ = aligned(sizeof(WorldProgram) * queues.size());
  for (std::size_t w = 0; w < queues.size(); ++w) {
    const OperationQueue &queue = *queues[w];
    Place &place = places_[w];
    place.instructions = bytes_;
    bytes_ += aligned(sizeof(Instruction) * static_cast<std::size_t>(queue.size())) +
              aligned(sizeof(Slot) * static_cast<std::size_t>(queue.slot_count()));
    place.data = bytes_;
    place.downloads = downloaded_;
    place.scratch = scratch_;
    bytes_ += queue.kept_bytes();
    scratch_ += aligned(scratch_per_key * static_cast<std::size_t>(queue.largest_sort()));
    if (const std::size_t downloaded = queue.downloaded_bytes(); downloaded > 0) {
      waits_ = true;
      downloaded_ += aligned(downloaded);
    }
  }
}

void Programs::write(Crew &crew, unsigned char *block, unsigned char *device, unsigned char *downloads,
                     unsigned char *scratch) const
{
  crew.run([&](int member) {
    const std::size_t worlds = queues_.size(), members = static_cast<std::size_t>(crew.size());
    const auto m = static_cast<std::size_t>(member);
    for (std::size_t w = worlds * m / members; w < worlds * (m + 1) / members; ++w)
      write(w, block, device, downloads, scratch);
  });
}

void Programs::answer(const unsigned char *downloads) const
{
  for (std::size_t w = 0; w < queues_.size(); ++w) queues_[w]->downloaded = downloads + places_[w].downloads;
}

void Programs::write(std::size_t world, unsigned char *block, unsigned char *device, unsigned char *downloads,
                     unsigned char *scratch) const
{
  const OperationQueue &queue = *queues_[world];
  const Place &place = places_[world];
  const int count = queue.size();
  const std::size_t slots_at = place.instructions + aligned(sizeof(Instruction) * static_cast<std::size_t>(count));
  WorldProgram &program = reinterpret_cast<WorldProgram *>(block)[world];
  program.instructions = reinterpret_cast<const Instruction *>(device + place.instructions);
  program.slots = reinterpret_cast<const Slot *>(device + slots_at);
  program.count = count;
  auto *instruction = reinterpret_cast<Instruction *>(block + place.instructions);
  auto *slots = reinterpret_cast<Slot *>(block + slots_at);
  std::copy_n(queue.slots(0), queue.slot_count(), slots);
  std::size_t data = place.data;
  std::size_t down = place.downloads;
  for (int i = 0; i < count; ++i, ++instruction) {
    const Operation &o = queue.operation(i);
    const auto first = static_cast<int>(queue.slots(i) - queue.slots(0));
    const bool launch = o.kind == OperationKind::launch;
    *instruction = {static_cast<std::uint8_t>(o.kind),
                    shift_of(o.kernel.team),
                    static_cast<std::uint16_t>(launch ? function_of_(o.kernel) : 0),
                    first,
                    o.slots,
                    o.extra};
    Slot *own = slots + first;
    switch (o.kind) {
    case OperationKind::repeat:
      instruction->first = from_slot<int>(own[0]);
      instruction->slots = 0;
      break;
    case OperationKind::upload:
      std::memcpy(block + data, from_slot<const void *>(own[2]), own[0]);
      own[2] = to_slot(device + data);
      data += aligned(own[0]);
      break;
    case OperationKind::download:
      own[1] = to_slot(downloads + down);
      own[2] += own[3];   // the address of what is read
      down += aligned(own[0]);
      break;
    case OperationKind::sort: own[3] = to_slot(scratch + place.scratch); break;
    default: break;
    }
  }
}

}  // namespace cama
