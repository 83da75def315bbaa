// SPDX-License-Identifier: Apache-2.0
// Contacts of a vertex over edges and corners of a surface: one each, as far away and in the direction that the shape
// of the surface says.
#include "../catch.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <random>

#include "../meshes.hpp"
#include "model/borders.hpp"

using namespace cama;
using namespace cama::kernels;

namespace {

constexpr double thickness = 0.1, stiffness = 1e4, area = 2e-3;

/// Turns and moves points: no coordinate is a round number.
struct Frame {
  dvec3 x = dnormalize({0.6, 0.5, -0.3}), y = dnormalize(dcross({0.1, 0.2, 0.9}, x)), z = dcross(x, y),
        origin = {0.31, -1.7, 2.3};
  bool plain = false;
  dvec3 direction(const dvec3 &p) const { return plain ? p : daxpy(daxpy(dscale(p.x, x), p.y, y), p.z, z); }
  dvec3 operator()(const dvec3 &p) const { return plain ? p : dadd(origin, direction(p)); }
};

/// The contacts of a vertex at `point` with a mesh, by every one of its faces.
std::vector<contact> contacts_at(const Mesh &mesh, const Frame &frame, const dvec3 &point, double anticipate = 1.0)
{
  std::vector<dvec3> x;
  for (const dvec3 &p : mesh.position) x.push_back(frame(p));
  x.push_back(frame(point));
  const int v = static_cast<int>(x.size()) - 1;
  std::vector<face_nodes> faces;
  for (const Triangle &f : mesh.face) faces.push_back({{f[0], f[1], f[2]}});
  const Borders borders(faces, v + 1);
  const std::vector<vertex_contact> of(x.size(), {thickness, area, stiffness, 0.3, 0.3, 0, 0, SHAPE_MESH});
  std::vector<contact> result;
  for (int f = 0; f < static_cast<int>(faces.size()); ++f) {
    const kernels::pair q = {v, f};
    const element_nodes e = pair_nodes(0, q, faces.data(), nullptr);
    contact c;
    if (make_contact(0, q, e, nullptr, borders.face.data(), borders.neighbours.start.data(),
                     borders.neighbours.value.data(), x.data(), x.data(), of.data(), anticipate,
                     surface_proximity(0, e, x.data(), of.data()), &c))
      result.push_back(c);
  }
  return result;
}

void check_one(const Mesh &mesh, const Frame &frame, const dvec3 &point, double distance, const dvec3 &normal)
{
  const std::vector<contact> found = contacts_at(mesh, frame, point);
  REQUIRE(found.size() == 1);
  CHECK(found[0].distance == Approx(distance).epsilon(1e-9));
  CHECK(dnorm(dsub(found[0].normal, frame.direction(normal))) < 1e-9);
  CHECK(found[0].stiffness == Approx(stiffness * area));
}

/// A box of size 2 around the origin, two faces a side.
Mesh cube()
{
  Mesh m;
  for (int k = 0; k < 8; ++k) m.position.push_back({k & 1 ? 1.0 : -1.0, k & 2 ? 1.0 : -1.0, k & 4 ? 1.0 : -1.0});
  m.face = {{0, 2, 3}, {0, 3, 1}, {4, 5, 7}, {4, 7, 6}, {0, 1, 5}, {0, 5, 4},
            {2, 6, 7}, {2, 7, 3}, {0, 4, 6}, {0, 6, 2}, {1, 3, 7}, {1, 7, 5}};
  return m;
}

Frame plain()
{
  Frame f;
  f.plain = true;
  return f;
}

double clamped(double c) { return std::clamp(c, -1.0, 1.0); }

}  // namespace

TEST_CASE("a vertex over a flat table has one contact, over faces, edges and corners alike", "[border]")
{
  const Mesh table = meshes::grid(4, 4, 4, 4, -2, -2);
  std::mt19937 engine(3);
  std::uniform_real_distribution<double> inside(-1.9, 1.9);
  for (const Frame &frame : {plain(), Frame{}})
    for (const double height : {0.05, 0.001}) {
      for (double a = -1.5; a < 1.6; a += 0.5)
        for (double b = -1.5; b < 1.6; b += 0.5) check_one(table, frame, {a, b, height}, height, {0, 0, 1});
      for (int n = 0; n < 5; ++n) {
        const double a = inside(engine), b = inside(engine), c = std::round(0.75 * inside(engine));
        check_one(table, frame, {a, b, height}, height, {0, 0, 1});
        check_one(table, frame, {c, b, height}, height, {0, 0, 1});  // over a line of edges
        check_one(table, frame, {c + 1e-13, b, -height}, height, {0, 0, -1});  // as near as rounding, from below
        check_one(table, frame, {a, a, height}, height, {0, 0, 1});  // over diagonals
        if (std::abs(a) > 1e-3) check_one(table, frame, {1e-15 * a, 1e-15 * b, height}, height, {0, 0, 1});
      }
    }
}

TEST_CASE("a vertex outside a box has one contact, at the closest point of the box, but around its sharp edges",
          "[border]")
{
  std::mt19937 engine(5);
  std::uniform_real_distribution<double> around(-1.05, 1.05);
  const auto check = [&](const Frame &frame, const dvec3 &p) {
    const dvec3 apart = dsub(p, {clamped(p.x), clamped(p.y), clamped(p.z)});
    const double distance = dnorm(apart);
    if (!(distance > 1e-3)) return;
    std::array<double, 3> lean = {std::abs(apart.x), std::abs(apart.y), std::abs(apart.z)};
    std::sort(lean.begin(), lean.end());  // the second: how far it leans off the nearest side
    if (std::abs(lean[1] / distance - 0.05) < 1e-9) return;
    if (lean[1] < 0.05 * distance)
      check_one(cube(), frame, p, distance, dscale(1 / distance, apart));
    else
      CHECK(contacts_at(cube(), frame, p).empty());
  };
  for (const Frame &frame : {plain(), Frame{}}) {
    for (const double a : {-1.0, -0.5, 0.0, 1.0})
      for (const double b : {-1.0, 0.0, 0.5, 1.0})
        for (const double out : {1.04, -1.04})
          for (const dvec3 &p : {dvec3{a, b, out}, dvec3{a, out, b}, dvec3{out, a, b}, dvec3{out, out, b},
                                 dvec3{out, -out, b}, dvec3{out, a, out}, dvec3{out, out, -out}})
            check(frame, p);
    for (int n = 0; n < 3000; ++n) check(frame, {around(engine), around(engine), around(engine)});
  }
}

TEST_CASE("a vertex outside a convex mesh of many faces has one contact, the closest of all", "[border]")
{
  const Mesh ball = meshes::sphere(80, 60, 1.0);
  std::mt19937 engine(7);
  std::normal_distribution<double> normal;
  const auto check = [&](const dvec3 &p) {
    double closest = 1e9;
    for (const Triangle &f : ball.face)
      closest = std::min(
          closest, vertex_face_proximity(p, ball.position[f[0]], ball.position[f[1]], ball.position[f[2]]).distance);
    const std::vector<contact> found = contacts_at(ball, Frame{}, p);
    REQUIRE(found.size() == (closest < thickness ? 1 : 0));
    if (!found.empty()) CHECK(found[0].distance == Approx(closest).epsilon(1e-9));
  };
  for (const int p : {1000, 2222, 4000}) check(dscale(1.05, ball.position[p]));
  for (const Triangle &f : ball.face)
    for (int k = 0; k < 3; ++k) check(dscale(0.525, dadd(ball.position[f[k]], ball.position[f[(k + 1) % 3]])));
  for (int n = 0; n < 5; ++n) {
    const dvec3 d = dnormalize({normal(engine), normal(engine), normal(engine)});
    const dvec3 p = dscale(1.03, d);
    check(p);
  }
}

TEST_CASE("in a valley the faces beside the edge have contacts, and the edge has none", "[border]")
{
  Mesh valley;
  valley.position = {{0, -1, 0}, {0, 1, 0}, {1, 0, 0.4}, {-1, 0, 0.4}};
  valley.face = {{0, 2, 1}, {0, 1, 3}};
  for (const Frame &frame : {plain(), Frame{}}) {
    const std::vector<contact> found = contacts_at(valley, frame, {0, 0.2, 0.05});
    REQUIRE(found.size() == 2);
    for (const contact &c : found) {
      CHECK(c.distance == Approx(0.05 / std::hypot(1, 0.4)));
      for (int k = 1; k < 4; ++k) CHECK(c.weight[k] < 0);
    }
    check_one(valley, frame, {0, 0.2, -0.05}, 0.05, {0, 0, -1});  // from below the edge is a ridge
  }
}

TEST_CASE("over the rim of a surface there is a contact straight above it, and none beside it", "[border]")
{
  Mesh square;
  square.position = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}};
  square.face = {{0, 1, 2}, {0, 2, 3}};
  for (const Frame &frame : {plain(), Frame{}})
    for (const dvec3 &p : {dvec3{0.4, 0, 0.02}, dvec3{1, 0.4, 0.02}, dvec3{0, 0, 0.02}, dvec3{1, 0, 0.02}}) {
      check_one(square, frame, p, 0.02, {0, 0, 1});
      const double out = 1e-4;
      CHECK(contacts_at(square, frame, {p.x + (p.x > 0.5 ? out : -out), p.y - out, p.z}).empty());
    }
}

TEST_CASE("two corners have one contact with each other", "[border]")
{
  // Of two blunt pyramids that stand tip to tip, and of two flat squares whose middles are above each other.
  for (const double tip : {0.05, 0.0}) {
    std::vector<dvec3> x;
    std::vector<face_nodes> faces;
    for (const int side : {0, 1}) {
      const int first = static_cast<int>(x.size());
      x.push_back({0, 0, side * 0.05});
      for (const dvec3 &p : {dvec3{1, 1, 0}, dvec3{-1, 1, 0}, dvec3{-1, -1, 0}, dvec3{1, -1, 0}})
        x.push_back({p.x, p.y, side ? 0.05 + tip : -tip});
      for (int k = 0; k < 4; ++k) faces.push_back({{first, first + 1 + k, first + 1 + (k + 1) % 4}});
    }
    const Borders borders(faces, static_cast<int>(x.size()));
    const std::vector<vertex_contact> of(x.size(), {thickness, area, stiffness, 0.3, 0.3, 0, 0, SHAPE_MESH});
    int found = 0;
    for (const int v : {0, 5})
      for (int k = 0; k < 4; ++k) {
        const kernels::pair q = {v, v == 0 ? 4 + k : k};
        const element_nodes e = pair_nodes(0, q, faces.data(), nullptr);
        contact c;
        found += make_contact(0, q, e, nullptr, borders.face.data(), borders.neighbours.start.data(),
                              borders.neighbours.value.data(), x.data(), x.data(), of.data(), 1.0,
                              surface_proximity(0, e, x.data(), of.data()), &c);
      }
    CHECK(found == 1);
  }
}

TEST_CASE("cloth has no contact with a neighbouring face of its own, and the paper's contacts end at the border",
          "[border]")
{
  // The vertex at the end of a sliver is nearer to the edge of its own hinge, and to its neighbours, than the
  // thickness.
  const std::vector<dvec3> x = {{0, 0, 0}, {1, 0, 0}, {0.5, -0.05, 0}, {0.5, 0.05, 0.03}, {0.5, 0.5, 0}};
  const std::vector<face_nodes> faces = {{{0, 2, 1}}, {{0, 1, 3}}, {{0, 3, 4}}};
  const std::vector<vertex_contact> of(x.size(), {thickness, area, stiffness, 0.3, 0.3, 0, 0, SHAPE_MESH});
  const Borders borders(faces, static_cast<int>(x.size()));
  const auto makes = [&](int v, int f) {
    const kernels::pair q = {v, f};
    const element_nodes e = pair_nodes(0, q, faces.data(), nullptr);
    contact c;
    return make_contact(0, q, e, nullptr, borders.face.data(), borders.neighbours.start.data(),
                        borders.neighbours.value.data(), x.data(), x.data(), of.data(), 1.0,
                        surface_proximity(0, e, x.data(), of.data()), &c);
  };
  CHECK_FALSE(makes(2, 1));
  CHECK_FALSE(makes(3, 0));
  CHECK(contacts_at(cube(), Frame{}, {0, 0, 1.05}).size() == 1);  // over the diagonal
  CHECK(contacts_at(cube(), plain(), {0, 0, 1.05}, 0.0).empty());
  CHECK(contacts_at(cube(), plain(), {0.5, 0, 1.05}, 0.0).size() == 1);
}
