// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cuda_runtime.h>

#include <cstddef>
#include <exception>
#include <utility>
#include <vector>

#include "launch_graphs.hpp"

namespace cama {

/// What the device is asked for, in its order: a stream, and another one for work aside. Launches pass through a list,
/// which goes to the device after each of them, or in batches after some, as a graph if the same ones have been there
/// before.
class LaunchQueue {
public:
  /// begins_early: launches may begin while the one before ends (AWAIT_LAUNCHES in lang.h).
  explicit LaunchQueue(bool begins_early);
  ~LaunchQueue();
  LaunchQueue(const LaunchQueue &) = delete;
  LaunchQueue &operator=(const LaunchQueue &) = delete;

  /// For what is asked of the device directly, which follows `hand_over`.
  cudaStream_t stream() const { return stream_; }

  void launch(const void *function, const char *name, int blocks, int threads, const Slot *arguments, int count);
  /// Frees memory behind what has been launched.
  void free(void *memory, std::size_t bytes) noexcept;

  void begin_batches() { batches_ = true; }
  void end_batches() noexcept;
  /// Hands what is held to the device. Also throws an earlier error that could not be thrown where it happened.
  void hand_over();
  /// The host has waited, so the stream has nothing to do: the next batch is a short one.
  void note_wait() { idle_ = true; }

  void begin_side_by_side() { side_by_side_ = begins_early_; }
  void end_side_by_side();
  void fork();
  void begin_aside();
  void end_aside() noexcept;
  void meet() noexcept;

  /// Launches from here on are held, and then launched `times` times; or they are given up.
  void begin_repetition();
  void run_repetition(int times);
  void give_up_repetition() noexcept;

  /// Gives up what is held and waits for the device.
  void stop() noexcept;

private:
  void run_held(int times, bool returns);
  void hand_over_or_note() noexcept;
  void clear_held() noexcept;
  void give_up_held() noexcept;

  const bool begins_early_;
  cudaStream_t stream_ = nullptr, side_ = nullptr;
  cudaEvent_t forked_ = nullptr, met_ = nullptr;
  bool apart_ = false;  // there is work aside
  bool side_by_side_ = false, after_several_ = false;  // launches now; the next one is behind several
  int beside_ = 0;  // launches of these so far
  bool batches_ = false, repeats_ = false;  // launches are held
  bool idle_ = true;  // nothing was handed over since the host waited
  LaunchList held_;
  LaunchGraphs graphs_;
  std::vector<void *> freed_later_;  // behind what is held
  std::exception_ptr failure_;  // to be reported
};

}  // namespace cama
