// SPDX-License-Identifier: Apache-2.0
// The certified commit: whatever motion is proposed, no pair crosses. Checked by an independent distance in long double
// with a Lipschitz certificate over the whole path, and by exact intersection tests on scenes.
#include "../catch.hpp"
#include "../judge.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <numeric>
#include <random>
#include <set>

#include "../backends.hpp"
#include "../engine.hpp"
#include "../recorder.hpp"
#include "cama/geometry.hpp"
#include "device/kernels.hpp"
#include "device/launch.hpp"

using namespace cama;
using namespace cama::kernels;

namespace {

using judge::Real;
using judge::Vec;
using Four = std::array<Vec, 4>;

Real distance(const Four &x, bool edges)
{
  return edges ? judge::segment_segment(x[0], x[1], x[2], x[3]) : judge::point_triangle(x[0], x[1], x[2], x[3]);
}

/// Whether the distance is above `least` during the whole linear motion a -> b. Halves it until the midpoint's distance
/// covers the half.
bool stays_separated(const Four &a, const Four &b, bool edges, Real least, int depth = 0)
{
  Four middle;
  Real reach = 0;
  for (int k = 0; k < 4; ++k) {
    middle[k] = 0.5L * (a[k] + b[k]);
    for (int j = 0; j < k; ++j) reach = std::max(reach, judge::length((b[k] - a[k]) - (b[j] - a[j])));
  }
  const Real d = distance(middle, edges);
  if (!(d > least)) return false;
  if (d - least > 0.5L * reach) return true;
  if (depth > 60) return false;
  return stays_separated(a, middle, edges, least, depth + 1) && stays_separated(middle, b, edges, least, depth + 1);
}

constexpr double edge_length = 0.01, dmin = 1e-6;  // m; dmin a thousandth of a 1 mm thickness

struct Trial {
  Quad x, y;
  std::array<double, 4> inverse_mass{1, 1, 1, 1};
  bool edges = false;
};

struct Result {
  std::array<double, 4> fraction;
  double sigma;
  Quad committed;
  int intersecting, state;
};

Result commit(const Trial &trial, double dmin, bool settle = false)
{
  const pair candidate{0, trial.edges ? 1 : 0};
  const face_nodes face{{1, 2, 3}};
  const edge_nodes edge[2] = {{{0, 1}}, {{2, 3}}};
  vertex_contact properties[4] = {};
  for (vertex_contact &p : properties) p.thickness = dmin;  // the commit keeps all of it
  int fraction[4], before[4], vertex_changed[4], outcome[COMMIT_OUTCOMES], cell_marked[4],
      accepted[1] = {COMMIT_CONDITIONAL}, list[1] = {0};
  unsigned char marked[7];  // of the vertices, the face and the edges
  commit_begin(4, 4, 4, fraction, before, cell_marked, outcome);
  const int first = trial.edges ? 0 : 1;
  outcome[COMMIT_LISTED] = 1;
  for (const int pass : {0, settle ? -1 : 1}) {
    commit_pairs(1, first, pass, list, &candidate, &candidate, &face, edge, trial.x.data(), trial.y.data(),
                 trial.inverse_mass.data(), properties, 1.0, 1, accepted, before, fraction, outcome);
    commit_changes(4, fraction, trial.x.data(), trial.x.data(), edge_length, 3, pass, before, vertex_changed,
                   cell_marked, outcome);
    if (settle) std::fill(std::begin(vertex_changed), std::end(vertex_changed), 1);
    commit_disturb(7, 4, 1, &face, edge, vertex_changed, marked);
    commit_recheck(1, 1, first, 4, 1, &candidate, &candidate, marked, accepted, list, outcome);
  }
  Result r;
  commit_apply(4, trial.x.data(), trial.y.data(), fraction, outcome, r.committed.data());
  r.sigma = bits_float(outcome[COMMIT_SIGMA]);
  for (int k = 0; k < 4; ++k) r.fraction[k] = double(bits_float(fraction[k])) * r.sigma;
  r.intersecting = outcome[COMMIT_CROSSED];
  r.state = accepted[0];
  return r;
}

Vec wide(dvec3 a) { return {a.x, a.y, a.z}; }
Four wide(const Quad &x) { return {wide(x[0]), wide(x[1]), wide(x[2]), wide(x[3])}; }

/// The path x + s t d, s from 0 to sigma.
bool path_is_safe(const Trial &trial, const Result &r, Real least)
{
  Four end;
  for (int k = 0; k < 4; ++k) {
    const Vec x = wide(trial.x[k]);
    end[k] = x + static_cast<Real>(r.fraction[k]) * (wide(trial.y[k]) - x);
  }
  return stays_separated(wide(trial.x), end, trial.edges, least);
}

class Random {
public:
  explicit Random(unsigned seed) : engine_(seed) {}
  double operator()(double lo, double hi) { return std::uniform_real_distribution<double>(lo, hi)(engine_); }
  double scale(double lo, double hi) { return std::exp((*this)(std::log(lo), std::log(hi))); }
  dvec3 vector(double size) { return dvec3_make((*this)(-size, size), (*this)(-size, size), (*this)(-size, size)); }
  dvec3 direction() { return dnormalize(dvec3_make(normal_(engine_), normal_(engine_), normal_(engine_))); }

private:
  std::mt19937_64 engine_;
  std::normal_distribution<double> normal_;
};

/// A pair near touching, its features at random angles; `thin` the sine of the angle between edges, or of the face's
/// corner.
Quad near_pair(Random &random, bool edges, double thin, double gap)
{
  const dvec3 u = random.direction(), w = random.direction(), v = dnormalize(daxpy(u, thin, w));
  const dvec3 n = dnormalize(dcross(u, v)), zero = dvec3_make(0, 0, 0);
  const double a = random(0.3, 1.5) * edge_length, b = random(0.3, 1.5) * edge_length, s = random(-0.1, 1.1),
               t = random(-0.1, 1.1);
  if (edges)
    return {daxpy(dscale(gap, n), -s * a, u), daxpy(dscale(gap, n), (1 - s) * a, u), daxpy(zero, -t * b, v),
            daxpy(zero, (1 - t) * b, v)};
  const dvec3 e = dscale(a, u), f = dscale(b, v), p = daxpy(daxpy(dscale(gap, n), s, e), t * (1 - s), f);
  return {p, zero, e, f};
}

/// kind: 0 generic, 1 sliding, 2 sliver or near parallel, 3 large common motion, 4 far from the origin
Trial make_trial(Random &random, int kind, bool kinematic)
{
  Trial trial;
  do {
    trial.edges = random(0, 1) < 0.5;
    const double thin = kind == 2 ? random.scale(1e-8, 1e-1) : random(0.1, 1), speed = random.scale(1e-5, 0.1);
    trial.x = near_pair(random, trial.edges, thin, random.scale(dmin, 5e-3));
    const dvec3 slide = random.vector(speed);
    for (int k = 0; k < 4; ++k) {
      const bool first = k < (trial.edges ? 2 : 1);
      const dvec3 d =
          kind == 1 ? daxpy(dscale(first ? 1 : -1, slide), 0.05, random.vector(speed)) : random.vector(speed);
      trial.y[k] = dadd(trial.x[k], d);
      trial.inverse_mass[k] = kinematic && random(0, 1) < 0.4 ? 0 : 1;
    }
    if (*std::max_element(trial.inverse_mass.begin(), trial.inverse_mass.end()) == 0) trial.inverse_mass[0] = 1;
    const dvec3 shift = kind == 4 ? random.vector(random.scale(1, 1e6)) : random.vector(1),
                common = kind >= 3 ? random.vector(kind == 3 ? 1 : 0.1) : dvec3_make(0, 0, 0);
    for (int k = 0; k < 4; ++k) {
      trial.x[k] = dadd(trial.x[k], shift);
      trial.y[k] = dadd(trial.y[k], dadd(shift, common));
    }
  } while (!(distance(wide(trial.x), trial.edges) > dmin * 1.001));
  return trial;
}

}  // namespace

namespace {

/// Ten kinds of pairs, `count` of each, with motions of any size, checked in long double along the whole path.
void check_pairs(unsigned seed, int count)
{
  Random random(seed);
  for (const bool kinematic : {false, true})
    for (int kind = 0; kind < 5; ++kind) {
      int unsafe = 0, nearer = 0, whole = 0, conditional = 0, intersecting = 0, stopped = 0;
      double kept = 0;
      for (int i = 0; i < count; ++i) {
        const Trial trial = make_trial(random, kind, kinematic);
        const Result r = commit(trial, dmin, i % 4 == 0);
        unsafe += !path_is_safe(trial, r, 0.9L * dmin);
        nearer += !(distance(wide(r.committed), trial.edges) > dmin * 0.9999L - (kind == 4 ? 1e-9L : 0));
        intersecting += r.intersecting;
        conditional += r.state == COMMIT_CONDITIONAL;
        for (double t : r.fraction) kept += 0.25 * t / count;
        whole += *std::min_element(r.fraction.begin(), r.fraction.end()) == 1;
        stopped += r.sigma == 0;
      }
      CAPTURE(kinematic, kind);
      INFO("motion kept " << kept << ", untouched " << double(whole) / count << ", conditional "
                          << double(conditional) / count << ", sigma 0: " << stopped);
      CHECK(unsafe == 0);
      CHECK(nearer == 0);
      CHECK(intersecting == 0);
      CHECK(stopped == 0);
      CHECK(kept > 0.3);
      if (std::getenv("CAMA_VERBOSE"))
        WARN("kinematic " << kinematic << " kind " << kind << ": kept " << kept << ", untouched "
                          << double(whole) / count << ", conditional " << double(conditional) / count);
    }
}

}  // namespace

TEST_CASE("pairs that keep their distance by their bounds are not looked at again", "[commit]")
{
  // A vertex and a face at rest 1 m above each other, and two edges; directions of no length tell nothing.
  const std::vector<dvec3> x = {{0, 0, 1}, {-1, -1, 0}, {1, -1, 0}, {0, 1, 0}, {1, 0, 1}};
  const face_nodes face = {{1, 2, 3}};
  const edge_nodes edge[2] = {{{0, 4}}, {{1, 2}}};
  const pair vertex_face = {0, 0}, edge_edge = {0, 1};
  const fvec3 none = {0, 0, 0};
  vertex_contact own{};
  own.thickness = 0.2;
  own.shape = SHAPE_MESH;
  const std::vector<vertex_contact> properties(x.size(), own);
  const double share = 0.5;  // 0.101 m are to be kept
  const auto listed = [&](std::vector<float> error, float face_bound, float edge_bound, bool bounds, bool certified) {
    int accepted[2] = {-1, -1}, list[2] = {-1, -1}, outcome[COMMIT_OUTCOMES] = {};
    commit_screen(1, 2, 1, int(x.size()), 1, certified, &vertex_face, &edge_edge, &face, edge, x.data(), x.data(),
                  &none, &none, properties.data(), bounds, &face_bound, bounds, &edge_bound,
                  error.empty() ? nullptr : error.data(), share, own.thickness, accepted, list, outcome);
    CHECK((accepted[0] == COMMIT_CONDITIONAL && accepted[1] == COMMIT_CONDITIONAL));
    std::vector<int> found(list, list + outcome[COMMIT_LISTED]);
    std::sort(found.begin(), found.end());
    return found;
  };
  using Places = std::vector<int>;
  const float much = 9;  // of features that no pair has
  CHECK(listed({0.1f, much, much, much, much, 0.09f, 0.05f, 0.14f}, 0.3f, 0.3f, true, false) == Places{});
  CHECK(listed({0.1f, much, much, much, much, 0.11f, 0.05f, 0.14f}, 0.3f, 0.3f, true, false) == Places{0});
  CHECK(listed({0.1f, much, much, much, much, 0.09f, 0.06f, 0.15f}, 0.3f, 0.3f, true, false) == Places{1});
  CHECK(listed({0, 0, 0, 0, 0, 0, 0, 0}, 0, 0, true, false) == Places{0, 1});  // no pair has a bound
  CHECK(listed({}, 0.3f, 0.3f, false, false) == Places{0, 1});  // bounds of another motion
  CHECK(listed({}, -1, 0, false, true) == Places{0});  // all are certified but for an impact
}

TEST_CASE("no proposed motion makes a pair cross or come nearer than the minimum", "[commit]")
{
  check_pairs(11, 20000);
}
TEST_CASE("a million pairs neither cross nor come nearer than the minimum", "[commit][.][long]")
{
  check_pairs(17, 100000);
}

TEST_CASE("common translation of touching pairs loses nothing", "[commit]")
{
  Random random(12);
  for (const double far : {0.0, 1e3, 1e6})
    for (const double nearness : {0.3, 1.0, 1.0001, 3.0}) {  // of dmin: pairs below it may move too
      int lost = 0;
      for (int i = 0; i < 5000; ++i) {
        Trial trial;
        trial.edges = i % 2;
        trial.x = near_pair(random, trial.edges, random(0.05, 1), nearness * dmin);
        const dvec3 shift = random.vector(far), fall = random.vector(random.scale(1e-3, 100));
        for (int k = 0; k < 4; ++k) {
          trial.x[k] = dadd(trial.x[k], shift);
          trial.y[k] = dadd(trial.x[k], fall);
          trial.inverse_mass[k] = random(0, 1) < 0.3 ? 0 : 1;
        }
        const Result r = commit(trial, dmin);
        lost += *std::min_element(r.fraction.begin(), r.fraction.end()) < 1;
        for (int k = 0; k < 4; ++k)
          lost += std::memcmp(&r.committed[k], &trial.y[k], sizeof(dvec3)) != 0 && r.fraction[k] == 1;
      }
      CAPTURE(far, nearness);
      CHECK(lost == 0);
    }
}

TEST_CASE("an obstacle pauses before it would pass through cloth", "[commit]")
{
  Trial trial;  // a pinned vertex 1 mm above an obstacle that rises 4 mm
  trial.x = {dvec3_make(0.2, 0.2, 1e-3), dvec3_make(0, 0, 0), dvec3_make(1, 0, 0), dvec3_make(0, 1, 0)};
  trial.y = trial.x;
  for (int k = 1; k < 4; ++k) trial.y[k].z = 4e-3;
  trial.inverse_mass = {1, 0, 0, 0};
  const Result r = commit(trial, dmin);
  CHECK(r.sigma == Approx(0.9 * (1e-3 - dmin) / 4e-3).epsilon(1e-6));
  CHECK(path_is_safe(trial, r, dmin));
  trial.y[0].z = 5e-3;  // it moves out of the way
  const Result free = commit(trial, dmin);
  CHECK(free.sigma == 1);
  CHECK(free.fraction[0] == 1);
  trial.y[0].z = -1e-3;  // it comes down on a static obstacle: only the vertex is stopped, before it touches
  for (int k = 1; k < 4; ++k) trial.y[k].z = 0;
  const Result falling = commit(trial, dmin);
  CHECK(falling.sigma == 1);
  CHECK(falling.committed[0].z >= dmin);
  CHECK(falling.committed[0].z < 2e-4);
  trial.inverse_mass[0] = 0;  // two obstacles: the commit ignores them
  CHECK(commit(trial, dmin).fraction[0] == 1);
}

TEST_CASE("pairs nearer than the minimum may leave, and approach by half; intersecting ones are counted", "[commit]")
{
  Trial trial;
  trial.x = {dvec3_make(0.2, 0.2, 0.5e-6), dvec3_make(0, 0, 0), dvec3_make(1, 0, 0), dvec3_make(0, 1, 0)};
  trial.y = trial.x;
  trial.y[0].z = 1e-3;
  CHECK(commit(trial, dmin).fraction[0] == 1);
  trial.y[0].z = 0.1e-6;
  CHECK(commit(trial, dmin).committed[0].z >= 0.25e-6);
  CHECK(commit(trial, dmin).committed[0].z < 0.5e-6);
  trial.y[0].z = -1;
  CHECK(commit(trial, dmin).committed[0].z >= 0.25e-6);
  trial.x[0].z = 0;
  CHECK(commit(trial, dmin).intersecting == 1);
}

namespace {

/// Hundreds of triangles, every vertex with its own motion; all pairs are candidates.
struct Soup {
  std::vector<dvec3> position;
  std::vector<Triangle> face;
  std::vector<face_nodes> faces;
  std::vector<edge_nodes> edges;
  std::vector<pair> vertex_face, edge_edge;
  std::vector<double> inverse_mass;

  void connect()
  {
    for (const Triangle &t : face) {
      faces.push_back({{t[0], t[1], t[2]}});
      for (int k = 0; k < 3; ++k) edges.push_back({{t[k], t[(k + 1) % 3]}});
    }
    inverse_mass.assign(position.size(), 1);
    for (int v = 0; v < int(position.size()); ++v)
      for (int f = 0; f < int(face.size()); ++f)
        if (std::find(face[f].begin(), face[f].end(), v) == face[f].end()) vertex_face.push_back({v, f});
    for (int a = 0; a < int(edges.size()); ++a)
      for (int b = a + 1; b < int(edges.size()); ++b)
        if (a / 3 != b / 3) edge_edge.push_back({a, b});
  }

  /// Runs the commit and returns the fractions. cap < 0: until nothing changes. runs: passes look at the runs of pairs
  /// near what was truncated; many: with the kernel for lists of many pairs.
  std::vector<int> commit(const std::vector<dvec3> &target, int cap, bool runs = false, bool many = false)
  {
    const int n = int(position.size()), first = int(vertex_face.size()), edge_pairs = int(edge_edge.size()),
              pairs = first + edge_pairs, cells = 1 << 14;
    const dvec3 origin{-1, -2, -3};
    std::vector<int> fraction(n), before(n), vertex_changed(n), accepted(pairs, COMMIT_CONDITIONAL), list(pairs),
        cell_marked(cells), run(runs_of(first) + runs_of(edge_pairs));
    std::vector<unsigned char> feature_marked(position.size() + faces.size() + edges.size());
    std::vector<vertex_contact> properties(position.size());
    for (vertex_contact &p : properties) p.thickness = 1e-6;
    int outcome[COMMIT_OUTCOMES];
    commit_begin(std::max(n, cells), n, cells, fraction.data(), before.data(), cell_marked.data(), outcome);
    std::iota(list.begin(), list.end(), 0);
    outcome[COMMIT_LISTED] = pairs;
    const auto recheck = [&] {
      commit_disturb(int(feature_marked.size()), n, int(faces.size()), faces.data(), edges.data(),
                     vertex_changed.data(), feature_marked.data());
      commit_recheck(runs_of(pairs), pairs, first, n, int(faces.size()), vertex_face.data(), edge_edge.data(),
                     feature_marked.data(), accepted.data(), list.data(), outcome);
    };
    std::vector<box> boxes[2] = {std::vector<box>(runs_of(first)), std::vector<box>(runs_of(edge_pairs))};
    if (runs)
      for (int kind = 0; kind < 2; ++kind)
        bound_runs(int(boxes[kind].size()), kind, 0, kind == 0 ? first : edge_pairs,
                   kind == 0 ? vertex_face.data() : edge_edge.data(), faces.data(), edges.data(), position.data(),
                   &origin, boxes[kind].data());
    const auto recheck_runs = [&](int mark) {
      list_marked_runs(int(run.size() - 1) / PAIR_TEAM + 1, int(run.size()), int(boxes[0].size()), boxes[0].data(),
                       boxes[1].data(), cell_size, cells - 1, cell_marked.data(), mark, run.data(), COMMIT_RUNS,
                       outcome);
      looked_at += outcome[COMMIT_RUNS];
      all_runs += int(run.size());
      commit_recheck_runs(3, first, edge_pairs, run.data(), vertex_face.data(), edge_edge.data(), faces.data(),
                          edges.data(), vertex_changed.data(), accepted.data(), list.data(), outcome);
    };
    const auto pass = [&](int number) {
      const int changes = outcome[COMMIT_CHANGES];
      const auto decide = [&](auto kernel) {  // by so few teams that lists are long for them
        kernel(3, first, number, list.data(), vertex_face.data(), edge_edge.data(), faces.data(), edges.data(),
               position.data(), target.data(), inverse_mass.data(), properties.data(), 1.0, 0, accepted.data(),
               before.data(), fraction.data(), outcome);
      };
      many ? decide(commit_many_pairs) : decide(commit_pairs);
      commit_changes(n, fraction.data(), position.data(), &origin, cell_size, cells - 1, number + 1, before.data(),
                     vertex_changed.data(), cell_marked.data(), outcome);
      return outcome[COMMIT_CHANGES] != changes;
    };
    bool changed = pass(0);
    for (int k = 1; k != cap && changed; ++k) {
      runs ? recheck_runs(k) : recheck();
      changed = pass(k);
    }
    if (cap >= 0) {
      outcome[COMMIT_LISTED] = 0;
      vertex_changed.assign(std::size_t(n), 1);
      recheck();
      pass(-1);
    }
    std::vector<dvec3> committed(position.size());
    commit_apply(n, position.data(), target.data(), fraction.data(), outcome, committed.data());
    position = committed;
    return fraction;
  }

  static int runs_of(int pairs) { return (pairs + RUN_PAIRS - 1) / RUN_PAIRS; }

  double cell_size = 0.02;
  int looked_at = 0, all_runs = 0;  // by all passes that look at runs
};

double mean(const std::vector<int> &fraction)
{
  double sum = 0;
  for (int t : fraction) sum += bits_float(t);
  return sum / double(fraction.size());
}

Soup make_soup(Random &random)
{
  Soup soup;
  for (int k = 0; k < 60; ++k) {
    const std::vector<dvec3> kept = soup.position;
    const dvec3 p = random.vector(0.02);
    const int first = int(kept.size());
    for (int j = 0; j < 3; ++j) soup.position.push_back(dadd(p, random.vector(0.008)));
    soup.face.push_back({first, first + 1, first + 2});
    if (!intersections(soup.position, soup.face).empty()) {
      soup.position = kept;
      soup.face.pop_back();
    }
  }
  soup.connect();
  return soup;
}

/// Several of them, which never meet.
Soup make_soups(Random &random, int count)
{
  Soup all;
  for (int k = 0; k < count; ++k) {
    const Soup one = make_soup(random);
    const int v = int(all.position.size()), f = int(all.faces.size()), e = int(all.edges.size());
    for (const dvec3 &p : one.position) all.position.push_back(dadd(p, {double(k), 0, 0}));
    for (const face_nodes &t : one.faces) all.faces.push_back({{v + t.node[0], v + t.node[1], v + t.node[2]}});
    for (const edge_nodes &t : one.edges) all.edges.push_back({{v + t.node[0], v + t.node[1]}});
    for (const pair &p : one.vertex_face) all.vertex_face.push_back({v + p.a, f + p.b});
    for (const pair &p : one.edge_edge) all.edge_edge.push_back({e + p.a, e + p.b});
  }
  all.inverse_mass.assign(all.position.size(), 1);
  return all;
}

}  // namespace

TEST_CASE("passes of the commit that look at runs nearby, or put work off, truncate what others do", "[commit]")
{
  int looked_at = 0, all_runs = 0;
  for (const int soups : {1, 6}) {
    Random random(unsigned(17 + soups));
    Soup all = make_soups(random, soups), other = all, late = all;
    for (int step = 0; step < 30; ++step) {
      std::vector<dvec3> target = all.position;
      for (dvec3 &x : target) x = dadd(x, random.vector(step % 2 ? 0.004 : 0.0004));
      const std::vector<int> fraction = all.commit(target, -1);
      REQUIRE(other.commit(target, -1, true) == fraction);
      REQUIRE(late.commit(target, -1, false, true) == fraction);
    }
    looked_at += other.looked_at;
    all_runs += other.all_runs;
  }
  CAPTURE(looked_at, all_runs);
  CHECK(looked_at < 0.8 * all_runs);
  CHECK(looked_at > 0);
}

TEST_CASE("what is put off in long lists ends as what is decided at once, on every backend", "[commit]")
{
  Random random(29);
  const Soup soup = make_soups(random, 6);
  const int n = int(soup.position.size()), first = int(soup.vertex_face.size()),
            pairs = first + int(soup.edge_edge.size()), teams = 3;  // so few that the lists are long for them
  std::vector<dvec3> target = soup.position;
  for (dvec3 &x : target) x = dadd(x, random.vector(0.004));
  vertex_contact thin = {};
  thin.thickness = 1e-6;
  std::vector<int> all(std::size_t(pairs), 0), code(std::size_t(pairs), 0);
  std::iota(all.begin(), all.end(), 0);
  for (int i = 0; i < pairs; ++i) code[std::size_t(i)] = i < first ? pair_code(0, i) : pair_code(1, i - first);
  std::vector<int> outcome(COMMIT_OUTCOMES, 0), detection(DETECTION_COUNTS, 0);
  outcome[COMMIT_LISTED] = detection[DETECTION_UNCLEAR] = pairs;
  outcome[COMMIT_SIGMA] = COMMIT_WHOLE;
  std::vector<int> expected_fraction, expected_states, expected_impacts;
  for (const std::string &name : backends_here()) {
    INFO(name);
    const auto backend = make_backend(name, 0, 2);
    Backend &b = *backend;
    const Stream<pair> faces_near(b, soup.vertex_face), edges_near(b, soup.edge_edge);
    const Stream<face_nodes> faces(b, soup.faces);
    const Stream<edge_nodes> edges(b, soup.edges);
    const Stream<dvec3> from(b, soup.position), to(b, target);
    const Stream<double> inverse_mass(b, soup.inverse_mass);
    const Stream<vertex_contact> properties(b, std::vector<vertex_contact>(std::size_t(n), thin));
    const Stream<int> list(b, all), before(b, std::vector<int>(std::size_t(n), COMMIT_WHOLE));
    for (const bool many : {false, true}) {
      INFO((many ? "put off" : "at once"));
      Stream<int> states(b, std::vector<int>(std::size_t(pairs), COMMIT_CONDITIONAL)),
          fraction(b, std::vector<int>(std::size_t(n), COMMIT_WHOLE)), counts(b, outcome), codes(b, code),
          found(b, detection);
      const auto decide = [&](auto &&...arguments) {
        if (many)
          CAMA_LAUNCH_TEAMS(void, b, commit_many_pairs, PAIR_TEAM, teams, arguments...);
        else
          CAMA_LAUNCH_TEAMS(void, b, commit_pairs, PAIR_TEAM, teams, arguments...);
      };
      decide(first, 1, list, faces_near, edges_near, faces, edges, from, to, inverse_mass, properties, 1.0, 0, states,
             before, fraction, counts);
      const auto find = [&](auto &&...arguments) {
        if (many)
          CAMA_LAUNCH_TEAMS(void, b, find_many_impacts, PAIR_TEAM, teams, arguments...);
        else
          CAMA_LAUNCH_TEAMS(void, b, find_impacts, PAIR_TEAM, teams, arguments...);
      };
      find(0, faces_near, edges_near, faces, edges, from, to, properties, 1.0, codes, found);
      if (expected_fraction.empty()) {
        expected_fraction = fraction.download();
        expected_states = states.download();
        expected_impacts = codes.download();
        CHECK(mean(expected_fraction) < 0.95);
      }
      CHECK(fraction.download() == expected_fraction);
      CHECK(states.download() == expected_states);
      CHECK(codes.download() == expected_impacts);
      const auto impacts =
          std::count_if(expected_impacts.begin(), expected_impacts.end(), [](int at) { return at != NO_PAIR; });
      CHECK(impacts > 50);
      CHECK(found.at(DETECTION_IMPACTS) == impacts);
    }
  }
}

TEST_CASE("a stack that lands is truncated layer by layer, whatever runs a pass looks at", "[commit]")
{
  // 400 triangles over a fixed one, 10 mm apart, go down by 25 mm. Each pass stops one more.
  Soup stack;
  constexpr int layers = 401;
  for (int k = 0; k < layers; ++k) {
    const int v = 3 * k;
    for (const dvec3 &x : {dvec3{0, 0, 0}, dvec3{1, 0, 0}, dvec3{0, 1, 0}})
      stack.position.push_back(dadd(x, {0.0003 * k, 0.0002 * k, 0.01 * k}));
    stack.faces.push_back({{v, v + 1, v + 2}});
    for (int j = 0; j < 3; ++j) stack.edges.push_back({{v + j, v + (j + 1) % 3}});
  }
  for (int k = 0; k + 1 < layers; ++k)
    for (int j = 0; j < 3; ++j) {
      stack.vertex_face.push_back({3 * k + j, k + 1});
      stack.vertex_face.push_back({3 * k + 3 + j, k});
      for (int i = 0; i < 3; ++i) stack.edge_edge.push_back({3 * k + j, 3 * k + 3 + i});
    }
  stack.inverse_mass.assign(3 * layers, 1);
  std::fill_n(stack.inverse_mass.begin(), 3, 0.0);
  std::vector<dvec3> target = stack.position;
  for (int v = 3; v < 3 * layers; ++v) target[std::size_t(v)].z -= 0.025;
  Soup near = stack;
  near.cell_size = 0.5;  // a run has the pairs of some 85 or 57 layers
  const std::vector<int> fraction = stack.commit(target, -1);
  CHECK(near.commit(target, -1, true) == fraction);
  CAPTURE(near.looked_at, near.all_runs);
  CHECK(near.all_runs > 12 * 100);
  CHECK(near.looked_at < 0.6 * near.all_runs);
  for (int v = 3; v < 3 * layers; ++v) {
    CAPTURE(v);
    REQUIRE(bits_float(fraction[std::size_t(v)]) < 1);
    REQUIRE(near.position[std::size_t(v)].z > near.position[std::size_t(v - 3)].z);
  }
}

TEST_CASE("boxes of runs hold their pairs, and marked cells find every run with a marked vertex", "[commit]")
{
  // A strip along x: its features follow each other, and so do the pairs.
  constexpr int vertices = 3000, cells = 1 << 16, mark = 7;
  const dvec3 origin{-0.5, -0.1, 100};
  const double size = 0.5;
  Random random(31);
  std::vector<dvec3> x;
  for (int v = 0; v < vertices; ++v) x.push_back(dadd(origin, dadd({0.01 * v, 0.02, 0.02}, random.vector(0.02))));
  std::vector<face_nodes> face;
  std::vector<edge_nodes> edge;
  for (int v = 0; v + 2 < vertices; ++v) {
    face.push_back({{v, v + 1, v + 2}});
    edge.push_back({{v, v + 1}});
  }
  std::vector<pair> list[2];
  for (int v = 0; v + 8 < vertices; ++v) {
    list[0].push_back({v, v + 4});
    list[1].push_back({v, v + 3});
    list[1].push_back({v, v + 5});
  }
  const int first = 3;  // runs that have their boxes already
  for (const std::string &name : backends_here()) {
    INFO(name);
    const auto backend = make_backend(name, 0, 2);
    const Stream<dvec3> position(*backend, x), bounds(*backend, {origin, origin});
    const Stream<face_nodes> faces(*backend, face);
    const Stream<edge_nodes> edges(*backend, edge);
    Stream<box> boxes[2] = {Stream<box>(*backend), Stream<box>(*backend)};
    for (int kind = 0; kind < 2; ++kind) {
      const int pairs = int(list[kind].size()), runs = Soup::runs_of(pairs);
      const Stream<pair> all(*backend, list[kind]);
      boxes[kind].resize(runs);
      for (const auto &[from, to] : {std::pair(0, first), std::pair(first, runs)})
        CAMA_LAUNCH_TEAMS(void, *backend, bound_runs, PAIR_TEAM, to - from, kind, from, pairs, all, faces, edges,
                          position, bounds, boxes[kind]);
      const std::vector<box> found = boxes[kind].download();
      for (int r = 0; r < runs; ++r) {
        double lo[3] = {1e9, 1e9, 1e9}, hi[3] = {-1e9, -1e9, -1e9};
        for (int i = RUN_PAIRS * r; i < std::min(RUN_PAIRS * (r + 1), pairs); ++i)
          for (const int v : pair_nodes(kind, list[kind][std::size_t(i)], face.data(), edge.data()).node)
            for (int k = 0; k < 3; ++k) {
              const double c = dcomponent(x[std::size_t(v)], k) - dcomponent(origin, k);
              lo[k] = std::min(lo[k], c);
              hi[k] = std::max(hi[k], c);
            }
        for (int k = 0; k < 3; ++k) {
          CAPTURE(kind, r, k);
          CHECK(double(found[std::size_t(r)].lo[k]) <= lo[k]);
          CHECK(double(found[std::size_t(r)].lo[k]) == Approx(lo[k]).epsilon(1e-6).margin(1e-12));
          CHECK(double(found[std::size_t(r)].hi[k]) >= hi[k]);
          CHECK(double(found[std::size_t(r)].hi[k]) == Approx(hi[k]).epsilon(1e-6).margin(1e-12));
        }
      }
    }
    // Vertices 400 and 2500 are marked, all others with an earlier mark.
    std::vector<int> marked(cells, mark - 1);
    std::set<int> expected;
    for (const int v : {400, 2500}) {
      marked[std::size_t(cell_of_position(x[std::size_t(v)], origin, size, cells - 1))] = mark;
      for (int kind = 0; kind < 2; ++kind)
        for (int i = 0; i < int(list[kind].size()); ++i)
          for (const int node : pair_nodes(kind, list[kind][std::size_t(i)], face.data(), edge.data()).node)
            if (node == v) expected.insert(pair_code(kind, i / RUN_PAIRS));
    }
    REQUIRE(expected.size() >= 4);
    const int faces_runs = boxes[0].size(), runs = faces_runs + boxes[1].size();
    const Stream<int> cell_marked(*backend, marked);
    Stream<int> run(*backend, runs), found(*backend, std::vector<int>{-1, 0});
    CAMA_LAUNCH_TEAMS(void, *backend, list_marked_runs, PAIR_TEAM, 1, runs, faces_runs, boxes[0], boxes[1], size,
                      cells - 1, cell_marked, mark, run, 1, found);
    CHECK(found.at(0) == -1);
    std::vector<int> listed = run.download();
    listed.resize(std::size_t(found.at(1)));
    const std::set<int> told(listed.begin(), listed.end());
    CHECK(told.size() == listed.size());
    CHECK(std::includes(told.begin(), told.end(), expected.begin(), expected.end()));
    CHECK(told.size() <= expected.size() + 2);  // beside those, at most one at each cell
    // What meets too many cells counts as marked.
    found.assign({-1, 0});
    CAMA_LAUNCH_TEAMS(void, *backend, list_marked_runs, PAIR_TEAM, 1, runs, faces_runs, boxes[0], boxes[1], 1e-4,
                      cells - 1, cell_marked, mark + 1, run, 1, found);
    CHECK(found.at(1) == runs);
  }
}

TEST_CASE("a soup of triangles in wild motion never intersects", "[commit]")
{
  Random random(13);
  for (const int cap : {-1, 1, 3}) {
    Soup soup = make_soup(random);
    REQUIRE(soup.face.size() > 25);
    double kept = 0;
    for (int step = 0; step < 40; ++step) {
      std::vector<dvec3> target = soup.position;
      const dvec3 common = random.vector(0.05);
      for (std::size_t v = 0; v < target.size(); ++v)
        target[v] = dadd(target[v], dadd(common, random.vector(step % 2 ? 0.004 : 0.0004)));
      kept += mean(soup.commit(target, cap)) / 40;
      REQUIRE(intersections(soup.position, soup.face).empty());
    }
    CAPTURE(cap, kept);
    CHECK(kept > 0.2);
    if (std::getenv("CAMA_VERBOSE")) WARN("soup, cap " << cap << ": kept " << kept);
  }
}

namespace {

/// Draped cloth whose vertices are moved randomly by several edge lengths, protected by the commit alone; intersections
/// are counted by exact predicates.
void check_mesh(const char *scene_name, int triangles, int settle, int rounds)
{
  Scene scene = Scene::load(std::string(CAMA_SOURCE_DIR) + "/scenes/" + scene_name, triangles);
  scene.time_step = chosen_time_step(Options::at(Accuracy::paper), scene);
  Options options = serial();
  StagedEngine engine(scene, options);
  for (int step = 0; step < settle; ++step) engine.step();
  State &state = engine.state;
  state.options.max_impact_passes = 0;
  state.options.pinch = Pinch::stop;
  const std::vector<Triangle> &face = engine.topology.face;
  REQUIRE(intersections(state.mesh.position.download(), face, state.mesh.cloth_vertices).empty());
  const std::vector<int> fixed = state.mesh.fixed.download();
  Random random(23);
  int truncated = 0;
  for (int round = 0; round < rounds; ++round) {
    engine.run_before("penetration handling");
    std::vector<dvec3> target = state.mesh.position.download();
    const double reach = random.scale(1e-4, 0.1);
    for (int v = 0; v < state.mesh.cloth_vertices; ++v)
      if (!fixed[static_cast<std::size_t>(v)]) target[v] = dadd(target[v], random.vector(reach));
    state.mesh.position_next.assign(target);
    engine.find("penetration handling")->run(state);
    truncated += state.report.truncated;
    const std::vector<dvec3> committed = state.mesh.position_next.download();
    CAPTURE(round, reach);
    REQUIRE(intersections(committed, face, state.mesh.cloth_vertices).empty());
    state.mesh.position.assign(committed);
    state.mesh.velocity.fill_zero();
  }
  CHECK(truncated > rounds * state.mesh.cloth_vertices / 20);
}

}  // namespace

TEST_CASE("whole meshes in random motion never intersect", "[commit]")
{
  check_mesh("sphere", 600, 60, 10);
  check_mesh("drape", 600, 60, 10);
}

TEST_CASE("the motion that truncation takes is summed over the cloth", "[commit]")
{
  const int cloth = 2 * LOST_VERTICES + 3, all = cloth + 5;  // with vertices of an obstacle behind
  std::vector<int> fraction(all, COMMIT_WHOLE);
  for (const int v : {0, 255, 256, cloth - 1, cloth}) fraction[std::size_t(v)] = float_bits(0.75f);
  std::vector<commit_loss> loss(3);
  commit_losses(3, cloth, fraction.data(), loss.data());
  CHECK(loss[0].vertices == 2);
  CHECK(loss[0].motion == 0.5);
  CHECK(loss[1].vertices == 1);
  CHECK(loss[1].motion == 0.25);
  CHECK(loss[2].vertices == 1);
  CHECK(loss[2].motion == 0.25);
}

TEST_CASE("where cloth is squeezed, late passes look at the runs nearby", "[commit]")
{
  Scene scene = Scene::load(std::string(CAMA_SOURCE_DIR) + "/scenes/funnel", 6000);
  scene.time_step = 0.005;
  auto recorder = std::make_unique<Recorder>(make_backend("cpu", 0, 1));
  Recorder &counts = *recorder;
  Options options = serial();
  options.newton_iterations = 1;  // what one solve leaves stretched strikes itself
  StagedEngine engine(scene, options, std::move(recorder));
  const State &state = engine.state;
  for (int step = 0; step < 160 && counts.launches["commit_recheck_runs"] < 5; ++step) engine.step();
  REQUIRE(counts.launches["commit_recheck_runs"] >= 5);
  REQUIRE(intersections(state.mesh.position.download(), engine.topology.face, state.mesh.cloth_vertices).empty());
}

TEST_CASE("whole meshes of twenty thousand triangles in random motion never intersect", "[commit][.][long]")
{
  check_mesh("sphere", 20000, 40, 20);
  check_mesh("drape", 20000, 40, 20);
}
