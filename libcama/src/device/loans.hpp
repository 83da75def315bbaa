// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <atomic>
#include <initializer_list>
#include <memory>
#include <mutex>
#include <utility>
#include <vector>

#include "cama/device_array.hpp"
#include "cama/stream.hpp"

namespace cama {

/// Memory of a simulation that others read. Before the simulation writes to what is lent, it leaves the memory to its
/// borrowers and goes on with a copy; without borrowers nothing is copied. Arrays may be dropped in any thread.
class Loans : public std::enable_shared_from_this<Loans> {
public:
  explicit Loans(std::shared_ptr<Backend> backend) : backend_(std::move(backend)) {}

  /// The stream's memory, of which all work is done. Throws BackendError where memory has no address.
  DeviceArray lend(const Stream<dvec3> &stream);
  /// The same, for memory that the simulation does not need.
  DeviceArray give(Stream<dvec3> stream);
  DeviceArray copy(const DeviceArray &array);
  std::vector<dvec3> download(const DeviceArray &array);
  DeviceMemory memory() const { return backend_->memory(); }
  /// The simulation writes to these streams next, after what borrowers have asked of the device.
  void before_writing(std::initializer_list<Stream<dvec3> *> streams);
  /// The simulation ends: its streams leave to borrowers what is lent.
  void leave(std::initializer_list<Stream<dvec3> *> streams) noexcept;
  void close() noexcept;  ///< the simulation uses the backend no more
  void end(Loan &loan) noexcept;

private:
  void check_memory() const;
  std::shared_ptr<Loan> make(Buffer buffer, bool owns);
  void wait_and_take_back();
  void take_back() noexcept;

  std::shared_ptr<Backend> backend_;
  std::mutex mutex_;  // of what follows
  std::vector<std::pair<Buffer, std::weak_ptr<Loan>>> lent_;  // since the simulation wrote last
  std::vector<Buffer> returned_;
  std::size_t loans_ = 0;
  bool open_ = true;
  std::atomic<bool> ended_{false};  // a loan, since the device was waited for
};

/// Closes the loans of a simulation when its streams are gone.
class OpenLoans {
public:
  explicit OpenLoans(std::shared_ptr<Backend> backend) : loans_(std::make_shared<Loans>(std::move(backend))) {}
  ~OpenLoans()
  {
    if (loans_) loans_->close();
  }
  OpenLoans(OpenLoans &&) noexcept = default;
  OpenLoans &operator=(OpenLoans &&) = delete;
  Loans *operator->() const { return loans_.get(); }
  explicit operator bool() const { return loans_ != nullptr; }

private:
  std::shared_ptr<Loans> loans_;
};

}  // namespace cama
