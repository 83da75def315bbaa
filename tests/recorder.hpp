// SPDX-License-Identifier: Apache-2.0
// A backend that counts the launches on another one, and may claim other work items than it has.
#pragma once
#include <algorithm>
#include <map>
#include <memory>
#include <string>
#include <utility>

#include "cama/backend.hpp"

class Recorder final : public cama::Backend {
public:
  using Buffer = cama::Buffer;
  explicit Recorder(std::unique_ptr<cama::Backend> inner) : inner_(std::move(inner)) {}
  std::string_view name() const override { return inner_->name(); }
  std::string device() const override { return inner_->device(); }
  bool wide_workers() const override { return !claimed_narrow && inner_->wide_workers(); }
  int workers() const override { return claimed_workers ? claimed_workers : inner_->workers(); }
  Buffer allocate(std::size_t bytes) override { return inner_->allocate(bytes); }
  void release(Buffer buffer) noexcept override { inner_->release(buffer); }
  void upload(Buffer to, const void *from, std::size_t bytes) override { inner_->upload(to, from, bytes); }
  void download(void *to, Buffer from, std::size_t bytes, std::size_t offset) override
  {
    inner_->download(to, from, bytes, offset);
  }
  void copy(Buffer to, Buffer from, std::size_t bytes) override { inner_->copy(to, from, bytes); }
  void fill(Buffer buffer, unsigned char byte, std::size_t bytes) override { inner_->fill(buffer, byte, bytes); }
  void launch(const cama::KernelKey &kernel, int n, const cama::Argument *arguments, int count) override
  {
    ++launches[kernel.name];
    most_items[kernel.name] = std::max(most_items[kernel.name], n);
    inner_->launch(kernel, n, arguments, count);
  }
  void scan(Buffer from, Buffer to, int n) override
  {
    ++launches["scan"];
    inner_->scan(from, to, n);
  }
  void sort(Buffer keys, Buffer values, int n, int bits) override
  {
    ++launches["sort"];
    inner_->sort(keys, values, n, bits);
  }
  void synchronize() override { inner_->synchronize(); }
  const cama::Backend &inner() const { return *inner_; }

  std::map<std::string, int> launches;   ///< by kernel, "scan" and "sort"
  std::map<std::string, int> most_items;   ///< of a launch, by kernel
  int claimed_workers = 0;
  bool claimed_narrow = false;   ///< as of a GPU

private:
  std::unique_ptr<cama::Backend> inner_;
};
