// SPDX-License-Identifier: Apache-2.0
#include "model/setup.hpp"

#include <algorithm>
#include <cstdio>

#include "model/plate.hpp"

namespace cama {
namespace {

constexpr double without_end = 1e30;         // m; boxes of planes
// Of the thickness: half for the contact distance, the rest for what the solve adds to the prediction.
constexpr double contact_margin = 0.6;

/// In single precision a vertex's mass is lost beside h^2 k, and with it the motion: from a ratio of 2e10 on, cloth was
/// seen to stretch. Throws MaterialError.
void refuse_stiffness_beyond_single(const State &state, const Scene &scene, const Topology &t)
{
  constexpr double largest = 8e9;
  const double step = std::max(state.time.step, state.time.longest);
  for (std::size_t c = 0; c < scene.cloths.size(); ++c) {
    const Material &material = scene.cloths[c].material;
    double stiffness = 0;
    for (const auto &row : material.stretching)
      stiffness = std::max(stiffness, *std::max_element(row.begin(), row.end()));
    const auto first = t.mass.begin() + t.cloth_range[c].first,
               lightest = std::min_element(first, t.mass.begin() + t.cloth_range[c].second);
    if (step * (step + material.damping) * stiffness <= largest * *lightest) continue;
    char text[160];
    std::snprintf(text, sizeof text,
                  "%.3g N/m with steps of %.3g s and vertex %d of %.3g kg is beyond single precision; use "
                  "precision mixed or double, or shorter steps",
                  stiffness, step, static_cast<int>(lightest - first), *lightest);
    throw MaterialError("cloth '" + scene.cloths[c].name + "': stiffness of " + text);
  }
}

template <class Real> void set_up_materials(State &state, System<Real> &s, Backend &b, const Scene &scene, bool hinges)
{
  using T = Types<Real>;
  std::vector<typename T::stretching_stiffness> table;
  std::vector<typename T::bending_stiffness> bending;
  std::vector<int> start;
  std::vector<Real> scale;
  const auto push = [&](const std::array<double, 4> &row) {
    typename T::stretching_stiffness k;
    for (int m = 0; m < 4; ++m) k.k[m] = static_cast<Real>(row[m]);
    table.push_back(k);
  };
  for (std::size_t c = 0; c < scene.cloths.size(); ++c) {
    const Material &material = scene.cloths[c].material;
    std::size_t same = 0;
    while (same < c && scene.cloths[same].material.stretching != material.stretching) ++same;
    if (same < c) {
      start.push_back(start[same]);
    } else if (material.has_table()) {
      start.push_back(static_cast<int>(table.size()));
      for (const auto &row : stretching_table(material)) push(row);
    } else {
      start.push_back(-1 - static_cast<int>(table.size()));
      push(material.stretching[0]);
    }
    typename T::bending_stiffness k;
    for (int m = 0; m < 15; ++m) k.k[m] = static_cast<Real>(material.bending[m / 5][m % 5]);
    bending.push_back(k);
    scale.push_back(static_cast<Real>(state.time.step * (state.time.step + material.damping)));
    state.elements.damping.push_back(material.damping);
  }
  state.time.implicit_step = state.system.scaled_step = state.time.step;
  s.stretching_table = Stream<typename T::stretching_stiffness>(b, table);
  if (has_strain_limit(scene)) {
    std::vector<typename T::strain_limit> limit;
    for (const Cloth &c : scene.cloths) {
      const double stretch = 1 + c.material.strain_limit;
      limit.push_back(
          {static_cast<Real>((stretch * stretch - 1) / 2), static_cast<Real>(c.material.limit_stiffening - 1)});
    }
    s.strain_limit = Stream<typename T::strain_limit>(b, limit);
  }
  s.stretching_start = Stream<int>(b, start);
  if (hinges) s.bending_table = Stream<typename T::bending_stiffness>(b, bending);
  s.material_scale = Stream<Real>(b, scale);
}

template <class Real>
void set_up_plasticity(State &state, System<Real> &s, const Scene &scene, const Topology &t, const Plate &plate)
{
  using T = Types<Real>;
  Backend &b = *state.backend;
  std::vector<typename T::plastic_material> materials;
  for (const Cloth &c : scene.cloths) materials.push_back({c.material.yield_curvature, c.material.hardening});
  const PlasticPlate plastic = plastic_plate(scene, t, plate);
  std::vector<typename T::plastic_triangle> triangles;
  for (std::size_t f = 0; f < t.triangle.size(); ++f) {
    typename T::plastic_triangle e{};
    e.material = t.triangle[f].material;
    for (int k = 0; k < 3; ++k) {
      e.hinge[k] = plastic.triangle[f].hinge[k];
      for (int c = 0; c < 3; ++c) e.curvature[k][c] = plastic.triangle[f].curvature[k][c];
    }
    triangles.push_back(e);
  }
  std::vector<typename T::plastic_hinge> hinges;
  for (std::size_t i = 0; i < t.hinge.size(); ++i) {
    typename T::plastic_hinge e{};
    e.rest_angle = t.hinge[i].rest_angle;
    for (int k = 0; k < 2; ++k) {
      e.triangle[k] = t.hinge[i].triangle[k];
      for (int c = 0; c < 3; ++c) e.angle[k][c] = plastic.hinge[i].angle[k][c];
    }
    hinges.push_back(e);
  }
  s.plastic_material = Stream<typename T::plastic_material>(b, materials);
  s.plastic_triangle = Stream<typename T::plastic_triangle>(b, triangles);
  s.plastic_hinge = Stream<typename T::plastic_hinge>(b, hinges);
  for (Stream<dvec3> *curvature : {&state.elements.plastic_curvature, &state.elements.plastic_curvature_next}) {
    *curvature = Stream<dvec3>(b, state.mesh.triangles);
    curvature->fill_zero();
  }
}

template <class Real> void set_up_gas(State &state, System<Real> &s, const Scene &scene, const Topology &t)
{
  constexpr int part_size = 8 * GAS_TEAM;
  constexpr double least_share = 1e-3;  // of the volume that the pressure is given at
  Backend &b = *state.backend;
  EnclosedGas &room = state.system.gas;
  std::vector<kernels::gas> gases;
  std::vector<kernels::gas_part> triangle_part, vertex_part;
  std::vector<int> gas_of(static_cast<std::size_t>(t.cloth_vertices), -1);
  const auto divide = [&](int first, int end, std::vector<kernels::gas_part> &parts, int &at, int &count) {
    at = static_cast<int>(parts.size());
    for (; first < end; first += part_size)
      parts.push_back({static_cast<int>(gases.size()), first, std::min(end, first + part_size)});
    count = static_cast<int>(parts.size()) - at;
  };
  int triangle = 0;
  for (std::size_t c = 0; c < scene.cloths.size(); ++c) {
    const Cloth &cloth = scene.cloths[c];
    const int first_triangle = triangle;
    triangle += static_cast<int>(cloth.mesh.face.size());
    if (!cloth.gas) continue;
    const auto [first, end] = t.cloth_range[c];
    const double volume = cloth.gas->volume > 0 ? cloth.gas->volume : cloth.enclosed_volume();
    kernels::gas g{};
    g.cloth = static_cast<int>(c);
    g.first_vertex = first;
    divide(first_triangle, triangle, triangle_part, g.triangle_part, g.triangle_parts);
    divide(first, end, vertex_part, g.vertex_part, g.vertex_parts);
    g.amount = (cloth.gas->ambient + cloth.gas->pressure) * volume;
    g.ambient = cloth.gas->ambient;
    g.least_volume = least_share * volume;
    std::fill(gas_of.begin() + first, gas_of.begin() + end, static_cast<int>(gases.size()));
    gases.push_back(g);
  }
  room.gas = Stream<kernels::gas>(b, gases);
  room.triangle_part = Stream<kernels::gas_part>(b, triangle_part);
  room.vertex_part = Stream<kernels::gas_part>(b, vertex_part);
  room.volume = Stream<double>(b, static_cast<int>(triangle_part.size()));
  room.product = Stream<double>(b, static_cast<int>(vertex_part.size()));
  room.state = Stream<kernels::gas_state>(b, static_cast<int>(gases.size()));
  room.gas_of = Stream<int>(b, gas_of);
  s.gas_gradient = Stream<typename Types<Real>::vec3>(b, t.cloth_vertices);
}

template <class Real> void set_up_plate(State &state, System<Real> &s, const Scene &scene, const Topology &t)
{
  using coupling = typename Types<Real>::hinge_coupling;
  Backend &b = *state.backend;
  const Plate plate = couple_hinges(scene, t);
  std::vector<coupling> couplings;
  for (const HingeCoupling &h : plate.hinge) {
    coupling c;
    for (int k = 0; k < 4; ++k) {
      c.neighbour[k] = h.neighbour[k];
      c.coupling[k] = static_cast<Real>(h.coupling[k]);
    }
    c.cloth = h.cloth;
    c.scale = static_cast<Real>(h.scale);
    c.bound = static_cast<Real>(h.bound);
    c.reference = static_cast<Real>(h.reference);
    couplings.push_back(c);
  }
  std::vector<typename Types<Real>::moment_step> steps;
  for (const auto &row : moment_steps(plate.iteration)) {
    for (const MomentStep &step : row)
      steps.push_back({static_cast<Real>(step.momentum), static_cast<Real>(step.share)});
    ++s.moment_iterations;
  }
  --s.moment_iterations;
  s.moment_step = Stream<typename Types<Real>::moment_step>(b, steps);
  s.hinge_coupling = Stream<coupling>(b, couplings);
  for (Stream<Real> *values : {&s.angle_scale, &s.scaled_angle, &s.moment, &s.moment_before})
    *values = Stream<Real>(b, state.mesh.hinges);
  const bool of_rates = state.options.integrator == Integrator::bdf2 || state.options.newton_iterations > 1;
  if (of_rates && has_damping(scene))
    for (Stream<Real> *values : {&s.scaled_rate, &s.rate_moment, &s.rate_moment_before})
      *values = Stream<Real>(b, state.mesh.hinges);
  if (has_yield(scene)) set_up_plasticity(state, s, scene, t, plate);
}

template <class Real> void set_up_elements(State &state, System<Real> &s, const Scene &scene, const Topology &t)
{
  using T = Types<Real>;
  Backend &b = *state.backend;
  std::vector<typename T::triangle_rest> triangles;
  std::vector<typename T::hinge_rest> hinges;
  std::vector<kernels::element_nodes> triangle_nodes, hinge_nodes;
  for (const RestTriangle &r : t.triangle) {
    typename T::triangle_rest e{};
    std::copy(r.node.begin(), r.node.end(), e.node);
    e.material = r.material;
    for (int k = 0; k < 4; ++k) e.d[k] = static_cast<Real>(r.d[k]);
    e.area = static_cast<Real>(r.area);
    triangles.push_back(e);
    triangle_nodes.push_back({{r.node[0], r.node[1], r.node[2], -1}});
  }
  for (const RestHinge &r : t.hinge) {
    typename T::hinge_rest e{};
    std::copy(r.node.begin(), r.node.end(), e.node);
    e.material = r.material;
    e.rest_angle = static_cast<Real>(r.rest_angle);
    e.length = static_cast<Real>(r.length);
    e.area = static_cast<Real>(r.area);
    for (int k = 0; k < 2; ++k) e.direction[k] = static_cast<Real>(r.direction[k]);
    hinges.push_back(e);
    hinge_nodes.push_back({{r.node[0], r.node[1], r.node[2], r.node[3]}});
  }
  const auto incidence = [&](Incidence &list, const Stream<kernels::element_nodes> &nodes, int n) {
    Stream<int> count(b, state.mesh.cloth_vertices);
    list.reset(b, state.mesh.cloth_vertices);
    list.build(b, nodes, n, count);
  };
  s.triangle_rest = Stream<typename T::triangle_rest>(b, triangles);
  s.triangle_factor = Stream<typename T::triangle_factor>(b, state.mesh.triangles);
  s.triangle_force = Stream<typename T::vec3>(b, 3 * state.mesh.triangles);
  state.elements.triangle_nodes = Stream<kernels::element_nodes>(b, triangle_nodes);
  incidence(state.elements.triangle_incidence, state.elements.triangle_nodes, state.mesh.triangles);
  if (state.mesh.hinges == 0) return;
  s.hinge_rest = Stream<typename T::hinge_rest>(b, hinges);
  s.hinge_factor = Stream<typename T::hinge_factor>(b, state.mesh.hinges);
  s.hinge_force = Stream<typename T::vec3>(b, 4 * state.mesh.hinges);
  if (state.options.bending == Bending::plate && !state.options.arcsim_conventions) set_up_plate(state, s, scene, t);
  state.elements.hinge_nodes = Stream<kernels::element_nodes>(b, hinge_nodes);
  incidence(state.elements.hinge_incidence, state.elements.hinge_nodes, state.mesh.hinges);
}

/// The vertices beside each edge in the first two of its faces; -1 where there is none.
std::vector<kernels::edge_nodes> wings_of(const std::vector<kernels::edge_nodes> &edges,
                                          const std::vector<kernels::face_nodes> &faces)
{
  struct Side {
    std::array<int, 2> edge;
    int beside;
  };
  std::vector<Side> sides;
  for (const kernels::face_nodes &f : faces)
    for (int k = 0; k < 3; ++k) {
      const int a = f.node[k], b = f.node[(k + 1) % 3], beside = f.node[(k + 2) % 3];
      if (a != b && b != beside && a != beside) sides.push_back({{std::min(a, b), std::max(a, b)}, beside});
    }
  std::stable_sort(sides.begin(), sides.end(), [](const Side &a, const Side &b) { return a.edge < b.edge; });
  std::vector<kernels::edge_nodes> wings;
  for (const kernels::edge_nodes &e : edges) {
    const std::array<int, 2> key = {std::min(e.node[0], e.node[1]), std::max(e.node[0], e.node[1])};
    auto side =
        std::lower_bound(sides.begin(), sides.end(), key, [](const Side &a, const auto &k) { return a.edge < k; });
    kernels::edge_nodes w{{-1, -1}};
    for (int k = 0; k < 2 && side != sides.end() && side->edge == key; ++k, ++side) w.node[k] = side->beside;
    wings.push_back(w);
  }
  return wings;
}

void set_up_contact(State &state, const Scene &scene, const Topology &t, const std::vector<double> &inverse_mass)
{
  Backend &b = *state.backend;
  state.contact.friction = has_friction(scene);
  state.bounds.predicted = Stream<dvec3>(b, state.mesh.vertices);
  state.mesh.inverse_mass = Stream<double>(b, inverse_mass);
  std::vector<kernels::face_nodes> faces;
  std::vector<kernels::edge_nodes> edges;
  std::vector<kernels::vertex_contact> properties(t.position.size());
  std::vector<double> margin(t.position.size());
  std::vector<int> query_vertices;
  state.contact.largest_thickness = 0;
  for (const auto *list : {&t.face, &t.exact_face})
    for (const Triangle &f : *list) faces.push_back({{f[0], f[1], f[2]}});
  for (const auto &e : t.edge) {
    // A box's edges without the diagonals of its sides: corners along an edge differ in one bit.
    if (t.shape[e[0]] == ObstacleShape::box) {
      const int first = t.obstacle_range[static_cast<std::size_t>(t.object[e[0]]) - scene.cloths.size()].first,
                bits = (e[0] - first) ^ (e[1] - first);
      if (bits & (bits - 1)) continue;
    }
    edges.push_back({{e[0], e[1]}});
  }
  const auto of_obstacle = [&](const kernels::edge_nodes &e) { return e.node[0] >= t.cloth_vertices; };
  if (!scene.contact.self && std::none_of(edges.begin(), edges.end(), of_obstacle))
    edges.clear();  // the cloth's edges have none to collide with
  state.mesh.edges = static_cast<int>(edges.size());
  for (std::size_t v = 0; v < t.position.size(); ++v) {
    const std::size_t object = static_cast<std::size_t>(t.object[v]), cloths = scene.cloths.size();
    const bool obstacle = object >= cloths;
    kernels::vertex_contact &p = properties[v];
    const ContactProperties own = scene.contact_properties(object);
    p.thickness = own.thickness;
    if (!obstacle) p.thickness = std::min(p.thickness, max_thickness_per_edge * t.shortest_edge[v]);
    state.contact.largest_thickness = std::max(state.contact.largest_thickness, p.thickness);
    p.area = t.area[v];
    p.stiffness = own.stiffness;
    p.friction = own.friction;
    p.static_friction = own.static_friction;
    p.obstacle = obstacle;
    const ObstacleShape shape = t.shape[v];
    p.radius = t.radius[v];
    p.shape = shape == ObstacleShape::plane
                  ? SHAPE_PLANE
                  : (shape == ObstacleShape::sphere || shape == ObstacleShape::capsule ? SHAPE_ROUND : SHAPE_MESH);
    if (shape != ObstacleShape::plane) query_vertices.push_back(static_cast<int>(v));
    margin[v] = shape == ObstacleShape::plane ? without_end : p.radius + contact_margin * p.thickness;
  }
  state.mesh.face = Stream<kernels::face_nodes>(b, faces);
  state.mesh.edge = Stream<kernels::edge_nodes>(b, edges);
  state.mesh.edge_wing = Stream<kernels::edge_nodes>(b, wings_of(edges, faces));
  state.contact.vertex_contact = Stream<kernels::vertex_contact>(b, properties);
  state.bounds.margin = Stream<double>(b, margin);
  state.bounds.query_vertices = Stream<int>(b, query_vertices);
  state.bounds.bounds = Stream<dvec3>(b, 2);
  state.bounds.vertex_box = Stream<kernels::box>(b, state.mesh.vertices);
  for (PairList *list : {&state.contact.vertex_face, &state.contact.edge_edge}) {
    list->pairs = Stream<kernels::pair>(b);
    list->direction = Stream<kernels::fvec3>(b);
    list->gap_bound = Stream<float>(b);
  }
  if (!t.seam.empty() || state.options.intersections == StartPolicy::exempt || state.options.pinch == Pinch::release)
    state.exemptions.set_up(b, t);
  state.contact.contact = Stream<kernels::contact>(b);
  state.contact.impact = Stream<kernels::impact>(b);
}

std::vector<kernels::stitch> stitches_of(const Scene &scene, const Topology &t)
{
  std::vector<kernels::stitch> stitches;
  for (const Stitch &s : scene.stitches) {
    const int a = t.cloth_range[s.cloth_a].first, b = t.cloth_range[s.cloth_b].first;
    stitches.push_back({{a + s.vertex_a, b + s.vertex_b, b + s.vertex_c}, s.ratio, s.stiffness, s.length});
  }
  return stitches;
}

}  // namespace

bool has_wind(const Scene &scene) { return scene.wind && (scene.wind->density != 0 || scene.wind->drag != 0); }

bool has_damping(const Scene &scene)
{
  return std::any_of(scene.cloths.begin(), scene.cloths.end(), [](const Cloth &c) { return c.material.damping != 0; });
}

bool has_mass_damping(const Scene &scene)
{
  return std::any_of(scene.cloths.begin(), scene.cloths.end(),
                     [](const Cloth &c) { return c.material.mass_damping != 0; });
}

bool has_yield(const Scene &scene)
{
  return std::any_of(scene.cloths.begin(), scene.cloths.end(),
                     [](const Cloth &c) { return c.material.yield_curvature > 0; });
}

bool has_gas(const Scene &scene)
{
  return std::any_of(scene.cloths.begin(), scene.cloths.end(), [](const Cloth &c) { return c.gas.has_value(); });
}

bool has_strain_limit(const Scene &scene)
{
  return std::any_of(scene.cloths.begin(), scene.cloths.end(),
                     [](const Cloth &c) { return c.material.strain_limit > 0; });
}

bool has_friction(const Scene &scene)
{
  const std::size_t cloths = scene.cloths.size();
  for (std::size_t object = scene.contact.self ? 0 : cloths; object < cloths + scene.obstacles.size(); ++object) {
    const ContactProperties p = scene.contact_properties(object);
    if (p.friction > 0 || p.static_friction > 0) return true;
  }
  return false;
}

template <class Real> void set_up(State &state, const Scene &scene, const Topology &t)
{
  Backend &b = *state.backend;
  System<Real> *s;
  if constexpr (sizeof(Real) == 8)
    s = (state.system.f64 = std::make_unique<System<double>>()).get();
  else
    s = (state.system.f32 = std::make_unique<System<float>>()).get();

  state.time.step = state.options.time_step;
  if (sizeof(Real) == 4) refuse_stiffness_beyond_single(state, scene, t);
  state.contact.settings = scene.contact;
  state.mesh.cloth_vertices = t.cloth_vertices;
  state.mesh.vertices = static_cast<int>(t.position.size());
  state.mesh.triangles = static_cast<int>(t.triangle.size());
  state.mesh.hinges = static_cast<int>(t.hinge.size());
  state.mesh.faces = static_cast<int>(t.face.size() + t.exact_face.size());
  state.mesh.edges = static_cast<int>(t.edge.size());

  state.mesh.object_name = t.object_name;
  for (const auto &range : t.cloth_range) {
    state.mesh.object_first.push_back(range.first);
    state.mesh.object_static.push_back(0);
  }
  for (std::size_t o = 0; o < scene.obstacles.size(); ++o) {
    state.mesh.object_first.push_back(t.obstacle_range[o].first);
    state.mesh.object_static.push_back(scene.obstacles[o].is_static());
    if (scene.obstacles[o].rigid)
      state.rigid.body.emplace_back(static_cast<int>(state.rigid.body.size()), static_cast<int>(o),
                                    t.obstacle_range[o].first, scene.obstacles[o]);
  }
  if (!state.rigid.body.empty()) {
    std::vector<int> rigid(t.position.size(), 0);
    for (const RigidBody &body : state.rigid.body) std::fill(rigid.begin() + body.first, rigid.begin() + body.last, 1);
    state.rigid.vertex = Stream<int>(b, rigid);
  }
  std::vector<int> fixed(t.position.size(), 0);
  std::fill(fixed.begin() + t.cloth_vertices, fixed.end(), 1);
  for (const Pin &pin : scene.pins)
    for (int v : pin.vertices) fixed[t.cloth_range[pin.cloth].first + v] = 1;
  std::vector<double> inverse_mass(t.position.size(), 0.0);
  std::vector<Real> mass;
  std::vector<dvec3> velocity(t.position.size(), dvec3{0, 0, 0});
  for (int v = 0; v < t.cloth_vertices; ++v) {
    mass.push_back(static_cast<Real>(t.mass[v]));
    if (fixed[v]) continue;
    inverse_mass[v] = 1 / t.mass[v];
    velocity[v] = scene.cloths[t.object[v]].velocity;
  }
  for (const RigidBody &body : state.rigid.body) {
    const dvec3 spin = body.angular_velocity(body.rotation, body.angular_momentum);
    for (int v = body.first; v < body.last; ++v)
      velocity[v] = kernels::dadd(body.velocity, kernels::dcross(spin, kernels::dsub(t.position[v], body.center)));
  }
  state.mesh.position = Stream<dvec3>(b, t.position);
  state.mesh.velocity = Stream<dvec3>(b, velocity);
  state.mesh.position_next = Stream<dvec3>(b, t.position);
  state.mesh.velocity_next = Stream<dvec3>(b, velocity);
  if (state.options.integrator == Integrator::bdf2) {
    state.time.predicted = true;
    state.mesh.position_before = Stream<dvec3>(b, t.position);
    state.mesh.velocity_before = Stream<dvec3>(b, velocity);
    state.mesh.position_base = Stream<dvec3>(b, t.position);
    state.mesh.velocity_base = Stream<dvec3>(b, velocity);
  }
  state.mesh.fixed = Stream<int>(b, fixed);
  state.elements.gravity = Stream<dvec3>(b, std::vector<dvec3>{scene.gravity});
  if (has_wind(scene)) {
    std::vector<double> density;
    for (const Cloth &c : scene.cloths) density.push_back(c.material.density);
    state.elements.areal_density = Stream<double>(b, density);
    if (state.time.predicted || state.options.newton_iterations > 1)
      s->drag = Stream<typename Types<Real>::mat3>(b, t.cloth_vertices);
  }
  if (has_mass_damping(scene)) {
    std::vector<Real> rate;
    for (int v = 0; v < t.cloth_vertices; ++v)
      rate.push_back(static_cast<Real>(scene.cloths[t.object[v]].material.mass_damping * t.mass[v]));
    s->mass_damping = Stream<Real>(b, rate);
    s->drag = Stream<typename Types<Real>::mat3>(b, t.cloth_vertices);
  }
  if (has_wind(scene) || has_mass_damping(scene))
    state.elements.wind = Stream<dvec3>(b, std::vector<dvec3>{scene.wind ? scene.wind->velocity : dvec3{0, 0, 0}});
  if (std::any_of(scene.cloths.begin(), scene.cloths.end(), [](const Cloth &c) { return c.pressure != 0; })) {
    std::vector<double> pressure;
    for (const Cloth &c : scene.cloths) pressure.push_back(c.pressure);
    state.elements.pressure = Stream<double>(b, pressure);
  }
  if (std::any_of(scene.obstacles.begin(), scene.obstacles.end(),
                  [](const Obstacle &o) { return !o.is_static() && o.motion.is_rigid(); }))
    state.mesh.rest_position = Stream<dvec3>(b, t.rest_position);

  if (state.options.forces)
    state.reactions.set_up(b, state.mesh.vertices, state.mesh.cloth_vertices, state.time.predicted);

  s->mass = Stream<Real>(b, mass);
  set_up_materials(state, *s, b, scene, state.mesh.hinges > 0);
  set_up_elements(state, *s, scene, t);
  if (has_gas(scene)) set_up_gas(state, *s, scene, t);
  s->force = Stream<typename Types<Real>::vec3>(b, t.cloth_vertices);
  s->matrix = {Stream<int>(b), Stream<int>(b), Stream<typename Types<Real>::mat3>(b)};
  s->right_side = Stream<typename Types<Real>::vec3>(b, t.cloth_vertices);
  s->solution = Stream<typename Types<Real>::vec3>(b, state.mesh.vertices);

  const std::vector<kernels::stitch> stitches = stitches_of(scene, t);
  state.elements.stitches = static_cast<int>(stitches.size());
  if (scene.has_contact()) {
    set_up_contact(state, scene, t, inverse_mass);
    if (state.time.predicted) {
      s->start_force = Stream<typename Types<Real>::vec3>(b, t.cloth_vertices);
      state.mesh.abrupt_change = Stream<dvec3>(b);
      state.contact.abrupt = Stream<dvec3>(b);
    }
    if (!state.rigid.body.empty() && state.options.newton_iterations > 1) state.contact.remainder = Stream<dvec3>(b);
    if (state.contact.friction && state.options.newton_iterations > 1) {
      s->hold = Stream<typename Types<Real>::vec3>(b);
      state.contact.kept.set_up(b);
      state.contact.kept_next.set_up(b);
    }
  }
  if (state.elements.stitches) state.elements.stitch = Stream<kernels::stitch>(b, stitches);
  if (scene.has_contact() || state.elements.stitches) {
    s->term = Stream<typename Types<Real>::term>(b);
    state.system.term_nodes = Stream<kernels::element_nodes>(b);
    if (state.options.paper.contact_form == ContactForm::star) state.system.term_split = Stream<int>(b);
    state.system.term_incidence.reset(b, t.cloth_vertices);
  }
}

template void set_up<double>(State &, const Scene &, const Topology &);
template void set_up<float>(State &, const Scene &, const Topology &);

}  // namespace cama
