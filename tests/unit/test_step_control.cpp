// SPDX-License-Identifier: Apache-2.0
// Time steps that an error chooses, without a simulation.
#include "../catch.hpp"

#include <cmath>

#include "device/kernels.hpp"
#include "model/topology.hpp"
#include "run/step_control.hpp"

using namespace cama;

TEST_CASE("steps that always err too much fill the frame with the shortest ones", "[step_control]")
{
  for (const double size : {1.0, 0.31, 0.75})
    for (const double share : {1e-2, 3e-3, 2e-3, 1e-3, 1e-4})
      for (const double frame : {1.0 / 60, 0.02, 0.025, 0.04}) {   // at 0.2 % a frame of 0.02 s is 15 shortest steps
        Clock time;
        time.error = share * size;
        time.frame = frame;
        time.longest = frame;
        time.shortest = shortest_step(time.error, size, frame);
        time.step = frame;
        int tries = 0, steps = 0;
        while (time.now < 2 * frame * (1 - 1e-9)) {
          choose_step(time);
          time.step_error = size;   // whatever the step
          REQUIRE(++tries < 10000);
          if (!judge_step(time)) continue;
          REQUIRE(over_error(time));
          time.now = time.end;
          ++steps;
        }
        CHECK(steps == 2 * std::lround(frame / time.shortest));
      }
}

TEST_CASE("the nearest whole number of shortest steps fills a frame", "[step_control]")
{
  const double error = 2e-3;   // of a cloth of 1 m: 12.5 steps in 1/60 s
  CHECK(shortest_step(error, 1, 1.0 / 300) == Approx(1.0 / 600).epsilon(1e-12));   // 2.5
  CHECK(shortest_step(error, 1, 1.0 / 60) == Approx(1.0 / 720).epsilon(1e-12));
  CHECK(shortest_step(error, 1, 0.02) == Approx(0.02 / 15).epsilon(1e-12));
  CHECK(shortest_step(error, 1, 1.0 / 40) == Approx(1.0 / 760).epsilon(1e-12));   // 18.75
  CHECK(shortest_step(error, 1, 1e-4) == Approx(1e-4).epsilon(1e-12));   // no longer than a frame
}

TEST_CASE("a step that stretches edges is halved, and the next ones grow slowly", "[step_control]")
{
  Clock time;
  time.error = 2e-3;
  time.frame = time.longest = time.step = 0.025;
  time.shortest = 0.004;
  time.step_error = 0;
  int tries = 0;
  const auto step_that = [&](double least) {   // stretches edges from a length on
    for (tries = 1;; ++tries) {
      REQUIRE(tries < 10);
      choose_step(time);
      time.stretched = time.step >= least ? 3 : 0;
      if (judge_step(time)) break;
    }
    time.now = time.end;
    return time.step;
  };
  CHECK(step_that(0.008) == 0.00625);   // 25, 12.5, 6.25 ms
  int steps = 0;
  for (double most = 1.1 * 0.00625; step_that(1) < 0.025; most *= 1.1, ++steps) {
    REQUIRE(steps < 100);
    CHECK(time.step <= most * (1 + 1e-12));
  }
  CHECK(steps > 5);
  CHECK(step_that(0) >= 0.00099);   // what no step mends is accepted at a quarter of the shortest
  CHECK(step_that(0) <= 0.0011);
  CHECK(tries == 1);   // and is not tried longer while it stretches edges
}

TEST_CASE("after a step with too many candidates of fast cloth the next one is shorter", "[step_control]")
{
  // Candidates grow with the square of the length: four times too many ask for half of it.
  for (const auto &[crowding, factor] :
       {std::pair{4.0, 0.5}, {1.0, 1.0}, {0.5, std::sqrt(2.0)}, {0.1, 2.0}, {0.0, 2.0}}) {
    Clock time;
    time.error = 2e-3;
    time.frame = time.longest = 0.1;
    time.shortest = 1e-4;
    time.wanted = 0.01;
    time.multistep = true;
    time.crowding = crowding;
    choose_step(time);
    REQUIRE(time.step == Approx(0.01));
    REQUIRE(judge_step(time));
    CHECK(time.wanted == Approx(0.01 * factor));
  }
}

TEST_CASE("edges that move by more than their length are counted", "[step_control]")
{
  const dvec3 x[3] = {{0, 0, 0}, {1, 0, 0}, {1, 0.5, 0}};
  const dvec3 y[3] = {{0, 0.9, 0}, {1.9, 0.9, 0}, {1, 1.4, 0}};   // 0.9, 1.27 and 0.9
  const kernels::edge_nodes edge[3] = {{{0, 1}}, {{1, 2}}, {{2, 0}}};   // 1, 0.5 and 1.12 long
  int count = 0, none = 0;
  kernels::count_far_moved(3, 3, edge, x, y, &count);
  CHECK(count == 1);
  kernels::count_far_moved(3, 1, edge, x, y, &none);   // the others are of obstacles
  CHECK(none == 0);
}

TEST_CASE("an edge that springs back to its length at rest is not stretched; a longer one is", "[step_control]")
{
  // Edges along x from 0: before, after and at rest, of which the last two end half as long again as the longer of
  // both.
  struct Case {
    double before, after;
    float rest;
    int counted;
  };
  for (const Case &c : {Case{0.2, 0.9, 1, 0}, Case{0.2, 1.4, 1, 0}, Case{1.2, 1.7, 1, 0}, Case{0.2, 0.4, 0, 1},
                        Case{0.2, 1.6, 1, 1}, Case{1.2, 1.9, 1, 1}}) {
    CAPTURE(c.before, c.after, c.rest);
    const dvec3 x[2] = {{0, 0, 0}, {c.before, 0, 0}}, y[2] = {{0, 0, 0}, {c.after, 0, 0}};
    const kernels::edge_nodes edge{{0, 1}};
    int count = 0, without = 0;
    kernels::count_stretched(1, 2, &edge, &c.rest, x, y, &count);
    CHECK(count == c.counted);
    kernels::count_stretched(1, 2, &edge, nullptr, x, y, &without);
    CHECK(without == (c.after > 1.5 * c.before));
    int obstacle = 0;
    kernels::count_stretched(1, 0, &edge, nullptr, x, y, &obstacle);
    CHECK(obstacle == 0);
  }
}

TEST_CASE("lengths of edges at rest are those of the material, the longer side's at a seam", "[step_control]")
{
  // Two triangles that are half as large at the start as in the material, where their common side has two lengths.
  Scene scene;
  Cloth cloth;
  cloth.mesh.position = {{0, 0, 0}, {0.5, 0, 0}, {0, 0.5, 0}, {0.5, 0.5, 0}};
  cloth.mesh.face = {{0, 1, 2}, {2, 1, 3}};
  cloth.mesh.material_position = {{0, 0}, {1, 0}, {0, 1}, {0, 2}, {2, 0}, {2, 2}};
  cloth.mesh.material_face = {{0, 1, 2}, {3, 4, 5}};
  scene.cloths = {cloth, cloth};
  const std::vector<kernels::edge_nodes> edges = {{{0, 1}}, {{1, 2}}, {{6, 5}}, {{6, 7}}, {{0, 3}}, {{3, 4}}};
  const std::vector<float> rest = lengths_at_rest(scene, edges);
  const double expected[] = {1, std::sqrt(8), std::sqrt(8), 2, 0, 0};  // the last two are no edges
  REQUIRE(rest.size() == 6);
  for (std::size_t i = 0; i < 6; ++i) CHECK(rest[i] == Approx(expected[i]));
}
