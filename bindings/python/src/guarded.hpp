// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <memory>
#include <mutex>
#include <utility>

#include "cama/simulation.hpp"
#include "turns.hpp"

namespace cama::python {

/// A simulation that several Python threads may use, one at a time. The worlds of one object share their turns.
class Guarded {
public:
  Guarded(const Scene &scene, const OptionOverrides &options)
      : simulation_(std::make_shared<Simulation>(scene, options)), turns_(std::make_shared<Turns>())
  {
    simulation_->backend().leave_to(simulation_->backend().device_before());
  }
  Guarded(std::shared_ptr<Simulation> simulation, std::shared_ptr<Turns> turns)
      : simulation_(std::move(simulation)), turns_(std::move(turns))
  {}

  template <class Ask> auto with(Ask &&ask)
  {
    turns_->await_background();
    py::gil_scoped_release release;
    std::lock_guard<std::mutex> lock(turns_->mutex);
    const OnDevice device(simulation_->backend());
    return ask(*simulation_);
  }
  Turns &turns() { return *turns_; }
  const std::shared_ptr<Turns> &shared_turns() const { return turns_; }

private:
  std::shared_ptr<Simulation> simulation_;
  std::shared_ptr<Turns> turns_;
};

/// vertices, weights, normal, distance, kind, normal_force, tangential_force
py::tuple contact_arrays(ContactArrays contacts);

}  // namespace cama::python
