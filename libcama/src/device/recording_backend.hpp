// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <exception>
#include <functional>
#include <initializer_list>
#include <memory>
#include <mutex>
#include <vector>

#include "device/fiber.hpp"
#include "device/operations.hpp"

namespace cama {

/// A device that several recordings share. They allocate from several threads.
struct SharedDevice {
  explicit SharedDevice(std::unique_ptr<Backend> device) : backend(std::move(device)) {}
  std::unique_ptr<Backend> backend;
  std::mutex mutex;
};

/// The backend of a simulation that records what it asks of a device. Where the simulation needs an answer, the device
/// gets all that was recorded at once. One of several worlds pauses its fiber there, so that the operations of all
/// worlds run together.
class RecordingBackend final : public Backend {
public:
  explicit RecordingBackend(std::shared_ptr<SharedDevice> device) : device_(std::move(device)) {}
  ~RecordingBackend() override;

  std::string_view name() const override { return device_->backend->name(); }
  std::string device() const override { return device_->backend->device(); }
  bool wide_workers() const override { return device_->backend->wide_workers(); }
  int workers() const override { return 1; }  // for this world: others run beside it

  Buffer allocate(std::size_t bytes) override;
  void release(Buffer buffer) noexcept override;
  void upload(Buffer to, const void *from, std::size_t bytes) override;
  void download(void *to, Buffer from, std::size_t bytes, std::size_t offset) override;
  void copy(Buffer to, Buffer from, std::size_t bytes) override;
  void fill(Buffer buffer, unsigned char byte, std::size_t bytes) override;
  void launch(const KernelKey &kernel, int n, const Argument *arguments, int count) override;
  void repeat(int times, const std::function<void()> &work, bool again) override;
  void scan(Buffer from, Buffer to, int n) override;
  void sort(Buffer keys, Buffer values, int n, int bits) override;
  void synchronize() override;
  DeviceMemory memory() const override { return device_->backend->memory(); }
  bool reaches(const void *address) const override { return device_->backend->reaches(address); }
  void synchronize_device() override { device_->backend->synchronize_device(); }
  int make_current() const override { return device_->backend->make_current(); }
  void leave_to(int device) const override { device_->backend->leave_to(device); }
  int device_before() const override { return device_->backend->device_before(); }

  // For who runs worlds together.

  /// Hands the world what a WorldRunner has downloaded for its queue, releases what the queue releases, and empties it.
  void take_answers();

  OperationQueue queue;
  Fiber *fiber = nullptr;      ///< in which the world runs; null: alone
  bool allocated = false;      ///< memory of the device, since this was last set to false
  std::exception_ptr failure;  ///< what the world meets when it goes on

private:
  void record(OperationKind kind, std::initializer_list<Slot> slots, int extra = 0);
  void wait();
  void run_alone();

  std::shared_ptr<SharedDevice> device_;
  std::vector<std::pair<Buffer, std::size_t>> sizes_;  // sorted by buffer
  std::vector<std::pair<std::size_t, Buffer>> spare_;  // released, for the next of this size
  std::size_t spare_bytes_ = 0;
};

}  // namespace cama
