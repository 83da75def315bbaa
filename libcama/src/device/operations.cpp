// SPDX-License-Identifier: Apache-2.0
#include "device/operations.hpp"

#include <algorithm>

namespace cama {
namespace {

void launch(Backend &backend, const Operation &what, const Slot *slots)
{
  Argument arguments[max_kernel_arguments];
  const int count = what.slots - 1;
  for (int i = 0; i < count; ++i) {
    const Slot &slot = slots[i + 1];
    Argument &a = arguments[i];
    a.is_buffer = (what.buffers >> i & 1) != 0;
    if (a.is_buffer) {
      a.buffer = from_slot<Buffer>(slot);
    } else {
      a.scalar = &slot;
      a.size = (what.wide >> i & 1) != 0 ? 8 : 4;
    }
  }
  backend.launch(what.kernel, from_slot<int>(slots[0]), arguments, count);
}

void run_one(Backend &backend, const Operation &what, const Slot *slots)
{
  const auto bytes = static_cast<std::size_t>(slots[0]);
  switch (what.kind) {
  case OperationKind::launch: return launch(backend, what, slots);
  case OperationKind::scan:
    return backend.scan(from_slot<Buffer>(slots[1]), from_slot<Buffer>(slots[2]), from_slot<int>(slots[0]));
  case OperationKind::sort:
    return backend.sort(from_slot<Buffer>(slots[1]), from_slot<Buffer>(slots[2]), from_slot<int>(slots[0]), what.extra);
  case OperationKind::copy: return backend.copy(from_slot<Buffer>(slots[1]), from_slot<Buffer>(slots[2]), bytes);
  case OperationKind::fill: return backend.fill(from_slot<Buffer>(slots[1]), from_slot<unsigned char>(slots[2]), bytes);
  case OperationKind::upload:
    return backend.upload(from_slot<Buffer>(slots[1]), from_slot<const void *>(slots[2]), bytes);
  case OperationKind::download:
    return backend.download(from_slot<void *>(slots[1]), from_slot<Buffer>(slots[2]), bytes, slots[3]);
  case OperationKind::release: return backend.release(from_slot<Buffer>(slots[0]));
  case OperationKind::repeat: return;
  }
}

std::size_t whole(std::size_t bytes) { return (bytes + 15) / 16 * 16; }

}  // namespace

void OperationQueue::add(const Operation &operation, std::initializer_list<Slot> slots)
{
  first_.push_back(slots_.size());
  slots_.insert(slots_.end(), slots);
  operations_.push_back(operation);
  const Slot size = *slots.begin();
  switch (operation.kind) {
  case OperationKind::launch:
    largest_ = std::max(largest_, static_cast<int>(size) * std::max(1, operation.kernel.team));
    break;
  case OperationKind::sort: largest_sort_ = std::max(largest_sort_, static_cast<int>(size)); break;
  case OperationKind::download:
    downloaded_bytes_ += whole(size);
    downloads_.push_back(this->size() - 1);
    break;
  case OperationKind::release: releases_.push_back(this->size() - 1); break;
  default: break;
  }
}

const unsigned char *OperationQueue::keep(const unsigned char *bytes, std::size_t count)
{
  kept_bytes_ += whole(count);
  return kept_.emplace_back(bytes, bytes + count).data();
}

void OperationQueue::deliver()
{
  if (!downloaded) return;
  for (const int i : downloads_) {
    const Slot *own = slots(i);
    std::memcpy(from_slot<void *>(own[1]), downloaded, own[0]);
    downloaded += whole(own[0]);
  }
  downloaded = nullptr;
}

void OperationQueue::clear()
{
  downloaded = nullptr;
  downloads_.clear();
  releases_.clear();
  operations_.clear();
  first_.clear();
  slots_.clear();
  kept_.clear();
  kept_bytes_ = downloaded_bytes_ = 0;
  largest_sort_ = largest_ = 0;
}

namespace {

/// Operations [begin, end).
void run_in_order(Backend &backend, const OperationQueue &queue, int begin, int end)
{
  for (int i = begin; i < end; ++i) {
    const Operation &what = queue.operation(i);
    if (what.kind != OperationKind::repeat) {
      run_one(backend, what, queue.slots(i));
      continue;
    }
    const int body = i + 1;
    i += what.extra;
    backend.repeat(from_slot<int>(*queue.slots(body - 1)), [&] { run_in_order(backend, queue, body, i + 1); });
  }
}

}  // namespace

void run_in_order(Backend &backend, const OperationQueue &queue) { run_in_order(backend, queue, 0, queue.size()); }

}  // namespace cama
