/* SPDX-License-Identifier: Apache-2.0 */
/* The first pass of a search (query.h) by teams: QUERY_TEAM neighbouring items walk the tree together. They meet much
   the same groups, so each node is read once for all of them, and the threads of a warp read it at one address. What an
   item finds, and in which order, is what it finds by itself. */
#ifndef CAMA_KERNELS_COLLISION_TEAM_QUERY_H
#define CAMA_KERNELS_COLLISION_TEAM_QUERY_H
#include "../dialect/lang.h"
#include "bounds.h"
#include "hits.h"
#include "query.h"
#include "tree.h"

#define QUERY_TEAM 32
#define TEAM_FLOATS (6 * QUERY_TEAM) /* of the boxes of its items */
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

/* As query_vertex_face_count, without batches, parts and shares. n: teams. */
KERNEL team_query_vertex_face(int n, int items, GLOBAL const int *vertex_order, GLOBAL const box *vertex_box,
                              int leaf_count, GLOBAL const int *face_order, GLOBAL const face_nodes *leaf_face,
                              GLOBAL const bvh8_node *tree, int cloth_vertex_count, int self, int mode,
                              GLOBAL const int *changed, GLOBAL const box *box_before, GLOBAL const end_boxes *ends,
                              GLOBAL const end_boxes *ends_before, int first_item, int blocks_at, int pools,
                              int pool_blocks, GLOBAL int *hit, GLOBAL int *taken, GLOBAL int *count)
{
  TEAM_LOCAL(float, boxes, TEAM_FLOATS);
  TEAM_LOCAL(int, found, QUERY_TEAM);
  TEAM_LOCAL(int, block, QUERY_TEAM);
  TEAM_LOCAL(int, mask, TEAM_TURNS);
  FOR_EACH_UNEVEN_TEAM(t, n) {
    const int first = t * QUERY_TEAM, many = min_int(items - first, QUERY_TEAM);
    group_walk walk = nodes_from_root(leaf_count);
    int turn = 0, g;
    TEAM_BARRIER;
    TEAM_FOR(l, TEAM_TURNS) mask[l] = 0;
    TEAM_FOR(l, many) {
      const int v = vertex_order[first + l];
      put_box(boxes, l, mode == QUERY_UNCHANGED && changed[v] ? empty_box() : vertex_box[v]);
      found[l] = 0;
      block[l] = NO_BLOCK;
    }
    TEAM_BARRIER;
    while ((g = team_group(&walk, &turn, many, boxes, leaf_count, tree, mask)) >= 0) {
      TEAM_FOR(l, many) {
        const int own = group_overlap(tree + g, box_of_member(boxes, l)), v = vertex_order[first + l],
                  item = first_item + first + l;
        GLOBAL const end_boxes *own_ends = own ? ends_for_vertex(v, ends) : 0;
        for (int k = 0; own && k < GROUP; ++k) { /* leaf by leaf, which members read together */
          const int leaf = GROUP * g + k;
          if (!((own >> k) & 1) || !wanted_vertex_face(v, leaf_face[leaf], cloth_vertex_count, self, mode, box_before,
                                                       own_ends, ends_before))
            continue;
          block[l] = keep_hit(item, found[l], face_order[leaf], block[l], blocks_at, pools, pool_blocks, hit, taken);
          ++found[l];
        }
      }
    }
    TEAM_FOR(l, many) {
      hit[HIT_ROW * (first_item + first + l) + ROW_HITS] = block[l];
      count[first_item + first + l] = found[l];
    }
  }
}

/* As query_edge_edge_count, without batches and shares. n: teams. */
KERNEL team_query_edge_edge(int n, int items, GLOBAL const int *item, GLOBAL const edge_nodes *item_edge,
                            GLOBAL const box *vertex_box, int leaf_count, GLOBAL const int *edge_order,
                            GLOBAL const edge_nodes *leaf_edge, GLOBAL const bvh8_node *tree, int cloth_vertex_count,
                            int self, int mode, GLOBAL const int *changed, GLOBAL const box *box_before,
                            GLOBAL const end_boxes *ends, GLOBAL const end_boxes *ends_before, int first_item,
                            int blocks_at, int pools, int pool_blocks, GLOBAL int *hit, GLOBAL int *taken,
                            GLOBAL int *count)
{
  TEAM_LOCAL(float, boxes, TEAM_FLOATS);
  TEAM_LOCAL(int, found, QUERY_TEAM);
  TEAM_LOCAL(int, block, QUERY_TEAM);
  TEAM_LOCAL(int, mask, TEAM_TURNS);
  FOR_EACH_UNEVEN_TEAM(t, n) {
    const int first = t * QUERY_TEAM, many = min_int(items - first, QUERY_TEAM);
    group_walk walk = mode == QUERY_ALL ? nodes_from(first >> 3, leaf_count) : nodes_from_root(leaf_count);
    int turn = 0, g;
    TEAM_BARRIER;
    TEAM_FOR(l, TEAM_TURNS) mask[l] = 0;
    TEAM_FOR(l, many) {
      put_box(boxes, l, edge_item_box(first + l, item_edge, vertex_box, tree, mode));
      found[l] = 0;
      block[l] = NO_BLOCK;
    }
    TEAM_BARRIER;
    if (mode == QUERY_ALL)
      for (int level = 1, offset = walk.offset; level <= walk.root; ++level) {
        const int child = first >> (3 * level), later = ((level == 1 ? 0xff : 0xfe) << (child & 7)) & 0xff;
        walk.open |= (key64)(team_overlap(turn++, many, boxes, tree, offset + (child >> 3), mask) & later)
                     << (8 * level);
        offset += group_level_size(leaf_count, level);
      }
    while ((g = team_group(&walk, &turn, many, boxes, leaf_count, tree, mask)) >= 0) {
      TEAM_FOR(l, many) {
        const int k = first + l,
                  own = mode == QUERY_ALL && g < k >> 3 ? 0 : edge_leaves(g, k, box_of_member(boxes, l), tree, mode);
        edge_nodes e;
        GLOBAL const end_boxes *own_ends;
        if (!own) continue;
        e = item_edge[k];
        own_ends = ends_for_edge(e, ends);
        for (int c = 0; c < GROUP; ++c) { /* leaf by leaf, which members read together */
          const int j = GROUP * g + c;
          if (!((own >> c) & 1) || !wanted_edge_edge(item[k], e, edge_order[j], leaf_edge[j], cloth_vertex_count, self,
                                                     mode, changed, box_before, own_ends, ends_before))
            continue;
          block[l] =
              keep_hit(first_item + k, found[l], edge_order[j], block[l], blocks_at, pools, pool_blocks, hit, taken);
          ++found[l];
        }
      }
    }
    TEAM_FOR(l, many) {
      hit[HIT_ROW * (first_item + first + l) + ROW_HITS] = block[l];
      count[first_item + first + l] = found[l];
    }
  }
}

#endif
