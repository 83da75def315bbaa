// SPDX-License-Identifier: Apache-2.0
#include "traffic.hpp"

#include <algorithm>
#include <cstdlib>
#include <stdexcept>

namespace cama::benchmark {
namespace {

constexpr double radix_passes = 8;      // 62-bit keys, 8 bits a pass
constexpr double aggregate = 16;        // vertices of a Schwarz block, and ratio of the sizes of levels
constexpr double int_bytes = 4, pair_bytes = 8, vector_bytes = 24;

double element_bytes(const std::string &element)
{
  if (element == "int" || element == "float") return 4;
  if (element == "double") return 8;
  return std::atof(element.c_str());   // "24 bytes"
}

/// Bytes of a number of the solve: with mixed, single precision is used for the Schwarz preconditioner only.
double solve_real(const SolveShape &shape)
{
  return shape.precision == "single" || (shape.precision == "mixed" && shape.preconditioner == "schwarz") ? 4 : 8;
}

/// Sizes of the streams: the bytes of a stream and its number of elements.
class Streams {
public:
  explicit Streams(const Simulation &simulation)
  {
    for (const StreamInfo &s : simulation.streams())
      size_[s.name] = {static_cast<double>(s.size), element_bytes(s.element)};
  }
  double n(const std::string &name) const
  {
    check(name);
    const auto found = size_.find(name);
    return found == size_.end() ? 0 : found->second.first;
  }
  double bytes(std::initializer_list<const char *> names) const
  {
    double sum = 0;
    for (const char *name : names) {
      check(name);
      const auto found = size_.find(name);
      if (found != size_.end()) sum += found->second.first * found->second.second;
    }
    return sum;
  }

private:
  /// Throws for a name that no stream has; a stream that this scene does not have has no bytes.
  static void check(const std::string &name)
  {
    const std::vector<std::string> &known = stream_names();
    if (std::find(known.begin(), known.end(), name) == known.end())
      throw std::logic_error("no stream is named '" + name + "'");
  }

  std::map<std::string, std::pair<double, double>> size_;
};

double motion(const Streams &s, double cloth) { return 3 * vector_bytes * (s.n("position") - cloth); }

/// Boxes of vertices, faces and edges, both kinds of trees written and read.
double boxes_and_trees(const Streams &s)
{
  return s.bytes({"position", "position_next", "margin", "vertex_box", "face", "face_box", "edge", "edge_box",
                  "trees.cloth.face_order", "trees.cloth.edge_order", "trees.moving.face_order",
                  "trees.moving.edge_order", "face_order", "trees.resting.face_bvh", "trees.resting.edge_bvh"}) +
         2 * s.bytes({"trees.cloth.face_bvh", "trees.cloth.edge_bvh", "trees.moving.face_bvh", "trees.moving.edge_bvh",
                      "face_tree", "obstacle_tree"});
}
double pairs_written(const Streams &s)
{
  return s.bytes({"vertex_face.pairs", "vertex_face.gap_bound", "vertex_face.direction", "edge_edge.pairs",
                  "edge_edge.gap_bound", "edge_edge.direction"});
}
double fronts(const Streams &s)
{
  return 2 * s.bytes({"front", "self_front"}) + s.bytes({"triangle_pairs", "face_features"});
}
double candidate_search(const Streams &s)
{
  return s.bytes({"position", "velocity", "predicted"}) + boxes_and_trees(s) + fronts(s) + pairs_written(s);
}

/// Every pair read, with the vertices of both features from the cache; flag and direction written.
double contacts(const Streams &s)
{
  return s.bytes({"vertex_face.pairs", "edge_edge.pairs", "vertex_face.direction", "edge_edge.direction", "position",
                  "predicted", "vertex_contact", "face", "edge", "contact"}) +
         int_bytes * (s.n("vertex_face.pairs") + s.n("edge_edge.pairs"));
}

/// Factors and forces of triangles and hinges written, forces gathered.
double element_forces(const Streams &s)
{
  return s.bytes({"triangle_rest", "triangle_factor", "hinge_rest", "hinge_factor", "position", "force", "mass",
                  "triangle_incidence.row", "triangle_incidence.entry", "hinge_incidence.row",
                  "hinge_incidence.entry"}) +
         2 * s.bytes({"triangle_force", "hinge_force"});
}

double contact_terms(const Streams &s)
{
  return s.bytes({"contact", "term_nodes", "term", "term_incidence.row", "force", "velocity", "velocity_next"}) +
         2 * s.bytes({"term_incidence.entry"});
}

/// gather: sources of the blocks read. algorithm1: indices written, sorted and read, sources written besides. sorted:
/// all entries pass through a radix sort.
double matrix(const Streams &s, const Options &o, double rows)
{
  const bool terms = o.paper.assembly != Assembly::gather;
  const double directed = 3 * s.n("triangle_incidence.entry") +
                          4 * (s.n("hinge_incidence.entry") + (terms ? s.n("term_incidence.entry") : 0)) + rows;
  const double factors =
      s.bytes({"triangle_factor", "hinge_factor", "mass", "block", "row"}) + (terms ? s.bytes({"term"}) : 0);
  const double elements = s.n("triangle_factor") + s.n("hinge_factor") + s.n("term");
  if (o.paper.assembly == Assembly::sorted)
    return factors + s.bytes({"column"}) + 2 * radix_passes * (2 * int_bytes + int_bytes) * (16 * elements + rows);
  const double gathered = factors + int_bytes * (directed + s.n("block"));
  if (o.paper.assembly == Assembly::gather) return gathered;
  return gathered + s.bytes({"triangle_nodes", "hinge_nodes", "term_nodes", "column"}) +
         (4 * 2 * int_bytes + int_bytes) * directed;
}

/// Test of the boxes, and every pair examined in each pass; the commit reads every pair and writes every vertex.
double penetration(const Streams &s, const StepReport &r, const Options &o)
{
  const double pairs = s.n("vertex_face.pairs") + s.n("edge_edge.pairs");
  const double vertices = s.bytes({"position", "position_next", "vertex_contact", "inverse_mass"});
  const double detections = o.max_impact_passes > 0 ? std::min(r.impact_passes + r.substeps, o.max_impact_passes) : 0;
  const double detect = pairs * (pair_bytes + vector_bytes + 2 * int_bytes) + vertices + s.bytes({"face", "edge"});
  const double commit =
      o.commit ? pairs * (pair_bytes + 2 * int_bytes) + 3 * s.bytes({"position"}) + 2 * int_bytes * s.n("position") : 0;
  const double again = std::max(0, r.searches - 1) * boxes_and_trees(s);
  return s.bytes({"vertex_box", "margin"}) + 2 * s.bytes({"position"}) + detections * detect + r.substeps * commit +
         again + r.impact_passes * 2 * s.bytes({"impact"});
}

double extrapolation(const Streams &s)
{
  return s.bytes({"position", "position_before", "position_base", "velocity", "velocity_before", "velocity_base"});
}

double abrupt_contact(const Streams &s)
{
  return s.bytes({"term", "contact", "abrupt", "abrupt_change", "term_incidence.row"}) +
         2 * s.bytes({"term_incidence.entry"});
}

double finish(const Streams &s) { return s.bytes({"position_next", "velocity_next"}); }

SolveShape shape_of(const Streams &s, const Simulation &simulation)
{
  const Options &o = simulation.options();
  SolveShape shape;
  shape.rows = simulation.cloth_vertex_count();
  shape.blocks = s.n("block");
  shape.iterations = simulation.report().iterations;
  shape.precision = to_text(option_value(o, "precision"));
  shape.preconditioner = to_text(option_value(o, "preconditioner"));
  if (o.paper.assembly == Assembly::gather) {
    shape.terms = s.n("term");
    shape.entries = s.n("term_incidence.entry");
  }
  return shape;
}

}  // namespace

double solve_bytes(const SolveShape &shape)
{
  const double real = solve_real(shape), vectors = 3 * real * shape.rows;
  const double term = 4 * int_bytes + 10 * real, product = 3 * real;
  const double multiply = shape.blocks * (9 * real + int_bytes) + shape.rows * int_bytes + 2 * vectors +
                          shape.terms * (term + 2 * product) + shape.entries * (int_bytes + real);
  double precondition = 0;
  if (shape.preconditioner == "jacobi") precondition = vectors;
  if (shape.preconditioner == "block_jacobi") precondition = 3 * vectors;
  if (shape.preconditioner ==
      "schwarz") {   // triangular factors in 16 bits, by tiles of 16 x 16, and weights; all levels
    const double side = 3 * aggregate, block = 2 * 6 * 256 + side * real;
    precondition = shape.rows * block / (aggregate - 1);
  }
  const double update = 7 * vectors, direction = 3 * vectors;  // x, p, q, r read, x, r, z written; z, p read, p written
  return (shape.iterations + 1) * multiply + shape.iterations * (precondition + update + direction);
}

std::string nested_name(const StageTime &time, std::string &outer)
{
  if (time.depth <= 1) return outer = time.name;
  return outer + "/" + time.name;
}

std::map<std::string, double> step_bytes(const Simulation &simulation)
{
  const Streams s(simulation);
  const Options &o = simulation.options();
  const double rows = simulation.cloth_vertex_count();
  const double solves = std::max(simulation.report().newton_iterations, 1);  // with as many iterations each
  SolveShape shape = shape_of(s, simulation);
  shape.iterations /= solves;
  const double elements = element_forces(s), terms = contact_terms(s), blocks = matrix(s, o, rows);
  const double solve = o.solver == LinearSolver::direct ? 0 : solve_bytes(shape);
  const std::map<std::string, double> leaves = {
      {"prescribed motion", motion(s, rows)},
      {"extrapolation", extrapolation(s)},
      {"proximity checking/candidate search", candidate_search(s)},
      {"proximity checking/contacts", contacts(s)},
      {"prediction", 4 * vector_bytes * rows},
      {"matrix assembly/element forces", elements},
      {"matrix assembly/contact terms", terms},
      {"matrix assembly/matrix assembly", blocks},
      {"linear solve", solve},
      {"newton iterations", (solves - 1) * (elements + terms + blocks + solve)},
      {"advance positions", 3 * vector_bytes * rows},
      {"abrupt contact", abrupt_contact(s)},
      {"keep friction", s.bytes({"contact", "term", "hold", "kept_next.force"})},
      {"penetration handling", penetration(s, simulation.report(), o)},
      {"finish step", finish(s)},
  };
  std::map<std::string, double> bytes;
  std::string outer;
  for (const StageTime &time : simulation.timings()) {
    const std::string name = nested_name(time, outer);
    const auto leaf = leaves.find(name);
    if (leaf == leaves.end() || leaf->second <= 0) continue;
    bytes[name] += leaf->second;
    if (time.depth > 1) bytes[outer] += leaf->second;
    bytes["step"] += leaf->second;
  }
  return bytes;
}

}  // namespace cama::benchmark
