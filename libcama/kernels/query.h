/* SPDX-License-Identifier: Apache-2.0 */
/* Candidate pairs from the trees by count, scan, fill: vertices against the tree of faces, edges against the tree of edges, so every
   pair of features arises exactly once and no representative triangles or orphan sets are needed. The count pass keeps each item's first
   `slots` hits in slot[slots i ..]; the fill pass walks the tree again only for items with more. Vertices are numbered cloth first:
   those from cloth_vertex_count on are obstacles, whose pairs among themselves are left out. self = 0 leaves out cloth against cloth. */

typedef struct { int a, b; } pair;

/* 1 if features whose first vertices are a and b are to be tested against each other. */
DEVICE int wanted_pair(int a, int b, int cloth_vertex_count, int self)
{
  int obstacle_a = a >= cloth_vertex_count, obstacle_b = b >= cloth_vertex_count;
  return !(obstacle_a && obstacle_b) && (self || obstacle_a || obstacle_b);
}

/* Root of the tree. */
DEVICE tree_node tree_root(int leaf_count)
{
  tree_node node;
  node.level = tree_root_level(leaf_count);
  node.index = 0;
  return node;
}

/* Next leaf at or after `node` whose box overlaps b, in depth-first order; its level is -1 when there is none. */
DEVICE tree_node tree_find(tree_node node, int leaf_count, GLOBAL const box *node_box, box b)
{
  int last = leaf_count - 1, offset = tree_level_offset(leaf_count, node.level); /* follows node.level from here on */
  while (tree_inside(node, leaf_count)) {
    if (box_overlap(b, node_box[offset + node.index])) {
      if (node.level == 0) return node;
      node = tree_child(node);
      offset -= (last >> node.level) + 1;
    } else {
      int level = node.level;
      node = tree_next(node);
      for (; level < node.level; ++level) offset += (last >> level) + 1;
    }
  }
  node.level = -1;
  return node;
}

/* Next face at or after `node` that is a candidate of vertex v. */
DEVICE tree_node next_candidate_face(tree_node node, int v, box b, int leaf_count, GLOBAL const int *face_order, GLOBAL const box *node_box,
                                     GLOBAL const face_nodes *face, int cloth_vertex_count, int self)
{
  for (;;) {
    face_nodes f;
    node = tree_find(node, leaf_count, node_box, b);
    if (node.level < 0) return node;
    f = face[face_order[node.index]];
    if (f.node[0] != v && f.node[1] != v && f.node[2] != v && wanted_pair(v, f.node[0], cloth_vertex_count, self)) return node;
    node = tree_next(node);
  }
}

/* A search that follows another one for motion that has changed: boxes of changed vertices have grown, box_before has the earlier ones.
   A pair is fresh if it overlaps now and did not before; pairs of the earlier search stay as they are. */
DEVICE int fresh_vertex_face(int v, face_nodes f, GLOBAL const box *box_before)
{
  box b = box_union(box_union(box_before[f.node[0]], box_before[f.node[1]]), box_before[f.node[2]]);
  return !box_overlap(box_before[v], b);
}
DEVICE int fresh_edge_edge(edge_nodes e, edge_nodes f, GLOBAL const box *box_before)
{
  return !box_overlap(box_union(box_before[e.node[0]], box_before[e.node[1]]), box_union(box_before[f.node[0]], box_before[f.node[1]]));
}

#define QUERY_ALL 0       /* every pair */
#define QUERY_CHANGED 1   /* fresh pairs; items are the changed vertices, or edges */
#define QUERY_UNCHANGED 2 /* fresh pairs; items are all vertices, changed ones are passed over; the tree holds changed faces */

/* Next face at or after `node` that is a candidate of vertex v and, but for QUERY_ALL, a fresh one. */
DEVICE tree_node next_wanted_face(tree_node node, int v, box b, int leaf_count, GLOBAL const int *face_order, GLOBAL const box *node_box,
                                  GLOBAL const face_nodes *face, int cloth_vertex_count, int self, int mode, GLOBAL const box *box_before)
{
  for (;;) {
    node = next_candidate_face(node, v, b, leaf_count, face_order, node_box, face, cloth_vertex_count, self);
    if (node.level < 0 || mode == QUERY_ALL || fresh_vertex_face(v, face[face_order[node.index]], box_before)) return node;
    node = tree_next(node);
  }
}

/* Item i is vertex vertex_order[i]; count[i]: its candidate faces. mode: QUERY_*; changed and box_before, per vertex, are read unless
   it is QUERY_ALL. */
KERNEL query_vertex_face_count(int n, GLOBAL const int *vertex_order, GLOBAL const box *vertex_box, int leaf_count,
                               GLOBAL const int *face_order, GLOBAL const box *node_box, GLOBAL const face_nodes *face,
                               int cloth_vertex_count, int self, int mode, GLOBAL const int *changed, GLOBAL const box *box_before,
                               int slots, GLOBAL int *slot, GLOBAL int *count)
{
  FOR_EACH_UNEVEN(i, n) {
    int v = vertex_order[i], found = 0;
    if (mode != QUERY_UNCHANGED || !changed[v]) {
      box b = vertex_box[v];
      tree_node node = next_wanted_face(tree_root(leaf_count), v, b, leaf_count, face_order, node_box, face, cloth_vertex_count, self, mode, box_before);
      while (node.level == 0) {
        if (found < slots) slot[slots * i + found] = face_order[node.index];
        ++found;
        node = next_wanted_face(tree_next(node), v, b, leaf_count, face_order, node_box, face, cloth_vertex_count, self, mode, box_before);
      }
    }
    count[i] = found;
  }
}

/* candidate[first + offset[i] ..]: (vertex, face); offset is the exclusive sum of count. */
KERNEL query_vertex_face_fill(int n, GLOBAL const int *vertex_order, GLOBAL const box *vertex_box, int leaf_count,
                              GLOBAL const int *face_order, GLOBAL const box *node_box, GLOBAL const face_nodes *face,
                              int cloth_vertex_count, int self, int mode, GLOBAL const box *box_before, int slots,
                              GLOBAL const int *slot, GLOBAL const int *count, GLOBAL const int *offset, int first, GLOBAL pair *candidate)
{
  FOR_EACH_UNEVEN(i, n) {
    int v = vertex_order[i], at = first + offset[i], found = count[i];
    pair p;
    p.a = v;
    if (found <= slots) {
      for (int k = 0; k < found; ++k) { p.b = slot[slots * i + k]; candidate[at + k] = p; }
    } else {
      box b = vertex_box[v];
      tree_node node = next_wanted_face(tree_root(leaf_count), v, b, leaf_count, face_order, node_box, face, cloth_vertex_count, self, mode, box_before);
      while (node.level == 0) {
        p.b = face_order[node.index];
        candidate[at++] = p;
        node = next_wanted_face(tree_next(node), v, b, leaf_count, face_order, node_box, face, cloth_vertex_count, self, mode, box_before);
      }
    }
  }
}

/* Next edge at or after `node` that is a candidate of edge e. */
DEVICE tree_node next_candidate_edge(tree_node node, edge_nodes e, box b, int leaf_count, GLOBAL const int *edge_order,
                                     GLOBAL const box *node_box, GLOBAL const edge_nodes *edge, int cloth_vertex_count, int self)
{
  for (;;) {
    edge_nodes f;
    node = tree_find(node, leaf_count, node_box, b);
    if (node.level < 0) return node;
    f = edge[edge_order[node.index]];
    if (e.node[0] != f.node[0] && e.node[0] != f.node[1] && e.node[1] != f.node[0] && e.node[1] != f.node[1] &&
        wanted_pair(e.node[0], f.node[0], cloth_vertex_count, self)) return node;
    node = tree_next(node);
  }
}

/* The leaf after sorted leaf i in depth-first order: half traversal, every pair once. */
DEVICE tree_node tree_after_leaf(int i)
{
  tree_node node;
  node.level = 0;
  node.index = i;
  return tree_next(node);
}

DEVICE int edge_changed(edge_nodes e, GLOBAL const int *changed) { return changed[e.node[0]] || changed[e.node[1]]; }

/* Where the query of leaf i begins: half traversal for QUERY_ALL; for QUERY_CHANGED at the root, since unchanged edges do not ask. */
DEVICE tree_node edge_query_start(int i, int leaf_count, int mode) { return mode == QUERY_ALL ? tree_after_leaf(i) : tree_root(leaf_count); }

/* Next edge at or after `node` that is a candidate of leaf i, edge e, and, but for QUERY_ALL, a fresh one; two changed edges meet once. */
DEVICE tree_node next_wanted_edge(tree_node node, int i, edge_nodes e, box b, int leaf_count, GLOBAL const int *edge_order,
                                  GLOBAL const box *node_box, GLOBAL const edge_nodes *edge, int cloth_vertex_count, int self, int mode,
                                  GLOBAL const int *changed, GLOBAL const box *box_before)
{
  for (;;) {
    edge_nodes f;
    node = next_candidate_edge(node, e, b, leaf_count, edge_order, node_box, edge, cloth_vertex_count, self);
    if (node.level < 0 || mode == QUERY_ALL) return node;
    f = edge[edge_order[node.index]];
    if ((node.index > i || !edge_changed(f, changed)) && fresh_edge_edge(e, f, box_before)) return node;
    node = tree_next(node);
  }
}

/* Item k is the sorted leaf leaf[k], edge edge_order[leaf[k]]. mode: QUERY_ALL, where leaf is the identity, or QUERY_CHANGED. */
KERNEL query_edge_edge_count(int n, GLOBAL const int *leaf, int leaf_count, GLOBAL const int *edge_order, GLOBAL const box *node_box,
                             GLOBAL const edge_nodes *edge, int cloth_vertex_count, int self, int mode, GLOBAL const int *changed,
                             GLOBAL const box *box_before, int slots, GLOBAL int *slot, GLOBAL int *count)
{
  FOR_EACH_UNEVEN(k, n) {
    int i = leaf[k], found = 0;
    edge_nodes e = edge[edge_order[i]];
    box b = node_box[i];
    tree_node node = next_wanted_edge(edge_query_start(i, leaf_count, mode), i, e, b, leaf_count, edge_order, node_box, edge,
                                      cloth_vertex_count, self, mode, changed, box_before);
    while (node.level == 0) {
      if (found < slots) slot[slots * k + found] = edge_order[node.index];
      ++found;
      node = next_wanted_edge(tree_next(node), i, e, b, leaf_count, edge_order, node_box, edge, cloth_vertex_count, self, mode, changed, box_before);
    }
    count[k] = found;
  }
}

/* Both edges of a pair, the lower index first. */
DEVICE pair ordered_pair(int a, int b)
{
  pair p;
  p.a = min_int(a, b);
  p.b = max_int(a, b);
  return p;
}

/* candidate[first + offset[k] ..]: (edge, edge). */
KERNEL query_edge_edge_fill(int n, GLOBAL const int *leaf, int leaf_count, GLOBAL const int *edge_order, GLOBAL const box *node_box,
                            GLOBAL const edge_nodes *edge, int cloth_vertex_count, int self, int mode, GLOBAL const int *changed,
                            GLOBAL const box *box_before, int slots, GLOBAL const int *slot, GLOBAL const int *count,
                            GLOBAL const int *offset, int first, GLOBAL pair *candidate)
{
  FOR_EACH_UNEVEN(k, n) {
    int i = leaf[k], at = first + offset[k], found = count[k], own = edge_order[i];
    if (found <= slots) {
      for (int j = 0; j < found; ++j) candidate[at + j] = ordered_pair(own, slot[slots * k + j]);
    } else {
      edge_nodes e = edge[own];
      box b = node_box[i];
      tree_node node = next_wanted_edge(edge_query_start(i, leaf_count, mode), i, e, b, leaf_count, edge_order, node_box, edge,
                                        cloth_vertex_count, self, mode, changed, box_before);
      while (node.level == 0) {
        candidate[at++] = ordered_pair(own, edge_order[node.index]);
        node = next_wanted_edge(tree_next(node), i, e, b, leaf_count, edge_order, node_box, edge, cloth_vertex_count, self, mode, changed, box_before);
      }
    }
  }
}

/* changed[i] = 1 where the motion x to y of vertex i leaves its box, which then grows to hold it with its own margin; before: a copy.
   `least`: what must be left between motion and box, m. */
KERNEL grow_boxes(int n, GLOBAL const dvec3 *x, GLOBAL const dvec3 *y, GLOBAL const double *margin, GLOBAL const dvec3 *scene_bounds,
                  double least, GLOBAL box *before, GLOBAL box *vertex_box, GLOBAL int *changed)
{
  FOR_EACH(i, n) {
    box b = vertex_box[i], needed = swept_box(x[i], y[i], least, scene_bounds[0]), all = box_union(b, needed);
    int outside = 0;
    for (int k = 0; k < 3; ++k) outside |= all.lo[k] != b.lo[k] || all.hi[k] != b.hi[k];
    before[i] = b;
    changed[i] = outside;
    if (outside) vertex_box[i] = box_union(b, swept_box(x[i], y[i], margin[i], scene_bounds[0]));
  }
}

/* 1 for the leaves whose face, or edge, has a changed vertex. */
KERNEL changed_faces(int n, GLOBAL const int *face_order, GLOBAL const face_nodes *face, GLOBAL const int *changed, GLOBAL int *flag)
{
  FOR_EACH(i, n) {
    face_nodes f = face[face_order[i]];
    flag[i] = changed[f.node[0]] || changed[f.node[1]] || changed[f.node[2]];
  }
}
KERNEL changed_edges(int n, GLOBAL const int *edge_order, GLOBAL const edge_nodes *edge, GLOBAL const int *changed, GLOBAL int *flag)
{
  FOR_EACH(i, n) flag[i] = edge_changed(edge[edge_order[i]], changed);
}

/* The flagged values, in order; place: exclusive sum of the flags. */
KERNEL keep_flagged(int n, GLOBAL const int *place, GLOBAL const int *value, GLOBAL int *kept)
{
  FOR_EACH(i, n) if (place[i + 1] > place[i]) kept[place[i]] = value[i];
}

/* 1 if `value` is in the sorted row of vertex v. */
DEVICE int row_holds(GLOBAL const int *row, GLOBAL const int *entry, int v, int value)
{
  int lo = row[v], hi = row[v + 1];
  while (lo < hi) {
    int mid = lo + (hi - lo) / 2;
    if (entry[mid] == value) return 1;
    if (entry[mid] < value) lo = mid + 1; else hi = mid;
  }
  return 0;
}

/* flag[i] = 1 if pair first + i is not exempt: no vertex of one side may pass a vertex, or the object, of the other. */
KERNEL wanted_pairs(int n, int first, int kind, int vertex_count, GLOBAL const pair *pairs, GLOBAL const face_nodes *face,
                    GLOBAL const edge_nodes *edge, GLOBAL const int *row, GLOBAL const int *entry, GLOBAL const int *object, GLOBAL int *flag)
{
  FOR_EACH(i, n) {
    pair p = pairs[first + i];
    int v[4], exempt = 0, split = kind + 1;
    if (kind == 0) {
      face_nodes f = face[p.b];
      v[0] = p.a; v[1] = f.node[0]; v[2] = f.node[1]; v[3] = f.node[2];
    } else {
      v[0] = edge[p.a].node[0]; v[1] = edge[p.a].node[1]; v[2] = edge[p.b].node[0]; v[3] = edge[p.b].node[1];
    }
    for (int a = 0; a < 4 && !exempt; ++a) {
      int other = a < split ? split : 0, last = a < split ? 4 : split;
      if (row[v[a]] == row[v[a] + 1]) continue;
      exempt = row_holds(row, entry, v[a], vertex_count + object[v[other]]);
      for (; other < last && !exempt; ++other) exempt = row_holds(row, entry, v[a], v[other]);
    }
    flag[i] = !exempt;
  }
}

/* The flagged pairs from `first` on, in order; place: exclusive sum of the flags. */
KERNEL keep_pairs(int n, int first, GLOBAL const int *place, GLOBAL const pair *pairs, GLOBAL pair *kept)
{
  FOR_EACH(i, n) if (place[i + 1] > place[i]) kept[place[i]] = pairs[first + i];
}

KERNEL copy_pairs(int n, int first, GLOBAL const pair *from, GLOBAL pair *to) { FOR_EACH(i, n) to[first + i] = from[i]; }
