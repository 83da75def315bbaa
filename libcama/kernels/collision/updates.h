/* SPDX-License-Identifier: Apache-2.0 */
/* Searches that follow another one after the motion has changed: the vertices that have left their boxes, the features
   that have such vertices; and the removal of pairs that are exempt from contact. */
#ifndef CAMA_KERNELS_COLLISION_UPDATES_H
#define CAMA_KERNELS_COLLISION_UPDATES_H
#include "../dialect/dvec3.h"
#include "../dialect/lang.h"
#include "bounds.h"
#include "query.h"

/* changed[i] = 1 where the motion x to y of vertex i leaves its box or those at its ends, which then grow to hold it
   with its own margin. before, ends_before: copies of the earlier ones. `least`: the distance to be left between motion
   and box, m. grown[0]: incremented for each box that grows. */
KERNEL grow_boxes(int n, GLOBAL const dvec3 *x, GLOBAL const dvec3 *y, GLOBAL const double *margin,
                  GLOBAL const dvec3 *scene_bounds, double least, GLOBAL box *before, GLOBAL box *vertex_box,
                  GLOBAL end_boxes *ends_before, GLOBAL end_boxes *ends, GLOBAL int *changed, GLOBAL int *grown)
{
  FOR_EACH(i, n) {
    box b = vertex_box[i], needed = swept_box(x[i], y[i], least, scene_bounds[0]), all = box_union(b, needed);
    int outside = 0, strays = leaves_end_boxes(x[i], y[i], least, scene_bounds[0], ends + i);
    for (int k = 0; k < 3; ++k) outside |= all.lo[k] != b.lo[k] || all.hi[k] != b.hi[k];
    before[i] = b;
    ends_before[i] = ends[i];
    changed[i] = outside | strays;
    if (outside) {
      vertex_box[i] = box_union(b, swept_box(x[i], y[i], margin[i], scene_bounds[0]));
      atomic_add_int(grown, 1);
    }
    if (strays)
      ends[i] = union_of_ends(ends[i], make_end_boxes(swept_box(x[i], x[i], margin[i], scene_bounds[0]),
                                                      swept_box(y[i], y[i], margin[i], scene_bounds[0])));
  }
}

/* How much has changed; of vertices, faces and edges from the sums of their flags, edges behind the faces. */
typedef struct {
  int vertices, faces, edges, grown;
} change_counts;
KERNEL count_changes(int n, int vertices, int faces, int features, GLOBAL const int *vertex_offset,
                     GLOBAL const int *feature_offset, GLOBAL const int *grown, GLOBAL change_counts *counts)
{
  FOR_EACH(i, n) {
    counts[i].vertices = vertex_offset[vertices];
    counts[i].faces = feature_offset[faces];
    counts[i].edges = feature_offset[features] - feature_offset[faces];
    counts[i].grown = grown[0];
  }
}

/* flag[first + i] = 1 for the leaves whose face, or edge, has a changed vertex. */
KERNEL changed_faces(int n, int first, GLOBAL const int *face_order, GLOBAL const face_nodes *face,
                     GLOBAL const int *changed, GLOBAL int *flag)
{
  FOR_EACH(i, n) {
    face_nodes f = face[face_order[i]];
    flag[first + i] = changed[f.node[0]] || changed[f.node[1]] || changed[f.node[2]];
  }
}
KERNEL changed_edges(int n, int first, GLOBAL const int *edge_order, GLOBAL const edge_nodes *edge,
                     GLOBAL const int *changed, GLOBAL int *flag)
{
  FOR_EACH(i, n) flag[first + i] = edge_changed(edge[edge_order[i]], changed);
}

/* The values whose flags, from `first` on, are 1, in order; their places in `kept` are counted from the flag at
   `start`. place: exclusive sum of all flags. */
KERNEL keep_flagged(int n, int start, int first, GLOBAL const int *place, GLOBAL const int *value, GLOBAL int *kept)
{
  FOR_EACH(i, n)
    if (place[first + i + 1] > place[first + i]) kept[place[first + i] - place[start]] = value[i];
}

/* 1 if `value` is in the sorted row of vertex v. */
DEVICE int row_holds(GLOBAL const int *row, GLOBAL const int *entry, int v, int value)
{
  int lo = row[v], hi = row[v + 1];
  while (lo < hi) {
    int mid = lo + (hi - lo) / 2;
    if (entry[mid] == value) return 1;
    if (entry[mid] < value)
      lo = mid + 1;
    else
      hi = mid;
  }
  return 0;
}

/* flag[i] = 1 if pair first + i is not exempt: no vertex of one side is exempt from contact with a vertex, or with the
   object, of the other. */
KERNEL wanted_pairs(int n, int first, int kind, int vertex_count, GLOBAL const pair *pairs,
                    GLOBAL const face_nodes *face, GLOBAL const edge_nodes *edge, GLOBAL const int *row,
                    GLOBAL const int *entry, GLOBAL const int *object, GLOBAL int *flag)
{
  FOR_EACH(i, n) {
    pair p = pairs[first + i];
    int v[4], exempt = 0, split = kind + 1;
    if (kind == 0) {
      face_nodes f = face[p.b];
      v[0] = p.a;
      v[1] = f.node[0];
      v[2] = f.node[1];
      v[3] = f.node[2];
    } else {
      v[0] = edge[p.a].node[0];
      v[1] = edge[p.a].node[1];
      v[2] = edge[p.b].node[0];
      v[3] = edge[p.b].node[1];
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
  FOR_EACH(i, n)
    if (place[i + 1] > place[i]) kept[place[i]] = pairs[first + i];
}

KERNEL copy_pairs(int n, int first, GLOBAL const pair *from, GLOBAL pair *to)
{
  FOR_EACH(i, n) to[first + i] = from[i];
}

#endif
