// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstddef>
#include <functional>
#include <memory>

namespace cama {

/// A function with a stack of its own, which can pause and go on. It runs in the thread that resumes it, and must
/// always be resumed by the same one.
class Fiber {
public:
  Fiber();  ///< throws MemoryError if there is no memory for its stack
  ~Fiber();
  Fiber(const Fiber &) = delete;
  Fiber &operator=(const Fiber &) = delete;

  /// Whether this system can have them: not on Windows.
  static bool supported();

  /// Makes `work` what the next `resume` begins. It may not throw. The fiber must have finished before.
  void begin(std::function<void()> work);
  /// Runs until the work pauses or ends.
  void resume();
  /// Called by the work: returns to who resumed it.
  void pause();
  bool finished() const;

private:
  struct Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace cama
