/* SPDX-License-Identifier: Apache-2.0 */
/* The first pass of a search (query.h) by teams: QUERY_TEAM neighbouring items walk the tree together. They meet much
   the same groups, so each node is read once for all of them, and the threads of a warp read it at one address. Few of
   them meet the same leaf: what they meet is collected, and the members test these pairs side by side. What an item
   finds, and in which order, is what it finds by itself. */
#ifndef CAMA_KERNELS_COLLISION_TEAM_QUERY_H
#define CAMA_KERNELS_COLLISION_TEAM_QUERY_H
#include "../dialect/lang.h"
#include "bounds.h"
#include "hits.h"
#include "query.h"
#include "tree.h"

#define QUERY_TEAM 32
#define QUERY_TEAMS 32               /* on a multiprocessor */
#define TEAM_FLOATS (6 * QUERY_TEAM) /* of the boxes of its items */
#define TEAM_GROUPS 4                /* of level 0, whose leaves are tested together */
#define TEAM_LEAVES (TEAM_GROUPS * GROUP) /* bits of an int */
#define TEAM_PAIRS (TEAM_LEAVES * QUERY_TEAM)
#define TEAM_TURNS 3 /* masks in memory: of this turn, of the next, and of the last, which a member may still read */

/* The boxes of a team, that of item l in every QUERY_TEAM-th number from l on. An empty box meets nothing. */
DEVICE_TEAM void put_box(LOCAL float *boxes, int l, box b)
{
  for (int c = 0; c < 3; ++c) {
    boxes[QUERY_TEAM * c + l] = b.lo[c];
    boxes[QUERY_TEAM * (3 + c) + l] = b.hi[c];
  }
}
DEVICE_TEAM box box_of_member(LOCAL const float *boxes, int l)
{
  box b;
  for (int c = 0; c < 3; ++c) {
    b.lo[c] = boxes[QUERY_TEAM * c + l];
    b.hi[c] = boxes[QUERY_TEAM * (3 + c) + l];
  }
  return b;
}

/* Bit k is 1 where one of `many` items overlaps box k of group g. turn: of the team, counted from 0; mask:
   [TEAM_TURNS], 0 at first. */
DEVICE_TEAM int team_overlap(int turn, int many, LOCAL const float *boxes, GLOBAL const bvh8_node *tree, int g,
                             LOCAL int *mask)
{
  TEAM_FOR(l, many) {
    const int own = group_overlap(tree + g, box_of_member(boxes, l));
    if (l == 0) mask[(turn + 1) % TEAM_TURNS] = 0;
    if (own) local_or_int(mask + turn % TEAM_TURNS, own);
  }
  TEAM_BARRIER;
  return mask[turn % TEAM_TURNS];
}

/* The next group of level 0 that one of them overlaps, -1 after the last. */
DEVICE_TEAM int team_group(group_walk *w, int *turn, int many, LOCAL const float *boxes, int leaf_count,
                           GLOBAL const bvh8_node *tree, LOCAL int *mask)
{
  while (next_node(w, leaf_count)) {
    if (w->level == 0) return w->group;
    w->open |= (key64)team_overlap((*turn)++, many, boxes, tree, w->offset + w->group, mask) << (8 * w->level);
  }
  return -1;
}

/* The next groups of level 0 that one of them overlaps, at most TEAM_GROUPS; returns their number, 0 after the last. */
DEVICE_TEAM int team_groups(group_walk *w, int *turn, int many, LOCAL const float *boxes, int leaf_count,
                            GLOBAL const bvh8_node *tree, LOCAL int *mask, LOCAL int *group)
{
  int found = 0, g;
  while (found < TEAM_GROUPS && (g = team_group(w, turn, many, boxes, leaf_count, tree, mask)) >= 0) {
    TEAM_FOR(l, 1) group[found] = g;
    ++found;
  }
  TEAM_BARRIER;
  return found;
}

/* Of leaves GROUP g + k those behind leaf `behind`: bit k. */
DEVICE int leaves_behind(int g, int behind)
{
  return g > behind >> 3 ? 0xff : g < behind >> 3 ? 0 : (0xfe << (behind & 7)) & 0xff;
}

/* Collects the leaves of these groups that items overlap: places of pairs, TEAM_LEAVES l + GROUP c + k for leaf k of
   group c and item l; with `behind` >= 0 only those behind leaf behind + l. wanted: [QUERY_TEAM], 0 afterwards; paired:
   their number, 0 before. */
DEVICE_TEAM void pair_leaves(int many, int groups, LOCAL const float *boxes, GLOBAL const bvh8_node *tree,
                             LOCAL const int *group, int behind, LOCAL int *wanted, LOCAL short *place,
                             LOCAL int *paired)
{
  TEAM_FOR(l, many) {
    const box b = box_of_member(boxes, l);
    unsigned int own = 0;
    int c, at;
    for (c = 0; c < groups; ++c) {
      int met = group_overlap(tree + group[c], b);
      if (behind >= 0) met &= leaves_behind(group[c], behind + l);
      own |= (unsigned int)met << (GROUP * c);
    }
    wanted[l] = 0;
    at = local_add_int(paired, count_bits((int)own));
    for (; own; own &= own - 1) place[at++] = (short)(TEAM_LEAVES * l + lowest_bit((key64)own));
  }
  TEAM_BARRIER;
}

/* Keeps the leaves that each item wants, in order. */
DEVICE_TEAM void keep_wanted(int many, int first_item, LOCAL const int *group, LOCAL const int *wanted,
                             GLOBAL const int *order, LOCAL int *found, LOCAL int *block, LOCAL int *paired,
                             int blocks_at, int pools, int pool_blocks, GLOBAL int *hit, GLOBAL int *taken)
{
  TEAM_BARRIER;
  TEAM_FOR(l, many) {
    unsigned int own = (unsigned int)wanted[l];
    int many_found = found[l], last = block[l];
    for (; own; own &= own - 1) {
      const int bit = lowest_bit((key64)own), leaf = GROUP * group[bit / GROUP] + bit % GROUP;
      last = keep_hit(first_item + l, many_found, order[leaf], last, blocks_at, pools, pool_blocks, hit, taken);
      ++many_found;
    }
    found[l] = many_found;
    block[l] = last;
    if (l == 0) *paired = 0;
  }
  TEAM_BARRIER;
}

/* As query_vertex_face_count, without batches and parts. n: teams. */
KERNEL_OF(QUERY_TEAM, QUERY_TEAMS)
team_query_vertex_face(int n, int items, GLOBAL const int *vertex_order, GLOBAL const box *vertex_box, int leaf_count,
                       GLOBAL const int *face_order, GLOBAL const face_nodes *leaf_face, GLOBAL const bvh8_node *tree,
                       int cloth_vertex_count, int self, int mode, GLOBAL const int *changed,
                       GLOBAL const box *box_before, GLOBAL const end_boxes *ends, GLOBAL const end_boxes *ends_before,
                       int first_item, int blocks_at, int pools, int pool_blocks, GLOBAL int *hit, GLOBAL int *taken,
                       GLOBAL int *count)
{
  TEAM_LOCAL(float, boxes, TEAM_FLOATS);
  TEAM_LOCAL(int, vertex, QUERY_TEAM);
  TEAM_LOCAL(int, moving, QUERY_TEAM); /* items whose ends differ */
  TEAM_LOCAL(int, found, QUERY_TEAM);
  TEAM_LOCAL(int, block, QUERY_TEAM);
  TEAM_LOCAL(int, wanted, QUERY_TEAM);
  TEAM_LOCAL(short, place, TEAM_PAIRS);
  TEAM_LOCAL(int, group, TEAM_GROUPS);
  TEAM_LOCAL(int, paired, 1);
  TEAM_LOCAL(int, mask, TEAM_TURNS);
  FOR_EACH_UNEVEN_TEAM(t, n) {
    const int first = t * QUERY_TEAM, many = min_int(items - first, QUERY_TEAM);
    group_walk walk = nodes_from_root(leaf_count);
    int turn = 0, groups;
    TEAM_BARRIER;
    TEAM_FOR(l, TEAM_TURNS) mask[l] = 0;
    TEAM_FOR(l, many) {
      const int v = vertex_order[first + l];
      put_box(boxes, l, mode == QUERY_UNCHANGED && changed[v] ? empty_box() : vertex_box[v]);
      vertex[l] = v;
      moving[l] = ends_for_vertex(v, ends) != 0;
      found[l] = 0;
      block[l] = NO_BLOCK;
      if (l == 0) paired[0] = 0;
    }
    TEAM_BARRIER;
    while ((groups = team_groups(&walk, &turn, many, boxes, leaf_count, tree, mask, group)) > 0) {
      pair_leaves(many, groups, boxes, tree, group, -1, wanted, place, paired);
      TEAM_FOR(p, paired[0]) {
        const int l = place[p] / TEAM_LEAVES, bit = place[p] % TEAM_LEAVES,
                  leaf = GROUP * group[bit / GROUP] + bit % GROUP;
        if (wanted_vertex_face(vertex[l], leaf_face[leaf], cloth_vertex_count, self, mode, box_before,
                               moving[l] ? ends : 0, ends_before))
          local_or_int(wanted + l, (int)(1u << bit));
      }
      keep_wanted(many, first_item + first, group, wanted, face_order, found, block, paired, blocks_at, pools,
                  pool_blocks, hit, taken);
    }
    TEAM_FOR(l, many) {
      hit[HIT_ROW * (first_item + first + l) + ROW_HITS] = block[l];
      count[first_item + first + l] = found[l];
    }
  }
}

/* As query_edge_edge_count, without batches. n: teams. */
KERNEL_OF(QUERY_TEAM, QUERY_TEAMS)
team_query_edge_edge(int n, int items, GLOBAL const int *item, GLOBAL const edge_nodes *item_edge,
                     GLOBAL const box *vertex_box, int leaf_count, GLOBAL const int *edge_order,
                     GLOBAL const edge_nodes *leaf_edge, GLOBAL const bvh8_node *tree, int cloth_vertex_count, int self,
                     int mode, GLOBAL const int *changed, GLOBAL const box *box_before, GLOBAL const end_boxes *ends,
                     GLOBAL const end_boxes *ends_before, int first_item, int blocks_at, int pools, int pool_blocks,
                     GLOBAL int *hit, GLOBAL int *taken, GLOBAL int *count)
{
  TEAM_LOCAL(float, boxes, TEAM_FLOATS);
  TEAM_LOCAL(edge_nodes, nodes, QUERY_TEAM);
  TEAM_LOCAL(int, moving, QUERY_TEAM);
  TEAM_LOCAL(int, found, QUERY_TEAM);
  TEAM_LOCAL(int, block, QUERY_TEAM);
  TEAM_LOCAL(int, wanted, QUERY_TEAM);
  TEAM_LOCAL(short, place, TEAM_PAIRS);
  TEAM_LOCAL(int, group, TEAM_GROUPS);
  TEAM_LOCAL(int, paired, 1);
  TEAM_LOCAL(int, mask, TEAM_TURNS);
  FOR_EACH_UNEVEN_TEAM(t, n) {
    const int first = t * QUERY_TEAM, many = min_int(items - first, QUERY_TEAM);
    group_walk walk = mode == QUERY_ALL ? nodes_from(first >> 3, leaf_count) : nodes_from_root(leaf_count);
    int turn = 0, groups;
    TEAM_BARRIER;
    TEAM_FOR(l, TEAM_TURNS) mask[l] = 0;
    TEAM_FOR(l, many) {
      const edge_nodes e = item_edge[first + l];
      put_box(boxes, l, edge_item_box(first + l, item_edge, vertex_box, tree, mode));
      nodes[l] = e;
      moving[l] = ends_for_edge(e, ends) != 0;
      found[l] = 0;
      block[l] = NO_BLOCK;
      if (l == 0) paired[0] = 0;
    }
    TEAM_BARRIER;
    if (mode == QUERY_ALL)
      for (int level = 1, offset = walk.offset; level <= walk.root; ++level) {
        const int child = first >> (3 * level), later = ((level == 1 ? 0xff : 0xfe) << (child & 7)) & 0xff;
        walk.open |= (key64)(team_overlap(turn++, many, boxes, tree, offset + (child >> 3), mask) & later)
                     << (8 * level);
        offset += group_level_size(leaf_count, level);
      }
    while ((groups = team_groups(&walk, &turn, many, boxes, leaf_count, tree, mask, group)) > 0) {
      pair_leaves(many, groups, boxes, tree, group, mode == QUERY_ALL ? first : -1, wanted, place, paired);
      TEAM_FOR(p, paired[0]) {
        const int l = place[p] / TEAM_LEAVES, bit = place[p] % TEAM_LEAVES,
                  j = GROUP * group[bit / GROUP] + bit % GROUP;
        if (wanted_edge_edge(item[first + l], nodes[l], edge_order[j], leaf_edge[j], cloth_vertex_count, self, mode,
                             changed, box_before, moving[l] ? ends : 0, ends_before))
          local_or_int(wanted + l, (int)(1u << bit));
      }
      keep_wanted(many, first_item + first, group, wanted, edge_order, found, block, paired, blocks_at, pools,
                  pool_blocks, hit, taken);
    }
    TEAM_FOR(l, many) {
      hit[HIT_ROW * (first_item + first + l) + ROW_HITS] = block[l];
      count[first_item + first + l] = found[l];
    }
  }
}

#endif
