// SPDX-License-Identifier: Apache-2.0
// Growing candidate lists: the pairs after an update are those of brute force over the boxes, and earlier ones keep
// their direction and gap_bound. Exempt pairs: seams, tangles, and cloth released by pinching obstacles.
#include "../catch.hpp"

#include <algorithm>
#include <array>
#include <cstring>
#include <random>
#include <set>

#include "../engine.hpp"
#include "../meshes.hpp"
#include "../recorder.hpp"
#include "../separated.hpp"
#include "cama/geometry.hpp"
#include "stages/gap_bounds.hpp"
#include "stages/tree_search.hpp"

using namespace cama;

namespace {

using Pair = std::pair<int, int>;

struct Lists {
  std::vector<Pair> vertex_face, edge_edge;
};

struct Box {
  float lo[3], hi[3];
};

Box bound(const std::vector<kernels::box> &boxes, std::initializer_list<int> vertices)
{
  Box b{{1e30f, 1e30f, 1e30f}, {-1e30f, -1e30f, -1e30f}};
  for (int v : vertices)
    for (int k = 0; k < 3; ++k) {
      b.lo[k] = std::min(b.lo[k], boxes[v].lo[k]);
      b.hi[k] = std::max(b.hi[k], boxes[v].hi[k]);
    }
  return b;
}

bool overlap(const Box &a, const Box &b)
{
  bool all = true;
  for (int k = 0; k < 3; ++k) all &= a.lo[k] <= b.hi[k] && b.lo[k] <= a.hi[k];
  return all;
}

bool share(std::initializer_list<int> a, std::initializer_list<int> b)
{
  return std::any_of(a.begin(), a.end(), [&](int v) { return std::find(b.begin(), b.end(), v) != b.end(); });
}

/// Every pair of features whose boxes, made from the state's vertex boxes, overlap.
Lists brute_force(State &s)
{
  Lists lists;
  const auto boxes = s.bounds.vertex_box.download();
  const auto faces = s.mesh.face.download();
  const auto edges = s.mesh.edge.download();
  const std::vector<int> query_vertices = s.bounds.query_vertices.download();
  const auto unwanted = [&](int v, int w) {
    const bool a = v >= s.mesh.cloth_vertices, b = w >= s.mesh.cloth_vertices;
    return a == b && (a || !s.contact.settings.self);
  };
  for (int v = 0; v < s.mesh.vertices; ++v)
    for (int f = 0; f < s.mesh.faces; ++f) {
      const int *n = faces[f].node;
      if (share({v}, {n[0], n[1], n[2]}) || unwanted(v, n[0]) ||
          !std::binary_search(query_vertices.begin(), query_vertices.end(), v))
        continue;
      if (overlap(bound(boxes, {v}), bound(boxes, {n[0], n[1], n[2]}))) lists.vertex_face.emplace_back(v, f);
    }
  for (int e = 0; e < s.mesh.edges; ++e)
    for (int f = e + 1; f < s.mesh.edges; ++f) {
      const int *a = edges[e].node, *b = edges[f].node;
      if (share({a[0], a[1]}, {b[0], b[1]}) || unwanted(a[0], b[0])) continue;
      if (overlap(bound(boxes, {a[0], a[1]}), bound(boxes, {b[0], b[1]}))) lists.edge_edge.emplace_back(e, f);
    }
  return lists;
}

std::vector<Pair> plain(const PairList &list)
{
  std::vector<Pair> pairs;
  for (const kernels::pair &p : list.pairs.download()) pairs.emplace_back(p.a, p.b);
  return pairs;
}

/// A closed slab between z and z + height that moves by `travel` within a second, then back and as far again.
Obstacle slab(double z, double height, double travel, const std::string &name)
{
  Mesh mesh;
  for (double level : {z, z + height})
    for (int corner = 0; corner < 4; ++corner)
      mesh.position.push_back({corner == 1 || corner == 2 ? 0.3 : -0.3, corner >= 2 ? 0.3 : -0.3, level});
  mesh.face = {{0, 2, 1}, {0, 3, 2}, {4, 5, 6}, {4, 6, 7}};
  for (int k = 0; k < 4; ++k) {
    const int next = (k + 1) % 4;
    mesh.face.push_back({k, next, 4 + next});
    mesh.face.push_back({k, 4 + next, 4 + k});
  }
  Motion motion;
  motion.keys.resize(3);
  motion.keys[1].time = 1;
  motion.keys[1].transform.translation = {0, 0, travel};
  motion.keys[2].time = 3;
  motion.keys[2].transform.translation = {0, 0, -travel};
  return meshes::obstacle(mesh, motion, name);
}

/// A sheet between two slabs that overlap from 0.8 s to 1.2 s.
Scene pinched()
{
  Scene s;
  s.gravity = {0, 0, 0};
  s.time_step = 0.02;
  s.contact.thickness = 2e-3;
  s.cloths.push_back(meshes::cloth(meshes::grid(6, 6, 0.2, 0.2, -0.1, -0.1, 0)));
  s.obstacles.push_back(slab(-0.14, 0.1, 0.05, "lower"));
  s.obstacles.push_back(slab(0.04, 0.1, -0.05, "upper"));
  return s;
}

}  // namespace

namespace {

struct Variant {
  const char *name;
  bool self, moving, still, exact;
};

/// The pile, with a moving ball, a static one below and a static exact one above.
Scene pile_of(const Variant &v)
{
  Scene scene = meshes::pile(6);
  scene.contact.self = v.self;
  if (!v.moving) scene.obstacles.clear();
  if (v.still)
    scene.obstacles.push_back(meshes::obstacle(meshes::sphere(10, 7, 0.1, {0.02, 0.01, -0.11}), {}, "still"));
  if (v.exact) {
    scene.obstacles.push_back(exact_sphere({0.01, 0, 0.115}, 0.1));
    scene.obstacles.back().name = "exact";
  }
  return scene;
}

/// Every bound is at most the distance of the pair's surfaces at any time of the motion, and every direction is a unit
/// vector or, as a bound along it needs, hardly shorter. Returns the share of the pairs that have a bound.
double check_bounds(State &s, const std::vector<dvec3> &x, const std::vector<dvec3> &y)
{
  const auto faces = s.mesh.face.download();
  const auto edges = s.mesh.edge.download();
  const auto properties = s.contact.vertex_contact.download();
  int bounded = 0, all = 0;
  for (int kind = 0; kind < 2; ++kind) {
    const PairList &list = kind == 0 ? s.contact.vertex_face : s.contact.edge_edge;
    const auto pairs = list.pairs.download();
    const auto bound = list.gap_bound.download();
    const auto direction = list.direction.download();
    REQUIRE(bound.size() == pairs.size());
    REQUIRE(direction.size() == pairs.size());
    for (std::size_t i = 0; i < pairs.size(); ++i) {
      const auto &[a, b] = pairs[i];
      std::array<std::size_t, 4> v{};
      for (int k = 0; k < 4; ++k)
        v[static_cast<std::size_t>(k)] =
            static_cast<std::size_t>(kind == 0 ? (k == 0 ? a : faces[static_cast<std::size_t>(b)].node[k - 1])
                                               : edges[static_cast<std::size_t>(k < 2 ? a : b)].node[k % 2]);
      const auto &n = direction[i];
      const double length = std::sqrt(double(n.x) * n.x + double(n.y) * n.y + double(n.z) * n.z);
      CHECK(length <= 1);
      CHECK(length > 0.999);
      ++all;
      if (!(bound[i] > 0)) continue;
      ++bounded;
      const double radii = properties[v[0]].radius + properties[v[kind == 0 ? 1 : 2]].radius;
      for (double t : {0.0, 0.3, 0.6, 1.0}) {
        const auto at = [&](std::size_t k) { return kernels::dlerp(x[v[k]], y[v[k]], t); };
        const double distance = kind == 0 ? kernels::vertex_face_proximity(at(0), at(1), at(2), at(3)).distance
                                          : kernels::edge_edge_proximity(at(0), at(1), at(2), at(3)).distance;
        CHECK(bound[i] <= distance - radii);
      }
    }
  }
  return all > 0 ? bounded / double(all) : 0;
}

}  // namespace

TEST_CASE("an updated list holds the pairs of the grown boxes, each once, but for separated ones", "[candidates]")
{
  const Variant variants[] = {{"cloth and a moving ball", true, true, false, false},
                              {"cloth and a ball at rest", true, false, true, false},
                              {"cloth alone", true, false, false, false},
                              {"both balls, cloth does not meet cloth", false, true, true, false},
                              {"a moving ball alone", false, true, false, false},
                              {"a ball at rest alone", false, false, true, false},
                              {"an exact ball alone", false, false, false, true},
                              {"all", true, true, true, true}};
  for (const std::string backend : {"cpu", "opencl"})
    for (const Variant &variant : variants) {
      INFO(backend << ", " << variant.name);
      if (backend != "cpu" && !variant.moving) continue;
      Options options = serial();
      options.backend = backend;
      StagedEngine engine(pile_of(variant), options);
      State &s = engine.state;
      const auto moves = [&](std::size_t v) {
        return !s.mesh.object_static[static_cast<std::size_t>(s.mesh.object_of(static_cast<int>(v)))];
      };
      ListedPairs listed(*s.backend);
      TreeSearch search(*s.backend, listed);
      std::mt19937 random(7);
      std::uniform_real_distribution<double> move(-1, 1);
      const std::vector<dvec3> start = s.mesh.position.download();
      std::vector<dvec3> target = start;
      for (std::size_t v = 0; v < target.size(); ++v)
        if (moves(v))
          target[v] = kernels::dadd(target[v], {2e-3 * move(random), 2e-3 * move(random), 2e-3 * move(random)});
      Stream<dvec3> from(*s.backend, start), to(*s.backend, target);
      const auto check = [&](const std::vector<dvec3> &x, const std::vector<dvec3> &y) {
        const Lists overlapping = brute_force(s);
        const auto faces = s.mesh.face.download();
        const auto edges = s.mesh.edge.download();
        CHECK(separated::wrong(overlapping.vertex_face, plain(s.contact.vertex_face), x, y, faces).empty());
        CHECK(separated::wrong(overlapping.edge_edge, plain(s.contact.edge_edge), x, y, faces, &edges).empty());
      };
      search.run(s, from, to);
      CHECK(search.update(s, from, to, 0) == CandidateSearch::Change::none);
      int grown = 0;
      for (int round = 0; round < 6; ++round) {
        for (int k = 0; k < 8; ++k) {
          const std::size_t v = std::uniform_int_distribution<std::size_t>(0, target.size() - 1)(random);
          if (!moves(v)) {
            --k;
            continue;
          }
          dvec3 &x = target[v];
          x = kernels::dadd(x, {0.05 * move(random), 0.05 * move(random), 0.05 * move(random)});
        }
        to.assign(target);
        s.contact.vertex_face.gap_bound.assign(
            std::vector<float>(static_cast<std::size_t>(s.contact.vertex_face.pairs.size()), 5));
        const std::vector<Pair> before = plain(s.contact.vertex_face);
        REQUIRE(search.update(s, from, to, 1e-4) == CandidateSearch::Change::grown);
        const std::vector<Pair> after = plain(s.contact.vertex_face);
        REQUIRE(after.size() >= before.size());
        CHECK(std::equal(before.begin(), before.end(), after.begin()));
        const std::vector<float> gap_bound = s.contact.vertex_face.gap_bound.download();
        CHECK(std::count(gap_bound.begin(), gap_bound.end(), 5.0f) == static_cast<long>(before.size()));
        CHECK(std::count(gap_bound.begin(), gap_bound.end(), 0.0f) == static_cast<long>(after.size() - before.size()));
        grown += static_cast<int>(after.size() - before.size());
        check(start, target);
        // The boxes of the search contain every motion.
        const auto boxes = s.bounds.vertex_box.download();
        const dvec3 origin = s.bounds.box_origin().download()[0];
        for (std::size_t v = 0; v < target.size(); ++v)
          for (const dvec3 &x : {start[v], target[v]}) {
            REQUIRE(boxes[v].lo[0] <= x.x - origin.x);
            REQUIRE(boxes[v].hi[0] >= x.x - origin.x);
            REQUIRE(boxes[v].lo[2] <= x.z - origin.z);
            REQUIRE(boxes[v].hi[2] >= x.z - origin.z);
          }
        CHECK(search.update(s, from, to, 1e-4) == CandidateSearch::Change::none);
      }
      CHECK(grown > (variant.exact && !variant.self ? 2 : 20));
      for (std::size_t v = 0; v < target.size(); ++v)
        if (moves(v)) target[v].x += 0.1;   // everything leaves its box, so all pairs are found again
      to.assign(target);
      REQUIRE(search.update(s, from, to, 0) == CandidateSearch::Change::renewed);
      check(start, target);
      GapBounds bounds(*s.backend, listed);
      bounds.find_all(s, from, to);
      const double share = check_bounds(s, start, target);
      if (variant.self) CHECK(share > 0.25);
      const int known = s.report.candidates;
      search.run(s, from, to);  // the same motion, predicted
      if (variant.self) CHECK(known < s.report.candidates);
    }
}

namespace {

/// A search on a CPU that may claim to have more work items, or narrow ones, as a GPU has.
struct RecordedSearch {
  RecordedSearch(const Scene &scene, int workers, bool narrow, const char *backend = "cpu")
      : RecordedSearch(scene, std::make_unique<Recorder>(make_backend(backend, 0, 1)), workers, narrow)
  {}
  /// Appends the lists of candidates.
  void keep(std::vector<std::vector<Pair>> &lists) const
  {
    lists.push_back(plain(engine.state.contact.vertex_face));
    lists.push_back(plain(engine.state.contact.edge_edge));
  }

  Recorder &counts;
  StagedEngine engine;
  ListedPairs listed;
  TreeSearch search;

private:
  static std::unique_ptr<Recorder> claiming(std::unique_ptr<Recorder> recorder, int workers, bool narrow)
  {
    recorder->claimed_workers = workers;
    recorder->claimed_narrow = narrow;
    return recorder;
  }
  RecordedSearch(const Scene &scene, std::unique_ptr<Recorder> recorder, int workers, bool narrow)
      : counts(*recorder), engine(scene, serial(), claiming(std::move(recorder), workers, narrow)),
        listed(*engine.state.backend), search(*engine.state.backend, listed)
  {}
};

}  // namespace

TEST_CASE("many items whose hits are copied by teams find the same pairs in the same order", "[candidates]")
{
  const Scene scene = Scene::load(std::string(CAMA_SOURCE_DIR) + "/scenes/drape", 24000);
  std::vector<std::vector<Pair>> found[2];
  for (const bool narrow : {false, true}) {
    RecordedSearch r(scene, 0, narrow);
    State &s = r.engine.state;
    std::mt19937 random(5);
    std::uniform_real_distribution<double> move(-0.01, 0.01);
    std::vector<dvec3> target = s.mesh.position.download();
    const Stream<dvec3> from(*s.backend, target);
    for (dvec3 &x : target) x.z += move(random);
    const Stream<dvec3> to(*s.backend, target);
    for (int again = 0; again < 2; ++again) {   // the first one has no room for more hits than fit into rows
      r.search.run(s, from, to);
      r.keep(found[narrow]);
    }
    CHECK((r.counts.launches["copy_hits"] > 0) == narrow);
  }
  REQUIRE(found[0][1].size() > 100000);
  CHECK(found[0] == found[1]);
}

TEST_CASE("the hits of a search fill a list, and no more", "[candidates]")
{
  for (const long long items : {1LL, 20000000LL, 60000000LL, 133000000LL}) {
    const long long hits = HIT_ROW * items + HIT_BLOCK * TreeSearch::most_hit_blocks(static_cast<int>(items));
    CAPTURE(items);
    CHECK(hits <= 2143289343);  // 2^31 - 1 - 2^22
    CHECK(hits > 2143289343 - HIT_BLOCK);
  }
  CHECK(TreeSearch::most_hit_blocks(134000000) == 0);
}

TEST_CASE("many items that walk trees together find the same pairs in the same order", "[candidates]")
{
  const Scene scene = Scene::load(std::string(CAMA_SOURCE_DIR) + "/scenes/drape", 136000);
  struct Device {
    const char *backend;
    bool narrow;
  };
  std::vector<std::vector<Pair>> alone;
  for (const auto &[backend, narrow] : {Device{"cpu", false}, Device{"cpu", true}, Device{"opencl", true}}) {
    CAPTURE(backend, narrow);
    std::vector<std::vector<Pair>> found;
    RecordedSearch r(scene, 0, narrow, backend);
    State &s = r.engine.state;
    std::mt19937 random(3);
    std::uniform_real_distribution<double> move(-1, 1);
    std::vector<dvec3> target = s.mesh.position.download();
    const Stream<dvec3> from(*s.backend, target);
    for (dvec3 &x : target) x = kernels::dadd(x, {x.x < 0 ? 0.004 : -0.004, 0, 0.01 + 0.001 * move(random)});
    Stream<dvec3> to(*s.backend, target);
    r.search.run(s, from, to);
    r.keep(found);
    for (std::size_t v = 0; v < target.size(); v += 6)  // so many that those who look for fresh pairs walk together too
      target[v] = kernels::dadd(target[v], {0.004 * move(random), 0.004 * move(random), 0.004 * move(random)});
    to.assign(target);
    REQUIRE(r.search.update(s, from, to, 1e-4) == CandidateSearch::Change::grown);
    r.keep(found);
    // All vertices against the cloth and against the ball, then those that have not changed; changed ones have no
    // order.
    CHECK(r.counts.launches["count_far_ends"] == 1);
    CHECK(r.counts.launches["team_query_vertex_face"] == (narrow ? 3 : 0));
    CHECK(r.counts.launches["team_query_edge_edge"] == (narrow ? 4 : 0));
    REQUIRE(found[1].size() > 100000);
    REQUIRE(found[3].size() > found[1].size());
    if (alone.empty()) alone = found;
    CHECK(found == alone);
    if (narrow) continue;
    // A vertex that moves by 0.2 m, alone or with all others: room at its end.
    for (const bool all : {true, false, true}) {
      target = from.download();
      for (std::size_t v = 0; v < (all ? static_cast<std::size_t>(s.mesh.cloth_vertices) : 1); ++v) target[v].z += 0.2;
      to.assign(target);
      r.search.run(s, from, to);
      const kernels::end_boxes ends = r.search.end_boxes().at(0);
      const double room = -ends.minus_hi[6] + ends.minus_hi[2] - 0.2;
      CHECK(std::abs(room - 0.2 / (all ? 32 : 8)) < 1e-6);
    }
  }
}

TEST_CASE("obstacles that turn back inside their boxes are searched for again, also where cloth does not meet cloth",
          "[candidates]")
{
  StagedEngine engine(pile_of({"a moving ball", false, true, false, false}), serial());
  State &s = engine.state;
  ListedPairs listed(*s.backend);
  TreeSearch search(*s.backend, listed);
  const std::vector<dvec3> start = s.mesh.position.download();
  std::vector<dvec3> target = start;
  for (std::size_t v = static_cast<std::size_t>(s.mesh.cloth_vertices); v < target.size(); ++v) target[v].z += 0.2;
  const Stream<dvec3> from(*s.backend, start);
  Stream<dvec3> to(*s.backend, target);
  search.run(s, from, to);
  for (std::size_t v = static_cast<std::size_t>(s.mesh.cloth_vertices); v < target.size(); v += 5) target[v].z -= 0.1;
  to.assign(target);
  REQUIRE(search.update(s, from, to, 1e-5) == CandidateSearch::Change::grown);
  const Lists overlapping = brute_force(s);
  const auto faces = s.mesh.face.download();
  const auto edges = s.mesh.edge.download();
  CHECK(separated::wrong(overlapping.vertex_face, plain(s.contact.vertex_face), start, target, faces).empty());
  CHECK(separated::wrong(overlapping.edge_edge, plain(s.contact.edge_edge), start, target, faces, &edges).empty());
}

TEST_CASE("shares of trees, and teams that walk for single items, find the same pairs in the same order",
          "[candidates]")
{
  struct Device {
    const char *backend;
    int workers;
    bool narrow;
  };
  const Scene scene = pile_of({"all", true, true, true, true});
  std::vector<std::vector<Pair>> alone;
  for (const auto &[backend, workers, narrow] : {Device{"cpu", 0, false}, Device{"cpu", 1 << 20, false},
                                                 Device{"cpu", 1 << 20, true}, Device{"opencl", 1 << 20, true}}) {
    CAPTURE(backend, workers, narrow);
    RecordedSearch r(scene, workers, narrow, backend);
    State &s = r.engine.state;
    std::mt19937 random(11);
    std::uniform_real_distribution<double> move(-1, 1);
    std::vector<dvec3> target = s.mesh.position.download();
    Stream<dvec3> from(*s.backend, target), to(*s.backend, target);
    std::vector<std::vector<Pair>> found;
    for (int again = 0; again < 2; ++again) {  // the first one has no room for more hits than fit into rows
      r.search.run(s, from, to);
      r.keep(found);
    }
    const bool shared = r.counts.most_items["query_edge_edge_count"] >= GROUP * s.mesh.cloth_vertices;
    CHECK(shared == (workers > 0));
    for (int round = 0; round < 4; ++round) {
      for (int v = 0; v < s.mesh.cloth_vertices; v += 37)
        target[static_cast<std::size_t>(v)] = kernels::dadd(
            target[static_cast<std::size_t>(v)], {0.05 * move(random), 0.05 * move(random), 0.05 * move(random)});
      to.assign(target);
      REQUIRE(r.search.update(s, from, to, 1e-4) == CandidateSearch::Change::grown);
      r.keep(found);
    }
    CHECK((r.counts.launches["item_query_edge_edge"] > 0) == narrow);
    CHECK((r.counts.launches["item_query_vertex_face"] > 0) == narrow);
    REQUIRE(found.back().size() > 1000);
    if (alone.empty()) alone = found;
    CHECK(found == alone);
  }
}

TEST_CASE("gap_bound is no more than the distance until the prediction; pairs with one are no contacts, all others are "
          "tested",
          "[candidates]")
{
  for (const bool anticipate : {false, true}) {
    Options options = serial();
    options.paper.anticipate_contacts = anticipate;
    Scene scene = meshes::pile(6);
    scene.obstacles.push_back(exact_sphere({0.05, 0.05, -0.052}, 0.05));
    scene.obstacles.push_back(exact_sphere({-0.05, 0.02, -0.03}, 0.03));
    for (std::size_t i = 0; i < scene.obstacles.size(); ++i) scene.obstacles[i].name = "body " + std::to_string(i);
    StagedEngine engine(scene, options);
    State &s = engine.state;
    long told = 0, all = 0, contacts = 0;
    for (int step = 0; step < 12; ++step) {
      engine.run_before("element forces");
      const auto x = s.mesh.position.download(), y = s.bounds.predicted.download();
      const auto face = s.mesh.face.download();
      const auto edge = s.mesh.edge.download();
      const auto wing = s.mesh.edge_wing.download();
      const auto v = s.contact.vertex_contact.download();
      std::set<std::array<int, 3>> found;
      for (int i = 0; i < s.contact.contacts; ++i) {
        const kernels::contact c = s.contact.contact.at(i);
        found.insert({c.kind, c.candidate, 0});
      }
      REQUIRE(int(found.size()) == s.contact.contacts);
      for (int kind = 0; kind < 2; ++kind) {
        const PairList &list = kind == 0 ? s.contact.vertex_face : s.contact.edge_edge;
        const auto pairs = list.pairs.download();
        const auto gap_bound = list.gap_bound.download();
        REQUIRE(gap_bound.size() == pairs.size());
        for (std::size_t i = 0; i < pairs.size(); ++i) {
          const kernels::element_nodes e = kernels::pair_nodes(kind, pairs[i], face.data(), edge.data());
          const bool contact = found.count({kind, int(i), 0}) != 0;
          ++all;
          contacts += contact;
          if (gap_bound[i] > 0) {
            ++told;
            REQUIRE_FALSE(contact);
            for (int t = 0; t <= 16; ++t) {
              std::vector<dvec3> at(x.size());
              for (int n : e.node) at[n] = kernels::dlerp(x[n], y[n], t / 16.0);
              REQUIRE(kernels::surface_proximity(kind, e, at.data(), v.data()).distance >= double(gap_bound[i]));
            }
            REQUIRE(double(gap_bound[i]) > kernels::pair_thickness(kind, e, v.data()));
          }
          kernels::contact c;
          const bool full = kernels::make_contact(kind, pairs[i], e, wing.data(), x.data(), y.data(), v.data(),
                                                  anticipate ? 20 * scene.contact.thickness : 0.0,
                                                  kernels::surface_proximity(kind, e, x.data(), v.data()), &c);
          if (anticipate)
            REQUIRE((full || !contact));  // hidden ones are dropped
          else
            REQUIRE(full == contact);
        }
      }
      s.report.step -= 1;
      engine.step();
    }
    CHECK(contacts > 200);
    CHECK(2 * told > all);
  }
}

TEST_CASE("a contact of edges has its whole stiffness on a ridge and on a border, none where it leans over a face",
          "[candidates]")
{
  // Edge 2-3 along y, its faces' vertices 4 and 5 at `slope` below the horizontal; edge 0-1 above it, across or along.
  const auto share = [](double slope, double lean, bool border) {
    const double c = std::cos(slope), s = std::sin(slope);
    const dvec3 n = {std::sin(lean), 0, std::cos(lean)}, u = {std::cos(lean), 0, -std::sin(lean)};
    const std::vector<dvec3> x = {
        kernels::daxpy(n, -1, u), kernels::dadd(n, u), {0, -1, 0}, {0, 1, 0}, {c, 0, -s}, {-c, 0.3, -s}};
    return kernels::edge_contact_share(
        {{0, 1, 2, 3}}, {{-1, -1}}, border ? kernels::edge_nodes{{4, -1}} : kernels::edge_nodes{{4, 5}}, n, x.data());
  };
  for (const double lean : {0.0, 0.02, 0.049}) CHECK(share(0, lean, false) == 1);
  for (const double lean : {0.1, 0.2, 0.3}) {
    CHECK(share(0, lean, false) == Approx((0.3 - std::sin(lean)) / 0.25));
    CHECK(share(0, -lean, false) == Approx((0.3 - std::sin(lean)) / 0.25));
    CHECK(share(0.3, lean, false) == 1);  // a ridge that falls off faster than the normal leans
    CHECK(share(-0.3 - lean, 0, false) == 0);  // the bottom of a valley
    CHECK(share(0, -lean, true) == 1);  // beyond a border there is no face
  }
  CHECK(share(0, 0.7, false) == 0);
  CHECK(share(0, 0.7, true) == 0);
}

TEST_CASE("contacts do not depend on searches before: a state that is set has those of one that was stepped to",
          "[candidates]")
{
  Scene scene = meshes::pile(8);
  scene.obstacles[0].motion = Motion{};
  StagedEngine stepped(scene);
  for (int step = 0; step < 9; ++step) stepped.step();
  StagedEngine set(scene);
  set.state.mesh.position.copy_from(stepped.state.mesh.position);
  set.state.mesh.position_next.copy_from(stepped.state.mesh.position);
  set.state.mesh.velocity.copy_from(stepped.state.mesh.velocity);
  for (StagedEngine *e : {&stepped, &set}) e->run_before("element forces");
  REQUIRE(stepped.state.contact.contacts > 20);
  REQUIRE(set.state.contact.contacts == stepped.state.contact.contacts);
  const auto a = stepped.state.contact.contact.download(), b = set.state.contact.contact.download();
  bool reordered = false;
  for (std::size_t i = 0; i < a.size(); ++i) {
    REQUIRE(std::memcmp(a[i].node, b[i].node, sizeof a[i].node) == 0);
    REQUIRE(std::memcmp(a[i].weight, b[i].weight, sizeof a[i].weight) == 0);
    REQUIRE(a[i].distance == b[i].distance);
    reordered |= a[i].candidate != b[i].candidate;
  }
  CHECK(reordered);  // the lists themselves differ
}

TEST_CASE("both sides of a seam are no candidates; the rest of the two pieces is", "[candidates]")
{
  Scene scene;
  scene.time_step = 1.0 / 200;
  scene.contact.thickness = 4e-3;
  scene.cloths.push_back(meshes::cloth(meshes::grid(6, 3, 0.2, 0.1)));
  scene.cloths.push_back(meshes::cloth(meshes::grid(6, 3, 0.2, 0.1, 0, 0, 0.003), meshes::cotton(), "upper"));
  for (int i = 0; i < 7; ++i) {  // the edge y = 0 of both
    Stitch s;
    s.cloth_a = 0;
    s.vertex_a = i;
    s.cloth_b = 1;
    s.vertex_b = i;
    s.vertex_c = i == 6 ? 5 : i + 1;
    scene.stitches.push_back(s);
  }
  StagedEngine engine(scene);
  State &s = engine.state;
  engine.run_before("contacts");
  const int upper = s.mesh.object_first[1];
  const auto faces = s.mesh.face.download();
  int others = 0;
  for (const Pair &p : plain(s.contact.vertex_face)) {
    const int v = p.first, *n = faces[p.second].node;
    const bool across = (v < upper) != (n[0] < upper);
    if (across &&
        v % upper < 7) {  // a seam vertex: not against faces with the seam vertices across from it and beside it
      for (int k = 0; k < 3; ++k)
        if (n[k] % upper < 7) CHECK(std::abs(n[k] % upper - v % upper) > 3);
    } else if (across)
      ++others;
  }
  CHECK(others > 20);
}

TEST_CASE("a pinch stops with the place, and the state before stays", "[candidates]")
{
  Simulation simulation(pinched(), serial());
  std::vector<dvec3> before;
  int step = 0;
  const std::string text = thrown<CollisionError>([&] {
    for (; step < 60; ++step) {
      before = simulation.positions();
      simulation.step();
    }
  });
  CAPTURE(text, step);
  CHECK(step >= 38);  // the slabs meet after 0.8 s
  CHECK(step <= 40);
  CHECK(contains(text, "cloth 'cloth', vertex "));
  CHECK((contains(text, "obstacle 'lower', vertex ") || contains(text, "obstacle 'upper', vertex ")));
  CHECK(contains(text, "pinch to release"));
  const std::vector<dvec3> after = simulation.positions();
  for (std::size_t i = 0; i < after.size(); ++i) REQUIRE((after[i].x == before[i].x && after[i].z == before[i].z));
  CHECK(simulation.count_intersections() == 0);
}

TEST_CASE("released cloth goes on, and is held again when it has come free", "[candidates]")
{
  Options options = serial();
  options.pinch = Pinch::release;
  Scene scene = pinched();
  Pin hold;
  hold.vertices = {0, 6, 42, 48};
  scene.pins.push_back(hold);
  Simulation simulation(scene, options);
  int released = 0, most = 0;
  for (int step = 0; step < 150; ++step) {
    simulation.step();
    released += simulation.report().released;
    most = std::max(most, simulation.report().exempt);
    for (const dvec3 &x : simulation.positions()) REQUIRE(std::fabs(x.x) + std::fabs(x.y) + std::fabs(x.z) < 1);
  }
  CHECK(released > 0);
  CHECK(most > 0);
  CHECK(simulation.report().exempt == 0);
  CHECK(simulation.count_intersections() == 0);
}

TEST_CASE("exact obstacles are rejected with pinch release", "[candidates]")
{
  Scene scene = pinched();
  scene.obstacles.push_back(exact_sphere({0, 0, 1}, 0.1));
  scene.obstacles.back().name = "ball";
  Options options = serial();
  options.pinch = Pinch::release;
  CHECK(contains(thrown<SceneError>([&] { Simulation refused(scene, options); }), "'ball'"));
  options.pinch = Pinch::stop;
  CHECK(Simulation(scene, options).step_count() == 0);
}

TEST_CASE("tangled cloth is simulated, its pairs are contacts again once apart", "[candidates]")
{
  Scene scene;  // a small sheet sinks through the middle of a large one, edge on, and is pulled out
  scene.time_step = 1.0 / 200;
  scene.gravity = {0, 0, 0};
  scene.contact.thickness = 2e-3;
  scene.cloths.push_back(meshes::cloth(meshes::grid(8, 8, 0.4, 0.4, -0.2, -0.2, 0)));
  Mesh small = meshes::grid(2, 2, 0.08, 0.08, -0.04, -0.01);
  for (dvec3 &x : small.position) x = {x.x + 0.003, 0.011, x.y};
  scene.cloths.push_back(meshes::cloth(small, meshes::cotton(), "small"));
  Pin pin;
  pin.cloth = 1;
  for (int v = 0; v < 9; ++v) pin.vertices.push_back(v);
  pin.motion.velocity = {0, 0, 0.1};
  scene.pins.push_back(pin);
  Pin hold;
  hold.vertices = {0, 8, 72, 80};
  scene.pins.push_back(hold);
  CHECK(contains(thrown<CollisionError>([&] { Simulation refused(scene, serial()); }), "intersections"));
  Options options = serial();
  options.intersections = StartPolicy::exempt;
  Simulation simulation(scene, options);
  const int start = simulation.count_intersections();
  CHECK(start > 0);
  simulation.step();
  CHECK(simulation.report().exempt > 0);
  for (int step = 1; step < 100; ++step) simulation.step();
  CHECK(simulation.count_intersections() == 0);
  CHECK(simulation.report().exempt == 0);
}
