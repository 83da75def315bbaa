/* SPDX-License-Identifier: Apache-2.0 */
/* Implicit bounding volume hierarchy (after Chitalu, Dubach, Komura: Binary Ostensibly-Implicit Trees, 2020): primitives sorted by Morton
   code are the leaves, level 0; node i of level l covers the sorted leaves [i << l, (i + 1) << l). No pointers, no atomics. Boxes of all
   levels lie one after the other in `node_box`; level l has tree_level_size nodes, the first at tree_level_offset. */

typedef struct { int level, index; } tree_node;

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

/* Boxes to allocate. */
DEVICE int tree_size(int leaf_count) { return tree_level_offset(leaf_count, tree_root_level(leaf_count)) + 1; }

/* First child; node.level must be > 0. */
DEVICE tree_node tree_child(tree_node node) { --node.level; node.index *= 2; return node; }

/* The node after this one's subtree in depth-first order: the next right sibling of it or of an ancestor. There is none, and the
   traversal is over, when tree_inside is 0. From leaf i it leads over exactly the leaves > i. */
DEVICE tree_node tree_next(tree_node node)
{
  ++node.index;
  while ((node.index & 1) == 0) { ++node.level; node.index >>= 1; }
  return node;
}
DEVICE int tree_inside(tree_node node, int leaf_count) { return node.level < 31 && node.index <= ((leaf_count - 1) >> node.level); }

/* Leaf boxes in sorted order. */
KERNEL tree_leaves(int n, GLOBAL const int *order, GLOBAL const box *primitive_box, GLOBAL box *node_box)
{
  FOR_EACH(i, n) node_box[i] = primitive_box[order[i]];
}

/* Item i builds what lies below and at node (level, i), `steps` levels of it: levels level - steps + 1 .. level, with the levels below
   those present. n = tree_level_size(leaf_count, level). A few levels a launch, and the small top in one, save launches. */
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
