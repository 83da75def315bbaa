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

/* The direction between the middles of both sides if along it the pair is further apart than `distance` by more than its vertices move
   against each other until the prediction: then it is no contact, at a quarter of the cost of its closest points. Else the zero vector. */
DEVICE dvec3 apart_along(int kind, element_nodes e, GLOBAL const dvec3 *position, GLOBAL const dvec3 *predicted, double distance)
{
  dvec3 o = position[e.node[0]], p = predicted[e.node[0]], x[4], moved[4], n;
  double low = 0.0, high = -1e300, most = 0.0, room;
  int k, j;
  x[0] = moved[0] = dvec3_make(0.0, 0.0, 0.0);
  for (k = 1; k < 4; ++k) {
    x[k] = dsub(position[e.node[k]], o);
    moved[k] = dsub(dsub(predicted[e.node[k]], p), x[k]);
  }
  n = kind == 0 ? dscale(-1.0 / 3.0, dadd(dadd(x[1], x[2]), x[3])) : dscale(0.5, dsub(x[1], dadd(x[2], x[3])));
  n = dnormalize(n);
  if (kind == 1) low = min_double(0.0, ddot(n, x[1]));
  for (k = kind + 1; k < 4; ++k) high = max_double(high, ddot(n, x[k]));
  room = low - high - distance;
  for (j = 0; j <= kind; ++j)
    for (k = kind + 1; k < 4; ++k) {
      dvec3 d = dsub(moved[j], moved[k]);
      most = max_double(most, ddot(d, d));
    }
  return room > 0.0 && room * room > most ? n : dvec3_make(0.0, 0.0, 0.0);
}

/* flag[i] = 1 where candidate i is a contact; direction[i]: one that tells its sides apart, from side B to side A. */
KERNEL find_contacts(int n, int kind, GLOBAL const pair *pairs, GLOBAL const face_nodes *face, GLOBAL const edge_nodes *edge,
                     GLOBAL const dvec3 *position, GLOBAL const dvec3 *predicted, GLOBAL const vertex_contact *v,
                     double anticipate, GLOBAL int *flag, GLOBAL dvec3 *direction)
{
  FOR_EACH(i, n)
  {
    contact c;
    element_nodes e = pair_nodes(kind, pairs[i], face, edge);
    dvec3 apart = pair_has_plane(kind, e, v) ? dvec3_make(0.0, 0.0, 0.0)
                                             : apart_along(kind, e, position, predicted, pair_thickness(kind, e, v) + pair_radius(kind, e, v));
    int none = apart.x != 0.0 || apart.y != 0.0 || apart.z != 0.0;
    proximity p;
    if (!none) p = surface_proximity(kind, e, position, v);
    direction[i] = none ? apart : p.normal;
    flag[i] = !none && make_contact(kind, e, position, predicted, v, anticipate, p, &c);
  }
}

#define SIDES 6            /* +x, -x, +y, -y, +z, -z */
#define SIDE_COMPONENT 0.45 /* a direction points to every side along which its component is larger than this, to one at least */

DEVICE double side_component(dvec3 n, int side) { return (side & 1) ? -dcomponent(n, side >> 1) : dcomponent(n, side >> 1); }

/* nearest[SIDES v + side]: bits of the smallest distance (float, m) at which cloth vertex v has a contact on that side. */
KERNEL nearest_contacts(int n, int kind, GLOBAL const pair *pairs, GLOBAL const face_nodes *face, GLOBAL const edge_nodes *edge,
                        GLOBAL const dvec3 *position, GLOBAL const vertex_contact *v, int cloth_vertex_count, GLOBAL const int *flag,
                        GLOBAL int *nearest)
{
  FOR_EACH(i, n)
  {
    element_nodes e;
    proximity p;
    int k, side;
    if (!flag[i]) continue;
    e = pair_nodes(kind, pairs[i], face, edge);
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
KERNEL drop_hidden_contacts(int n, int kind, GLOBAL const pair *pairs, GLOBAL const face_nodes *face, GLOBAL const edge_nodes *edge,
                            GLOBAL const dvec3 *position, GLOBAL const vertex_contact *v, int cloth_vertex_count,
                            GLOBAL const int *nearest, GLOBAL int *flag)
{
  FOR_EACH(i, n)
  {
    element_nodes e;
    proximity p;
    double thickness;
    int k, side, hidden = 0;
    if (!flag[i]) continue;
    e = pair_nodes(kind, pairs[i], face, edge);
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

/* The flagged pairs with a key by their features, so that lists made from them have one order whatever the search's was. */
KERNEL flagged_pairs(int n, GLOBAL const pair *pairs, GLOBAL const int *place, GLOBAL key64 *key, GLOBAL int *index)
{
  FOR_EACH(i, n)
  {
    if (place[i + 1] == place[i]) continue;
    key[place[i]] = ((key64)pairs[i].a << 31) | (key64)pairs[i].b;
    index[place[i]] = i;
  }
}

/* Contacts of the pairs index[0 .. n), behind `first`. */
KERNEL fill_contacts(int n, int kind, GLOBAL const int *index, GLOBAL const pair *pairs, GLOBAL const face_nodes *face,
                     GLOBAL const edge_nodes *edge, GLOBAL const dvec3 *position, GLOBAL const dvec3 *predicted,
                     GLOBAL const vertex_contact *v, double anticipate, int first, GLOBAL contact *contacts)
{
  FOR_EACH(i, n)
  {
    contact c;
    element_nodes e = pair_nodes(kind, pairs[index[i]], face, edge);
    int k;
    c.kind = kind;
    c.candidate = index[i];
    c.normal = dvec3_make(0.0, 0.0, 1.0);
    c.distance = c.thickness = c.stiffness = c.friction = c.static_friction = 0.0;
    for (k = 0; k < 4; ++k) { c.node[k] = e.node[k]; c.weight[k] = 0.0; }
    make_contact(kind, e, position, predicted, v, anticipate, surface_proximity(kind, e, position, v), &c);
    contacts[first + i] = c;
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
