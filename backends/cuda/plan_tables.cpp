// SPDX-License-Identifier: Apache-2.0
#include "plan_tables.hpp"

#include <omp.h>

#include <algorithm>
#include <cstring>

namespace cama {
namespace {

constexpr std::size_t alignment = 16, bytes_per_thread = std::size_t(1) << 18;
constexpr int most_threads = 16;

std::size_t aligned(std::size_t bytes) { return (bytes + alignment - 1) / alignment * alignment; }

}  // namespace

PlanTables::PlanTables(const Plan &plan) : plan_(plan), tables_(plan.batches.size())
{
  for (std::size_t b = 0; b < tables_.size(); ++b) place(static_cast<int>(b));
}

void PlanTables::place(int index)
{
  const Plan::Batch &batch = plan_.batches[static_cast<std::size_t>(index)];
  Table &table = tables_[static_cast<std::size_t>(index)];
  const int worlds = plan_.worlds(batch);
  table.offset = bytes_;
  bytes_ = aligned(bytes_ + sizeof(Slot) * static_cast<std::size_t>(batch.what.slots) * static_cast<std::size_t>(worlds));
  if (batch.what.kind == OperationKind::upload) {
    table.data = bytes_;
    for (int w = 0; w < worlds; ++w) bytes_ += aligned(*plan_.slots(batch, w));
  } else if (batch.what.kind == OperationKind::download) {
    table.data = downloaded_;
    for (int w = 0; w < worlds; ++w) downloaded_ += aligned(*plan_.slots(batch, w));
  } else if (batch.what.kind == OperationKind::sort) {
    table.bounds = bytes_;
    bytes_ = aligned(bytes_ + sizeof(int) * static_cast<std::size_t>(worlds + 1));
  }
}

void PlanTables::write(unsigned char *block, unsigned char *device, unsigned char *downloads)
{
  const int batches = static_cast<int>(tables_.size());
  const int threads =
      std::min({most_threads, omp_get_num_procs(), static_cast<int>(bytes_ / bytes_per_thread) + 1});
#pragma omp parallel for schedule(dynamic) num_threads(threads)
  for (int b = 0; b < batches; ++b) write(b, block, device, downloads);
}

void PlanTables::write(int index, unsigned char *block, unsigned char *device, unsigned char *downloads)
{
  const Plan::Batch &batch = plan_.batches[static_cast<std::size_t>(index)];
  Table &table = tables_[static_cast<std::size_t>(index)];
  const int worlds = plan_.worlds(batch);
  const auto count = static_cast<std::size_t>(batch.what.slots);
  auto *row = reinterpret_cast<Slot *>(block + table.offset);
  std::size_t data = table.data;
  int *bound = reinterpret_cast<int *>(block + table.bounds);
  Slot largest = 0;
  for (int w = 0; w < worlds; ++w, row += count) {
    const Slot *slots = plan_.slots(batch, w);
    std::copy_n(slots, count, row);
    largest = std::max(largest, slots[0]);
    if (batch.what.kind == OperationKind::upload) {
      std::memcpy(block + data, from_slot<const void *>(slots[2]), slots[0]);
      row[2] = to_slot(device + data);
      data += aligned(slots[0]);
    } else if (batch.what.kind == OperationKind::download) {
      row[1] = to_slot(downloads + data);
      row[2] = slots[2] + slots[3];   // the address of what is read
      data += aligned(slots[0]);
    } else if (batch.what.kind == OperationKind::sort) {
      *bound++ = table.items;
      table.items += static_cast<int>(slots[0]);
      *bound = table.items;
    }
  }
  table.largest = static_cast<int>(std::min<Slot>(largest, 0x7fffffff));
}

void PlanTables::deliver(const unsigned char *downloaded) const
{
  for (std::size_t b = 0; b < tables_.size(); ++b) {
    const Plan::Batch &batch = plan_.batches[b];
    if (batch.what.kind != OperationKind::download) continue;
    std::size_t data = tables_[b].data;
    for (int w = 0; w < plan_.worlds(batch); ++w) {
      const Slot *slots = plan_.slots(batch, w);
      std::memcpy(from_slot<void *>(slots[1]), downloaded + data, slots[0]);
      data += aligned(slots[0]);
    }
  }
}

}  // namespace cama
