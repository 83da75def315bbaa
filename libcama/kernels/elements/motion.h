/* SPDX-License-Identifier: Apache-2.0 */
/* Prescribed motion, position prediction and the end of a step. */
#ifndef CAMA_KERNELS_ELEMENTS_MOTION_H
#define CAMA_KERNELS_ELEMENTS_MOTION_H
#include "../dialect/dvec3.h"
#include "../dialect/lang.h"
#include "../system/incidence.h"

/* x = rotation (rest - center) scale + center + translation, row-major rotation; transform: 6 vectors, the rows of the
   rotation, then translation, center and (scale, 0, 0). Writes vertices first .. first + n. */
KERNEL move_rigid(int n, GLOBAL const dvec3 *rest, GLOBAL const dvec3 *transform, int first, GLOBAL dvec3 *out)
{
  FOR_EACH(i, n) {
    dvec3 x = dscale(transform[5].x, dsub(rest[first + i], transform[4]));
    out[first + i] =
        dadd(dadd(dvec3_make(ddot(transform[0], x), ddot(transform[1], x), ddot(transform[2], x)), transform[4]),
             transform[3]);
  }
}

/* Velocities of a body that turns about its centre of mass; motion: its centre, velocity and angular velocity. Writes
   vertices first .. first + n. */
KERNEL rigid_velocities(int n, GLOBAL const dvec3 *position, GLOBAL const dvec3 *motion, int first,
                        GLOBAL dvec3 *velocity)
{
  FOR_EACH(i, n) {
    velocity[first + i] = dadd(motion[1], dcross(motion[2], dsub(position[first + i], motion[0])));
  }
}

/* Linear interpolation between two sampled frames. */
KERNEL move_sampled(int n, GLOBAL const dvec3 *frame_a, GLOBAL const dvec3 *frame_b, double t, int first,
                    GLOBAL dvec3 *out)
{
  FOR_EACH(i, n) {
    out[first + i] = dlerp(frame_a[i], frame_b[i], t);
  }
}

/* Scatters prescribed positions to their vertices. */
KERNEL scatter_positions(int n, GLOBAL const int *vertex, GLOBAL const dvec3 *position, GLOBAL dvec3 *out)
{
  FOR_EACH(i, n) {
    out[vertex[i]] = position[i];
  }
}

/* A vertex attached to a triangle: its foot point there, and for each of the triangle's vertices its offset from the
   foot point in the frame of that vertex. */
typedef struct {
  int vertex;
  int node[3];
  double weight[3];
  double offset[9];
} attachment;

/* The frame of vertex v of an obstacle: third axis along the mean normal of the faces around it, first as near as can
   be to the edge to the first of their other vertices. faces_of: of the vertices from `first` on, the faces around
   each, as the two vertices that follow it there; faces_row: where those of each begin. */
DEVICE void surface_frame(int v, int first, GLOBAL const int *faces_row, GLOBAL const int *faces_of,
                          GLOBAL const dvec3 *position, dvec3 axis[3])
{
  dvec3 x = position[v], normal = dvec3_make(0.0, 0.0, 0.0), edge = normal;
  int k, begin = faces_row[v - first], end = faces_row[v - first + 1];
  for (k = begin; k < end; ++k) {
    dvec3 side = dsub(position[faces_of[2 * k]], x);
    if (k == begin) edge = side;
    normal = dadd(normal, dcross(side, dsub(position[faces_of[2 * k + 1]], x)));
  }
  axis[2] = dnormalize(normal);
  axis[0] = dnormalize(daxpy(edge, -ddot(edge, axis[2]), axis[2]));
  axis[1] = dcross(axis[2], axis[0]);
}

/* Where an attached vertex is: the mean, weighted as the foot point is, of what the three vertices say by their frames.
   Neighbours stay neighbours where the surface bends from one triangle to the next. */
KERNEL move_attached(int n, int first, GLOBAL const attachment *attachments, GLOBAL const int *faces_row,
                     GLOBAL const int *faces_of, GLOBAL dvec3 *position)
{
  FOR_EACH(i, n) {
    attachment a = attachments[i];
    dvec3 x = dvec3_make(0.0, 0.0, 0.0), axis[3];
    int j, k;
    for (j = 0; j < 3; ++j) {
      dvec3 corner = position[a.node[j]];
      surface_frame(a.node[j], first, faces_row, faces_of, position, axis);
      for (k = 0; k < 3; ++k) corner = daxpy(corner, a.offset[3 * j + k], axis[k]);
      x = daxpy(x, a.weight[j], corner);
    }
    position[a.vertex] = x;
  }
}

/* base = now + memory (now - before), from which the second-order backward differentiation formula (BDF2) starts. */
KERNEL extrapolate_states(int n, double memory, GLOBAL const dvec3 *now, GLOBAL const dvec3 *before, GLOBAL dvec3 *base)
{
  FOR_EACH(i, n) {
    base[i] = daxpy(now[i], memory, dsub(now[i], before[i]));
  }
}

/* Prediction of the end of the step by a multistep integrator: v = v_n, x = x* + time_step v, of free vertices. n:
   cloth vertices. */
KERNEL predict_states(int n, double time_step, GLOBAL const int *fixed, GLOBAL const dvec3 *velocity,
                      GLOBAL const dvec3 *base, GLOBAL dvec3 *velocity_next, GLOBAL dvec3 *position_next)
{
  FOR_EACH(i, n) {
    if (fixed[i]) continue;
    velocity_next[i] = velocity[i];
    position_next[i] = daxpy(base[i], time_step, velocity[i]);
  }
}

/* motion[i]: from the position to the next one, m. n: cloth vertices. */
KERNEL predicted_motions(int n, GLOBAL const dvec3 *position, GLOBAL const dvec3 *position_next, GLOBAL dvec3 *motion)
{
  FOR_EACH(i, n) {
    motion[i] = dsub(position_next[i], position[i]);
  }
}

/* Where the motion of a free vertex differs from that of a vertex of its triangles by more than `most` of their
   distance, half of it and half of the mean of theirs; elsewhere its own. row, entry: triangles of a vertex. n: cloth
   vertices. */
KERNEL smooth_motions(int n, double most, GLOBAL const int *fixed, GLOBAL const element_nodes *nodes,
                      GLOBAL const int *row, GLOBAL const int *entry, GLOBAL const dvec3 *position,
                      GLOBAL const dvec3 *motion, GLOBAL dvec3 *smooth)
{
  FOR_EACH(i, n) {
    const dvec3 x = position[i], own = motion[i];
    dvec3 sum = dvec3_make(0.0, 0.0, 0.0);
    const int first = row[i], end = row[i + 1];
    int rough = 0;
    for (int k = first; k < end; ++k) {
      const int corner = entry[k] & 3;
      for (int side = 1; side < 3; ++side) {
        const int j = nodes[entry[k] >> 2].node[(corner + side) % 3];
        const dvec3 way = dsub(position[j], x), apart = dsub(motion[j], own);
        if (ddot(apart, apart) > most * most * ddot(way, way)) rough = 1;
        sum = dadd(sum, motion[j]);
      }
    }
    smooth[i] = rough && !fixed[i] ? daxpy(dscale(0.5, own), 0.25 / (end - first), sum) : own;
  }
}

/* Free vertices whose motion is another than the predicted one go by it, with the velocity that leads there from
   `base`. n: cloth vertices. */
KERNEL follow_motions(int n, double time_step, GLOBAL const int *fixed, GLOBAL const dvec3 *position,
                      GLOBAL const dvec3 *base, GLOBAL const dvec3 *motion, GLOBAL dvec3 *velocity_next,
                      GLOBAL dvec3 *position_next)
{
  FOR_EACH(i, n) {
    const dvec3 change = dsub(motion[i], dsub(position_next[i], position[i]));
    if (fixed[i] || (change.x == 0.0 && change.y == 0.0 && change.z == 0.0)) continue;
    velocity_next[i] = daxpy(velocity_next[i], 1.0 / time_step, change);
    position_next[i] = daxpy(base[i], time_step, velocity_next[i]);
  }
}

/* energy[i]: of vertex i at its velocity, and at the one that gravity gives it in the step, J; 0 of fixed ones. n:
   cloth vertices. */
KERNEL kinetic_energies(int n, double time_step, GLOBAL const dvec3 *gravity, GLOBAL const double *inverse_mass,
                        GLOBAL const dvec3 *velocity, GLOBAL double *energy)
{
  FOR_EACH(i, n) {
    const dvec3 v = velocity[i], fall = dscale(time_step, gravity[0]);
    energy[i] = inverse_mass[i] > 0.0 ? 0.5 * (ddot(v, v) + ddot(fall, fall)) / inverse_mass[i] : 0.0;
  }
}

/* Velocity of prescribed vertices over the step; zero elsewhere. */
KERNEL prescribe_velocities(int n, GLOBAL const int *fixed, GLOBAL const dvec3 *position, GLOBAL const dvec3 *target,
                            double time_step, GLOBAL dvec3 *velocity_next)
{
  FOR_EACH(i, n) {
    velocity_next[i] = fixed[i] ? dscale(1.0 / time_step, dsub(target[i], position[i])) : dvec3_make(0.0, 0.0, 0.0);
  }
}

/* Ballistic prediction of the end of the step; prescribed vertices go to their target. */
KERNEL predict_positions(int n, GLOBAL const int *fixed, GLOBAL const dvec3 *position, GLOBAL const dvec3 *velocity,
                         GLOBAL const dvec3 *gravity, GLOBAL const dvec3 *target, double time_step,
                         GLOBAL dvec3 *predicted, GLOBAL double *uncertain)
{
  FOR_EACH(i, n) {
    if (i == 0) uncertain[0] = time_step * time_step * dnorm(gravity[0]);
    predicted[i] =
        fixed[i] ? target[i] : daxpy(daxpy(position[i], time_step, velocity[i]), time_step * time_step, gravity[0]);
  }
}

/* Projects positions along the solved velocities (Equation 1). n: cloth vertices. */
KERNEL advance(int n, double time_step, GLOBAL const int *fixed, GLOBAL const dvec3 *velocity_next,
               GLOBAL const dvec3 *position, GLOBAL dvec3 *position_next)
{
  FOR_EACH(i, n) {
    if (!fixed[i]) position_next[i] = daxpy(position[i], time_step, velocity_next[i]);
  }
}

/* Where penetration handling moved a vertex away from base + step v, its velocity becomes the mean one over the time
   step. n: cloth vertices. */
KERNEL follow_positions(int n, double time_step, double step, GLOBAL const int *fixed, GLOBAL const dvec3 *position,
                        GLOBAL const dvec3 *base, GLOBAL const dvec3 *position_next, GLOBAL dvec3 *velocity_next)
{
  FOR_EACH(i, n) {
    dvec3 free_end = daxpy(base[i], step, velocity_next[i]), x = position_next[i];
    if (!fixed[i] && (x.x != free_end.x || x.y != free_end.y || x.z != free_end.z))
      velocity_next[i] = dscale(1.0 / time_step, dsub(x, position[i]));
  }
}

/* A change of velocity that is larger than both was a blow that contact passed on. */
#define BLOW_GROWTH 2.0 /* times the change in the last step */
#define BLOW 10.0 /* times what gravity adds */
#define HINDERED_BLOW 3.0 /* likewise, of a vertex that was moved away */
#define STANDARD_GRAVITY 9.81 /* m/s^2, where there is none */

/* What BDF2 keeps of a step, of all vertices: the state at its start, or, where the motion was not smooth, the state
   from which the change dv of the velocity leads to the new one. dv: by which the solve changed the velocity, without
   `abrupt`, the part of contact that stopped it; the velocity loses the share by which the formula overrates that
   (abrupt.h). touching: whether there are contacts. With them, of a blow no more is kept than would not have been one.
   Where penetration handling moved a vertex away from base + step v, its velocity becomes the mean one over the time
   step plus `share` of dv, except for what pressed it against the obstacle and for what a blow has beyond
   HINDERED_BLOW: the solve knows nothing of impacts, and such a change would fling the vertex on. memory: of base = now
   + memory (now - before). cloth: number of cloth vertices, of which others have none. gravity: of the scene.
   history_*: may be base_*. */
KERNEL keep_history(int n, int cloth, double time_step, double step, double share, double memory,
                    GLOBAL const int *fixed, GLOBAL const dvec3 *gravity, GLOBAL const dvec3 *position,
                    GLOBAL const dvec3 *velocity, GLOBAL const dvec3 *base_position, GLOBAL const dvec3 *base_velocity,
                    int touching, GLOBAL const dvec3 *abrupt, GLOBAL const dvec3 *position_next,
                    GLOBAL dvec3 *velocity_next, GLOBAL dvec3 *position_history, GLOBAL dvec3 *velocity_history)
{
  FOR_EACH(i, n) {
    dvec3 x = position[i], v = velocity[i];
    if (i < cloth && !fixed[i]) {
      dvec3 off = dsub(position_next[i], daxpy(base_position[i], step, velocity_next[i]));
      dvec3 stopped = touching ? abrupt[i] : dvec3_make(0.0, 0.0, 0.0), dv = dsub(dsub(velocity_next[i], v), stopped);
      dvec3 fall = dscale(time_step, gravity[0]), blow = dsub(dv, fall);
      const double g = dnorm(gravity[0]), added = time_step * (g > 0.0 ? g : STANDARD_GRAVITY);
      double size = dnorm(blow), most = size;
      int struck = off.x != 0.0 || off.y != 0.0 || off.z != 0.0;
      if (touching) {
        most = max_double(BLOW * added, BLOW_GROWTH / memory * dnorm(daxpy(dsub(base_velocity[i], v), -memory, fall)));
      }
      if (struck || size > most || stopped.x != 0.0 || stopped.y != 0.0 || stopped.z != 0.0) {
        dvec3 end = daxpy(velocity_next[i], step / time_step - 1.0, stopped);
        if (struck) {
          dvec3 mean = dscale(1.0 / time_step, dsub(position_next[i], x)), away = dnormalize(off), kept = dv;
          double kept_share = 1.0;
          if (size > HINDERED_BLOW * added) {
            kept_share = HINDERED_BLOW * added / size;
            kept = daxpy(fall, kept_share, blow);
          }
          end = daxpy(mean, share, daxpy(kept, -kept_share * min_double(ddot(blow, away), 0.0), away));
        }
        if (size > most) dv = daxpy(fall, most / size, blow);
        velocity_next[i] = end;
        v = dsub(end, dv);
        x = daxpy(position_next[i], -time_step, daxpy(end, -0.5, dv));
      }
    }
    position_history[i] = x;
    velocity_history[i] = v;
  }
}

/* The local error of a step's positions, squared, times the mass, kg m^2, of free vertices. The smooth part is scale
   |dv - ratio dv'|, from the changes dv and dv' of the velocity in this step and the one before: dv from `start` to
   `end`, dv' from `start_before` to `end_before`. BDF2 at the ratio w of its step to the last has the error dt^3 x'''
   (1 + w)^2 / (6 w (1 + 2 w)), and x''' = 2 w (dv - w dv') / (dt^2 (1 + w)): with its implicit step h that is h/3 |dv -
   w dv'|. A step of backward Euler has dt/2 |dv|. By what else the velocity changed, from `end_before` to `start`,
   contact stopped the vertex at a moment that the step does not resolve: `jump` times as much. n: cloth vertices. */
KERNEL local_errors(int n, double scale, double ratio, double jump, GLOBAL const int *fixed, GLOBAL const double *mass,
                    GLOBAL const dvec3 *end, GLOBAL const dvec3 *start, GLOBAL const dvec3 *end_before,
                    GLOBAL const dvec3 *start_before, GLOBAL double *square)
{
  FOR_EACH(i, n) {
    dvec3 e = dscale(scale, daxpy(dsub(end[i], start[i]), -ratio, dsub(end_before[i], start_before[i]))),
          j = dscale(jump, dsub(start[i], end_before[i]));
    square[i] = fixed[i] ? 0.0 : mass[i] * (ddot(e, e) + ddot(j, j));
  }
}

#define FASTEST 2e5 /* m/s, beyond what any cloth does: the numbers have gone astray */

/* bad[0]: 1 + the last vertex with a value that is not finite, or faster than FASTEST; it keeps its initial 0 if there
   is none. */
KERNEL find_nonfinite(int n, GLOBAL const dvec3 *x, GLOBAL const dvec3 *v, GLOBAL int *bad)
{
  FOR_EACH(i, n) {
    double s = (x[i].x - x[i].x) + (x[i].y - x[i].y) + (x[i].z - x[i].z) + (v[i].x - v[i].x) + (v[i].y - v[i].y) +
               (v[i].z - v[i].z);
    if (!(s == 0.0) || !(ddot(v[i], v[i]) <= FASTEST * FASTEST)) atomic_max_int(bad, i + 1);
  }
}

/* Single-precision vectors [n] of another library in double precision. */
KERNEL widen_vectors(int n, GLOBAL const float *from, GLOBAL dvec3 *to)
{
  FOR_EACH(i, n) {
    to[i] = dvec3_make(from[3 * i], from[3 * i + 1], from[3 * i + 2]);
  }
}

/* bad[0]: n minus the first vector with a value that is not finite; it keeps its initial 0 if there is none. */
KERNEL find_nonfinite_vector(int n, GLOBAL const dvec3 *x, GLOBAL int *bad)
{
  FOR_EACH(i, n) {
    double s = (x[i].x - x[i].x) + (x[i].y - x[i].y) + (x[i].z - x[i].z);
    if (!(s == 0.0)) atomic_max_int(bad, n - i);
  }
}

KERNEL scale_vectors(int n, double scale, GLOBAL dvec3 *x)
{
  FOR_EACH(i, n) {
    x[i] = dscale(scale, x[i]);
  }
}

#endif
