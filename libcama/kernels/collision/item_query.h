/* SPDX-License-Identifier: Apache-2.0 */
/* The first pass of a search (query.h) by a team for each item: its members test the boxes of ITEM_GROUPS groups at
   once, and then the leaves that these meet, so that a long walk has few steps. For updates, whose items are few and
   meet many leaves. What an item finds, and in which order, is what it finds by itself. */
#ifndef CAMA_KERNELS_COLLISION_ITEM_QUERY_H
#define CAMA_KERNELS_COLLISION_ITEM_QUERY_H
#include "../dialect/lang.h"
#include "bounds.h"
#include "hits.h"
#include "query.h"
#include "tree.h"

#define ITEM_TEAM 64
#define ITEM_GROUPS 8                    /* whose boxes are tested at once */
#define ITEM_BOXES (ITEM_GROUPS * GROUP) /* fewer than 128 */
#define ITEM_WORDS 2                     /* of a mask, which has a bit for each */
#define ITEM_LISTS 9                     /* of leaves, and of groups of every level */
#define ITEM_MASKS 3 /* of this turn, of the next, and of the last, which a member may still read */

/* A walk of a team. List 0 has leaves, list l + 1 groups of level l, in order, all of them to be visited before those
   of higher lists. They are at the end of the list's ITEM_BOXES places; `left`: their numbers, in seven bits each. */
typedef struct {
  key64 left;
  int turn, root_group, root;
} item_walk;

DEVICE int places_left(key64 left, int list) { return (int)(left >> (7 * list)) & 127; }

DEVICE int mask_has(LOCAL const int *mask, int l) { return (mask[l >> 5] >> (l & 31)) & 1; }
/* Numbers of one bits: those before bit l, and all. */
DEVICE int bits_before(LOCAL const int *mask, int l)
{
  int before = count_bits(mask[l >> 5] & (int)((1u << (l & 31)) - 1u));
  for (int word = 0; word < l >> 5; ++word) before += count_bits(mask[word]);
  return before;
}
DEVICE int mask_size(LOCAL const int *mask)
{
  int size = 0;
  for (int word = 0; word < ITEM_WORDS; ++word) size += count_bits(mask[word]);
  return size;
}
DEVICE_TEAM void set_mask_bit(LOCAL int *mask, int l) { local_or_int(mask + (l >> 5), (int)(1u << (l & 31))); }
/* The mask of a turn. All are 0 at first; the members clear that of the next turn before a barrier. */
DEVICE LOCAL int *turn_mask(LOCAL int *mask, int turn) { return mask + ITEM_WORDS * (turn % ITEM_MASKS); }
DEVICE_TEAM void clear_mask(LOCAL int *mask)
{
  for (int word = 0; word < ITEM_WORDS; ++word) mask[word] = 0;
}

/* A walk of leaves behind leaf `first`, -1 for all of them, that overlap b. */
DEVICE_TEAM item_walk walk_for_item(int first, int leaf_count, GLOBAL const bvh8_node *tree, box b, LOCAL int *list,
                                    LOCAL int *mask)
{
  item_walk w;
  w.left = 0;
  w.turn = 0;
  w.root = group_root_level(leaf_count);
  w.root_group = first < 0 ? -1 : first >> (3 * w.root + 3);
  TEAM_BARRIER;
  TEAM_FOR(l, ITEM_MASKS) clear_mask(turn_mask(mask, l));
  TEAM_BARRIER;
  if (first >= 0) {
    LOCAL const int *met = turn_mask(mask, 0);
    int offset = group_level_size(leaf_count, 0);
    for (int level = 1; level <= w.root; ++level) {
      const int group = first >> (3 * level + 3), own = (first >> (3 * level)) & 7;
      TEAM_FOR(k, GROUP)
        if ((level == 1 ? k >= own : k > own) && box_overlap(b, group_box(tree + offset + group, k)))
          set_mask_bit(turn_mask(mask, 0), GROUP * level - GROUP + k);
      offset += group_level_size(leaf_count, level);
    }
    TEAM_BARRIER;
    for (int level = 1; level <= w.root; ++level) {
      const int bits = (met[(level - 1) >> 2] >> (8 * ((level - 1) & 3))) & 0xff, many = count_bits(bits);
      TEAM_FOR(k, GROUP)
        if ((bits >> k) & 1)
          list[ITEM_BOXES * level + ITEM_BOXES - many + count_bits(bits & ((1 << k) - 1))] =
              GROUP * (first >> (3 * level + 3)) + k;
      w.left |= (key64)many << (7 * level);
    }
    w.turn = 1;
    TEAM_BARRIER;
  }
  return w;
}

/* The number of leaves that come next, which are the last of list[0 .. ITEM_BOXES); 0 after the last. */
DEVICE_TEAM int next_leaves(item_walk *w, int leaf_count, GLOBAL const bvh8_node *tree, box b, LOCAL int *list,
                            LOCAL int *mask)
{
  for (;;) {
    int from, many, taken, found, offset = 0;
    LOCAL int *met = turn_mask(mask, w->turn);
    if (!w->left) {
      if (++w->root_group >= group_level_size(leaf_count, w->root)) return 0;
      TEAM_FOR(l, 1) list[ITEM_BOXES * (w->root + 2) - 1] = w->root_group;
      w->left = (key64)1 << (7 * (w->root + 1));
      TEAM_BARRIER;
    }
    from = lowest_bit(w->left) / 7;
    many = places_left(w->left, from);
    if (from == 0) {
      w->left -= many;
      return many;
    }
    taken = min_int(many, ITEM_GROUPS);
    for (int level = 0; level < from - 1; ++level) offset += group_level_size(leaf_count, level);
    TEAM_FOR(l, GROUP * taken) {
      const int group = list[ITEM_BOXES * (from + 1) - many + l / GROUP];
      if (l == 0) clear_mask(turn_mask(mask, w->turn + 1));
      if (box_overlap(b, group_box(tree + offset + group, l % GROUP))) set_mask_bit(met, l);
    }
    TEAM_BARRIER;
    found = mask_size(met);
    TEAM_FOR(l, GROUP * taken)
      if (mask_has(met, l))
        list[ITEM_BOXES * from - found + bits_before(met, l)] =
            GROUP * list[ITEM_BOXES * (from + 1) - many + l / GROUP] + l % GROUP;
    w->left += ((key64)found << (7 * (from - 1))) - ((key64)taken << (7 * from));
    ++w->turn;
    TEAM_BARRIER;
  }
}

/* Keeps those of an item's next leaves that have a bit in the mask, which follow its first `found` hits; returns its
   hits afterwards. block: in member 0. value: [ITEM_BOXES]. */
DEVICE_TEAM int keep_leaves(int item, int found, int many, LOCAL const int *leaf, LOCAL const int *wanted,
                            GLOBAL const int *order, int *block, int blocks_at, int pools, int pool_blocks,
                            LOCAL int *value, GLOBAL int *hit, GLOBAL int *taken)
{
  const int all = found + mask_size(wanted);
  TEAM_FOR(l, many) {
    const int place = found + bits_before(wanted, l);
    if (!mask_has(wanted, l)) continue;
    if (place < ROW_HITS)
      hit[HIT_ROW * item + place] = order[leaf[l]];
    else
      value[place - found] = order[leaf[l]];
  }
  if (all > ROW_HITS) {
    TEAM_BARRIER;
    TEAM_FOR(l, 1)
      for (int k = max_int(found, ROW_HITS); k < all; ++k)
        *block = keep_hit(item, k, value[k - found], *block, blocks_at, pools, pool_blocks, hit, taken);
  }
  return all;
}

/* As query_vertex_face_count, without batches and parts. n: items. */
KERNEL item_query_vertex_face(int n, GLOBAL const int *vertex_order, GLOBAL const box *vertex_box, int leaf_count,
                              GLOBAL const int *face_order, GLOBAL const face_nodes *leaf_face,
                              GLOBAL const bvh8_node *tree, int cloth_vertex_count, int self, int mode,
                              GLOBAL const int *changed, GLOBAL const box *box_before, GLOBAL const end_boxes *ends,
                              GLOBAL const end_boxes *ends_before, int first_item, int blocks_at, int pools,
                              int pool_blocks, GLOBAL int *hit, GLOBAL int *taken, GLOBAL int *count)
{
  TEAM_LOCAL(int, list, ITEM_LISTS *ITEM_BOXES);
  TEAM_LOCAL(int, value, ITEM_BOXES);
  TEAM_LOCAL(int, mask, ITEM_WORDS *ITEM_MASKS);
  FOR_EACH_UNEVEN_TEAM(k, n) {
    const int v = vertex_order[k], item = first_item + k;
    GLOBAL const end_boxes *own_ends = ends_for_vertex(v, ends);
    const box b = mode == QUERY_UNCHANGED && changed[v] ? empty_box() : vertex_box[v];
    int found = 0, block = NO_BLOCK, many;
    item_walk walk = walk_for_item(-1, leaf_count, tree, b, list, mask);
    while ((many = next_leaves(&walk, leaf_count, tree, b, list, mask)) > 0) {
      LOCAL int *wanted = turn_mask(mask, walk.turn), *leaf = list + ITEM_BOXES - many;
      TEAM_FOR(l, many) {
        if (l == 0) clear_mask(turn_mask(mask, walk.turn + 1));
        if (wanted_vertex_face(v, leaf_face[leaf[l]], cloth_vertex_count, self, mode, box_before, own_ends,
                               ends_before))
          set_mask_bit(wanted, l);
      }
      TEAM_BARRIER;
      found = keep_leaves(item, found, many, leaf, wanted, face_order, &block, blocks_at, pools, pool_blocks, value,
                          hit, taken);
      ++walk.turn;
    }
    TEAM_FOR(l, 1) {
      hit[HIT_ROW * item + ROW_HITS] = block;
      count[item] = found;
    }
  }
}

/* As query_edge_edge_count, without batches. n: items. */
KERNEL item_query_edge_edge(int n, GLOBAL const int *item, GLOBAL const edge_nodes *item_edge,
                            GLOBAL const box *vertex_box, int leaf_count, GLOBAL const int *edge_order,
                            GLOBAL const edge_nodes *leaf_edge, GLOBAL const bvh8_node *tree, int cloth_vertex_count,
                            int self, int mode, GLOBAL const int *changed, GLOBAL const box *box_before,
                            GLOBAL const end_boxes *ends, GLOBAL const end_boxes *ends_before, int first_item,
                            int blocks_at, int pools, int pool_blocks, GLOBAL int *hit, GLOBAL int *taken,
                            GLOBAL int *count)
{
  TEAM_LOCAL(int, list, ITEM_LISTS *ITEM_BOXES);
  TEAM_LOCAL(int, value, ITEM_BOXES);
  TEAM_LOCAL(int, mask, ITEM_WORDS *ITEM_MASKS);
  FOR_EACH_UNEVEN_TEAM(k, n) {
    const int own = item[k];
    const edge_nodes e = item_edge[k];
    GLOBAL const end_boxes *own_ends = ends_for_edge(e, ends);
    const box b = edge_item_box(k, item_edge, vertex_box, tree, mode);
    int found = 0, block = NO_BLOCK, many;
    item_walk walk = walk_for_item(mode == QUERY_ALL ? k : -1, leaf_count, tree, b, list, mask);
    while ((many = next_leaves(&walk, leaf_count, tree, b, list, mask)) > 0) {
      LOCAL int *wanted = turn_mask(mask, walk.turn), *leaf = list + ITEM_BOXES - many;
      TEAM_FOR(l, many) {
        const int j = leaf[l];
        if (l == 0) clear_mask(turn_mask(mask, walk.turn + 1));
        if ((mode != QUERY_ALL || j > k) && wanted_edge_edge(own, e, edge_order[j], leaf_edge[j], cloth_vertex_count,
                                                             self, mode, changed, box_before, own_ends, ends_before))
          set_mask_bit(wanted, l);
      }
      TEAM_BARRIER;
      found = keep_leaves(first_item + k, found, many, leaf, wanted, edge_order, &block, blocks_at, pools, pool_blocks,
                          value, hit, taken);
      ++walk.turn;
    }
    TEAM_FOR(l, 1) {
      hit[HIT_ROW * (first_item + k) + ROW_HITS] = block;
      count[first_item + k] = found;
    }
  }
}

#endif
