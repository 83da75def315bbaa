// SPDX-License-Identifier: Apache-2.0
#include "device/crew.hpp"

#include <algorithm>
#include <chrono>

#include "device/rest.hpp"

namespace cama {
namespace {

/// Calls follow each other as soon as the device has done its part, within a millisecond: a thread that sleeps comes
/// too late.
constexpr std::chrono::microseconds patience{2000};

template <class Condition> bool soon(Condition &&condition)
{
  constexpr int looks_between_times = 64;
  const auto end = std::chrono::steady_clock::now() + patience;
  do {
    for (int i = 0; i < looks_between_times; ++i) {
      if (condition()) return true;
      rest();
    }
  } while (std::chrono::steady_clock::now() < end);
  return false;
}

}  // namespace

Crew::Crew(int threads)
{
  for (int member = 1; member < std::max(1, threads); ++member)
    threads_.emplace_back([this, member] { serve(member); });
}

Crew::~Crew()
{
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    ended_ = true;
  }
  called_.notify_all();
  for (std::thread &thread : threads_) thread.join();
}

void Crew::run(const std::function<void(int)> &work)
{
  if (threads_.empty()) return work(0);
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    work_ = &work;
    at_work_ = static_cast<int>(threads_.size());
    ++call_;
  }
  called_.notify_all();
  work(0);
  const auto returned = [this] { return at_work_ == 0; };
  if (soon(returned)) return;
  std::unique_lock<std::mutex> lock(mutex_);
  done_.wait(lock, returned);
}

void Crew::serve(int member)
{
  long served = 0;
  while (true) {
    const auto called = [&] { return call_ != served || ended_; };
    if (!soon(called)) {
      std::unique_lock<std::mutex> lock(mutex_);
      called_.wait(lock, called);
    }
    if (ended_) return;
    ++served;
    (*work_)(member);
    if (--at_work_ > 0) continue;
    const std::lock_guard<std::mutex> lock(mutex_);
    done_.notify_all();
  }
}

}  // namespace cama
