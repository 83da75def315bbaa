// SPDX-License-Identifier: Apache-2.0
// Boxes, the implicit tree and the candidate queries against brute force over every pair.
#include "../catch.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numeric>
#include <random>
#include <set>

#include "cama/mesh.hpp"
#include "device/kernels.hpp"

using namespace cama;
using namespace cama::kernels;

namespace {

using Pairs = std::vector<std::array<int, 2>>;

struct Scene {
  std::vector<dvec3> position, target;
  std::vector<double> margin;
  std::vector<face_nodes> face;
  std::vector<edge_nodes> edge;
  int cloth_vertices = 0;
};

/// Leaves in order, and the groups above them.
template <class Nodes> struct Tree {
  std::vector<int> order;
  std::vector<Nodes> leaf;
  std::vector<bvh8_node> group;
};

/// changed: null for all groups.
void make_groups(int n, const face_nodes *leaf, const std::vector<box> &boxes, bvh8_node *tree,
                 const int *changed = nullptr)
{
  face_groups(group_level_size(n, 0), n, leaf, boxes.data(), changed, tree);
}
void make_groups(int n, const edge_nodes *leaf, const std::vector<box> &boxes, bvh8_node *tree,
                 const int *changed = nullptr)
{
  edge_groups(group_level_size(n, 0), n, leaf, boxes.data(), changed, tree);
}

/// both: two levels at a time.
void make_levels(int n, bool both, bvh8_node *tree)
{
  const int root = group_root_level(n);
  for (int level = 0; level < root;) {
    const int two = both && level + 2 <= root;
    level += 1 + two;
    group_levels(group_level_size(n, level), n, level, two, tree);
  }
}

template <class Nodes>
Tree<Nodes> build_tree(const std::vector<Nodes> &nodes, const std::vector<box> &boxes,
                       const std::vector<box> &vertex_box, const std::vector<dvec3> &bounds, bool both)
{
  Tree<Nodes> tree;
  const int n = static_cast<int>(boxes.size());
  std::vector<key64> key(n);
  tree.order.resize(n);
  for (int i = 0; i < n; ++i) {
    key[i] = morton_code(boxes[i], bounds.data(), bounds[0]);
    tree.order[i] = i;
  }
  std::stable_sort(tree.order.begin(), tree.order.end(), [&](int a, int b) { return key[a] < key[b]; });
  for (int i : tree.order) tree.leaf.push_back(nodes[i]);
  tree.group.resize(group_tree_size(n));
  make_groups(n, tree.leaf.data(), vertex_box, tree.group.data());
  make_levels(n, both, tree.group.data());
  return tree;
}

struct Found {
  Pairs vertex_face, edge_edge;
};

/// pools, pool_blocks: of blocks of hits; part: groups of level 0 in the parts in which each vertex queries the tree;
/// shares: of each vertex and edge; separate: without pairs that a coordinate separates throughout; copied: by teams.
/// batch: items that one work-item walks for; QUERY_TEAM: those that a team does; BY_ITEM: a team walks for each.
constexpr int BY_ITEM = 0;
Found query(const Scene &s, int self, int pools, int pool_blocks, int batch, bool both, int part = 1 << 20,
            int shares = 1, bool separate = false, bool copied = false)
{
  const int vertices = int(s.position.size()), faces = int(s.face.size()), edges = int(s.edge.size());
  const int chunks = std::min(vertices, 7);
  std::vector<dvec3> corners(2 * chunks), bounds(2);
  position_bounds(chunks, vertices, s.position.data(), s.target.data(), corners.data());
  reduce_bounds(1, chunks, corners.data(), bounds.data());
  std::vector<box> vertex_box(vertices), face_box(faces), edge_box(edges);
  vertex_boxes(vertices, s.position.data(), s.target.data(), s.margin.data(), bounds.data(), vertex_box.data());
  face_boxes(faces, s.face.data(), vertex_box.data(), face_box.data());
  edge_boxes(edges, s.edge.data(), vertex_box.data(), edge_box.data());
  const std::vector<double> short_motion(vertices, 0);
  const double uncertain = 0;
  std::vector<end_boxes> own_ends(vertices);
  vertex_end_boxes(vertices, s.position.data(), s.target.data(), s.margin.data(), short_motion.data(), bounds.data(),
                   &uncertain, 0, nullptr, vertex_box.data(), own_ends.data());
  const end_boxes *ends = separate ? own_ends.data() : nullptr;
  const auto face_tree = build_tree(s.face, face_box, vertex_box, bounds, both);
  const auto edge_tree = build_tree(s.edge, edge_box, vertex_box, bounds, both);

  std::vector<int> order(vertices);
  std::iota(order.rbegin(), order.rend(), 0);
  // Vertices, then edges, in one list of items.
  const int vertex_items = vertices * tree_parts(faces, part) * shares, edge_items = edges * shares,
            items = vertex_items + edge_items;
  const int blocks_at = HIT_ROW * items, blocks = pools * pool_blocks;
  std::vector<int> hit(std::size_t(blocks_at) + HIT_BLOCK * blocks, -7), taken(POOL_STRIDE * pools, 0);
  std::vector<int> count(items, -1), offset(items + 1, 0);
  if (batch == BY_ITEM) {
    item_query_vertex_face(vertices, order.data(), vertex_box.data(), faces, face_tree.order.data(),
                           face_tree.leaf.data(), face_tree.group.data(), s.cloth_vertices, self, QUERY_ALL, nullptr,
                           nullptr, ends, nullptr, 0, blocks_at, pools, pool_blocks, hit.data(), taken.data(),
                           count.data());
    item_query_edge_edge(edges, edge_tree.order.data(), edge_tree.leaf.data(), vertex_box.data(), edges,
                         edge_tree.order.data(), edge_tree.leaf.data(), edge_tree.group.data(), s.cloth_vertices, self,
                         QUERY_ALL, nullptr, nullptr, ends, nullptr, vertex_items, blocks_at, pools, pool_blocks,
                         hit.data(), taken.data(), count.data());
  } else if (batch == QUERY_TEAM) {
    team_query_vertex_face((vertex_items - 1) / batch + 1, vertex_items, order.data(), vertex_box.data(), faces,
                           face_tree.order.data(), face_tree.leaf.data(), face_tree.group.data(), s.cloth_vertices,
                           self, QUERY_ALL, nullptr, nullptr, ends, nullptr, 0, blocks_at, pools, pool_blocks,
                           hit.data(), taken.data(), count.data());
    team_query_edge_edge((edge_items - 1) / batch + 1, edge_items, edge_tree.order.data(), edge_tree.leaf.data(),
                         vertex_box.data(), edges, edge_tree.order.data(), edge_tree.leaf.data(),
                         edge_tree.group.data(), s.cloth_vertices, self, QUERY_ALL, nullptr, nullptr, ends, nullptr,
                         vertex_items, blocks_at, pools, pool_blocks, hit.data(), taken.data(), count.data());
  } else {
    query_vertex_face_count((vertex_items + batch - 1) / batch, vertex_items, batch, part, shares, order.data(),
                            vertex_box.data(), faces, face_tree.order.data(), face_tree.leaf.data(),
                            face_tree.group.data(), s.cloth_vertices, self, QUERY_ALL, nullptr, nullptr, ends, nullptr,
                            0, blocks_at, pools, pool_blocks, hit.data(), taken.data(), count.data());
    query_edge_edge_count((edge_items + batch - 1) / batch, edge_items, batch, shares, edge_tree.order.data(),
                          edge_tree.leaf.data(), vertex_box.data(), edges, edge_tree.order.data(),
                          edge_tree.leaf.data(), edge_tree.group.data(), s.cloth_vertices, self, QUERY_ALL, nullptr,
                          nullptr, ends, nullptr, vertex_items, blocks_at, pools, pool_blocks, hit.data(), taken.data(),
                          count.data());
  }
  std::partial_sum(count.begin(), count.end(), offset.begin() + 1);
  std::vector<int> totals(2 + pools);
  query_totals(pools, vertex_items, items, offset.data(), taken.data(), totals.data());
  for (int n : taken) REQUIRE(n == 0);
  int wanted = 0;
  for (int c : count) wanted += std::max(0, c - ROW_HITS + BLOCK_HITS - 1) / BLOCK_HITS;
  REQUIRE(std::accumulate(totals.begin() + 2, totals.end(), 0) == wanted);
  const int first = 3;   // behind the earlier entries of a list
  std::vector<pair> vf(totals[0] + first), ee(totals[1] + first);
  std::vector<float> vf_gap_bound(vf.size(), 7), ee_gap_bound(ee.size(), 7);
  const int edges_first = first - totals[0];
  if (copied) {   // teams of the hits of many items
    copy_hits((vertex_items - 1) / HIT_TEAM + 1, vertex_items, tree_parts(faces, part), 0, order.data(), 0, blocks_at,
              hit.data(), count.data(), offset.data(), first, vf.data(), vf_gap_bound.data());
    copy_hits((edge_items - 1) / HIT_TEAM + 1, edge_items, 1, 1, edge_tree.order.data(), vertex_items, blocks_at,
              hit.data(), count.data(), offset.data(), edges_first, ee.data(), ee_gap_bound.data());
  }
  query_vertex_face_fill(vertex_items, copied ? 1 : 0, part, shares, order.data(), vertex_box.data(), faces,
                         face_tree.order.data(), face_tree.leaf.data(), face_tree.group.data(), s.cloth_vertices, self,
                         QUERY_ALL, nullptr, ends, nullptr, 0, blocks_at, hit.data(), count.data(), offset.data(),
                         first, vf.data(), vf_gap_bound.data());
  query_edge_edge_fill(edge_items, copied ? 1 : 0, shares, edge_tree.order.data(), edge_tree.leaf.data(),
                       vertex_box.data(), edges, edge_tree.order.data(), edge_tree.leaf.data(), edge_tree.group.data(),
                       s.cloth_vertices, self, QUERY_ALL, nullptr, nullptr, ends, nullptr, vertex_items, blocks_at,
                       hit.data(), count.data(), offset.data(), first - totals[0], ee.data(), ee_gap_bound.data());
  Found found;
  for (int i = 0; i < first; ++i) REQUIRE((vf_gap_bound[i] == 7 && ee_gap_bound[i] == 7));
  for (std::size_t i = first; i < vf.size(); ++i) {
    REQUIRE(vf_gap_bound[i] == 0);
    found.vertex_face.push_back({vf[i].a, vf[i].b});
  }
  for (std::size_t i = first; i < ee.size(); ++i) {
    REQUIRE(ee_gap_bound[i] == 0);
    found.edge_edge.push_back({ee[i].a, ee[i].b});
  }
  return found;
}

/// Boxes in double, every pair; `slack` widens them.
Found brute_force(const Scene &s, int self, double slack)
{
  struct Box {
    double lo[3], hi[3];
  };
  const auto make = [&](const int *v, int count) {
    Box b;
    for (int k = 0; k < 3; ++k) {
      b.lo[k] = 1e300;
      b.hi[k] = -1e300;
      for (int i = 0; i < count; ++i) {
        const double x = dcomponent(s.position[v[i]], k), y = dcomponent(s.target[v[i]], k);
        b.lo[k] = std::min(b.lo[k], std::min(x, y) - s.margin[v[i]] - slack);
        b.hi[k] = std::max(b.hi[k], std::max(x, y) + s.margin[v[i]] + slack);
      }
    }
    return b;
  };
  const auto overlap = [](const Box &a, const Box &b) {
    for (int k = 0; k < 3; ++k)
      if (a.lo[k] > b.hi[k] || b.lo[k] > a.hi[k]) return false;
    return true;
  };
  const auto wanted = [&](int a, int b) {
    const bool obstacle_a = a >= s.cloth_vertices, obstacle_b = b >= s.cloth_vertices;
    return obstacle_a != obstacle_b || (!obstacle_a && self);
  };
  std::vector<Box> vertex, face, edge;
  for (int v = 0; v < int(s.position.size()); ++v) vertex.push_back(make(&v, 1));
  for (const auto &f : s.face) face.push_back(make(f.node, 3));
  for (const auto &e : s.edge) edge.push_back(make(e.node, 2));
  Found found;
  for (int v = 0; v < int(vertex.size()); ++v)
    for (int f = 0; f < int(face.size()); ++f) {
      const int *t = s.face[f].node;
      if (t[0] != v && t[1] != v && t[2] != v && wanted(v, t[0]) && overlap(vertex[v], face[f]))
        found.vertex_face.push_back({v, f});
    }
  for (int a = 0; a < int(edge.size()); ++a)
    for (int b = a + 1; b < int(edge.size()); ++b) {
      const int *p = s.edge[a].node, *q = s.edge[b].node;
      if (p[0] != q[0] && p[0] != q[1] && p[1] != q[0] && p[1] != q[1] && wanted(p[0], q[0]) &&
          overlap(edge[a], edge[b]))
        found.edge_edge.push_back({a, b});
    }
  return found;
}

/// A crumpled sheet of (n+1)^2 vertices and an obstacle likewise.
Scene make_scene(unsigned seed, int n, double size, double offset)
{
  std::mt19937_64 engine(seed);
  const auto random = [&](double s) { return std::uniform_real_distribution<double>(-s, s)(engine); };
  Scene s;
  std::vector<Triangle> triangles;
  for (int sheet = 0; sheet < 2; ++sheet) {
    const int base = int(s.position.size());
    for (int i = 0; i <= n; ++i)
      for (int j = 0; j <= n; ++j) {
        const dvec3 x = dvec3_make(offset + size * i / n, offset + size * j / n, offset + random(size * 0.2));
        s.position.push_back(x);
        s.target.push_back(dadd(x, dvec3_make(random(size * 0.05), random(size * 0.05), random(size * 0.05))));
        s.margin.push_back(size * 0.01 * std::fabs(random(1)));
      }
    for (int i = 0; i < n; ++i)
      for (int j = 0; j < n; ++j) {
        const int a = base + i * (n + 1) + j, b = a + 1, c = a + n + 1, d = c + 1;
        triangles.push_back({a, b, c});
        triangles.push_back({b, d, c});
      }
    if (sheet == 0) s.cloth_vertices = int(s.position.size());
  }
  for (const Triangle &t : triangles) s.face.push_back({{t[0], t[1], t[2]}});
  for (const auto &e : unique_edges(triangles)) s.edge.push_back({{e[0], e[1]}});
  return s;
}

Pairs sorted(Pairs p)
{
  std::sort(p.begin(), p.end());
  return p;
}
bool contains(const Pairs &all, const Pairs &some)
{
  return std::includes(all.begin(), all.end(), some.begin(), some.end());
}

}  // namespace

TEST_CASE("the box at the end of a motion has room for what is uncertain, unless most ends are too uncertain", "[tree]")
{
  // Two of the three vertices that are asked move by 2 m, the other by 1 m.
  const int n = 2 * ASKED_VERTICES + 1;
  const std::vector<double> margin(n, 0.01), short_motion(n, 0.15);
  const double uncertain = 0.02;
  std::vector<dvec3> x(n, dvec3_make(0, 0, 0)), y(n, dvec3_make(0, 0, 1)), bounds{{0, 0, 0}, {0, 0, 2}};
  y[ASKED_VERTICES] = y[2 * ASKED_VERTICES] = dvec3_make(0, 0, 2);
  std::vector<box> whole(n);
  vertex_boxes(n, x.data(), y.data(), margin.data(), bounds.data(), whole.data());
  int far_ends = 0;
  count_far_ends(3, x.data(), y.data(), margin.data(), short_motion.data(), &uncertain, &far_ends);
  CHECK(far_ends == 2);  // 0.02 + 2 / 8 is more than 0.15, 0.02 + 1 / 8 is not
  const double fall = 0.2;  // what hangs has this motion, and is as uncertain
  const std::vector<dvec3> fallen(n, dvec3_make(0, 0, -fall));
  count_far_ends(3, x.data(), fallen.data(), margin.data(), short_motion.data(), &fall, &far_ends);
  CHECK(far_ends == 2);
  const auto end_of_first = [&](int all, int far) {
    std::vector<end_boxes> ends(n);
    vertex_end_boxes(n, x.data(), y.data(), margin.data(), short_motion.data(), bounds.data(), &uncertain, all, &far,
                     whole.data(), ends.data());
    CHECK(std::fabs(double(-ends[0].minus_hi[2]) - 0.01) < 1e-6);  // of the start
    CHECK(std::fabs(double(ends[0].lo[6] - ends[0].minus_hi[6]) - 2) < 1e-6);
    return double(-ends[0].minus_hi[6]) - 1;
  };
  CHECK(std::fabs(end_of_first(0, 0) - (0.01 + 0.02 + 1. / 8)) < 1e-6);  // nobody was asked
  CHECK(std::fabs(end_of_first(4, 1) - (0.01 + 0.02 + 1. / 8)) < 1e-6);
  CHECK(std::fabs(end_of_first(4, 2) - (0.01 + 1. / 32)) < 1e-6);
  CHECK(std::fabs(end_of_first(-1, 0) - (0.01 + 1. / 32)) < 1e-6);  // of a known motion
  std::vector<end_boxes> ends(n);
  vertex_end_boxes(n, x.data(), fallen.data(), margin.data(), short_motion.data(), bounds.data(), &fall, 4, &n,
                   whole.data(), ends.data());
  CHECK_FALSE(ends_differ(&ends[0]));  // whatever others do
}

TEST_CASE("pairs that are left out by the boxes at both ends are separated at every moment", "[tree]")
{
  for (unsigned seed : {3u, 4u, 5u}) {
    Scene s = make_scene(seed, 9, 1, seed == 5 ? 1e4 : 0);
    const dvec3 all[] = {{0.3, 0, -0.6}, {0, 0.7, 0.1}};  // with which each sheet goes on, several times an edge
    for (std::size_t v = 0; v < s.position.size(); ++v)
      s.target[v] = dadd(s.target[v], all[int(v) >= s.cloth_vertices]);
    const Found overlapping = query(s, 1, 1, 1000, 1, false);
    Found near;
    for (int batch : {1, 8})
      for (int shares : {1, 8}) {
        if (batch > 1 && shares > 1) continue;
        near = query(s, 1, 1, 1000, batch, false, 1 << 20, shares, true);
        near = {sorted(near.vertex_face), sorted(near.edge_edge)};
        REQUIRE(contains(sorted(overlapping.vertex_face), near.vertex_face));
        REQUIRE(contains(sorted(overlapping.edge_edge), near.edge_edge));
      }
    const auto separated = [&](const std::vector<int> &a, const std::vector<int> &b, double t) {
      for (int k = 0; k < 3; ++k) {
        double lo[2] = {1e300, 1e300}, hi[2] = {-1e300, -1e300};
        for (int side = 0; side < 2; ++side)
          for (int v : side ? b : a) {
            const double x = (1 - t) * dcomponent(s.position[v], k) + t * dcomponent(s.target[v], k);
            lo[side] = std::min(lo[side], x);
            hi[side] = std::max(hi[side], x);
          }
        if (lo[0] > hi[1] || lo[1] > hi[0]) return true;
      }
      return false;
    };
    const auto check = [&](const Pairs &overlap, const Pairs &kept, bool faces) {
      int left_out = 0;
      for (const auto &p : overlap) {
        if (std::binary_search(kept.begin(), kept.end(), p)) continue;
        ++left_out;
        std::vector<int> a = {p[0]}, b;
        if (faces) {
          b.assign(s.face[p[1]].node, s.face[p[1]].node + 3);
        } else {
          a.assign(s.edge[p[0]].node, s.edge[p[0]].node + 2);
          b.assign(s.edge[p[1]].node, s.edge[p[1]].node + 2);
        }
        for (int i = 0; i <= 16; ++i) REQUIRE(separated(a, b, i / 16.0));
      }
      CHECK(left_out > 200);
    };
    check(overlapping.vertex_face, near.vertex_face, true);
    check(overlapping.edge_edge, near.edge_edge, false);
  }
}

TEST_CASE("teams that walk a tree together find what each item does, in its order", "[tree]")
{
  for (const int n : {1, 3, 9, 21}) {  // from one team, not all of whose members have an item, to a tree of four levels
    const Scene s = make_scene(unsigned(n), n, 1, 0);
    for (const bool separate : {false, true})
      for (const int pool_blocks : {1000, 3})  // also where the second pass walks again
        for (const int self : {0, 1}) {
          const Found alone = query(s, self, 2, pool_blocks, 1, true, 1 << 20, 1, separate),
                      together = query(s, self, 2, pool_blocks, QUERY_TEAM, true, 1 << 20, 1, separate),
                      by_item = query(s, self, 2, pool_blocks, BY_ITEM, true, 1 << 20, 1, separate);
          CAPTURE(n, separate, pool_blocks, self);
          REQUIRE(together.vertex_face == alone.vertex_face);
          REQUIRE(together.edge_edge == alone.edge_edge);
          REQUIRE(by_item.vertex_face == alone.vertex_face);
          REQUIRE(by_item.edge_edge == alone.edge_edge);
          if (n > 1) REQUIRE(alone.edge_edge.size() > 20);
        }
  }
}

TEST_CASE("groups with a changed vertex are made anew, the others stay", "[tree]")
{
  const int leaves = 21;
  std::vector<box> before(2 * leaves), after;
  std::vector<edge_nodes> edge(leaves);
  std::vector<face_nodes> face(leaves);
  for (int i = 0; i < leaves; ++i) {
    edge[i] = {{2 * i, 2 * i + 1}};
    face[i] = {{2 * i, 2 * i + 1, 2 * i}};
  }
  for (int v = 0; v < 2 * leaves; ++v)
    for (int k = 0; k < 3; ++k) {
      before[v].lo[k] = float(v);
      before[v].hi[k] = float(v + 1);
    }
  after = before;
  std::vector<int> changed(2 * leaves, 0);
  changed[2 * 9 + 1] = 1;  // of leaf 9, in the second group
  for (box &b : after) b.hi[2] += 5;
  const auto check = [&](const auto *leaf) {
    std::vector<bvh8_node> tree(group_tree_size(leaves)), whole(group_tree_size(leaves));
    make_groups(leaves, leaf, before, tree.data());
    make_groups(leaves, leaf, after, whole.data());
    const std::vector<bvh8_node> old = tree;
    make_groups(leaves, leaf, after, tree.data(), changed.data());
    for (int g = 0; g < 3; ++g)
      for (int k = 0; k < GROUP; ++k) CHECK(tree[g].hi[2][k] == (g == 1 ? whole : old)[g].hi[2][k]);
  };
  check(edge.data());
  check(face.data());
}

TEST_CASE("level sizes and offsets of the implicit tree add up", "[tree]")
{
  for (int leaves = 1; leaves < 600; ++leaves) {
    int offset = 0, level = 0;
    for (int size = leaves;; size = (size + 1) / 2, ++level) {
      REQUIRE(tree_level_size(leaves, level) == size);
      REQUIRE(tree_level_offset(leaves, level) == offset);
      offset += size;
      if (size == 1) break;
    }
    REQUIRE(tree_root_level(leaves) == level);
    REQUIRE(tree_size(leaves) == offset);
  }
  CHECK(tree_size(40000000) < 2 * 40000000 + 32);
}

TEST_CASE("a traversal meets every leaf once, a half traversal the leaves behind it", "[tree]")
{
  box all;
  for (int k = 0; k < 3; ++k) {
    all.lo[k] = -1;
    all.hi[k] = 1;
  }
  for (int leaves = 1; leaves < 140; ++leaves) {
    const std::vector<box> node(tree_size(leaves), all);
    int next = 0;
    for (tree_node n = tree_find(tree_root(leaves), leaves, node.data(), all); n.level == 0;
         n = tree_find(tree_next(n), leaves, node.data(), all))
      REQUIRE(n.index == next++);
    REQUIRE(next == leaves);
    for (int i = 0; i < leaves; ++i) {
      next = i + 1;
      tree_node leaf;
      leaf.level = 0;
      leaf.index = i;
      for (tree_node n = tree_find(tree_next(leaf), leaves, node.data(), all); n.level == 0;
           n = tree_find(tree_next(n), leaves, node.data(), all))
        REQUIRE(n.index == next++);
      REQUIRE(next == leaves);
    }
  }
}

TEST_CASE("groups: sizes and offsets add up; every level is the union of the one below, made one or two at a time",
          "[tree]")
{
  for (int leaves : {1, 2, 7, 8, 9, 63, 64, 65, 511, 512, 513, 4097, 70000}) {
    int offset = 0, level = 0;
    for (int size = (leaves + 7) / 8;; size = (size + 7) / 8, ++level) {
      REQUIRE(group_level_size(leaves, level) == size);
      REQUIRE(group_level_offset(leaves, level) == offset);
      offset += size;
      if (size == 1 && level > 0) break;
    }
    REQUIRE(group_root_level(leaves) == level);
    REQUIRE(group_tree_size(leaves) == offset);
    std::mt19937 random(static_cast<unsigned>(leaves));
    std::uniform_real_distribution<float> place(-5, 5);
    std::vector<box> vertex_box(2 * leaves);
    std::vector<edge_nodes> leaf(leaves);
    for (box &b : vertex_box)
      for (int k = 0; k < 3; ++k) {
        b.lo[k] = place(random);
        b.hi[k] = b.lo[k] + 0.1f;
      }
    for (int i = 0; i < leaves; ++i) leaf[i] = {{2 * i, 2 * i + 1}};
    std::vector<bvh8_node> one(offset), two(offset);
    make_groups(leaves, leaf.data(), vertex_box, one.data());
    two = one;
    make_levels(leaves, false, one.data());
    make_levels(leaves, true, two.data());
    REQUIRE(std::memcmp(one.data(), two.data(), one.size() * sizeof(bvh8_node)) == 0);
    std::vector<box> below(leaves);  // by hand
    for (int i = 0; i < leaves; ++i) below[i] = box_union(vertex_box[2 * i], vertex_box[2 * i + 1]);
    for (int l = 0; l <= level; ++l) {
      std::vector<box> here;
      for (int g = 0; g < group_level_size(leaves, l); ++g) {
        for (int k = 0; k < 8; ++k) {
          const box b = group_box(&one[group_level_offset(leaves, l) + g], k);
          if (8 * g + k < int(below.size()))
            REQUIRE(std::memcmp(&b, &below[8 * g + k], sizeof b) == 0);
          else
            REQUIRE(b.lo[0] > b.hi[0]);
        }
        here.push_back(below[8 * g]);
        for (int k = 1; k < 8 && 8 * g + k < int(below.size()); ++k)
          here.back() = box_union(here.back(), below[8 * g + k]);
      }
      below = here;
    }
  }
  CHECK(group_root_level(16777216) == 7);
  CHECK(group_level_size(16777217, group_root_level(16777217)) == 2);
  CHECK(group_tree_size(2000000000) < 2000000000 / 6);
}

TEST_CASE("a walk meets every group, and every leaf, that overlaps once and in order, from any group on", "[tree]")
{
  std::mt19937 random(3);
  for (int leaves : {1, 8, 9, 64, 65, 700, 4097}) {
    std::uniform_real_distribution<float> place(0, 10), size(0, 3);
    std::vector<box> vertex_box(2 * leaves);
    std::vector<edge_nodes> leaf(leaves);
    for (box &b : vertex_box)
      for (int k = 0; k < 3; ++k) {
        b.lo[k] = place(random);
        b.hi[k] = b.lo[k] + 0.1f;
      }
    for (int i = 0; i < leaves; ++i) leaf[i] = {{2 * i, 2 * i + 1}};
    std::vector<bvh8_node> tree(group_tree_size(leaves));
    make_groups(leaves, leaf.data(), vertex_box, tree.data());
    make_levels(leaves, true, tree.data());
    const int groups = group_level_size(leaves, 0);
    for (int trial = 0; trial < 60; ++trial) {
      box b;
      for (int k = 0; k < 3; ++k) {
        b.lo[k] = place(random);
        b.hi[k] = b.lo[k] + (trial == 0 ? 20 : size(random));
        if (trial == 0) b.lo[k] = -1;
      }
      const int first = trial % 2 ? std::uniform_int_distribution<int>(0, groups - 1)(random) : 0;
      std::vector<int> expected, met;
      for (int g = first; g < groups; ++g)
        if (box_overlap(b, group_union(&tree[g]))) expected.push_back(g);
      group_walk w = trial % 2 ? groups_overlapping_from(first, leaves, tree.data(), b)
                               : groups_overlapping(leaves, tree.data(), b);
      for (int g = next_group(&w, leaves, tree.data(), b); g >= 0; g = next_group(&w, leaves, tree.data(), b))
        met.push_back(g);
      REQUIRE(met == expected);
      if (trial == 0) REQUIRE(int(met.size()) == groups);
      expected.clear();
      met.clear();
      for (int i = GROUP * first; i < leaves; ++i)
        if (box_overlap(b, group_box(&tree[i / GROUP], i % GROUP))) expected.push_back(i);
      w = trial % 2 ? groups_overlapping_from(first, leaves, tree.data(), b)
                    : groups_overlapping(leaves, tree.data(), b);
      for (int i = walk_leaves(&w, leaves, tree.data(), b); i != WALK_END; i = walk_leaves(&w, leaves, tree.data(), b))
        if (i != WALK_ON) met.push_back(i);
      REQUIRE(met == expected);
    }
  }
}

TEST_CASE("floats are rounded outward", "[tree]")
{
  std::mt19937_64 engine(31);
  std::uniform_real_distribution<double> exponent(-45, 30), mantissa(-1, 1);
  for (int i = 0; i < 100000; ++i) {
    const double x = i < 3 ? (i - 1) * 1e-320 : mantissa(engine) * std::pow(10.0, exponent(engine));
    REQUIRE(double(float_below(x)) <= x);
    REQUIRE(double(float_above(x)) >= x);
    REQUIRE(double(float_above(x)) - double(float_below(x)) <= 8e-7 * std::fabs(x) + 2.1e-30);
  }
}

TEST_CASE("the trees' candidates are those of brute force", "[tree]")
{
  for (const double offset : {0.0, 1e6})
    for (const int n : {1, 2, 5, 14})
      for (const int self : {0, 1}) {
        const Scene s = make_scene(unsigned(n), n, 0.5, offset);
        const Found exact = brute_force(s, self, 0), wide = brute_force(s, self, 1e-6);
        CAPTURE(offset, n, self, exact.vertex_face.size(), exact.edge_edge.size());
        Found reference;
        for (const auto &[pools, pool_blocks] : {std::array{1, 0}, {1, 9}, {3, 7}, {64, 400}})
          for (const int batch : {1, 2, 8}) {
            const Found found = query(s, self, pools, pool_blocks, batch, batch == 2);
            if (pool_blocks == 0 && batch == 1) {
              reference = found;
              const Pairs vf = sorted(found.vertex_face), ee = sorted(found.edge_edge);
              CHECK(std::adjacent_find(vf.begin(), vf.end()) == vf.end());  // each once
              CHECK(std::adjacent_find(ee.begin(), ee.end()) == ee.end());
              CHECK(contains(vf, exact.vertex_face));  // none missed
              CHECK(contains(ee, exact.edge_edge));
              CHECK(contains(wide.vertex_face, vf));  // none except by rounding
              CHECK(contains(wide.edge_edge, ee));
            }
            REQUIRE(found.vertex_face == reference.vertex_face);
            REQUIRE(found.edge_edge == reference.edge_edge);
          }
        for (const int part : {1, 3, 8})
          REQUIRE(query(s, self, 3, 7, 1, false, part).vertex_face == reference.vertex_face);
        for (const auto &[part, pool_blocks] : {std::array{1 << 20, 0}, {1 << 20, 400}, {3, 7}}) {
          const Found copied = query(s, self, 3, pool_blocks, 1, false, part, 1, false, true);
          REQUIRE(copied.vertex_face == reference.vertex_face);
          REQUIRE(copied.edge_edge == reference.edge_edge);
          const Found shared = query(s, self, 3, pool_blocks, 1, false, part, GROUP);
          REQUIRE(shared.vertex_face == reference.vertex_face);
          REQUIRE(shared.edge_edge == reference.edge_edge);
        }
        if (n == 14) CHECK(exact.edge_edge.size() > 1000);
      }
}

TEST_CASE("shares of a walk, and a team for each, find in a tree of several levels what one walk does", "[tree]")
{
  const Scene s = make_scene(7, 50, 0.5, 0);
  REQUIRE(group_root_level(int(s.face.size())) > 3);
  const Found one = query(s, 1, 3, 4000, 1, false);
  REQUIRE(one.edge_edge.size() > 10000);
  const Found shared = query(s, 1, 3, 4000, 1, false, 1 << 20, GROUP);
  CHECK(shared.vertex_face == one.vertex_face);
  CHECK(shared.edge_edge == one.edge_edge);
  const Found by_item = query(s, 1, 3, 4000, BY_ITEM, false);
  CHECK(by_item.vertex_face == one.vertex_face);
  CHECK(by_item.edge_edge == one.edge_edge);
}

TEST_CASE("everything in one point: every pair, and no hang", "[tree]")
{
  Scene s = make_scene(1, 4, 0.5, 0);
  for (auto &x : s.position) x = dvec3_make(3, 3, 3);
  s.target = s.position;
  const Found exact = brute_force(s, 1, 0);
  for (const int batch : {8, BY_ITEM, QUERY_TEAM}) {
    const Found found = query(s, 1, 3, 7, batch, true);
    CHECK(sorted(found.vertex_face) == exact.vertex_face);
    CHECK(sorted(found.edge_edge) == exact.edge_edge);
  }
}

TEST_CASE("teams copy long chains of hits, and leave longer ones to a single work-item", "[tree]")
{
  Scene s = make_scene(1, 18, 0.5, 0);
  for (auto &x : s.position) x = dvec3_make(3, 3, 3);
  s.target = s.position;
  const Found one = query(s, 1, 3, 60000, 1, false), copied = query(s, 1, 3, 60000, 1, false, 1 << 20, 1, false, true);
  REQUIRE(one.vertex_face.size() / s.position.size() > COPIED_HITS / 2);  // of a vertex: chains of many blocks
  REQUIRE(one.edge_edge.size() / s.edge.size() > COPIED_HITS / 2);
  CHECK(copied.vertex_face == one.vertex_face);
  CHECK(copied.edge_edge == one.edge_edge);
}
