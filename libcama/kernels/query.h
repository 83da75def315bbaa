/* SPDX-License-Identifier: Apache-2.0 */
/* Candidate pairs from the trees by count, scan, fill: vertices against the tree of faces, edges against the tree of edges, so every
   pair of features arises exactly once and no representative triangles or orphan sets are needed. The count pass keeps each item's first
   `slots` hits in slot[k n + i]; the fill pass walks the tree again only for items with more. Vertices are numbered cloth first:
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

/* Item i is vertex vertex_order[i]; count[i]: its candidate faces. */
KERNEL query_vertex_face_count(int n, GLOBAL const int *vertex_order, GLOBAL const box *vertex_box, int leaf_count,
                               GLOBAL const int *face_order, GLOBAL const box *node_box, GLOBAL const face_nodes *face,
                               int cloth_vertex_count, int self, int slots, GLOBAL int *slot, GLOBAL int *count)
{
  FOR_EACH_UNEVEN(i, n) {
    int v = vertex_order[i], found = 0;
    box b = vertex_box[v];
    tree_node node = next_candidate_face(tree_root(leaf_count), v, b, leaf_count, face_order, node_box, face, cloth_vertex_count, self);
    while (node.level == 0) {
      if (found < slots) slot[found * n + i] = face_order[node.index];
      ++found;
      node = next_candidate_face(tree_next(node), v, b, leaf_count, face_order, node_box, face, cloth_vertex_count, self);
    }
    count[i] = found;
  }
}

/* candidate[offset[i] ..]: (vertex, face); offset is the exclusive sum of count. */
KERNEL query_vertex_face_fill(int n, GLOBAL const int *vertex_order, GLOBAL const box *vertex_box, int leaf_count,
                              GLOBAL const int *face_order, GLOBAL const box *node_box, GLOBAL const face_nodes *face,
                              int cloth_vertex_count, int self, int slots, GLOBAL const int *slot, GLOBAL const int *count,
                              GLOBAL const int *offset, GLOBAL pair *candidate)
{
  FOR_EACH_UNEVEN(i, n) {
    int v = vertex_order[i], at = offset[i], found = count[i];
    pair p;
    p.a = v;
    if (found <= slots) {
      for (int k = 0; k < found; ++k) { p.b = slot[k * n + i]; candidate[at + k] = p; }
    } else {
      box b = vertex_box[v];
      tree_node node = next_candidate_face(tree_root(leaf_count), v, b, leaf_count, face_order, node_box, face, cloth_vertex_count, self);
      while (node.level == 0) {
        p.b = face_order[node.index];
        candidate[at++] = p;
        node = next_candidate_face(tree_next(node), v, b, leaf_count, face_order, node_box, face, cloth_vertex_count, self);
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

/* Item i is the sorted leaf i, edge edge_order[i]; n is the leaf count. */
KERNEL query_edge_edge_count(int n, GLOBAL const int *edge_order, GLOBAL const box *node_box, GLOBAL const edge_nodes *edge,
                             int cloth_vertex_count, int self, int slots, GLOBAL int *slot, GLOBAL int *count)
{
  FOR_EACH_UNEVEN(i, n) {
    edge_nodes e = edge[edge_order[i]];
    box b = node_box[i];
    int found = 0;
    tree_node node = next_candidate_edge(tree_after_leaf(i), e, b, n, edge_order, node_box, edge, cloth_vertex_count, self);
    while (node.level == 0) {
      if (found < slots) slot[found * n + i] = edge_order[node.index];
      ++found;
      node = next_candidate_edge(tree_next(node), e, b, n, edge_order, node_box, edge, cloth_vertex_count, self);
    }
    count[i] = found;
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

KERNEL query_edge_edge_fill(int n, GLOBAL const int *edge_order, GLOBAL const box *node_box, GLOBAL const edge_nodes *edge,
                            int cloth_vertex_count, int self, int slots, GLOBAL const int *slot, GLOBAL const int *count,
                            GLOBAL const int *offset, GLOBAL pair *candidate)
{
  FOR_EACH_UNEVEN(i, n) {
    int own = edge_order[i], at = offset[i], found = count[i];
    if (found <= slots) {
      for (int k = 0; k < found; ++k) candidate[at + k] = ordered_pair(own, slot[k * n + i]);
    } else {
      edge_nodes e = edge[own];
      box b = node_box[i];
      tree_node node = next_candidate_edge(tree_after_leaf(i), e, b, n, edge_order, node_box, edge, cloth_vertex_count, self);
      while (node.level == 0) {
        candidate[at++] = ordered_pair(own, edge_order[node.index]);
        node = next_candidate_edge(tree_next(node), e, b, n, edge_order, node_box, edge, cloth_vertex_count, self);
      }
    }
  }
}
