/* SPDX-License-Identifier: Apache-2.0 */
/* Implicit bounding volume hierarchy (after Chitalu, Dubach, Komura: Binary Ostensibly-Implicit Trees, 2020):
   primitives sorted by Morton code are the leaves, level 0; node i of level l covers the sorted leaves [i << l, (i + 1)
   << l). No pointers, no atomics. The boxes of all levels lie one after the other in `node_box`; level l has
   tree_level_size nodes, the first at tree_level_offset. The variant with eight children to a node, further down,
   serves the search for candidates; the binary tree serves fronts and audits. */
#ifndef CAMA_KERNELS_COLLISION_TREE_H
#define CAMA_KERNELS_COLLISION_TREE_H
#include "../dialect/lang.h"
#include "bounds.h"

typedef struct {
  int level, index;
} tree_node;

DEVICE int count_bits(int v)
{
  unsigned int x = (unsigned int)v;
  x = x - ((x >> 1) & 0x55555555u);
  x = (x & 0x33333333u) + ((x >> 2) & 0x33333333u);
  x = (x + (x >> 4)) & 0x0f0f0f0fu;
  return (int)((x * 0x01010101u) >> 24);
}

/* Nodes of a level: leaf_count / 2^level, rounded up. leaf_count >= 1. */
DEVICE int tree_level_size(int leaf_count, int level) { return ((leaf_count - 1) >> level) + 1; }

/* Sum of the sizes of the levels below; from sum_k floor(m / 2^k) = 2 m - bits(m). */
DEVICE int tree_level_offset(int leaf_count, int level)
{
  int m = leaf_count - 1, q = m >> level;
  return level + 2 * (m - q) - count_bits(m) + count_bits(q);
}

/* Level of the root. */
DEVICE int tree_root_level(int leaf_count)
{
  int level = 0;
  while (((leaf_count - 1) >> level) > 0) ++level;
  return level;
}

/* Number of boxes to allocate. */
DEVICE int tree_size(int leaf_count) { return tree_level_offset(leaf_count, tree_root_level(leaf_count)) + 1; }

/* First child; node.level must be > 0. */
DEVICE tree_node tree_child(tree_node node)
{
  --node.level;
  node.index *= 2;
  return node;
}

/* The node after this one's subtree in depth-first order: the next right sibling of it or of an ancestor. There is
   none, and the traversal is over, when tree_inside is 0. From leaf i it leads over exactly the leaves > i. */
DEVICE tree_node tree_next(tree_node node)
{
  ++node.index;
  while ((node.index & 1) == 0) {
    ++node.level;
    node.index >>= 1;
  }
  return node;
}
DEVICE int tree_inside(tree_node node, int leaf_count)
{
  return node.level < 31 && node.index <= ((leaf_count - 1) >> node.level);
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

/* Leaf boxes in sorted order. */
KERNEL tree_leaves(int n, GLOBAL const int *order, GLOBAL const box *primitive_box, GLOBAL box *node_box)
{
  FOR_EACH(i, n) node_box[i] = primitive_box[order[i]];
}

/* Item i builds node (level, i) and the nodes below it, `steps` levels in all: level - steps + 1 .. level; the levels
   below those are present. n = tree_level_size(leaf_count, level). Several levels a launch, and the small top in one,
   save launches. */
KERNEL tree_levels(int n, int leaf_count, int level, int steps, GLOBAL box *node_box)
{
  FOR_EACH(i, n) {
    for (int l = level - steps + 1; l <= level; ++l) {
      int below = tree_level_offset(leaf_count, l - 1), here = tree_level_offset(leaf_count, l);
      int below_size = tree_level_size(leaf_count, l - 1), first = i << (level - l);
      int last = min_int((i + 1) << (level - l), tree_level_size(leaf_count, l));
      for (int k = first; k < last; ++k) {
        box b = node_box[below + 2 * k];
        if (2 * k + 1 < below_size) b = box_union(b, node_box[below + 2 * k + 1]);
        node_box[here + k] = b;
      }
    }
  }
}

/* The tree with eight children to a node. The boxes of eight sorted leaves are a group of level 0; the boxes of eight
   groups of level l - 1 are a group of level l. All groups lie one after the other, lower levels first. Places without
   a leaf have boxes that overlap nothing. The root level is at least 1 and at most 7: beyond 8^8 leaves it has several
   groups. */
#define GROUP 8
typedef struct ALIGNED(16) {
  float lo[3][GROUP], hi[3][GROUP];
} bvh8_node;

DEVICE int group_level_size(int leaf_count, int level) { return ((leaf_count - 1) >> (3 * level + 3)) + 1; }
DEVICE int group_root_level(int leaf_count)
{
  int level = 1;
  while (level < 7 && ((leaf_count - 1) >> (3 * level + 3)) > 0) ++level;
  return level;
}
DEVICE int group_level_offset(int leaf_count, int level)
{
  int offset = 0;
  for (int l = 0; l < level; ++l) offset += group_level_size(leaf_count, l);
  return offset;
}
/* Number of groups to allocate. */
DEVICE int group_tree_size(int leaf_count) { return group_level_offset(leaf_count, group_root_level(leaf_count) + 1); }

/* Bit k is 1 where box k of the group overlaps b. */
DEVICE int group_overlap(GLOBAL const bvh8_node *g, box b)
{
  int hit[GROUP];
  SIMD
  for (int k = 0; k < GROUP; ++k)
    hit[k] = (b.lo[0] <= g->hi[0][k]) & (g->lo[0][k] <= b.hi[0]) & (b.lo[1] <= g->hi[1][k]) & (g->lo[1][k] <= b.hi[1]) &
             (b.lo[2] <= g->hi[2][k]) & (g->lo[2][k] <= b.hi[2]);
  return eight_bits(hit);
}

DEVICE box group_box(GLOBAL const bvh8_node *g, int k)
{
  box b;
  for (int c = 0; c < 3; ++c) {
    b.lo[c] = g->lo[c][k];
    b.hi[c] = g->hi[c][k];
  }
  return b;
}
DEVICE void set_group_box(GLOBAL bvh8_node *g, int k, box b)
{
  for (int c = 0; c < 3; ++c) {
    g->lo[c][k] = b.lo[c];
    g->hi[c][k] = b.hi[c];
  }
}
/* Overlaps nothing, not even itself. */
DEVICE box empty_box(void)
{
  box b;
  for (int c = 0; c < 3; ++c) {
    b.lo[c] = 3e38f;
    b.hi[c] = -3e38f;
  }
  return b;
}
DEVICE box group_union(GLOBAL const bvh8_node *g)
{
  const bvh8_node own = *g; /* by few wide loads */
  box b;
  for (int c = 0; c < 3; ++c) {
    b.lo[c] = own.lo[c][0];
    b.hi[c] = own.hi[c][0];
    for (int k = 1; k < GROUP; ++k) {
      if (own.lo[c][k] < b.lo[c]) b.lo[c] = own.lo[c][k];
      if (own.hi[c][k] > b.hi[c]) b.hi[c] = own.hi[c][k];
    }
  }
  return b;
}

/* A walk, in order, over the groups of level 0 whose box overlaps a given one. Byte l of `open`: the children at level
   l still to be visited. */
typedef struct {
  key64 open;
  int level, root, group, offset;
  int kept; /* children of groups of level 1 that walk_leaves goes to */
} group_walk;

DEVICE group_walk groups_overlapping(int leaf_count, GLOBAL const bvh8_node *tree, box b)
{
  group_walk w;
  w.level = w.root = group_root_level(leaf_count);
  w.group = 0;
  w.kept = 0xff;
  w.offset = group_level_offset(leaf_count, w.level);
  w.open = (key64)group_overlap(tree + w.offset, b) << (8 * w.level);
  return w;
}

/* The same from group `first` of level 0 on. */
DEVICE group_walk groups_overlapping_from(int first, int leaf_count, GLOBAL const bvh8_node *tree, box b)
{
  group_walk w;
  int offset = group_level_size(leaf_count, 0);
  w.level = 1;
  w.root = group_root_level(leaf_count);
  w.group = first >> 3;
  w.kept = 0xff;
  w.offset = offset;
  w.open = 0;
  for (int l = 1; l <= w.root; ++l) {
    int later = (l == 1 ? 0xff : 0xfe) << ((first >> (3 * l - 3)) & 7);
    w.open |= (key64)(group_overlap(tree + offset + (first >> (3 * l)), b) & later & 0xff) << (8 * l);
    offset += group_level_size(leaf_count, l);
  }
  return w;
}

/* The next group, -1 after the last. b: the box that the walk was started with. */
DEVICE int next_group(group_walk *w, int leaf_count, GLOBAL const bvh8_node *tree, box b)
{
  for (;;) {
    int mask = (int)(w->open >> (8 * w->level)) & 0xff;
    if (mask) {
      int k = lowest_bit((key64)mask);
      w->open &= ~((key64)1 << (8 * w->level + k));
      if (w->level == 1) return GROUP * w->group + k;
      w->group = GROUP * w->group + k;
      --w->level;
      w->offset -= group_level_size(leaf_count, w->level);
    } else if (w->level < w->root) {
      w->offset += group_level_size(leaf_count, w->level);
      ++w->level;
      w->group >>= 3;
      continue;
    } else if (++w->group >= group_level_size(leaf_count, w->root)) {
      return -1;
    }
    w->open |= (key64)group_overlap(tree + w->offset + w->group, b) << (8 * w->level);
  }
}

/* The box of group g, which next_group has just returned. */
DEVICE box box_of_group(group_walk w, int g, GLOBAL const bvh8_node *tree)
{
  return group_box(tree + w.offset + (g >> 3), g & 7);
}

/* A walk by nodes, for those who find out for themselves which children are met. next_node returns 1 if node `group` of
   `level`, whose boxes begin at tree[offset + group], is next, 0 after the last; but for nodes of level 0 its caller
   adds to `open` the children to be visited. From group `first` of level 0 on `open` is empty at first, and the caller
   fills it for all levels up to the root. */
DEVICE group_walk nodes_from_root(int leaf_count)
{
  group_walk w;
  w.level = w.root = group_root_level(leaf_count);
  w.group = -1;
  w.kept = 0xff;
  w.offset = group_level_offset(leaf_count, w.level);
  w.open = 0;
  return w;
}
DEVICE group_walk nodes_from(int first, int leaf_count)
{
  group_walk w = nodes_from_root(leaf_count);
  w.level = 1;
  w.group = first >> 3;
  w.offset = group_level_size(leaf_count, 0);
  return w;
}
DEVICE int next_node(group_walk *w, int leaf_count)
{
  int bit = w->open ? lowest_bit(w->open) : 8 * w->root;
  for (; w->level < bit >> 3; ++w->level) {
    w->offset += group_level_size(leaf_count, w->level);
    w->group >>= 3;
  }
  if (!w->open) return ++w->group < group_level_size(leaf_count, w->root);
  w->open &= w->open - 1;
  w->group = GROUP * w->group + (bit & 7);
  --w->level;
  w->offset -= group_level_size(leaf_count, w->level);
  return 1;
}

/* Makes a walk that has just begun share k of `shares`, 1 or GROUP, which together meet what the walk would: it goes to
   child k alone of every group of level 1. For boxes so few that each may have GROUP items. */
DEVICE void take_share(group_walk *w, int k, int shares)
{
  if (shares == 1) return;
  w->kept = 1 << k;
  w->open &= ~((key64)(0xff & ~w->kept) << 8);
}

/* The same walk one iteration at a time, down to the leaves: byte 0 of `open` is that of leaves. Every iteration
   executes the same operations, so that work-items that walk in lockstep stay together. Returns the next leaf that
   overlaps, in order, WALK_ON if this iteration found none, or WALK_END after the last. */
#define WALK_ON -1
#define WALK_END -2
DEVICE int walk_leaves(group_walk *w, int leaf_count, GLOBAL const bvh8_node *tree, box b)
{
  int bit = w->open ? lowest_bit(w->open) : 8 * w->root, leaf = WALK_ON;
  for (; w->level < bit >> 3; ++w->level) {
    w->offset += group_level_size(leaf_count, w->level);
    w->group >>= 3;
  }
  if (w->open) {
    int child = GROUP * w->group + (bit & 7);
    w->open &= w->open - 1;
    if (w->level == 0) {
      leaf = child;
    } else {
      w->group = child;
      --w->level;
      w->offset -= group_level_size(leaf_count, w->level);
    }
  } else if (++w->group >= group_level_size(leaf_count, w->root)) {
    leaf = WALK_END;
  }
  if (leaf == WALK_ON)
    w->open |= (key64)(group_overlap(tree + w->offset + w->group, b) & (w->level == 1 ? w->kept : 0xff))
               << (8 * w->level);
  return leaf;
}

/* Groups of level 0. leaf_face, leaf_edge: nodes of the sorted leaves. changed: [vertices] flags, null for all; groups
   without a changed vertex stay as they are. n = group_level_size(leaf_count, 0). */
KERNEL face_groups(int n, int leaf_count, GLOBAL const face_nodes *leaf_face, GLOBAL const box *vertex_box,
                   GLOBAL const int *changed, GLOBAL bvh8_node *tree)
{
  FOR_EACH(i, n) {
    const int leaves = min_int(leaf_count - GROUP * i, GROUP);
    int any = !changed;
    for (int k = 0; !any && k < leaves; ++k) {
      const face_nodes f = leaf_face[GROUP * i + k];
      any = changed[f.node[0]] | changed[f.node[1]] | changed[f.node[2]];
    }
    for (int k = 0; any && k < GROUP; ++k)
      set_group_box(tree + i, k, k < leaves ? box_of_face(leaf_face[GROUP * i + k], vertex_box) : empty_box());
  }
}
KERNEL edge_groups(int n, int leaf_count, GLOBAL const edge_nodes *leaf_edge, GLOBAL const box *vertex_box,
                   GLOBAL const int *changed, GLOBAL bvh8_node *tree)
{
  FOR_EACH(i, n) {
    const int leaves = min_int(leaf_count - GROUP * i, GROUP);
    int any = !changed;
    for (int k = 0; !any && k < leaves; ++k) {
      const edge_nodes e = leaf_edge[GROUP * i + k];
      any = changed[e.node[0]] | changed[e.node[1]];
    }
    for (int k = 0; any && k < GROUP; ++k)
      set_group_box(tree + i, k, k < leaves ? box_of_edge(leaf_edge[GROUP * i + k], vertex_box) : empty_box());
  }
}

/* Boxes of level `level`, and with both = 1 of the level below it, which is at least 1, from the groups beneath. Team t
   makes group t of the level, n = group_level_size(leaf_count, level). */
#define GROUP_TEAM (GROUP * GROUP)
KERNEL group_levels(int n, int leaf_count, int level, int both, GLOBAL bvh8_node *tree)
{
  TEAM_LOCAL(box, own, GROUP_TEAM);
  int here = group_level_offset(leaf_count, level), below = group_level_offset(leaf_count, level - 1),
      below_size = group_level_size(leaf_count, level - 1);
  FOR_EACH_TEAM(t, n) {
    if (both) {
      int beneath_size = group_level_size(leaf_count, level - 2), beneath = below - beneath_size;
      TEAM_BARRIER;
      TEAM_FOR(l, GROUP_TEAM) {
        int child = GROUP_TEAM * t + l;
        own[l] = child < beneath_size ? group_union(tree + beneath + child) : empty_box();
        if (child / GROUP < below_size) set_group_box(tree + below + child / GROUP, l % GROUP, own[l]);
      }
      TEAM_BARRIER;
    }
    TEAM_FOR(k, GROUP) {
      int child = GROUP * t + k;
      box b = empty_box();
      if (child < below_size) b = both ? own[GROUP * k] : group_union(tree + below + child);
      if (both && child < below_size)
        for (int l = 1; l < GROUP; ++l) b = box_union(b, own[GROUP * k + l]);
      set_group_box(tree + here + t, k, b);
    }
  }
}

/* Nodes of the faces or edges in the order of the leaves. */
KERNEL order_faces(int n, GLOBAL const int *order, GLOBAL const face_nodes *face, GLOBAL face_nodes *leaf_face)
{
  FOR_EACH(i, n) leaf_face[i] = face[order[i]];
}
KERNEL order_edges(int n, GLOBAL const int *order, GLOBAL const edge_nodes *edge, GLOBAL edge_nodes *leaf_edge)
{
  FOR_EACH(i, n) leaf_edge[i] = edge[order[i]];
}

#endif
