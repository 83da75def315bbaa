// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "cama/backend.hpp"
#include "cama/checkpoint.hpp"
#include "cama/options.hpp"
#include "cama/report.hpp"
#include "cama/scene.hpp"
#include "cama/untangle.hpp"

namespace cama {

struct StageTime {
  std::string name;
  int depth;
  double milliseconds;
};  ///< of the last step
struct StreamInfo {
  std::string name;
  std::string element;
  std::size_t size, bytes;
};

struct Energy {
  double kinetic = 0, stretching = 0, bending = 0, gravity = 0;
};  ///< J

/// Contacts of the last step, ordered by their features; vertices in the numbering of all vertices.
struct ContactArrays {
  std::vector<std::array<int, 4>> vertices;  ///< vertex then face, or two edges
  std::vector<std::array<double, 4>> weights;  ///< signed barycentric weights
  std::vector<dvec3> normal;
  std::vector<double> distance;  ///< m
  std::vector<int> kind;  ///< 0 vertex-face, 1 edge-edge
};

/// Names of every stream that a simulation can have; see Simulation::streams.
const std::vector<std::string> &stream_names();

/// Backend, state and pipeline of one scene. Vertices: all cloths in order, then all obstacles.
class Simulation {
public:
  /// Level < scene < user: what the scene's options and the accuracy level leave to the user is in `options`; see
  /// resolve. Validates; throws before any kernel runs.
  explicit Simulation(const Scene &scene, const OptionOverrides &options = {});
  /// With these options, whatever the scene says of them.
  Simulation(const Scene &scene, const Options &options);
  ~Simulation();
  Simulation(Simulation &&) noexcept;
  Simulation &operator=(Simulation &&) noexcept;

  /// One time step. A step that the solver cannot do is taken back and done in halves, by default down to 1/16
  /// (StepReport::retries). Throws SolverError when that does not help either, CollisionError or BackendError; the
  /// state before the step stays.
  void step();
  /// Stage times are of work and not of enqueueing it: the device is waited for after every stage. Starts as true where
  /// the environment variable CAMA_WAIT_FOR_STAGES is set.
  void wait_for_stages(bool wait);
  double time_step() const;  ///< s
  int step_count() const;
  double time() const;

  int vertex_count() const;  ///< cloth and obstacles
  int cloth_vertex_count() const;
  const std::vector<Triangle> &faces() const;  ///< all, cloths first, indices into all vertices
  int cloth_triangle_count() const;
  std::vector<std::pair<int, int>> cloth_ranges() const;  ///< [first, last) vertices of each cloth
  std::vector<std::pair<int, int>> obstacle_ranges() const;

  std::vector<dvec3> positions() const;  ///< [all vertices], m
  std::vector<dvec3> velocities() const;  ///< [all vertices], m/s
  std::vector<double> masses() const;  ///< [cloth vertices], kg
  /// [cloth vertices] each, m and m/s. Throws SceneError, and CollisionError if the positions intersect, unless the
  /// option intersections is exempt or nothing can touch; then nothing was set.
  void set_state(const std::vector<dvec3> &positions, const std::vector<dvec3> &velocities);
  /// All that later steps depend on; contacts and report of the last step are not.
  Checkpoint checkpoint() const;
  /// Goes on from a checkpoint of the same scene: with the same options its steps are, bit by bit, those of the run
  /// that it was taken of, on any backend. Options may differ, the time step too. Throws SceneError if it is of another
  /// scene or damaged, or if pins have let go here of what it holds; CollisionError as set_state. Nothing is changed
  /// then.
  void restore(const Checkpoint &checkpoint);
  ContactArrays contacts() const;  ///< of the last step; empty after a step that failed

  const StepReport &report() const;
  std::vector<StageTime> timings() const;  ///< of the last step, pipeline order
  std::vector<StreamInfo> streams() const;  ///< every stream that outlives a stage
  std::vector<std::pair<std::string, std::string>> explain() const;  ///< stage name, why it is there
  std::vector<ChosenOption> chosen_options() const;  ///< those that trade accuracy for time, and who chose them
  Energy energy() const;
  double min_gap() const;  ///< smallest distance over candidate pairs of the last step, m; inf if none
  double max_strain() const;  ///< largest principal stretch minus one over all triangles
  int count_intersections()
      const;  ///< edge-triangle intersections, exact predicates (cloth with cloth only where contact.self is on); cloth
              ///< triangles that reach into exact spheres and capsules, cloth vertices below planes
  std::uint64_t state_hash() const;  ///< of cloth positions and velocities, bit for bit
  std::size_t peak_memory_bytes() const;  ///< of the device memory this simulation allocated
  const UntangleReport &
  untangled() const;  ///< what Options::intersections "untangle" did to the start; rounds 0: nothing to do
  const Options &options() const;
  const Backend &backend() const;

private:
  struct Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace cama
