// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <exception>
#include <functional>
#include <memory>
#include <vector>

#include "device/crew.hpp"
#include "device/recording_backend.hpp"

namespace cama {

/// Runs the steps of worlds that share a device side by side. Each world runs in a fiber and records what it asks of
/// the device; where all pause, their operations run in batches. No world computes anything but what it computes alone.
class Lockstep {
public:
  explicit Lockstep(std::unique_ptr<Backend> device) : device_(std::make_shared<SharedDevice>(std::move(device))) {}

  std::unique_ptr<RecordingBackend> make_world() { return std::make_unique<RecordingBackend>(device_); }
  Backend &device() { return *device_->backend; }

  struct Task {
    RecordingBackend *world;
    std::function<void()> work;  ///< may not throw
  };
  /// Does all tasks. Throws what the device throws; the worlds' works have then met that exception where they waited.
  void run(Crew &crew, std::vector<Task> &tasks);

private:
  std::shared_ptr<SharedDevice> device_;
  std::vector<std::unique_ptr<Fiber>> fibers_;
};

}  // namespace cama
