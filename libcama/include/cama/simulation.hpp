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
#include "cama/device_array.hpp"
#include "cama/options.hpp"
#include "cama/report.hpp"
#include "cama/scene.hpp"
#include "cama/untangle.hpp"

namespace cama {

struct StageTime {
  std::string name;
  int depth;            ///< 0: the step itself; its stages 1, theirs 2
  double milliseconds;  ///< in the last step
};
struct StreamInfo {
  std::string name;
  std::string element;
  std::size_t size, bytes;
};

/// J
struct Energy {
  double kinetic = 0, stretching = 0, bending = 0, gravity = 0;
  /// What enclosed gas can still do as work at constant temperature: until its pressure is that outside, or up to 1 m^3
  /// where there is none outside.
  double gas = 0;
};

/// Gas in a closed cloth.
struct GasState {
  int cloth;
  double volume;  ///< m^3
  double pressure;  ///< above that outside, Pa
  double amount;  ///< absolute pressure times volume, J
  double ambient;  ///< absolute pressure outside, Pa
};

/// What cloth exerts on an obstacle, or on what holds vertices.
struct Wrench {
  dvec3 force{0, 0, 0};  ///< N, mean over the last step
  dvec3 torque{0, 0, 0};  ///< N m, about the origin of the scene
  dvec3 impulse{0, 0, 0};  ///< N s, over the interval
  dvec3 angular_impulse{0, 0, 0};  ///< N m s, about the origin of the scene
};

/// Contacts of the last step, ordered by their features; vertices are numbered over all objects.
struct ContactArrays {
  std::vector<std::array<int, 4>> vertices;  ///< vertex then face, or two edges
  std::vector<std::array<double, 4>> weights;  ///< signed barycentric weights
  std::vector<dvec3> normal;
  std::vector<double> distance;  ///< m
  std::vector<int> kind;  ///< 0 vertex-face, 1 edge-edge
  std::vector<double> normal_force;  ///< N, along the normal on the first side; with the option forces, else empty
  std::vector<dvec3> tangential_force;  ///< N, friction on the first side
};

/// Names of all streams that a simulation can have; see Simulation::streams.
const std::vector<std::string> &stream_names();

/// Backend, state and pipeline of one scene. Vertices are those of all cloths in order, then of all obstacles.
class Simulation {
public:
  /// `options` override those of the scene, which override those of the accuracy level; see resolve. Validates the
  /// scene, and throws before any kernel runs.
  explicit Simulation(const Scene &scene, const OptionOverrides &options = {});
  /// With exactly these options; those of the scene are ignored.
  Simulation(const Scene &scene, const Options &options);
  ~Simulation();
  Simulation(Simulation &&) noexcept;
  Simulation &operator=(Simulation &&) noexcept;

  /// Takes one time step. A step that the solver cannot compute is undone and taken in halves, by default down to 1/16
  /// (StepReport::retries). Throws SolverError if that fails too, CollisionError or BackendError; the state is then
  /// that before the step.
  void step();
  /// Whether to wait for the device after every stage, so that stage times measure work and not its enqueueing.
  /// Initially true if the environment variable CAMA_WAIT_FOR_STAGES is set.
  void wait_for_stages(bool wait);
  /// s; with error control (Options::error) that of the last step, and before the first an initial guess.
  double time_step() const;
  /// Error in a frame of 1/60 s that time steps are chosen by, m; 0: all have one length.
  double error() const;
  /// With error control, whether the last step ended a frame of the scene (Scene::seconds_per_frame); else false.
  bool frame_ended() const;
  int step_count() const;
  double time() const;

  int vertex_count() const;  ///< cloth and obstacles
  int cloth_vertex_count() const;
  const std::vector<Triangle> &faces() const;  ///< of all objects, cloths first; indices into all vertices
  int cloth_triangle_count() const;
  std::vector<std::pair<int, int>> cloth_ranges() const;  ///< [first, last) vertices of each cloth
  std::vector<std::pair<int, int>> obstacle_ranges() const;

  std::vector<dvec3> positions() const;  ///< [all vertices], m
  std::vector<dvec3> velocities() const;  ///< [all vertices], m/s
  std::vector<double> masses() const;  ///< [cloth vertices], kg
  /// Sets positions, m, and velocities, m/s, [cloth vertices] each. Throws SceneError, or CollisionError if the
  /// positions intersect, unless the option intersections is exempt or nothing can touch; the state is then unchanged.
  void set_state(const std::vector<dvec3> &positions, const std::vector<dvec3> &velocities);
  void set_state(const DeviceVectors &positions, const DeviceVectors &velocities);
  // Driving: what is set between steps holds from the next step on. Vertices are those of the cloths, numbered through
  // all of them. Positions and poses are reached after `duration`, s (0: one time step), linearly in time, and held;
  // motion on the way is swept and divided as prescribed motion is. All throw SceneError where the arguments do not
  // fit; nothing has changed then.

  /// Holds vertices, and moves them to targets, [vertices], m; none: holds them where they are. Takes them from pins
  /// and attachments of the scene.
  void pin(const std::vector<int> &vertices, const std::vector<dvec3> &targets = {}, double duration = 0);
  /// Moves vertices that `pin` holds to positions, m.
  void set_targets(const std::vector<int> &vertices, const std::vector<dvec3> &positions, double duration = 0);
  /// Lets go of vertices that pins or attachments hold, also those of the scene. They keep their velocity.
  void release(const std::vector<int> &vertices);
  /// Fixes vertices to the nearest point of an obstacle's triangles, at their present offset.
  void attach(const std::vector<int> &vertices, int obstacle);
  /// Moves an obstacle to x -> rotation x + translation, m, of its vertices as the scene has them before any motion,
  /// or as set_obstacle_vertices left them. rotation: unit quaternion (w, x, y, z). Ends its prescribed rigid motion.
  void set_obstacle_pose(int obstacle, const dvec3 &translation, const std::array<double, 4> &rotation = {1, 0, 0, 0},
                         double duration = 0);
  /// Moves the vertices of an obstacle that is a mesh to positions, m. Ends its prescribed motion.
  void set_obstacle_vertices(int obstacle, const std::vector<dvec3> &positions, double duration = 0);
  /// Where a rigid obstacle (Obstacle::rigid) is. Throws SceneError for another.
  RigidPose rigid_pose(int obstacle) const;
  /// Forces on vertices, N, until they are set anew.
  void set_force(const std::vector<int> &vertices, const std::vector<dvec3> &forces);
  void set_force(const std::vector<int> &vertices, const DeviceVectors &forces);
  void set_gravity(const dvec3 &gravity);  ///< m/s^2
  void set_wind(const dvec3 &velocity);  ///< m/s; the scene must have a wind
  void set_pressure(int cloth, double pressure);  ///< Pa, as Cloth::pressure
  /// amount: absolute pressure times volume, J. ambient: absolute pressure outside, Pa. The cloth must have gas.
  void set_gas(int cloth, double amount, double ambient);
  dvec3 gravity() const;  ///< m/s^2
  std::vector<double> pressures() const;  ///< [cloths] Pa
  dvec3 wind() const;  ///< m/s; zero if the scene has none
  std::vector<GasState> gas() const;  ///< of all cloths that have gas
  /// [cloth triangles] along warp and weft and twice the twist, 1/m; zero where the material has no yield curvature.
  std::vector<dvec3> plastic_curvature() const;

  /// All data that later steps depend on, which contacts and report of the last step are not.
  Checkpoint checkpoint() const;
  /// Continues from a checkpoint of the same scene: with the same options the steps are, bit by bit, those of the run
  /// that it was taken from, on any backend. Options may differ, also the time step. Throws SceneError if it is of
  /// another scene or damaged; CollisionError as set_state. The state is then unchanged.
  void restore(const Checkpoint &checkpoint);
  ContactArrays contacts() const;  ///< of the last step; empty after a step that failed

  // Forces, with the option forces; without it they throw SceneError. They act on what is prescribed: on a body, on
  // what holds a pin. A free vertex has what nothing received, which the commit took from it against other cloth or
  // BDF2 did not carry on after a blow: over all vertices the impulses are the momentum that left the cloth.

  std::vector<dvec3> forces() const;  ///< [all vertices], N, mean over the last step
  std::vector<dvec3> impulses() const;  ///< [all vertices], N s, over the interval
  double interval() const;  ///< s, from begin_interval to now
  void begin_interval();  ///< the interval starts here, at first with the simulation
  Wrench force_on_obstacle(int obstacle) const;
  Wrench force_on_vertices(const std::vector<int> &vertices) const;  ///< cloth vertices that are held

  // Arrays on the device, for other libraries there; nothing is copied while the simulation does not write to what is
  // lent. With OpenCL, whose memory has no address, they throw BackendError.

  DeviceArray device_positions();  ///< [all vertices], m
  DeviceArray device_velocities();  ///< [all vertices], m/s
  DeviceArray device_forces();  ///< as `forces`
  /// Vectors of another library on the device, in double precision; count: their number. Throws SceneError.
  std::vector<dvec3> download(const char *what, const DeviceVectors &vectors, int count);

  const StepReport &report() const;
  std::vector<StageTime> timings() const;  ///< of the last step, pipeline order
  std::vector<StreamInfo> streams() const;  ///< every stream that lives longer than a stage
  std::vector<std::pair<std::string, std::string>> explain() const;  ///< name of each stage and why the scene needs it
  std::vector<ChosenOption> chosen_options() const;  ///< those that trade accuracy for time, with who chose them
  Energy energy() const;
  /// smallest distance over the candidate pairs of the last step, m; infinity if there are none
  double min_gap() const;
  double max_strain() const;  ///< largest principal stretch minus one over all triangles
  /// Edge-triangle intersections by exact predicates (cloth with cloth only if contact.self is on), plus cloth
  /// triangles that reach into exact spheres and capsules, and cloth vertices below planes.
  int count_intersections() const;
  std::uint64_t state_hash() const;  ///< of cloth positions and velocities, bit for bit
  std::size_t peak_memory_bytes() const;  ///< of the device memory that this simulation allocated
  /// What Options::intersections = untangle did to the start; rounds 0: there was nothing to do.
  const UntangleReport &untangled() const;
  const Options &options() const;
  const Backend &backend() const;

private:
  friend class Worlds;
  struct Implementation;
  /// On a device that others use too.
  Simulation(const Scene &scene, const ResolvedOptions &options, std::unique_ptr<Backend> device);

  // For Worlds: what driving checks first, and arrays of all worlds.

  /// As `restore`, from a checkpoint that this simulation has taken: it is not checked.
  void restore_own(const Checkpoint &checkpoint);
  void check_pin(const std::vector<int> &vertices, const std::vector<dvec3> &targets, double duration) const;
  void check_targets(const std::vector<int> &vertices, const std::vector<dvec3> &positions, double duration) const;
  void check_release(const std::vector<int> &vertices) const;
  void check_pose(int obstacle, const dvec3 &translation, const std::array<double, 4> &rotation, double duration) const;
  void check_force(const std::vector<int> &vertices, const std::vector<dvec3> &forces) const;
  void check_gravity(const dvec3 &gravity) const;
  void check_wind(const dvec3 &velocity) const;
  enum class Field { positions, velocities, forces };
  DeviceArray device_memory(int size);
  void copy_to(void *address, Field field);  ///< [all vertices], on the device

  std::unique_ptr<Implementation> implementation_;
};

}  // namespace cama
