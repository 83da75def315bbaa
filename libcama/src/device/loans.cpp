// SPDX-License-Identifier: Apache-2.0
#include "device/loans.hpp"

#include <algorithm>
#include <string>

#include "cama/error.hpp"

namespace cama {

/// One piece of lent memory.
struct Loan {
  std::shared_ptr<Loans> loans;
  Buffer buffer;
  bool owns;  ///< the simulation does not use the memory
  Loan(std::shared_ptr<Loans> of, Buffer memory, bool alone) : loans(std::move(of)), buffer(memory), owns(alone) {}
  ~Loan() { loans->end(*this); }
};

void *DeviceArray::data() const { return loan_->buffer; }
DeviceMemory DeviceArray::memory() const { return loan_->loans->memory(); }
DeviceArray DeviceArray::copy() const { return loan_->loans->copy(*this); }
std::vector<dvec3> DeviceArray::download() const { return loan_->loans->download(*this); }

void Loans::check_memory() const
{
  if (memory().kind == DeviceMemory::Kind::opaque)
    throw BackendError("device arrays: memory of backend " + std::string(backend_->name()) +
                       " has no address that other libraries can use; use positions, velocities and forces, which are "
                       "copies on the host");
}

/// With the mutex locked.
std::shared_ptr<Loan> Loans::make(Buffer buffer, bool owns)
{
  returned_.reserve(returned_.size() + loans_ + 1);  // `end` must not allocate
  auto loan = std::make_shared<Loan>(shared_from_this(), buffer, owns);
  ++loans_;
  return loan;
}

DeviceArray Loans::lend(const Stream<dvec3> &stream)
{
  check_memory();
  backend_->synchronize();
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto same = [&](const auto &lent) { return lent.first == stream.buffer(); };
  auto lent = std::find_if(lent_.begin(), lent_.end(), same);
  const bool first = lent == lent_.end();
  if (first) lent = lent_.emplace(lent, stream.buffer(), std::weak_ptr<Loan>());
  if (std::shared_ptr<Loan> living = lent->second.lock()) return {std::move(living), stream.size()};
  std::shared_ptr<Loan> loan = make(stream.buffer(), false);
  lent->second = loan;
  if (!first) ended_ = true;  // of the loan before this one the device may still read
  return {std::move(loan), stream.size()};
}

DeviceArray Loans::give(Stream<dvec3> stream)
{
  check_memory();
  if (ended_.exchange(false)) wait_and_take_back();
  backend_->synchronize();
  const std::lock_guard<std::mutex> lock(mutex_);
  const int size = stream.size();
  std::shared_ptr<Loan> loan = make(stream.buffer(), true);
  stream.give_up();
  return {std::move(loan), size};
}

DeviceArray Loans::copy(const DeviceArray &array)
{
  if (ended_.exchange(false)) wait_and_take_back();
  const std::lock_guard<std::mutex> lock(mutex_);  // borrowers may give memory back meanwhile
  Stream<dvec3> own(*backend_, array.size());
  if (array.size()) backend_->copy(own.buffer(), array.data(), sizeof(dvec3) * static_cast<std::size_t>(array.size()));
  backend_->synchronize();
  std::shared_ptr<Loan> loan = make(own.buffer(), true);
  own.give_up();
  return {std::move(loan), array.size()};
}

std::vector<dvec3> Loans::download(const DeviceArray &array)
{
  const std::lock_guard<std::mutex> lock(mutex_);
  std::vector<dvec3> values(static_cast<std::size_t>(array.size()));
  if (!values.empty()) backend_->download(values.data(), array.data(), sizeof(dvec3) * values.size());
  return values;
}

void Loans::before_writing(std::initializer_list<Stream<dvec3> *> streams)
{
  if (lent_.empty() && !ended_) return;
  std::vector<std::shared_ptr<Loan>> living;  // dropped after the lock
  bool wait = false;
  for (auto &[buffer, loan] : lent_) {
    living.push_back(loan.lock());
    wait = wait || !living.back();
    if (!living.back()) continue;
    for (Stream<dvec3> *stream : streams) {
      if (stream->buffer() != buffer) continue;
      Stream<dvec3> copy(*backend_);
      copy.copy_from(*stream);
      const std::lock_guard<std::mutex> lock(mutex_);
      stream->give_up();
      stream->swap(copy);
      living.back()->owns = true;
    }
  }
  lent_.clear();
  if (ended_.exchange(false) || wait) wait_and_take_back();
}

void Loans::wait_and_take_back()
{
  backend_->synchronize_device();
  const std::lock_guard<std::mutex> lock(mutex_);
  take_back();
}

void Loans::leave(std::initializer_list<Stream<dvec3> *> streams) noexcept
{
  for (auto &[buffer, loan] : lent_) {
    const std::shared_ptr<Loan> living = loan.lock();
    if (!living) ended_ = true;
    for (Stream<dvec3> *stream : streams) {
      if (!living || stream->buffer() != buffer) continue;
      const std::lock_guard<std::mutex> lock(mutex_);
      stream->give_up();
      living->owns = true;
    }
  }
  lent_.clear();
  if (!ended_) return;
  try {
    backend_->synchronize_device();
  } catch (const Error &) {  // the device is lost
  }
}

void Loans::close() noexcept
{
  const std::lock_guard<std::mutex> lock(mutex_);
  take_back();
  open_ = false;
}

/// Releases what has been returned; with the mutex locked.
void Loans::take_back() noexcept
{
  for (const Buffer buffer : returned_) backend_->release(buffer);
  returned_.clear();
}

void Loans::end(Loan &loan) noexcept
{
  const std::lock_guard<std::mutex> lock(mutex_);
  --loans_;
  if (loan.owns) returned_.push_back(loan.buffer);
  ended_ = true;
  if (open_ || !loan.owns) return;
  try {
    backend_->synchronize_device();
  } catch (const Error &) {  // the device is lost
  }
  take_back();
}

}  // namespace cama
