// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <mutex>
#include <thread>

#include "bindings.hpp"

namespace cama::python {

/// One thread at a time uses a simulation, or the worlds of one object. Who asks while steps are taken in the
/// background waits for all of them, except the thread that takes them. No thread waits while it holds the GIL.
class Turns {
public:
  std::mutex mutex;  // of the simulation

  void begin_background() { ++background_; }
  void end_background()
  {
    {
      const std::lock_guard<std::mutex> lock(waiting_);
      --background_;
    }
    ended_.notify_all();
  }
  void set_worker() { worker_ = std::this_thread::get_id(); }
  bool is_worker() const { return worker_ == std::this_thread::get_id(); }

  /// Waits for the steps in the background. Ctrl-C ends it.
  void await_background()
  {
    while (background_ > 0 && !is_worker()) {
      {
        const py::gil_scoped_release release;
        std::unique_lock<std::mutex> lock(waiting_);
        ended_.wait_for(lock, std::chrono::milliseconds(50), [this] { return background_ == 0; });
      }
      if (PyErr_CheckSignals() != 0) throw py::error_already_set();
    }
  }

private:
  std::atomic<int> background_{0};
  std::atomic<std::thread::id> worker_{};
  std::mutex waiting_;
  std::condition_variable ended_;
};

template <class Class> void bind_turns(Class &bound)
{
  using Owner = typename Class::type;
  bound.def("begin_background", [](Owner &o) { o.turns().begin_background(); })
      .def("end_background", [](Owner &o) { o.turns().end_background(); })
      .def("set_worker", [](Owner &o) { o.turns().set_worker(); })
      .def("is_worker", [](Owner &o) { return o.turns().is_worker(); });
}

}  // namespace cama::python
