/* SPDX-License-Identifier: Apache-2.0 */
/* Candidate pairs from the trees by count, scan, fill: vertices against the tree of faces, edges against the tree of
   edges, so every pair of features arises exactly once and no representative triangles or orphan sets are needed. The
   count pass keeps what it finds (hits.h), and the fill pass walks the tree again only for items whose hits did not
   find room. Vertices are numbered cloth first: those from cloth_vertex_count on are obstacles, whose pairs among
   themselves are left out. self = 0 leaves out cloth against cloth. */
#ifndef CAMA_KERNELS_COLLISION_QUERY_H
#define CAMA_KERNELS_COLLISION_QUERY_H
#include "../dialect/dvec3.h"
#include "../dialect/lang.h"
#include "bounds.h"
#include "hits.h"
#include "tree.h"

typedef struct {
  int a, b;
} pair;

/* 1 if features whose first vertices are a and b are to be tested against each other. */
DEVICE int wanted_pair(int a, int b, int cloth_vertex_count, int self)
{
  int obstacle_a = a >= cloth_vertex_count, obstacle_b = b >= cloth_vertex_count;
  return !(obstacle_a && obstacle_b) && (self || obstacle_a || obstacle_b);
}

/* Pairs that a coordinate separates throughout are no candidates, where the ends of the vertex, or of both edges,
   differ. ends: [vertices], null where all pairs that overlap are; those for an item are null where its ends do not
   differ. */
DEVICE GLOBAL const end_boxes *ends_for_vertex(int v, GLOBAL const end_boxes *ends)
{
  return ends && ends_differ(ends + v) ? ends : 0;
}
DEVICE_SELDOM int ends_of_vertex_face_separated(int v, face_nodes f, GLOBAL const end_boxes *ends)
{
  return ends_separated(ends[v], union_of_ends(union_of_ends(ends[f.node[0]], ends[f.node[1]]), ends[f.node[2]]));
}
DEVICE int separated_vertex_face(int v, face_nodes f, GLOBAL const end_boxes *ends)
{
  return ends && ends_of_vertex_face_separated(v, f, ends);
}
DEVICE GLOBAL const end_boxes *ends_for_edge(edge_nodes e, GLOBAL const end_boxes *ends)
{
  return ends && (ends_differ(ends + e.node[0]) || ends_differ(ends + e.node[1])) ? ends : 0;
}
DEVICE_SELDOM int ends_of_edges_separated(edge_nodes e, edge_nodes f, GLOBAL const end_boxes *ends)
{
  return ends_for_edge(f, ends) && ends_separated(union_of_ends(ends[e.node[0]], ends[e.node[1]]),
                                                  union_of_ends(ends[f.node[0]], ends[f.node[1]]));
}
DEVICE int separated_edge_edge(edge_nodes e, edge_nodes f, GLOBAL const end_boxes *ends)
{
  return ends && ends_of_edges_separated(e, f, ends);
}

/* A search that follows another one after the motion has changed: the boxes of changed vertices have grown,
   and box_before and ends_before have the earlier ones. A pair is fresh if it is a candidate now and was none before;
   the pairs of the earlier search are kept. */
DEVICE int fresh_vertex_face(int v, face_nodes f, GLOBAL const box *box_before, GLOBAL const end_boxes *ends_before)
{
  box b = box_union(box_union(box_before[f.node[0]], box_before[f.node[1]]), box_before[f.node[2]]);
  return !box_overlap(box_before[v], b) || separated_vertex_face(v, f, ends_for_vertex(v, ends_before));
}
DEVICE int fresh_edge_edge(edge_nodes e, edge_nodes f, GLOBAL const box *box_before,
                           GLOBAL const end_boxes *ends_before)
{
  return !box_overlap(box_union(box_before[e.node[0]], box_before[e.node[1]]),
                      box_union(box_before[f.node[0]], box_before[f.node[1]])) ||
         separated_edge_edge(e, f, ends_for_edge(e, ends_before));
}

#define QUERY_ALL 0 /* every pair */
#define QUERY_CHANGED 1 /* fresh pairs; items are the changed vertices, or edges */
/* Fresh pairs; items are all vertices, of which changed ones are skipped; the tree holds the changed faces. */
#define QUERY_UNCHANGED 2

/* 1 if face f is to be tested against vertex v; changed, box_before and ends_before, per vertex, are read unless mode
   is QUERY_ALL. */
DEVICE int wanted_vertex_face(int v, face_nodes f, int cloth_vertex_count, int self, int mode,
                              GLOBAL const box *box_before, GLOBAL const end_boxes *ends,
                              GLOBAL const end_boxes *ends_before)
{
  return (f.node[0] != v) & (f.node[1] != v) & (f.node[2] != v) &&
         wanted_pair(v, f.node[0], cloth_vertex_count, self) && !separated_vertex_face(v, f, ends) &&
         (mode == QUERY_ALL || fresh_vertex_face(v, f, box_before, ends_before));
}

/* A work-item queries for `batch` items, at most GROUP, batch i .. batch i + batch. With batch > 1 it walks the tree
   once, for the box of all its items, which is less work for one thread; items test the leaves of a group for
   themselves, edges if they meet it. What an item finds, and in which order, does not depend on the batch. */

/* A tree in parts of `part` groups of level 0: their number, the walk of part k of them, and where it has to end. The
   walks of all parts in turn meet the leaves in the order of a walk of the whole. */
DEVICE int tree_parts(int leaf_count, int part) { return (group_level_size(leaf_count, 0) - 1) / part + 1; }
DEVICE group_walk walk_part(int k, int part, int leaf_count, GLOBAL const bvh8_node *tree, box b)
{
  return k ? groups_overlapping_from(part * k, leaf_count, tree, b) : groups_overlapping(leaf_count, tree, b);
}
DEVICE int part_end(int k, int part, int leaf_count) { return min_int(GROUP * part * (k + 1), leaf_count); }

/* Item k is share k % s of vertex vertex_order[k / s / p] against part k / s % p of the tree, of its p parts of `part`
   groups; count[first_item + k]: its candidate faces. More than one part is for few vertices, each of which may meet
   much of the tree, more than one share for somewhat more, where a device has more work-items than there are; batch is
   1 then. n = items / batch, rounded up. mode: QUERY_*. */
KERNEL query_vertex_face_count(int n, int items, int batch, int part, int shares, GLOBAL const int *vertex_order,
                               GLOBAL const box *vertex_box, int leaf_count, GLOBAL const int *face_order,
                               GLOBAL const face_nodes *leaf_face, GLOBAL const bvh8_node *tree, int cloth_vertex_count,
                               int self, int mode, GLOBAL const int *changed, GLOBAL const box *box_before,
                               GLOBAL const end_boxes *ends, GLOBAL const end_boxes *ends_before, int first_item,
                               int blocks_at, int pools, int pool_blocks, GLOBAL int *hit, GLOBAL int *taken,
                               GLOBAL int *count)
{
  FOR_EACH_UNEVEN(i, n) {
    int first = batch * i, end = min_int(first + batch, items), moving = 0, g;
    box all = empty_box();
    group_walk walk;
    if (batch == 1) {
      int parts = tree_parts(leaf_count, part), at = i / shares, v = vertex_order[at / parts], found = 0,
          last = part_end(at % parts, part, leaf_count),
          leaf = mode == QUERY_UNCHANGED && changed[v] ? WALK_END : WALK_ON, block = NO_BLOCK;
      GLOBAL const end_boxes *own_ends = ends_for_vertex(v, ends);
      all = vertex_box[v];
      walk = walk_part(at % parts, part, leaf_count, tree, all);
      take_share(&walk, i % shares, shares);
      WHILE_ANY(leaf != WALK_END)
      {
        if (leaf != WALK_END) leaf = walk_leaves(&walk, leaf_count, tree, all);
        if (leaf >= last) leaf = WALK_END;
        if (leaf >= 0 &&
            wanted_vertex_face(v, leaf_face[leaf], cloth_vertex_count, self, mode, box_before, own_ends, ends_before)) {
          block = keep_hit(first_item + i, found, shares > 1 ? leaf : face_order[leaf], block, blocks_at, pools,
                           pool_blocks, hit, taken);
          ++found;
        }
      }
      hit[HIT_ROW * (first_item + i) + ROW_HITS] = block;
      count[first_item + i] = found;
      continue;
    }
    for (int k = first; k < end; ++k) {
      int v = vertex_order[k];
      count[first_item + k] = 0;
      hit[HIT_ROW * (first_item + k) + ROW_HITS] = NO_BLOCK;
      if (mode != QUERY_UNCHANGED || !changed[v]) all = box_union(all, vertex_box[v]);
      if (ends_for_vertex(v, ends)) moving |= 1 << (k - first);
    }
    walk = groups_overlapping(leaf_count, tree, all);
    while ((g = next_group(&walk, leaf_count, tree, all)) >= 0) {
      for (int k = first; k < end; ++k) {
        int v = vertex_order[k],
            mask = mode == QUERY_UNCHANGED && changed[v] ? 0 : group_overlap(tree + g, vertex_box[v]);
        GLOBAL const end_boxes *own_ends = (moving >> (k - first)) & 1 ? ends : 0;
        for (; mask; mask &= mask - 1) {
          int leaf = GROUP * g + lowest_bit((key64)mask), item = first_item + k;
          GLOBAL int *block = hit + HIT_ROW * item + ROW_HITS;
          if (!wanted_vertex_face(v, leaf_face[leaf], cloth_vertex_count, self, mode, box_before, own_ends,
                                  ends_before))
            continue;
          *block = keep_hit(item, count[item], face_order[leaf], *block, blocks_at, pools, pool_blocks, hit, taken);
          ++count[item];
        }
      }
    }
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

/* The pairs of what the items have found and kept, for many items without shares: a team writes those of HIT_TEAM items
   side by side, with gap_bound 0. owner: of every `parts` items their vertex, or with edges 1 their
   edge. n: teams. */
KERNEL copy_hits(int n, int items, int parts, int edges, GLOBAL const int *owner, int first_item, int blocks_at,
                 GLOBAL const int *hit, GLOBAL const int *count, GLOBAL const int *offset, int first,
                 GLOBAL pair *candidate, GLOBAL float *gap_bound)
{
  TEAM_LOCAL(int, start, HIT_TEAM + 1);
  TEAM_LOCAL(int, own, HIT_TEAM);
  TEAM_LOCAL(int, last_block, HIT_TEAM);
  FOR_EACH_UNEVEN_TEAM(t, n) {
    const int begin = t * HIT_TEAM, many = min_int(items - begin, HIT_TEAM), begun = offset[first_item + begin];
    TEAM_BARRIER;
    TEAM_FOR(l, many) {
      const int item = first_item + begin + l;
      start[l] = offset[item] - begun;
      own[l] = owner[(begin + l) / parts];
      last_block[l] = hit[HIT_ROW * item + ROW_HITS];
      if (l == many - 1) start[many] = offset[item] + count[item] - begun;
    }
    TEAM_BARRIER;
    TEAM_FOR(k, start[many]) {
      int lo = 0, hi = many, found; /* start[lo] <= k < start[hi] */
      while (hi - lo > 1) {
        const int middle = (lo + hi) / 2;
        if (start[middle] <= k)
          lo = middle;
        else
          hi = middle;
      }
      found = start[lo + 1] - start[lo];
      if (hits_copied(found, last_block[lo])) {
        gap_bound[first + begun + k] = 0.0f;
        const int value = hit_number(first_item + begin + lo, k - start[lo], found, last_block[lo], blocks_at, hit);
        pair p;
        p.a = own[lo];
        p.b = value;
        candidate[first + begun + k] = edges ? ordered_pair(own[lo], value) : p;
      }
    }
  }
}

/* candidate[first + offset[first_item + k] ..]: (vertex, face), with gap_bound 0; offset is the exclusive sum of
   count. Shares of a vertex put theirs in the order in which one item would have found them. copied: what copy_hits has
   done is not done again. n: items. */
KERNEL query_vertex_face_fill(int n, int copied, int part, int shares, GLOBAL const int *vertex_order,
                              GLOBAL const box *vertex_box, int leaf_count, GLOBAL const int *face_order,
                              GLOBAL const face_nodes *leaf_face, GLOBAL const bvh8_node *tree, int cloth_vertex_count,
                              int self, int mode, GLOBAL const box *box_before, GLOBAL const end_boxes *ends,
                              GLOBAL const end_boxes *ends_before, int first_item, int blocks_at, GLOBAL const int *hit,
                              GLOBAL const int *count, GLOBAL const int *offset, int first, GLOBAL pair *candidate,
                              GLOBAL float *gap_bound)
{
  FOR_EACH_UNEVEN(k, n) {
    int parts = tree_parts(leaf_count, part), v = vertex_order[k / shares / parts], item = first_item + k,
        at = first + offset[item], found = count[item], block = hit[HIT_ROW * item + ROW_HITS], leaf = WALK_ON,
        alone = first_item + k / shares * shares, kept = 0;
    pair p;
    if (copied && hits_copied(found, block)) continue;
    p.a = v;
    for (int j = 0; j < found; ++j) gap_bound[at + j] = 0.0f;
    if (shares > 1) {
      shared_hits all;
      if (found == 0 && item != alone) continue;
      all = hits_of_shares(alone, hit, count, &kept);
      for (int j = kept ? found - 1 : -1; j >= 0; --j) {
        leaf = kept_hit(item, j, &block, blocks_at, hit);
        p.b = face_order[leaf];
        candidate[first + offset[alone] + hits_before(&all, alone, leaf, blocks_at, hit)] = p;
      }
      if (kept || item != alone) continue;
      leaf = WALK_ON;
    }
    if (shares == 1 && (found <= ROW_HITS || block != NO_BLOCK)) {
      for (int j = found - 1; j >= 0; --j) {
        p.b = kept_hit(item, j, &block, blocks_at, hit);
        candidate[at + j] = p;
      }
    } else {
      int last = part_end(k / shares % parts, part, leaf_count);
      box b = vertex_box[v];
      GLOBAL const end_boxes *own_ends = ends_for_vertex(v, ends);
      group_walk walk = walk_part(k / shares % parts, part, leaf_count, tree, b);
      WHILE_ANY(leaf != WALK_END)
      {
        if (leaf != WALK_END) leaf = walk_leaves(&walk, leaf_count, tree, b);
        if (leaf >= last) leaf = WALK_END;
        if (leaf >= 0 &&
            wanted_vertex_face(v, leaf_face[leaf], cloth_vertex_count, self, mode, box_before, own_ends, ends_before)) {
          p.b = face_order[leaf];
          candidate[at++] = p;
        }
      }
    }
  }
}

DEVICE int edge_changed(edge_nodes e, GLOBAL const int *changed) { return changed[e.node[0]] || changed[e.node[1]]; }

#define QUERY_OTHER 3 /* every pair; items are edges of another tree */

/* The same for edge j with nodes f and edge i with nodes e. Every pair once: QUERY_ALL tests only leaves behind that of
   the item; with QUERY_CHANGED unchanged edges do not query, and of two changed edges the first does. */
DEVICE int wanted_edge_edge(int i, edge_nodes e, int j, edge_nodes f, int cloth_vertex_count, int self, int mode,
                            GLOBAL const int *changed, GLOBAL const box *box_before, GLOBAL const end_boxes *ends,
                            GLOBAL const end_boxes *ends_before)
{
  return (e.node[0] != f.node[0]) & (e.node[0] != f.node[1]) & (e.node[1] != f.node[0]) & (e.node[1] != f.node[1]) &&
         wanted_pair(e.node[0], f.node[0], cloth_vertex_count, self) &&
         (mode != QUERY_CHANGED || j > i || !edge_changed(f, changed)) && !separated_edge_edge(e, f, ends) &&
         (mode != QUERY_CHANGED || fresh_edge_edge(e, f, box_before, ends_before));
}

/* The leaves of group g that overlap item k with box b; with QUERY_ALL, where the item is leaf k, only those behind
   it. */
DEVICE int edge_leaves(int g, int k, box b, GLOBAL const bvh8_node *tree, int mode)
{
  int mask = group_overlap(tree + g, b);
  return mode == QUERY_ALL && g == k >> 3 ? mask & (0xfe << (k & 7)) : mask;
}
DEVICE box edge_item_box(int k, GLOBAL const edge_nodes *item_edge, GLOBAL const box *vertex_box,
                         GLOBAL const bvh8_node *tree, int mode)
{
  return mode == QUERY_ALL ? group_box(tree + (k >> 3), k & 7) : box_of_edge(item_edge[k], vertex_box);
}

/* Item k is share k % shares of edge item[k / shares], nodes item_edge[k / shares]; with QUERY_ALL they are the leaves.
   With more than one share batch is 1. mode: QUERY_ALL, QUERY_OTHER or QUERY_CHANGED. */
KERNEL query_edge_edge_count(int n, int items, int batch, int shares, GLOBAL const int *item,
                             GLOBAL const edge_nodes *item_edge, GLOBAL const box *vertex_box, int leaf_count,
                             GLOBAL const int *edge_order, GLOBAL const edge_nodes *leaf_edge,
                             GLOBAL const bvh8_node *tree, int cloth_vertex_count, int self, int mode,
                             GLOBAL const int *changed, GLOBAL const box *box_before, GLOBAL const end_boxes *ends,
                             GLOBAL const end_boxes *ends_before, int first_item, int blocks_at, int pools,
                             int pool_blocks, GLOBAL int *hit, GLOBAL int *taken, GLOBAL int *count)
{
  FOR_EACH_UNEVEN(b, n) {
    int first = batch * b, end = min_int(first + batch, items), in_group = mode == QUERY_ALL && batch == GROUP,
        moving = 0, g;
    box all = empty_box();
    group_walk walk;
    if (batch == 1) {
      int k = b / shares, own = item[k], found = 0, j = WALK_ON, block = NO_BLOCK;
      edge_nodes e = item_edge[k];
      GLOBAL const end_boxes *own_ends = ends_for_edge(e, ends);
      all = edge_item_box(k, item_edge, vertex_box, tree, mode);
      walk = mode == QUERY_ALL ? groups_overlapping_from(k >> 3, leaf_count, tree, all)
                               : groups_overlapping(leaf_count, tree, all);
      take_share(&walk, b % shares, shares);
      WHILE_ANY(j != WALK_END)
      {
        if (j != WALK_END) j = walk_leaves(&walk, leaf_count, tree, all);
        if (j >= 0 && (mode != QUERY_ALL || j > k) &&
            wanted_edge_edge(own, e, edge_order[j], leaf_edge[j], cloth_vertex_count, self, mode, changed, box_before,
                             own_ends, ends_before)) {
          block = keep_hit(first_item + b, found, shares > 1 ? j : edge_order[j], block, blocks_at, pools, pool_blocks,
                           hit, taken);
          ++found;
        }
      }
      hit[HIT_ROW * (first_item + b) + ROW_HITS] = block;
      count[first_item + b] = found;
      continue;
    }
    for (int k = first; k < end; ++k) {
      count[first_item + k] = 0;
      hit[HIT_ROW * (first_item + k) + ROW_HITS] = NO_BLOCK;
      all = box_union(all, edge_item_box(k, item_edge, vertex_box, tree, mode));
      if (ends_for_edge(item_edge[k], ends)) moving |= 1 << (k - first);
    }
    walk = mode == QUERY_ALL ? groups_overlapping_from(first >> 3, leaf_count, tree, all)
                             : groups_overlapping(leaf_count, tree, all);
    while ((g = next_group(&walk, leaf_count, tree, all)) >= 0) {
      int meeting = in_group ? group_overlap(tree + (first >> 3), box_of_group(walk, g, tree)) : (1 << batch) - 1;
      for (; meeting; meeting &= meeting - 1) {
        int k = first + lowest_bit((key64)meeting);
        edge_nodes e;
        GLOBAL const end_boxes *own_ends;
        if (k >= end) break;
        e = item_edge[k];
        own_ends = (moving >> (k - first)) & 1 ? ends : 0;
        for (int mask = edge_leaves(g, k, edge_item_box(k, item_edge, vertex_box, tree, mode), tree, mode); mask;
             mask &= mask - 1) {
          int j = GROUP * g + lowest_bit((key64)mask), at = first_item + k;
          GLOBAL int *block = hit + HIT_ROW * at + ROW_HITS;
          if (!wanted_edge_edge(item[k], e, edge_order[j], leaf_edge[j], cloth_vertex_count, self, mode, changed,
                                box_before, own_ends, ends_before))
            continue;
          *block = keep_hit(at, count[at], edge_order[j], *block, blocks_at, pools, pool_blocks, hit, taken);
          ++count[at];
        }
      }
    }
  }
}

/* candidate[first + offset[first_item + k] ..]: (edge, edge), with gap_bound 0, in the order of one item for all
   shares. */
KERNEL query_edge_edge_fill(int n, int copied, int shares, GLOBAL const int *item, GLOBAL const edge_nodes *item_edge,
                            GLOBAL const box *vertex_box, int leaf_count, GLOBAL const int *edge_order,
                            GLOBAL const edge_nodes *leaf_edge, GLOBAL const bvh8_node *tree, int cloth_vertex_count,
                            int self, int mode, GLOBAL const int *changed, GLOBAL const box *box_before,
                            GLOBAL const end_boxes *ends, GLOBAL const end_boxes *ends_before, int first_item,
                            int blocks_at, GLOBAL const int *hit, GLOBAL const int *count, GLOBAL const int *offset,
                            int first, GLOBAL pair *candidate, GLOBAL float *gap_bound)
{
  FOR_EACH_UNEVEN(i, n) {
    int k = i / shares, own = item[k], place = first_item + i, at = first + offset[place], found = count[place],
        block = hit[HIT_ROW * place + ROW_HITS], other = WALK_ON, alone = first_item + k * shares, kept = 0;
    if (copied && hits_copied(found, block)) continue;
    for (int j = 0; j < found; ++j) gap_bound[at + j] = 0.0f;
    if (shares > 1) {
      shared_hits all;
      if (found == 0 && place != alone) continue;
      all = hits_of_shares(alone, hit, count, &kept);
      for (int j = kept ? found - 1 : -1; j >= 0; --j) {
        other = kept_hit(place, j, &block, blocks_at, hit);
        candidate[first + offset[alone] + hits_before(&all, alone, other, blocks_at, hit)] =
            ordered_pair(own, edge_order[other]);
      }
      if (kept || place != alone) continue;
      other = WALK_ON;
    }
    if (shares == 1 && (found <= ROW_HITS || block != NO_BLOCK)) {
      for (int j = found - 1; j >= 0; --j)
        candidate[at + j] = ordered_pair(own, kept_hit(place, j, &block, blocks_at, hit));
    } else {
      edge_nodes e = item_edge[k];
      GLOBAL const end_boxes *own_ends = ends_for_edge(e, ends);
      box b = edge_item_box(k, item_edge, vertex_box, tree, mode);
      group_walk walk = mode == QUERY_ALL ? groups_overlapping_from(k >> 3, leaf_count, tree, b)
                                          : groups_overlapping(leaf_count, tree, b);
      WHILE_ANY(other != WALK_END)
      {
        if (other != WALK_END) other = walk_leaves(&walk, leaf_count, tree, b);
        if (other >= 0 && (mode != QUERY_ALL || other > k) &&
            wanted_edge_edge(own, e, edge_order[other], leaf_edge[other], cloth_vertex_count, self, mode, changed,
                             box_before, own_ends, ends_before))
          candidate[at++] = ordered_pair(own, edge_order[other]);
      }
    }
  }
}

/* totals[0], totals[1]: of a scan over the items of two lists, the first with n_first of them; totals[2 + i]: blocks of
   hits that were taken from pool i, none of which is taken afterwards. n: pools. */
KERNEL query_totals(int n, int n_first, int n_all, GLOBAL const int *offset, GLOBAL int *taken, GLOBAL int *totals)
{
  FOR_EACH(i, n) {
    if (i == 0) {
      totals[0] = offset[n_first];
      totals[1] = offset[n_all] - offset[n_first];
    }
    totals[2 + i] = taken[POOL_STRIDE * i];
    taken[POOL_STRIDE * i] = 0;
  }
}

#endif
