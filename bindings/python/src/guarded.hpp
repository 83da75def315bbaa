// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <memory>
#include <mutex>
#include <utility>

#include "bindings.hpp"
#include "cama/simulation.hpp"

namespace cama::python {

/// A simulation that several Python threads may use, one at a time; no thread waits for its lock while it holds the
/// GIL. The worlds of one object share a lock.
class Guarded {
public:
  Guarded(const Scene &scene, const OptionOverrides &options)
      : simulation_(std::make_shared<Simulation>(scene, options)), mutex_(std::make_shared<std::mutex>())
  {}
  Guarded(std::shared_ptr<Simulation> simulation, std::shared_ptr<std::mutex> mutex)
      : simulation_(std::move(simulation)), mutex_(std::move(mutex))
  {}

  template <class Ask> auto with(Ask &&ask)
  {
    py::gil_scoped_release release;
    std::lock_guard<std::mutex> lock(*mutex_);
    return ask(*simulation_);
  }

private:
  std::shared_ptr<Simulation> simulation_;
  std::shared_ptr<std::mutex> mutex_;
};

}  // namespace cama::python
