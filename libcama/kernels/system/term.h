/* SPDX-License-Identifier: Apache-2.0 */
/* Terms: elements of the system that couple up to four nodes through weights. They are contacts (paper, Equation 2 and
   Algorithm 2), friction and stitches. Block (a, b) of a term is c_ab (along n n' + around I). */
#ifndef CAMA_KERNELS_SYSTEM_TERM_H
#define CAMA_KERNELS_SYSTEM_TERM_H
#include "../collision/contact.h"
#include "../collision/pair.h"
#include "../dialect/dvec3.h"
#include "../dialect/lang.h"
#include "../dialect/vec3.h"

#define FORM_RANK_ONE 0 /* c_ab = w_a w_b: the Jacobian of the penalty force with a constant normal */
#define FORM_STAR 1 /* the paper's Algorithm 2: springs from every node of one side to every node of the other */

typedef struct {
  int node[4]; /* -1: unused */
  real weight[4]; /* sum_k w_k x_k is the difference vector; positive on side A, negative on side B */
  vec3 normal; /* from side B to side A */
  real along; /* coefficient of n n' in the matrix, kg */
  real around; /* coefficient of I in the matrix, kg */
  real push; /* right-hand side along the normal, kg m/s */
} term;

DEVICE real term_coupling(term t, int form, int a, int b)
{
  real w = t.weight[a] * t.weight[b];
  if (form == FORM_RANK_ONE) return w;
  if (a == b) return t.weight[a] < (real)0 ? -t.weight[a] : t.weight[a];
  return w < (real)0 ? w : (real)0;
}

DEVICE mat3 term_block(term t, int form, int a, int b)
{
  real c = term_coupling(t, form, a, b);
  return mat3_add_outer(mat3_diagonal(c * t.around), c * t.along, t.normal, t.normal);
}

/* Friction is a damping coefficient phi (N s/m) on the tangential velocity of a contact. free_speed: the tangential
   speed that it would have after the step without friction and without its neighbours, m/s; effective_mass:
   1 / sum w^2/m, kg; static_friction >= friction. A contact that sticks keeps 1/STICKING of what a step adds. */
#define STICKING ((real)1000)

/* phi for a step of one solve: the contact sticks if static_friction N can stop it within the step, and otherwise
   slides with the force friction N. */
DEVICE real friction_alone(real static_friction, real friction, real normal_force, real free_speed, real effective_mass,
                           real time_step)
{
  real stopping = free_speed * effective_mass / time_step, cone = friction * normal_force,
       most = STICKING * effective_mass / time_step;
  if (!(static_friction * normal_force > (real)0)) return (real)0;
  if (stopping <= static_friction * normal_force) return most;
  return min_real(most, cone / (free_speed * ((real)1 - cone / stopping)));
}

/* Friction of a contact in a step of several solves: force - damping v, with v its tangential velocity, N and N s/m. */
typedef struct {
  dvec3 force;
  double damping;
} friction_law;

/* Coulomb's law around an iterate at which the contact has the tangential velocity `velocity` and the friction `force`,
   N on side A. It sticks if the force that stops it within the step, with its neighbours as they are, is within the
   cone; then the force stays as it is and the damping takes what is left of the velocity. Otherwise it slides with
   friction N where it has the velocity `expected`; damping keeps it from reversing, the less the faster it is, or would
   be if the force that holds it were gone. Friction is static up to SLOW of the change of speed that it can make in the
   step. */
#define SLOW 0.1
#define HELD 100.0 /* like STICKING; the force of one solve is that from which the next starts */
#define OVERPOWERED 4.0
DEVICE friction_law friction_around(double static_friction, double friction, double normal_force, dvec3 force,
                                    dvec3 velocity, dvec3 expected, double effective_mass, double time_step)
{
  friction_law law;
  const double mobility = time_step / effective_mass;
  const dvec3 trial = daxpy(force, -1.0 / mobility, velocity);
  const double size = dnorm(trial), speed = dnorm(velocity);
  double cone = static_friction * normal_force;
  const double fastest = max_double(speed, (size - OVERPOWERED * cone) * mobility);
  law.force = dvec3_make(0.0, 0.0, 0.0);
  law.damping = 0.0;
  if (!(cone > 0.0)) return law;
  if (fastest > SLOW * cone * mobility) cone = friction * normal_force;
  if (size <= cone) {
    law.force = force;
    law.damping = HELD / mobility;
    if (law.damping * speed > OVERPOWERED * cone) law.damping = OVERPOWERED * cone / speed;
  } else {
    law.damping = cone / max_double(fastest, cone * mobility);
    law.force = daxpy(dscale(cone / size, trial), law.damping, expected);
  }
  return law;
}

/* sum_k w_k^2 / m_k, 1/kg, where each vertex gives a contact the share of its mass that the contact has in the vertex's
   total load, so that all contacts of a vertex together stop it. load: [cloth vertices], N. */
DEVICE double shared_mobility(contact c, GLOBAL const double *inverse_mass, GLOBAL const double *load)
{
  double sum = 0.0, own = contact_load(c);
  int a;
  for (a = 0; a < 4; ++a) {
    double w = fabs(c.weight[a]);
    if (inverse_mass[c.node[a]] > 0.0 && w * own > 0.0)
      sum += w * w * inverse_mass[c.node[a]] * (load[c.node[a]] / (w * own));
  }
  return sum;
}

/* Stiffens contacts that the current forces press harder than their penalty balances at half the thickness: stretched
   cloth would otherwise close them and leave them to impacts, whose projection considers masses only. force: of
   elements, gravity and wind, N. */
KERNEL stiffen_contacts(int n, int cloth_vertices, GLOBAL const double *inverse_mass, GLOBAL const vec3 *force,
                        GLOBAL contact *contacts)
{
  FOR_EACH(i, n) {
    contact c = contacts[i];
    double pull = 0.0, mobility = 0.0, load;
    int a;
    if (!(c.distance < c.thickness)) continue;
    for (a = 0; a < 4; ++a) {
      int v = c.node[a];
      if (v >= cloth_vertices || !(inverse_mass[v] > 0.0)) continue;
      pull -= c.weight[a] * inverse_mass[v] * ddot(c.normal, to_dvec3(force[v]));
      mobility += c.weight[a] * c.weight[a] * inverse_mass[v];
    }
    load = mobility > 0.0 ? pull / mobility : 0.0;
    if (load > 0.5 * c.stiffness * c.thickness) contacts[i].stiffness = 2.0 * load / c.thickness;
  }
}

/* Terms from contacts. Penalty E = k (d - thickness)^2 / 2 while d < thickness, linearised: matrix dt^2 k, push dt k
   (thickness - d). Friction is that of a step of one solve. free_velocity: after this step without contact, m/s. */
KERNEL make_contact_terms(int n, GLOBAL const contact *contacts, GLOBAL const double *inverse_mass,
                          GLOBAL const dvec3 *free_velocity, GLOBAL const double *load, real time_step,
                          GLOBAL term *terms)
{
  FOR_EACH(i, n) {
    contact c = contacts[i];
    term t;
    double mobility = shared_mobility(c, inverse_mass, load);
    dvec3 end = dvec3_make(0.0, 0.0, 0.0);
    real k = (real)c.stiffness, depth = (real)(c.thickness - c.distance), damping = (real)0;
    int a;
    for (a = 0; a < 4; ++a) {
      t.node[a] = c.node[a];
      t.weight[a] = (real)c.weight[a];
      end = daxpy(end, c.weight[a], free_velocity[c.node[a]]);
    }
    end = daxpy(end, -ddot(end, c.normal), c.normal);
    if (mobility > 0.0)
      damping = time_step * friction_alone((real)c.static_friction, (real)c.friction, (real)contact_load(c),
                                           (real)dnorm(end), (real)(1.0 / mobility), time_step);
    t.normal = to_vec3(c.normal);
    t.along = time_step * time_step * k - damping;
    t.around = damping;
    t.push = time_step * k * depth;
    terms[i] = t;
  }
}

/* N with which the other contacts of its vertices press contact c, below 0 where they pull its sides apart. push: sum
   of the penalty forces on each cloth vertex, N. */
DEVICE double pinching_load(contact c, GLOBAL const double *inverse_mass, GLOBAL const dvec3 *push)
{
  double pull = 0.0, mobility = 0.0;
  int a;
  for (a = 0; a < 4; ++a) {
    double share = c.weight[a] * inverse_mass[c.node[a]];
    if (share == 0.0) continue;
    pull += share * ddot(c.normal, push[c.node[a]]);
    mobility += share * c.weight[a];
  }
  return mobility > 0.0 ? contact_load(c) - pull / mobility : 0.0;
}

/* The load of a contact before the first solve is at most this times what presses it alone, or what other contacts
   press it with, as the pads of a gripper do: an impact can leave a contact deeper than any force has pressed it. */
#define LAYERS 30.0

/* Without a further solve, which would know the velocities after the first, a contact that is faster than FAST of what
   its friction can change in the step is expected to end as it would with this friction and the forces of the start; a
   slower one has too much of these from its neighbours. */
#define FAST 0.5

/* Adds friction to terms without it before the only solve, or the first of several. velocity, free_velocity: at the
   start, and after this step without contact, m/s. push: of vertex_pushes, N. kept: friction of each contact at the end
   of the last step, N on side A; zero if it is new: then it slides if it is not slow. hold: impulse that friction would
   have at rest, N s on side A. */
KERNEL expect_friction(int n, int several, GLOBAL const contact *contacts, GLOBAL const double *inverse_mass,
                       GLOBAL const dvec3 *velocity, GLOBAL const dvec3 *base_velocity, double carry,
                       GLOBAL const dvec3 *free_velocity, GLOBAL const double *load, GLOBAL const dvec3 *push,
                       GLOBAL const dvec3 *kept, real time_step, GLOBAL term *terms, GLOBAL vec3 *hold)
{
  FOR_EACH(i, n) {
    contact c = contacts[i];
    const double h = (double)time_step, mobility = shared_mobility(c, inverse_mass, load);
    friction_law law;
    law.force = dvec3_make(0.0, 0.0, 0.0);
    law.damping = 0.0;
    if (mobility > 0.0) {
      dvec3 start = dvec3_make(0.0, 0.0, 0.0), end = start, change = start, force = kept[i];
      double rise, press, alone, speed, before;
      int a;
      for (a = 0; a < 4; ++a) {
        start = daxpy(start, c.weight[a], velocity[c.node[a]]);
        end = daxpy(end, c.weight[a], free_velocity[c.node[a]]);
        change = daxpy(change, carry * c.weight[a], dsub(base_velocity[c.node[a]], velocity[c.node[a]]));
      }
      rise = ddot(end, c.normal);
      start = daxpy(start, -ddot(start, c.normal), c.normal);
      change = daxpy(change, -ddot(change, c.normal), c.normal);
      force = daxpy(force, -ddot(force, c.normal), c.normal);
      alone =
          c.stiffness * max_double(c.thickness - c.distance - h * rise, 0.0) / (1.0 + c.stiffness * h * h * mobility);
      press = min_double(contact_load(c), max_double(LAYERS * alone, pinching_load(c, inverse_mass, push)));
      speed = dnorm(start);
      before = dnorm(force);
      if (speed > SLOW * c.static_friction * press * h * mobility) {
        if (several) press = min_double(press, before > 0.0 ? before / c.friction : alone);
        if (!(before > 0.0)) force = dscale(-c.friction * press / speed, start);
      }
      if (!several && speed > FAST * c.friction * press * h * mobility) {
        const double left = ddot(end, start) / speed - c.friction * press * h * mobility;
        change = dscale(max_double(left, 0.0) / speed - 1.0, start);
      }
      law = friction_around(c.static_friction, c.friction, press, force, start, dadd(start, change), 1.0 / mobility, h);
    }
    terms[i].around = time_step * (real)law.damping;
    terms[i].along -= terms[i].around;
    hold[i] = scale(time_step, to_vec3(law.force));
  }
}

/* Place of the first of n ascending keys that is at least `value`. */
DEVICE int first_key(int n, GLOBAL const key64 *key, key64 value)
{
  int lo = 0, hi = n;
  while (lo < hi) {
    int middle = (lo + hi) / 2;
    if (key[middle] < value)
      lo = middle + 1;
    else
      hi = middle;
  }
  return lo;
}
DEVICE int has_key(int n, GLOBAL const key64 *key, key64 value)
{
  int at = first_key(n, key, value);
  return at < n && key[at] == value;
}

/* Number of vertices that two faces share. */
DEVICE int shared_nodes(face_nodes f, face_nodes g)
{
  int i, k, sum = 0;
  for (i = 0; i < 3; ++i)
    for (k = 0; k < 3; ++k) sum += f.node[i] == g.node[k];
  return sum;
}

/* kept[i]: the friction that contact i had at the end of the last step, N on side A; zero if it was none. Where its
   vertex has come to this face from a neighbouring one, with which it has no contact any more, it is that contact. key:
   features of the contacts, before_key: of those of the last step, ascending, and their friction. */
KERNEL recall_friction(int n, int before, GLOBAL const face_nodes *face, GLOBAL const key64 *key,
                       GLOBAL const key64 *before_key, GLOBAL const dvec3 *before_force, GLOBAL dvec3 *kept)
{
  FOR_EACH(i, n) {
    const key64 second = (key64)0x7fffffff;
    int at = first_key(before, before_key, key[i]), most = 0;
    dvec3 force = dvec3_make(0.0, 0.0, 0.0);
    if (at < before && before_key[at] == key[i]) {
      force = before_force[at];
    } else if (!(key[i] >> 62)) {
      face_nodes here = face[(int)(key[i] & second)];
      for (at = first_key(before, before_key, key[i] & ~second); at < before && before_key[at] >> 31 == key[i] >> 31;
           ++at) {
        int shared = shared_nodes(here, face[(int)(before_key[at] & second)]);
        if (shared > most && !has_key(n, key, before_key[at])) {
          most = shared;
          force = before_force[at];
        }
      }
    }
    kept[i] = force;
  }
}

/* The same without friction, which needs neither loads nor free velocities. */
KERNEL make_frictionless_terms(int n, GLOBAL const contact *contacts, real time_step, GLOBAL term *terms)
{
  FOR_EACH(i, n) {
    contact c = contacts[i];
    term t;
    real k = (real)c.stiffness, depth = (real)(c.thickness - c.distance);
    int a;
    for (a = 0; a < 4; ++a) {
      t.node[a] = c.node[a];
      t.weight[a] = (real)c.weight[a];
    }
    t.normal = to_vec3(c.normal);
    t.along = time_step * time_step * k;
    t.around = (real)0;
    t.push = time_step * k * depth;
    terms[i] = t;
  }
}

/* Appends stitches to the terms, starting at `first`. The matrix of a spring of rest length L that is l long is
   k (n n' + (1 - L/l) (I - n n')) while it pulls, and zero while it is slack. */
KERNEL make_stitch_terms(int n, GLOBAL const stitch *stitches, GLOBAL const dvec3 *position, real time_step, int first,
                         GLOBAL term *terms)
{
  FOR_EACH(i, n) {
    stitch s = stitches[i];
    term t;
    dvec3 gap =
        daxpy(dsub(position[s.node[0]], position[s.node[1]]), -s.ratio, dsub(position[s.node[2]], position[s.node[1]]));
    double distance = dnorm(gap), stretch = stitch_stretch(s, distance);
    real k = (real)s.stiffness;
    t.node[0] = s.node[0];
    t.node[1] = s.node[1];
    t.node[2] = s.node[2];
    t.node[3] = -1;
    t.weight[0] = (real)1;
    t.weight[1] = -(real)(1.0 - s.ratio);
    t.weight[2] = -(real)s.ratio;
    t.weight[3] = (real)0;
    t.normal = to_vec3(dnormalize(gap));
    t.along = (real)0;
    t.around = time_step * time_step * k;
    t.push = -time_step * k * (real)stretch;
    if (s.length > 0.0) {
      real whole = stretch > 0.0 ? t.around : (real)0;
      t.around = stretch > 0.0 ? whole * (real)(stretch / distance) : (real)0;
      t.along = whole - t.around;
    }
    terms[first + i] = t;
  }
}

/* (along n n' + around I) sum_k w_k x_k of a term (rank-one form). */
DEVICE vec3 term_product(term t, GLOBAL const vec3 *x)
{
  vec3 s = scale(t.weight[0], x[t.node[0]]);
  int a;
  for (a = 1; a < 4; ++a)
    if (t.node[a] >= 0) s = axpy(s, t.weight[a], x[t.node[a]]);
  return axpy(scale(t.around, s), t.along * dot(t.normal, s), t.normal);
}

KERNEL term_products(int n, GLOBAL const term *terms, GLOBAL const vec3 *x, GLOBAL vec3 *product)
{
  FOR_EACH(i, n) product[i] = term_product(terms[i], x);
}

/* y + the sum over the first `count` terms at vertex i of w times what they have in `product`. row, incidence:
   4 * term + local index, sorted within a row. */
DEVICE vec3 add_term_products(int i, int count, GLOBAL const int *row, GLOBAL const int *incidence,
                              GLOBAL const term *terms, GLOBAL const vec3 *product, vec3 y)
{
  const int end = row[i + 1];
  int k = row[i], next[AT_ONCE(4)];
  FOR_AT_ONCE(q, 4, end - k) next[q] = incidence[k + q];
  for (; k < end; k += AT_ONCE(4)) {
    int at[AT_ONCE(4)];
    real weight[AT_ONCE(4)];
    vec3 own[AT_ONCE(4)];
    FOR_AT_ONCE(q, 4, end - k) at[q] = next[q];
    FOR_AT_ONCE(q, 4, end - k - AT_ONCE(4)) next[q] = incidence[k + AT_ONCE(4) + q];
    FOR_AT_ONCE(q, 4, end - k)
      if ((at[q] >> 2) < count) {
        weight[q] = terms[at[q] >> 2].weight[at[q] & 3];
        own[q] = product[at[q] >> 2];
      }
    FOR_AT_ONCE(q, 4, end - k)
      if ((at[q] >> 2) < count) y = axpy(y, weight[q], own[q]);
  }
  return y;
}

/* b + the sum over the terms at vertex i of w push n. */
DEVICE vec3 add_term_pushes(int i, GLOBAL const int *row, GLOBAL const int *incidence, GLOBAL const term *terms, vec3 b)
{
  const int end = row[i + 1];
  int k = row[i], next[AT_ONCE(4)];
  FOR_AT_ONCE(q, 4, end - k) next[q] = incidence[k + q];
  for (; k < end; k += AT_ONCE(4)) {
    int at[AT_ONCE(4)];
    real push[AT_ONCE(4)];
    vec3 normal[AT_ONCE(4)];
    FOR_AT_ONCE(q, 4, end - k) at[q] = next[q];
    FOR_AT_ONCE(q, 4, end - k - AT_ONCE(4)) next[q] = incidence[k + AT_ONCE(4) + q];
    FOR_AT_ONCE(q, 4, end - k) {
      push[q] = terms[at[q] >> 2].weight[at[q] & 3] * terms[at[q] >> 2].push;
      normal[q] = terms[at[q] >> 2].normal;
    }
    FOR_AT_ONCE(q, 4, end - k) b = axpy(b, push[q], normal[q]);
  }
  return b;
}

/* Diagonal blocks: matrix (and, in rank-one operator form, the terms). */
KERNEL add_term_diagonal(int n, GLOBAL const int *row, GLOBAL const int *incidence, GLOBAL const term *terms,
                         GLOBAL mat3 *diagonal)
{
  FOR_EACH(i, n) {
    mat3 sum = diagonal[i];
    int k;
    for (k = row[i]; k < row[i + 1]; ++k)
      sum = mat3_add(sum, term_block(terms[incidence[k] >> 2], FORM_RANK_ONE, incidence[k] & 3, incidence[k] & 3));
    diagonal[i] = sum;
  }
}

#endif
