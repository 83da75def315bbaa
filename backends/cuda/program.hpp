// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cuda_runtime.h>

#include <cstddef>
#include <cstdint>
#include <utility>

#include "device/for_backends.hpp"

namespace cama {

class Interpreter;

/// An operation as the interpreter reads it.
struct alignas(16) Instruction {
  std::uint8_t kind;        // OperationKind
  std::uint8_t team_shift;  // of a launch: logarithm of the members of a team
  std::uint16_t function;   // of a launch: its place among all functions
  int first;                // slot of the world; of a repetition: how often
  int slots;
  int extra;                // Operation::extra
};

/// What one world does in one call of the interpreter. Its blocks copy `words` times 16 bytes to the device first:
/// instructions, then slots, then the data of uploads.
struct WorldProgram {
  const uint4 *from;        // on the host
  uint4 *to;
  int words, count, slots;  // count: of instructions; slots: where they begin, words
  unsigned int number;      // becomes *done when all is done
  unsigned int *done;       // on the host
  int *overflow;            // on the host; set by a scan whose total is beyond 2^31 - 1
  unsigned int *arrived;    // [2] zeros, for meetings of blocks
  long long *partials;      // [blocks]
};

/// What the programs of one world need, on the host and on the device. It only grows.
class ProgramRoom {
public:
  /// queue: in whose order memory of the device is allocated.
  explicit ProgramRoom(cudaStream_t queue) : queue_(queue) {}
  ~ProgramRoom();
  ProgramRoom(const ProgramRoom &) = delete;
  ProgramRoom &operator=(const ProgramRoom &) = delete;

  /// Writes the program of a queue; the one before has ended. Slots that refer to memory of the host refer to the
  /// device's copy instead, those of downloads to the room.
  WorldProgram write(const OperationQueue &queue, int blocks, const Interpreter &interpreter);
  bool ended() const;      ///< the last program
  bool take_overflow();    ///< whether a scan has overflowed since the last call
  /// Whether memory of the device was allocated since the last call.
  bool take_grown() { return std::exchange(grown_, false); }
  const unsigned char *downloads() const { return host_ + downloads_; }
  int lane = 0;            ///< in which it runs

private:
  void grow(std::size_t host_bytes, std::size_t device_bytes);

  cudaStream_t queue_;
  unsigned char *host_ = nullptr, *device_ = nullptr;
  std::size_t host_bytes_ = 0, device_bytes_ = 0, downloads_ = 0;
  unsigned int number_ = 0;
  bool grown_ = false;
};

}  // namespace cama
