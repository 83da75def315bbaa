// SPDX-License-Identifier: Apache-2.0
// A scene has only what it requires: what a feature adds in streams, stages, kernels and matrix blocks, and that a
// scene without it has none of that. Expected values follow the table in docs/reference/features.md; they are not taken
// from the program.
#include "../catch.hpp"

#include <algorithm>
#include <cstring>
#include <functional>
#include <map>
#include <set>

#include "../backends.hpp"
#include "../engine.hpp"
#include "../meshes.hpp"
#include "../recorder.hpp"

using namespace cama;

namespace {

using Names = std::set<std::string>;
using Kernels = std::map<std::string, int>;  // launches of one step

Names operator+(Names a, const Names &b)
{
  a.insert(b.begin(), b.end());
  return a;
}
Kernels operator+(Kernels a, const Kernels &b)
{
  for (const auto &[name, n] : b) a[name] += n;
  return a;
}

// 60 triangles: V - E + F = 1; 22 edges are on the border.
constexpr int columns = 6, rows = 5, vertices = 42, edges = 101, inner_edges = 79;

/// A grid whose cells are all split along the same diagonal: six triangles around every inner vertex, and no two hinges
/// with the same ends.
Mesh grid(int columns, int rows, double width, double height, double x = 0, double y = 0, double z = 0)
{
  Mesh m = meshes::grid(columns, rows, width, height, x, y, z);
  for (std::size_t f = 0; f < m.face.size(); f += 2) {
    const int a = *std::min_element(m.face[f].begin(), m.face[f].end()), b = a + 1, c = a + columns + 1, d = c + 1;
    m.face[f] = {a, b, d};
    m.face[f + 1] = {a, d, c};
  }
  return m;
}

/// A sheet that falls: elasticity and gravity, no bending, no contact.
Scene bare()
{
  Scene s;
  s.time_step = 1.0 / 200;
  s.contact.enabled = false;
  s.contact.self = false;
  s.contact.friction = 0;
  s.cloths.push_back(meshes::cloth(grid(columns, rows, 0.3, 0.25), Material::isotropic(100, 0.3, 0, 0.1)));
  return s;
}

Material tabulated(bool bending)
{
  Material m = Material::isotropic(100, 0.3, bending ? 1e-5 : 0, 0.1);
  for (std::size_t row = 1; row < m.stretching.size(); ++row)
    m.stretching[row][0] *= 1 + 0.1 * static_cast<double>(row);
  return m;
}

/// What a scene has after some steps, and what one more step launches.
struct Inventory {
  Names streams;  // those that are not empty
  std::vector<std::string> stages;
  std::map<std::string, Kernels> kernels;  // by stage
  int blocks = 0, contacts = 0;
};

Inventory take(const Scene &scene, const Options &options, int steps = 3)
{
  auto recorder = std::make_unique<Recorder>(make_backend("cpu", 0, 1));
  Recorder &counts = *recorder;
  StagedEngine engine(scene, options, std::move(recorder));
  for (int i = 0; i < steps; ++i) engine.step();
  Inventory found;
  engine.begin_step();
  for (Stage *stage : engine.leaves()) {
    counts.launches.clear();
    stage->run(engine.state);
    found.stages.emplace_back(stage->name());
    found.kernels[found.stages.back()] = counts.launches;
  }
  engine.state.visit_streams([&](const char *name, auto &stream) {
    if (stream.bytes()) found.streams.insert(name);
  });
  found.blocks = engine.state.system.f64 ? engine.state.system.f64->matrix.column.size()
                                         : engine.state.system.f32->matrix.column.size();
  found.contacts = engine.state.contact.contacts;
  return found;
}

/// Every kernel of the step except those of the linear solve, which the tests name only if they belong to a feature.
Kernels outside_the_solve(const Inventory &i)
{
  Kernels all;
  for (const auto &[stage, kernels] : i.kernels)
    if (stage != "linear solve") all = all + kernels;
  return all;
}

bool launched(const Inventory &i, const std::string &kernel)
{
  return std::any_of(i.kernels.begin(), i.kernels.end(),
                     [&](const auto &stage) { return stage.second.count(kernel) > 0; });
}

/// Backward Euler, one solve a step: the least that a step does.
Options one_solve()
{
  Options o = serial();
  o.integrator = Integrator::backward_euler;
  o.newton_iterations = 1;
  return o;
}

const Names elastic_streams = {"position",
                               "velocity",
                               "position_next",
                               "velocity_next",
                               "fixed",
                               "gravity",
                               "mass",
                               "triangle_nodes",
                               "triangle_incidence.row",
                               "triangle_incidence.entry",
                               "triangle_rest",
                               "triangle_factor",
                               "triangle_force",
                               "material_scale",
                               "stretching_table",
                               "stretching_start",
                               "force",
                               "row",
                               "column",
                               "block",
                               "right_side",
                               "solution"};
const Names hinge_streams = {"hinge_nodes",  "hinge_incidence.row", "hinge_incidence.entry", "hinge_rest",
                             "hinge_factor", "hinge_force",         "bending_table"};
const Names plate_streams = {"hinge_coupling", "moment_step", "angle_scale", "scaled_angle", "moment", "moment_before"};
const Names term_streams = {"term", "term_nodes", "term_incidence.row", "term_incidence.entry"};
const Names contact_streams = {"predicted", "inverse_mass", "face",      "query_vertices", "vertex_contact",
                               "margin",    "short_motion", "uncertain", "bounds",         "vertex_box"};
const Names face_pair_streams = {"vertex_face.pairs", "vertex_face.direction", "vertex_face.gap_bound"};
const Names edge_pair_streams = {"edge_edge.pairs", "edge_edge.direction", "edge_edge.gap_bound"};

const Kernels elastic_kernels = {
    {"evaluate_triangles", 1}, {"gather_forces", 1}, {"gather_blocks", 1}, {"advance", 1}, {"find_nonfinite", 1}};
const Names bdf2_streams = {"position_before", "velocity_before", "position_base", "velocity_base"};
const Kernels bdf2_kernels = {{"extrapolate_states", 2}, {"predict_states", 1}, {"keep_history", 1}};
/// A list of elements, vertex by vertex: count, scan, fill, sort.
const Kernels incidence_kernels = {
    {"set_int", 1}, {"count_incidence", 1}, {"scan", 1}, {"fill_incidence", 1}, {"sort_rows", 1}};
const Names friction_kernels = {"vertex_loads",    "free_velocities", "vertex_pushes",
                                "recall_friction", "expect_friction", "keep_friction"};
const Names solve_kernels_of_terms = {"pack_terms", "add_term_diagonal", "term_diagonals"};

const std::vector<std::string> elastic_stages = {"element forces", "matrix assembly", "linear solve",
                                                 "advance positions", "finish step"};
const std::vector<std::string> contact_stages = {
    "candidate search", "contacts",          "element forces",       "contact terms", "matrix assembly",
    "linear solve",     "advance positions", "penetration handling", "finish step"};
std::vector<std::string> behind(const std::string &first, std::vector<std::string> stages)
{
  stages.insert(stages.begin(), first);
  return stages;
}

/// The bare sheet just above an obstacle, in contact from the first step on.
Scene on(Obstacle obstacle, const Motion &motion = {})
{
  Scene s = bare();
  s.contact.enabled = true;
  s.contact.thickness = 4e-3;
  obstacle.name = "ground";
  obstacle.motion = motion;
  obstacle.friction = 0;
  s.obstacles.push_back(std::move(obstacle));
  return s;
}

Obstacle plane() { return exact_plane({0, 0, -2e-3}, {0, 0, 1}); }
Obstacle ball() { return exact_sphere({0.15, 0.125, -0.102}, 0.1); }
Obstacle table()
{
  return meshes::obstacle(meshes::grid(3, 3, 0.5, 0.5, -0.1, -0.1, -3e-3));
}  // near enough to push, too little for a vertex to leave its box
Motion rising()
{
  Motion m;
  m.velocity = {0, 0, 0.01};
  return m;
}

}  // namespace

TEST_CASE("a sheet that falls has elasticity and nothing else", "[required]")
{
  for (const char *precision : {"double", "mixed", "single"}) {
    Options o = one_solve();
    o.precision = precision_of(precision);
    const Inventory found = take(bare(), o);
    CHECK(found.streams == elastic_streams);
    CHECK(found.stages == elastic_stages);
    CHECK(outside_the_solve(found) == elastic_kernels);
    for (const std::string &kernel : solve_kernels_of_terms) CHECK_FALSE(launched(found, kernel));
  }
}

TEST_CASE("bending brings hinges and the second ring: 13 blocks a row instead of 7", "[required]")
{
  Scene scene = bare();
  const Inventory without = take(scene, one_solve());
  scene.cloths[0].material = Material::isotropic(100, 0.3, 1e-5, 0.1);
  Options by_hinge = one_solve();
  by_hinge.bending = Bending::hinge;
  CHECK(take(scene, by_hinge).streams == elastic_streams + hinge_streams);
  CHECK(outside_the_solve(take(scene, by_hinge)) == elastic_kernels + Kernels{{"evaluate_hinges", 1}});
  const Inventory with = take(scene, one_solve());
  CHECK(with.streams == elastic_streams + hinge_streams + plate_streams);
  CHECK(with.stages == elastic_stages);
  Kernels kernels = outside_the_solve(with);
  CHECK(kernels["improve_moments"] >= 5);
  CHECK(kernels["improve_moments"] <= 16);
  kernels.erase("improve_moments");
  CHECK(kernels == elastic_kernels + Kernels{{"scale_angles", 1}, {"bend_hinges", 1}});
  CHECK(without.blocks == vertices + 2 * edges);
  CHECK(with.blocks == vertices + 2 * edges + 2 * inner_edges);
  // n x n cells have (n + 1)^2 vertices, 3 n^2 + 2 n edges, 3 n^2 - 2 n of them inside: away from the border 7 and 13.
  Scene large = bare();
  large.cloths[0].mesh = grid(100, 100, 1, 1);
  CHECK(take(large, one_solve(), 1).blocks == 10201 + 2 * 30200);
  large.cloths[0].material = scene.cloths[0].material;
  CHECK(take(large, one_solve(), 1).blocks == 10201 + 2 * 30200 + 2 * 29800);
}

TEST_CASE("BDF2 brings the state before, and kernels that extrapolate from it", "[required]")
{
  Options bdf2 = one_solve();
  bdf2.integrator = Integrator::bdf2;
  const Inventory found = take(bare(), bdf2);
  CHECK(found.streams == elastic_streams + bdf2_streams);
  CHECK(outside_the_solve(found) == elastic_kernels + bdf2_kernels);
}

TEST_CASE("damping of bending with BDF2 brings its moments, which are found together with those of the angles",
          "[required]")
{
  Options bdf2 = one_solve();
  bdf2.integrator = Integrator::bdf2;
  Scene scene = bare();
  scene.cloths[0].material = Material::isotropic(100, 0.3, 1e-5, 0.1);
  const Inventory without = take(scene, bdf2);
  scene.cloths[0].material.damping = 0.01;
  const Inventory with = take(scene, bdf2);
  CHECK(with.streams == without.streams + Names{"scaled_rate", "rate_moment", "rate_moment_before"});
  CHECK(outside_the_solve(with) == outside_the_solve(without) + Kernels{{"measure_rates", 1}, {"damp_triangles", 1}});
}

TEST_CASE("bending of one cloth gives the other no hinges", "[required]")
{
  Scene scene = bare();
  scene.cloths.push_back(
      meshes::cloth(grid(columns, rows, 0.3, 0.25, 2), Material::isotropic(100, 0.3, 1e-5, 0.1), "second"));
  CHECK(take(scene, one_solve()).blocks == 2 * (vertices + 2 * edges) + 2 * inner_edges);
}

TEST_CASE("wind brings its velocity and a kernel; air without density and drag is none", "[required]")
{
  Scene scene = bare();
  scene.wind = Wind{{3, 0, 0}, 0, 0};
  Inventory found = take(scene, one_solve());
  CHECK(found.streams == elastic_streams);
  CHECK(outside_the_solve(found) == elastic_kernels);
  scene.wind = Wind{{3, 0, 0}, 1.2, 0};
  found = take(scene, one_solve());
  CHECK(found.streams == elastic_streams + Names{"areal_density", "wind"});
  CHECK(found.stages == elastic_stages);
  CHECK(outside_the_solve(found) == elastic_kernels + Kernels{{"add_wind", 1}});
  Options bdf2 = one_solve();
  bdf2.integrator = Integrator::bdf2;
  found = take(scene, bdf2);
  CHECK(found.streams == elastic_streams + bdf2_streams + Names{"areal_density", "drag", "wind"});
  CHECK(outside_the_solve(found) ==
        elastic_kernels + bdf2_kernels + Kernels{{"add_wind", 1}, {"wind_drag", 1}, {"add_to_diagonal", 1}});
}

TEST_CASE("a strain limit brings its values and a kernel", "[required]")
{
  Scene scene = bare();
  scene.cloths[0].material.strain_limit = 0.05;
  Inventory found = take(scene, one_solve());
  CHECK(found.streams == elastic_streams + Names{"strain_limit"});
  CHECK(found.stages == elastic_stages);
  CHECK(outside_the_solve(found) == elastic_kernels + Kernels{{"limit_strain", 1}});
}

TEST_CASE("pressure brings its values and a kernel", "[required]")
{
  Scene scene = bare();
  scene.cloths[0].pressure = 10;
  Inventory found = take(scene, one_solve());
  CHECK(found.streams == elastic_streams + Names{"pressure"});
  CHECK(found.stages == elastic_stages);
  CHECK(outside_the_solve(found) == elastic_kernels + Kernels{{"add_pressure", 1}});
}

TEST_CASE("gas brings its parts and states, the derivative of the volume, and kernels for them", "[required]")
{
  Scene scene = bare();
  Mesh &mesh = scene.cloths[0].mesh;
  mesh = {};
  mesh.position = {{0, 0, 0}, {0.1, 0, 0}, {0, 0.1, 0}, {0, 0, 0.1}};
  mesh.face = {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {0, 3, 2}};
  CHECK(take(scene, one_solve()).streams == elastic_streams);
  scene.cloths[0].gas = Gas{100, 0, 101325};
  Inventory found = take(scene, one_solve());
  CHECK(found.streams == elastic_streams + Names{"gas", "gas.triangle_part", "gas.vertex_part", "gas.volume",
                                                 "gas.product", "gas.state", "gas.gas_of", "gas_gradient"});
  CHECK(found.stages == elastic_stages);
  CHECK(outside_the_solve(found) ==
        elastic_kernels + Kernels{{"measure_volumes", 1}, {"gas_pressures", 1}, {"add_gas_pressure", 1}});
  CHECK(launched(found, "add_gas_products"));
}

TEST_CASE("a yield curvature brings plastic curvatures, angles that follow them, and two stages", "[required]")
{
  Scene scene = bare();
  scene.cloths[0].material = Material::isotropic(100, 0.3, 1e-5, 0.1);
  const Inventory elastic = take(scene, one_solve());
  scene.cloths[0].material.yield_curvature = 10;
  Inventory found = take(scene, one_solve());
  CHECK(found.streams == elastic.streams + Names{"plastic_curvature", "plastic_curvature_next", "plastic_material",
                                                 "plastic_triangle", "plastic_hinge"});
  std::vector<std::string> stages = behind("angles at rest", elastic_stages);
  stages.insert(stages.end() - 1, "plastic bending");
  CHECK(found.stages == stages);
  Kernels moments = elastic.kernels.at("element forces");
  moments = {{"scale_angles", 1}, {"improve_moments", moments["improve_moments"]}};
  CHECK(outside_the_solve(found) ==
        outside_the_solve(elastic) + moments + Kernels{{"set_rest_angles", 1}, {"yield_triangles", 1}});
}

TEST_CASE("a crease is a rest angle alone", "[required]")
{
  Scene scene = bare();
  scene.cloths[0].material = Material::isotropic(100, 0.3, 1e-5, 0.1);
  const Inventory flat = take(scene, one_solve());
  scene.creases.push_back({0, {9, 10, 11}, 90});
  const Inventory folded = take(scene, one_solve());
  CHECK(folded.streams == flat.streams);
  CHECK(outside_the_solve(folded) == outside_the_solve(flat));
}

TEST_CASE("mass damping brings its rates, the air's velocity, what it adds to the diagonal, and kernels for both",
          "[required]")
{
  Scene scene = bare();
  scene.cloths[0].material.mass_damping = 1;
  const Names streams{"drag", "mass_damping", "wind"};
  const Kernels kernels{{"damp_vertices", 1}, {"mass_damping_drag", 1}, {"add_to_diagonal", 1}};
  Inventory found = take(scene, one_solve());
  CHECK(found.streams == elastic_streams + streams);
  CHECK(outside_the_solve(found) == elastic_kernels + kernels);
  Options bdf2 = one_solve();
  bdf2.integrator = Integrator::bdf2;
  found = take(scene, bdf2);
  CHECK(found.streams == elastic_streams + bdf2_streams + streams);
  CHECK(outside_the_solve(found) == elastic_kernels + bdf2_kernels + kernels);
}

TEST_CASE("damping and tables bring neither streams nor kernels; a table brings its samples", "[required]")
{
  Scene scene = bare();
  scene.cloths[0].material.damping = 0.01;
  const Inventory damped = take(scene, one_solve());
  CHECK(damped.streams == elastic_streams);
  CHECK(outside_the_solve(damped) == elastic_kernels);
  scene.cloths[0].material = tabulated(false);
  const Inventory sampled = take(scene, one_solve());
  CHECK(sampled.streams == elastic_streams);
  CHECK(outside_the_solve(sampled) == elastic_kernels);
}

TEST_CASE("pins bring a stage, and no stream of the state", "[required]")
{
  Scene scene = bare();
  Pin pin;
  pin.vertices = {0, columns};
  scene.pins.push_back(pin);
  const Inventory found = take(scene, one_solve());
  CHECK(found.streams == elastic_streams);
  CHECK(found.stages == behind("prescribed motion", elastic_stages));
  CHECK(outside_the_solve(found) == elastic_kernels + Kernels{{"scatter_positions", 1}, {"prescribe_velocities", 1}});
}

TEST_CASE("stitches bring their terms alone", "[required]")
{
  Scene scene = bare();
  scene.stitches.push_back({0, 0, 0, columns, columns - 1, 0.5, 10});
  const Inventory found = take(scene, one_solve());
  CHECK(found.streams == elastic_streams + term_streams + Names{"stitch"});
  std::vector<std::string> stages = elastic_stages;
  stages.insert(stages.begin() + 1, "contact terms");
  CHECK(found.stages == stages);
  CHECK(outside_the_solve(found) ==
        elastic_kernels + incidence_kernels + Kernels{{"stitch_nodes", 1}, {"make_stitch_terms", 1}});
}

TEST_CASE("obstacles without contact bring nothing but their vertices; moving ones their motion", "[required]")
{
  Scene scene = on(table());
  scene.contact.enabled = false;
  Inventory found = take(scene, one_solve());
  CHECK(found.streams == elastic_streams);
  CHECK(outside_the_solve(found) == elastic_kernels);
  scene.obstacles[0].motion = rising();
  found = take(scene, one_solve());
  CHECK(found.streams == elastic_streams + Names{"rest_position"});
  CHECK(found.stages == behind("prescribed motion", elastic_stages));
  CHECK(outside_the_solve(found) == elastic_kernels + Kernels{{"move_rigid", 1}, {"prescribe_velocities", 1}});
}

TEST_CASE("a plane: the cloth's vertices query one face; no edges, no trees of the cloth", "[required]")
{
  const Inventory found = take(on(plane()), one_solve());
  REQUIRE(found.contacts > 0);
  CHECK(found.stages == contact_stages);
  CHECK(found.streams == elastic_streams + term_streams + contact_streams + face_pair_streams +
                             Names{"origin", "trees.resting.face_bvh", "trees.resting.face_order", "contact"});
  CHECK(found.kernels.at("candidate search") == Kernels{{"predict_positions", 1},
                                                        {"position_bounds", 1},
                                                        {"reduce_bounds", 1},
                                                        {"vertex_boxes", 1},
                                                        {"vertex_end_boxes", 1},
                                                        {"query_vertex_face_count", 1},
                                                        {"scan", 1},
                                                        {"query_totals", 1},
                                                        {"query_vertex_face_fill", 1}});
}

TEST_CASE("a ball's centre queries the faces of the cloth: no edges", "[required]")
{
  const Inventory found = take(on(ball()), one_solve());
  REQUIRE(found.contacts > 0);
  CHECK(found.streams == elastic_streams + term_streams + contact_streams + face_pair_streams +
                             Names{"origin", "trees.resting.face_bvh", "trees.resting.face_order",
                                   "trees.cloth.face_bvh", "trees.cloth.face_order", "contact"});
  CHECK(found.kernels.at("candidate search").at("face_groups") == 1);
  CHECK(found.kernels.at("candidate search").at("query_vertex_face_count") == 2);
  for (const char *kernel : {"edge_groups", "query_edge_edge_count", "query_edge_edge_fill", "sort"})
    CHECK_FALSE(found.kernels.at("candidate search").count(kernel));
}

TEST_CASE("an obstacle at rest is neither boxed nor sorted again, and its tree stands", "[required]")
{
  const Inventory still = take(on(table()), one_solve()), moving = take(on(table(), rising()), one_solve());
  REQUIRE(still.contacts > 0);
  REQUIRE(moving.contacts > 0);
  // Edges of the cloth query; no edge queries them.
  const Names both =
      elastic_streams + term_streams + contact_streams + face_pair_streams + edge_pair_streams +
      Names{"edge", "edge_wing", "trees.cloth.face_bvh", "trees.cloth.face_order", "trees.cloth.edge_order", "contact"};
  CHECK(still.streams == both + Names{"origin", "trees.resting.face_bvh", "trees.resting.face_order",
                                      "trees.resting.edge_bvh", "trees.resting.edge_order"});
  CHECK(moving.streams == both + Names{"rest_position", "trees.moving.face_bvh", "trees.moving.face_order",
                                       "trees.moving.edge_bvh", "trees.moving.edge_order"});
  CHECK(still.kernels.at("candidate search").at("face_groups") == 1);  // of the cloth
  CHECK_FALSE(still.kernels.at("candidate search").count("edge_groups"));
  CHECK(moving.kernels.at("candidate search").at("face_groups") == 2);
  CHECK(moving.kernels.at("candidate search").at("edge_groups") == 1);
  CHECK(still.stages == contact_stages);
  CHECK(moving.stages == behind("prescribed motion", contact_stages));
}

TEST_CASE("cloth meets cloth: trees of the cloth, none of obstacles", "[required]")
{
  Scene scene = bare();
  scene.contact.enabled = scene.contact.self = true;
  scene.contact.thickness = 4e-3;
  scene.cloths.push_back(
      meshes::cloth(grid(columns, rows, 0.3, 0.25, 0.01, 0.007, 3e-3), scene.cloths[0].material, "second"));
  const Inventory found = take(scene, one_solve());
  REQUIRE(found.contacts > 0);
  CHECK(found.streams == elastic_streams + term_streams + contact_streams + face_pair_streams + edge_pair_streams +
                             Names{"edge", "edge_wing", "trees.cloth.face_bvh", "trees.cloth.face_order",
                                   "trees.cloth.edge_bvh", "trees.cloth.edge_order", "contact"});
  const Kernels &search = found.kernels.at("candidate search");
  for (const char *kernel : {"face_groups", "edge_groups", "query_vertex_face_count", "query_edge_edge_count"})
    CHECK(search.at(kernel) == 1);
}

TEST_CASE("without contact.self no pair of cloth with cloth is tested", "[required]")
{
  // A folded sheet: its layers are nearer than the thickness, and the table is near both.
  Scene scene = on(table());
  for (dvec3 &x : scene.cloths[0].mesh.position)
    if (x.x > 0.15) x = {0.3 - x.x, x.y, 3e-3};
  const auto &source = scene.cloths[0].mesh;
  scene.cloths[0].mesh.material_face = source.face;
  for (const dvec3 &x : grid(columns, rows, 0.3, 0.25).position)
    scene.cloths[0].mesh.material_position.push_back({x.x, x.y});
  StagedEngine engine(scene);
  engine.step();
  const auto faces = engine.state.mesh.face.download();
  for (const kernels::pair &p : engine.state.contact.vertex_face.pairs.download())
    CHECK((p.a < engine.state.mesh.cloth_vertices) !=
          (faces[static_cast<std::size_t>(p.b)].node[0] < engine.state.mesh.cloth_vertices));
  CHECK(engine.state.contact.edge_edge.pairs.size() > 0);
}

TEST_CASE("contact without friction sums no loads and predicts no velocities", "[required]")
{
  Scene scene = on(plane());
  const Inventory smooth = take(scene, one_solve());
  CHECK(smooth.kernels.at("contact terms") ==
        incidence_kernels + Kernels{{"contact_nodes", 1}, {"stiffen_contacts", 1}, {"make_frictionless_terms", 1}});
  scene.cloths[0].material.friction = 0.5;  // no cloth touches cloth, so its coefficient is not used
  CHECK(take(scene, one_solve()).kernels.at("contact terms") == smooth.kernels.at("contact terms"));
  scene.obstacles[0].friction = 0.5;
  const Inventory rough = take(scene, one_solve());
  CHECK(rough.streams == smooth.streams + Names{"hold", "kept.force", "kept.key", "kept_next.force", "kept_next.key"});
  CHECK(rough.kernels.at("contact terms") == incidence_kernels + Kernels{{"contact_nodes", 1},
                                                                         {"stiffen_contacts", 1},
                                                                         {"make_frictionless_terms", 1},
                                                                         {"vertex_loads", 1},
                                                                         {"free_velocities", 1},
                                                                         {"vertex_pushes", 1},
                                                                         {"recall_friction", 1},
                                                                         {"expect_friction", 1}});
  CHECK(rough.kernels.at("keep friction") == Kernels{{"keep_friction", 1}});
}

TEST_CASE("forces are measured where they are asked for", "[required]")
{
  Options measuring = one_solve();
  measuring.forces = true;
  const Names streams = {"reactions.step",        "reactions.step_moment",     "reactions.pieces",
                         "reactions.piece",       "reactions.pieces_moment",   "reactions.piece_moment",
                         "reactions.interval",    "reactions.interval_moment", "reactions.push",
                         "reactions.push_moment", "reactions.solved_velocity"};
  const Inventory free = take(bare(), measuring), resting = take(on(plane()), measuring),
                  without = take(on(plane()), one_solve());
  CHECK(free.streams == elastic_streams + streams);
  CHECK(resting.streams == without.streams + streams + Names{"reactions.contact"});
  CHECK(free.kernels.at("forces of the solve").at("solve_reactions") == 1);
  CHECK_FALSE(free.kernels.at("forces of the solve").count("contact_impulses"));
  CHECK(resting.kernels.at("forces of the solve").at("contact_impulses") == 1);
  CHECK(resting.kernels.at("forces of impacts") == Kernels{{"add_impulses", 2}});
}

TEST_CASE("contact terms without friction are those of friction zero, bit for bit", "[required]")
{
  Scene scene = on(ball());
  StagedEngine smooth(scene);
  scene.obstacles[0].friction = 0.5;
  StagedEngine rubbing(scene);
  REQUIRE(rubbing.state.contact.friction);
  auto properties = rubbing.state.contact.vertex_contact.download();
  for (kernels::vertex_contact &v : properties) v.friction = v.static_friction = 0;
  rubbing.state.contact.vertex_contact.assign(properties);
  for (int i = 0; i < 10; ++i) {
    smooth.step();
    rubbing.step();
  }
  REQUIRE(smooth.state.contact.contacts > 0);
  const auto a = smooth.state.mesh.position.download(), b = rubbing.state.mesh.position.download();
  CHECK(std::memcmp(a.data(), b.data(), a.size() * sizeof a[0]) == 0);
}

TEST_CASE("contact that touches nothing has no terms", "[required]")
{
  Scene scene = on(plane());
  for (dvec3 &x : scene.cloths[0].mesh.position) x.z += 1;
  const Inventory found = take(scene, one_solve());
  REQUIRE(found.contacts == 0);
  CHECK(found.kernels.at("contact terms").empty());
  for (const std::string &kernel : solve_kernels_of_terms) CHECK_FALSE(launched(found, kernel));
  CHECK_FALSE(found.streams.count("term"));
  CHECK_FALSE(found.streams.count("term_nodes"));
}

TEST_CASE("no guarantee, no commit", "[required]")
{
  Options o = one_solve();
  o.commit = false;
  const Inventory found = take(on(table(), rising()), o, 8);
  for (const char *kernel : {"commit_begin", "commit_screen", "commit_pairs", "commit_apply"})
    CHECK_FALSE(launched(found, kernel));
}

TEST_CASE("every stage names the feature that needs it", "[required]")
{
  Scene scene = on(table(), rising());
  scene.stitches.push_back({0, 0, 0, columns, columns - 1, 0.5, 10});
  Simulation simulation(scene, one_solve());
  std::map<std::string, std::string> reason;
  for (auto [name, why] : simulation.explain()) {
    name.erase(0, name.find_first_not_of(' '));
    reason.emplace(name, why);
  }
  CHECK(reason.at("element forces") == "always");
  CHECK(reason.at("linear solve") == "always");
  CHECK(reason.at("prescribed motion") == "pins or moving obstacles");
  CHECK(reason.at("proximity checking") == "contact");
  CHECK(reason.at("candidate search") == "contact");
  CHECK(reason.at("contacts") == "contact");
  CHECK(reason.at("contact terms") == "contact or stitches");
  CHECK(reason.at("penetration handling") == "contact");
}

// Distant objects do not move the cloth by one bit. They may not be in the same contacts nor, as a free cloth, in the
// same solve: the steps of the conjugate gradient method are ratios of sums over all free vertices, which change with
// every free vertex that has a residual.
namespace {

/// Two sheets that fall on each other and on a ball that moves.
Scene pile() { return meshes::pile(8); }

struct Trace {
  std::vector<dvec3> position, velocity;
  int contacts = 0;
};

Trace follow_first(const Scene &scene, int cloths, int steps, const Options &options)
{
  Simulation simulation(scene, options);
  Trace r;
  for (int i = 0; i < steps; ++i) {
    simulation.step();
    r.contacts = std::max(r.contacts, simulation.report().contacts);
  }
  const std::size_t n =
      static_cast<std::size_t>(simulation.cloth_ranges()[static_cast<std::size_t>(cloths) - 1].second);
  r.position = simulation.positions();
  r.velocity = simulation.velocities();
  r.position.resize(n);
  r.velocity.resize(n);
  return r;
}

bool same_bits(const Trace &a, const Trace &b)
{
  const auto same = [](const std::vector<dvec3> &x, const std::vector<dvec3> &y) {
    return x.size() == y.size() && std::memcmp(x.data(), y.data(), x.size() * sizeof(dvec3)) == 0;
  };
  return same(a.position, b.position) && same(a.velocity, b.velocity);
}

void add(Scene &s, Obstacle o, const Motion &motion = {})
{
  o.name = "far" + std::to_string(s.obstacles.size());
  o.motion = motion;
  s.obstacles.push_back(std::move(o));
}
Motion drifting(const dvec3 &velocity)
{
  Motion m;
  m.velocity = velocity;
  return m;
}
/// A distant cloth with all vertices pinned.
std::size_t add_pinned(Scene &s, Material material, const Motion &motion = {})
{
  s.cloths.push_back(meshes::cloth(meshes::grid(3, 3, 0.1, 0.1, 4, 5, -2), std::move(material), "far cloth"));
  Pin pin;
  pin.cloth = static_cast<int>(s.cloths.size()) - 1;
  pin.motion = motion;
  for (int v = 0; v < 16; ++v) pin.vertices.push_back(v);
  s.pins.push_back(pin);
  return s.cloths.size() - 1;
}
Obstacle far_mesh(const dvec3 &center) { return meshes::obstacle(meshes::sphere(8, 6, 0.2, center)); }

struct Feature {
  const char *name;
  std::function<void(Scene &)> add;
};
const Feature far_features[] = {
    {"a mesh above", [](Scene &s) { add(s, far_mesh({5, 3, 4})); }},
    {"a mesh below", [](Scene &s) { add(s, far_mesh({-5, -3, -4})); }},
    {"a mesh a kilometre away", [](Scene &s) { add(s, far_mesh({-1000, 300, 200})); }},
    {"a mesh that moves", [](Scene &s) { add(s, far_mesh({-5, 3, -4}), drifting({1, -2, 0.5})); }},
    {"a mesh that moves fast", [](Scene &s) { add(s, far_mesh({-5, 3, -4}), drifting({0, 0, -40})); }},
    {"meshes at rest and moving",
     [](Scene &s) {
       add(s, far_mesh({-5, 3, -4}), drifting({0, -3, 0}));
       add(s, far_mesh({5, -3, -4}));
     }},
    {"an exact sphere", [](Scene &s) { add(s, exact_sphere({3, 0, -3}, 0.5)); }},
    {"an exact sphere that moves", [](Scene &s) { add(s, exact_sphere({3, 0, -3}, 0.5), drifting({1, 0, 0})); }},
    {"a capsule", [](Scene &s) { add(s, exact_capsule({-3, 1, 0}, {-3, -1, 1}, 0.2)); }},
    {"a box", [](Scene &s) { add(s, exact_box({0, 4, 1}, {1, 1, 1})); }},
    {"a plane", [](Scene &s) { add(s, exact_plane({0, 0, -6}, {0, 0, 1})); }},
    {"a plane that moves", [](Scene &s) { add(s, exact_plane({0, 0, -6}, {0, 0, 1}), drifting({0, 0, 1})); }},
    {"rougher and stiffer ground",
     [](Scene &s) {
       add(s, far_mesh({0, 0, -5}));
       s.obstacles.back().friction = 2;
       s.obstacles.back().contact_stiffness = 1e8;
     }},
    {"thicker ground",
     [](Scene &s) {
       add(s, far_mesh({0, 0, -5}));
       s.obstacles.back().thickness = 0.03;
     }},
    {"a pinned cloth", [](Scene &s) { add_pinned(s, meshes::cotton()); }},
    {"a pinned cloth that is moved", [](Scene &s) { add_pinned(s, meshes::cotton(), drifting({0.3, 0, 0})); }},
    {"a pinned cloth without bending", [](Scene &s) { add_pinned(s, Material::isotropic(100, 0.3, 0, 0.1)); }},
    {"a pinned cloth of a tabulated fabric", [](Scene &s) { add_pinned(s, tabulated(true)); }},
    {"a pinned cloth that is damped",
     [](Scene &s) {
       Material m = meshes::cotton();
       m.damping = 0.02;
       add_pinned(s, m);
     }},
    {"a pinned cloth with mass damping",
     [](Scene &s) {
       Material m = meshes::cotton();
       m.mass_damping = 2;
       add_pinned(s, m);
     }},
    {"a pinned cloth with a seam",
     [](Scene &s) {
       const int c = static_cast<int>(add_pinned(s, meshes::cotton()));
       s.stitches.push_back({c, 0, c, 3, 2, 0, 10});
     }},
    {"a thicker pinned cloth",
     [](Scene &s) {
       const std::size_t c = add_pinned(s, meshes::cotton());
       s.cloths[c].material.thickness = 0.01;
     }},
};

/// Features that involve every vertex but have no effect.
const Feature empty_features[] = {
    {"still air without density", [](Scene &s) { s.wind = Wind{{3, 0, 0}, 0, 0}; }},
    {"a cloth's friction where an obstacle's holds",
     [](Scene &s) {
       s.contact.self = false;
       s.cloths[0].material.friction = 0.7;
     }},
};

}  // namespace

TEST_CASE("what is far away does not move the cloth by one bit", "[required][distant]")
{
  for (const std::string &backend : backends_here())
    for (const auto &[start, scene] :
         {std::pair<const char *, Scene>{"draped", meshes::sheet_on_ball()}, {"pile", pile()}}) {
      Options o = one_solve();
      o.backend = backend;
      const int steps = backend == "cpu" ? 30 : 6, cloths = static_cast<int>(scene.cloths.size());
      const Trace alone = follow_first(scene, cloths, steps, o);
      REQUIRE(alone.contacts > 10);
      for (const Feature &feature : far_features) {
        INFO(backend << ", " << start << ", " << feature.name);
        Scene beside = scene;
        feature.add(beside);
        CHECK(same_bits(alone, follow_first(beside, cloths, steps, o)));
      }
    }
}

TEST_CASE("what is far away does not move the cloth by one bit in the paper's mode", "[required][distant]")
{
  const Scene scene = meshes::sheet_on_ball();
  const Trace alone = follow_first(scene, 1, 12, serial(Accuracy::paper));
  for (const Feature &feature : far_features) {
    INFO(feature.name);
    Scene beside = scene;
    feature.add(beside);
    CHECK(same_bits(alone, follow_first(beside, 1, 12, serial(Accuracy::paper))));
  }
}

TEST_CASE("features that amount to nothing do not move the cloth by one bit", "[required][distant]")
{
  for (const Feature &feature : empty_features) {
    INFO(feature.name);
    Scene plain = meshes::sheet_on_ball();
    plain.contact.self = false;
    Scene with = plain;
    feature.add(with);
    CHECK(same_bits(follow_first(plain, 1, 20, one_solve()), follow_first(with, 1, 20, one_solve())));
  }
}
