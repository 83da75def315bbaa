// SPDX-License-Identifier: Apache-2.0
// All data that lives longer than a stage, in rooms. Names of streams follow the paper's Figure 4;
// docs/developer/architecture.md has the table. A stage declares the rooms that it accesses (access.hpp) and cannot
// access others.
#pragma once
#include <memory>
#include <string>
#include <type_traits>
#include <vector>

#include "cama/options.hpp"
#include "cama/report.hpp"
#include "cama/scene.hpp"
#include "cama/stream.hpp"
#include "device/kernels.hpp"
#include "model/exemptions.hpp"
#include "model/incidence.hpp"
#include "model/life.hpp"
#include "model/rigid_body.hpp"

namespace cama {

template <class T> struct IsStream : std::false_type {};
template <class T> struct IsStream<Stream<T>> : std::true_type {};

/// The times of a step, s.
struct Clock {
  double now = 0;  // at the start of the step; at its end from FinishStep on
  double step = 0;  // the time step
  double start = 0;  // now = start + (number of the step - start_step) step
  int start_step = 0;
  int division = 0;  // a failed step is done in pieces; this one is 1/2^division of it
  double implicit_step = 0;  // h of v = v* + h M^-1 f(x* + h v): step, or a share of it with a history
  bool predicted = false;  // BDF2: the step is linearised at a predicted state, otherwise at its base
  bool multistep = false;  // BDF2: this step uses the previous state
  bool history = false;  // BDF2: the next step may use this one
  double step_before = 0;  // BDF2: time step of the last step
  double memory = 0;  // BDF2: share of the last change of the state that the base of this step carries on
  double ratio = 0;  // BDF2: of the step to the last one
  // Error control; 0 without it.
  double error = 0;  // m in a frame of 1/60 s
  double frame = 0;  // s, which whole steps fill
  double shortest = 0, longest = 0;  // s, of a step
  double end = 0;  // s, of the step
  double step_error = 0;  // m, of the step: an estimate
  double wanted = 0;  // s, longest next step
  double last_share = 0;  // of the error that was allowed in the last step
  int stretched = 0;  // edges of cloth that the step makes much longer
  double max_by_stretch = 0;  // s, longest next step after one was too long for edges; 0: none was

  template <class F> void visit(F &&f)
  {
    f("time", Life::run, now);
    f("time_step", Life::scene, step);
    f("start_time", Life::run, start);
    f("start_step", Life::run, start_step);
    f("division", Life::step, division);
    f("implicit_step", Life::step, implicit_step);
    f("predicted", Life::scene, predicted);
    f("multistep", Life::step, multistep);
    f("history", Life::run, history);
    f("step_before", Life::run, step_before);
    f("memory", Life::step, memory);
    f("ratio", Life::step, ratio);
    f("error", Life::scene, error);
    f("frame", Life::scene, frame);
    f("shortest_step", Life::scene, shortest);
    f("longest_step", Life::scene, longest);
    f("step_end", Life::step, end);
    f("step_error", Life::step, step_error);
    f("wanted_step", Life::run, wanted);
    f("last_share", Life::run, last_share);
    f("stretched", Life::step, stretched);
    f("max_step_by_stretch", Life::run, max_by_stretch);
  }
};

/// Vertices of cloth, then of obstacles, with their positions and connections.
struct MeshState {
  int cloth_vertices = 0, vertices = 0;
  int triangles = 0, hinges = 0;  // of cloth
  int faces = 0, edges = 0;  // of cloth and obstacles
  int pin_changes = 0;  // number of times that vertices were pinned or released
  int motion_changes = 0;  // number of times that static obstacles began to move
  Stream<dvec3> position, velocity;  // [vertices] m, m/s at the start of the step
  Stream<dvec3> position_next, velocity_next;  // [vertices] at the end of the step
  // [vertices] with BDF2: at the start of the previous step; of a vertex that penetration handling moved since, the
  // state from which it would have come to the present one
  Stream<dvec3> position_before, velocity_before;
  Stream<dvec3> position_base, velocity_base;  // [vertices] with BDF2: x*, v*
  // [cloth vertices] m/s, with BDF2 in a step with contacts, else empty: by what contact stopped abruptly
  Stream<dvec3> abrupt_change;
  Stream<dvec3> rest_position;  // [vertices] obstacles before their motion, if any moves rigidly
  Stream<double> inverse_mass;  // [vertices] 1/kg; 0: prescribed; with contact
  Stream<int> fixed;  // [vertices] 1: prescribed
  Stream<kernels::face_nodes> face;  // cloth, then obstacles; with contact
  Stream<kernels::edge_nodes> edge;
  Stream<kernels::edge_nodes> edge_wing;  // [edges] the vertices beside the edge in its faces, -1 where it has none
  std::vector<std::string> object_name;  // "cloth 'shirt'": cloths, then obstacles
  std::vector<int> object_first;  // their first vertices
  std::vector<char> object_static;  // 1: an obstacle that never moves

  /// Index of the object that a vertex belongs to: cloths, then obstacles.
  int object_of(int vertex) const;
  /// "cloth 'shirt', vertex 12": a vertex in the numbering of its own object.
  std::string describe(int vertex) const;
  /// The positions at which the first solve of the step is linearised.
  const Stream<dvec3> &linearised_position(const Clock &time) const
  {
    return time.predicted ? position_next : base_position(time);
  }
  /// x*, v* of this step.
  const Stream<dvec3> &base_position(const Clock &time) const { return time.multistep ? position_base : position; }
  const Stream<dvec3> &base_velocity(const Clock &time) const { return time.multistep ? velocity_base : velocity; }

  template <class F> void visit(F &&f)
  {
    f("position", Life::run, position);
    f("velocity", Life::run, velocity);
    f("position_next", Life::step, position_next);
    f("velocity_next", Life::step, velocity_next);
    f("position_before", Life::run, position_before);
    f("velocity_before", Life::run, velocity_before);
    f("position_base", Life::step, position_base);
    f("velocity_base", Life::step, velocity_base);
    f("abrupt_change", Life::step, abrupt_change);
    f("rest_position", Life::scene, rest_position);
    f("inverse_mass", Life::scene, inverse_mass);
    f("fixed", Life::scene, fixed);
    f("face", Life::scene, face);
    f("edge", Life::scene, edge);
    f("edge_wing", Life::scene, edge_wing);
  }
};

/// What acts on cloth without contact: elasticity, stitches, gravity, wind.
struct ElementState {
  Stream<kernels::element_nodes> triangle_nodes, hinge_nodes;
  Incidence triangle_incidence, hinge_incidence;
  int stitches = 0;
  Stream<kernels::stitch> stitch;
  Stream<dvec3> gravity, wind;  // [1] m/s^2, m/s; wind: with wind or mass damping, the velocity of the air
  Stream<double> areal_density;  // [cloths] kg/m^2, with wind
  Stream<double> pressure;  // [cloths] Pa, where the scene or a driver gives one
  Stream<dvec3> driven_force;  // [cloth vertices] N, once a driver has set one
  std::vector<double> damping;  // [cloths], s
  // [triangles] (11, 22, 2 12) 1/m, with a yield curvature: at the start of the step and at its end
  Stream<dvec3> plastic_curvature, plastic_curvature_next;

  template <class F> void visit(F &&f)
  {
    f("triangle_nodes", Life::scene, triangle_nodes);
    f("hinge_nodes", Life::scene, hinge_nodes);
    f("triangle_incidence.row", Life::scene, triangle_incidence.row);
    f("triangle_incidence.entry", Life::scene, triangle_incidence.entry);
    f("hinge_incidence.row", Life::scene, hinge_incidence.row);
    f("hinge_incidence.entry", Life::scene, hinge_incidence.entry);
    f("stitch", Life::scene, stitch);
    f("gravity", Life::scene, gravity);
    f("wind", Life::scene, wind);
    f("areal_density", Life::scene, areal_density);
    f("pressure", Life::scene, pressure);
    f("driven_force", Life::scene, driven_force);
    f("plastic_curvature", Life::run, plastic_curvature);
    f("plastic_curvature_next", Life::step, plastic_curvature_next);
  }
};

/// Candidate pairs of one kind.
struct PairList {
  Stream<kernels::pair> pairs;
  Stream<kernels::fvec3> direction;  // [pairs] a direction that separates the sides, from B to A
  // [pairs] lower bound of the distance along `direction` until the prediction, m; 0: unknown; below 0: an impact of
  // this step
  Stream<float> gap_bound;

  template <class F> void visit(const char *const (&name)[3], F &&f)
  {
    f(name[0], Life::step, pairs);
    f(name[1], Life::step, direction);
    f(name[2], Life::step, gap_bound);
  }
};

/// Friction of contacts at the end of a step, with friction and several solves a step; else without a backend.
struct KeptFriction {
  Stream<key64> key;  // [contacts] features of each contact, ascending
  Stream<dvec3> force;  // [contacts] N on side A

  void set_up(Backend &backend)
  {
    key = Stream<key64>(backend);
    force = Stream<dvec3>(backend);
  }
  void resize(int size)
  {
    key.resize(size);
    force.resize(size);
  }
  void swap(KeptFriction &other) noexcept
  {
    key.swap(other.key);
    force.swap(other.force);
  }
  void copy_from(const KeptFriction &other)
  {
    if (!other.key.backend()) return;
    if (!key.backend()) set_up(*other.key.backend());
    key.copy_from(other.key);
    force.copy_from(other.force);
  }
  void forget() noexcept
  {
    if (key.backend()) resize(0);
  }
};

/// Pairs that may touch, contacts and impacts.
struct ContactState {
  Contact settings;  // of the scene
  bool friction = false;  // some contact has friction
  double largest_thickness = 0;  // largest contact thickness of any vertex, m
  Stream<kernels::vertex_contact> vertex_contact;
  PairList vertex_face, edge_edge;
  int contacts = 0;
  Stream<kernels::contact> contact;
  Stream<dvec3> abrupt;  // [contacts] N s on side A, with BDF2: the part of the impulse that stopped motion abruptly
  // [contacts] N s on side A, with rigid bodies and several solves: by which the equation that the last solve has
  // solved differs from the forces of contacts at its solution; else empty
  Stream<dvec3> remainder;
  Stream<kernels::impact> impact;
  KeptFriction kept, kept_next;  // of the last step, of this one

  /// Removes all contacts and candidates.
  void forget() noexcept;

  template <class F> void visit(F &&f)
  {
    f("vertex_contact", Life::scene, vertex_contact);
    vertex_face.visit({"vertex_face.pairs", "vertex_face.direction", "vertex_face.gap_bound"}, f);
    edge_edge.visit({"edge_edge.pairs", "edge_edge.direction", "edge_edge.gap_bound"}, f);
    f("contacts", Life::step, contacts);
    f("contact", Life::step, contact);
    f("abrupt", Life::step, abrupt);
    f("remainder", Life::step, remainder);
    f("impact", Life::step, impact);
    f("kept.key", Life::step, kept.key);  // a checkpoint holds it by pairs
    f("kept.force", Life::step, kept.force);
    f("kept_next.key", Life::step, kept_next.key);
    f("kept_next.force", Life::step, kept_next.force);
  }
};

/// Where vertices may be during the step, by which candidate pairs are searched for.
struct BoundsState {
  Stream<dvec3> predicted;  // [vertices] ballistic end of the step
  Stream<int> query_vertices;  // vertices that are tested against faces: all but those that define planes
  Stream<double> margin;  // [vertices] by which boxes are inflated, m
  Stream<dvec3> bounds;  // [2] of the scene
  // [2] if obstacles are at rest, the bounds when their boxes were made, which boxes are relative to
  Stream<dvec3> origin;
  Stream<kernels::box> vertex_box;
  const Stream<dvec3> &box_origin() const { return origin.size() ? origin : bounds; }

  template <class F> void visit(F &&f)
  {
    f("predicted", Life::step, predicted);
    f("query_vertices", Life::scene, query_vertices);
    f("margin", Life::scene, margin);
    f("bounds", Life::step, bounds);
    f("origin", Life::step, origin);
    f("vertex_box", Life::step, vertex_box);
  }
};

/// Faces and edges of some objects along the Morton curve, under trees with eight children to a node.
struct FeatureTrees {
  Stream<int> face_order, edge_order;  // leaf to primitive
  Stream<kernels::bvh8_node> face_bvh, edge_bvh;

  template <class F> void visit(const char *const (&name)[4], F &&f)
  {
    f(name[0], Life::step, face_order);
    f(name[1], Life::step, edge_order);
    f(name[2], Life::step, face_bvh);
    f(name[3], Life::step, edge_bvh);
  }
};

/// The room of TreeSearch.
struct TreeState {
  FeatureTrees cloth, moving, resting;  // of the cloth, of moving obstacles, of static ones

  template <class F> void visit(F &&f)
  {
    cloth.visit({"trees.cloth.face_order", "trees.cloth.edge_order", "trees.cloth.face_bvh", "trees.cloth.edge_bvh"},
                f);
    moving.visit(
        {"trees.moving.face_order", "trees.moving.edge_order", "trees.moving.face_bvh", "trees.moving.edge_bvh"}, f);
    resting.visit(
        {"trees.resting.face_order", "trees.resting.edge_order", "trees.resting.face_bvh", "trees.resting.edge_bvh"},
        f);
  }
};

/// The room of FrontSearch.
struct FrontState {
  Stream<kernels::box> face_box, edge_box;
  Stream<kernels::box> face_tree, obstacle_tree;  // binary trees of the cloth and of the obstacles
  Stream<int> face_order, obstacle_order;  // leaf to face
  Stream<kernels::face_features> face_features;
  Stream<kernels::pair> front, self_front;  // of cloth with obstacles, of cloth with itself: pairs of nodes
  Stream<kernels::pair> triangle_pairs;  // of the last search or localized update
  Stream<kernels::pair> orphan_vertex_face, orphan_edge_edge;  // feature pairs of adjacent triangles

  template <class F> void visit(F &&f)
  {
    f("face_box", Life::step, face_box);
    f("edge_box", Life::step, edge_box);
    f("face_tree", Life::step, face_tree);
    f("obstacle_tree", Life::step, obstacle_tree);
    f("face_order", Life::step, face_order);
    f("obstacle_order", Life::step, obstacle_order);
    f("face_features", Life::scene, face_features);
    f("front", Life::step, front);
    f("self_front", Life::step, self_front);
    f("triangle_pairs", Life::step, triangle_pairs);
    f("orphan_vertex_face", Life::scene, orphan_vertex_face);
    f("orphan_edge_edge", Life::scene, orphan_edge_edge);
  }
};

/// A matrix of 3x3 blocks in block compressed sparse row form: rows of cloth vertices, columns of all vertices.
template <class Real> struct BlockMatrix {
  Stream<int> row, column;  // [rows + 1], [blocks]
  Stream<typename Types<Real>::mat3> block;  // [blocks], kg
};

/// Streams in the working precision: elements, the linear system, its solution.
template <class Real> struct System {
  using T = Types<Real>;
  Stream<Real> mass;  // [cloth vertices], kg
  Stream<Real> mass_damping;  // [cloth vertices] kg/s, with mass damping: times velocity a force; else empty
  Stream<Real> material_scale;  // [materials] h (h + damping), s^2
  Stream<typename T::stretching_stiffness> stretching_table;
  Stream<typename T::strain_limit> strain_limit;  // [materials], where one has a limit
  Stream<int> stretching_start;  // [materials] start in the table; below 0: constant stiffness
  Stream<typename T::bending_stiffness> bending_table;  // [materials]
  Stream<typename T::triangle_rest> triangle_rest;
  Stream<typename T::triangle_factor> triangle_factor;
  Stream<typename T::vec3> triangle_force;  // [3 triangles], N
  Stream<typename T::hinge_rest> hinge_rest;
  Stream<typename T::hinge_factor> hinge_factor;
  Stream<typename T::vec3> hinge_force;  // [4 hinges], N
  Stream<typename T::hinge_coupling> hinge_coupling;  // with bending=plate, as all of these; else empty
  Stream<typename T::moment_step> moment_step;  // [moment_iterations + 1][cloths]
  int moment_iterations = 0;
  Stream<Real> angle_scale, scaled_angle, moment, moment_before;  // [hinges], sqrt(J)
  Stream<Real> scaled_rate, rate_moment, rate_moment_before;  // [hinges], sqrt(J), with damping: of the rates
  // [triangles], [hinges], [cloths] with a yield curvature; else empty
  Stream<typename T::plastic_triangle> plastic_triangle;
  Stream<typename T::plastic_hinge> plastic_hinge;
  Stream<typename T::plastic_material> plastic_material;
  Stream<typename T::vec3> gas_gradient;  // [cloth vertices] m^2, with gas: derivative of the volume; else empty
  Stream<typename T::term> term;  // contacts, then stitches
  // [terms] N s on side A, with friction and several solves: of the friction of a contact without its damping
  Stream<typename T::vec3> hold;
  Stream<typename T::vec3> force;  // [cloth vertices], N
  Stream<typename T::mat3> drag;  // [cloth vertices] kg: what wind and mass damping add to the matrix; else empty
  Stream<typename T::vec3> start_force;  // [cloth vertices] N, with BDF2, in a step with contacts: at its start
  BlockMatrix<Real> matrix;
  Stream<typename T::vec3> right_side, solution;  // [cloth vertices], [vertices]

  template <class F> void visit(F &&f)
  {
    f("mass", Life::scene, mass);
    f("mass_damping", Life::scene, mass_damping);
    f("material_scale", Life::step, material_scale);
    f("stretching_table", Life::scene, stretching_table);
    f("strain_limit", Life::scene, strain_limit);
    f("stretching_start", Life::scene, stretching_start);
    f("bending_table", Life::scene, bending_table);
    f("triangle_rest", Life::scene, triangle_rest);
    f("triangle_factor", Life::step, triangle_factor);
    f("triangle_force", Life::step, triangle_force);
    f("hinge_rest", Life::scene, hinge_rest);
    f("hinge_factor", Life::step, hinge_factor);
    f("hinge_force", Life::step, hinge_force);
    f("hinge_coupling", Life::scene, hinge_coupling);
    f("moment_step", Life::scene, moment_step);
    f("angle_scale", Life::step, angle_scale);
    f("scaled_angle", Life::step, scaled_angle);
    f("moment", Life::step, moment);
    f("moment_before", Life::step, moment_before);
    f("scaled_rate", Life::step, scaled_rate);
    f("rate_moment", Life::step, rate_moment);
    f("rate_moment_before", Life::step, rate_moment_before);
    f("plastic_triangle", Life::scene, plastic_triangle);
    f("plastic_hinge", Life::scene, plastic_hinge);
    f("plastic_material", Life::scene, plastic_material);
    f("gas_gradient", Life::step, gas_gradient);
    f("term", Life::step, term);
    f("hold", Life::step, hold);
    f("force", Life::step, force);
    f("drag", Life::step, drag);
    f("start_force", Life::step, start_force);
    f("row", Life::step, matrix.row);
    f("column", Life::step, matrix.column);
    f("block", Life::step, matrix.block);
    f("right_side", Life::step, right_side);
    f("solution", Life::step, solution);
  }
};

/// Gas in closed cloths; without any, all streams are empty.
struct EnclosedGas {
  Stream<kernels::gas> gas;
  Stream<kernels::gas_part> triangle_part, vertex_part;  // that teams sum over
  Stream<double> volume, product;  // m^3 of the triangle parts; sums of the vertex parts
  Stream<kernels::gas_state> state;  // where the step is linearised
  Stream<int> gas_of;  // [cloth vertices] -1: none

  template <class F> void visit(F &&f)
  {
    f("gas", Life::scene, gas);
    f("gas.triangle_part", Life::scene, triangle_part);
    f("gas.vertex_part", Life::scene, vertex_part);
    f("gas.volume", Life::step, volume);
    f("gas.product", Life::step, product);
    f("gas.state", Life::step, state);
    f("gas.gas_of", Life::scene, gas_of);
  }
};

/// The linear system in the precision of the run, and its terms of rank one: contacts, then stitches.
struct SystemState {
  int terms = 0;
  Stream<kernels::element_nodes> term_nodes;
  Stream<int> term_split;  // [terms] with star: nodes on side A
  Incidence term_incidence;
  std::unique_ptr<System<double>> f64;
  std::unique_ptr<System<float>> f32;
  double scaled_step = 0;  // h of material_scale
  EnclosedGas gas;

  template <class Real> System<Real> &of()
  {
    if constexpr (sizeof(Real) == 8)
      return *f64;
    else
      return *f32;
  }
  /// Sets material_scale to h (h + damping), if it is that of another h.
  void scale_materials(double h, const std::vector<double> &damping);
  std::vector<double> masses() const;  ///< [cloth vertices], kg

  template <class F> void visit(F &&f)
  {
    f("terms", Life::step, terms);
    f("term_nodes", Life::step, term_nodes);
    f("term_split", Life::step, term_split);
    f("term_incidence.row", Life::step, term_incidence.row);
    f("term_incidence.entry", Life::step, term_incidence.entry);
    gas.visit(f);
    if (f64) f64->visit(f);
    if (f32) f32->visit(f);
  }
};

/// Impulses, N s, and their moments about the origin, N m s, [vertices].
struct Impulses {
  Stream<dvec3> linear, angular;

  void fill_zero();
  void swap(Impulses &other) noexcept;
  /// this += share other
  void add(double share, const Impulses &other);
};

/// What the cloth gave to what is prescribed, with the option forces: each obstacle vertex, pinned and attached vertex.
/// A free vertex has the momentum that nothing else received: what the commit took from it against other cloth, and
/// what BDF2 does not carry on after a blow.
struct ReactionState {
  bool measured = false, carries = false;
  Impulses step;  // of the last step
  Impulses pieces;  // of the step that is computed: of its pieces up to now
  Impulses piece;  // of the piece that is computed
  Impulses smooth, smooth_next;  // with BDF2: of the solve alone, which it carries on, of the last step and of this
  Impulses interval;  // since the interval began
  double interval_time = 0;  // s
  Impulses push;  // of impacts, kg m, kg m^2
  Stream<dvec3> solved_velocity;  // [cloth vertices] m/s
  Stream<dvec3> contact;  // [contacts] on side A, N s
  double contact_time = 0;  // s, over which `contact` acted

  /// carried: by BDF2.
  void set_up(Backend &backend, int vertices, int cloth_vertices, bool carried);
  void begin_interval();
  void begin_step();
  /// `piece` has the impulses of the solve. memory: Clock::memory.
  void carry_on(double memory);
  /// The piece is complete.
  void accept_piece();
  /// The step is complete. time_step: s.
  void accept_step(double time_step);

  template <class F> void visit(F &&f)
  {
    const auto both = [&](const char *linear, const char *angular, Impulses &i, Life life = Life::step) {
      f(linear, life, i.linear);
      f(angular, life, i.angular);
    };
    both("reactions.step", "reactions.step_moment", step);
    both("reactions.pieces", "reactions.pieces_moment", pieces);
    both("reactions.piece", "reactions.piece_moment", piece);
    both("reactions.smooth", "reactions.smooth_moment", smooth, Life::run);
    both("reactions.smooth_next", "reactions.smooth_next_moment", smooth_next);
    both("reactions.interval", "reactions.interval_moment", interval);
    both("reactions.push", "reactions.push_moment", push);
    f("reactions.solved_velocity", Life::step, solved_velocity);
    f("reactions.contact", Life::step, contact);
  }
};

struct State {
  explicit State(Backend &device) : backend(&device) {}

  Backend *backend;
  bool wait_for_stages = false;  // wait after every stage, so that stage times measure work
  Options options;
  StepReport report;
  Clock time;
  MeshState mesh;
  ElementState elements;
  ContactState contact;
  Exemptions exemptions;
  BoundsState bounds;
  TreeState *trees = nullptr;  // owned by the search by trees; null with fronts
  FrontState *fronts = nullptr;  // owned by the search by fronts; null with trees
  SystemState system;
  ReactionState reactions;
  RigidState rigid;

  /// Calls f(name, life, value) for every stream, and for every number that stages pass to each other.
  template <class F> void visit(F &&f)
  {
    time.visit(f);
    mesh.visit(f);
    elements.visit(f);
    contact.visit(f);
    exemptions.visit(Life::scene, f);
    bounds.visit(f);
    if (trees) trees->visit(f);
    if (fronts) fronts->visit(f);
    system.visit(f);
    reactions.visit(f);
    rigid.visit(f);
  }
  /// Calls f(name, stream) for every stream.
  template <class F> void visit_streams(F &&f)
  {
    visit([&](const char *name, Life, auto &value) {
      if constexpr (IsStream<std::decay_t<decltype(value)>>::value) f(name, value);
    });
  }
};

}  // namespace cama
