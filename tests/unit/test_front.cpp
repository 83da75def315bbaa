// SPDX-License-Identifier: Apache-2.0
// Fronts against brute force over every pair of feature boxes and against the trees, through moving sequences in which
// they are kept.
#include "../backends.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>
#include <set>

#include "../engine.hpp"
#include "../meshes.hpp"
#include "../separated.hpp"
#include "stages/front_search.hpp"
#include "stages/tree_search.hpp"

using namespace cama;
using kernels::box;

namespace {

using Pairs = std::vector<std::array<int, 2>>;

Pairs listed(const PairList &list)
{
  Pairs all;
  for (kernels::pair p : list.pairs.download()) all.push_back({p.a, p.b});
  return all;
}
Pairs sorted(Pairs p)
{
  std::sort(p.begin(), p.end());
  return p;
}

/// Every pair of features without a shared vertex whose boxes overlap, one by one.
struct Found {
  Pairs vertex_face, edge_edge;
};
Found brute_force(State &s, const Topology &t)
{
  const std::vector<box> v = s.bounds.vertex_box.download(), f = s.fronts->face_box.download(),
                         e = s.fronts->edge_box.download();
  const auto wanted = [&](int a, int b) {
    const bool oa = a >= s.mesh.cloth_vertices, ob = b >= s.mesh.cloth_vertices;
    return !(oa && ob) && (s.contact.settings.self || oa || ob);
  };
  const auto apart = [](const box &a, const box &b) {
    for (int k = 0; k < 3; ++k)
      if (a.lo[k] > b.hi[k] || b.lo[k] > a.hi[k]) return true;
    return false;
  };
  Found found;
  for (int i = 0; i < s.mesh.vertices; ++i)
    for (int j = 0; j < s.mesh.faces; ++j) {
      const Triangle &n = t.face[j];
      if (n[0] != i && n[1] != i && n[2] != i && wanted(i, n[0]) && !apart(v[i], f[j]))
        found.vertex_face.push_back({i, j});
    }
  for (int i = 0; i < s.mesh.edges; ++i)
    for (int j = i + 1; j < s.mesh.edges; ++j) {
      const auto &a = t.edge[i], &b = t.edge[j];
      if (a[0] != b[0] && a[0] != b[1] && a[1] != b[0] && a[1] != b[1] && wanted(a[0], b[0]) && !apart(e[i], e[j]))
        found.edge_edge.push_back({i, j});
    }
  return found;
}

/// Triangles that share vertices at random: edges with many faces, vertices with up to about `n / 4` faces.
Mesh soup(unsigned seed, int vertices, int faces, double reach)
{
  std::mt19937 engine(seed);
  std::uniform_real_distribution<double> place(-0.5, 0.5);
  Mesh m;
  for (int i = 0; i < vertices; ++i) m.position.push_back({place(engine), place(engine), place(engine)});
  std::set<std::set<int>> present;
  const auto add = [&](int a, int b, int c) {
    const auto far = [&](int i, int j) {
      return std::hypot(m.position[i].x - m.position[j].x, m.position[i].y - m.position[j].y,
                        m.position[i].z - m.position[j].z) > reach;
    };
    if (a == b || b == c || a == c || far(a, b) || far(b, c) || far(a, c) || !present.insert({a, b, c}).second) return;
    m.face.push_back({a, b, c});
  };
  std::uniform_int_distribution<int> any(0, vertices - 1);
  for (int i = 0; i < 400 * faces && static_cast<int>(m.face.size()) < faces; ++i)
    add(any(engine), any(engine), any(engine));
  std::vector<int> number(m.position.size(), -1);   // vertices in use only
  Mesh used;
  for (Triangle &t : m.face)
    for (int &v : t) {
      if (number[v] < 0) {
        number[v] = static_cast<int>(used.position.size());
        used.position.push_back(m.position[v]);
      }
      v = number[v];
    }
  used.face = m.face;
  return used;
}

/// A sheet folded like a map, layers 3 mm apart.
Mesh folded(int cells)
{
  Mesh m = meshes::grid(cells, cells, 0.4, 0.4);
  for (dvec3 &x : m.position) {
    const double u = x.x / 0.1;
    const int layer = static_cast<int>(u);
    x = {layer % 2 ? 0.1 * (layer + 1 - u) : 0.1 * (u - layer), x.y, 0.003 * u};
  }
  return m;
}

/// A fan: more faces around one vertex than make each other adjacent.
Mesh fan(int sectors)
{
  Mesh m = meshes::sphere(sectors, 4, 0.2, {0.05, 0.02, 0.01});
  return m;
}

Scene with(std::vector<Mesh> cloths, std::vector<Mesh> obstacles, bool self = true)
{
  Scene s;
  s.time_step = 1.0 / 200;
  s.contact.thickness = 4e-3;
  s.contact.self = self;
  for (std::size_t i = 0; i < cloths.size(); ++i)
    s.cloths.push_back(meshes::cloth(std::move(cloths[i]), meshes::cotton(), "cloth" + std::to_string(i)));
  Motion moving;   // the tests move everything
  moving.velocity = {1, 0, 0};
  for (std::size_t i = 0; i < obstacles.size(); ++i)
    s.obstacles.push_back(meshes::obstacle(std::move(obstacles[i]), moving, "obstacle" + std::to_string(i)));
  return s;
}

Mesh moved(Mesh m, dvec3 by)
{
  for (dvec3 &x : m.position) x = {x.x + by.x, x.y + by.y, x.z + by.z};
  return m;
}

struct Case {
  const char *name;
  Scene scene;
};
std::vector<Case> cases(unsigned seed)
{
  return {{"one triangle", with({soup(seed, 3, 1, 9)}, {})},
          {"one triangle, one obstacle triangle", with({soup(seed, 3, 1, 9)}, {soup(seed + 1, 3, 1, 9)})},
          {"soup", with({soup(seed, 60, 150, 0.5)}, {})},
          {"dense soup and obstacle", with({soup(seed, 20, 120, 9)}, {soup(seed + 9, 90, 33, 0.4)})},
          {"book", with({meshes::book(37, 0.3)}, {meshes::sphere(5, 3, 0.1)})},
          {"book of few pages", with({meshes::book(7, 0.3)}, {})},
          {"folded", with({folded(12)}, {})},
          {"sheets and ball",
           with({meshes::grid(9, 8, 0.3, 0.3, -0.15, -0.15, 0.02), meshes::grid(7, 7, 0.3, 0.3, -0.14, -0.16, 0.024)},
                {meshes::sphere(9, 7, 0.1)})},
          {"without self",
           with({folded(8)}, {meshes::sphere(9, 7, 0.1), moved(soup(seed, 30, 20, 9), {0.1, 0, 0})}, false)},
          {"fan", with({fan(40), meshes::grid(3, 3, 0.3, 0.3)}, {fan(31)})}};
}

/// Positions of search k: waves, a drift of each half, and sometimes everything scattered or in one place.
std::vector<dvec3> positions(const std::vector<dvec3> &rest, unsigned seed, int k)
{
  std::mt19937 engine(seed * 977 + static_cast<unsigned>(k));
  std::uniform_real_distribution<double> noise(-1, 1);
  std::vector<dvec3> x = rest;
  const double phase = 0.35 * k, scattered = k % 11 == 7 ? 0.3 : 0.004, squeeze = k % 13 == 9 ? 0.02 : 1;
  for (std::size_t i = 0; i < x.size(); ++i) {
    const double side = i < x.size() / 2 ? 1 : -1;
    dvec3 &p = x[i];
    p = {squeeze * p.x + 0.08 * side * std::sin(phase) + scattered * noise(engine),
         squeeze * p.y + 0.05 * std::sin(phase + 9 * p.x) + scattered * noise(engine),
         squeeze * p.z + 0.06 * std::cos(phase + 7 * p.y) + scattered * noise(engine)};
  }
  return x;
}

/// An engine, whose own pipeline is not used, with a FrontSearch on its state.
struct Fronts {
  Fronts(const Scene &scene, const std::string &backend, int threads, bool localized = true)
      : engine(scene, options(backend, threads, localized)), search(engine.state), from(*engine.backend),
        to(*engine.backend)
  {
    engine.state.fronts = &search.streams();
  }
  static Options options(const std::string &backend, int threads, bool localized)
  {
    Options o = serial();
    o.backend = backend;
    o.threads = threads;
    o.paper.localized_search = localized;
    return o;
  }
  void run(const std::vector<dvec3> &x, const std::vector<dvec3> &y)
  {
    from.assign(x);
    to.assign(y);
    search.run(engine.state, from, to);
  }
  StagedEngine engine;
  FrontSearch search;
  Stream<dvec3> from, to;
};

/// Checks how often the front covers each pair of leaves; adjacent pairs, which it leaves out, are treated separately.
void check_cut(State &s, const Topology &t)
{
  const int n = s.mesh.triangles, root = kernels::tree_root_level(n);
  std::vector<int> covered(static_cast<std::size_t>(n) * n, 0);
  for (kernels::pair packed : s.fronts->self_front.download()) {
    const kernels::node_pair p = kernels::front_unpack(packed);
    const int level = std::min(p.level, root);
    for (int i = p.a << level; i < std::min(n, (p.a + 1) << level); ++i)
      for (int j = p.b << level; j < std::min(n, (p.b + 1) << level); ++j)
        ++covered[static_cast<std::size_t>(i) * n + j];
  }
  const std::vector<int> order = s.fronts->face_order.download();
  int wrong = 0, twice = 0;
  for (int i = 0; i < n; ++i)
    for (int j = i; j < n; ++j) {
      bool touch = false;
      for (int v : t.face[order[i]])
        for (int w : t.face[order[j]]) touch |= v == w;
      const int c = covered[static_cast<std::size_t>(i) * n + j];
      wrong += c == 0 && !touch;
      twice += c > 1;
    }
  CHECK(wrong == 0);
  CHECK(twice == 0);
}

}  // namespace

TEST_CASE("fronts give every pair of features whose boxes overlap, once, trees those but for separated ones", "[front]")
{
  for (const std::string &backend : backends_here())
    for (unsigned seed : {1u, 2u, 3u}) {
      if (backend != "cpu" && seed > 1) continue;
      for (const Case &c : cases(seed)) {
        INFO(backend << ", seed " << seed << ", " << c.name);
        Fronts fronts(c.scene, backend, 1);
        StagedEngine trees(c.scene);
        ListedPairs own(*trees.backend);
        TreeSearch tree(*trees.backend, own);
        const Topology &t = fronts.engine.topology;
        State &s = fronts.engine.state;
        const auto faces = s.mesh.face.download();
        const auto edges = s.mesh.edge.download();
        int most = 0, fewest = 0x7fffffff;
        for (int k = 0; k < 26; ++k) {
          INFO("search " << k);
          const auto x = positions(t.position, seed, k), y = positions(t.position, seed, k + 1);
          fronts.run(x, y);
          const Pairs vf = listed(s.contact.vertex_face), ee = listed(s.contact.edge_edge);
          const Found expected = brute_force(s, t);
          REQUIRE(sorted(vf) == sorted(expected.vertex_face));
          REQUIRE(sorted(ee) == sorted(expected.edge_edge));
          trees.state.mesh.position.assign(x);
          trees.state.mesh.position_next.assign(y);
          tree.run(trees.state, trees.state.mesh.position, trees.state.mesh.position_next);
          const Pairs tree_vf = listed(trees.state.contact.vertex_face),
                      tree_ee = listed(trees.state.contact.edge_edge);
          REQUIRE(separated::wrong(sorted(vf), tree_vf, x, y, faces).empty());
          REQUIRE(separated::wrong(sorted(ee), tree_ee, x, y, faces, &edges).empty());
          REQUIRE(s.contact.vertex_face.gap_bound.size() == static_cast<int>(vf.size()));
          REQUIRE(s.contact.edge_edge.direction.size() == static_cast<int>(ee.size()));
          for (float gap_bound : s.contact.vertex_face.gap_bound.download()) REQUIRE(gap_bound == 0);
          for (const auto &d : s.contact.edge_edge.direction.download()) REQUIRE((d.x == 0 && d.y == 0 && d.z == 0));
          if (c.scene.contact.self) check_cut(s, t);
          const int front = s.fronts->front.size() + s.fronts->self_front.size();
          most = std::max(most, front);
          fewest = std::min(fewest, front);
        }
        if (t.face.size() > 50) CHECK(most > fewest);   // pairs were opened and pruned
        CHECK(fronts.search.rebuilds() < 26);
      }
    }
}

TEST_CASE("fronts kept through a smooth motion sprout and prune without being built anew", "[front]")
{
  const Scene scene = with({meshes::grid(20, 20, 0.4, 0.4), meshes::grid(20, 20, 0.4, 0.4, 0, 0, 0.1)},
                           {meshes::sphere(12, 8, 0.05, {0.2, 0.2, 0.2})});
  Fronts fronts(scene, "cpu", 1);
  State &s = fronts.engine.state;
  const Topology &t = fronts.engine.topology;
  const int lower = 21 * 21;
  std::vector<int> size;
  const auto at = [&](double height) {
    std::vector<dvec3> x = t.position;
    for (int v = lower; v < 2 * lower; ++v) x[v].z -= height;
    for (std::size_t v = static_cast<std::size_t>(2 * lower); v < x.size(); ++v) x[v].z -= 2 * height;
    return x;
  };
  for (int k = 0; k < 40; ++k) {
    INFO("search " << k);
    const double height = 0.0045 * (k < 20 ? k : 39 - k);   // to 14 mm above the lower sheet, and back
    fronts.run(at(height), at(height + 1e-4));
    const Found expected = brute_force(s, t);
    REQUIRE(sorted(listed(s.contact.vertex_face)) == sorted(expected.vertex_face));
    REQUIRE(sorted(listed(s.contact.edge_edge)) == sorted(expected.edge_edge));
    check_cut(s, t);
    size.push_back(s.fronts->self_front.size() + s.fronts->front.size());
  }
  CHECK(fronts.search.rebuilds() == 1);
  CHECK(size[19] > 1.1 * size[0]);
  CHECK(size[39] == size[0]);   // pruned to its original size
}

TEST_CASE("a localized update adds exactly the pairs that are new, and leaves the others as they are", "[front]")
{
  for (const std::string &backend : backends_here())
    for (unsigned seed : {4u, 5u, 6u}) {
      if (backend != "cpu" && seed > 4) continue;
      for (const Case &c : cases(seed)) {
        INFO(backend << ", seed " << seed << ", " << c.name);
        Fronts fronts(c.scene, backend, 1);
        State &s = fronts.engine.state;
        const Topology &t = fronts.engine.topology;
        std::mt19937 engine(seed);
        std::uniform_real_distribution<double> far(-0.2, 0.2);
        std::uniform_int_distribution<int> any(0, s.mesh.vertices - 1);
        int fresh = 0;
        for (int k = 0; k < 6; ++k) {
          const auto x = positions(t.position, seed, k);
          auto y = positions(t.position, seed, k + 1);
          fronts.run(x, y);
          CHECK(fronts.search.update(s, fronts.from, fronts.to, 1e-6) == CandidateSearch::Change::none);
          for (int pass = 0; pass < 4; ++pass) {
            INFO("search " << k << ", update " << pass);
            const int few = std::min(3, s.mesh.vertices / 20);
            for (int i = 0; i < few; ++i) {
              dvec3 &p = y[any(engine)];
              p = {p.x + far(engine), p.y + far(engine), p.z + far(engine)};
            }
            fronts.to.assign(y);
            for (PairList *list : {&s.contact.vertex_face, &s.contact.edge_edge}) {   // values that must be kept
              std::vector<float> gap_bound(static_cast<std::size_t>(list->pairs.size()), -1);
              std::vector<kernels::fvec3> direction(gap_bound.size());
              for (std::size_t i = 0; i < gap_bound.size(); ++i) {
                direction[i] = {static_cast<float>(i), 2, 3};
              }
              list->gap_bound.assign(gap_bound);
              list->direction.assign(direction);
            }
            const Pairs vf = listed(s.contact.vertex_face), ee = listed(s.contact.edge_edge);
            const std::vector<box> before = s.bounds.vertex_box.download();
            const int localized = fronts.search.localized();
            const CandidateSearch::Change change = fronts.search.update(s, fronts.from, fronts.to, 1e-6);
            REQUIRE(change != CandidateSearch::Change::renewed);
            const bool changed = change == CandidateSearch::Change::grown;
            CHECK(fronts.search.localized() == localized + changed);
            if (few == 0) CHECK_FALSE(changed);
            const std::vector<box> after = s.bounds.vertex_box.download();
            for (std::size_t i = 0; i < after.size(); ++i)
              for (int axis = 0; axis < 3; ++axis)
                REQUIRE((after[i].lo[axis] <= before[i].lo[axis] && after[i].hi[axis] >= before[i].hi[axis]));
            const Found expected = brute_force(s, t);
            const Pairs vf_after = listed(s.contact.vertex_face), ee_after = listed(s.contact.edge_edge);
            REQUIRE(sorted(vf_after) == sorted(expected.vertex_face));
            REQUIRE(sorted(ee_after) == sorted(expected.edge_edge));
            REQUIRE(std::equal(vf.begin(), vf.end(), vf_after.begin()));
            REQUIRE(std::equal(ee.begin(), ee.end(), ee_after.begin()));
            fresh += static_cast<int>(vf_after.size() + ee_after.size() - vf.size() - ee.size());
            const std::pair<PairList *, std::size_t> lists[] = {{&s.contact.vertex_face, vf.size()},
                                                                {&s.contact.edge_edge, ee.size()}};
            for (const auto &[list, old] : lists) {
              const std::vector<float> gap_bound = list->gap_bound.download();
              const std::vector<kernels::fvec3> direction = list->direction.download();
              REQUIRE(gap_bound.size() == static_cast<std::size_t>(list->pairs.size()));
              REQUIRE(direction.size() == gap_bound.size());
              for (std::size_t i = 0; i < gap_bound.size(); ++i) {
                REQUIRE(gap_bound[i] == (i < old ? -1 : 0));
                if (i < old)
                  REQUIRE((direction[i].x == static_cast<float>(i) && direction[i].y == 2 && direction[i].z == 3));
                else
                  REQUIRE(std::abs(std::hypot(direction[i].x, direction[i].y, direction[i].z) - 1) < 1e-6);
              }
            }
          }
        }
        if (t.face.size() > 100) CHECK(fresh > 0);
      }
    }
}

TEST_CASE("many vertices out of their boxes, or the option, make a full search; it forgets what was known", "[front]")
{
  const Scene scene = with({folded(12)}, {});
  for (bool localized : {true, false}) {
    Fronts fronts(scene, "cpu", 1, localized);
    State &s = fronts.engine.state;
    const Topology &t = fronts.engine.topology;
    fronts.run(t.position, t.position);
    std::vector<dvec3> y = t.position;
    for (std::size_t i = 0; i < y.size(); i += localized ? 2 : 50) y[i].z += 0.1;
    fronts.to.assign(y);
    s.contact.vertex_face.gap_bound.assign(
        std::vector<float>(static_cast<std::size_t>(s.contact.vertex_face.gap_bound.size()), -1));
    REQUIRE(fronts.search.update(s, fronts.from, fronts.to, 1e-6) == CandidateSearch::Change::renewed);
    CHECK(fronts.search.localized() == 0);
    for (float gap_bound : s.contact.vertex_face.gap_bound.download()) CHECK(gap_bound == 0);
    CHECK(sorted(listed(s.contact.vertex_face)) == sorted(brute_force(s, t).vertex_face));
  }
}

TEST_CASE("fronts have the same order for 1, 2 and 7 threads and on every backend", "[front][determinism]")
{
  for (const Case &c : cases(8)) {
    INFO(c.name);
    Fronts reference(c.scene, "cpu", 1);
    std::vector<std::unique_ptr<Fronts>> others;
    for (int threads : {2, 7}) others.push_back(std::make_unique<Fronts>(c.scene, "cpu", threads));
    for (const std::string &backend : backends_here())
      if (backend != "cpu") others.push_back(std::make_unique<Fronts>(c.scene, backend, 1));
    for (int k = 0; k < 10; ++k) {
      const auto x = positions(reference.engine.topology.position, 8, k),
                 y = positions(reference.engine.topology.position, 8, k + 1);
      reference.run(x, y);
      for (auto &other : others) {
        other->run(x, y);
        REQUIRE(listed(other->engine.state.contact.vertex_face) == listed(reference.engine.state.contact.vertex_face));
        REQUIRE(listed(other->engine.state.contact.edge_edge) == listed(reference.engine.state.contact.edge_edge));
      }
    }
  }
}

TEST_CASE("orphans grow with the mesh, not with its square, whatever meets in a vertex", "[front]")
{
  for (int pages : {50, 800}) {
    Fronts book(with({meshes::book(pages, 0.3)}, {}), "cpu", 1);
    CHECK(book.engine.state.fronts->orphan_vertex_face.size() + book.engine.state.fronts->orphan_edge_edge.size() <=
          50 * pages);
  }
  Fronts sheet(with({meshes::grid(30, 30, 1, 1)}, {}), "cpu", 1);
  const int orphans =
      sheet.engine.state.fronts->orphan_vertex_face.size() + sheet.engine.state.fronts->orphan_edge_edge.size();
  CHECK(orphans > 5 * 1800);
  CHECK(orphans < 20 * 1800);
}

TEST_CASE("a steady motion allocates nothing once the fronts have their size", "[front]")
{
  Fronts fronts(with({meshes::grid(20, 20, 0.4, 0.4), meshes::grid(20, 20, 0.4, 0.4, 0, 0, 0.004)},
                     {meshes::sphere(12, 8, 0.05, {0.2, 0.2, 0.03})}),
                "cpu", 1);
  std::vector<dvec3> x = fronts.engine.topology.position, y = x;
  for (dvec3 &p : y) p.z += 1e-3;
  for (int k = 0; k < 3; ++k) fronts.run(k % 2 ? x : y, y);
  fronts.from.assign(x);
  const std::size_t bytes = fronts.engine.backend->allocated_bytes(), peak = fronts.engine.backend->peak_bytes();
  for (int k = 0; k < 10; ++k) fronts.search.run(fronts.engine.state, k % 2 ? fronts.from : fronts.to, fronts.to);
  CHECK(fronts.engine.backend->allocated_bytes() == bytes);
  CHECK(fronts.engine.backend->peak_bytes() == peak);
}

TEST_CASE("the paper's mode has the same bits with trees and with fronts", "[front]")
{
  Scene scene = meshes::pile(8);
  std::uint64_t hash[2];
  for (int way = 0; way < 2; ++way) {
    Options o = serial(Accuracy::paper);
    REQUIRE(o.paper.search == SearchKind::fronts);
    o.paper.search = way == 0 ? SearchKind::tree : SearchKind::fronts;
    Simulation simulation(scene, o);
    int impacts = 0;
    for (int i = 0; i < 15; ++i) {
      simulation.step();
      impacts += simulation.report().impacts;
    }
    CHECK(impacts > 0);
    hash[way] = simulation.state_hash();
    std::set<std::string> streams;
    for (const StreamInfo &info : simulation.streams())
      if (info.bytes) streams.insert(info.name);
    for (const char *name :
         {"front", "self_front", "triangle_pairs", "orphan_vertex_face", "orphan_edge_edge", "face_features"})
      CHECK(streams.count(name) == static_cast<std::size_t>(way));
    CHECK(streams.count("trees.cloth.edge_bvh") == static_cast<std::size_t>(1 - way));
  }
  CHECK(hash[0] == hash[1]);
}
