// SPDX-License-Identifier: Apache-2.0
// Time steps that an error chooses, without a simulation.
#include "../catch.hpp"
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
        time.shortest = shortest_step(time.error, size);
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
        CHECK(steps >= 2 * frame / time.shortest * (1 - 1e-6));
        CHECK(steps <= 2 * (frame / time.shortest + 1));
      }
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
