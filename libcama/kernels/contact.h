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

/* What tells most pairs apart, per vertex: position and motion until the prediction relative to the scene's lower corner, contact thickness
   and radius, all m. Rounded: what is told by it is told with MOVER_ROUNDING of the scene's extent to spare. */
typedef struct { float x[3], move[3], thickness, radius; } mover;
#define MOVER_ROUNDING 1e-6

/* A plane's radius is without end, so that movers tell nothing of it. */
KERNEL make_movers(int n, GLOBAL const dvec3 *position, GLOBAL const dvec3 *predicted, GLOBAL const dvec3 *scene_bounds,
                   GLOBAL const vertex_contact *v, GLOBAL mover *movers)
{
  FOR_EACH(i, n)
  {
    mover m;
    int k;
    for (k = 0; k < 3; ++k) {
      m.x[k] = (float)(dcomponent(position[i], k) - dcomponent(scene_bounds[0], k));
      m.move[k] = (float)(dcomponent(predicted[i], k) - dcomponent(position[i], k));
    }
    m.thickness = float_above(v[i].thickness);
    m.radius = v[i].form == SURFACE_PLANE ? 1e30f : float_above(v[i].radius);
    movers[i] = m;
  }
}

DEVICE dvec3 mover_offset(mover a, mover b) { return dvec3_make((double)a.x[0] - (double)b.x[0], (double)a.x[1] - (double)b.x[1], (double)a.x[2] - (double)b.x[2]); }
DEVICE dvec3 mover_motion(mover a, mover b) { return dvec3_make((double)a.move[0] - (double)b.move[0], (double)a.move[1] - (double)b.move[1], (double)a.move[2] - (double)b.move[2]); }

/* How far a pair's hulls are apart along a direction of any length, m; x: vertices 1 to 3 relative to 0. unit: the direction, no longer than 1. */
DEVICE double hulls_apart(int kind, dvec3 x1, dvec3 x2, dvec3 x3, dvec3 direction, dvec3 *unit)
{
  double length = dnorm(direction), low = 0.0, high;
  dvec3 n = dscale(length > 0.0 ? (1.0 - 1e-12) / length : 0.0, direction);
  high = max_double(ddot(n, x2), ddot(n, x3));
  if (kind == 0) high = max_double(high, ddot(n, x1)); else low = min_double(0.0, ddot(n, x1));
  *unit = n;
  return low - high;
}

/* `a` less its part along b, scaled by |b|^2. */
DEVICE dvec3 across(dvec3 a, dvec3 b) { return dsub(dscale(ddot(b, b), a), dscale(ddot(a, b), b)); }

/* room: the least distance of a pair's surfaces until the prediction as far as one of a few directions can tell: along it now, less what its
   vertices move against each other; 0 if that does not exceed the thickness. A pair with room is no contact, at a fraction of the cost of
   its closest points. Directions: between the middles of both sides; of two edges, that across either of them. */
typedef struct { double spent, thickness, room; dvec3 direction; } apartness; /* spent: radii, motion and rounding, m */

DEVICE apartness apart_along(int kind, element_nodes e, GLOBAL const mover *movers, double rounding)
{
  mover m[4];
  apartness r;
  dvec3 x1, x2, x3, middle, d;
  double most;
  int k;
  for (k = 0; k < 4; ++k) m[k] = movers[e.node[k]];
  x1 = mover_offset(m[1], m[0]);
  x2 = mover_offset(m[2], m[0]);
  x3 = mover_offset(m[3], m[0]);
  d = mover_motion(m[0], m[2]);
  most = ddot(d, d);
  d = mover_motion(m[0], m[3]);
  most = max_double(most, ddot(d, d));
  d = mover_motion(m[1], m[kind == 0 ? 0 : 2]);
  most = max_double(most, ddot(d, d));
  if (kind == 0) {
    middle = dscale(-1.0 / 3.0, dadd(dadd(x1, x2), x3));
    r.thickness = 0.5 * (double)m[0].thickness + ((double)m[1].thickness + (double)m[2].thickness + (double)m[3].thickness) * (1.0 / 6.0);
  } else {
    middle = dscale(0.5, dsub(x1, dadd(x2, x3)));
    d = mover_motion(m[1], m[3]);
    most = max_double(most, ddot(d, d));
    r.thickness = mean4((double)m[0].thickness, (double)m[1].thickness, (double)m[2].thickness, (double)m[3].thickness);
  }
  r.thickness *= 1.000001;
  r.spent = sqrt(most) + (double)m[0].radius + (double)m[kind + 1].radius + rounding;
  r.room = hulls_apart(kind, x1, x2, x3, middle, &r.direction) - r.spent;
  if (kind == 1 && !(r.room > r.thickness)) {
    r.room = hulls_apart(kind, x1, x2, x3, across(middle, x1), &r.direction) - r.spent;
    if (!(r.room > r.thickness)) r.room = hulls_apart(kind, x1, x2, x3, across(middle, dsub(x3, x2)), &r.direction) - r.spent;
  }
  if (!(r.room > r.thickness)) r.room = 0.0;
  return r;
}

/* Pair i of the two candidate lists one behind the other, vertex-face first. */
DEVICE pair listed_pair(int i, int first_size, GLOBAL const pair *vertex_face, GLOBAL const pair *edge_edge)
{
  return i < first_size ? vertex_face[i] : edge_edge[i - first_size];
}

/* flag[i] = 1 where candidate i of both lists is a contact; direction: one that tells its sides apart, from side B to side A; room: how far
   apart, m, they are along it at least until the prediction, 0 where that is not known to exceed the thickness. */
KERNEL find_contacts(int n, int first_size, GLOBAL const pair *vertex_face, GLOBAL const pair *edge_edge, GLOBAL const face_nodes *face,
                     GLOBAL const edge_nodes *edge, GLOBAL const dvec3 *position, GLOBAL const dvec3 *predicted, GLOBAL const mover *movers,
                     GLOBAL const dvec3 *scene_bounds, GLOBAL const vertex_contact *v, double anticipate, GLOBAL int *flag,
                     GLOBAL dvec3 *vertex_face_direction, GLOBAL float *vertex_face_room, GLOBAL dvec3 *edge_edge_direction,
                     GLOBAL float *edge_edge_room)
{
  FOR_EACH_UNEVEN(i, n)
  {
    contact c;
    int kind = i >= first_size, hit = 0;
    element_nodes e = pair_nodes(kind, listed_pair(i, first_size, vertex_face, edge_edge), face, edge);
    double rounding = MOVER_ROUNDING * largest_component(dsub(scene_bounds[1], scene_bounds[0])) +
                      1e-15 * max_double(largest_component(scene_bounds[0]), largest_component(scene_bounds[1]));
    apartness r = apart_along(kind, e, movers, rounding);
    dvec3 direction = r.direction;
    double room = r.room;
    if (!(room > 0.0)) {
      proximity p = surface_proximity(kind, e, position, v);
      direction = p.normal;
      hit = make_contact(kind, e, position, predicted, v, anticipate, p, &c);
      if (!hit && p.distance + rounding > r.spent + r.thickness) {   /* the direction of the closest points may tell more */
        dvec3 o = position[e.node[0]], unit;
        room = hulls_apart(kind, dsub(position[e.node[1]], o), dsub(position[e.node[2]], o), dsub(position[e.node[3]], o), direction, &unit) - r.spent;
        if (!(room > r.thickness)) room = 0.0;
      }
    }
    flag[i] = hit;
    if (kind == 0) {
      vertex_face_direction[i] = direction;
      vertex_face_room[i] = float_below(room);
    } else {
      edge_edge_direction[i - first_size] = direction;
      edge_edge_room[i - first_size] = float_below(room);
    }
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
                       GLOBAL const dvec3 *position, GLOBAL const vertex_contact *v, GLOBAL dvec3 *direction)
{
  FOR_EACH(i, n) { direction[first + i] = surface_proximity(kind, pair_nodes(kind, pairs[first + i], face, edge), position, v).normal; }
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
