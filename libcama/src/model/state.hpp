// SPDX-License-Identifier: Apache-2.0
// Every stream that outlives a stage. Names follow the paper's Figure 4; docs/architecture.md has the table.
#pragma once
#include <memory>
#include <string>
#include <vector>

#include "cama/simulation.hpp"
#include "cama/stream.hpp"
#include "device/kernels.hpp"
#include "model/exemptions.hpp"

namespace cama {

/// Vertex-to-element lists in CSR form.
struct Incidence {
  Stream<int> row, entry;   // [vertices + 1], [sum] 4 * element + local index
  int vertices = 0;
  void reset(Backend &backend, int vertex_count);
  /// Makes the lists on the device. `count` is scratch of at least vertex_count ints.
  void build(Backend &backend, const Stream<kernels::element_nodes> &nodes, int elements, Stream<int> &count);
  /// The same lists; faster where they are long and made often, for scratch that stays.
  void rebuild(Backend &backend, const Stream<kernels::element_nodes> &nodes, int elements, Stream<int> &count);

private:
  Stream<key64> key_;   // of rebuild
  Stream<int> sorted_;
};

/// A matrix of 3x3 blocks in block compressed sparse row form: rows of cloth vertices, columns of all vertices.
template <class Real> struct BlockMatrix {
  Stream<int> row, column;                        // [rows + 1], [blocks]
  Stream<typename Types<Real>::mat3> block;       // [blocks], kg
};

/// Streams in the working precision: elements, the linear system, its solution.
template <class Real> struct System {
  using T = Types<Real>;
  Stream<Real> mass;                                              // [cloth vertices], kg
  Stream<Real> material_scale;                                    // [materials] h (h + damping), s^2
  Stream<typename T::stretching_stiffness> stretching_table;
  Stream<int> stretching_start;  // [materials] place in the table; below 0: constant
  Stream<typename T::bending_stiffness> bending_table;  // [materials]
  Stream<typename T::triangle_rest> triangle_rest;
  Stream<typename T::triangle_factor> triangle_factor;
  Stream<typename T::vec3> triangle_force;  // [3 triangles], N
  Stream<typename T::hinge_rest> hinge_rest;
  Stream<typename T::hinge_factor> hinge_factor;
  Stream<typename T::vec3> hinge_force;  // [4 hinges], N
  Stream<typename T::term> term;  // contacts, then stitches
  Stream<typename T::vec3> force;  // [cloth vertices], N
  BlockMatrix<Real> matrix;
  Stream<typename T::vec3> right_side, solution;  // [cloth vertices], [vertices]
};

/// Faces and edges of some objects along the Morton curve, under trees with eight children to a node.
struct FeatureTrees {
  Stream<int> face_order, edge_order;  // leaf to primitive
  Stream<kernels::bvh8_node> face_groups, edge_groups;
};

struct PairList {
  Stream<kernels::pair> pairs;
  Stream<kernels::fvec3> direction;  // [pairs] that tells the sides apart, from B to A
  Stream<float> gap_bound;  // [pairs] distance along it until the prediction at least, m; 0: unknown; below: an impact
                            // of this step
};

struct State {
  explicit State(Backend &device) : backend(&device) {}

  Backend *backend;
  double time = 0, time_step = 0;  // s
  double start_time = 0;  // s: time = start_time + (step - start_step) time_step
  int start_step = 0;
  double implicit_step = 0;  // s, h of v = v* + h M^-1 f(x* + h v): time_step, or 2/3 of it with a history
  bool multistep = false, history = false;  // BDF2: this step uses what was before; the next one may
  int cloth_vertices = 0, vertices = 0;  // cloth vertices come first
  int triangles = 0, hinges = 0, stitches = 0, terms = 0;
  int faces = 0, edges = 0;  // of cloth and obstacles
  int contacts = 0;
  int releases = 0;  // times that pins let vertices go
  double largest_thickness = 0;  // largest contact thickness of any vertex, m

  Stream<dvec3> position, velocity;  // [vertices] m, m/s at the start of the step
  Stream<dvec3> position_next, velocity_next;  // [vertices] at its end
  Stream<dvec3> position_before, velocity_before;  // [vertices] with BDF2: at the start of the previous step
  Stream<dvec3> position_base, velocity_base;  // [vertices] with BDF2: x*, v*
  Stream<dvec3> predicted;  // [vertices] ballistic end of the step
  Stream<dvec3> rest_position;  // [vertices] obstacles at rest of their motion, where any moves rigidly
  Stream<double> inverse_mass;  // [vertices] 1/kg; 0: prescribed; of contact
  Stream<int> fixed;  // [vertices] 1: prescribed
  Stream<dvec3> gravity, wind;  // [1]
  Stream<double> areal_density;  // [cloths] kg/m^2, with wind

  Stream<kernels::element_nodes> triangle_nodes, hinge_nodes, term_nodes;
  Stream<int> term_split;  // [terms] of the star: nodes on side A
  Incidence triangle_incidence, hinge_incidence, term_incidence;
  Stream<kernels::stitch> stitch;

  Stream<kernels::face_nodes> face;  // cloth, then obstacles
  Stream<kernels::edge_nodes> edge;
  Stream<int> query_vertices;  // vertices that are tested against faces: all but those that span planes
  Stream<kernels::vertex_contact> vertex_contact;
  Stream<double> margin;  // [vertices] by which boxes are inflated, m
  Stream<dvec3> bounds;  // [2] of the scene
  Stream<dvec3> origin;  // [2] what boxes are relative to where obstacles are at rest: the bounds when those were boxed
  const Stream<dvec3> &box_origin() const { return origin.size() ? origin : bounds; }
  Stream<kernels::box> vertex_box;
  FeatureTrees cloth_trees, moving_trees, static_trees;  // of the cloth, of obstacles that move, of those that do not
  Stream<kernels::box> face_box, edge_box;  // with fronts
  Stream<kernels::box> face_tree, obstacle_tree;  // with fronts: binary trees of the cloth and of the obstacles
  Stream<int> face_order, obstacle_order;  // leaf to face
  Stream<kernels::face_features> face_features;
  Stream<kernels::pair> front, self_front;  // of cloth with obstacles, of cloth with itself: pairs of tree nodes
  Stream<kernels::pair> triangle_pairs;  // of the last search or localized update
  Stream<kernels::pair> orphan_vertex_face, orphan_edge_edge;  // feature pairs of adjacent triangles
  PairList vertex_face, edge_edge;
  Stream<kernels::contact> contact;
  Stream<kernels::impact> impact;

  Exemptions exemptions;  // [vertices], where anything is exempt from contact
  std::vector<std::string> object_name;  // cloths, then obstacles
  std::vector<int> object_first;  // their first vertices
  std::vector<char> object_static;  // 1: an obstacle that never moves
  bool friction = false;  // anything in contact has some

  /// x*, v* of this step.
  const Stream<dvec3> &base_position() const { return multistep ? position_base : position; }
  const Stream<dvec3> &base_velocity() const { return multistep ? velocity_base : velocity; }
  /// Sets h, and material_scale where it was for another.
  void set_implicit_step(double step);

  std::unique_ptr<System<double>> system64;
  std::unique_ptr<System<float>> system32;
  template <class Real> System<Real> &system()
  {
    if constexpr (sizeof(Real) == 8)
      return *system64;
    else
      return *system32;
  }

  /// No contacts, no candidates.
  void forget_contacts() noexcept;

  /// "cloth 'shirt', vertex 12": a vertex in the numbering of its own object.
  std::string describe(int vertex) const;
  /// Index of the object that a vertex belongs to: cloths, then obstacles.
  int object_of(int vertex) const;

  Options options;
  StepReport report;
  Contact contact_settings;  // of the scene
  std::vector<double> damping;  // [cloths], s
  double scaled_step = 0;  // h that material_scale is for

  /// Calls f(name, stream) for every stream.
  template <class F> void visit(F &&f)
  {
    f("position", position);
    f("velocity", velocity);
    f("position_next", position_next);
    f("velocity_next", velocity_next);
    f("position_before", position_before);
    f("velocity_before", velocity_before);
    f("position_base", position_base);
    f("velocity_base", velocity_base);
    f("predicted", predicted);
    f("rest_position", rest_position);
    f("inverse_mass", inverse_mass);
    f("fixed", fixed);
    f("gravity", gravity);
    f("wind", wind);
    f("areal_density", areal_density);
    f("triangle_nodes", triangle_nodes);
    f("hinge_nodes", hinge_nodes);
    f("term_nodes", term_nodes);
    f("term_split", term_split);
    f("triangle_incidence.row", triangle_incidence.row);
    f("triangle_incidence.entry", triangle_incidence.entry);
    f("hinge_incidence.row", hinge_incidence.row);
    f("hinge_incidence.entry", hinge_incidence.entry);
    f("term_incidence.row", term_incidence.row);
    f("term_incidence.entry", term_incidence.entry);
    f("stitch", stitch);
    f("face", face);
    f("edge", edge);
    f("query_vertices", query_vertices);
    f("vertex_contact", vertex_contact);
    f("margin", margin);
    f("bounds", bounds);
    f("origin", origin);
    f("vertex_box", vertex_box);
    f("face_box", face_box);
    f("edge_box", edge_box);
    f("face_groups", cloth_trees.face_groups);
    f("edge_groups", cloth_trees.edge_groups);
    f("face_order", cloth_trees.face_order);
    f("edge_order", cloth_trees.edge_order);
    f("moving.face_groups", moving_trees.face_groups);
    f("moving.edge_groups", moving_trees.edge_groups);
    f("moving.face_order", moving_trees.face_order);
    f("moving.edge_order", moving_trees.edge_order);
    f("static.face_groups", static_trees.face_groups);
    f("static.edge_groups", static_trees.edge_groups);
    f("static.face_order", static_trees.face_order);
    f("static.edge_order", static_trees.edge_order);
    f("face_tree", face_tree);
    f("tree_order", face_order);
    f("obstacle_tree", obstacle_tree);
    f("obstacle_order", obstacle_order);
    f("face_features", face_features);
    f("front", front);
    f("self_front", self_front);
    f("triangle_pairs", triangle_pairs);
    f("orphan_vertex_face", orphan_vertex_face);
    f("orphan_edge_edge", orphan_edge_edge);
    f("vertex_face.pairs", vertex_face.pairs);
    f("vertex_face.direction", vertex_face.direction);
    f("edge_edge.pairs", edge_edge.pairs);
    f("edge_edge.direction", edge_edge.direction);
    f("vertex_face.gap_bound", vertex_face.gap_bound);
    f("edge_edge.gap_bound", edge_edge.gap_bound);
    f("contact", contact);
    f("impact", impact);
    f("exemptions.row", exemptions.row);
    f("exemptions.entry", exemptions.entry);
    f("exemptions.object", exemptions.object);
    if (system64) visit_system(*system64, f);
    if (system32) visit_system(*system32, f);
  }

private:
  template <class S, class F> static void visit_system(S &s, F &&f)
  {
    f("mass", s.mass);
    f("material_scale", s.material_scale);
    f("stretching_table", s.stretching_table);
    f("stretching_start", s.stretching_start);
    f("bending_table", s.bending_table);
    f("triangle_rest", s.triangle_rest);
    f("triangle_factor", s.triangle_factor);
    f("triangle_force", s.triangle_force);
    f("hinge_rest", s.hinge_rest);
    f("hinge_factor", s.hinge_factor);
    f("hinge_force", s.hinge_force);
    f("term", s.term);
    f("force", s.force);
    f("row", s.matrix.row);
    f("column", s.matrix.column);
    f("block", s.matrix.block);
    f("right_side", s.right_side);
    f("solution", s.solution);
  }
};

/// Called with the state after every linear solve. Tests plant failures here.
inline void (*planted_failure)(State &) = nullptr;

}  // namespace cama
