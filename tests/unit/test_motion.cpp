// SPDX-License-Identifier: Apache-2.0
#include "../catch.hpp"

#include <cmath>

#include "cama/error.hpp"
#include "cama/generators.hpp"
#include "cama/motion.hpp"

using namespace cama;

namespace {

constexpr double pi = 3.14159265358979323846;

double distance(const dvec3 &a, const dvec3 &b) { return kernels::dnorm(kernels::dsub(a, b)); }
void check_point(const dvec3 &a, const dvec3 &b) { CHECK(distance(a, b) < 1e-12); }

std::array<double, 4> about_z(double angle) { return {std::cos(angle / 2), 0, 0, std::sin(angle / 2)}; }

}  // namespace

TEST_CASE("a placement turns about its centre, scales and shifts", "[motion]")
{
  RigidTransform t;
  check_point(t.apply({1, 2, 3}), {1, 2, 3});
  t.rotation = about_z(pi / 2);
  t.center = {1, 0, 0};
  t.scale = 2;
  t.translation = {0, 0, 5};
  check_point(t.apply({2, 0, 0}), {1, 2, 5});   // (1,0,0) from the centre, turned to (0,1,0), doubled
}

TEST_CASE("keys: linear, spherical, held outside", "[motion]")
{
  Motion m;
  m.keys.resize(2);
  m.keys[0].time = 1;
  m.keys[1].time = 3;
  m.keys[1].transform.translation = {4, 0, 0};
  m.keys[1].transform.rotation = about_z(pi / 2);
  CHECK_FALSE(m.is_static());
  check_point(m.at(0).apply({0, 0, 0}), {0, 0, 0});
  check_point(m.at(2).apply({1, 0, 0}), {2 + std::cos(pi / 4), std::sin(pi / 4), 0});
  check_point(m.at(1.5).apply({1, 0, 0}), {1 + std::cos(pi / 8), std::sin(pi / 8), 0});
  check_point(m.at(9).apply({1, 0, 0}), {4, 1, 0});
  m.keys[1].transform = m.keys[0].transform;
  CHECK(m.is_static());
  for (double &q : m.keys[1].transform.rotation) q = -q;   // the same rotation
  check_point(m.at(2).apply({1, 0, 0}), {1, 0, 0});
}

TEST_CASE("steady motions act between start and stop", "[motion]")
{
  Motion m;
  CHECK(m.is_static());
  m.velocity = {0, 2, 0};
  m.start = 1;
  m.stop = 4;
  CHECK_FALSE(m.is_static());
  check_point(m.at(0.5).apply({0, 0, 0}), {0, 0, 0});
  check_point(m.at(2).apply({0, 0, 0}), {0, 2, 0});
  check_point(m.at(10).apply({0, 0, 0}), {0, 6, 0});

  Motion turn;
  turn.rotation_rate = {0, 0, 2 * pi};
  turn.center = {1, 1, 0};
  check_point(turn.at(0.25).apply({2, 1, 7}), {1, 2, 7});
  check_point(turn.at(1).apply({2, 1, 7}), {2, 1, 7});

  Motion swing;
  swing.oscillation = {0, 0.5, 0};
  swing.period = 2;
  check_point(swing.at(0.5).apply({0, 0, 0}), {0, 0.5, 0});
  check_point(swing.at(1.5).apply({0, 0, 0}), {0, -0.5, 0});

  Motion both = turn;   // keys first, then the steady turn
  both.keys.resize(1);
  both.keys[0].transform.translation = {1, 0, 0};
  check_point(both.at(0.25).apply({1, 1, 0}), {1, 2, 0});
}

TEST_CASE("sampled vertices: linear between, held outside, moved rigidly on top", "[motion]")
{
  auto s = std::make_shared<Motion::Sampled>();
  s->time = {0, 1, 3};
  s->position = {{{0, 0, 0}}, {{1, 0, 0}}, {{1, 4, 0}}};
  Motion m;
  m.sampled = s;
  CHECK_FALSE(m.is_rigid());
  CHECK_FALSE(m.is_static());
  std::vector<dvec3> x;
  const std::vector<dvec3> rest{{9, 9, 9}};
  const auto at = [&](double t) {
    m.evaluate(t, rest, x);
    return x[0];
  };
  check_point(at(-1), {0, 0, 0});
  check_point(at(0.25), {0.25, 0, 0});
  check_point(at(2), {1, 2, 0});
  check_point(at(5), {1, 4, 0});
  m.velocity = {0, 0, 1};
  check_point(at(2), {1, 2, 2});
  CHECK(x.size() == 1);
  Motion still;
  still.evaluate(3, rest, x);
  CHECK(x[0].x == 9.0);
}

TEST_CASE("a walker stands closed and still at first, then walks continuously", "[motion][generators]")
{
  Walker w;
  w.duration = 2;
  w.cell = 0.03;
  const Character c = make_walker(w);
  CHECK_NOTHROW(c.mesh.validate("walker"));
  CHECK(3 * c.mesh.face.size() == 2 * unique_edges(c.mesh.face).size());
  const auto &s = *c.motion.sampled;
  double lo = 1e9, hi = -1e9, still = 0, fastest = 0;
  for (const dvec3 &x : c.mesh.position) {
    lo = std::min(lo, x.z);
    hi = std::max(hi, x.z);
  }
  CHECK(hi - lo == Approx(1.7).epsilon(0.03));
  for (std::size_t v = 0; v < c.mesh.position.size(); ++v) {
    still = std::max(still, distance(s.position[0][v], s.position[20][v]));
    for (std::size_t k = 1; k < s.time.size(); ++k)
      fastest = std::max(fastest, distance(s.position[k][v], s.position[k - 1][v]) / (s.time[k] - s.time[k - 1]));
  }
  CHECK(still < 1e-12);
  CHECK(fastest > 0.5);
  CHECK(fastest < 6);
}

#if CAMA_HAS_ASSIMP
TEST_CASE("skinning in the bind pose gives the mesh back", "[motion][data]")
{
  for (const char *name : {"characters/makehuman_body.glb", "characters/CesiumMan.glb", "characters/ozz_arnaud.fbx",
                           "characters/raylib_greenman.glb"}) {
    const auto file = test_data(name);
    if (!file) continue;
    CAPTURE(name);
    const double scale = contains(name, "fbx") ? 0.01 : 1.0;
    const Mesh mesh = load_mesh(*file, scale);
    const Character c = load_character(*file, "bind", {}, scale);
    REQUIRE(c.mesh.face.size() == mesh.face.size());
    double worst = 0;
    for (std::size_t f = 0; f < mesh.face.size(); ++f)
      for (int k = 0; k < 3; ++k)
        worst = std::max(worst, distance(c.mesh.position[c.mesh.face[f][k]], mesh.position[mesh.face[f][k]]));
    if (contains(name, "fbx"))
      CHECK(worst < 2e-5);           // assimp keeps FBX matrices in single precision, in cm
    else if (!contains(name, "greenman"))
      CHECK(worst < 1e-6);   // greenman's nodes do not rest in its bind pose
    CHECK_NOTHROW(c.mesh.validate(name));
  }
}

TEST_CASE("clips start in the mesh and move continuously", "[motion][data]")
{
  if (const auto file = test_data("characters/makehuman_body.glb")) {
    const Character c = load_character(*file, "kicks_twist_turn_squat", {}, 1.0, 30);
    const Mesh bind = load_character(*file, "bind").mesh;
    CHECK(c.duration == Approx(6.0));
    double start = 0, jump = 0;
    for (std::size_t v = 0; v < bind.position.size(); ++v)
      start = std::max(start, distance(bind.position[v], c.mesh.position[v]));
    CHECK(start < 1e-6);   // this clip begins in the bind pose
    std::vector<dvec3> a, b;
    for (double t = 0.9; t < 1.1; t += 0.011) {   // across samples and within
      c.motion.evaluate(t, c.mesh.position, a);
      c.motion.evaluate(t + 1e-7, c.mesh.position, b);
      for (std::size_t v = 0; v < a.size(); ++v) jump = std::max(jump, distance(a[v], b[v]));
    }
    CHECK(jump < 1e-6);   // the fastest vertex does 7 m/s
    CHECK(contains(thrown<FileError>([&] { load_character(*file, "dance"); }), "kicks_twist_turn_squat"));
  }
  const auto body = test_data("characters/ozz_arnaud.fbx"), walk = test_data("characters/ozz_pab_walk.fbx");
  if (body && walk) {
    const Character c = load_character(*body, "walk", *walk, 0.01, 60, true, 0.5, 2);
    const Mesh bind = load_character(*body, "bind", {}, 0.01).mesh;
    CHECK(c.duration == Approx(0.5 + 2 * 40.0 / 30));
    double start = 0, fastest = 0;
    const auto &s = *c.motion.sampled;
    for (std::size_t v = 0; v < bind.position.size(); ++v) {
      start = std::max(start, distance(bind.position[v], c.mesh.position[v]));
      for (std::size_t k = 1; k < s.time.size(); ++k)
        fastest = std::max(fastest, distance(s.position[k][v], s.position[k - 1][v]) / (s.time[k] - s.time[k - 1]));
    }
    CHECK(start < 1e-6);
    CHECK(fastest < 8);   // also where the second loop begins
    CHECK(contains(thrown<FileError>([&] { load_character(*body); }), "no animation"));
  }
  CHECK_THROWS_AS(load_character("/no/such.glb"), FileError);
}
#endif
