// SPDX-License-Identifier: Apache-2.0
#include "solver/anderson.hpp"

#include <cmath>

namespace cama {
namespace {

constexpr double dependent = 1e-6;  // of the length of a change of g: what is left of it tells nothing new

double dot(const std::vector<double> &a, const std::vector<double> &b)
{
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += a[i] * b[i];
  return sum;
}

void add(std::vector<double> &to, double share, const std::vector<double> &other)
{
  for (std::size_t i = 0; i < to.size(); ++i) to[i] += share * other[i];
}

}  // namespace

void AndersonMixing::begin()
{
  changes_.clear();
  x_before_.clear();
}

std::vector<double> AndersonMixing::next(const std::vector<double> &x, const std::vector<double> &g)
{
  if (!x_before_.empty()) {
    Change change{x, g};
    add(change.x, -1, x_before_);
    add(change.g, -1, g_before_);
    const double length = std::sqrt(dot(change.g, change.g));
    for (int twice = 0; twice < 2; ++twice)  // for orthogonality beyond rounding
      for (const Change &known : changes_) {
        const double part = dot(known.g, change.g);
        add(change.g, -part, known.g);
        add(change.x, -part, known.x);
      }
    const double left = std::sqrt(dot(change.g, change.g));
    if (left > dependent * length) {
      for (double &value : change.x) value /= left;
      for (double &value : change.g) value /= left;
      changes_.push_back(std::move(change));
    }
  }
  x_before_ = x;
  g_before_ = g;
  std::vector<double> result = x, rest = g;
  for (const Change &known : changes_) {
    const double part = dot(known.g, g);
    add(result, -part, known.x);
    add(rest, -part, known.g);
  }
  add(result, 1, rest);
  return result;
}

}  // namespace cama
