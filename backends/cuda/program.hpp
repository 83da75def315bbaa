// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstddef>
#include <cstdint>
#include <vector>

#include "device/for_backends.hpp"

namespace cama {

/// An operation as the interpreter reads it.
struct Instruction {
  std::uint8_t kind;        // OperationKind
  std::uint8_t team_shift;  // of a launch: logarithm of the members of a team
  std::uint16_t function;   // of a launch: its place among all functions
  int first;                // slot of the world; of a repetition: how often
  int slots;
  int extra;                // Operation::extra
};

/// What one world does in one call of the interpreter. Addresses are of the device.
struct WorldProgram {
  const Instruction *instructions;
  const Slot *slots;
  int count;
};

/// The programs of several worlds in one block of memory that is copied to the device at once: WorldPrograms,
/// instructions, slots and the data of uploads. Slots that refer to memory of the host refer to the block instead, and
/// those of downloads to memory that both can reach.
class Programs {
public:
  /// function_of: place of a kernel among all functions.
  Programs(const std::vector<OperationQueue *> &queues, int (*function_of)(const KernelKey &));

  std::size_t bytes() const { return bytes_; }
  std::size_t downloaded_bytes() const { return downloaded_; }
  std::size_t scratch_bytes() const { return scratch_; }  ///< of sorts
  bool waits() const { return waits_; }                   ///< whether there is a download
  /// Writes the block. device: where it will be; downloads, scratch: of the device.
  void write(Crew &crew, unsigned char *block, unsigned char *device, unsigned char *downloads,
             unsigned char *scratch) const;
  /// Tells the worlds where what they have downloaded is.
  void answer(const unsigned char *downloads) const;

private:
  struct Place {
    std::size_t instructions = 0, data = 0, downloads = 0, scratch = 0;
  };
  void write(std::size_t world, unsigned char *block, unsigned char *device, unsigned char *downloads,
             unsigned char *scratch) const;

  const std::vector<OperationQueue *> &queues_;
  int (*function_of_)(const KernelKey &);
  std::vector<Place> places_;
  std::size_t bytes_ = 0, downloaded_ = 0, scratch_ = 0;
  bool waits_ = false;
};

}  // namespace cama
