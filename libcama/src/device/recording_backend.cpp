// SPDX-License-Identifier: Apache-2.0
#include "device/recording_backend.hpp"

#include <algorithm>
#include <cstring>
#include <utility>


namespace cama {
namespace {

// Buffers that a world keeps for its next allocations, since the device serves all worlds one after the other: their
// number, and which part of its memory they may take.
constexpr std::size_t most_spare = 64, spare_part = 8;

/// Few sizes, so that buffers fit again: a multiple of an eighth of the largest power of two below.
std::size_t room_for(std::size_t bytes)
{
  std::size_t unit = 64;
  while (16 * unit <= bytes) unit *= 2;
  return std::max<std::size_t>((bytes + unit - 1) / unit, 1) * unit;
}

bool before(const std::pair<Buffer, std::size_t> &entry, Buffer buffer)
{
  return std::less<Buffer>{}(entry.first, buffer);
}

}  // namespace

RecordingBackend::~RecordingBackend()
{
  queue.room.reset();
  try {
    for (const auto &spare : spare_) record(OperationKind::release, {to_slot(spare.second)});
    run_alone();
  } catch (...) {  // the device is lost
  }
}

Buffer RecordingBackend::allocate(std::size_t bytes)
{
  const std::size_t room = room_for(bytes);
  Buffer buffer = nullptr;
  const auto spare = std::find_if(spare_.rbegin(), spare_.rend(), [&](const auto &s) { return s.first == room; });
  if (spare != spare_.rend()) {
    buffer = spare->second;
    *spare = spare_.back();
    spare_.pop_back();
    spare_bytes_ -= room;
  } else {
    const std::lock_guard<std::mutex> lock(device_->mutex);
    buffer = device_->backend->allocate(room);
    allocated_ += room;
    peak_ = std::max(peak_, allocated_);
    allocated = true;
  }
  sizes_.insert(std::lower_bound(sizes_.begin(), sizes_.end(), buffer, before), {buffer, room});
  return buffer;
}

void RecordingBackend::release(Buffer buffer) noexcept
{
  const auto found = std::lower_bound(sizes_.begin(), sizes_.end(), buffer, before);
  if (found == sizes_.end() || found->first != buffer) return;
  const std::size_t room = found->second;
  sizes_.erase(found);
  if (spare_.size() < most_spare && spare_bytes_ + room <= allocated_ / spare_part) {
    spare_.emplace_back(room, buffer);
    spare_bytes_ += room;
    return;
  }
  allocated_ -= room;
  record(OperationKind::release, {to_slot(buffer)});  // after the work that uses it
}

void RecordingBackend::record(OperationKind kind, std::initializer_list<Slot> slots, int extra)
{
  Operation operation;
  operation.kind = kind;
  operation.slots = static_cast<int>(slots.size());
  operation.extra = extra;
  queue.add(operation, slots);
}

void RecordingBackend::upload(Buffer to, const void *from, std::size_t bytes)
{
  if (bytes == 0) return;
  const unsigned char *copy = queue.keep(static_cast<const unsigned char *>(from), bytes);
  record(OperationKind::upload, {bytes, to_slot(to), to_slot(copy)});
}

void RecordingBackend::download(void *to, Buffer from, std::size_t bytes, std::size_t offset)
{
  if (bytes == 0) return;
  ++waits_;
  record(OperationKind::download, {bytes, to_slot(to), to_slot(from), offset});
  wait();
}

void RecordingBackend::copy(Buffer to, Buffer from, std::size_t bytes)
{
  if (bytes > 0 && to != from) record(OperationKind::copy, {bytes, to_slot(to), to_slot(from)});
}

void RecordingBackend::fill(Buffer buffer, unsigned char byte, std::size_t bytes)
{
  if (bytes > 0) record(OperationKind::fill, {bytes, to_slot(buffer), to_slot(byte)});
}

void RecordingBackend::launch(const KernelKey &kernel, int n, const Argument *arguments, int count)
{
  if (fiber) ++launches_;   // else those of the device count
  Operation operation;
  operation.kernel = kernel;
  operation.slots = 1 + count;
  for (int i = 0; i < count; ++i) {
    if (arguments[i].is_buffer) operation.buffers |= std::uint64_t(1) << i;
    if (arguments[i].size == 8) operation.wide |= std::uint64_t(1) << i;
  }
  queue.add(operation, {to_slot(n)});
  for (int i = 0; i < count; ++i) {
    Slot slot = 0;
    if (arguments[i].is_buffer)
      slot = to_slot(arguments[i].buffer);
    else
      std::memcpy(&slot, arguments[i].scalar, arguments[i].size);
    queue.add(slot);
  }
}

void RecordingBackend::repeat(int times, const std::function<void()> &work, bool)
{
  if (times < 1) return;
  record(OperationKind::repeat, {to_slot(times)});
  const int begin = queue.size();
  const long launches = launches_;
  work();
  queue.end_repetition(begin);
  launches_ += (launches_ - launches) * (times - 1);
}

void RecordingBackend::scan(Buffer from, Buffer to, int n)
{
  record(OperationKind::scan, {to_slot(n), to_slot(from), to_slot(to)});
}

void RecordingBackend::sort(Buffer keys, Buffer values, int n, int bits)
{
  if (n > 1) record(OperationKind::sort, {to_slot(n), to_slot(keys), to_slot(values), 0}, bits);
}

void RecordingBackend::synchronize()
{
  ++waits_;
  wait();
  if (!fiber) device_->backend->synchronize();
}

void RecordingBackend::wait()
{
  if (fiber) {
    fiber->pause();
    if (failure) std::rethrow_exception(std::exchange(failure, nullptr));
    return;
  }
  run_alone();
}

void RecordingBackend::take_answers()
{
  queue.deliver();
  if (!queue.releases().empty()) {
    const std::lock_guard<std::mutex> lock(device_->mutex);
    for (const int i : queue.releases()) device_->backend->release(from_slot<Buffer>(*queue.slots(i)));
  }
  queue.clear();
}

void RecordingBackend::run_alone()
{
  if (queue.empty()) return;
  const std::lock_guard<std::mutex> lock(device_->mutex);
  const long before = device_->backend->launches();
  try {
    run_in_order(*device_->backend, queue);
  } catch (...) {
    queue.clear();
    throw;
  }
  queue.deliver();
  queue.clear();
  launches_ += device_->backend->launches() - before;
}

}  // namespace cama
