// SPDX-License-Identifier: Apache-2.0
// The main function, for Catch2 version 2 and 3. Returns 0 if all passed, 1 if not, 77 if all passed that could
// run and some could not.
#define CATCH_CONFIG_RUNNER
#include "catch.hpp"

int main(int count, char **argument)
{
  if (Catch::Session().run(count, argument) != 0) return 1;
  return skipped > 0 ? 77 : 0;
}
