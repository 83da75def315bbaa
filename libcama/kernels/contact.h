/* SPDX-License-Identifier: Apache-2.0 */
/* Records of the contact system, and proximity checking: candidate pairs become contacts (paper, section 3.2). */

typedef struct {
  int node[4];        /* vertex then face, or two edges */
  int kind;           /* 0 vertex-face, 1 edge-edge */
  int candidate;      /* the pair it came from */
  double weight[4];   /* sum_k w_k x_k is the difference vector, side A minus side B */
  dvec3 normal;       /* from B to A */
  double distance;    /* m */
  double thickness;   /* m */
  double stiffness;   /* N/m */
  double friction;         /* Coulomb coefficient while it slides */
  double static_friction;  /* while it sticks, not below `friction` */
} contact;

typedef struct { int node[3]; double ratio, stiffness; } stitch;

/* Per vertex: what contact needs to know. */
typedef struct {
  double thickness, area;            /* m, m^2 */
  double stiffness;                  /* penalty per area against its own like, N/m^3 */
  double friction, static_friction;
  double radius;                     /* of the sphere around it that an analytic obstacle is made of; 0 elsewhere, m */
  int obstacle, form;                /* form: SURFACE_* */
} vertex_contact;

#define SURFACE_MESH 0
#define SURFACE_ROUND 1   /* a sphere is the face (c, c, c), a capsule the face (a, b, b): distances are those of the hulls less the radius */
#define SURFACE_PLANE 2   /* the half space below the plane of the face, without end */

DEVICE element_nodes pair_nodes(int kind, pair p, GLOBAL const face_nodes *face, GLOBAL const edge_nodes *edge)
{
  element_nodes e;
  if (kind == 0) {
    e.node[0] = p.a; e.node[1] = face[p.b].node[0]; e.node[2] = face[p.b].node[1]; e.node[3] = face[p.b].node[2];
  } else {
    e.node[0] = edge[p.a].node[0]; e.node[1] = edge[p.a].node[1]; e.node[2] = edge[p.b].node[0]; e.node[3] = edge[p.b].node[1];
  }
  return e;
}

/* The proximity of a pair at given positions. */
DEVICE proximity pair_proximity(int kind, element_nodes e, GLOBAL const dvec3 *x)
{
  dvec3 o = x[e.node[0]], z = dvec3_make(0.0, 0.0, 0.0);
  dvec3 b = dsub(x[e.node[1]], o), c = dsub(x[e.node[2]], o), d = dsub(x[e.node[3]], o);
  return kind == 0 ? vertex_face_proximity(z, b, c, d) : edge_edge_proximity(z, b, c, d);
}

/* Radii of both sides together, m. All vertices of a side belong to one object. */
DEVICE double pair_radius(int kind, element_nodes e, GLOBAL const vertex_contact *v) { return v[e.node[0]].radius + v[e.node[kind + 1]].radius; }

/* Smallest contact thickness of the four vertices, m. */
DEVICE double pair_least_thickness(element_nodes e, GLOBAL const vertex_contact *v)
{
  return min_double(min_double(v[e.node[0]].thickness, v[e.node[1]].thickness), min_double(v[e.node[2]].thickness, v[e.node[3]].thickness));
}

/* Distance that a pair's hulls keep: a share of its least thickness, and the radii, m. */
DEVICE double pair_clearance(int kind, element_nodes e, GLOBAL const vertex_contact *v, double share)
{
  return share * pair_least_thickness(e, v) + pair_radius(kind, e, v);
}

DEVICE int pair_has_plane(int kind, element_nodes e, GLOBAL const vertex_contact *v) { return kind == 0 && v[e.node[1]].form == SURFACE_PLANE; }

/* A vertex over the half space below the plane of a, b, c; the distance is negative inside. A plane only translates, so that each of its
   points moves as the closest one does: one stands for it. */
DEVICE proximity vertex_plane_proximity(dvec3 vertex, dvec3 a, dvec3 b, dvec3 c)
{
  proximity p;
  p.normal = dnormalize(dcross(dsub(b, a), dsub(c, a)));
  p.distance = ddot(p.normal, dsub(vertex, a));
  p.weight[0] = 1.0; p.weight[1] = -1.0; p.weight[2] = p.weight[3] = 0.0;
  p.interior = 1;
  return p;
}

/* The proximity of a pair as contact sees it: radii and planes heeded. A round obstacle has no border: all its points are inside. */
DEVICE proximity surface_proximity(int kind, element_nodes e, GLOBAL const dvec3 *x, GLOBAL const vertex_contact *v)
{
  proximity p;
  if (pair_has_plane(kind, e, v)) return vertex_plane_proximity(x[e.node[0]], x[e.node[1]], x[e.node[2]], x[e.node[3]]);
  p = pair_proximity(kind, e, x);
  if (kind == 0 && v[e.node[1]].form == SURFACE_ROUND) p.interior = p.distance > 0.0;
  p.distance -= pair_radius(kind, e, v);
  return p;
}

DEVICE double mean4(double a, double b, double c, double d) { return 0.25 * (a + b + c + d); }

/* Thickness of a pair: half of side A's plus half of side B's. */
DEVICE double pair_thickness(int kind, element_nodes e, GLOBAL const vertex_contact *v)
{
  double t0 = v[e.node[0]].thickness, t1 = v[e.node[1]].thickness, t2 = v[e.node[2]].thickness, t3 = v[e.node[3]].thickness;
  return kind == 0 ? 0.5 * t0 + (t1 + t2 + t3) / 6.0 : mean4(t0, t1, t2, t3);
}

/* An obstacle's coefficient holds for all that touches it; two cloths meet at their mean. */
DEVICE double pair_friction(vertex_contact a, vertex_contact b)
{
  return a.obstacle ? a.friction : (b.obstacle ? b.friction : 0.5 * (a.friction + b.friction));
}
DEVICE double pair_static_friction(vertex_contact a, vertex_contact b)
{
  return a.obstacle ? a.static_friction : (b.obstacle ? b.static_friction : 0.5 * (a.static_friction + b.static_friction));
}

/* Penalty per area of two layers that yield one behind the other, N/m^3: the harmonic mean, so that like on like keeps its own. */
DEVICE double pair_stiffness(vertex_contact a, vertex_contact b)
{
  return a.stiffness == b.stiffness ? a.stiffness : 2.0 * a.stiffness * b.stiffness / (a.stiffness + b.stiffness);
}

/* The contact of a candidate pair, if it is one: closest points inside the features, and closer than the thickness now or
   (anticipate > 0) after moving with the predicted displacement. */
DEVICE int make_contact(int kind, element_nodes e, GLOBAL const dvec3 *position, GLOBAL const dvec3 *predicted,
                        GLOBAL const vertex_contact *v, double anticipate, proximity p, contact *c)
{
  double thickness = pair_thickness(kind, e, v), approach = 0.0, area_a, area_b;
  int k;
  if (!p.interior || !(p.distance + pair_radius(kind, e, v) > 0.0)) return 0;
  for (k = 0; k < 4; ++k) approach += p.weight[k] * ddot(p.normal, dsub(predicted[e.node[k]], position[e.node[k]]));
  if (!(p.distance < thickness || (anticipate > 0.0 && p.distance + approach < thickness))) return 0;
  if (p.distance >= thickness + anticipate) return 0;
  if (kind == 0) {
    area_a = v[e.node[0]].area;
    area_b = v[e.node[1]].area + v[e.node[2]].area + v[e.node[3]].area;
  } else {
    area_a = 0.5 * (v[e.node[0]].area + v[e.node[1]].area);
    area_b = 0.5 * (v[e.node[2]].area + v[e.node[3]].area);
  }
  for (k = 0; k < 4; ++k) { c->node[k] = e.node[k]; c->weight[k] = p.weight[k]; }
  c->kind = kind;
  c->normal = p.normal;
  c->distance = p.distance;
  c->thickness = thickness;
  c->stiffness = pair_stiffness(v[e.node[0]], v[e.node[3]]) * min_double(area_a, area_b);
  c->friction = pair_friction(v[e.node[0]], v[e.node[3]]);
  c->static_friction = pair_static_friction(v[e.node[0]], v[e.node[3]]);
  return 1;
}

/* Vectors of three floats. */
typedef struct { float x, y, z; } fvec3;
DEVICE fvec3 fvec3_make(float x, float y, float z) { fvec3 r; r.x = x; r.y = y; r.z = z; return r; }
DEVICE fvec3 fvec3_sub(fvec3 a, fvec3 b) { return fvec3_make(a.x - b.x, a.y - b.y, a.z - b.z); }
DEVICE fvec3 fvec3_scale(float s, fvec3 a) { return fvec3_make(s * a.x, s * a.y, s * a.z); }
/* A unit vector as a direction that tells sides apart: not longer than 1. */
DEVICE fvec3 to_direction(dvec3 n) { return fvec3_make((float)(0.9999999 * n.x), (float)(0.9999999 * n.y), (float)(0.9999999 * n.z)); }
DEVICE dvec3 from_direction(fvec3 n) { return dvec3_make((double)n.x, (double)n.y, (double)n.z); }
DEVICE float fvec3_dot(fvec3 a, fvec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
DEVICE float float_most(float a, float b) { return a > b ? a : b; }
DEVICE float float_least(float a, float b) { return a < b ? a : b; }
/* 1 / sqrt(a) to 3e-7 for a > 0, in plain arithmetic: the same bits everywhere, and no call in loops that run side by side. */
DEVICE float float_inverse_root(float a)
{
  float y = bits_float(0x5f3759df - (float_bits(a) >> 1)), h = 0.5f * a;
  y = y * (1.5f - h * y * y);
  y = y * (1.5f - h * y * y);
  y = y * (1.5f - h * y * y);
  return y * (1.5f - h * y * y);
}
/* The same everywhere: division of doubles is rounded correctly in every language, that of floats is not. */
DEVICE float float_inverse(float a) { return (float)(1.0 / (double)a); }

/* What tells most pairs apart, per vertex: position and motion until the prediction relative to the scene's lower corner, contact thickness
   and radius, all m. Rounded: what is told by it is told with MOVER_ROUNDING of the scene's extent to spare, which covers the floats (6e-8 each,
   two to an offset) and the some thirty operations on them. */
typedef struct { float x, y, z, dx, dy, dz, thickness, radius; } mover;
#define MOVER_ROUNDING 6e-6

/* A plane's radius is without end, so that movers tell nothing of it. spare: [1] what rounding may take, m. */
KERNEL make_movers(int n, GLOBAL const dvec3 *position, GLOBAL const dvec3 *predicted, GLOBAL const dvec3 *scene_bounds,
                   GLOBAL const vertex_contact *v, GLOBAL mover *movers, GLOBAL float *spare)
{
  FOR_EACH(i, n)
  {
    dvec3 x = dsub(position[i], scene_bounds[0]), d = dsub(predicted[i], position[i]);
    mover m;
    m.x = (float)x.x; m.y = (float)x.y; m.z = (float)x.z;
    m.dx = (float)d.x; m.dy = (float)d.y; m.dz = (float)d.z;
    m.thickness = float_above(v[i].thickness);
    m.radius = v[i].form == SURFACE_PLANE ? 1e30f : float_above(v[i].radius);
    movers[i] = m;
    if (i == 0)
      spare[0] = float_above(MOVER_ROUNDING * largest_component(dsub(scene_bounds[1], scene_bounds[0])) +
                             1e-15 * max_double(largest_component(scene_bounds[0]), largest_component(scene_bounds[1])));
  }
}

DEVICE fvec3 mover_offset(mover a, mover b) { return fvec3_make(a.x - b.x, a.y - b.y, a.z - b.z); }
/* Square of how far two vertices move against each other. */
DEVICE float mover_motion(mover a, mover b)
{
  fvec3 d = fvec3_make(a.dx - b.dx, a.dy - b.dy, a.dz - b.dz);
  return fvec3_dot(d, d);
}

/* Not below a pair's thickness, m. */
DEVICE float mover_thickness(int kind, mover m0, mover m1, mover m2, mover m3)
{
  return 1.000001f * (kind == 0 ? 0.5f * m0.thickness + (m1.thickness + m2.thickness + m3.thickness) * 0.16666667f
                                : 0.25f * (m0.thickness + m1.thickness + m2.thickness + m3.thickness));
}

/* What of the distance of a pair's hulls along a direction is not the surfaces' until the prediction: motion of the sides against each
   other, radii, rounding, m. */
DEVICE float mover_spent(int kind, mover m0, mover m1, mover m2, mover m3, float rounding)
{
  float most = float_most(float_most(mover_motion(m0, m2), mover_motion(m0, m3)), mover_motion(m1, kind == 0 ? m0 : m2));
  if (kind == 1) most = float_most(most, mover_motion(m1, m3));
  return 1.000001f * (most * float_inverse_root(most)) + m0.radius + (kind == 0 ? m1.radius : m2.radius) + rounding;
}

/* How far a pair's hulls are apart along n times the length of n, 0 at least; x: vertices 1 to 3 relative to 0. */
DEVICE float hulls_apart(int kind, fvec3 x1, fvec3 x2, fvec3 x3, fvec3 n)
{
  float a = fvec3_dot(n, x1), high = float_most(fvec3_dot(n, x2), fvec3_dot(n, x3));
  return float_most(0.0f, kind == 0 ? -float_most(high, a) : float_least(0.0f, a) - high);
}

/* `a` less its part along b. */
DEVICE fvec3 across(fvec3 a, fvec3 b) { return fvec3_sub(a, fvec3_scale(fvec3_dot(a, b) * float_inverse(fvec3_dot(b, b)), b)); }

/* gap: of the hulls along the direction times its length, size: square of that. */
typedef struct { float gap, size; fvec3 direction; } apartness;

/* The wider of a and what direction d has. */
DEVICE apartness wider_apart(int kind, fvec3 x1, fvec3 x2, fvec3 x3, fvec3 d, apartness a)
{
  float gap = hulls_apart(kind, x1, x2, x3, d), size = fvec3_dot(d, d);
  int better = gap * gap * a.size > a.gap * a.gap * size;
  a.gap = better ? gap : a.gap;
  a.size = better ? size : a.size;
  a.direction.x = better ? d.x : a.direction.x;
  a.direction.y = better ? d.y : a.direction.y;
  a.direction.z = better ? d.z : a.direction.z;
  return a;
}

/* The direction with the widest gap of three: between the middles of both sides, and that across two of the pair's edges; about as long as 1.
   gap becomes the room along it: the least distance of the surfaces until the prediction, 0 if it does not exceed the thickness. No
   branches: they would be guessed wrong, and pairs could not be told side by side. */
DEVICE INLINED apartness apart_along(int kind, mover m0, mover m1, mover m2, mover m3, float rounding)
{
  apartness r;
  fvec3 x1 = mover_offset(m1, m0), x2 = mover_offset(m2, m0), x3 = mover_offset(m3, m0);
  fvec3 middle = kind == 0 ? fvec3_make(-0.33333334f * (x1.x + x2.x + x3.x), -0.33333334f * (x1.y + x2.y + x3.y), -0.33333334f * (x1.z + x2.z + x3.z))
                           : fvec3_make(0.5f * (x1.x - x2.x - x3.x), 0.5f * (x1.y - x2.y - x3.y), 0.5f * (x1.z - x2.z - x3.z));
  float scale;
  r.direction = middle;
  r.gap = hulls_apart(kind, x1, x2, x3, middle);
  r.size = fvec3_dot(middle, middle);
  r = wider_apart(kind, x1, x2, x3, across(middle, kind == 0 ? fvec3_sub(x2, x1) : x1), r);
  r = wider_apart(kind, x1, x2, x3, across(middle, fvec3_sub(x3, x2)), r);
  scale = r.size > 1e-30f ? 0.999999f * float_inverse_root(r.size) : 0.0f;
  r.direction = fvec3_scale(scale, r.direction);
  r.gap = r.gap * scale - mover_spent(kind, m0, m1, m2, m3, rounding);
  r.gap = r.gap > mover_thickness(kind, m0, m1, m2, m3) ? r.gap : 0.0f;
  return r;
}

/* Pairs that a work-item tells apart side by side. */
#define ABREAST (LANES == 1 ? 1 : 8)

/* Of one vertex of each pair. */
typedef struct { float x[ABREAST], y[ABREAST], z[ABREAST], dx[ABREAST], dy[ABREAST], dz[ABREAST], thickness[ABREAST], radius[ABREAST]; } movers_abreast;

DEVICE mover mover_of(const movers_abreast *m, int k)
{
  mover r;
  r.x = m->x[k]; r.y = m->y[k]; r.z = m->z[k];
  r.dx = m->dx[k]; r.dy = m->dy[k]; r.dz = m->dz[k];
  r.thickness = m->thickness[k]; r.radius = m->radius[k];
  return r;
}

/* Pairs that movers can tell to be no contact, at a fraction of the cost of their closest points: room, how far apart they are along
   `direction`, from side B to side A, at least until the prediction, m; 0 for the others. */
KERNEL tell_apart(int n, int kind, GLOBAL const pair *pairs, GLOBAL const face_nodes *face, GLOBAL const edge_nodes *edge,
                  GLOBAL const mover *movers, GLOBAL const float *spare, GLOBAL fvec3 *direction, GLOBAL float *room)
{
  int batches = (n - 1) / ABREAST + 1;
  float rounding = spare[0];
  FOR_EACH(b, batches)
  {
    movers_abreast m[4];
    float gap[ABREAST], x[ABREAST], y[ABREAST], z[ABREAST];
    int first = ABREAST * b, count = min_int(ABREAST, n - first);
    for (int j = 0; j < ABREAST; ++j) {
      element_nodes e = pair_nodes(kind, pairs[first + min_int(j, count - 1)], face, edge);
      for (int k = 0; k < 4; ++k) {
        mover v = movers[e.node[k]];
        m[k].x[j] = v.x; m[k].y[j] = v.y; m[k].z[j] = v.z;
        m[k].dx[j] = v.dx; m[k].dy[j] = v.dy; m[k].dz[j] = v.dz;
        m[k].thickness[j] = v.thickness; m[k].radius[j] = v.radius;
      }
    }
    if (kind == 0) {
      SIMD
      for (int j = 0; j < ABREAST; ++j) {
        apartness r = apart_along(0, mover_of(m, j), mover_of(m + 1, j), mover_of(m + 2, j), mover_of(m + 3, j), rounding);
        gap[j] = r.gap; x[j] = r.direction.x; y[j] = r.direction.y; z[j] = r.direction.z;
      }
    } else {
      SIMD
      for (int j = 0; j < ABREAST; ++j) {
        apartness r = apart_along(1, mover_of(m, j), mover_of(m + 1, j), mover_of(m + 2, j), mover_of(m + 3, j), rounding);
        gap[j] = r.gap; x[j] = r.direction.x; y[j] = r.direction.y; z[j] = r.direction.z;
      }
    }
    for (int j = 0; j < count; ++j) {
      direction[first + j] = fvec3_make(x[j], y[j], z[j]);
      room[first + j] = gap[j];
    }
  }
}

/* Pair i of the two candidate lists one behind the other, vertex-face first. */
DEVICE pair listed_pair(int i, int first_size, GLOBAL const pair *vertex_face, GLOBAL const pair *edge_edge)
{
  return i < first_size ? vertex_face[i] : edge_edge[i - first_size];
}

/* flag[i] = 1 where candidate i of both lists is a contact; direction: one that tells its sides apart, from side B to side A; room: how far
   apart, m, they are along it at least until the prediction, 0 where that is not known to exceed the thickness. Both come from tell_apart;
   here pairs without room are looked at. */
KERNEL find_contacts(int n, int first_size, GLOBAL const pair *vertex_face, GLOBAL const pair *edge_edge, GLOBAL const face_nodes *face,
                     GLOBAL const edge_nodes *edge, GLOBAL const dvec3 *position, GLOBAL const dvec3 *predicted, GLOBAL const mover *movers,
                     GLOBAL const float *spare, GLOBAL const vertex_contact *v, double anticipate, GLOBAL int *flag,
                     GLOBAL fvec3 *vertex_face_direction, GLOBAL float *vertex_face_room, GLOBAL fvec3 *edge_edge_direction,
                     GLOBAL float *edge_edge_room)
{
  FOR_EACH_UNEVEN(i, n)
  {
    contact c;
    int kind = i >= first_size, at = kind == 0 ? i : i - first_size, hit = 0;
    if (!((kind == 0 ? vertex_face_room[at] : edge_edge_room[at]) > 0.0f)) {
      element_nodes e = pair_nodes(kind, listed_pair(i, first_size, vertex_face, edge_edge), face, edge);
      proximity p = surface_proximity(kind, e, position, v);
      hit = make_contact(kind, e, position, predicted, v, anticipate, p, &c);
      if (kind == 0) vertex_face_direction[at] = to_direction(p.normal); else edge_edge_direction[at] = to_direction(p.normal);
      if (!hit) {   /* the direction of the closest points may tell more */
        mover m0 = movers[e.node[0]], m1 = movers[e.node[1]], m2 = movers[e.node[2]], m3 = movers[e.node[3]];
        fvec3 normal = fvec3_make(0.999999f * (float)p.normal.x, 0.999999f * (float)p.normal.y, 0.999999f * (float)p.normal.z);
        float room = hulls_apart(kind, mover_offset(m1, m0), mover_offset(m2, m0), mover_offset(m3, m0), normal) -
                     mover_spent(kind, m0, m1, m2, m3, spare[0]);
        if (room > mover_thickness(kind, m0, m1, m2, m3)) {
          if (kind == 0) vertex_face_room[at] = room; else edge_edge_room[at] = room;
        }
      }
    }
    flag[i] = hit;
  }
}

#define SIDES 6            /* +x, -x, +y, -y, +z, -z */
#define SIDE_COMPONENT 0.45 /* a direction points to every side along which its component is larger than this, to one at least */

DEVICE double side_component(dvec3 n, int side) { return (side & 1) ? -dcomponent(n, side >> 1) : dcomponent(n, side >> 1); }

/* nearest[SIDES v + side]: bits of the smallest distance (float, m) at which cloth vertex v has a contact on that side. */
KERNEL nearest_contacts(int n, int first_size, GLOBAL const pair *vertex_face, GLOBAL const pair *edge_edge, GLOBAL const face_nodes *face,
                        GLOBAL const edge_nodes *edge, GLOBAL const dvec3 *position, GLOBAL const vertex_contact *v, int cloth_vertex_count,
                        GLOBAL const int *flag, GLOBAL int *nearest)
{
  FOR_EACH(i, n)
  {
    element_nodes e;
    proximity p;
    int k, side, kind = i >= first_size;
    if (!flag[i]) continue;
    e = pair_nodes(kind, listed_pair(i, first_size, vertex_face, edge_edge), face, edge);
    p = surface_proximity(kind, e, position, v);
    for (k = 0; k < 4; ++k) {
      dvec3 towards = k <= kind ? dscale(-1.0, p.normal) : p.normal;
      if (e.node[k] >= cloth_vertex_count) continue;
      for (side = 0; side < SIDES; ++side)
        if (side_component(towards, side) > SIDE_COMPONENT) atomic_min_int(nearest + SIDES * e.node[k] + side, float_bits((float)p.distance));
    }
  }
}

/* Takes back anticipated contacts through other cloth: one of their vertices has a contact on the same side that is nearer by more than
   the thickness. The term of such a pair would pull its sides together through what lies between them. */
KERNEL drop_hidden_contacts(int n, int first_size, GLOBAL const pair *vertex_face, GLOBAL const pair *edge_edge, GLOBAL const face_nodes *face,
                            GLOBAL const edge_nodes *edge, GLOBAL const dvec3 *position, GLOBAL const vertex_contact *v,
                            int cloth_vertex_count, GLOBAL const int *nearest, GLOBAL int *flag)
{
  FOR_EACH(i, n)
  {
    element_nodes e;
    proximity p;
    double thickness;
    int k, side, hidden = 0, kind = i >= first_size;
    if (!flag[i]) continue;
    e = pair_nodes(kind, listed_pair(i, first_size, vertex_face, edge_edge), face, edge);
    p = surface_proximity(kind, e, position, v);
    thickness = pair_thickness(kind, e, v);
    if (!(p.distance > thickness)) continue;
    for (k = 0; k < 4; ++k) {
      dvec3 towards = k <= kind ? dscale(-1.0, p.normal) : p.normal;
      if (e.node[k] >= cloth_vertex_count) continue;
      for (side = 0; side < SIDES; ++side)
        if (side_component(towards, side) > SIDE_COMPONENT)
          hidden |= p.distance > (double)bits_float(nearest[SIDES * e.node[k] + side]) + thickness;
    }
    if (hidden) flag[i] = 0;
  }
}

/* The directions alone, from pair `first` on, for a search that contacts are not wanted from. */
KERNEL find_directions(int n, int kind, int first, GLOBAL const pair *pairs, GLOBAL const face_nodes *face, GLOBAL const edge_nodes *edge,
                       GLOBAL const dvec3 *position, GLOBAL const vertex_contact *v, GLOBAL fvec3 *direction)
{
  FOR_EACH(i, n) { direction[first + i] = to_direction(surface_proximity(kind, pair_nodes(kind, pairs[first + i], face, edge), position, v).normal); }
}

/* The flagged pairs of both lists with a key by their features, so that lists made from them have one order whatever the search's was:
   vertex-face pairs first. */
KERNEL flagged_pairs(int n, int first_size, GLOBAL const pair *vertex_face, GLOBAL const pair *edge_edge, GLOBAL const int *place,
                     GLOBAL key64 *key, GLOBAL int *index)
{
  FOR_EACH(i, n)
  {
    pair p;
    if (place[i + 1] == place[i]) continue;
    p = listed_pair(i, first_size, vertex_face, edge_edge);
    key[place[i]] = ((key64)(i >= first_size) << 62) | ((key64)p.a << 31) | (key64)p.b;
    index[place[i]] = i;
  }
}

/* Contacts of the pairs index[0 .. n). */
KERNEL fill_contacts(int n, int first_size, GLOBAL const int *index, GLOBAL const pair *vertex_face, GLOBAL const pair *edge_edge,
                     GLOBAL const face_nodes *face, GLOBAL const edge_nodes *edge, GLOBAL const dvec3 *position, GLOBAL const dvec3 *predicted,
                     GLOBAL const vertex_contact *v, double anticipate, GLOBAL contact *contacts)
{
  FOR_EACH(i, n)
  {
    contact c;
    int k, kind = index[i] >= first_size;
    element_nodes e = pair_nodes(kind, listed_pair(index[i], first_size, vertex_face, edge_edge), face, edge);
    c.kind = kind;
    c.candidate = kind == 0 ? index[i] : index[i] - first_size;
    c.normal = dvec3_make(0.0, 0.0, 1.0);
    c.distance = c.thickness = c.stiffness = c.friction = c.static_friction = 0.0;
    for (k = 0; k < 4; ++k) { c.node[k] = e.node[k]; c.weight[k] = 0.0; }
    make_contact(kind, e, position, predicted, v, anticipate, surface_proximity(kind, e, position, v), &c);
    contacts[i] = c;
  }
}

/* Number of nodes on side A: 1 for vertex-face, 2 for edge-edge. */
KERNEL contact_splits(int n, GLOBAL const contact *contacts, GLOBAL int *split) { FOR_EACH(i, n) { split[i] = contacts[i].kind + 1; } }

KERNEL contact_nodes(int n, GLOBAL const contact *contacts, GLOBAL element_nodes *nodes)
{
  FOR_EACH(i, n)
  {
    int a;
    for (a = 0; a < 4; ++a) nodes[i].node[a] = contacts[i].node[a];
  }
}

/* Nodes of stitches, behind `first`. */
KERNEL stitch_nodes(int n, GLOBAL const stitch *stitches, int first, GLOBAL element_nodes *nodes)
{
  FOR_EACH(i, n)
  {
    int a;
    for (a = 0; a < 3; ++a) nodes[first + i].node[a] = stitches[i].node[a];
    nodes[first + i].node[3] = -1;
  }
}

/* Force of the penalty, N; pairs that are only anticipated push nothing yet. */
DEVICE double contact_load(contact c) { return c.stiffness * max_double(c.thickness - c.distance, 0.0); }

/* Normal load that its contacts lay on each cloth vertex, N. incidence: 4 * term + local index; terms from `contact_count` on are stitches. */
KERNEL vertex_loads(int n, int contact_count, GLOBAL const int *row, GLOBAL const int *incidence, GLOBAL const contact *contacts,
                    GLOBAL double *load)
{
  FOR_EACH(i, n)
  {
    double sum = 0.0;
    int k;
    for (k = row[i]; k < row[i + 1]; ++k)
      if ((incidence[k] >> 2) < contact_count)
        sum += fabs(contacts[incidence[k] >> 2].weight[incidence[k] & 3]) * contact_load(contacts[incidence[k] >> 2]);
    load[i] = sum;
  }
}
