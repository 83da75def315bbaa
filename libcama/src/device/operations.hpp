// SPDX-License-Identifier: Apache-2.0
// What is asked of a device, recorded: to run later, together with what others ask.
#pragma once
#include <cstdint>
#include <cstring>
#include <initializer_list>
#include <memory>
#include <vector>

#include "cama/backend.hpp"

namespace cama {

/// A number or a buffer of an operation.
using Slot = std::uint64_t;

template <class T> Slot to_slot(T value)
{
  static_assert(sizeof(T) <= sizeof(Slot));
  Slot slot = 0;
  std::memcpy(&slot, &value, sizeof value);
  return slot;
}
template <class T> T from_slot(Slot slot)
{
  T value;
  std::memcpy(&value, &slot, sizeof value);
  return value;
}

inline Slot slot_of(const Argument &argument)
{
  if (argument.is_buffer) return to_slot(argument.buffer);
  Slot slot = 0;
  std::memcpy(&slot, argument.scalar, argument.size);
  return slot;
}

enum class OperationKind : std::uint8_t {
  launch,    ///< n, then the arguments
  scan,      ///< n, from, to
  sort,      ///< n, keys, values, room for the backend; `extra` is the number of bits
  copy,      ///< bytes, to, from
  fill,      ///< bytes, buffer, byte
  upload,    ///< bytes, to, address on the host
  download,  ///< bytes, address on the host, from, offset; the last operation of a world before it waits
  release,   ///< buffer, its bytes
  repeat     ///< times; the next `extra` operations are what is repeated
};

/// One operation without its slots.
struct Operation {
  OperationKind kind = OperationKind::launch;
  KernelKey kernel{0, KernelPrecision::none, ""};
  int slots = 0;
  int extra = 0;
  std::uint64_t buffers = 0;  ///< bit i: argument i of a launch is a buffer
  std::uint64_t wide = 0;     ///< bit i: argument i is a number of 8 bytes, not 4
};

/// What one world has asked of its device and what has not run yet.
class OperationQueue {
public:
  bool empty() const { return operations_.empty(); }
  int size() const { return static_cast<int>(operations_.size()); }
  const Operation &operation(int i) const { return operations_[static_cast<std::size_t>(i)]; }
  const Slot *slots(int i) const { return slots_.data() + first_[static_cast<std::size_t>(i)]; }
  std::size_t slot_count() const { return slots_.size(); }
  std::size_t kept_bytes() const { return kept_bytes_; }  ///< each copy filled up to whole 16 bytes
  std::size_t downloaded_bytes() const { return downloaded_bytes_; }  ///< likewise
  int largest_sort() const { return largest_sort_; }  ///< number of keys
  int largest() const { return largest_; }            ///< number of work items or members of teams of a launch
  const std::vector<int> &releases() const { return releases_; }  ///< the operations that are releases

  void add(const Operation &operation, std::initializer_list<Slot> slots);
  void add(Slot slot) { slots_.push_back(slot); }
  /// A copy that lives until `clear`.
  const unsigned char *keep(const unsigned char *bytes, std::size_t count);
  /// Makes everything from operation i on the body of the repetition i - 1.
  void end_repetition(int i) { operations_[static_cast<std::size_t>(i - 1)].extra = size() - i; }
  void clear();

  /// Where a backend has left what was downloaded, one behind the other, each filled up to whole 16 bytes; null if it
  /// is where it was asked for.
  const unsigned char *downloaded = nullptr;
  /// Copies it to where it was asked for.
  void deliver();

  std::shared_ptr<void> room;  ///< what a WorldRunner keeps for this queue

private:
  std::vector<Operation> operations_;
  std::vector<std::size_t> first_;  // [operations] slot
  std::vector<Slot> slots_;
  std::vector<std::vector<unsigned char>> kept_;
  std::vector<int> downloads_, releases_;  // operations
  std::size_t kept_bytes_ = 0, downloaded_bytes_ = 0;
  int largest_sort_ = 0, largest_ = 0;
};

/// Does the operations of a queue, one after the other.
void run_in_order(Backend &backend, const OperationQueue &queue);

}  // namespace cama
