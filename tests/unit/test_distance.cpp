// SPDX-License-Identifier: Apache-2.0
// Distances against libccd, closed forms, and the duality gap: the closest vector bounds the distance from below over
// the vertices.
#include "../catch.hpp"

#include <ccd/vec3.h>

#include <cmath>
#include <random>

#include "cama/geometry.hpp"
#include "device/kernels.hpp"

using namespace cama;
using namespace cama::kernels;

namespace {

using Real = long double;
struct Wide {
  Real x, y, z;
};
Wide operator-(Wide a, Wide b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
Real dot(Wide a, Wide b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
Wide wide(dvec3 a) { return {a.x, a.y, a.z}; }

/// above: length of sum w x; below: the largest lower bound along the reported normal.
struct Gap {
  Real above, below;
};

Gap bounds(const Quad &x, const proximity &p, bool edges)
{
  Wide r{0, 0, 0};
  Real least = 1e30L;
  const int split = edges ? 2 : 1;
  const Wide n = wide(p.normal);
  const Real length = std::sqrt(dot(n, n));
  for (int i = 0; i < split; ++i)
    for (int j = split; j < 4; ++j) least = std::min(least, dot(n, wide(x[i]) - wide(x[j])) / length);
  for (int k = 1; k < 4; ++k) {   // relative to vertex 0: the weights sum to zero
    const Wide d = wide(x[k]) - wide(x[0]);
    r = {r.x + p.weight[k] * d.x, r.y + p.weight[k] * d.y, r.z + p.weight[k] * d.z};
  }
  return {std::sqrt(dot(r, r)), least};
}

proximity nearest(const Quad &x, bool edges)
{
  return edges ? edge_edge_proximity(x[0], x[1], x[2], x[3]) : vertex_face_proximity(x[0], x[1], x[2], x[3]);
}

class Random {
public:
  explicit Random(unsigned seed) : engine_(seed) {}
  double operator()(double lo, double hi) { return std::uniform_real_distribution<double>(lo, hi)(engine_); }
  dvec3 vector(double size) { return dvec3_make((*this)(-size, size), (*this)(-size, size), (*this)(-size, size)); }

private:
  std::mt19937_64 engine_;
};

bool valid_weights(const proximity &p, bool edges)
{
  const int split = edges ? 2 : 1;
  double a = 0, b = 0;
  for (int k = 0; k < 4; ++k) {
    (k < split ? a : b) += p.weight[k];
    if (k < split ? p.weight[k] < 0 : p.weight[k] > 0) return false;
  }
  return std::fabs(a - 1) < 1e-15 && std::fabs(b + 1) < 1e-15;
}

}  // namespace

TEST_CASE("vertex-face distance equals libccd's", "[distance]")
{
  Random random(21);
  for (int i = 0; i < 50000; ++i) {
    ccd_vec3_t v[4];
    Quad x;
    for (int k = 0; k < 4; ++k) {
      x[k] = random.vector(1);
      ccdVec3Set(&v[k], ccd_real_t(x[k].x), ccd_real_t(x[k].y), ccd_real_t(x[k].z));
    }
    const double expected = std::sqrt(double(ccdVec3PointTriDist2(&v[0], &v[1], &v[2], &v[3], nullptr)));
    REQUIRE(vertex_face_distance(x).distance ==
            Approx(expected).epsilon(sizeof(ccd_real_t) == 8 ? 1e-9 : 1e-4).margin(1e-7));
  }
}

TEST_CASE("closest points are optimal: no gap to the lower bound along the normal", "[distance]")
{
  Random random(22);
  for (const bool edges : {false, true})
    for (const double thin : {1.0, 1e-3, 1e-6, 1e-9})   // slivers, near-parallel edges
      for (const double offset : {0.0, 1024.0}) {
        Real worst_gap = 0, worst_length = 0;
        int interior = 0, wrong = 0;
        for (int i = 0; i < 20000; ++i) {
          Quad x;
          const dvec3 u = random.vector(1), v = dadd(u, random.vector(thin)), shift = random.vector(offset);
          x[0] = random.vector(1);
          if (edges) {
            x[1] = dadd(x[0], u);
            x[2] = random.vector(1);
            x[3] = daxpy(x[2], random(0.5, 2), v);
          } else {
            x[1] = random.vector(1);
            x[2] = dadd(x[1], u);
            x[3] = daxpy(x[1], random(0.5, 2), v);
          }
          if (i % 2) {   // moved so that the closest points are inside, from 1e-6 to 1 apart
            const dvec3 n = dnormalize(dcross(u, v)), w = dsub(x[3], edges ? x[2] : x[1]);
            const double s = random(0.1, 0.9), t = random(0.1, 0.9), height = std::pow(10.0, random(-6, 0));
            const dvec3 foot = edges ? daxpy(x[2], t, w) : daxpy(daxpy(x[1], s, u), t * (1 - s), w);
            x[0] = daxpy(daxpy(foot, edges ? -s : 0, u), height, n);
            if (edges) x[1] = dadd(x[0], u);
          }
          for (auto &p : x) p = dadd(p, shift);
          const proximity p = nearest(x, edges);
          const Gap g = bounds(x, p, edges);
          worst_gap = std::max(worst_gap, g.above - g.below);
          worst_length = std::max(worst_length, std::fabs(g.above - p.distance));
          interior += p.interior;
          wrong += !valid_weights(p, edges);
        }
        CAPTURE(edges, thin, offset, interior);
        CHECK(worst_gap < 1e-8);
        CHECK(worst_length < 1e-9);
        CHECK(wrong == 0);
        CHECK(interior > (thin > 1e-7 ? 7000 : 0));
      }
}

TEST_CASE("distances by closed form", "[distance]")
{
  const dvec3 a = dvec3_make(0, 0, 0), b = dvec3_make(1, 0, 0), c = dvec3_make(0, 1, 0);
  const auto face = [&](double x, double y, double z) { return vertex_face_proximity(dvec3_make(x, y, z), a, b, c); };
  CHECK(face(0.25, 0.25, 2).distance == 2);
  CHECK(face(0.25, 0.25, 2).interior == 1);
  CHECK(face(0.25, 0.25, -2).normal.z == -1);
  CHECK(face(-3, -4, 0).distance == 5);
  CHECK(face(-3, -4, 0).interior == 0);
  CHECK(face(1, 1, 0).distance == Approx(std::sqrt(0.5)));
  CHECK(face(1, 1, 0).weight[2] == Approx(-0.5));
  CHECK(face(0.25, 0.25, 0).distance == 0);
  CHECK(std::fabs(face(0.25, 0.25, 0).normal.z) == 1);
  CHECK(std::fabs(face(0.5, 0, 0).normal.z) == 1);   // on an edge, distance 0: the face's normal

  const proximity parallel = edge_edge_proximity(a, b, dvec3_make(0.5, 3, 0), dvec3_make(2, 3, 0));
  CHECK(parallel.distance == 3);
  CHECK(parallel.normal.y == -1);
  CHECK(parallel.interior == 0);
  const proximity crossing = edge_edge_proximity(a, b, dvec3_make(0.5, -1, 0), dvec3_make(0.5, 1, 0));
  CHECK(crossing.distance == 0);
  CHECK(std::fabs(crossing.normal.z) == 1);
  CHECK(crossing.interior == 1);
  CHECK(edge_edge_proximity(a, b, dvec3_make(4, 4, 0), dvec3_make(5, 4, 0)).distance == 5);
  CHECK(edge_edge_proximity(a, a, b, b).distance == 1);   // edges of length zero
  CHECK(vertex_face_proximity(b, a, a, a).distance == 1);
  const proximity point = edge_edge_proximity(a, a, a, a);
  CHECK(point.distance == 0);
  CHECK(dnorm(point.normal) == Approx(1));
}
