// SPDX-License-Identifier: Apache-2.0
// Exact intersection tests against integer arithmetic: a separating-axis test on points of a small grid, where most
// cases are degenerate.
#include "../catch.hpp"

#include <algorithm>
#include <random>

#include "cama/geometry.hpp"
#include "exact/predicates.hpp"

using namespace cama;
using kernels::dvec3_make;

namespace {

using Integer = __int128;
struct Point {
  long long x, y, z;
};
struct Axis {
  Integer x, y, z;
};

Axis minus(Point a, Point b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
Axis cross(Axis a, Axis b) { return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x}; }
Integer along(Axis n, Point p) { return n.x * p.x + n.y * p.y + n.z * p.z; }
Integer dot(Axis a, Axis b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

/// Closed segment and triangle are disjoint if and only if an axis of their Minkowski difference separates them
/// strictly.
bool disjoint(Point p, Point q, Point a, Point b, Point c)
{
  const Axis d = minus(q, p), e[3] = {minus(b, a), minus(c, b), minus(a, c)}, n = cross(e[0], e[1]);
  std::vector<Axis> axes{n, cross(n, d)};
  for (const Axis &edge : e) {
    axes.push_back(cross(edge, d));
    axes.push_back(cross(n, edge));
  }
  for (const Axis &axis : axes) {
    const Integer s0 = along(axis, p), s1 = along(axis, q), t0 = along(axis, a), t1 = along(axis, b),
                  t2 = along(axis, c);
    if (std::max(s0, s1) < std::min({t0, t1, t2}) || std::max({t0, t1, t2}) < std::min(s0, s1)) return true;
  }
  return false;
}

dvec3 as_double(Point p, double scale, double offset)
{
  return dvec3_make(p.x * scale + offset, p.y * scale + offset, p.z * scale + offset);
}

class Random {
public:
  explicit Random(unsigned seed) : engine_(seed) {}
  long long operator()(long long lo, long long hi) { return std::uniform_int_distribution<long long>(lo, hi)(engine_); }
  Point point(long long size) { return {(*this)(-size, size), (*this)(-size, size), (*this)(-size, size)}; }

private:
  std::mt19937_64 engine_;
};

int sign(Integer x) { return x > 0 ? 1 : (x < 0 ? -1 : 0); }

}  // namespace

TEST_CASE("orientation signs equal integer arithmetic", "[intersections]")
{
  Random random(41);
  int zero = 0;
  for (int i = 0; i < 200000; ++i) {
    const long long size = i % 2 ? 3 : (1 << 26);
    Point a = random.point(size), b = random.point(size), c = random.point(size), d = random.point(size);
    if (i % 3 == 0) {   // d near the plane of a, b, c: in it up to one unit
      const long long s = random(-2, 2), t = random(-2, 2);
      d = {a.x + s * (b.x - a.x) + t * (c.x - a.x) + random(0, 1), a.y + s * (b.y - a.y) + t * (c.y - a.y),
           a.z + s * (b.z - a.z) + t * (c.z - a.z)};
    }
    const int expected = sign(dot(minus(a, d), cross(minus(b, d), minus(c, d))));
    zero += expected == 0;
    for (const double scale : {1.0, 1.0 / (1 << 30)})
      REQUIRE(exact::orientation(as_double(a, scale, 0), as_double(b, scale, 0), as_double(c, scale, 0),
                                 as_double(d, scale, 0)) == expected);
  }
  CHECK(zero > 10000);
}

TEST_CASE("segment against triangle equals the integer separating-axis test", "[intersections]")
{
  Random random(42);
  int meet = 0, coplanar = 0;
  for (int i = 0; i < 300000; ++i) {
    const long long size = i % 4 == 0 ? 1 : (i % 4 == 1 ? 3 : 20);
    const Point a = random.point(size), b = random.point(size), c = random.point(size);
    Point p = random.point(size), q = random.point(size);
    if (i % 5 == 0) {   // in the triangle's plane
      const long long s = random(-1, 2), t = random(-1, 2), u = random(-1, 2), v = random(-1, 2);
      p = {a.x + s * (b.x - a.x) + t * (c.x - a.x), a.y + s * (b.y - a.y) + t * (c.y - a.y),
           a.z + s * (b.z - a.z) + t * (c.z - a.z)};
      q = {a.x + u * (b.x - a.x) + v * (c.x - a.x), a.y + u * (b.y - a.y) + v * (c.y - a.y),
           a.z + u * (b.z - a.z) + v * (c.z - a.z)};
    }
    const Axis n = cross(minus(b, a), minus(c, a)), d = minus(q, p);
    if (dot(n, n) == 0 || dot(d, d) == 0) continue;
    const bool expected = !disjoint(p, q, a, b, c);
    meet += expected;
    coplanar += expected && along(n, p) == along(n, a) && along(n, q) == along(n, a);
    for (const double offset : {0.0, 1048576.0}) {
      const double scale = 1.0 / 1024;
      const auto x = [&](Point point) { return as_double(point, scale, offset); };
      REQUIRE(exact::segment_meets_triangle(x(p), x(q), x(a), x(b), x(c)) == expected);
    }
  }
  CHECK(meet > 20000);
  CHECK(coplanar > 5000);
}

TEST_CASE("all intersections of two meshes, each once", "[intersections]")
{
  Random random(43);
  std::vector<Point> point;
  std::vector<dvec3> position;
  std::vector<Triangle> face;
  for (int k = 0; k < 300; ++k) {
    const Point p = random.point(12);
    for (int j = 0; j < 3; ++j) {
      const Point d = random.point(3);
      point.push_back({p.x + d.x, p.y + d.y, p.z + d.z});
    }
    const auto *t = &point[point.size() - 3];
    const Axis n = cross(minus(t[1], t[0]), minus(t[2], t[0]));
    if (dot(n, n) == 0) {
      point.resize(point.size() - 3);
      continue;
    }
    const int first = int(point.size()) - 3;
    face.push_back({first, first + 1, first + 2});
  }
  for (const Point &p : point) position.push_back(as_double(p, 0.125, 4096));
  for (const int obstacle : {-1, 0, 150}) {
    std::vector<std::array<int, 3>> expected, found;
    for (const Triangle &owner : face)
      for (int k = 0; k < 3; ++k)
        for (int f = 0; f < int(face.size()); ++f) {
          const int p = std::min(owner[k], owner[(k + 1) % 3]), q = std::max(owner[k], owner[(k + 1) % 3]);
          const Triangle &t = face[f];
          if (&t == &owner || (obstacle >= 0 && p >= obstacle && t[0] >= obstacle)) continue;
          if (!disjoint(point[p], point[q], point[t[0]], point[t[1]], point[t[2]])) expected.push_back({p, q, f});
        }
    std::sort(expected.begin(), expected.end());
    for (const Intersection &i : intersections(position, face, obstacle))
      found.push_back({i.edge[0], i.edge[1], i.face});
    CAPTURE(obstacle, expected.size());
    CHECK(found == expected);
  }
  CHECK(intersections({}, {}).empty());
}

TEST_CASE("touching counts, a shared vertex does not", "[intersections]")
{
  const std::vector<dvec3> x{dvec3_make(0, 0, 0),       dvec3_make(1, 0, 0), dvec3_make(0, 1, 0),
                             dvec3_make(0.25, 0.25, 0), dvec3_make(0, 0, 1), dvec3_make(1, 0, 1)};
  CHECK_FALSE(intersections(x, {{0, 1, 2}, {3, 4, 5}}).empty());   // a vertex in the face
  CHECK(intersections(x, {{0, 1, 2}, {0, 4, 5}}).empty());
  auto lifted = x;
  lifted[3].z = 1e-300;
  CHECK(intersections(lifted, {{0, 1, 2}, {3, 4, 5}}).empty());
}
