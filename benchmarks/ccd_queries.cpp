// SPDX-License-Identifier: Apache-2.0
// Cost and errors of continuous collision queries: cama's (additive, cubic) and FCL's on the same queries, on one
// thread.
//   ccd_queries [--repeats N] [--write FOLDER] [NAME=FILE ...]
// FILE: rows of 26 doubles: 1 for two edges or 0 for vertex and face, truth (1, 0), 4 points at the start, 4 at the
// end. The generated sets are always included; --write stores them in this form. Prints CSV:
// set,queries,hits,method,missed,extra,ns (CPU time, median over repeats).
#include <fcl/narrowphase/detail/traversal/collision/intersect.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include "cama/geometry.hpp"

namespace {

using cama::dvec3;
using cama::Quad;

struct Query {
  double edges, truth;
  Quad start, end;
};
static_assert(sizeof(Query) == 26 * sizeof(double));
struct Set {
  std::string name;
  std::vector<Query> queries;
};

dvec3 along(dvec3 a, double s, dvec3 b) { return {a.x + s * b.x, a.y + s * b.y, a.z + s * b.z}; }

/// Pairs with a known answer: the plane z = 0 separates the misses, the hits pass through a contact at the origin in
/// mid step.
class Generator {
public:
  explicit Generator(unsigned seed) : engine_(seed) {}

  /// gap: of a miss, to either side of the plane; slope: of edges and faces against it; slide: motion in the plane;
  /// drop: motion across it; angle: between edges.
  Set operator()(const char *name, bool hits, double gap, double slope, double slide, double drop, double angle)
  {
    Set set{name, {}};
    for (int i = 0; i < 20000; ++i) {
      Query q{static_cast<double>(i & 1), static_cast<double>(hits && i % 4 < 2), {}, {}};
      const int split = q.edges != 0 ? 2 : 1;
      const Quad flat = q.edges != 0 ? edges(angle) : face();
      std::array<dvec3, 2> motion{plane(slide), plane(slide)};
      motion[0].z = q.truth != 0 ? -drop : drop;
      motion[1].z = -motion[0].z;
      for (int k = 0; k < 4; ++k) {
        const int side = k < split ? 0 : 1;
        const double sign = side == 0 ? 1 : -1;
        const dvec3 own = plane(0.2 * slide),
                    move = {motion[side].x + own.x, motion[side].y + own.y, motion[side].z * uniform(0.8, 1.2)};
        if (q.truth != 0) {
          q.start[k] = along(flat[k], -0.5, move);
          q.end[k] = along(flat[k], 0.5, move);
        } else {
          q.start[k] = flat[k];
          q.start[k].z += sign * (gap + slope * uniform(0, 1));
          q.end[k] = {q.start[k].x + move.x, q.start[k].y + move.y,
                      sign * (gap + slope * uniform(0, 1) + drop * uniform(0, 1))};
        }
      }
      rotate(q);
      set.queries.push_back(q);
    }
    return set;
  }

private:
  double uniform(double lo, double hi) { return std::uniform_real_distribution<double>(lo, hi)(engine_); }
  dvec3 plane(double size) { return {uniform(-size, size), uniform(-size, size), 0}; }
  Quad edges(double angle)
  {
    const double s = uniform(.1, .9), t = uniform(.1, .9), c = std::cos(angle), d = std::sin(angle);
    return {dvec3{-s, 0, 0}, dvec3{1 - s, 0, 0}, dvec3{-t * c, -t * d, 0}, dvec3{(1 - t) * c, (1 - t) * d, 0}};
  }
  Quad face()
  {
    const double a = uniform(.1, .8), b = uniform(.1, .9 - a);
    return {dvec3{0, 0, 0}, dvec3{-a, -b, 0}, dvec3{1 - a, -b, 0}, dvec3{-a, 1 - b, 0}};
  }
  void rotate(Query &q)
  {
    double w[4], length = 0;
    for (double &x : w) {
      x = std::normal_distribution<double>()(engine_);
      length += x * x;
    }
    for (double &x : w) x /= std::sqrt(length);
    const auto turn = [&](dvec3 p) {
      const dvec3 u{w[1], w[2], w[3]}, c{u.y * p.z - u.z * p.y, u.z * p.x - u.x * p.z, u.x * p.y - u.y * p.x};
      const dvec3 cc{u.y * c.z - u.z * c.y, u.z * c.x - u.x * c.z, u.x * c.y - u.y * c.x};
      return along(along(p, 2 * w[0], c), 2, cc);
    };
    for (Quad *x : {&q.start, &q.end})
      for (dvec3 &p : *x) p = turn(p);
  }
  std::mt19937_64 engine_;
};

bool additive(const Query &q)
{
  return (q.edges != 0 ? cama::edge_edge_ccd(q.start, q.end) : cama::vertex_face_ccd(q.start, q.end)).hit;
}
bool cubic(const Query &q)
{
  return (q.edges != 0 ? cama::edge_edge_ccd_cubic(q.start, q.end) : cama::vertex_face_ccd_cubic(q.start, q.end)).hit;
}
bool fcl_cubic(const Query &q)
{
  using Intersect = fcl::detail::Intersect<double>;
  fcl::Vector3d a[4], b[4], point;
  double time = 0;
  for (int k = 0; k < 4; ++k) {
    a[k] = {q.start[k].x, q.start[k].y, q.start[k].z};
    b[k] = {q.end[k].x, q.end[k].y, q.end[k].z};
  }
  return q.edges != 0 ? Intersect::intersect_EE(a[0], a[1], a[2], a[3], b[0], b[1], b[2], b[3], &time, &point)
                      : Intersect::intersect_VF(a[1], a[2], a[3], a[0], b[1], b[2], b[3], b[0], &time, &point);
}

void measure(const Set &set, const char *method, bool (*hit)(const Query &), int repeats)
{
  long missed = 0, extra = 0, hits = 0;
  for (const Query &q : set.queries) {
    const bool answer = hit(q);
    hits += q.truth != 0;
    missed += q.truth != 0 && !answer;
    extra += q.truth == 0 && answer;
  }
  const int loops = std::max<int>(1, 20000 / static_cast<int>(set.queries.size()));
  std::vector<double> ns;
  static volatile long sink = 0;
  for (int r = 0; r < repeats; ++r) {
    const std::clock_t begin = std::clock();
    long found = 0;
    for (int l = 0; l < loops; ++l)
      for (const Query &q : set.queries) found += hit(q);
    ns.push_back(1e9 / CLOCKS_PER_SEC * static_cast<double>(std::clock() - begin) / loops /
                 static_cast<double>(set.queries.size()));
    sink = sink + found;
  }
  std::nth_element(ns.begin(), ns.begin() + repeats / 2, ns.end());
  std::printf("%s,%zu,%ld,%s,%ld,%ld,%.0f\n", set.name.c_str(), set.queries.size(), hits, method, missed, extra,
              ns[repeats / 2]);
  std::fflush(stdout);
}

Set read(const std::string &argument)
{
  const std::size_t equals = argument.find('=');
  if (equals == std::string::npos) throw std::runtime_error("expected NAME=FILE, got " + argument);
  Set set{argument.substr(0, equals), {}};
  std::ifstream file(argument.substr(equals + 1), std::ios::binary);
  if (!file) throw std::runtime_error("cannot read " + argument.substr(equals + 1));
  for (Query q; file.read(reinterpret_cast<char *>(&q), sizeof q);) set.queries.push_back(q);
  if (set.queries.empty()) throw std::runtime_error("no queries in " + argument);
  return set;
}

}  // namespace

int main(int count, char **argument)
try {
  int repeats = 15;
  std::string folder;
  Generator generate(1);
  std::vector<Set> sets;   // hits, gap, slope, slide, drop, angle
  sets.push_back(generate("generic", true, 1e-3, 0.5, 0.5, 0.5, 1.0));
  sets.push_back(generate("sliding", false, 5e-4, 0, 0.5, 0, 1.0));
  sets.push_back(generate("near-parallel", true, 1e-6, 0, 1e-3, 1e-2, 1e-4));
  sets.push_back(generate("resting", false, 1e-4, 1e-3, 1e-3, 1e-3, 0.5));
  for (int i = 1; i < count; ++i) {
    const std::string word = argument[i];
    if (word == "--repeats" && i + 1 < count)
      repeats = std::max(1, std::atoi(argument[++i]));
    else if (word == "--write" && i + 1 < count)
      folder = argument[++i];
    else
      sets.push_back(read(word));
  }
  if (!folder.empty())
    for (int k = 0; k < 4; ++k)
      std::ofstream(folder + "/" + sets[k].name + ".bin", std::ios::binary)
          .write(reinterpret_cast<const char *>(sets[k].queries.data()),
                 static_cast<std::streamsize>(sets[k].queries.size() * sizeof(Query)));
  std::printf("set,queries,hits,method,missed,extra,ns\n");
  for (const Set &set : sets) {
    measure(set, "additive", additive, repeats);
    measure(set, "cubic", cubic, repeats);
    measure(set, "fcl", fcl_cubic, repeats);
  }
  return 0;
} catch (const std::exception &e) {
  std::fprintf(stderr, "ccd_queries: %s\n", e.what());
  return 1;
}
