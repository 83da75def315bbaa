// SPDX-License-Identifier: Apache-2.0
#include "device/recording_backend.hpp"

#include <algorithm>
#include <utility>

#include "cama/error.hpp"

namespace cama {
namespace {

// Buffers that a world keeps for its next allocations, which then wait for no other world and no program: their number,
// and which part of its memory they may take.
constexpr std::size_t most_spare = 64, spare_part = 8;

constexpr std::size_t smallest_unit = 64, shelved_part = 8;  // of a room; of all memory, at most one of so many parts

bool before(const std::pair<Buffer, std::size_t> &entry, Buffer buffer)
{
  return std::less<Buffer>{}(entry.first, buffer);
}

}  // namespace

std::size_t SharedDevice::room_for(std::size_t bytes)
{
  std::size_t unit = smallest_unit;
  while (rooms_of_a_unit * unit <= bytes) unit *= 2;
  return std::max<std::size_t>((bytes + unit - 1) / unit, 1) * unit;
}

SharedDevice::~SharedDevice()
{
  const OnDevice on(*backend);
  clear();
}

SharedDevice::Shelf &SharedDevice::shelf_of(std::size_t room)
{
  std::size_t unit = smallest_unit, number = 0;
  for (; rooms_of_a_unit * unit < room; unit *= 2) ++number;
  return shelves_[rooms_of_a_unit * number + room / unit - 1];
}

SharedDevice::Allocation SharedDevice::allocate(std::size_t room)
{
  {
    Shelf &shelf = shelf_of(room);
    const std::lock_guard<std::mutex> lock(shelf.mutex);
    if (!shelf.buffers.empty()) {
      const Buffer buffer = shelf.buffers.back();
      shelf.buffers.pop_back();
      shelved_ -= room;
      return {buffer, false};
    }
  }
  Buffer buffer = nullptr;
  try {
    const std::lock_guard<std::mutex> lock(mutex);
    buffer = backend->allocate(room);
  } catch (const MemoryError &) {
    clear();
    const std::lock_guard<std::mutex> lock(mutex);
    buffer = backend->allocate(room);
  }
  allocated_ += room;
  return {buffer, true};
}

void SharedDevice::release(Buffer buffer, std::size_t room) noexcept
{
  if (shelved_ + room <= allocated_ / shelved_part) {
    Shelf &shelf = shelf_of(room);
    const std::lock_guard<std::mutex> lock(shelf.mutex);
    shelf.buffers.push_back(buffer);
    shelved_ += room;
    return;
  }
  const std::lock_guard<std::mutex> lock(mutex);
  backend->release(buffer);
  allocated_ -= room;
}

void SharedDevice::clear() noexcept
{
  for (std::size_t number = 0; number < units; ++number)
    for (std::size_t k = 0; k < rooms_of_a_unit; ++k) {
      const std::size_t room = (k + 1) * (smallest_unit << number);
      Shelf &shelf = shelves_[rooms_of_a_unit * number + k];
      const std::lock_guard<std::mutex> lock(shelf.mutex);
      for (const Buffer buffer : shelf.buffers) {
        const std::lock_guard<std::mutex> one(mutex);
        backend->release(buffer);
        allocated_ -= room;
        shelved_ -= room;
      }
      shelf.buffers.clear();
    }
}

RecordingBackend::~RecordingBackend()
{
  queue.room.reset();
  try {
    for (const auto &spare : spare_) record(OperationKind::release, {to_slot(spare.second), spare.first});
    for (const Buffer of_pieces : chunks_) record(OperationKind::release, {to_slot(of_pieces), chunk});
    run_alone();
  } catch (...) {  // the device is lost
  }
}

Buffer RecordingBackend::allocate(std::size_t bytes)
{
  const bool piece = is_piece(bytes);
  const std::size_t room = piece ? std::max<std::size_t>((bytes + piece_unit - 1) / piece_unit, 1) * piece_unit
                                 : SharedDevice::room_for(bytes);
  const Buffer buffer = piece ? take_piece(room) : take(room);
  sizes_.insert(std::lower_bound(sizes_.begin(), sizes_.end(), buffer, before), {buffer, room});
  return buffer;
}

Buffer RecordingBackend::take(std::size_t room)
{
  const auto spare = std::find_if(spare_.rbegin(), spare_.rend(), [&](const auto &s) { return s.first == room; });
  if (spare != spare_.rend()) {
    const Buffer buffer = spare->second;
    *spare = spare_.back();
    spare_.pop_back();
    spare_bytes_ -= room;
    return buffer;
  }
  const SharedDevice::Allocation found = device_->allocate(room);
  allocated |= found.fresh;
  allocated_ += room;
  peak_ = std::max(peak_, allocated_);
  return found.buffer;
}

Buffer RecordingBackend::take_piece(std::size_t room)
{
  std::vector<Buffer> &released = pieces_[room / piece_unit - 1];
  if (!released.empty()) {
    const Buffer buffer = released.back();
    released.pop_back();
    return buffer;
  }
  if (chunk_left_ < room) {
    chunks_.push_back(take(chunk));
    chunk_left_ = chunk;
  }
  const std::size_t at = chunk - chunk_left_;
  chunk_left_ -= room;
  return static_cast<unsigned char *>(chunks_.back()) + at;
}

void RecordingBackend::release(Buffer buffer) noexcept
{
  const auto found = std::lower_bound(sizes_.begin(), sizes_.end(), buffer, before);
  if (found == sizes_.end() || found->first != buffer) return;
  const std::size_t room = found->second;
  sizes_.erase(found);
  if (is_piece(room)) return pieces_[room / piece_unit - 1].push_back(buffer);
  if (spare_.size() < most_spare && spare_bytes_ + room <= allocated_ / spare_part) {
    spare_.emplace_back(room, buffer);
    spare_bytes_ += room;
    return;
  }
  allocated_ -= room;
  record(OperationKind::release, {to_slot(buffer), room});  // after the work that uses it
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
  if (fiber) ++launches_;  // else those of the device count
  Operation operation;
  operation.kernel = kernel;
  operation.slots = 1 + count;
  for (int i = 0; i < count; ++i) {
    if (arguments[i].is_buffer) operation.buffers |= std::uint64_t(1) << i;
    if (arguments[i].size == 8) operation.wide |= std::uint64_t(1) << i;
  }
  queue.add(operation, {to_slot(n)});
  for (int i = 0; i < count; ++i) queue.add(slot_of(arguments[i]));
}

void RecordingBackend::repeat(int times, const std::function<void()> &work)
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
  for (const int i : queue.releases()) device_->release(from_slot<Buffer>(queue.slots(i)[0]), queue.slots(i)[1]);
  queue.clear();
}

long RecordingBackend::run_now()
{
  const std::lock_guard<std::mutex> lock(device_->mutex);
  const long before = device_->backend->launches();
  const auto end = [&] {
    for (const int i : queue.releases()) device_->forget(queue.slots(i)[1]);
    queue.clear();
  };
  try {
    run_in_order(*device_->backend, queue);
  } catch (...) {
    end();
    throw;
  }
  end();
  return device_->backend->launches() - before;
}

void RecordingBackend::run_alone()
{
  if (queue.empty()) return;
  launches_ += run_now();
}

}  // namespace cama
