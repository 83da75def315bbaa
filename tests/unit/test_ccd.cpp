// SPDX-License-Identifier: Apache-2.0
// Continuous collision against FCL, hand-made degenerate queries with exact truth, and motions whose contact is known by construction.
#include "../catch.hpp"

#include <fcl/narrowphase/detail/traversal/collision/intersect.h>

#include <chrono>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <random>
#include <sstream>

#include "cama/geometry.hpp"

using namespace cama;
using kernels::dadd;
using kernels::daxpy;
using kernels::dcross;
using kernels::dlerp;
using kernels::dnorm;
using kernels::dnormalize;
using kernels::dscale;
using kernels::dsub;
using kernels::dvec3_make;

namespace {

struct Motion { Quad start, end; bool edges; };

Ccd additive(const Motion &m, double minimum = 0) { return m.edges ? edge_edge_ccd(m.start, m.end, minimum) : vertex_face_ccd(m.start, m.end, minimum); }
Ccd cubic(const Motion &m) { return m.edges ? edge_edge_ccd_cubic(m.start, m.end) : vertex_face_ccd_cubic(m.start, m.end); }
double distance_at(const Motion &m, double t)
{
  Quad x;
  for (int k = 0; k < 4; ++k) x[k] = dlerp(m.start[k], m.end[k], t);
  return m.edges ? edge_edge_distance(x).distance : vertex_face_distance(x).distance;
}

class Random {
public:
  explicit Random(unsigned seed) : engine_(seed) {}
  double operator()(double lo, double hi) { return std::uniform_real_distribution<double>(lo, hi)(engine_); }
  dvec3 vector(double size) { return dvec3_make((*this)(-size, size), (*this)(-size, size), (*this)(-size, size)); }
  dvec3 direction() { return dnormalize(dvec3_make(normal_(engine_), normal_(engine_), normal_(engine_))); }

private:
  std::mt19937_64 engine_;
  std::normal_distribution<double> normal_;
};

/// Four points in touch: a vertex inside a face, or two edges crossing; `parallel` is the sine of the edges' angle or the face's thinness.
Quad touching(Random &random, bool edges, double parallel)
{
  const dvec3 p = random.vector(1), u = random.direction(), v = dnormalize(daxpy(dscale(parallel, random.direction()), 1.0, u));
  if (edges) {
    const double s = random(0.05, 0.95), t = random(0.05, 0.95), a = random(0.5, 2), b = random(0.5, 2);
    return {daxpy(p, -s * a, u), daxpy(p, (1 - s) * a, u), daxpy(p, -t * b, v), daxpy(p, (1 - t) * b, v)};
  }
  double w0 = random(0.05, 1), w1 = random(0.05, 1), w2 = random(0.05, 1);
  const double sum = w0 + w1 + w2;
  w0 /= sum; w1 /= sum; w2 /= sum;
  const dvec3 b = daxpy(dvec3_make(0, 0, 0), random(0.5, 2), u), c = daxpy(dvec3_make(0, 0, 0), random(0.5, 2), v);
  const dvec3 a = dsub(p, dadd(dscale(w1, b), dscale(w2, c)));
  return {p, a, dadd(a, b), dadd(a, c)};
}

dvec3 contact_normal(const Quad &x, bool edges)
{
  return edges ? dnormalize(dcross(dsub(x[1], x[0]), dsub(x[3], x[2]))) : dnormalize(dcross(dsub(x[2], x[1]), dsub(x[3], x[1])));
}

/// A motion that passes through `contact` at `time`; every vertex has its own velocity.
Motion through(Random &random, const Quad &contact, bool edges, double time, double speed)
{
  Motion m{contact, contact, edges};
  for (int k = 0; k < 4; ++k) {
    const dvec3 d = random.vector(speed);
    m.start[k] = daxpy(contact[k], -time, d);
    m.end[k] = daxpy(contact[k], 1 - time, d);
  }
  return m;
}

struct Query { std::string file; int index; Motion motion; bool truth; };

std::vector<std::string> split(const std::string &line)
{
  std::vector<std::string> part;
  std::stringstream stream(line);
  for (std::string s; std::getline(stream, s, ',');) part.push_back(s);
  return part;
}

/// Rows of six integers, numerator and denominator of each coordinate, and the truth; eight rows a query. All are exact doubles.
std::vector<Query> sample_queries(const std::filesystem::path &root)
{
  std::vector<Query> all;
  for (const auto &entry : std::filesystem::recursive_directory_iterator(root)) {
    const std::string kind = entry.path().parent_path().filename().string();
    if (entry.path().extension() != ".csv" || (kind != "edge-edge" && kind != "vertex-face")) continue;
    std::ifstream file(entry.path());
    std::vector<dvec3> x;
    std::string line;
    for (int index = 0; std::getline(file, line);) {
      const auto part = split(line);
      const auto number = [&](int k) { return static_cast<double>(std::strtold(part[2 * k].c_str(), nullptr) / std::strtold(part[2 * k + 1].c_str(), nullptr)); };
      x.push_back(dvec3_make(number(0), number(1), number(2)));
      if (x.size() < 8) continue;
      all.push_back({std::filesystem::relative(entry.path(), root).string(), index++,
                     {{x[0], x[1], x[2], x[3]}, {x[4], x[5], x[6], x[7]}, kind == "edge-edge"}, part[6] == "1"});
      x.clear();
    }
  }
  return all;
}

fcl::Vector3d to_fcl(dvec3 a) { return {a.x, a.y, a.z}; }

bool fcl_hit(const Motion &m, double &time)
{
  fcl::Vector3d point;
  fcl::Vector3d a[4], b[4];
  for (int k = 0; k < 4; ++k) { a[k] = to_fcl(m.start[k]); b[k] = to_fcl(m.end[k]); }
  using Intersect = fcl::detail::Intersect<double>;
  return m.edges ? Intersect::intersect_EE(a[0], a[1], a[2], a[3], b[0], b[1], b[2], b[3], &time, &point)
                 : Intersect::intersect_VF(a[1], a[2], a[3], a[0], b[1], b[2], b[3], b[0], &time, &point);
}

}  // namespace

TEST_CASE("a vertex falling on a face hits at the time of its height", "[ccd]")
{
  const Quad start{dvec3_make(0.2, 0.2, 1), dvec3_make(0, 0, 0), dvec3_make(1, 0, 0), dvec3_make(0, 1, 0)};
  Quad end = start;
  end[0].z = -3;
  const Ccd hit = vertex_face_ccd(start, end), exact = vertex_face_ccd_cubic(start, end);
  REQUIRE(hit.hit);
  CHECK(hit.time <= 0.25);
  CHECK(hit.time == Approx(0.25).epsilon(1e-7));
  CHECK(exact.time == Approx(0.25).epsilon(1e-12));
  CHECK(vertex_face_ccd(start, end, 0.2).time == Approx(0.2).epsilon(1e-7));
  end[0].z = 0.001;
  CHECK_FALSE(vertex_face_ccd(start, end).hit);
  CHECK(vertex_face_ccd(start, end, 0.002).hit);
  end[0] = dvec3_make(0.8, 0.8, -1);   // leaves over the edge
  CHECK_FALSE(vertex_face_ccd({dvec3_make(0.8, 0.8, 1), start[1], start[2], start[3]}, end).hit);
}

TEST_CASE("motions through a known contact are never missed, never reported late", "[ccd]")
{
  Random random(1);
  for (const double offset : {0.0, 100.0, 1e6})
    for (const double parallel : {1.0, 1e-3, 1e-6})
      for (const bool edges : {false, true}) {
        // Far coordinates and thin shapes move the contact by their own rounding, so those pairs cross it by more: at mid step, along the
        // contact's normal, sliding in its plane. The others pass through the contact with four unrelated velocities.
        const bool crossing = offset > 0 || parallel < 1;
        const double reach = 1e-5 + 1e-14 * offset;
        int missed = 0, after = 0, cubic_missed = 0;
        for (int i = 0; i < 20000; ++i) {
          const Quad x = touching(random, edges, parallel);
          const double time = crossing ? 0.5 : random(1e-6, 1 - 1e-6);
          Motion m = through(random, x, edges, time, i % 3 ? 1 : 0.01);
          if (crossing) {
            const dvec3 n = contact_normal(x, edges);
            for (int k = 0; k < 4; ++k) {
              const dvec3 side = dscale(k < (edges ? 2 : 1) ? reach : -reach, n), d = dscale(1e-3, dsub(m.end[k], m.start[k]));
              const dvec3 along = daxpy(d, -kernels::ddot(d, n), n);
              m.start[k] = dadd(daxpy(x[k], -0.5, along), side);
              m.end[k] = dsub(daxpy(x[k], 0.5, along), side);
            }
          }
          const dvec3 shift = dscale(offset, random.direction()), travel = dscale(offset, random.direction());
          for (int k = 0; k < 4; ++k) { m.start[k] = dadd(m.start[k], shift); m.end[k] = dadd(m.end[k], dadd(shift, travel)); }
          const Ccd result = additive(m);
          missed += !result.hit;
          after += result.time > time + (crossing ? 1e-2 : 1e-12);
          cubic_missed += parallel > 1e-6 && !cubic(m).hit;
        }
        CAPTURE(offset, parallel, edges);
        CHECK(missed == 0);
        CHECK(after == 0);
        CHECK(cubic_missed == 0);
      }
}

TEST_CASE("the reported time is certified: no distance below the minimum before it", "[ccd]")
{
  Random random(2);
  int hits = 0;
  double worst = 0;
  for (int i = 0; i < 20000; ++i) {
    Motion m{{}, {}, i % 2 == 0};
    for (int k = 0; k < 4; ++k) { m.start[k] = random.vector(1); m.end[k] = random.vector(1); }
    const double minimum = i % 3 ? 0 : random(0, 0.1);
    if (distance_at(m, 0) <= minimum) continue;
    const Ccd result = additive(m, minimum);
    hits += result.hit;
    double nearest = 10;
    for (int s = 0; s < 200; ++s) nearest = std::min(nearest, distance_at(m, result.time * s / 200.0));
    if (nearest < minimum) FAIL("nearer than the minimum before the reported time");
    if (result.hit) worst = std::max(worst, distance_at(m, result.time) - minimum);
  }
  CHECK(hits > 2000);
  CHECK(worst < 1e-7);   // and the pair is really that near at the reported time
}

TEST_CASE("random motions agree with FCL", "[ccd]")
{
  Random random(3);
  for (const bool edges : {false, true}) {
    int both = 0, missed = 0, extra = 0, cubic_extra = 0, cubic_missed = 0, late = 0, count = 200000;
    double worst = 0;
    for (int i = 0; i < count; ++i) {
      Motion m{{}, {}, edges};
      for (int k = 0; k < 4; ++k) { m.start[k] = random.vector(1); m.end[k] = random.vector(1); }
      double time = 1;
      const bool truth = fcl_hit(m, time) && distance_at(m, time) < 1e-9;   // FCL's inside test is loose
      const Ccd a = additive(m), c = cubic(m);
      missed += truth && !a.hit;
      cubic_missed += truth && !c.hit;
      both += truth && a.hit;
      extra += a.hit && !c.hit;
      cubic_extra += c.hit && distance_at(m, c.time) > 1e-7;
      late += truth && a.hit && a.time > time + 1e-6;
      if (truth && c.hit && c.time <= time) worst = std::max(worst, std::fabs(c.time - a.time));
    }
    CAPTURE(edges, both, worst);
    CHECK(both > 5000);
    CHECK(missed == 0);
    CHECK(cubic_missed == 0);
    CHECK(late == 0);
    CHECK(extra <= 10);
    CHECK(cubic_extra == 0);
    CHECK(worst < 1e-6);
  }
}

TEST_CASE("common motion, however large, changes nothing", "[ccd]")
{
  Random random(4);
  for (int i = 0; i < 2000; ++i) {
    Motion m{{}, {}, i % 2 == 0};
    for (int k = 0; k < 4; ++k) { m.start[k] = random.vector(1); m.end[k] = m.start[k]; }
    for (auto &x : m.end) x = dadd(x, dvec3_make(1024, -4096, 512));
    if (distance_at(m, 0) > 1e-6) REQUIRE_FALSE(additive(m).hit);
  }
}

TEST_CASE("hand-made degenerate queries: no false negative", "[ccd][data]")
{
  const auto folder = test_data("ccd/sample-queries");
  if (!folder) return;
  const std::filesystem::path root = *folder;
  std::map<std::string, double> first;
  std::ifstream times(root / "toi_ours.csv");
  std::string line;
  for (std::getline(times, line); std::getline(times, line);) {
    const auto part = split(line);
    if (part.size() > 3 && !part[3].empty()) first[part[0] + ":" + part[1]] = std::stod(part[3]);
  }
  const auto queries = sample_queries(root);
  int hits = 0, missed = 0, extra = 0, late = 0, cubic_missed = 0, cubic_extra = 0, cubic_off = 0;
  for (const Query &q : queries) {
    const Ccd a = additive(q.motion), c = cubic(q.motion);
    hits += q.truth;
    missed += q.truth && !a.hit;
    extra += !q.truth && a.hit;
    cubic_missed += q.truth && !c.hit;
    cubic_extra += !q.truth && c.hit;
    const auto known = first.find(q.file + ":" + std::to_string(q.index));
    if (known == first.end()) continue;
    late += a.hit && a.time > known->second;
    cubic_off += c.hit && std::fabs(c.time - known->second) > 1e-6;
  }
  WARN(queries.size() << " queries, " << hits << " hits; additive: " << missed << " missed, " << extra << " extra, " << late << " late; cubic: "
                      << cubic_missed << " missed, " << cubic_extra << " extra, " << cubic_off << " off by more than 1e-6");
  CHECK(queries.size() == 4779);
  CHECK(missed == 0);
  CHECK(late == 0);
  CHECK(extra < 100);
  CHECK(cubic_missed == 0);
  CHECK(cubic_off <= 1);   // a vertex that comes within 1e-16 of the face 0.78 before it touches
}

TEST_CASE("cost of a query", "[.benchmark]")
{
  Random random(5);
  for (const bool edges : {false, true})
    for (const int kind : {0, 1, 2}) {
      std::vector<Motion> motions;
      for (int i = 0; i < 20000; ++i) {
        Motion m{{}, {}, edges};
        if (kind == 0) for (int k = 0; k < 4; ++k) { m.start[k] = random.vector(1); m.end[k] = random.vector(1); }
        else if (kind == 1) m = through(random, touching(random, edges, 1), edges, random(0, 1), 0.3);
        else {   // sliding past each other, 1e-3 apart
          m.start = touching(random, edges, 1);
          const int first = edges ? 2 : 1;
          const dvec3 n = contact_normal(m.start, edges);
          for (int k = 0; k < first; ++k) m.start[k] = daxpy(m.start[k], 1e-3, n);
          m.end = m.start;
          dvec3 d = random.vector(0.5);
          d = daxpy(d, -kernels::ddot(d, n), n);
          for (int k = 0; k < first; ++k) m.end[k] = dadd(m.end[k], d);
        }
        motions.push_back(m);
      }
      for (const bool use_cubic : {false, true}) {
        int hits = 0;
        const auto begin = std::chrono::steady_clock::now();
        for (int repeat = 0; repeat < 10; ++repeat) for (const Motion &m : motions) hits += use_cubic ? cubic(m).hit : additive(m).hit;
        const double ns = std::chrono::duration<double, std::nano>(std::chrono::steady_clock::now() - begin).count() / 10.0 / motions.size();
        WARN((edges ? "edge-edge " : "vertex-face ") << (kind == 0 ? "generic " : kind == 1 ? "hitting " : "sliding ") << (use_cubic ? "cubic " : "additive ")
                                                     << ns << " ns, hits " << hits / 10 << " of " << motions.size());
      }
    }
}
