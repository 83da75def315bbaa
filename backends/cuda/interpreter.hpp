// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cuda_runtime.h>

#include <cstddef>
#include <functional>
#include <memory>

#include "program.hpp"

namespace cama {

/// Memory that only grows: of the device, or of the host and reachable from the device.
class GrowingMemory {
public:
  explicit GrowingMemory(bool on_host) : on_host_(on_host) {}
  ~GrowingMemory();
  GrowingMemory(const GrowingMemory &) = delete;
  GrowingMemory &operator=(const GrowingMemory &) = delete;
  /// The contents are lost if it has to grow.
  unsigned char *get(std::size_t bytes);

private:
  const bool on_host_;
  unsigned char *memory_ = nullptr;
  std::size_t bytes_ = 0;
};

/// Runs recorded operations in one launch: a kernel that stays on the device and calls the kernels as functions. Each
/// world has blocks of its own, which wait for each other between operations; small scenes, for which a launch lasts
/// longer than its work, gain most. A world in one block needs no others to wait for, so any number of worlds runs at
/// once.
class Interpreter {
public:
  /// overflow: on the device, set by a scan whose total is beyond 2^31 - 1.
  Interpreter(int device, cudaStream_t queue, int *overflow);
  ~Interpreter();
  Interpreter(const Interpreter &) = delete;
  Interpreter &operator=(const Interpreter &) = delete;

  /// Whether these queues run faster so than launch by launch.
  bool suits(const std::vector<OperationQueue *> &queues) const;
  /// Launches all but the releases, and for one world the sorts: sort(operation) is called in their place. Returns the
  /// number of launches.
  int begin(const std::vector<OperationQueue *> &queues, Crew &crew, int lane, const std::function<void(int)> &sort);
  /// Waits for what has begun in the lane, if it downloads; returns whether it does.
  bool end(int lane);

private:
  struct Lane {
    GrowingMemory block{true}, downloads{true};
    cudaEvent_t copied = nullptr, done = nullptr;  // copied: the block may be written again
    std::unique_ptr<Programs> programs;  // that have begun
  };
  int blocks_for(const std::vector<OperationQueue *> &queues) const;
  void launch(int worlds, int blocks, int begin, int end);

  cudaStream_t queue_;
  int *overflow_;
  int together_ = 0;  // blocks that run at once; 0: the device has too little shared memory
  Lane lane_[2];
  GrowingMemory device_{false}, scratch_{false}, meetings_{false}, partials_{false};
};

}  // namespace cama
