// SPDX-License-Identifier: Apache-2.0
// The main function, for Catch2 version 2 and 3. Returns 0 if all tests passed, 1 if one failed, and 77 if none failed
// but some could not run.
#define CATCH_CONFIG_RUNNER
#include "catch.hpp"

int main(int count, char **argument)
{
  if (Catch::Session().run(count, argument) != 0) return 1;
  return skipped > 0 ? 77 : 0;
}
