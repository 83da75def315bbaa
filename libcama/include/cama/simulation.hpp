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
#include "cama/scene.hpp"
#include "cama/untangle.hpp"

namespace cama {

enum class Assembly { gather, algorithm1, sorted };  ///< static pattern; the paper's Algorithm 1; collect, sort, reduce
enum class Preconditioner {
  none,
  jacobi,
  block_jacobi,
  schwarz
};  ///< schwarz: multilevel additive, blocks of 16 strongly coupled vertices
enum class Pinch { stop, release };  ///< cloth caught between moving obstacles or pins without a way out
enum class SearchKind { tree, fronts };  ///< trees searched from the root; the paper's fronts
enum class LinearSolver { conjugate_gradient, direct };
enum class Integrator { backward_euler, bdf2 };  ///< bdf2: second order in the time step, less damping
enum class ContactRefresh { step, iteration };  ///< how often the closest points of contacts are found
/// What becomes of a start in which cloth intersects something: refused; simulated as it is; cloth moved first (refused
/// if some is left).
enum class StartPolicy { reject, exempt, untangle };

/// How to compute; what to compute is the Scene. The defaults are those of accuracy "production".
struct Options {
  std::string backend = "auto";
  int device = 0;
  int threads = 0;  ///< of the CPU backend; 0: useful_threads of the scene. No bit depends on them
  /// "double"; "mixed": forces, matrix and residual double, the solve single with refinement; "single": all of these.
  /// State and collision are double always. Mixed is for the Schwarz preconditioner; others solve in the matrix's
  /// precision.
  std::string precision = "mixed";
  /// One of accuracy_levels(): what the other options start as. docs/accuracy-levels.md says what each level sets.
  std::string accuracy = "production";
  double time_step = 0;  ///< s; 0: the level's (see chosen_time_step)
  Integrator integrator = Integrator::backward_euler;
  int newton_iterations = 1;  ///< at most, a step; 1: the linearised step
  double newton_tolerance =
      1e-3;  ///< of the nonlinear equation, relative to the forces in it; StepReport::newton_residual
  ContactRefresh contact_refresh = ContactRefresh::step;  ///< iteration: at every Newton iterate
  Assembly assembly = Assembly::gather;
  bool atomic_filling = false;  ///< Algorithm 1 as printed: fill with floating-point atomics (order, hence bits, vary)
  ContactForm contact_form =
      ContactForm::rank_one;  ///< of the penalty in the matrix: consistent, or the paper's star of springs
  bool anticipate_contacts =
      true;  ///< contacts also for pairs that would close within the step; false: distance alone (paper)
  SearchKind search = SearchKind::tree;  ///< how candidate pairs are found; the pairs are the same
  bool localized_search =
      true;  ///< with fronts, when few vertices leave their boxes: search only near those (Figure 8)
  Preconditioner preconditioner = Preconditioner::schwarz;
  LinearSolver solver = LinearSolver::conjugate_gradient;
  double tolerance = 1e-3;  ///< of the solve, relative, in the preconditioned norm
  int max_iterations = 5000;  ///< of one solve
  int max_impact_passes = 8;  ///< rounds of continuous detection and inelastic projection
  bool linear_impacts =
      false;  ///< impacts as one linear system with an active set (paper); false: impulses that only push
  bool cubic_impacts =
      false;  ///< impacts by the coplanarity cubic at distance 0 (paper); false: additive, at the certified distance
  bool commit = true;  ///< certified commit at the end of every step
  bool arcsim_conventions =
      false;  ///< as ARCSim: bending at the signed curvature, extrapolated below zero; wind on the rest area
  StartPolicy intersections = StartPolicy::reject;  ///< of the start
  Pinch pinch =
      Pinch::stop;  ///< stop: CollisionError; release: obstacles let go of the caught cloth until it has come free
  bool audit = false;  ///< count intersections after every step

  /// Sets every option that the named accuracy fixes. Throws SceneError listing the names.
  static Options preset(const std::string &accuracy);
};

/// Names of the accuracy levels: preview, interactive, production, accurate, reference, paper.
const std::vector<std::string> &accuracy_levels();

/// The time step that a simulation takes, s: Options::time_step; where it is 0, the scene's at the levels production
/// and paper; where that is 0 too, the level's, shortened so that whole steps fill a frame. accurate and reference
/// never take a longer one than the scene's. preview 1/120, interactive 1/240, paper 1/200; production sqrt(edge
/// / 1.5e5 m/s^2), 1/960 at most and 1/2880 at least, with the mean length of the cloth's edges; accurate a fifth and
/// reference a twentieth of that.
double chosen_time_step(const Options &options, const Scene &scene);

/// An option that trades accuracy for time, as it was chosen.
struct Setting {
  std::string name, value;
  std::string origin;  ///< "level", "scene" or "user"
  std::string trades;  ///< what for what
};
/// All of them for a scene. An option that differs from its level's is the user's.
std::vector<Setting> settings(const Options &options, const Scene &scene);

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

/// What the last step did.
struct StepReport {
  int step = 0;
  double time = 0;  ///< s, at the end of the step
  int contacts = 0;  ///< proximity contacts in the matrix
  int candidates = 0;  ///< pairs examined
  int searches = 0;  ///< candidate searches: more than one where motion left the boxes of the first
  int impacts = 0;  ///< found by continuous detection in the first pass
  int impact_passes = 0;
  int truncated = 0;  ///< vertices whose motion the commit cut, summed over substeps
  double lost_motion =
      0;  ///< mean fraction of motion that the commit cut, over all cloth vertices, summed over substeps
  int released = 0;  ///< cloth vertices that pinching obstacles let go of in this step
  int exempt = 0;  ///< pairs that contact passes over after this step, seams aside
  int substeps = 1;  ///< pieces that moving obstacles divided the step into
  int retries = 0;  ///< attempts that failed and were taken back; the step was then made of shorter ones
  int newton_iterations = 1;  ///< solves of the step
  double newton_residual = -1;  ///< of the nonlinear equation, relative to the forces in it; -1: not computed
  int iterations = 0;  ///< of the linear solves
  double residual = 0;  ///< of the last linear solve: sqrt(r' P r) relative to its start (Schwarz: computed afresh);
                        ///< direct: |A v - b| / |b|
  double milliseconds = 0;
  long launches = 0;  ///< of kernels; what a backend's scan and sort launch is counted too
  long waits = 0;  ///< times the host waited for the device
  int intersections = -1;  ///< -1: not audited
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

/// Backend, state and pipeline of one scene. Vertices: all cloths in order, then all obstacles.
class Simulation {
public:
  explicit Simulation(const Scene &scene, const Options &options = {});  ///< validates; throws before any kernel runs
  ~Simulation();
  Simulation(Simulation &&) noexcept;
  Simulation &operator=(Simulation &&) noexcept;

  /// One time step. A step that the solver cannot do is taken back and done in halves, down to 1/16
  /// (StepReport::retries). Throws SolverError when that does not help either, CollisionError or BackendError; the
  /// state before the step stays.
  void step();
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
  std::vector<Setting> settings() const;  ///< options that trade accuracy for time, and who chose them
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
