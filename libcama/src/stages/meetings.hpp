// SPDX-License-Identifier: Apache-2.0
// Where the surfaces of two obstacles touch, or will in the step.
#pragma once
#include <array>
#include <vector>

#include "model/contact_shape.hpp"

namespace cama {

/// A point fixed to a surface: a mean of vertices.
struct Foot {
  std::array<int, 3> node{0, 0, 0};
  std::array<double, 3> weight{1, 0, 0};

  dvec3 at(const std::vector<dvec3> &position) const
  {
    dvec3 x{0, 0, 0};
    for (std::size_t k = 0; k < 3; ++k)
      if (weight[k] != 0) x = kernels::daxpy(x, weight[k], position[static_cast<std::size_t>(node[k])]);
    return x;
  }
};

/// A shape in a step: its vertices go straight from start to end.
struct PlacedShape {
  explicit PlacedShape(const ContactShape &its_shape) : shape(&its_shape), tree(its_shape) {}
  void fit() { tree.fit(*shape, start, end); }

  const ContactShape *shape;
  std::vector<dvec3> start, end;  // [vertices] m
  ContactTree tree;
};

/// Two features that touch or will.
struct Meeting {
  std::array<int, 7> key;  // which features
  Foot a, b;
  dvec3 normal;  // from b to a
  double time;  // share of the step: 0 if they touch at its start
};

/// Looks for meetings of two shapes, of which b may be a plane.
class MeetingSearch {
public:
  /// gap: the distance that contact keeps between the surfaces, m.
  MeetingSearch(const PlacedShape &a, const PlacedShape &b, double gap);

  /// Feature pairs that are near at the start, and those that would come nearer than the gap.
  std::vector<Meeting> meetings() const;
  /// Where the surfaces would first pass through each other; time above 1: they do not.
  Meeting first_crossing() const;
  /// How deep the surfaces reach into each other at the start, m; 0: they do not.
  double depth() const;

private:
  enum class Kind { vertex_face, face_vertex, edges, plane };
  struct Candidate {
    Kind kind;
    int a, b;  // vertex, face or edge of either
    bool operator<(const Candidate &o) const { return kind != o.kind ? kind < o.kind : (a != o.a ? a < o.a : b < o.b); }
    bool operator==(const Candidate &o) const { return kind == o.kind && a == o.a && b == o.b; }
  };
  struct Closest {
    double distance;  // of the surfaces, m
    Meeting meeting;
    bool least;  // whether no feature beside them is closer
  };
  void add(int face_a, int face_b);
  Closest closest(const Candidate &c, double time) const;
  Closest vertex_face(const PlacedShape &p, int vertex, const PlacedShape &q, int face, double time) const;
  Closest edges(int a, int b, double time) const;
  Closest plane(int vertex, double time) const;
  double travel(const Candidate &c) const;
  double meet(const Candidate &c, double from, double target, double accepted, double travelled) const;

  const PlacedShape &a_, &b_;
  const double gap_, radius_;
  std::vector<Candidate> candidates_;
};

}  // namespace cama
