/* SPDX-License-Identifier: Apache-2.0 */
/* Fronts of the bounding volume traversal tree (paper, section 4.1; Tang, Manocha, Lin, Tong 2011). A pair of level L
   joins node a of one tree with node b of another, each at level L, or the root where its tree is lower; its children
   join their children, all at level L - 1; the root pair has the level of the higher root. For a tree with itself only
   a <= b. So every pair but the root has one parent, (L + 1, a / 2, b / 2), and one first child, (L - 1, 2 a, 2 b).

   A front is a cut of this tree of pairs: separated pairs, and pairs of leaves that overlap. It leaves out the pairs of
   adjacent triangles: all their ancestors overlap, so no pruning ever reaches them. */
#ifndef CAMA_KERNELS_COLLISION_FRONT_H
#define CAMA_KERNELS_COLLISION_FRONT_H
#include "../dialect/dvec3.h"
#include "../dialect/lang.h"
#include "../solver/scalars.h"
#include "bounds.h"
#include "query.h"
#include "tree.h"

#define FRONT_BITS 26                           /* a pair is stored as (level << FRONT_BITS | a, b) */
#define FRONT_CHUNK 64                          /* pairs counted by one work item */

#define FRONT_GONE 0
#define FRONT_APART 1                           /* stays in the front */
#define FRONT_TOUCHING 2                        /* a pair of leaves: stays, and is a triangle pair */
#define FRONT_OPEN 3                            /* is replaced by its children */

typedef struct {
  int level, a, b;
} node_pair;

/* Edge k of a face joins its nodes k and k + 1. owned: with bit k, this face and no other tests node k; with bit 3 + k,
   edge k; with bit 6 + k, node k has so many faces that sharing it does not make faces adjacent. */
typedef struct {
  int edge[3];
  int owned;
} face_features;

DEVICE node_pair front_unpack(pair p)
{
  node_pair q;
  q.level = p.a >> FRONT_BITS;
  q.a = p.a & ((1 << FRONT_BITS) - 1);
  q.b = p.b;
  return q;
}
DEVICE pair front_pack(node_pair q)
{
  pair p;
  p.a = (q.level << FRONT_BITS) | q.a;
  p.b = q.b;
  return p;
}

/* Index of a pair's node among the nodes of its tree. */
DEVICE int front_place(int leaf_count, int root_level, int level, int index)
{
  return tree_level_offset(leaf_count, min_int(level, root_level)) + index;
}

/* 1 if the faces share a vertex that makes them adjacent. */
DEVICE int adjacent_faces(face_nodes f, int flags, face_nodes g)
{
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      if (f.node[i] == g.node[j] && !((flags >> (6 + i)) & 1)) return 1;
  return 0;
}

/* Morton codes of the faces first .. first + n, and their numbers to sort with them. */
KERNEL face_codes(int n, int first, GLOBAL const box *face_box, GLOBAL const dvec3 *scene_bounds, GLOBAL key64 *key,
                  GLOBAL int *index)
{
  FOR_EACH(i, n) {
    key[i] = morton_code(face_box[first + i], scene_bounds, scene_bounds[0]);
    index[i] = first + i;
  }
}

/* sum[i]: half the surface area of the boxes of the nodes in chunk i, m^2. */
KERNEL tree_surface(int n, int first, int end, GLOBAL const box *node_box, GLOBAL double *sum)
{
  FOR_EACH(i, n) {
    double total = 0.0;
    int last = min_int(first + (i + 1) * DOT_CHUNK, end);
    for (int k = first + i * DOT_CHUNK; k < last; ++k) {
      box b = node_box[k];
      double x = (double)b.hi[0] - (double)b.lo[0], y = (double)b.hi[1] - (double)b.lo[1],
             z = (double)b.hi[2] - (double)b.lo[2];
      total += x * y + y * z + z * x;
    }
    sum[i] = total;
  }
}

/* total[at] = sum of the partials. One work item. */
KERNEL finish_surface(int n, int count, int at, GLOBAL const double *partial, GLOBAL double *total)
{
  FOR_EACH(i, n) {
    double sum = 0.0;
    for (int k = 0; k < count; ++k) sum += partial[k];
    total[at] = sum;
  }
}

/* Outcome of the pairs of a front. prune: pairs below a separated ancestor are replaced by the highest such ancestor,
   once: by the pair on its path of first children, of which a cut has exactly one; the others leave the front. */
KERNEL test_front(int n, int prune, int self, int leaves_a, int root_a, GLOBAL const box *tree_a,
                  GLOBAL const int *order_a, int leaves_b, int root_b, GLOBAL const box *tree_b,
                  GLOBAL const int *order_b, GLOBAL const face_nodes *face, GLOBAL const face_features *features,
                  GLOBAL pair *front, GLOBAL int *outcome)
{
  FOR_EACH(i, n) {
    int top = root_a > root_b ? root_a : root_b, result = FRONT_GONE;
    if (front[i].a >= 0) {
      node_pair p = front_unpack(front[i]);
      if (box_overlap(tree_a[front_place(leaves_a, root_a, p.level, p.a)],
                      tree_b[front_place(leaves_b, root_b, p.level, p.b)])) {
        if (p.level > 0) {
          result = FRONT_OPEN;
        } else if (!(self && p.a == p.b)) {
          int f = order_a[p.a], g = order_b[p.b];
          result = prune || !adjacent_faces(face[f], features[f].owned, face[g]) ? FRONT_TOUCHING : FRONT_GONE;
        }
      } else {
        result = FRONT_APART;
        if (prune) {
          node_pair q = p;
          while (q.level < top) {
            node_pair up;
            up.level = q.level + 1;
            up.a = q.a >> 1;
            up.b = q.b >> 1;
            if (box_overlap(tree_a[front_place(leaves_a, root_a, up.level, up.a)],
                            tree_b[front_place(leaves_b, root_b, up.level, up.b)]))
              break;
            q = up;
          }
          if (q.level > p.level) {
            int rise = q.level - p.level;
            if (p.a == q.a << rise && p.b == q.b << rise)
              front[i] = front_pack(q);
            else
              result = FRONT_GONE;
          }
        }
      }
    }
    outcome[i] = result;
  }
}

/* The same while boxes only grow: only pairs with a dirty node are tested. check 1: pairs of adjacent leaves are left
   out. */
KERNEL test_dirty_front(int n, int check, int self, int leaves_a, int root_a, GLOBAL const box *tree_a,
                        GLOBAL const int *dirty_a, GLOBAL const int *order_a, int leaves_b, int root_b,
                        GLOBAL const box *tree_b, GLOBAL const int *dirty_b, GLOBAL const int *order_b,
                        GLOBAL const face_nodes *face, GLOBAL const face_features *features, GLOBAL const pair *front,
                        GLOBAL int *outcome)
{
  FOR_EACH(i, n) {
    int result = FRONT_GONE;
    if (front[i].a >= 0) {
      node_pair p = front_unpack(front[i]);
      int a = front_place(leaves_a, root_a, p.level, p.a), b = front_place(leaves_b, root_b, p.level, p.b);
      if ((dirty_a[a] || dirty_b[b]) && box_overlap(tree_a[a], tree_b[b])) {
        if (p.level > 0) {
          result = FRONT_OPEN;
        } else if (!(self && p.a == p.b)) {
          int f = order_a[p.a], g = order_b[p.b];
          result = !check || !adjacent_faces(face[f], features[f].owned, face[g]) ? FRONT_TOUCHING : FRONT_GONE;
        }
      }
    }
    outcome[i] = result;
  }
}

/* Children of open pairs, four slots each; a = -1: no child. n is 4 times the pairs. */
KERNEL open_pairs(int n, int self, int leaves_a, int root_a, int leaves_b, int root_b, GLOBAL const pair *open,
                  GLOBAL pair *child)
{
  FOR_EACH(i, n) {
    node_pair p = front_unpack(open[i >> 2]), q;
    int da = i & 1, db = (i >> 1) & 1, level = p.level - 1;
    q.level = level;
    q.a = level >= root_a ? 0 : 2 * p.a + da;
    q.b = level >= root_b ? 0 : 2 * p.b + db;
    if ((level >= root_a && da) || (level >= root_b && db) || (self && q.a > q.b) ||
        q.a >= tree_level_size(leaves_a, min_int(level, root_a)) ||
        q.b >= tree_level_size(leaves_b, min_int(level, root_b))) {
      child[i].a = -1;
      child[i].b = -1;
    } else {
      child[i] = front_pack(q);
    }
  }
}

/* count[c], count[n + c], count[2 n + c]: pairs of chunk c that stay, that are triangle pairs, and that are opened. */
KERNEL count_front(int n, int size, GLOBAL const int *outcome, GLOBAL int *count)
{
  FOR_EACH(i, n) {
    int last = min_int((i + 1) * FRONT_CHUNK, size), stay = 0, touching = 0, open = 0;
    for (int k = i * FRONT_CHUNK; k < last; ++k) {
      stay += outcome[k] == FRONT_APART || outcome[k] == FRONT_TOUCHING;
      touching += outcome[k] == FRONT_TOUCHING;
      open += outcome[k] == FRONT_OPEN;
    }
    count[i] = stay;
    count[n + i] = touching;
    count[2 * n + i] = open;
  }
}

/* stays: 0 leaves `kept` unchanged. first_*: the number of entries already there. offset: exclusive sum of count. */
KERNEL fill_front(int n, int size, int stays, GLOBAL const pair *front, GLOBAL const int *outcome,
                  GLOBAL const int *offset, int first_kept, int first_triangle, GLOBAL const int *order_a,
                  GLOBAL const int *order_b, GLOBAL pair *kept, GLOBAL pair *triangle_pair, GLOBAL pair *open)
{
  FOR_EACH(i, n) {
    int last = min_int((i + 1) * FRONT_CHUNK, size);
    int stay = first_kept + offset[i], touching = first_triangle + offset[n + i] - offset[n],
        opened = offset[2 * n + i] - offset[2 * n];
    for (int k = i * FRONT_CHUNK; k < last; ++k) {
      int result = outcome[k];
      if (result == FRONT_GONE) continue;
      if (result == FRONT_OPEN) {
        open[opened++] = front[k];
        continue;
      }
      if (stays) kept[stay++] = front[k];
      if (result == FRONT_TOUCHING) {
        node_pair p = front_unpack(front[k]);
        triangle_pair[touching].a = order_a[p.a];
        triangle_pair[touching].b = order_b[p.b];
        ++touching;
      }
    }
  }
}

/* 1 if boxes overlap and, with only_new, did not overlap before: `before` holds the earlier boxes of dirty features. */
DEVICE int wanted_boxes(int only_new, int a, GLOBAL const box *box_a, GLOBAL const int *dirty_a,
                        GLOBAL const box *before_a, int b, GLOBAL const box *box_b, GLOBAL const int *dirty_b,
                        GLOBAL const box *before_b)
{
  if (only_new && !dirty_a[a] && !dirty_b[b]) return 0;
  if (!box_overlap(box_a[a], box_b[b])) return 0;
  return !only_new || !box_overlap(dirty_a[a] ? before_a[a] : box_a[a], dirty_b[b] ? before_b[b] : box_b[b]);
}
DEVICE int face_has(face_nodes f, int v) { return f.node[0] == v || f.node[1] == v || f.node[2] == v; }
DEVICE int edges_meet(edge_nodes e, edge_nodes f)
{
  return e.node[0] == f.node[0] || e.node[0] == f.node[1] || e.node[1] == f.node[0] || e.node[1] == f.node[1];
}

/* Candidates among the features that the faces of a triangle pair own. Bits of mask: k is vertex k of the first face
   with the second face, 3 + k vertex k of the second with the first, 6 + 3 k + l edge k of the first with edge l of the
   second. */
KERNEL test_features(int n, int only_new, GLOBAL const pair *triangle_pair, GLOBAL const face_nodes *face,
                     GLOBAL const edge_nodes *edge, GLOBAL const face_features *features, GLOBAL const box *vertex_box,
                     GLOBAL const int *vertex_dirty, GLOBAL const box *vertex_before, GLOBAL const box *face_box,
                     GLOBAL const int *face_dirty, GLOBAL const box *face_before, GLOBAL const box *edge_box,
                     GLOBAL const int *edge_dirty, GLOBAL const box *edge_before, GLOBAL int *mask,
                     GLOBAL int *vertex_face, GLOBAL int *edge_edge)
{
  FOR_EACH(i, n) {
    pair p = triangle_pair[i];
    face_features own[2];
    face_nodes node[2];
    int found = 0, points = 0, lines = 0;
    node[0] = face[p.a];
    node[1] = face[p.b];
    own[0] = features[p.a];
    own[1] = features[p.b];
    for (int side = 0; side < 2; ++side)
      for (int k = 0; k < 3; ++k) {
        int v = node[side].node[k];
        if (((own[side].owned >> k) & 1) && !face_has(node[1 - side], v) &&
            wanted_boxes(only_new, v, vertex_box, vertex_dirty, vertex_before, side == 0 ? p.b : p.a, face_box,
                         face_dirty, face_before)) {
          found |= 1 << (3 * side + k);
          ++points;
        }
      }
    for (int k = 0; k < 3; ++k) {
      if (!((own[0].owned >> (3 + k)) & 1)) continue;
      for (int l = 0; l < 3; ++l)
        if (((own[1].owned >> (3 + l)) & 1) && !edges_meet(edge[own[0].edge[k]], edge[own[1].edge[l]]) &&
            wanted_boxes(only_new, own[0].edge[k], edge_box, edge_dirty, edge_before, own[1].edge[l], edge_box,
                         edge_dirty, edge_before)) {
          found |= 1 << (6 + 3 * k + l);
          ++lines;
        }
    }
    mask[i] = found;
    vertex_face[i] = points;
    edge_edge[i] = lines;
  }
}

/* Writes these pairs from first_* on; offsets are the exclusive sums of the counts of test_features. */
KERNEL fill_features(int n, GLOBAL const pair *triangle_pair, GLOBAL const face_nodes *face,
                     GLOBAL const face_features *features, GLOBAL const int *mask, int first_vertex_face,
                     GLOBAL const int *vertex_face_offset, GLOBAL pair *vertex_face,
                     GLOBAL float *vertex_face_gap_bound, int first_edge_edge, GLOBAL const int *edge_edge_offset,
                     GLOBAL pair *edge_edge, GLOBAL float *edge_edge_gap_bound)
{
  FOR_EACH(i, n) {
    pair p = triangle_pair[i];
    int at = first_vertex_face + vertex_face_offset[i];
    for (int k = 0; k < 6; ++k)
      if ((mask[i] >> k) & 1) {
        vertex_face[at].a = face[k < 3 ? p.a : p.b].node[k % 3];
        vertex_face[at].b = k < 3 ? p.b : p.a;
        vertex_face_gap_bound[at++] = 0.0f;
      }
    at = first_edge_edge + edge_edge_offset[i];
    for (int k = 0; k < 9; ++k)
      if ((mask[i] >> (6 + k)) & 1) {
        edge_edge[at] = ordered_pair(features[p.a].edge[k / 3], features[p.b].edge[k % 3]);
        edge_edge_gap_bound[at++] = 0.0f;
      }
  }
}

/* found[first + i] = 1: orphan i, feature a with feature b, is a candidate. */
KERNEL test_orphans(int n, int only_new, GLOBAL const pair *orphan, GLOBAL const box *box_a, GLOBAL const int *dirty_a,
                    GLOBAL const box *before_a, GLOBAL const box *box_b, GLOBAL const int *dirty_b,
                    GLOBAL const box *before_b, int first, GLOBAL int *found)
{
  FOR_EACH(i, n) {
    found[first + i] =
        wanted_boxes(only_new, orphan[i].a, box_a, dirty_a, before_a, orphan[i].b, box_b, dirty_b, before_b);
  }
}

KERNEL fill_orphans(int n, GLOBAL const pair *orphan, int first, GLOBAL const int *found, GLOBAL const int *offset,
                    int first_pair, GLOBAL pair *pairs, GLOBAL float *gap_bound)
{
  FOR_EACH(i, n) {
    if (found[first + i]) {
      pairs[first_pair + offset[first + i]] = orphan[i];
      gap_bound[first_pair + offset[first + i]] = 0.0f;
    }
  }
}

/* Vertices that leave their box on the way from x to y become dirty, and their box grows to hold the motion as well.
   `count`: their number. */
KERNEL mark_escaped(int n, GLOBAL const dvec3 *x, GLOBAL const dvec3 *y, GLOBAL const box *boxes,
                    GLOBAL const dvec3 *bounds, double margin, GLOBAL int *dirty, GLOBAL int *count)
{
  FOR_EACH(i, n) {
    dvec3 a = dsub(x[i], bounds[0]), b = dsub(y[i], bounds[0]);
    box k = boxes[i];
    int outside = 0;
    for (int axis = 0; axis < 3; ++axis) {
      double lo = min_double(dcomponent(a, axis), dcomponent(b, axis)) - margin,
             hi = max_double(dcomponent(a, axis), dcomponent(b, axis)) + margin;
      outside |= lo < (double)k.lo[axis] || hi > (double)k.hi[axis];
    }
    dirty[i] = outside;
    if (outside) atomic_add_int(count, 1);
  }
}

KERNEL grow_vertex_boxes(int n, GLOBAL const dvec3 *x, GLOBAL const dvec3 *y, GLOBAL const double *margin,
                         GLOBAL const dvec3 *bounds, GLOBAL const int *dirty, GLOBAL box *boxes, GLOBAL box *before)
{
  FOR_EACH(i, n) {
    if (dirty[i]) {
      before[i] = boxes[i];
      boxes[i] = box_union(boxes[i], swept_box(x[i], y[i], margin[i], bounds[0]));
    }
  }
}

KERNEL grow_face_boxes(int n, GLOBAL const face_nodes *face, GLOBAL const box *vertex_box,
                       GLOBAL const int *vertex_dirty, GLOBAL int *dirty, GLOBAL box *boxes, GLOBAL box *before)
{
  FOR_EACH(i, n) {
    face_nodes f = face[i];
    dirty[i] = vertex_dirty[f.node[0]] || vertex_dirty[f.node[1]] || vertex_dirty[f.node[2]];
    if (dirty[i]) {
      before[i] = boxes[i];
      boxes[i] = box_union(box_union(vertex_box[f.node[0]], vertex_box[f.node[1]]), vertex_box[f.node[2]]);
    }
  }
}

KERNEL grow_edge_boxes(int n, GLOBAL const edge_nodes *edge, GLOBAL const box *vertex_box,
                       GLOBAL const int *vertex_dirty, GLOBAL int *dirty, GLOBAL box *boxes, GLOBAL box *before)
{
  FOR_EACH(i, n) {
    edge_nodes e = edge[i];
    dirty[i] = vertex_dirty[e.node[0]] || vertex_dirty[e.node[1]];
    if (dirty[i]) {
      before[i] = boxes[i];
      boxes[i] = box_union(vertex_box[e.node[0]], vertex_box[e.node[1]]);
    }
  }
}

KERNEL grow_leaves(int n, GLOBAL const int *order, GLOBAL const int *face_dirty, GLOBAL const box *face_box,
                   GLOBAL int *dirty, GLOBAL box *node_box)
{
  FOR_EACH(i, n) {
    dirty[i] = face_dirty[order[i]];
    if (dirty[i]) node_box[i] = face_box[order[i]];
  }
}

/* As tree_levels: marks the nodes above dirty ones and refits them alone. */
KERNEL grow_levels(int n, int leaf_count, int level, int steps, GLOBAL int *dirty, GLOBAL box *node_box)
{
  FOR_EACH(i, n) {
    for (int l = level - steps + 1; l <= level; ++l) {
      int below = tree_level_offset(leaf_count, l - 1), here = tree_level_offset(leaf_count, l);
      int below_size = tree_level_size(leaf_count, l - 1), first = i << (level - l);
      int last = min_int((i + 1) << (level - l), tree_level_size(leaf_count, l));
      for (int k = first; k < last; ++k) {
        int left = below + 2 * k, both = 2 * k + 1 < below_size;
        dirty[here + k] = dirty[left] || (both && dirty[left + 1]);
        if (dirty[here + k]) node_box[here + k] = both ? box_union(node_box[left], node_box[left + 1]) : node_box[left];
      }
    }
  }
}

#endif
