/* SPDX-License-Identifier: Apache-2.0 */
/* Runs: RUN_PAIRS candidates that follow each other in their list. The pairs of a run are near each other, since
   searches write the pairs of neighbouring features side by side. So boxes of runs tell which runs may have one of a
   few vertices, at the cost of reading a box instead of the pairs: vertices mark the cells of a grid. */
#ifndef CAMA_KERNELS_COLLISION_RUNS_H
#define CAMA_KERNELS_COLLISION_RUNS_H
#include "../dialect/dvec3.h"
#include "../dialect/lang.h"
#include "bounds.h"
#include "pair.h"

/* Cells share marks, 2^k of them, by a hash of their place: those that meet make more runs count as marked, which harms
   nothing. mask: 2^k - 1. */
DEVICE int hash_of_cell(int i, int j, int k, int mask)
{
  return (int)((unsigned int)i * 73856093u ^ (unsigned int)j * 19349663u ^ (unsigned int)k * 83492791u) & mask;
}

/* Place of the cell, along one axis, of a coordinate relative to the scene's lower corner, m. size: of a cell, m. */
DEVICE int cell_along(double coordinate, double size) { return (int)floor(clamp_double(coordinate / size, -1e9, 1e9)); }

DEVICE int cell_of_position(dvec3 x, dvec3 origin, double size, int mask)
{
  return hash_of_cell(cell_along(x.x - origin.x, size), cell_along(x.y - origin.y, size),
                      cell_along(x.z - origin.z, size), mask);
}

/* Boxes of runs `first` to first + n, around the positions of all vertices of their pairs. size: of the list of pairs;
   n: teams. */
KERNEL bound_runs(int n, int kind, int first, int size, GLOBAL const pair *pairs, GLOBAL const face_nodes *face,
                  GLOBAL const edge_nodes *edge, GLOBAL const dvec3 *position, GLOBAL const dvec3 *scene_bounds,
                  GLOBAL box *run_box)
{
  TEAM_LOCAL(box, part, PAIR_TEAM);
  FOR_EACH_TEAM(t, n) {
    const int begin = (first + t) * RUN_PAIRS, many = min_int(size - begin, RUN_PAIRS);
    int span;
    TEAM_BARRIER;
    TEAM_FOR(l, PAIR_TEAM) {
      element_nodes e = pair_nodes(kind, pairs[begin + min_int(l, many - 1)], face, edge);
      dvec3 lo = position[e.node[0]], hi = lo;
      for (int at = l; at < many; at += PAIR_TEAM) {
        e = pair_nodes(kind, pairs[begin + at], face, edge);
        for (int k = 0; k < 4; ++k) {
          lo = dvec3_min(lo, position[e.node[k]]);
          hi = dvec3_max(hi, position[e.node[k]]);
        }
      }
      part[l] = swept_box(lo, hi, 0.0, scene_bounds[0]);
    }
    TEAM_BARRIER;
    for (span = PAIR_TEAM / 2; span > 0; span /= 2) {
      TEAM_FOR(l, span) part[l] = box_union(part[l], part[l + span]);
      TEAM_BARRIER;
    }
    TEAM_FOR(l, 1) run_box[first + t] = part[0];
  }
}

/* 1 if one of the cells that the box meets has the mark `mark`, and if it meets very many. */
#define MOST_CELLS 64
DEVICE int meets_marked_cell(box b, double size, int mask, GLOBAL const int *cell_marked, int mark)
{
  int lo[3], hi[3], marked = 0;
  for (int k = 0; k < 3; ++k) {
    lo[k] = cell_along((double)b.lo[k], size);
    hi[k] = cell_along((double)b.hi[k], size);
    if (hi[k] - lo[k] >= MOST_CELLS) return 1;
  }
  if ((hi[0] - lo[0] + 1) * (hi[1] - lo[1] + 1) * (hi[2] - lo[2] + 1) > MOST_CELLS) return 1;
  for (int k = lo[2]; k <= hi[2]; ++k)
    for (int j = lo[1]; j <= hi[1]; ++j)
      for (int i = lo[0]; i <= hi[0]; ++i) marked |= cell_marked[hash_of_cell(i, j, k, mask)] == mark;
  return marked;
}

/* Lists the runs that meet marked cells, by pair_code(kind, place of the run); found[counter]: the length of the list.
   n: teams, for all `runs` of both lists, `first_runs` of them of vertices and faces. */
KERNEL list_marked_runs(int n, int runs, int first_runs, GLOBAL const box *vertex_face_box,
                        GLOBAL const box *edge_edge_box, double cell_size, int mask, GLOBAL const int *cell_marked,
                        int mark, GLOBAL int *list, int counter, GLOBAL int *found)
{
  TEAM_LOCAL(int, chosen, PAIR_TEAM);
  TEAM_LOCAL(int, listed, 2);
  FOR_EACH_TEAM(t, n) {
    const int first = t * PAIR_TEAM;
    begin_chosen(listed);
    TEAM_FOR(l, min_int(runs - first, PAIR_TEAM)) {
      const int r = first + l, kind = r >= first_runs, at = kind == 0 ? r : r - first_runs;
      if (meets_marked_cell(kind == 0 ? vertex_face_box[at] : edge_edge_box[at], cell_size, mask, cell_marked, mark))
        chosen[local_add_int(listed, 1)] = pair_code(kind, at);
    }
    append_chosen(chosen, listed, list, found + counter);
  }
}

#endif
