/* SPDX-License-Identifier: Apache-2.0 */
/* Contact that stops cloth within a step of BDF2. The formula takes an impulse P as part of a smooth force: it changes
   the velocity of a mass m by P / m and its position by h P / m. What stopped the motion abruptly moved the vertex by
   the same, but over the whole time step dt: its impulse is h / dt of P, and the next step must not carry it on.
   Without this correction contact would be elastic. */
#ifndef CAMA_KERNELS_SYSTEM_ABRUPT_H
#define CAMA_KERNELS_SYSTEM_ABRUPT_H
#include "../collision/pair.h"
#include "../dialect/dvec3.h"
#include "../dialect/lang.h"
#include "../dialect/vec3.h"
#include "term.h"

#define ROUGH_MOST 2.0 /* sliding friction has the push after the first solve, which later ones change */

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
    const int end = row[i + 1];
    double sum = 0.0;
    int k;
    for (k = row[i]; k < end; k += AT_ONCE(8)) {
      int at[AT_ONCE(8)];
      double own[AT_ONCE(8)];
      FOR_AT_ONCE(q, 8, end - k) at[q] = incidence[k + q];
      FOR_AT_ONCE(q, 8, end - k)
        if ((at[q] >> 2) < contacts) own[q] = fabs((double)terms[at[q] >> 2].weight[at[q] & 3]) * push[at[q] >> 2];
      FOR_AT_ONCE(q, 8, end - k)
        if ((at[q] >> 2) < contacts) sum += own[q];
    }
    load[i] = sum;
  }
}

/* Sum of w^2 / m of a contact, 1/kg, where each cloth vertex gives it the share of its mass that the contact has in the
   vertex's load. push: N s. */
DEVICE double pushed_mobility(term t, double push, int cloth_vertices, GLOBAL const double *inverse_mass,
                              GLOBAL const double *load)
{
  double sum = 0.0;
  int a;
  for (a = 0; a < 4; ++a) {
    int v = t.node[a];
    double w = (double)t.weight[a], own = fabs(w) * push;
    if (v < cloth_vertices && own > 0.0) sum += w * w * inverse_mass[v] * (load[v] / own);
  }
  return sum;
}

/* Sum of w v of a contact along its tangent plane, m/s. */
DEVICE dvec3 tangential(term t, GLOBAL const dvec3 *velocity)
{
  dvec3 s = dvec3_make(0.0, 0.0, 0.0), normal = to_dvec3(t.normal);
  int a;
  for (a = 0; a < 4; ++a) s = daxpy(s, (double)t.weight[a], velocity[t.node[a]]);
  return daxpy(s, -ddot(normal, s), normal);
}

/* abrupt[i]: the part of the impulse of contact i that stopped motion abruptly, on its side A, N s: of the push as much
   as stops the approach that the sides of the contact had at the start of the step, of the friction the same share, if
   `rough`, but no more than ROUGH_MOST times what the coefficient allows: the tangential speed that sticking friction
   leaves is an error of the solve and tells nothing of the force. The term loses it. share: h / dt. start, velocity:
   before and after the solve, m/s. hold: of friction_impulse, or none. rigid: 1 for vertices of rigid bodies, or none:
   on these a contact is abrupt if all of its push stops cloth, since a body that rests is borne by the others and would
   vibrate on what the split makes of them. n: contacts. */
KERNEL abrupt_impulses(int n, double share, int cloth_vertices, int rough, GLOBAL const int *rigid,
                       GLOBAL const contact *contacts, GLOBAL const double *inverse_mass, GLOBAL const double *push,
                       GLOBAL const double *load, GLOBAL const dvec3 *start, GLOBAL const dvec3 *velocity,
                       GLOBAL term *terms, GLOBAL vec3 *hold, GLOBAL dvec3 *abrupt)
{
  FOR_EACH(i, n) {
    term t = terms[i];
    dvec3 normal = to_dvec3(t.normal);
    double separation = 0.0, mobility = pushed_mobility(t, push[i], cloth_vertices, inverse_mass, load), part = 0.0;
    int a, bears = 0;
    for (a = 0; a < 4; ++a) {
      separation += (double)t.weight[a] * ddot(normal, start[t.node[a]]);
      if (rigid && rigid[t.node[a]]) bears = 1;
    }
    if (separation < 0.0 && mobility > 0.0) part = min_double(push[i], -separation / (share * mobility));
    if (bears && part < push[i]) part = 0.0;
    terms[i].push = t.push - (real)part;
    abrupt[i] = dscale(part, normal);
    if (rough && part > 0.0) {
      dvec3 rough_part = dscale(-(double)t.around, tangential(t, velocity));
      double own = part / push[i], size, most = ROUGH_MOST * contacts[i].static_friction * part;
      real around;
      if (hold) rough_part = dadd(rough_part, to_dvec3(hold[i]));
      size = own * dnorm(rough_part);
      if (size > most) own *= most / size;
      around = (real)(own * (double)t.around);
      terms[i].around = t.around - around;
      terms[i].along = t.along + around;
      if (hold) hold[i] = axpy(hold[i], -(real)own, hold[i]);
      abrupt[i] = daxpy(abrupt[i], own, rough_part);
    }
  }
}

/* change[i]: of the velocity of cloth vertex i by abrupt impulses, m/s; zero if it is prescribed. */
KERNEL abrupt_changes(int n, int contacts, GLOBAL const int *row, GLOBAL const int *incidence, GLOBAL const term *terms,
                      GLOBAL const double *inverse_mass, GLOBAL const dvec3 *abrupt, GLOBAL dvec3 *change)
{
  FOR_EACH(i, n) {
    const int end = row[i + 1];
    dvec3 sum = dvec3_make(0.0, 0.0, 0.0);
    int k;
    for (k = row[i]; k < end; k += AT_ONCE(8)) {
      int at[AT_ONCE(8)];
      double weight[AT_ONCE(8)];
      dvec3 own[AT_ONCE(8)];
      FOR_AT_ONCE(q, 8, end - k) at[q] = incidence[k + q];
      FOR_AT_ONCE(q, 8, end - k)
        if ((at[q] >> 2) < contacts) {
          weight[q] = (double)terms[at[q] >> 2].weight[at[q] & 3];
          own[q] = abrupt[at[q] >> 2];
        }
      FOR_AT_ONCE(q, 8, end - k)
        if ((at[q] >> 2) < contacts) sum = daxpy(sum, weight[q], own[q]);
    }
    change[i] = dscale(inverse_mass[i], sum);
  }
}

#endif
