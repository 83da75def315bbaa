/* SPDX-License-Identifier: Apache-2.0 */
/* Penetration handling (paper, section 4; inelastic impact zones of Harmon et al. 2008 as one system): all impacts are
   projected at once. With C_i(x) = n_i . sum_k w_ik x_k, J its gradient and S = J M^-1 J', lambda >= 0 minimises
   lambda' S lambda / 2 - c' lambda; then x += M^-1 J' lambda. By default c = target - C(x): the features end apart by
   their target. With the option paper.impact_zones c = -J d with d the motion of the step: no impact's features
   approach each other. */
#ifndef CAMA_KERNELS_COLLISION_IMPULSES_H
#define CAMA_KERNELS_COLLISION_IMPULSES_H
#include "../dialect/dvec3.h"
#include "../dialect/lang.h"
#include "../solver/scalars.h"
#include "../system/incidence.h"
#include "impact.h"

KERNEL impact_nodes(int n, GLOBAL const impact *impacts, GLOBAL element_nodes *nodes)
{
  FOR_EACH(i, n) {
    int a;
    for (a = 0; a < 4; ++a) nodes[i].node[a] = impacts[i].node[a];
  }
}

/* constraint: c above, of the positions x, with impact zones for the motion from `from` to x. majorant: sum_k count_k
   w_k^2 / m_k with count_k the number of impacts at node k, a diagonal matrix that exceeds S (mass splitting), so that
   steps scaled by it never overshoot; 0 for what cannot move, and for repeated impacts, which rigid zones resolve. row:
   start of each vertex's row in the incidence. */
KERNEL start_impacts(int n, int rows, int zones, GLOBAL const impact *impacts, GLOBAL const dvec3 *from,
                     GLOBAL const dvec3 *x, GLOBAL const double *inverse_mass, GLOBAL const int *row,
                     GLOBAL double *constraint, GLOBAL double *majorant)
{
  FOR_EACH(i, n) {
    impact m = impacts[i];
    dvec3 o = x[m.node[0]];
    double c = 0.0, split = 0.0;
    int k;
    if (zones) {
      o = dsub(o, from[m.node[0]]);
      for (k = 1; k < 4; ++k) c += m.weight[k] * ddot(m.normal, dsub(dsub(x[m.node[k]], from[m.node[k]]), o));
    } else {
      for (k = 1; k < 4; ++k) c += m.weight[k] * ddot(m.normal, dsub(x[m.node[k]], o));
    }
    for (k = 0; k < 4; ++k) {
      double mobility = m.weight[k] * m.weight[k] * inverse_mass[m.node[k]];
      if (m.node[k] < rows) split += mobility * (double)(row[m.node[k] + 1] - row[m.node[k]]);
    }
    constraint[i] = (zones ? 0.0 : m.target) - c;
    majorant[i] = m.repeated ? 0.0 : split;
  }
}

#define PUSH_TEAM 256       /* members of a team, and impacts where there are many */
#define PUSH_IMPACTS 1024   /* most impacts of a team that solves alone */
/* Places in the scalars of an iteration: */
#define PUSH_T 0            /* t of Nesterov's sequence */
#define PUSH_MOMENTUM 1     /* of extrapolated points */
#define PUSH_MOVED 2        /* |change|^2 in the majorant's norm */
#define PUSH_SIZE 3         /* |lambda|^2 in the majorant's norm */
#define PUSH_COUNT 4
#define SPREAD_TEAMS 512    /* beyond so many teams, their sums are found in a launch of their own */

/* Of an impact at one of its vertices: the weight and the normal, in the order of the incidence. */
typedef struct ALIGNED(32) {
  double weight;
  dvec3 normal;
} impact_share;

/* Of an entry of the incidence: its cloth vertex if it is the first of the vertex's row, else -1; the row's end. */
typedef struct ALIGNED(8) {
  int vertex, end;
} row_head;

/* Row i of S p, S = J M^-1 J'; y: M^-1 J' p of cloth vertices. */
DEVICE double impulse_response(impact m, int rows, GLOBAL const dvec3 *y)
{
  double sum = 0.0;
  int k;
  for (k = 0; k < 4; ++k)
    if (m.node[k] < rows) sum += m.weight[k] * ddot(m.normal, y[m.node[k]]);
  return sum;
}

/* lambda at the point from which Nesterov's method takes a step. */
DEVICE double extrapolated(impulse p, double momentum) { return p.lambda + momentum * p.change; }

/* Accelerated projected gradient on min lambda' S lambda / 2 - constraint' lambda, lambda >= 0. Of impact m one
   step from the extrapolated point p: lambda = max(0, p + (constraint - S p) / majorant); y: M^-1 J' p. Adds to
   sums[PUSH_TEAM c], c = 0, 1, 2: gradient mapping times change, |change|^2, |lambda|^2, the latter two in the
   majorant's norm. */
DEVICE void push_one(impact m, double constraint, double majorant, int rows, GLOBAL const dvec3 *y, double momentum,
                     GLOBAL impulse *own, LOCAL double *sums)
{
  const double gradient = constraint - impulse_response(m, rows, y), p = extrapolated(*own, momentum);
  impulse next;
  next.lambda = majorant > 0.0 ? max_double(0.0, p + gradient / majorant) : 0.0;
  next.change = next.lambda - own->lambda;
  sums[0] += (next.lambda - p) * majorant * next.change;
  sums[PUSH_TEAM] += majorant * next.change * next.change;
  sums[2 * PUSH_TEAM] += next.lambda * majorant * next.lambda;
  *own = next;
}

/* One step of all impacts, from the scalars at `at`. Sums over the PUSH_TEAM impacts of team t, of n: partial[t] along,
   partial[n + 2 t ...] the other two. */
KERNEL push_impulses(int n, int count, int rows, GLOBAL const impact *impacts, GLOBAL const dvec3 *y,
                     GLOBAL const double *constraint, GLOBAL const double *majorant, int at,
                     GLOBAL const double *scalar, GLOBAL impulse *impulses, GLOBAL double *partial)
{
  TEAM_LOCAL(double, sums, 3 * PUSH_TEAM);
  FOR_EACH_TEAM_EARLY(t, n) {
    TEAM_BARRIER;
    TEAM_FOR(l, PUSH_TEAM) {
      const int i = t * PUSH_TEAM + l, some = min_int(i, count - 1);
      const impact m = impacts[some];
      const double own_constraint = constraint[some], own_majorant = majorant[some];
      AWAIT_LAUNCHES;
      sums[l] = sums[PUSH_TEAM + l] = sums[2 * PUSH_TEAM + l] = 0.0;
      if (i < count)
        push_one(m, own_constraint, own_majorant, rows, y, scalar[at + PUSH_MOMENTUM], impulses + i, sums + l);
    }
    tree_sums(PUSH_TEAM, 3, sums);
    TEAM_FOR(c, 3) partial[c ? n + 2 * t + c - 1 : t] = sums[c * PUSH_TEAM];
  }
}

/* t of Nesterov's sequence after `before`, and how far to go on; the sequence restarts when the step went against the
   momentum: along < 0. From 0 it goes to 1. */
DEVICE double next_momentum(double before, double along, double *momentum)
{
  double next;
  if (along < 0.0) before = 1.0;
  next = 0.5 * (1.0 + sqrt(1.0 + 4.0 * before * before));
  *momentum = along < 0.0 ? 0.0 : (before - 1.0) / next;
  return next;
}

/* y_v = m_v^-1 sum over impacts at cloth vertex v of w n p, p extrapolated. incidence: 4 * impact + local index. */
DEVICE dvec3 impulse_at(int v, GLOBAL const int *row, GLOBAL const int *incidence, GLOBAL const impact *impacts,
                        GLOBAL const double *inverse_mass, double momentum, GLOBAL const impulse *impulses)
{
  dvec3 sum = dvec3_make(0.0, 0.0, 0.0);
  int k;
  for (k = row[v]; k < row[v + 1]; ++k) {
    int e = incidence[k] >> 2;
    sum = daxpy(sum, impacts[e].weight[incidence[k] & 3] * extrapolated(impulses[e], momentum), impacts[e].normal);
  }
  return dscale(inverse_mass[v], sum);
}
KERNEL spread_impulses(int n, GLOBAL const int *row, GLOBAL const int *incidence, GLOBAL const impact *impacts,
                       GLOBAL const double *inverse_mass, GLOBAL const impulse *impulses, GLOBAL dvec3 *y)
{
  FOR_EACH(i, n) y[i] = impulse_at(i, row, incidence, impacts, inverse_mass, 0.0, impulses);
}

/* The cloth vertex of entry l if that is the first of its row, else -1. */
DEVICE int first_of_row(int l, int rows, GLOBAL const impact *impacts, GLOBAL const int *row,
                        GLOBAL const int *incidence)
{
  int v = impacts[l >> 2].node[l & 3];
  return v < rows && incidence[row[v]] == l ? v : -1;
}
/* head, share: [entries of the incidence]. At least one launch follows before spread_extrapolated, which reads them
   early. n: 4 impacts, at least as many. */
KERNEL list_shares(int n, int rows, GLOBAL const impact *impacts, GLOBAL const int *row, GLOBAL const int *incidence,
                   GLOBAL row_head *head, GLOBAL impact_share *share)
{
  FOR_EACH(k, n) {
    if (k < row[rows]) {
      const int e = incidence[k] >> 2, at = incidence[k] & 3, v = impacts[e].node[at];
      impact_share s;
      row_head h;
      h.vertex = row[v] == k ? v : -1;
      h.end = row[v + 1];
      s.weight = impacts[e].weight[at];
      s.normal = impacts[e].normal;
      head[k] = h;
      share[k] = s;
    }
  }
}

/* Updates the scalars at `from` to those at `to` by the sums of `teams` teams, for spread_extrapolated where they are
   many. n = 1. */
KERNEL find_momentum(int n, int teams, GLOBAL const double *partial, int from, int to, GLOBAL double *scalar)
{
  TEAM_LOCAL(double, sums, PUSH_TEAM);
  FOR_EACH_TEAM(t, n) {
    sum_of_teams(PUSH_TEAM, 1, teams, partial, sums);
    TEAM_FOR(l, 1) {
      double momentum;
      scalar[to + PUSH_T] = next_momentum(scalar[from + PUSH_T], sums[0], &momentum);
      scalar[to + PUSH_MOMENTUM] = momentum;
    }
  }
}

/* What an impact gives to one of its vertices: w n p, p extrapolated. */
DEVICE dvec3 given_by(impact_share s, impulse p, double momentum)
{
  return dscale(s.weight * extrapolated(p, momentum), s.normal);
}

/* Spreads the extrapolated impulses to the vertices with impacts, as impulse_at does. Team t has the PUSH_TEAM entries
   of the incidence from PUSH_TEAM t on and the rows that begin there: its members find what each entry gives, and the
   one that is the first of a row adds the row in order. Where teams > 0, every team first updates the scalars at `from`
   to those at `to` for itself, as find_momentum does. */
KERNEL spread_extrapolated(int n, int teams, GLOBAL const double *partial, int from, int to, GLOBAL double *scalar,
                           int rows, GLOBAL const int *row, GLOBAL const int *incidence, GLOBAL const row_head *head,
                           GLOBAL const impact_share *share, GLOBAL const double *inverse_mass,
                           GLOBAL const impulse *impulses, GLOBAL dvec3 *y)
{
  TEAM_LOCAL(double, sums, PUSH_TEAM);
  TEAM_LOCAL(impact_share, own_shares, PUSH_TEAM); /* their normals become what they give */
  TEAM_LOCAL(row_head, own_heads, PUSH_TEAM);
  TEAM_LOCAL(int, own_impacts, PUSH_TEAM);
  TEAM_LOCAL(row_head, open_row, 1); /* the row that goes on behind the entries */
  TEAM_LOCAL(dvec3, open_sum, 1);
  FOR_EACH_TEAM_EARLY(t, n) {
    const int first = t * PUSH_TEAM, count = min_int(row[rows] - first, PUSH_TEAM);
    LOCAL impact_share *const shares = TEAM_POINTER(LOCAL impact_share, own_shares);
    LOCAL row_head *const heads = TEAM_POINTER(LOCAL row_head, own_heads);
    LOCAL int *const of = TEAM_POINTER(LOCAL int, own_impacts);
    double momentum = 0.0;
    int at;
    TEAM_BARRIER;
    TEAM_FOR(l, 1) open_row[0].vertex = -1;
    TEAM_FOR(l, count) {
      shares[l] = share[first + l];
      heads[l] = head[first + l];
      of[l] = incidence[first + l] >> 2;
    }
    AWAIT_LAUNCHES;
    if (count <= 0) continue;
    TEAM_BARRIER;
    if (teams > 0) {
      double next;
      sum_of_teams(PUSH_TEAM, 1, teams, partial, sums);
      next = next_momentum(scalar[from + PUSH_T], sums[0], &momentum);
      if (t == 0)
        TEAM_FOR(l, 1) {
          scalar[to + PUSH_T] = next;
          scalar[to + PUSH_MOMENTUM] = momentum;
        }
    } else {
      momentum = scalar[to + PUSH_MOMENTUM];
    }
    TEAM_FOR(l, count) shares[l].normal = given_by(shares[l], impulses[of[l]], momentum);
    TEAM_BARRIER;
    TEAM_FOR(l, count) {
      const row_head own = heads[l];
      if (own.vertex >= 0) {
        const double mobility = inverse_mass[own.vertex];
        const int end = min_int(own.end - first, count);
        dvec3 sum = dvec3_make(0.0, 0.0, 0.0);
        int k;
        for (k = l; k < end; ++k) sum = dadd(sum, shares[k].normal);
        if (own.end > first + count) {
          open_row[0] = own;
          open_sum[0] = sum;
        } else {
          y[own.vertex] = dscale(mobility, sum);
        }
      }
    }
    TEAM_BARRIER;
    if (open_row[0].vertex < 0) continue;
    for (at = first + count; at < open_row[0].end; at += PUSH_TEAM) {
      const int more = min_int(open_row[0].end - at, PUSH_TEAM);
      TEAM_FOR(l, more) shares[l].normal = given_by(share[at + l], impulses[incidence[at + l] >> 2], momentum);
      TEAM_BARRIER;
      TEAM_FOR(l, 1)
        for (int k = 0; k < more; ++k) open_sum[0] = dadd(open_sum[0], shares[k].normal);
      TEAM_BARRIER;
    }
    TEAM_FOR(l, 1) y[open_row[0].vertex] = dscale(inverse_mass[open_row[0].vertex], open_sum[0]);
  }
}

/* How far the last step went, at `at`: n = 1. */
KERNEL measure_step(int n, int teams, GLOBAL const double *partial, int at, GLOBAL double *scalar)
{
  TEAM_LOCAL(double, sums, 2 * PUSH_TEAM);
  FOR_EACH_TEAM(t, n) {
    sum_of_teams(PUSH_TEAM, 2, teams, partial + teams, sums);
    TEAM_FOR(l, 1) {
      scalar[at + PUSH_MOVED] = sums[0];
      scalar[at + PUSH_SIZE] = sums[PUSH_TEAM];
    }
  }
}

/* All steps for at most PUSH_IMPACTS impacts, by one team (n = 1), with the results of spread_extrapolated and
   push_impulses in turn. They end after `most`, or where after a multiple of `check` |change| is at most `tolerance`
   |lambda|. */
KERNEL solve_few_impacts(int n, int count, int rows, int most, int check, double tolerance, GLOBAL const int *row,
                         GLOBAL const int *incidence, GLOBAL const impact *impacts, GLOBAL const double *inverse_mass,
                         GLOBAL const double *constraint, GLOBAL const double *majorant, GLOBAL dvec3 *y,
                         GLOBAL impulse *impulses)
{
  TEAM_LOCAL(double, sums, 3 * PUSH_TEAM);
  TEAM_LOCAL(int, pushed, 4 * PUSH_IMPACTS);
  TEAM_LOCAL(int, pushed_count, 1);
  FOR_EACH_TEAM(t, n) {
    double sequence = 1.0, momentum = 0.0;
    int step, ended = 0;
    TEAM_FOR(l, 1) pushed_count[l] = 0;
    TEAM_FOR(i, count) impulses[i].lambda = impulses[i].change = 0.0;
    TEAM_BARRIER;
    TEAM_FOR(l, 4 * count) {
      int v = first_of_row(l, rows, impacts, row, incidence);
      if (v >= 0) pushed[local_add_int(pushed_count, 1)] = v;
    }
    TEAM_BARRIER;
    for (step = 1; step <= most && !ended; ++step) {
      TEAM_FOR(l, pushed_count[0])
        y[pushed[l]] = impulse_at(pushed[l], row, incidence, impacts, inverse_mass, momentum, impulses);
      TEAM_BARRIER;
      TEAM_FOR(l, PUSH_TEAM) {
        int i;
        sums[l] = sums[PUSH_TEAM + l] = sums[2 * PUSH_TEAM + l] = 0.0;
        for (i = l; i < count; i += PUSH_TEAM)
          push_one(impacts[i], constraint[i], majorant[i], rows, y, momentum, impulses + i, sums + l);
      }
      tree_sums(PUSH_TEAM, 3, sums);
      sequence = next_momentum(sequence, sums[0], &momentum);
      ended = step % check == 0 && sums[PUSH_TEAM] <= tolerance * tolerance * sums[2 * PUSH_TEAM];
      TEAM_BARRIER;
    }
  }
}

/* length[i]: length of the motion of vertex i from x to y, m. */
KERNEL motion_lengths(int n, GLOBAL const dvec3 *x, GLOBAL const dvec3 *y, GLOBAL double *length)
{
  FOR_EACH(i, n) {
    length[i] = dnorm(dsub(y[i], x[i]));
  }
}
/* farthest[i]: how far impacts i, i + n, .. < count may move a vertex, m: twice the longest motion of their vertices
   plus the target distance. */
KERNEL farthest_pushes(int n, int count, GLOBAL const impact *impacts, GLOBAL const double *length,
                       GLOBAL double *farthest)
{
  FOR_EACH(i, n) {
    double most = 0.0;
    int k, a;
    for (k = i; k < count; k += n)
      for (a = 0; a < 4; ++a) most = max_double(most, 2.0 * length[impacts[k].node[a]] + impacts[k].target);
    farthest[i] = most;
  }
}
KERNEL largest_of(int n, int count, GLOBAL const double *value, GLOBAL double *largest)
{
  FOR_EACH(i, n) {
    double most = value[i];
    int k;
    for (k = i + n; k < count; k += n) most = max_double(most, value[k]);
    largest[i] = most;
  }
}

/* x += y = M^-1 J' lambda for cloth vertices, with impact zones from the position that the solve proposed, but no
   further than farthest[0] from that: impacts that cannot all be resolved, between closing obstacles, could move a
   vertex arbitrarily far. moved[i] = 1 where x changes. */
KERNEL apply_impulses(int n, int zones, GLOBAL const double *farthest, GLOBAL const dvec3 *wanted,
                      GLOBAL const dvec3 *y, GLOBAL dvec3 *x, GLOBAL int *moved)
{
  FOR_EACH(i, n) {
    const double most = farthest[0], length = dnorm(y[i]);
    const dvec3 before = x[i], start = zones ? wanted[i] : before, d = dsub(dadd(start, y[i]), wanted[i]);
    const double away = dnorm(d);
    if (zones || length > 0.0) x[i] = away > most ? daxpy(wanted[i], most / away, d) : dadd(start, y[i]);
    moved[i] = zones ? x[i].x != before.x || x[i].y != before.y || x[i].z != before.z : length > 0.0;
  }
}

#define LARGEST_STRETCH 1.5 /* of an edge in one step, beyond which the step is too long */

/* count[0]: incremented for each edge of cloth that the motion x to y makes over LARGEST_STRETCH times as long. rest:
   [edges] lengths at rest, m, or null; an edge that was shorter, which springs back, counts from its length at rest. */
KERNEL count_stretched(int n, int cloth_vertices, GLOBAL const edge_nodes *edge, GLOBAL const float *rest,
                       GLOBAL const dvec3 *x, GLOBAL const dvec3 *y, GLOBAL int *count)
{
  FOR_EACH(i, n) {
    const edge_nodes e = edge[i];
    if (e.node[0] < cloth_vertices) {
      const double before = max_double(dnorm(dsub(x[e.node[1]], x[e.node[0]])), rest ? (double)rest[i] : 0.0);
      if (dnorm(dsub(y[e.node[1]], y[e.node[0]])) > LARGEST_STRETCH * before) atomic_add_int(count, 1);
    }
  }
}

/* count[0]: incremented for each edge of cloth that the motion x to y moves by more than its length. */
KERNEL count_far_moved(int n, int cloth_vertices, GLOBAL const edge_nodes *edge, GLOBAL const dvec3 *x,
                       GLOBAL const dvec3 *y, GLOBAL int *count)
{
  FOR_EACH(i, n) {
    const edge_nodes e = edge[i];
    if (e.node[0] < cloth_vertices && dnorm(dsub(y[e.node[0]], x[e.node[0]])) > dnorm(dsub(x[e.node[1]], x[e.node[0]])))
      atomic_add_int(count, 1);
  }
}

#endif
