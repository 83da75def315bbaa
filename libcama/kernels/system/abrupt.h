/* SPDX-License-Identifier: Apache-2.0 */
/* Contact that stops cloth within a step of BDF2. The formula takes an impulse P as part of a smooth force: it changes
   the velocity of a mass m by P / m and its position by h P / m. What stopped the motion abruptly moved the vertex by
   the same, but over the whole time step dt: its impulse is h / dt of P, and the next step must not carry it on.
   Without this correction contact would be elastic. */
#ifndef CAMA_KERNELS_SYSTEM_ABRUPT_H
#define CAMA_KERNELS_SYSTEM_ABRUPT_H
#include "../dialect/dvec3.h"
#include "../dialect/lang.h"
#include "../dialect/vec3.h"
#include "term.h"

/* push[i]: the impulse of contact i along its normal at the end of the solve, N s; 0 where it pulls. newton: the terms
   are those of the solution; otherwise the solve changed the velocities by `change` since. */
KERNEL contact_pushes(int n, int newton, GLOBAL const term *terms, GLOBAL const vec3 *change, GLOBAL double *push)
{
  FOR_EACH(i, n) {
    term t = terms[i];
    real p = t.push;
    int a;
    if (!newton)
      for (a = 0; a < 4; ++a) p -= (t.along + t.around) * t.weight[a] * dot(t.normal, change[t.node[a]]);
    push[i] = max_double((double)p, 0.0);
  }
}

/* load[i]: what presses on cloth vertex i in all, N s. */
KERNEL push_loads(int n, int contacts, GLOBAL const int *row, GLOBAL const int *incidence, GLOBAL const term *terms,
                  GLOBAL const double *push, GLOBAL double *load)
{
  FOR_EACH(i, n) {
    double sum = 0.0;
    int k;
    for (k = row[i]; k < row[i + 1]; ++k) {
      int e = incidence[k] >> 2;
      if (e < contacts) sum += fabs((double)terms[e].weight[incidence[k] & 3]) * push[e];
    }
    load[i] = sum;
  }
}

/* Replaces each push by its abrupt part, and takes that from the term: as much as stops the approach that the sides of
   the contact had at the start of the step. share: h / dt. Each vertex gives a contact the share of its mass that the
   contact has in the vertex's load. n: contacts. */
KERNEL abrupt_pushes(int n, double share, int cloth_vertices, GLOBAL const double *inverse_mass,
                     GLOBAL const double *load, GLOBAL const dvec3 *velocity, GLOBAL term *terms, GLOBAL double *push)
{
  FOR_EACH(i, n) {
    term t = terms[i];
    double separation = 0.0, mobility = 0.0, abrupt = 0.0, p = push[i];
    int a;
    for (a = 0; a < 4; ++a) {
      int v = t.node[a];
      double w = (double)t.weight[a], own = fabs(w) * p;
      separation += w * ddot(to_dvec3(t.normal), velocity[v]);
      if (v < cloth_vertices && own > 0.0) mobility += w * w * inverse_mass[v] * (load[v] / own);
    }
    if (separation < 0.0 && mobility > 0.0) abrupt = min_double(p, -separation / (share * mobility));
    push[i] = abrupt;
    terms[i].push = t.push - (real)abrupt;
  }
}

/* change[i]: of the velocity of cloth vertex i by abrupt pushes, m/s; zero if it is prescribed. */
KERNEL abrupt_changes(int n, int contacts, GLOBAL const int *row, GLOBAL const int *incidence, GLOBAL const term *terms,
                      GLOBAL const double *inverse_mass, GLOBAL const double *abrupt, GLOBAL dvec3 *change)
{
  FOR_EACH(i, n) {
    dvec3 sum = dvec3_make(0.0, 0.0, 0.0);
    int k;
    for (k = row[i]; k < row[i + 1]; ++k) {
      int e = incidence[k] >> 2;
      if (e < contacts)
        sum = daxpy(sum, (double)terms[e].weight[incidence[k] & 3] * abrupt[e], to_dvec3(terms[e].normal));
    }
    change[i] = dscale(inverse_mass[i], sum);
  }
}

#endif
