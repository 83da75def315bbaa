// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cuda_runtime.h>

#include "program.hpp"

namespace cama {

constexpr int most_worlds = 32;

/// The worlds of one launch.
struct Batch {
  WorldProgram world[most_worlds];
};

/// Runs recorded operations of worlds: a kernel that stays on the device and calls the kernels as functions. Each
/// world has blocks of its own, which wait for each other between operations, and tells the host by itself when it has
/// ended. Small scenes, for which a launch lasts longer than its work, gain most.
class Interpreter {
public:
  /// team_bytes: memory that a team of a kernel shares.
  Interpreter(int device, int (*team_bytes)(const KernelKey &));

  bool usable() const { return together_ > 0; }  ///< else the device has too little shared memory
  /// worlds: that run at once.
  int blocks_for(const OperationQueue &queue, int worlds) const;
  /// Whether a queue runs faster so than launch by launch.
  bool suits(const OperationQueue &queue, int worlds) const;
  void launch(const Batch &batch, int worlds, int blocks, cudaStream_t stream) const;

  // Of programs.

  int place(const KernelKey &kernel) const;  ///< among all functions
  /// Logarithm of the members of a team; teams: of a block. Teams are as small as it takes for all of a block to work
  /// at once, if their memory suffices: barriers of few members cost less, and teams that wait do so side by side.
  int team_shift(const KernelKey &kernel, int teams) const;

private:
  int (*team_bytes_)(const KernelKey &);
  int memory_ = 0;  // bytes that the teams of a block share
  int together_ = 0;  // blocks that run at once
};

}  // namespace cama
