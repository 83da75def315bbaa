// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <atomic>
#include <cstddef>
#include <exception>
#include <functional>
#include <initializer_list>
#include <memory>
#include <mutex>
#include <vector>

#include "device/fiber.hpp"
#include "device/operations.hpp"

namespace cama {

/// A device that several recordings share. They allocate from several threads; what one of them has released serves the
/// others, since to allocate takes microseconds in which all would wait.
class SharedDevice {
public:
  explicit SharedDevice(std::unique_ptr<Backend> device) : backend(std::move(device)) {}
  ~SharedDevice();
  SharedDevice(const SharedDevice &) = delete;
  SharedDevice &operator=(const SharedDevice &) = delete;

  struct Allocation {
    Buffer buffer;
    bool fresh;  ///< from the backend: work that does not follow its queue may not use it
  };
  /// room: bytes, as of room_for.
  Allocation allocate(std::size_t room);
  /// Nothing on the device uses the buffer any more.
  void release(Buffer buffer, std::size_t room) noexcept;
  /// The backend has released a buffer.
  void forget(std::size_t room) { allocated_ -= room; }

  /// The smallest room that holds so many bytes. There are few sizes, so that buffers fit again: multiples of an
  /// eighth of the largest power of two below.
  static std::size_t room_for(std::size_t bytes);

  std::unique_ptr<Backend> backend;
  std::mutex mutex;  ///< of the backend

private:
  struct Shelf {
    std::mutex mutex;
    std::vector<Buffer> buffers;
  };
  static constexpr std::size_t rooms_of_a_unit = 16, units = 48;
  Shelf &shelf_of(std::size_t room);
  void clear() noexcept;

  std::array<Shelf, rooms_of_a_unit * units> shelves_;  // of released buffers, by room
  std::atomic<std::size_t> allocated_{0}, shelved_{0};  // bytes; allocated: shelved ones too
};

/// The backend of a simulation that records what it asks of a device. Where the simulation needs an answer, the device
/// gets all that was recorded at once. One of several worlds pauses its fiber there, so that the operations of all
/// worlds run together.
class RecordingBackend final : public Backend {
public:
  explicit RecordingBackend(std::shared_ptr<SharedDevice> device)
      : device_(std::move(device)), addresses_(device_->backend->memory().kind != DeviceMemory::Kind::opaque)
  {}
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
  void repeat(int times, const std::function<void()> &work) override;
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
  /// Does what the queue holds, launch by launch, and empties it. Returns the number of launches.
  long run_now();

  OperationQueue queue;
  Fiber *fiber = nullptr;  ///< in which the world runs; null: alone
  bool allocated = false;  ///< memory of the device, since this was last set to false
  std::exception_ptr failure;  ///< what the world meets when it goes on

private:
  /// Small buffers are pieces of larger ones, where a buffer is an address: a world has hundreds of them, and each that
  /// comes from the device takes microseconds in which others wait.
  static constexpr std::size_t piece_unit = 256, largest_piece = std::size_t(1) << 14, chunk = std::size_t(1) << 18;

  void record(OperationKind kind, std::initializer_list<Slot> slots, int extra = 0);
  void wait();
  void run_alone();
  bool is_piece(std::size_t bytes) const { return addresses_ && bytes <= largest_piece; }
  Buffer take(std::size_t room);
  Buffer take_piece(std::size_t room);

  std::shared_ptr<SharedDevice> device_;
  const bool addresses_;  // whether a buffer is an address
  std::vector<std::pair<Buffer, std::size_t>> sizes_;  // sorted by buffer
  std::vector<std::pair<std::size_t, Buffer>> spare_;  // released, for the next of this size
  std::size_t spare_bytes_ = 0;
  std::vector<Buffer> chunks_;  // of pieces
  std::size_t chunk_left_ = 0;  // bytes of the last chunk
  std::array<std::vector<Buffer>, largest_piece / piece_unit> pieces_;  // released, by room
};

}  // namespace cama
