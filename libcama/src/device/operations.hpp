// SPDX-License-Identifier: Apache-2.0
// What several worlds ask of one device, merged: the same operation of many worlds is one batch.
#pragma once
#include <cstdint>
#include <cstring>
#include <initializer_list>
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

enum class OperationKind : std::uint8_t {
  launch,    ///< n, then the arguments
  scan,      ///< n, from, to
  sort,      ///< n, keys, values; `extra` is the number of bits
  copy,      ///< bytes, to, from
  fill,      ///< bytes, buffer, byte
  upload,    ///< bytes, to, address on the host
  download,  ///< bytes, address on the host, from, offset; the last operation of a world before it waits
  release,   ///< buffer
  repeat     ///< times; the next `extra` operations are what is repeated
};

/// One operation without its slots: operations that are equal can be one batch.
struct Operation {
  OperationKind kind = OperationKind::launch;
  KernelKey kernel{0, KernelPrecision::none, ""};
  int slots = 0;
  int extra = 0;
  std::uint64_t buffers = 0;  ///< bit i: argument i of a launch is a buffer
  std::uint64_t wide = 0;     ///< bit i: argument i is a number of 8 bytes, not 4

  /// Of what must be equal in a batch; `before`: the hash of what precedes it.
  std::uint64_t hash(std::uint64_t before) const
  {
    const auto mix = [](std::uint64_t h, std::uint64_t word) {
      h = (h ^ word) * 0x9e3779b97f4a7c15ull;
      return h ^ h >> 29;
    };
    const std::uint64_t kernel_word = static_cast<std::uint64_t>(kernel.index) << 32 |
                                      static_cast<std::uint64_t>(kernel.precision) << 24 |
                                      static_cast<std::uint64_t>(kernel.team);
    const std::uint64_t kind_word = static_cast<std::uint64_t>(kind) << 56 |
                                    static_cast<std::uint64_t>(static_cast<unsigned int>(extra));
    return mix(mix(before + 1, kernel_word), kind_word);
  }
};

/// What one world has asked of its device and what has not run yet.
class OperationQueue {
public:
  bool empty() const { return operations_.empty(); }
  int size() const { return static_cast<int>(operations_.size()); }
  /// Equal for queues whose operations are equal but for their slots, and, but for chance, for those only.
  std::uint64_t hash() const { return hash_; }
  const Operation &operation(int i) const { return operations_[static_cast<std::size_t>(i)]; }
  const Slot *slots(int i) const { return slots_.data() + first_[static_cast<std::size_t>(i)]; }

  /// Adds an operation; its other slots are added by `add`.
  void add(const Operation &operation, std::initializer_list<Slot> slots)
  {
    first_.push_back(slots_.size());
    slots_.insert(slots_.end(), slots);
    operations_.push_back(operation);
    hash_ = operation.hash(hash_);
  }
  void add(Slot slot) { slots_.push_back(slot); }
  /// A copy that lives until `clear`.
  const unsigned char *keep(const unsigned char *bytes, std::size_t count)
  {
    return kept_.emplace_back(bytes, bytes + count).data();
  }
  /// Makes everything from operation i on the body of the repetition i - 1.
  void end_repetition(int i)
  {
    Operation &repeat = operations_[static_cast<std::size_t>(i - 1)];
    repeat.extra = size() - i;
    hash_ = repeat.hash(hash_);
  }
  void clear()
  {
    operations_.clear();
    first_.clear();
    slots_.clear();
    kept_.clear();
    hash_ = 0;
  }

private:
  std::vector<Operation> operations_;
  std::vector<std::size_t> first_;  // [operations] slot
  std::vector<Slot> slots_;
  std::vector<std::vector<unsigned char>> kept_;
  std::uint64_t hash_ = 0;
};

/// Operations of several worlds, merged. Refers to their queues.
struct Plan {
  /// Worlds that do the same; those that repeat it most often come first.
  struct Group {
    std::vector<const OperationQueue *> worlds;
    std::vector<int> sequence;  ///< [worlds] to which of the group's sequences the world belongs
  };
  /// The same operation of the worlds of a group.
  struct Batch {
    Operation what;
    int group;
    std::vector<int> at;  ///< [sequences of the group] place of the operation in the queues
  };
  struct Run {
    int batch;
    int worlds;  ///< the first so many of its group
  };
  std::vector<Group> groups;
  std::vector<Batch> batches;
  std::vector<Run> order;

  int worlds(const Batch &batch) const
  {
    return static_cast<int>(groups[static_cast<std::size_t>(batch.group)].worlds.size());
  }
  const Slot *slots(const Batch &batch, int world) const
  {
    const Group &group = groups[static_cast<std::size_t>(batch.group)];
    const auto w = static_cast<std::size_t>(world);
    return group.worlds[w]->slots(batch.at[static_cast<std::size_t>(group.sequence[w])]);
  }
};

}  // namespace cama
