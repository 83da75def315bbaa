// SPDX-License-Identifier: Apache-2.0
// Continuous collision against FCL, hand-made degenerate queries with exact truth, and motions whose contact is known
// by construction.
#include "../catch.hpp"
#include "../engine.hpp"

#include <fcl/narrowphase/detail/traversal/collision/intersect.h>
#include <nlohmann/json.hpp>

#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <random>
#include <set>
#include <sstream>

#include "cama/geometry.hpp"
#include "stages/tree_search.hpp"

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

struct LinearMotion {
  Quad start, end;
  bool edges;
};

Ccd additive(const LinearMotion &m, double minimum = 0)
{
  return m.edges ? edge_edge_ccd(m.start, m.end, minimum) : vertex_face_ccd(m.start, m.end, minimum);
}
Ccd cubic(const LinearMotion &m)
{
  return m.edges ? edge_edge_ccd_cubic(m.start, m.end) : vertex_face_ccd_cubic(m.start, m.end);
}
double distance_at(const LinearMotion &m, double t)
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

/// Four points that touch: a vertex inside a face, or two edges crossing; `parallel` is the sine of the edges' angle or
/// the face's thinness.
Quad touching(Random &random, bool edges, double parallel)
{
  const dvec3 p = random.vector(1), u = random.direction(),
              v = dnormalize(daxpy(dscale(parallel, random.direction()), 1.0, u));
  if (edges) {
    const double s = random(0.05, 0.95), t = random(0.05, 0.95), a = random(0.5, 2), b = random(0.5, 2);
    return {daxpy(p, -s * a, u), daxpy(p, (1 - s) * a, u), daxpy(p, -t * b, v), daxpy(p, (1 - t) * b, v)};
  }
  double w0 = random(0.05, 1), w1 = random(0.05, 1), w2 = random(0.05, 1);
  const double sum = w0 + w1 + w2;
  w0 /= sum;
  w1 /= sum;
  w2 /= sum;
  const dvec3 b = daxpy(dvec3_make(0, 0, 0), random(0.5, 2), u), c = daxpy(dvec3_make(0, 0, 0), random(0.5, 2), v);
  const dvec3 a = dsub(p, dadd(dscale(w1, b), dscale(w2, c)));
  return {p, a, dadd(a, b), dadd(a, c)};
}

dvec3 contact_normal(const Quad &x, bool edges)
{
  return edges ? dnormalize(dcross(dsub(x[1], x[0]), dsub(x[3], x[2])))
               : dnormalize(dcross(dsub(x[2], x[1]), dsub(x[3], x[1])));
}

/// A motion that passes through `contact` at `time`; every vertex has its own velocity.
LinearMotion through(Random &random, const Quad &contact, bool edges, double time, double speed)
{
  LinearMotion m{contact, contact, edges};
  for (int k = 0; k < 4; ++k) {
    const dvec3 d = random.vector(speed);
    m.start[k] = daxpy(contact[k], -time, d);
    m.end[k] = daxpy(contact[k], 1 - time, d);
  }
  return m;
}

struct Query {
  std::string file;
  int index;
  LinearMotion motion;
  bool truth;
};

std::vector<std::string> split(const std::string &line)
{
  std::vector<std::string> part;
  std::stringstream stream(line);
  for (std::string s; std::getline(stream, s, ',');) part.push_back(s);
  return part;
}

/// Rows of six integers, numerator and denominator of each coordinate, and the truth; eight rows a query. All are exact
/// doubles.
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
      const auto number = [&](int k) {
        return static_cast<double>(std::strtold(part[2 * k].c_str(), nullptr) /
                                   std::strtold(part[2 * k + 1].c_str(), nullptr));
      };
      x.push_back(dvec3_make(number(0), number(1), number(2)));
      if (x.size() < 8) continue;
      all.push_back({std::filesystem::relative(entry.path(), root).string(),
                     index++,
                     {{x[0], x[1], x[2], x[3]}, {x[4], x[5], x[6], x[7]}, kind == "edge-edge"},
                     part[6] == "1"});
      x.clear();
    }
  }
  return all;
}

fcl::Vector3d to_fcl(dvec3 a) { return {a.x, a.y, a.z}; }

bool fcl_hit(const LinearMotion &m, double &time)
{
  fcl::Vector3d point;
  fcl::Vector3d a[4], b[4];
  for (int k = 0; k < 4; ++k) {
    a[k] = to_fcl(m.start[k]);
    b[k] = to_fcl(m.end[k]);
  }
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
  end[0] = dvec3_make(0.8, 0.8, -1);  // leaves over the edge
  CHECK_FALSE(vertex_face_ccd({dvec3_make(0.8, 0.8, 1), start[1], start[2], start[3]}, end).hit);
}

TEST_CASE("motions through a known contact are never missed, never reported late", "[ccd]")
{
  Random random(1);
  for (const double offset : {0.0, 100.0, 1e6})
    for (const double parallel : {1.0, 1e-3, 1e-6})
      for (const bool edges : {false, true}) {
        // Far coordinates and thin shapes move the contact by their own rounding, so those pairs cross it by more: at
        // mid step, along the contact's normal, sliding in its plane. The others pass through the contact with four
        // unrelated velocities.
        const bool crossing = offset > 0 || parallel < 1;
        const double reach = 1e-5 + 1e-14 * offset;
        int missed = 0, after = 0, cubic_missed = 0;
        for (int i = 0; i < 20000; ++i) {
          const Quad x = touching(random, edges, parallel);
          const double time = crossing ? 0.5 : random(1e-6, 1 - 1e-6);
          LinearMotion m = through(random, x, edges, time, i % 3 ? 1 : 0.01);
          if (crossing) {
            const dvec3 n = contact_normal(x, edges);
            for (int k = 0; k < 4; ++k) {
              const dvec3 side = dscale(k < (edges ? 2 : 1) ? reach : -reach, n),
                          d = dscale(1e-3, dsub(m.end[k], m.start[k]));
              const dvec3 along = daxpy(d, -kernels::ddot(d, n), n);
              m.start[k] = dadd(daxpy(x[k], -0.5, along), side);
              m.end[k] = dsub(daxpy(x[k], 0.5, along), side);
            }
          }
          const dvec3 shift = dscale(offset, random.direction()), travel = dscale(offset, random.direction());
          for (int k = 0; k < 4; ++k) {
            m.start[k] = dadd(m.start[k], shift);
            m.end[k] = dadd(m.end[k], dadd(shift, travel));
          }
          const Ccd result = additive(m);
          missed += !result.hit;
          after += result.time > time + (crossing ? 1e-2 : 1e-12);
          cubic_missed += !cubic(m).hit;
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
    LinearMotion m{{}, {}, i % 2 == 0};
    for (int k = 0; k < 4; ++k) {
      m.start[k] = random.vector(1);
      m.end[k] = random.vector(1);
    }
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
  CHECK(worst < 1e-7);  // and the pair is really that near at the reported time
}

TEST_CASE("random motions agree with FCL", "[ccd]")
{
  Random random(3);
  for (const bool edges : {false, true}) {
    int both = 0, missed = 0, extra = 0, cubic_extra = 0, cubic_missed = 0, late = 0, count = 200000;
    double worst = 0;
    for (int i = 0; i < count; ++i) {
      LinearMotion m{{}, {}, edges};
      for (int k = 0; k < 4; ++k) {
        m.start[k] = random.vector(1);
        m.end[k] = random.vector(1);
      }
      double time = 1;
      const bool truth = fcl_hit(m, time) && distance_at(m, time) < 1e-9;  // FCL's inside test is inexact
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
    LinearMotion m{{}, {}, i % 2 == 0};
    for (int k = 0; k < 4; ++k) {
      m.start[k] = random.vector(1);
      m.end[k] = m.start[k];
    }
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
  struct Count {
    int queries = 0, hits = 0, missed = 0, extra = 0, late = 0, cubic_missed = 0, cubic_extra = 0, cubic_off = 0;
  };
  std::map<std::string, Count> folders;
  for (const Query &q : queries) {
    const Ccd a = additive(q.motion), c = cubic(q.motion);
    const auto known = first.find(q.file + ":" + std::to_string(q.index));
    for (const std::string &name : {q.file.substr(0, q.file.find('/')), std::string("all")}) {
      Count &n = folders[name];
      ++n.queries;
      n.hits += q.truth;
      n.missed += q.truth && !a.hit;
      n.extra += !q.truth && a.hit;
      n.cubic_missed += q.truth && !c.hit;
      n.cubic_extra += !q.truth && c.hit;
      if (known == first.end()) continue;
      n.late += a.hit && a.time > known->second;
      n.cubic_off += c.hit && std::fabs(c.time - known->second) > 1e-6;
    }
  }
  CHECK(folders.size() == 7);
  CHECK(folders["all"].queries == 4779);
  CHECK(folders["all"].hits == 301);
  for (const auto &[name, n] : folders) {
    CAPTURE(name, n.queries, n.hits, n.extra, n.cubic_extra);
    CHECK(n.missed == 0);
    CHECK(n.late == 0);
    CHECK(n.extra < 0.005 * n.queries);
    CHECK(n.cubic_missed == 0);
    // A vertex comes within 1e-16 of the face 0.78 before it touches.
    CHECK(n.cubic_off <= (name == "erleben-cube-internal-edges" || name == "all"));
  }
  CHECK(folders["all"].cubic_extra <= 42);  // which pass each other within 2e-16
}

namespace {

/// A frame: binary PLY of float or double vertices, then triangles.
Mesh read_ply(const std::filesystem::path &path)
{
  std::ifstream file(path, std::ios::binary);
  std::string line, element;
  std::size_t vertices = 0, faces = 0;
  bool swapped = false;
  std::vector<int> bytes, axis;  // of a vertex's properties; axis -1: not a coordinate
  while (std::getline(file, line) && line != "end_header") {
    std::istringstream words(line);
    std::string key, a, b;
    words >> key >> a >> b;
    if (key == "format") swapped = a == "binary_big_endian";
    if (key == "element") {
      element = a;
      (a == "vertex" ? vertices : faces) = std::stoul(b);
    }
    if (key == "property" && element == "vertex") {
      bytes.push_back(a == "double" ? 8 : a == "float" ? 4 : a == "int" ? 4 : 1);
      axis.push_back(b == "x" ? 0 : b == "y" ? 1 : b == "z" ? 2 : -1);
    }
  }
  const auto read = [&](void *to, int size) {
    char *raw = static_cast<char *>(to);
    file.read(raw, size);
    if (swapped) std::reverse(raw, raw + size);
  };
  Mesh mesh;
  for (std::size_t v = 0; v < vertices; ++v) {
    double x[3] = {};
    for (std::size_t k = 0; k < bytes.size(); ++k) {
      char raw[8];
      float single;
      read(raw, bytes[k]);
      if (axis[k] < 0) continue;
      std::memcpy(&single, raw, 4);
      if (bytes[k] == 4)
        x[axis[k]] = single;
      else
        std::memcpy(&x[axis[k]], raw, 8);
    }
    mesh.position.push_back(dvec3_make(x[0], x[1], x[2]));
  }
  for (std::size_t f = 0; f < faces; ++f) {
    char count;
    std::int32_t node[3];
    file.read(&count, 1);
    REQUIRE(count == 3);
    for (std::int32_t &n : node) read(&n, 4);
    mesh.face.push_back({node[0], node[1], node[2]});
  }
  REQUIRE(file);
  return mesh;
}

using Pairs = std::set<std::pair<int, int>>;

/// (vertex, face), or (edge, edge) with the lower index of unique_edges first.
struct Listed {
  Pairs all, colliding;
};

/// boxes/*.json: ids of vertices 0.., edges V.. in order of (hi, lo), faces V + E..; mma_bool/*.json: whether they
/// collide.
Listed read_listed(const std::filesystem::path &folder, const std::string &stem, bool edges, const Mesh &mesh)
{
  std::vector<std::array<int, 2>> own = unique_edges(mesh.face);
  std::vector<int> order(own.size());
  for (std::size_t e = 0; e < own.size(); ++e) order[e] = static_cast<int>(e);
  std::sort(order.begin(), order.end(),
            [&](int a, int b) { return std::pair(own[a][1], own[a][0]) < std::pair(own[b][1], own[b][0]); });
  const auto ids = nlohmann::json::parse(std::ifstream(folder / "boxes" / (stem + ".json")));
  const auto truth = nlohmann::json::parse(std::ifstream(folder / "mma_bool" / (stem + "_mma_bool.json")));
  const int v = static_cast<int>(mesh.position.size()), e = static_cast<int>(own.size());
  Listed listed;
  for (std::size_t k = 0; k < ids.size(); ++k) {
    int a = ids[k][0], b = ids[k][1];
    if (edges) {
      a = order[a - v];
      b = order[b - v];
      if (a > b) std::swap(a, b);
    } else
      b -= v + e;
    listed.all.insert({a, b});
    if (truth[k].get<bool>()) listed.colliding.insert({a, b});
  }
  return listed;
}

Pairs as_set(const Stream<kernels::pair> &pairs)
{
  Pairs all;
  for (const kernels::pair &p : pairs.download()) all.insert({p.a, p.b});
  return all;
}

/// What one step's stages find in the motion between two frames, all vertices free.
struct FoundImpacts {
  Pairs candidates[2], impacts[2];
  std::vector<kernels::impact> list;
};

FoundImpacts find_in(const Mesh &start, const Mesh &end, const std::string &precision, bool cubic)
{
  Scene scene;
  scene.time_step = 1.0 / 200;
  Cloth cloth;
  cloth.name = "mesh";
  cloth.mesh = start;
  scene.cloths.push_back(cloth);
  scene.contact.thickness = 1e-6;  // an impact comes nearer than 1e-8
  Options options = serial();
  options.precision = precision_of(precision);
  options.paper.cubic_impacts = cubic;
  options.max_impact_passes = 1;
  options.commit = false;
  StagedEngine engine(scene, options);
  State &state = engine.state;
  state.mesh.position_next.assign(end.position);
  ListedPairs listed(*engine.backend);
  TreeSearch search(*engine.backend, listed);
  search.run(state, state.mesh.position, state.mesh.position_next);
  FoundImpacts found;
  found.candidates[0] = as_set(state.contact.vertex_face.pairs);
  found.candidates[1] = as_set(state.contact.edge_edge.pairs);
  engine.find("penetration handling")->run(state);
  found.list = state.contact.impact.download();
  const std::vector<kernels::pair> pairs[2] = {state.contact.vertex_face.pairs.download(),
                                               state.contact.edge_edge.pairs.download()};
  for (const kernels::impact &i : found.list) {
    const kernels::pair p = pairs[i.kind][static_cast<std::size_t>(i.candidate)];
    found.impacts[i.kind].insert({p.a, p.b});
  }
  return found;
}

}  // namespace

TEST_CASE("whole meshes: every listed pair is a candidate, impacts are the colliding pairs, in every precision",
          "[ccd][data]")
{
  struct Case {
    const char *folder, *first, *second, *stem;
    double vertex_face, edge_edge;
  };
  // Times of first contacts, by exact rational arithmetic, as given with the data; 0: not given.
  for (const Case &c :
       {Case{"cloth-ball", "cloth_ball92.ply", "cloth_ball93.ply", "92", 1.4768157568140283e-04, 7.492069186824336e-06},
        Case{"cloth-funnel", "227.ply", "228.ply", "227", 0.0452323, 0}}) {
    const auto folder = test_data(std::string("ccd/scalable/") + c.folder);
    if (!folder) return;
    const Mesh start = read_ply(*folder / "frames" / c.first), end = read_ply(*folder / "frames" / c.second);
    REQUIRE(start.face == end.face);
    const auto edge = unique_edges(start.face);
    const auto quads = [&](int kind, std::pair<int, int> p, const Mesh &m) {
      const Triangle &f = m.face[static_cast<std::size_t>(kind == 0 ? p.second : 0)];
      const std::array<int, 2> a = edge[static_cast<std::size_t>(kind == 0 ? 0 : p.first)],
                               b = edge[static_cast<std::size_t>(kind == 0 ? 0 : p.second)];
      return kind == 0 ? Quad{m.position[p.first], m.position[f[0]], m.position[f[1]], m.position[f[2]]}
                       : Quad{m.position[a[0]], m.position[a[1]], m.position[b[0]], m.position[b[1]]};
    };
    const FoundImpacts found = find_in(start, end, "double", false), single = find_in(start, end, "single", false);
    const FoundImpacts paper = find_in(start, end, "double", true), paper_single = find_in(start, end, "single", true);
    for (int kind = 0; kind < 2; ++kind) {
      const Listed listed = read_listed(*folder, std::string(c.stem) + (kind == 0 ? "vf" : "ee"), kind == 1, start);
      const auto missing = [](const Pairs &wanted, const Pairs &in) {
        return std::count_if(wanted.begin(), wanted.end(), [&](const auto &p) { return in.count(p) == 0; });
      };
      CAPTURE(c.folder, kind, listed.all.size(), listed.colliding.size(), found.candidates[kind].size());
      CHECK(missing(listed.all, found.candidates[kind]) == 0);
      CHECK(missing(listed.colliding, found.impacts[kind]) == 0);
      CHECK(missing(listed.colliding, paper.impacts[kind]) == 0);
      CHECK(missing(paper.impacts[kind], listed.colliding) == 0);
      double first = 1, first_cubic = 1;
      int far = 0;
      for (const auto &p : found.impacts[kind]) {
        const Quad a = quads(kind, p, start), b = quads(kind, p, end);
        const Ccd hit = kind == 0 ? vertex_face_ccd(a, b) : edge_edge_ccd(a, b),
                  root = kind == 0 ? vertex_face_ccd_cubic(a, b) : edge_edge_ccd_cubic(a, b);
        if (hit.hit) first = std::min(first, hit.time);
        if (root.hit) first_cubic = std::min(first_cubic, root.time);
        CHECK(hit.hit == (listed.colliding.count(p) == 1));
        if (listed.colliding.count(p) == 0) {  // an extra impact must come nearer than the certified distance
          const double near = 1.01e-8;
          far += !(kind == 0 ? vertex_face_ccd(a, b, near) : edge_edge_ccd(a, b, near)).hit;
        }
      }
      CHECK(far == 0);
      const double truth = kind == 0 ? c.vertex_face : c.edge_edge;
      if (truth > 0) {
        CHECK(first <= truth * (1 + 1e-6));  // that of the funnel is given to six digits
        CHECK(first > truth - 1e-6);
        CHECK(first_cubic == Approx(truth).margin(1e-6 * truth));
      }
      CHECK(single.candidates[kind] == found.candidates[kind]);
    }
    const auto same = [](const std::vector<kernels::impact> &a, const std::vector<kernels::impact> &b) {
      return a.size() == b.size() &&
             std::equal(a.begin(), a.end(), b.begin(), [](const kernels::impact &x, const kernels::impact &y) {
               return std::equal(x.node, x.node + 4, y.node) && std::equal(x.weight, x.weight + 4, y.weight) &&
                      x.kind == y.kind && x.candidate == y.candidate && x.repeated == y.repeated &&
                      std::memcmp(&x.normal, &y.normal, sizeof x.normal) == 0 && x.target == y.target;
             });
    };
    CHECK(same(found.list, single.list));
    CHECK(same(paper.list, paper_single.list));
    CHECK(found.list.size() > 50);
  }
}

namespace {

dvec3 turned(dvec3 a, int turn)
{
  return turn == 0 ? a : turn == 1 ? dvec3_make(a.y, a.z, a.x) : dvec3_make(a.z, a.x, a.y);
}

struct Planted {
  const char *name;
  LinearMotion motion;
  bool hit;
  double time;
};

/// Contacts and near misses whose answer follows directly from the numbers; lengths of order 1, all dyadic, so that
/// scaling and moving them is exact.
std::vector<Planted> planted()
{
  const auto v = dvec3_make;
  const dvec3 a = v(0, 0, 0), b = v(1, 0, 0), c = v(0, 1, 0);
  const double e = std::ldexp(1, -10), tiny = std::ldexp(1, -20);
  std::vector<Planted> all;
  const auto drop = [&](const char *name, dvec3 from, dvec3 to, bool hit, double time) {
    all.push_back({name, {{from, a, b, c}, {to, a, b, c}, false}, hit, time});
  };
  const auto cross = [&](const char *name, Quad from, dvec3 move, bool hit, double time) {
    Quad to = from;
    to[0] = dadd(from[0], move);
    to[1] = dadd(from[1], move);
    all.push_back({name, {from, to, true}, hit, time});
  };
  drop("inside the face", v(.25, .25, 1), v(.25, .25, -1), true, .5);
  drop("on a corner", v(0, 0, 1), v(0, 0, -1), true, .5);
  drop("on an edge", v(.5, 0, 1), v(.5, 0, -1), true, .5);
  drop("on the hypotenuse", v(.5, .5, 1), v(.5, .5, -1), true, .5);
  drop("beside a corner", v(-tiny, -tiny, 1), v(-tiny, -tiny, -1), false, 1);
  drop("beside an edge", v(.5, -tiny, 1), v(.5, -tiny, -1), false, 1);
  drop("hit at the end", v(.25, .25, 1), v(.25, .25, 0), true, 1);
  drop("hit at the start", v(.25, .25, 0), v(.25, .25, 1), true, 0);
  drop("just short of a hit", v(.25, .25, 1), v(.25, .25, tiny), false, 1);
  drop("leaving", v(.25, .25, tiny), v(.25, .25, 1), false, 1);
  drop("grazing in the plane, onto an edge", v(.5, -1, 0), v(.5, 1, 0), true, .5);
  drop("grazing above the plane", v(.5, -1, tiny), v(.5, 1, tiny), false, 1);
  drop("grazing in the plane, past a corner", v(-1, 1, 0), v(1, -1, 0), true, .5);
  cross("crossing edges", {v(-1, 0, 1), v(1, 0, 1), v(0, -1, 0), v(0, 1, 0)}, v(0, 0, -2), true, .5);
  cross("end on edge", {v(0, 0, 1), v(1, 0, 1), v(0, -1, 0), v(0, 1, 0)}, v(0, 0, -4), true, .25);
  cross("corner on corner", {v(0, 0, 1), v(1, 0, 1), v(0, 0, 0), v(0, 1, 0)}, v(0, 0, -2), true, .5);
  cross("corner past corner", {v(tiny, 0, 1), v(1, 0, 1), v(0, 0, 0), v(0, 1, 0)}, v(0, 0, -2), false, 1);
  cross("edges meet at the end", {v(-1, 0, 1), v(1, 0, 1), v(0, -1, 0), v(0, 1, 0)}, v(0, 0, -1), true, 1);
  cross("edges part from the start", {v(-1, 0, 0), v(1, 0, 0), v(0, -1, 0), v(0, 1, 0)}, v(0, 0, 1), true, 0);
  cross("parallel edges fall on each other", {v(0, 0, 1), v(1, 0, 1), v(.5, 0, 0), v(2, 0, 0)}, v(0, 0, -2), true, .5);
  cross("parallel edges pass", {v(0, tiny, 1), v(1, tiny, 1), v(.5, 0, 0), v(2, 0, 0)}, v(0, 0, -2), false, 1);
  cross("collinear edges meet", {v(-2, 0, 0), v(-1, 0, 0), v(0, 0, 0), v(1, 0, 0)}, v(2, 0, 0), true, .5);
  cross("near-parallel edges fall, angle 1e-3", {v(-1, -e, 1), v(1, e, 1), v(-1, 0, 0), v(1, 0, 0)}, v(0, 0, -2), true,
        .5);
  cross("near-parallel edges slide into each other, angle 1e-3",
        {v(-1, 4 * e, 0), v(1, 6 * e, 0), v(-1, 0, 0), v(1, 0, 0)}, v(0, -8 * e, 0), true, .5);
  cross("near-parallel edges slide, 1e-6 apart", {v(-1, 4 * e, tiny), v(1, 6 * e, tiny), v(-1, 0, 0), v(1, 0, 0)},
        v(.5, -8 * e, 0), false, 1);
  cross("near-parallel edges slide in the plane, angle 1e-6",
        {v(-1, 2 * tiny, 0), v(1, 4 * tiny, 0), v(-1, 0, 0), v(1, 0, 0)}, v(0, -4 * tiny, 0), true, .5);
  return all;
}

}  // namespace

TEST_CASE("planted contacts: corners, edges, parallels, grazing, first and last moment; far, small and large", "[ccd]")
{
  for (const Planted &p : planted())
    for (const double scale : {1.0, std::ldexp(1, -20), std::ldexp(1, 20)})
      for (const double offset : {0.0, std::ldexp(1, 20)})
        for (int turn = 0; turn < 3; ++turn) {
          if (offset > 0 && scale < 1) continue;  // 1e-6 m shapes at 1e6 m are not representable
          LinearMotion m = p.motion;
          for (Quad *x : {&m.start, &m.end})
            for (dvec3 &y : *x) y = dadd(dscale(scale, turned(y, turn)), dvec3_make(offset, -offset, offset));
          double speed = 0;
          for (int k = 0; k < 4; ++k) speed = std::max(speed, dnorm(dsub(p.motion.end[k], p.motion.start[k])));
          const Ccd r = additive(m), c = cubic(m);
          CAPTURE(p.name, scale, offset, turn, r.hit, r.time, c.hit, c.time);
          REQUIRE(r.hit == p.hit);
          REQUIRE(c.hit == p.hit);
          REQUIRE(r.time <= p.time);
          REQUIRE(r.time > p.time - 1e-5 - 2e-8 / speed);  // CCD_TOLERANCE of a pair of this size
          REQUIRE(c.time == Approx(p.time).margin(1e-6));
        }
}

TEST_CASE("pairs that pass nearer than double can resolve are decided in double-double", "[ccd]")
{
  const auto v = dvec3_make;
  const double third = 1.0 / 3, tenth = 0.1;
  // The rounding of 1/3 and 0.1 to double puts a vertex about 1e-17 beside the line of an edge; exact rational
  // arithmetic gives the side.
  for (const int sign : {-1, 1}) {
    const Quad start{v(third, tenth, 1), v(0, 0, 0), v(1, 0.3 + sign * 0x1p-53, 0), v(0.5, -1, 0)};
    Quad end = start;
    end[0].z = -1;
    // Correctly rounded, so its sign is exact; negative: above the edge, outside.
    const double side = std::fma(third, start[2].y, -tenth);
    CAPTURE(sign, side);
    REQUIRE(side != 0);
    REQUIRE(std::fabs(side) < 1e-16);
    CHECK(vertex_face_ccd(start, end).hit == (side >= 0));
  }
}

TEST_CASE("an impact of the cubic, at distance 0, has the normal of the features, towards the side that A comes from",
          "[ccd]")
{
  Random random(6);
  for (const bool edges : {false, true})
    for (int i = 0; i < 500; ++i) {
      const Quad contact = touching(random, edges, 1);
      const dvec3 n = contact_normal(contact, edges);
      const double side = i % 2 ? 1 : -1, time = random(0.1, 0.9);
      std::vector<dvec3> x(contact.begin(), contact.end()), y = x;
      for (int k = 0; k < (edges ? 2 : 1); ++k) {
        const dvec3 d = dadd(dscale(-side, n), dscale(0.1, random.vector(1)));
        const dvec3 whole = k == 1 ? dsub(y[0], x[0]) : d;  // both vertices of an edge move alike
        x[k] = daxpy(contact[k], -time, whole);
        y[k] = daxpy(contact[k], 1 - time, whole);
      }
      const kernels::face_nodes face{{1, 2, 3}};
      const kernels::edge_nodes edge[2] = {{{0, 1}}, {{2, 3}}};
      const kernels::pair pair{0, edges ? 1 : 0};
      const float error[7] = {};  // of four vertices, a face and two edges
      unsigned char motion[7];
      std::fill(std::begin(motion), std::end(motion), MOTION_OPEN);
      const kernels::fvec3 direction = kernels::fvec3_make(0, 0, 0);
      kernels::vertex_contact properties[4] = {};
      for (auto &p : properties) p.thickness = 1e-9;
      float gap_bound = 0;
      kernels::impact impact;
      int detection[DETECTION_COUNTS] = {}, open = 7, list = 7;
      kernels::select_open_pairs(1, 1, edges ? 0 : 1, 4, 1, 0, &pair, &pair, 1.0, 1e-9, error, motion, 0, 0, 0,
                                 &gap_bound, 0, &gap_bound, &open, detection);
      kernels::select_ccd_pairs(1, &pair, &pair, &face, edge, 1.0, x.data(), y.data(), properties, &direction,
                                &direction, &open, &list, detection);
      REQUIRE(detection[DETECTION_OPEN] == 1);
      REQUIRE(detection[DETECTION_UNCLEAR] == 1);
      const int code = list;
      REQUIRE(code == kernels::pair_code(edges, 0));
      kernels::find_impacts(1, 1, &pair, &pair, &face, edge, x.data(), y.data(), properties, 1.0, &list, detection);
      REQUIRE(list == code);
      REQUIRE(detection[DETECTION_IMPACTS] == 1);
      int repeated = 0;
      kernels::fill_impacts(1, 1, 0, &code, &pair, &pair, &face, edge, x.data(), y.data(), properties, 1.0, 1.0, 0,
                            &gap_bound, &gap_bound, &impact, &repeated);
      REQUIRE(repeated == 0);
      REQUIRE(gap_bound < 0);  // known from now on
      REQUIRE(kernels::ddot(impact.normal, n) * side > 1 - 1e-9);
    }
}

TEST_CASE("cost of a query", "[.benchmark]")
{
  Random random(5);
  for (const bool edges : {false, true})
    for (const int kind : {0, 1, 2}) {
      std::vector<LinearMotion> motions;
      for (int i = 0; i < 20000; ++i) {
        LinearMotion m{{}, {}, edges};
        if (kind == 0)
          for (int k = 0; k < 4; ++k) {
            m.start[k] = random.vector(1);
            m.end[k] = random.vector(1);
          }
        else if (kind == 1)
          m = through(random, touching(random, edges, 1), edges, random(0, 1), 0.3);
        else {  // sliding past each other, 1e-3 apart
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
        for (int repeat = 0; repeat < 10; ++repeat)
          for (const LinearMotion &m : motions) hits += use_cubic ? cubic(m).hit : additive(m).hit;
        const double ns = std::chrono::duration<double, std::nano>(std::chrono::steady_clock::now() - begin).count() /
                          10.0 / motions.size();
        WARN((edges ? "edge-edge " : "vertex-face ")
             << (kind == 0   ? "generic "
                 : kind == 1 ? "hitting "
                             : "sliding ")
             << (use_cubic ? "cubic " : "additive ") << ns << " ns, hits " << hits / 10 << " of " << motions.size());
      }
    }
}
