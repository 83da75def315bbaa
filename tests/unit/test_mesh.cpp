// SPDX-License-Identifier: Apache-2.0
#include "../catch.hpp"

#include <cmath>
#include <cstring>
#include <fstream>
#include <map>
#include <set>

#include "cama/error.hpp"
#include "cama/generators.hpp"
#include "cama/mesh.hpp"

using namespace cama;
namespace fs = std::filesystem;

namespace {

Mesh square()
{
  Mesh m;
  m.position = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}};
  m.face = {{0, 1, 2}, {0, 2, 3}};
  m.material_position = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
  m.material_face = m.face;
  return m;
}

fs::path write(const std::string &name, const std::string &text)
{
  const fs::path p = fs::temp_directory_path() / ("cama_test_" + name);
  std::ofstream(p) << text;
  return p;
}

/// Every edge in exactly two faces, once in each direction.
bool closed(const Mesh &m)
{
  std::map<std::pair<int, int>, int> count;
  for (const Triangle &t : m.face)
    for (int k = 0; k < 3; ++k) ++count[{t[k], t[(k + 1) % 3]}];
  for (const auto &[edge, n] : count)
    if (n != 1 || !count.count({edge.second, edge.first})) return false;
  return true;
}

double volume(const Mesh &m)
{
  double v = 0;
  for (const Triangle &t : m.face)
    v += kernels::ddot(m.position[t[0]], kernels::dcross(m.position[t[1]], m.position[t[2]])) / 6;
  return v;
}

long euler(const Mesh &m)
{
  return static_cast<long>(m.position.size()) - static_cast<long>(unique_edges(m.face).size()) +
         static_cast<long>(m.face.size());
}

}  // namespace

TEST_CASE("bad meshes are named, element by element", "[mesh]")
{
  const auto broken = [](auto change) {
    Mesh m = square();
    change(m);
    const std::string text = thrown<MeshError>([&] { m.validate("towel"); });
    CHECK(contains(text, "towel"));
    return text;
  };
  CHECK_NOTHROW(square().validate("towel"));
  CHECK(contains(broken([](Mesh &m) { m = Mesh(); }), "empty"));
  CHECK(contains(broken([](Mesh &m) {
                   m.face.clear();
                   m.material_face.clear();
                 }),
                 "empty"));
  CHECK(contains(broken([](Mesh &m) { m.position[2].y = std::nan(""); }), "vertex 2"));
  CHECK(contains(broken([](Mesh &m) { m.position[3].z = INFINITY; }), "vertex 3"));
  CHECK(contains(broken([](Mesh &m) { m.material_position[1][0] = std::nan(""); }), "material vertex 1"));
  CHECK(contains(broken([](Mesh &m) { m.face[1][2] = 4; }), "face 1 (0 2 4) uses vertex 4"));
  CHECK(contains(broken([](Mesh &m) { m.face[0][1] = -1; }), "vertex -1"));
  CHECK(contains(broken([](Mesh &m) { m.material_face[1][0] = 9; }), "material vertex 9"));
  CHECK(contains(broken([](Mesh &m) { m.face[1] = {0, 2, 2}; }), "twice"));
  CHECK(contains(broken([](Mesh &m) { m.position[3] = {0.5, 0.5, 0}; }), "face 1 (0 2 3) has zero area"));
  CHECK(contains(broken([](Mesh &m) { m.material_position[3] = {0.5, 0.5}; }), "zero area in material space"));
  CHECK(contains(broken([](Mesh &m) {
                   m.face.push_back({2, 0, 1});
                   m.material_face.push_back({2, 0, 1});
                 }),
                 "face 2 (2 0 1) repeats face 0"));
  CHECK(contains(broken([](Mesh &m) { m.position.push_back({5, 5, 5}); }), "vertex 4 is isolated"));
  CHECK(contains(broken([](Mesh &m) { m.position[2].y = std::nan(""); }),
                 "vertex 2 has a coordinate that is not finite (NaN or infinity); give it a place"));
  CHECK(contains(broken([](Mesh &m) { m.material_face.pop_back(); }), "1 faces in material space"));
}

TEST_CASE("unique edges are sorted pairs", "[mesh]")
{
  const std::vector<std::array<int, 2>> expected{{0, 1}, {0, 2}, {0, 3}, {1, 2}, {1, 3}, {2, 3}};  // of a tetrahedron
  CHECK(unique_edges({{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {2, 0, 3}}) == expected);
}

TEST_CASE("OBJ keeps vertex order, separate texture indices and every bit", "[mesh][io]")
{
  Mesh m = square();
  m.position[1].x = 0.1 + 0.2;
  m.position[2].z = 1e-300;
  m.material_position.push_back({2, 2});
  m.material_face[1] = {0, 4, 3};
  const fs::path file = fs::temp_directory_path() / "cama_test_round.obj";
  save_obj(file, m);
  const Mesh r = load_mesh(file, 1, RestShape::uv);
  REQUIRE(r.position.size() == m.position.size());
  CHECK(std::memcmp(r.position.data(), m.position.data(), sizeof(dvec3) * m.position.size()) == 0);
  CHECK(r.face == m.face);
  CHECK(r.material_position == m.material_position);
  CHECK(r.material_face == m.material_face);
  const Mesh scaled = load_mesh(file, 0.01, RestShape::uv, 2.0);
  CHECK(scaled.position[3].y == 0.01);
  CHECK(scaled.material_position[2][0] == 2.0);
}

TEST_CASE("texture coordinates become material space where asked for", "[mesh][io]")
{
  const Mesh m = square();
  const fs::path file = fs::temp_directory_path() / "cama_test_rest.obj";
  save_obj(file, m);
  const Mesh start = load_mesh(file);
  CHECK(start.face == m.face);
  CHECK(start.material_position.empty());
  CHECK(start.material_face.empty());
  CHECK(contains(thrown<MeshError>([&] { load_mesh(file, 1, RestShape::start, 2); }), "cama_test_rest.obj: material_"));
  Mesh bare = m;
  bare.material_position.clear();
  bare.material_face.clear();
  save_obj(file, bare);
  CHECK(load_mesh(file).face == m.face);
  CHECK(contains(thrown<MeshError>([&] { load_mesh(file, 1, RestShape::uv); }),
                 "cama_test_rest.obj: has no texture coordinates"));
  // Some faces with texture coordinates: no rest shape, but a mesh.
  const fs::path mixed = write("mixed.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\n"
                                            "f 1/1 2/2 3/3\nf 1 3 4\n");
  CHECK(load_mesh(mixed).face == m.face);
  CHECK(contains(thrown<FileError>([&] { load_mesh(mixed, 1, RestShape::uv); }), "some faces have texture"));
}

TEST_CASE("two squares that share no vertex are welded along their border", "[mesh]")
{
  Mesh m = square();  // and its neighbour, whose texture is elsewhere
  for (const dvec3 &x : square().position) m.position.push_back({x.x + 1, x.y, x.z + 1e-4});
  for (const Triangle &t : square().face) {
    m.face.push_back({t[0] + 4, t[1] + 4, t[2] + 4});
    m.material_face.push_back(m.face.back());
  }
  for (const MaterialPoint &u : square().material_position) m.material_position.push_back({u[0] + 5, u[1]});
  const WeldDistances range = weld_distances(m);
  CHECK(range.coincident == 2e-6);
  CHECK(range.largest == Approx(0.2));
  CHECK(weld(m, range.coincident).mesh.face == m.face);  // 0.1 mm apart
  const WeldedMesh welded = weld(m, 2e-4);
  CHECK(welded.vertex == std::vector<int>{0, 1, 2, 3, 1, 4, 5, 2});
  REQUIRE(welded.mesh.position.size() == 6);
  CHECK(welded.mesh.position[1].z == 0);  // of the first
  CHECK(welded.mesh.face == std::vector<Triangle>{{0, 1, 2}, {0, 2, 3}, {1, 4, 5}, {1, 5, 2}});
  CHECK(welded.mesh.material_face == m.material_face);
  CHECK(welded.mesh.material_position == m.material_position);
  const std::vector<MeshStitch> left = renumber({{1, 4, 5, 0.0}, {0, 5, 7, 0.5}, {6, 5, 6, 1.0}}, welded.vertex);
  REQUIRE(left.size() == 1);  // the first sewed what is one vertex now, the last a vertex to an edge of its own
  CHECK((left[0].a == 0 && left[0].b == 4 && left[0].c == 2 && left[0].ratio == 0.5));
  // A sliver that collapses goes, and so does its vertex.
  m.position.push_back({0, -1e-5, 0});
  m.face.push_back({0, 8, 3});
  m.material_face.push_back({0, 1, 3});
  const WeldedMesh whole = weld(m, 2e-4);
  CHECK(whole.mesh.face == welded.mesh.face);
  CHECK(whole.vertex.back() == 0);
  m.face.back()[1] = 99;
  CHECK(weld(m, 2e-4).mesh.position.size() == m.position.size());  // left to validate
}

TEST_CASE("a concave polygon of an OBJ is refused, a convex one and one that is not flat are not", "[mesh][io]")
{
  const auto quad = [](const std::string &corner) {
    return write("quad.obj", "v 0 0 0\nv 1 0 0\n" + corner + "\nv 0 1 0\nf 2 3 4 1\n");
  };
  CHECK(load_mesh(quad("v 1 1 0")).face.size() == 2);
  CHECK(load_mesh(quad("v 1 1 0.4")).face.size() == 2);
  CHECK(contains(thrown<FileError>([&] { load_mesh(quad("v 0.3 0.3 0")); }), ":5: the face is a concave polygon"));
}

TEST_CASE("OBJ polygons, relative indices, stitches and bad lines", "[mesh][io]")
{
  const fs::path file = write(
      "quad.obj", "# a quad\nv 0 0 0\nv 1 0 0\r\nv 1 1 0\nv 0 1 0\n\nf -4 -3 -2 -1\nstitch 0 1 2 2.5e-001\nvn 0 0 1");
  const Mesh m = load_mesh(file);
  CHECK(m.face == std::vector<Triangle>{{0, 1, 2}, {0, 2, 3}});
  CHECK(m.material_face.empty());
  const auto stitches = load_stitches(file);
  REQUIRE(stitches.size() == 1);
  CHECK(stitches[0].c == 2);
  CHECK(stitches[0].ratio == 0.25);

  CHECK(contains(thrown<FileError>([] { load_mesh(write("short.obj", "v 0 0\n")); }), ":1: expected z"));
  CHECK(contains(thrown<FileError>([] { load_mesh(write("index.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n")); }),
                 "uses vertex 4"));
  CHECK(contains(thrown<FileError>([] { load_mesh(write("two.obj", "v 0 0 0\nv 1 0 0\nf 1 2\n")); }),
                 ":3: a face needs"));
  CHECK(contains(thrown<FileError>([] { load_mesh(write("none.obj", "v 0 0 0\n")); }), "no faces"));
  CHECK(contains(thrown<FileError>([] { load_mesh("/no/such.obj"); }), "no such file"));
  CHECK_THROWS_AS(load_mesh("/no/such.glb"), FileError);
}

TEST_CASE("garments with panels survive: counts as grep finds them in the file", "[mesh][data]")
{
  if (const auto file = test_data("arcsim/meshes/tshirt.obj")) {
    const Mesh m = load_mesh(*file, 1, RestShape::uv);
    CHECK(m.position.size() == 330);
    CHECK(m.face.size() == 604);
    CHECK(m.material_position.size() == 426);
    CHECK(m.material_position[0] == MaterialPoint{0.985129, 1.04444});  // the first line of the file
    CHECK(m.face[1] == Triangle{0, 2, 3});
    CHECK_NOTHROW(m.validate("tshirt"));
  }
  if (const auto file = test_data("garments/codim/dress_knife_stage.obj")) {
    const Mesh m = load_mesh(*file);
    CHECK(m.position.size() == 15656);
    CHECK(m.face.size() == 29456);
    CHECK(m.position[1].z == 3.864468e-001);
    const auto stitches = load_stitches(*file);
    REQUIRE(stitches.size() == 851);
    CHECK(stitches[1].a == 847);
    CHECK(stitches[1].b == 704);
    CHECK(stitches[1].c == 703);
    CHECK(stitches[1].ratio == 5.263158e-002);
  }
}

#if CAMA_HAS_ASSIMP
TEST_CASE("PLY and STL through assimp: order kept, facets welded", "[mesh][io]")
{
  const Mesh ply = load_mesh(write(
      "square.ply",
      "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face 2\n"
      "property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2\n3 0 2 3\n"));
  CHECK(contains(
      thrown<MeshError>([] { load_mesh(fs::temp_directory_path() / "cama_test_square.ply", 1, RestShape::uv); }),
      "square.ply: has no texture coordinates"));
  const fs::path textured = write(
      "textured.ply",
      "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nproperty float "
      "s\n"
      "property float t\nelement face 2\nproperty list uchar int vertex_indices\nend_header\n0 0 0 0 0\n1 0 0 0.5 0\n"
      "1 1 0 0.5 0.25\n0 1 0 0 0.25\n3 0 1 2\n3 0 2 3\n");
  CHECK(load_mesh(textured).material_face.empty());
  const Mesh atlas = load_mesh(textured, 1, RestShape::uv, 2);
  REQUIRE(atlas.material_face.size() == 2);
  CHECK(atlas.material_position[atlas.material_face[0][2]] == MaterialPoint{1, 0.5});
  CHECK(ply.position.size() == 4);
  CHECK(ply.face == std::vector<Triangle>{{0, 1, 2}, {0, 2, 3}});
  CHECK(ply.position[2].y == 1);
  std::string stl = "solid t\n";
  const double x[4][3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  const int f[4][3] = {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {2, 0, 3}};
  for (const auto &t : f) {
    stl += "facet normal 0 0 1\nouter loop\n";
    for (int v : t)
      stl += "vertex " + std::to_string(x[v][0]) + " " + std::to_string(x[v][1]) + " " + std::to_string(x[v][2]) + "\n";
    stl += "endloop\nendfacet\n";
  }
  const Mesh solid = load_mesh(write("tetra.stl", stl + "endsolid t\n"), 2.0);
  CHECK(solid.position.size() == 4);
  CHECK(closed(solid));
  CHECK(volume(solid) == Approx(8.0 / 6));
  CHECK(contains(thrown<FileError>([] { load_mesh(write("broken.ply", "not a mesh\n")); }), "broken.ply"));
}

TEST_CASE("characters from files are closed where the model is", "[mesh][data]")
{
  if (const auto file = test_data("characters/makehuman_body.glb")) {
    const Mesh m = load_mesh(*file);
    CHECK(m.position.size() == 13380);  // as its SOURCE.txt says
    CHECK(m.face.size() == 26756);
    CHECK(closed(m));
    CHECK(volume(m) > 0);
    double top = 0;
    for (const dvec3 &x : m.position) top = std::max(top, x.z);
    CHECK(top == Approx(1.666).epsilon(0.01));  // z is up
  }
  if (const auto file = test_data("characters/ozz_arnaud.fbx")) CHECK(closed(load_mesh(*file)));
}
#endif

TEST_CASE("generated meshes: counts, closedness, volumes", "[mesh][generators]")
{
  const double pi = 3.14159265358979323846;
  for (int n : {200, 5000, 66667, 333333}) {
    const Mesh m = make_grid(1, 1, n).mesh;
    CAPTURE(n, m.face.size());
    CHECK(std::abs(static_cast<double>(m.face.size()) - n) < 0.05 * n);
    CHECK_NOTHROW(m.validate("grid"));
  }
  const Pattern grid = make_grid_cells(2, 1, 4, 2);
  CHECK(grid.mesh.face.size() == 16);
  CHECK(grid.group.at("top").size() == 5);
  CHECK(grid.mesh.position[grid.group.at("top_right")[0]].x == 1);
  CHECK(grid.mesh.position[grid.group.at("top_right")[0]].y == 0.5);
  std::map<std::pair<int, int>, int> diagonal;  // both directions equally often: no bias
  for (const auto &[a, b] : unique_edges(grid.mesh.face)) {
    const dvec3 d = kernels::dsub(grid.mesh.position[b], grid.mesh.position[a]);
    if (d.x != 0 && d.y != 0) ++diagonal[{d.x > 0 ? 1 : -1, d.y > 0 ? 1 : -1}];
  }
  CHECK(diagonal[{1, 1}] == 4);
  CHECK(diagonal[{-1, 1}] == 4);

  const Mesh sphere = make_sphere(0.25);
  CHECK(sphere.face.size() >= 5000);
  CHECK(closed(sphere));
  CHECK(euler(sphere) == 2);
  CHECK(volume(sphere) == Approx(4.0 / 3 * pi * 0.25 * 0.25 * 0.25).epsilon(0.005));
  const Mesh box = make_box({1, 2, 0.5}, 1200);
  CHECK(closed(box));
  CHECK(volume(box) == Approx(1.0));
  const Mesh capsule = make_capsule(0.1, 0.3);
  CHECK(closed(capsule));
  CHECK(volume(capsule) == Approx(pi * 0.01 * 0.3 + 4.0 / 3 * pi * 0.001).epsilon(0.005));
  const Mesh funnel = make_funnel({});
  CHECK(closed(funnel));
  CHECK(euler(funnel) == 0);  // a ring: there is a way through
  CHECK(volume(funnel) > 0);
  for (const Mesh *m : {&sphere, &box, &capsule, &funnel}) CHECK_NOTHROW(m->validate("shape"));
  CHECK_THROWS_AS(make_sphere(-1), MeshError);

  const Pattern tube = make_tube(0.3, 0.2, 0.5, 4000, 6);
  CHECK_NOTHROW(tube.mesh.validate("tube"));
  CHECK(euler(tube.mesh) == 0);
  CHECK(tube.mesh.material_position.size() > tube.mesh.position.size());  // panels are separate in material space
}
