// SPDX-License-Identifier: Apache-2.0
// Time steps that an error chooses, without a simulation.
#include "../catch.hpp"
#include "run/step_control.hpp"

using namespace cama;

TEST_CASE("steps that always err too much fill the frame with the shortest ones", "[step_control]")
{
  for (const double size : {1.0, 0.31, 0.75})
    for (const double share : {1e-2, 3e-3, 2e-3, 1e-3, 1e-4})
      for (const double frame : {1.0 / 60, 0.02, 0.025, 0.04}) {   // at 0.2 % a frame of 0.02 s is 30 shortest steps
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
