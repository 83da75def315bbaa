// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <algorithm>
#include <utility>
#include <vector>

#include "cama/backend.hpp"
#include "cama/error.hpp"

namespace cama {

/// The paper's data stream: typed, sized, growable memory on one backend.
template <class T> class Stream {
public:
  using value_type = T;

  Stream() = default;
  explicit Stream(Backend &backend, int size = 0) : backend_(&backend) { resize(size); }
  Stream(Backend &backend, const std::vector<T> &values) : backend_(&backend) { assign(values); }
  Stream(Stream &&other) noexcept { swap(other); }
  Stream &operator=(Stream &&other) noexcept
  {
    swap(other);
    return *this;
  }
  ~Stream()
  {
    if (buffer_) backend_->release(buffer_);
  }

  int size() const { return size_; }
  int capacity() const { return capacity_; }
  std::size_t bytes() const { return sizeof(T) * static_cast<std::size_t>(capacity_); }
  Buffer buffer() const { return buffer_; }
  Backend *backend() const { return backend_; }

  /// Contents are lost if the stream has to grow; it grows by half, large ones by a sixteenth, so that repeated growth
  /// is rare.
  void resize(long long size)
  {
    const int wanted = checked(size);
    if (wanted > capacity_) reserve(capacity_ == 0 ? wanted : with_reserve(wanted));
    size_ = wanted;
  }
  void reserve(int capacity)
  {
    if (capacity <= capacity_) return;
    if (buffer_) backend_->release(std::exchange(buffer_, nullptr));
    capacity_ = size_ = 0;  // if allocation throws, the stream is empty
    buffer_ = backend_->allocate(sizeof(T) * static_cast<std::size_t>(capacity));
    capacity_ = capacity;
  }
  /// Like `resize`, but keeps the contents.
  void grow(long long size)
  {
    const int wanted = checked(size);
    if (wanted > capacity_) {
      Stream larger(*backend_);
      larger.reserve(with_reserve(wanted));
      if (size_) backend_->copy(larger.buffer_, buffer_, sizeof(T) * static_cast<std::size_t>(size_));
      swap(larger);
    }
    size_ = wanted;
  }
  void assign(const std::vector<T> &values)
  {
    resize(static_cast<int>(values.size()));
    if (size_) backend_->upload(buffer_, values.data(), sizeof(T) * values.size());
  }
  std::vector<T> download() const
  {
    std::vector<T> values(static_cast<std::size_t>(size_));
    if (size_) backend_->download(values.data(), buffer_, sizeof(T) * values.size());
    return values;
  }
  /// One element; waits for the device.
  T at(int index) const
  {
    T value;
    backend_->download(&value, buffer_, sizeof(T), sizeof(T) * static_cast<std::size_t>(index));
    return value;
  }
  void copy_from(const Stream &other)
  {
    resize(other.size_);
    if (size_) backend_->copy(buffer_, other.buffer_, sizeof(T) * static_cast<std::size_t>(size_));
  }
  void fill_zero()
  {
    if (size_) backend_->fill(buffer_, 0, sizeof(T) * static_cast<std::size_t>(size_));
  }
  /// Gives the memory away, which the caller has to release; the stream is empty then.
  Buffer give_up() noexcept
  {
    capacity_ = size_ = 0;
    return std::exchange(buffer_, nullptr);
  }
  void swap(Stream &other) noexcept
  {
    std::swap(backend_, other.backend_);
    std::swap(buffer_, other.buffer_);
    std::swap(size_, other.size_);
    std::swap(capacity_, other.capacity_);
  }

  /// Elements that a stream may have: the loops of kernels count beyond the last one by up to the number of work items.
  static constexpr int most = 0x7fffffff - (1 << 22);

private:
  /// A size that overflowed while it was summed as an int is negative.
  static int checked(long long size)
  {
    if (size < 0 || size > most) throw ListOverflow(" (" + std::to_string(size) + ")");
    return static_cast<int>(size);
  }
  static int with_reserve(int size)
  {
    const long long more = sizeof(T) * static_cast<std::size_t>(size) > (std::size_t(16) << 20) ? size / 16 : size / 2;
    return static_cast<int>(std::min<long long>(most, size + more));
  }
  Backend *backend_ = nullptr;
  Buffer buffer_ = nullptr;
  int size_ = 0, capacity_ = 0;
};

}  // namespace cama
