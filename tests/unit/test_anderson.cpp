// SPDX-License-Identifier: Apache-2.0
#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <cstddef>
#include <vector>

#include "solver/anderson.hpp"

namespace cama {
namespace {

constexpr std::size_t n = 3;
using Matrix = std::array<std::array<double, n>, n>;

/// b - A x.
std::vector<double> affine(const Matrix &a, const std::vector<double> &b, const std::vector<double> &x)
{
  std::vector<double> g = b;
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t j = 0; j < n; ++j) g[i] -= a[i][j] * x[j];
  return g;
}

double length(const std::vector<double> &g)
{
  double sum = 0;
  for (double value : g) sum += value * value;
  return std::sqrt(sum);
}

const Matrix stiff{{{9, 2, 0}, {2, 7, 1}, {0, 1, 5}}}, soft{{{3, -2, 1}, {-2, 6, 0}, {1, 0, 40}}};
const std::vector<double> load{1, -2, 3};

}  // namespace

TEST_CASE("Anderson mixing solves n affine equations in n + 1 steps, as GMRES does", "[anderson]")
{
  AndersonMixing mixing;
  mixing.begin();
  std::vector<double> x(n, 0.0);
  for (std::size_t i = 0; i <= n; ++i) x = mixing.next(x, affine(stiff, load, x));
  CHECK(length(affine(stiff, load, x)) < 1e-10);
}

TEST_CASE("Anderson mixing forgets what newer steps contradict", "[anderson]")
{
  AndersonMixing mixing;
  mixing.begin();
  std::vector<double> x(n, 0.0);
  for (std::size_t i = 0; i < n; ++i) x = mixing.next(x, affine(stiff, load, x));
  for (std::size_t i = 0; i < n + 2; ++i) x = mixing.next(x, affine(soft, load, x));
  CHECK(length(affine(soft, load, x)) < 1e-8);
}

}  // namespace cama
