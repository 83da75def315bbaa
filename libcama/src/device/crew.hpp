// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <atomic>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace cama {

/// Threads that do the same work at once, each time they are asked to. The calling thread is the first of them.
class Crew {
public:
  explicit Crew(int threads);
  ~Crew();
  Crew(const Crew &) = delete;
  Crew &operator=(const Crew &) = delete;

  int size() const { return static_cast<int>(threads_.size()) + 1; }
  /// Calls work(member), member from 0 to size() - 1, and returns when all have returned. `work` may not throw.
  void run(const std::function<void(int)> &work);

private:
  void serve(int member);

  std::mutex mutex_;
  std::condition_variable called_, done_;
  const std::function<void(int)> *work_ = nullptr;
  std::atomic<long> call_{0};     // number of the call that is to be served
  std::atomic<int> at_work_{0};   // threads that have not returned from it
  std::atomic<bool> ended_{false};
  std::vector<std::thread> threads_;
};

}  // namespace cama
