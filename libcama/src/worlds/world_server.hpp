// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <functional>
#include <memory>
#include <vector>

#include "device/crew.hpp"
#include "device/recording_backend.hpp"

namespace cama {

/// Runs worlds that share a device side by side. Each world runs in a fiber and records what it asks of the device;
/// while it waits for an answer, other worlds go on, on the host and on the device. No world waits for another, and
/// none computes anything but what it computes alone.
class WorldServer {
public:
  explicit WorldServer(std::unique_ptr<Backend> device) : device_(std::make_shared<SharedDevice>(std::move(device))) {}

  std::unique_ptr<RecordingBackend> make_world() { return std::make_unique<RecordingBackend>(device_); }
  Backend &device() { return *device_->backend; }
  long launches() const;  ///< on the device since the start

  struct Task {
    RecordingBackend *world;
    std::function<void()> work;  ///< may not throw
  };
  /// Does all tasks. Throws what the device throws; the worlds' works have then met an exception where they waited.
  void run(Crew &crew, std::vector<Task> &tasks);

private:
  std::shared_ptr<SharedDevice> device_;
  std::vector<std::unique_ptr<Fiber>> fibers_;
  std::vector<std::unique_ptr<WorldRunner>> runners_;  // [members of the crew]; null: see Backend::make_runner
};

}  // namespace cama
