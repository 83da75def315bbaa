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
    changes_.push_back(std::move(change));
  }
  x_before_ = x;
  g_before_ = g;
  std::vector<Change> basis;  // with orthonormal g
  std::vector<double> result = x, rest = g;
  for (std::size_t i = changes_.size(); i-- > 0;) {
    Change own = changes_[i];
    const double length = std::sqrt(dot(own.g, own.g));
    for (int twice = 0; twice < 2; ++twice)  // for orthogonality beyond rounding
      for (const Change &known : basis) {
        const double part = dot(known.g, own.g);
        add(own.g, -part, known.g);
        add(own.x, -part, known.x);
      }
    const double left = std::sqrt(dot(own.g, own.g));
    if (!(left > dependent * length)) continue;
    for (double &value : own.x) value /= left;
    for (double &value : own.g) value /= left;
    const double part = dot(own.g, g);
    add(result, -part, own.x);
    add(rest, -part, own.g);
    basis.push_back(std::move(own));
  }
  add(result, 1, rest);
  return result;
}

}  // namespace cama
