// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "cama/simulation.hpp"

namespace cama {

/// Simulations of many scenes that advance together: on a GPU side by side, many in one launch, on the CPU each thread
/// takes worlds in turn. Worlds do not touch or influence each other, and each ends in the same bits as alone. The
/// scenes may differ in everything.
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

  /// Takes time steps in every world that is not frozen, each of its own length; worlds do not wait for each other
  /// between them. A world whose step throws is frozen in the state before that step; the others go on. Throws
  /// BackendError only when the device is lost.
  void step(int steps = 1);
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

  // Driving, as the functions of Simulation that have these names: one row of each argument for each of the worlds.
  // They throw SceneError with the world in front where an argument does not fit; no world has changed then.

  using Vertices = std::vector<std::vector<int>>;
  using Vectors = std::vector<std::vector<dvec3>>;
  void pin(const std::vector<int> &worlds, const Vertices &vertices, const Vectors &targets, double duration = 0);
  void set_targets(const std::vector<int> &worlds, const Vertices &vertices, const Vectors &positions,
                   double duration = 0);
  void release(const std::vector<int> &worlds, const Vertices &vertices);
  void set_force(const std::vector<int> &worlds, const Vertices &vertices, const Vectors &forces);
  void set_obstacle_pose(const std::vector<int> &worlds, const std::vector<int> &obstacle,
                         const std::vector<dvec3> &translation, const std::vector<std::array<double, 4>> &rotation,
                         double duration = 0);
  void set_gravity(const std::vector<int> &worlds, const std::vector<dvec3> &gravity);
  void set_wind(const std::vector<int> &worlds, const std::vector<dvec3> &velocity);

  // Measurements, as of Simulation: one for each of the worlds.

  std::vector<dvec3> gravity() const;  ///< [all worlds]
  std::vector<dvec3> wind() const;  ///< [all worlds]
  std::vector<Wrench> force_on_obstacle(const std::vector<int> &worlds, const std::vector<int> &obstacle) const;
  std::vector<Wrench> force_on_vertices(const std::vector<int> &worlds, const Vertices &vertices) const;
  std::vector<ContactArrays> contacts(const std::vector<int> &worlds) const;

  /// Vertices of world w are [first_vertex(w), first_vertex(w + 1)) in the arrays of all worlds.
  int first_vertex(int world) const;
  std::vector<dvec3> positions() const;  ///< [vertices of all worlds], m
  std::vector<dvec3> velocities() const;  ///< [vertices of all worlds], m/s
  std::vector<dvec3> forces() const;  ///< [vertices of all worlds], N; see Simulation::forces
  std::vector<dvec3> impulses() const;  ///< [vertices of all worlds], N s
  // The same on the device, in memory of their own.
  DeviceArray device_positions();
  DeviceArray device_velocities();
  DeviceArray device_forces();
  long launches() const;  ///< on the device since the start, of all worlds

private:
  struct Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace cama
