// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "cama/simulation.hpp"

namespace cama {

/// Simulations of many scenes that advance together: on a GPU their kernels run as one, on the CPU each thread takes
/// worlds in turn. Worlds do not touch or influence each other, and each ends in the same bits as alone. The scenes may
/// differ in everything; those that do the same work at the same time share launches.
class Worlds {
public:
  /// One world for each scene. options: of all worlds, or one for each. Their backend and device must be the same;
  /// `threads` is the number of host threads for all worlds, 0: of all cores. Throws what Simulation throws, with the
  /// number of the world in front.
  Worlds(const std::vector<Scene> &scenes, const std::vector<OptionOverrides> &options);
  ~Worlds();
  Worlds(Worlds &&) noexcept;
  Worlds &operator=(Worlds &&) noexcept;

  int size() const;
  /// A world with all that a simulation can: its state can be read and set, it can be driven and restored. It may also
  /// take steps alone.
  Simulation &operator[](int world);
  const Simulation &operator[](int world) const;

  /// Takes one time step in every world that is not frozen, each of its own length. A world whose step throws is frozen
  /// in the state before that step; the others go on. Throws BackendError only when the device is lost.
  void step();
  /// As `step`, up to the end of a frame in every world.
  void step_frame();

  /// Whether a step of this world failed since its last reset.
  bool frozen(int world) const;
  /// What froze it: rethrows the error; without one does nothing.
  void rethrow(int world) const;
  /// Returns worlds to the start of their scenes, with nothing driven; those that are frozen go on.
  void reset(const std::vector<int> &worlds);
  /// Simulation::set_state of several worlds at once; one row of each argument for each. Throws the error of the first
  /// world that refuses; its state is unchanged, the others are set.
  void set_state(const std::vector<int> &worlds, const std::vector<std::vector<dvec3>> &positions,
                 const std::vector<std::vector<dvec3>> &velocities);

  /// Vertices of world w are [first_vertex(w), first_vertex(w + 1)) in the arrays of all worlds.
  int first_vertex(int world) const;
  std::vector<dvec3> positions() const;  ///< [vertices of all worlds], m
  std::vector<dvec3> velocities() const;  ///< [vertices of all worlds], m/s
  long launches() const;  ///< on the device since the start, of all worlds

private:
  struct Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace cama
