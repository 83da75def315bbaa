/* SPDX-License-Identifier: Apache-2.0 */
/* Newton's method on the nonlinear equation of a step, R(v) = M (v - v*) - h f(x* + h v, v) = 0, and the incremental
   potential that its line search lowers. v*, x*, h: base of the step (with backward Euler v and x of its start, and
   dt). */
#ifndef CAMA_KERNELS_SYSTEM_NEWTON_H
#define CAMA_KERNELS_SYSTEM_NEWTON_H
#include "../collision/distance.h"
#include "../collision/pair.h"
#include "../dialect/dvec3.h"
#include "../dialect/lang.h"
#include "../dialect/vec3.h"
#include "../elements/bending.h"
#include "../elements/elasticity.h"
#include "abrupt.h"
#include "incidence.h"
#include "term.h"

/* Distance between the sides of a contact at x, negative once they have passed through each other, with its normal and
   weights. refresh: those of the closest points at x; otherwise those that the contact was found with at `start`. */
DEVICE double contact_gap(contact c, int refresh, GLOBAL const dvec3 *start, GLOBAL const dvec3 *x,
                          GLOBAL const vertex_contact *v, dvec3 *normal, double *weight)
{
  double gap = c.distance;
  int a;
  *normal = c.normal;
  for (a = 0; a < 4; ++a) weight[a] = c.weight[a];
  if (refresh) {
    element_nodes e;
    proximity p;
    double sign, radius;
    for (a = 0; a < 4; ++a) e.node[a] = c.node[a];
    radius = pair_radius(c.kind, e, v);
    p = surface_proximity(c.kind, e, x, v);
    sign = p.interior && ddot(p.normal, c.normal) < 0.0 && !pair_has_plane(c.kind, e, v) ? -1.0 : 1.0;
    *normal = dscale(sign, p.normal);
    for (a = 0; a < 4; ++a) weight[a] = p.weight[a];
    return sign * (p.distance + radius) - radius;
  }
  for (a = 0; a < 4; ++a) gap += c.weight[a] * ddot(c.normal, dsub(x[c.node[a]], start[c.node[a]]));
  return gap;
}

/* What a contact does at the iterate. */
typedef struct {
  double depth; /* m: its force over its stiffness, never negative */
  double rate; /* s: how fast that grows with the speed at which its sides approach */
  double energy; /* J: of penalty and damping, as far as the step goes */
  dvec3 normal;
  double weight[4];
} contact_state;

/* Penalty and damping of a contact. The damping is critical for the masses of the contact's own vertices, so that soft
   contacts do not throw cloth back; it is never larger than the penalty, so that the force is continuous and never
   pulls. The depth without damping is base + step s, s being the speed of approach; with it, at least 0 and at most
   twice as much, base + (step + damping) s. The energy is its integral over s, times stiffness and step. damped:
   whether there is damping. step: h. */
DEVICE contact_state contact_at(contact c, int damped, int refresh, double step, GLOBAL const dvec3 *start,
                                GLOBAL const dvec3 *x, GLOBAL const dvec3 *velocity, GLOBAL const double *inverse_mass,
                                GLOBAL const vertex_contact *v)
{
  contact_state r;
  double depth, mobility = 0.0, approach = 0.0, damping, base, share, turn;
  int a;
  depth = max_double(c.thickness - contact_gap(c, refresh, start, x, v, &r.normal, r.weight), 0.0);
  r.depth = depth;
  r.rate = depth > 0.0 ? step : 0.0;
  r.energy = 0.5 * c.stiffness * depth * depth;
  if (!(depth > 0.0) || !damped) return r;
  for (a = 0; a < 4; ++a) {
    mobility += r.weight[a] * r.weight[a] * inverse_mass[c.node[a]];
    approach -= r.weight[a] * ddot(r.normal, velocity[c.node[a]]);
  }
  if (!(mobility > 0.0)) return r;
  damping = 2.0 / sqrt(mobility * c.stiffness);
  base = depth - step * approach;
  share = 0.5 * c.stiffness * step / (step + damping);
  if (damping * approach < -depth) {
    r.depth = r.rate = r.energy = 0.0;
  } else if (damping * approach > depth) {
    r.depth = 2.0 * depth;
    r.rate = 2.0 * step;
    turn = base > 0.0 ? damping * base / (damping - step) : 0.0; /* depth where this begins */
    r.energy = 4.0 * share * turn * turn + c.stiffness * (depth * depth - turn * turn);
  } else {
    r.depth = depth + damping * approach;
    r.rate = step + damping;
    turn = base < 0.0 ? damping * base / (damping - step) : 0.0; /* depth where this begins */
    r.energy = share * (r.depth * r.depth - 4.0 * turn * turn) + c.stiffness * turn * turn;
  }
  return r;
}

/* Terms of contacts at the iterate x, v: a contact that is open there does not push; friction is left as it is.
   holding: contacts that were closed at the start and do not push at x, v act as springs that may pull,
   since what presses them together is not in the prediction. */
KERNEL update_contact_terms(int n, int damped, int refresh, int holding, GLOBAL const contact *contacts,
                            GLOBAL const dvec3 *start, GLOBAL const dvec3 *x, GLOBAL const dvec3 *velocity,
                            GLOBAL const double *inverse_mass, GLOBAL const vertex_contact *v, real step,
                            GLOBAL term *terms)
{
  FOR_EACH(i, n) {
    contact c = contacts[i];
    contact_state s = contact_at(c, damped, refresh, (double)step, start, x, velocity, inverse_mass, v);
    int a;
    if (holding && !(s.depth > 0.0) && c.distance < c.thickness) {
      s.depth = c.thickness - contact_gap(c, refresh, start, x, v, &s.normal, s.weight);
      s.rate = (double)step;
    }
    if (s.rate > 0.0) {
      terms[i].along = step * (real)s.rate * (real)c.stiffness - terms[i].around;
      terms[i].push = step * (real)(c.stiffness * s.depth);
    } else {
      terms[i].along = -terms[i].around;
      terms[i].push = (real)0;
    }
    terms[i].normal = to_vec3(s.normal);
    for (a = 0; a < 4; ++a) terms[i].weight[a] = (real)s.weight[a];
  }
}

/* Tangential part of sum w v of a contact. */
DEVICE vec3 sliding(term t, GLOBAL const dvec3 *velocity)
{
  vec3 s = vec3_make((real)0, (real)0, (real)0);
  int a;
  for (a = 0; a < 4; ++a) s = axpy(s, t.weight[a], to_vec3(velocity[t.node[a]]));
  return axpy(s, -dot(t.normal, s), t.normal);
}

/* Impulse of the friction of contact i at `velocity`, N s on side A. hold: at rest, or none. */
DEVICE vec3 friction_impulse(int i, GLOBAL const term *terms, GLOBAL const vec3 *hold, GLOBAL const dvec3 *velocity)
{
  vec3 f = scale(-terms[i].around, sliding(terms[i], velocity));
  return hold ? add(hold[i], f) : f;
}

KERNEL friction_impulses(int n, GLOBAL const term *terms, GLOBAL const vec3 *hold, GLOBAL const dvec3 *velocity,
                         GLOBAL vec3 *impulse)
{
  FOR_EACH(i, n) impulse[i] = friction_impulse(i, terms, hold, velocity);
}

/* force[i]: friction of contact i at the end of the step, N on side A; twice as much where it slides, so that it is
   beyond the cone in the next step as well, whatever the load is then. It slides if it has this part of the cone and
   its damping more than that. */
#define SLIDES 0.99
#define MOVES 0.01
KERNEL keep_friction(int n, GLOBAL const contact *contacts, GLOBAL const term *terms, GLOBAL const vec3 *hold,
                     GLOBAL const dvec3 *velocity, double step, GLOBAL dvec3 *force)
{
  FOR_EACH(i, n) {
    dvec3 impulse = to_dvec3(friction_impulse(i, terms, hold, velocity));
    double cone = contacts[i].friction * (double)terms[i].push,
           damped = (double)terms[i].around * dnorm(tangential(terms[i], velocity));
    int slides = dnorm(impulse) >= SLIDES * cone && damped > MOVES * cone;
    force[i] = dscale((slides ? 2.0 : 1.0) / step, impulse);
  }
}

/* push[i]: the impulse of contact i along its normal at the end of the first solve, N s, below 0 where it pulls.
   change: by which the solve changed the velocities. */
KERNEL solved_pushes(int n, GLOBAL const term *terms, GLOBAL const vec3 *change, GLOBAL double *push)
{
  FOR_EACH(i, n) {
    term t = terms[i];
    real p = t.push;
    int a;
    for (a = 0; a < 4; ++a) p -= (t.along + t.around) * t.weight[a] * dot(t.normal, change[t.node[a]]);
    push[i] = (double)p;
  }
}

/* load[i]: what presses on cloth vertex i in all, N s; pull[i]: what pulls at it. */
KERNEL solved_loads(int n, int contacts, GLOBAL const int *row, GLOBAL const int *incidence, GLOBAL const term *terms,
                    GLOBAL const double *push, GLOBAL double *load, GLOBAL double *pull)
{
  FOR_EACH(i, n) {
    const int end = row[i + 1];
    double pressing = 0.0, pulling = 0.0;
    int k;
    for (k = row[i]; k < end; k += AT_ONCE(8)) {
      int at[AT_ONCE(8)];
      double own[AT_ONCE(8)];
      FOR_AT_ONCE(q, 8, end - k) at[q] = incidence[k + q];
      FOR_AT_ONCE(q, 8, end - k)
        if ((at[q] >> 2) < contacts) own[q] = fabs((double)terms[at[q] >> 2].weight[at[q] & 3]) * push[at[q] >> 2];
      FOR_AT_ONCE(q, 8, end - k)
        if ((at[q] >> 2) < contacts) {
          pressing += max_double(own[q], 0.0);
          pulling -= min_double(own[q], 0.0);
        }
    }
    load[i] = pressing;
    pull[i] = pulling;
  }
}

/* share[i]: what is left of the load around cloth vertex i, itself and those that elements couple it with, once the
   contacts that pull have let go. row, column: of the matrix. */
KERNEL remaining_loads(int n, GLOBAL const int *row, GLOBAL const int *column, GLOBAL const double *load,
                       GLOBAL const double *pull, GLOBAL double *share)
{
  FOR_EACH(i, n) {
    const int end = load[i] > 0.0 ? row[i + 1] : row[i];
    double pressing = 0.0, pulling = 0.0;
    int k;
    for (k = row[i]; k < end; k += AT_ONCE(8)) {
      int at[AT_ONCE(8)];
      double own_load[AT_ONCE(8)], own_pull[AT_ONCE(8)];
      FOR_AT_ONCE(q, 8, end - k) at[q] = column[k + q];
      FOR_AT_ONCE(q, 8, end - k)
        if (at[q] < n) {
          own_load[q] = load[at[q]];
          own_pull[q] = pull[at[q]];
        }
      FOR_AT_ONCE(q, 8, end - k)
        if (at[q] < n) {
          pressing += own_load[q];
          pulling += own_pull[q];
        }
    }
    share[i] = pressing > pulling ? (pressing - pulling) / pressing : 0.0;
  }
}

/* Friction by the normal forces, velocities and friction after the first solve. push, load, share: as above; contacts
   that pull let go in the next solve, and what they took from the others goes with them. No contact presses more than
   its term does at the iterate. pressing[i]: the normal force that follows, N; again: it is taken as it was found.
   n: contacts. */
KERNEL iterate_friction(int n, int again, int cloth_vertices, GLOBAL const contact *contacts,
                        GLOBAL const double *inverse_mass, GLOBAL const double *push, GLOBAL const double *load,
                        GLOBAL const double *share, GLOBAL const dvec3 *velocity, real step, GLOBAL double *pressing,
                        GLOBAL term *terms, GLOBAL vec3 *hold)
{
  FOR_EACH(i, n) {
    term t = terms[i];
    const double h = (double)step, press = max_double(push[i], 0.0),
                 mobility = pushed_mobility(t, press, cloth_vertices, inverse_mass, load);
    friction_law law;
    law.force = dvec3_make(0.0, 0.0, 0.0);
    law.damping = 0.0;
    if (!again) pressing[i] = 0.0;
    if (mobility > 0.0) {
      dvec3 speed = tangential(t, velocity), normal = to_dvec3(t.normal),
            force = dscale(1.0 / h, daxpy(to_dvec3(hold[i]), -(double)t.around, speed));
      double left = 0.0, whole = 0.0;
      int a;
      for (a = 0; a < 4; ++a)
        if (t.node[a] < cloth_vertices) {
          left += fabs((double)t.weight[a]) * share[t.node[a]];
          whole += fabs((double)t.weight[a]);
        }
      force = daxpy(force, -ddot(force, normal), normal);
      if (!again) pressing[i] = min_double(press * left / whole, max_double((double)t.push, 0.0)) / h;
      law = friction_around(contacts[i].static_friction, contacts[i].friction, pressing[i], force, speed, speed,
                            1.0 / mobility, h);
    }
    terms[i].around = step * (real)law.damping;
    terms[i].along = t.along + (t.around - terms[i].around);
    hold[i] = scale(step, to_vec3(law.force));
  }
}

/* b = h f - M (v - v*) of free vertices with what terms, if any, push, and with the friction of the first `contacts` of
   them (friction_impulses): the negative residual. */
KERNEL newton_right_side(int n, real step, GLOBAL const real *mass, GLOBAL const int *fixed,
                         GLOBAL const dvec3 *base_velocity, GLOBAL const dvec3 *velocity, GLOBAL const vec3 *force,
                         int with_terms, int contacts, GLOBAL const int *term_row, GLOBAL const int *term_incidence,
                         GLOBAL const term *terms, GLOBAL const vec3 *friction, GLOBAL vec3 *b)
{
  FOR_EACH(i, n) {
    vec3 sum = vec3_make((real)0, (real)0, (real)0);
    if (!fixed[i]) {
      sum = axpy(scale(step, force[i]), -mass[i], to_vec3(dsub(velocity[i], base_velocity[i])));
      if (with_terms) {
        sum = add_term_pushes(i, term_row, term_incidence, terms, sum);
        sum = add_term_products(i, contacts, term_row, term_incidence, terms, friction, sum);
      }
    }
    b[i] = sum;
  }
}

/* residual[i] = |b|^2 / m; size[i] = the sum of the squares of all contributions to b, before any cancel, / m. Both in
   J, of free vertices. pushing: whether there are terms. */
KERNEL newton_norms(int n, real step, GLOBAL const real *mass, GLOBAL const int *fixed, GLOBAL const dvec3 *gravity,
                    GLOBAL const vec3 *b, GLOBAL const int *triangle_row, GLOBAL const int *triangle_incidence,
                    GLOBAL const vec3 *triangle_force, GLOBAL const int *hinge_row, GLOBAL const int *hinge_incidence,
                    GLOBAL const vec3 *hinge_force, int hinges, int pushing, GLOBAL const int *term_row,
                    GLOBAL const int *term_incidence, GLOBAL const term *terms, GLOBAL double *residual,
                    GLOBAL double *size)
{
  FOR_EACH(i, n) {
    double sum = 0.0, pushes = 0.0, inverse = 1.0 / (double)mass[i];
    vec3 weight = scale(mass[i], to_vec3(gravity[0]));
    if (!fixed[i]) {
      int k, end = triangle_row[i + 1];
      sum = (double)dot(weight, weight);
      for (k = triangle_row[i]; k < end; k += AT_ONCE(4)) {
        vec3 f[AT_ONCE(4)];
        FOR_AT_ONCE(q, 4, end - k)
          f[q] = triangle_force[3 * (triangle_incidence[k + q] >> 2) + (triangle_incidence[k + q] & 3)];
        FOR_AT_ONCE(q, 4, end - k) sum += (double)dot(f[q], f[q]);
      }
      end = hinges ? hinge_row[i + 1] : 0;
      for (k = hinges ? hinge_row[i] : 0; k < end; k += AT_ONCE(4)) {
        vec3 f[AT_ONCE(4)];
        FOR_AT_ONCE(q, 4, end - k) f[q] = hinge_force[hinge_incidence[k + q]];
        FOR_AT_ONCE(q, 4, end - k) sum += (double)dot(f[q], f[q]);
      }
      end = pushing ? term_row[i + 1] : 0;
      for (k = pushing ? term_row[i] : 0; k < end; k += AT_ONCE(8)) {
        int at[AT_ONCE(8)];
        double push[AT_ONCE(8)];
        FOR_AT_ONCE(q, 8, end - k) at[q] = term_incidence[k + q];
        FOR_AT_ONCE(q, 8, end - k) push[q] = (double)(terms[at[q] >> 2].weight[at[q] & 3] * terms[at[q] >> 2].push);
        FOR_AT_ONCE(q, 8, end - k) pushes += push[q] * push[q];
      }
    }
    residual[i] = fixed[i] ? 0.0 : inverse * (double)dot(b[i], b[i]);
    size[i] = inverse * ((double)(step * step) * sum + pushes);
  }
}

/* Damping of triangles [3 n] and hinges [4 n]: -c K v, with the K of the matrix without its geometric terms;
   material_scale = h (h + c). A common velocity does nothing, rounded or not. onto: added to what is there. */
KERNEL damp_triangles(int n, GLOBAL const triangle_rest *rest, GLOBAL const triangle_factor *factor,
                      GLOBAL const real *material_scale, real step, GLOBAL const dvec3 *velocity, int onto,
                      GLOBAL vec3 *force)
{
  FOR_EACH(i, n) {
    triangle_rest r = rest[i];
    triangle_factor t = factor[i];
    real whole = material_scale[r.material], ratio = (whole / step - step) / whole;
    vec3 v1 = to_vec3(dsub(velocity[r.node[1]], velocity[r.node[0]])),
         v2 = to_vec3(dsub(velocity[r.node[2]], velocity[r.node[0]]));
    vec3 du = axpy(scale(t.d[0], v1), t.d[2], v2), dw = axpy(scale(t.d[1], v1), t.d[3], v2); /* rates of u and w */
    real s0 = t.k[0] * dot(t.u, du) + t.k[1] * dot(t.w, dw), s1 = t.k[2] * dot(t.w, dw) + t.k[1] * dot(t.u, du);
    real s2 = (real)0.5 * t.k[3] * (dot(t.u, dw) + dot(t.w, du));
    vec3 pu = axpy(scale(s0, t.u), s2, t.w), pw = axpy(scale(s1, t.w), s2, t.u);
    vec3 f[3];
    int a;
    f[1] = axpy(scale(t.d[0], pu), t.d[1], pw);
    f[2] = axpy(scale(t.d[2], pu), t.d[3], pw);
    f[0] = scale((real)-1, add(f[1], f[2]));
    for (a = 0; a < 3; ++a) force[3 * i + a] = onto ? axpy(force[3 * i + a], -ratio, f[a]) : scale(-ratio, f[a]);
  }
}
KERNEL damp_hinges(int n, GLOBAL const hinge_rest *rest, GLOBAL const hinge_factor *factor,
                   GLOBAL const real *material_scale, real step, GLOBAL const dvec3 *velocity, int onto,
                   GLOBAL vec3 *force)
{
  FOR_EACH(i, n) {
    hinge_rest r = rest[i];
    real whole = material_scale[r.material], ratio = (whole / step - step) / whole, rate = (real)0;
    int a;
    for (a = 1; a < 4; ++a) rate += dot(factor[i].gradient[a], to_vec3(dsub(velocity[r.node[a]], velocity[r.node[0]])));
    rate *= -ratio * factor[i].coefficient;
    for (a = 0; a < 4; ++a)
      force[4 * i + a] =
          onto ? axpy(force[4 * i + a], rate, factor[i].gradient[a]) : scale(rate, factor[i].gradient[a]);
  }
}

/* force += outer */
KERNEL add_forces(int n, GLOBAL const vec3 *outer, GLOBAL vec3 *force)
{
  FOR_EACH(i, n) {
    force[i] = add(force[i], outer[i]);
  }
}

/* v = v0 + alpha d of free vertices. n: cloth vertices. */
KERNEL move_iterate(int n, double alpha, GLOBAL const int *fixed, GLOBAL const dvec3 *start,
                    GLOBAL const vec3 *direction, GLOBAL dvec3 *velocity)
{
  FOR_EACH(i, n) {
    if (!fixed[i]) velocity[i] = daxpy(start[i], alpha, to_dvec3(direction[i]));
  }
}

/* Inertia, gravity and, if any, a force that is constant through the line search, as parts of the incremental potential
   of each cloth vertex, J. */
KERNEL measure_inertia(int n, double step, GLOBAL const real *mass, GLOBAL const int *fixed,
                       GLOBAL const dvec3 *base_velocity, GLOBAL const dvec3 *velocity, GLOBAL const dvec3 *start,
                       GLOBAL const dvec3 *position, GLOBAL const dvec3 *gravity, int held, GLOBAL const vec3 *outer,
                       GLOBAL double *energy)
{
  FOR_EACH(i, n) {
    dvec3 d = dsub(velocity[i], base_velocity[i]);
    double m = (double)mass[i], sum = m * (0.5 * ddot(d, d) - ddot(gravity[0], dsub(position[i], start[i])));
    if (held) sum -= step * ddot(to_dvec3(outer[i]), velocity[i]);
    energy[i] = fixed[i] ? 0.0 : sum;
  }
}

/* Energy of the penalty, damping and friction of each contact, and then of the stretch of each stitch, J. step: h. */
KERNEL measure_terms(int n, int contact_count, int damped, int refresh, double step, GLOBAL const contact *contacts,
                     GLOBAL const stitch *stitches, GLOBAL const dvec3 *start, GLOBAL const dvec3 *x,
                     GLOBAL const dvec3 *velocity, GLOBAL const double *inverse_mass, GLOBAL const vertex_contact *v,
                     GLOBAL const term *terms, GLOBAL const vec3 *hold, GLOBAL double *energy)
{
  FOR_EACH(i, n) {
    if (i < contact_count) {
      vec3 s = sliding(terms[i], velocity);
      double friction = 0.5 * (double)(terms[i].around * dot(s, s));
      if (hold) friction -= (double)dot(hold[i], s);
      energy[i] = contact_at(contacts[i], damped, refresh, step, start, x, velocity, inverse_mass, v).energy + friction;
    } else {
      stitch s = stitches[i - contact_count];
      dvec3 gap = daxpy(dsub(x[s.node[0]], x[s.node[1]]), -s.ratio, dsub(x[s.node[2]], x[s.node[1]]));
      double stretch = s.length > 0.0 ? stitch_stretch(s, dnorm(gap)) : 0.0;
      energy[i] = 0.5 * s.stiffness * (s.length > 0.0 ? stretch * stretch : ddot(gap, gap));
    }
  }
}

/* slope[i] = -b . d: how fast the potential falls along d. */
KERNEL descent(int n, GLOBAL const int *fixed, GLOBAL const vec3 *b, GLOBAL const vec3 *d, GLOBAL double *slope)
{
  FOR_EACH(i, n) {
    slope[i] = fixed[i] ? 0.0 : -(double)dot(b[i], d[i]);
  }
}

#endif
