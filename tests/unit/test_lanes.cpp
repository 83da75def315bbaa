// SPDX-License-Identifier: Apache-2.0
// Vectors of CPUs against plain loops over their numbers.
#include "../catch.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <random>
#include <vector>

#include "device/kernels.hpp"

using namespace cama;

namespace {

/// These numbers, one in each lane.
float_lanes lanes_of(const std::vector<float> &v) { return LANES_LOAD(float_lanes, v.data()); }

template <class Real> std::vector<Real> random(std::size_t n, std::mt19937 &engine)
{
  std::vector<Real> v(n);
  for (Real &x : v) x = std::uniform_real_distribution<Real>(-1, 1)(engine);
  return v;
}

bool same_bits(float a, float b) { return std::memcmp(&a, &b, sizeof a) == 0; }
bool same_bits(double a, double b) { return std::memcmp(&a, &b, sizeof a) == 0; }

}  // namespace

TEMPLATE_TEST_CASE("sums of columns come in the order of halves, bit by bit", "[lanes]", float, double)
{
  std::mt19937 engine(3);
  for (int round = 0; round < 20; ++round) {
    const auto column = random<TestType>(3 * 256, engine), v = random<TestType>(3 * 16, engine);
    TestType sum[LANES];
    const TestType *runs[3] = {column.data(), column.data() + 256, column.data() + 512};
    const auto keep = [&](auto sums) {
      for (int q = 0; q < LANES; ++q) sum[q] = LANE(sums, q);
    };
    if constexpr (sizeof(TestType) == 4) {
      kernels::f32::lanes sums;
      kernels::f32::dot_columns(runs, 3, v.data(), &sums);
      keep(sums);
    } else {
      kernels::f64::lanes sums;
      kernels::f64::dot_columns(runs, 3, v.data(), &sums);
      keep(sums);
    }
    for (int q = 0; q < LANES; ++q) {
      TestType t[16] = {};
      for (int k = 0; k < 3; ++k)
        for (int r = 0; r < 16; ++r) t[r] += column[256 * k + 16 * q + r] * v[16 * k + r];
      for (int width = 8; width > 0; width /= 2)
        for (int r = 0; r < width; ++r) t[r] += t[r + width];
      CHECK(same_bits(sum[q], t[0]));
    }
  }
}

TEMPLATE_TEST_CASE("vectors go from anywhere to the lanes and back", "[lanes]", float, double)
{
  std::mt19937 engine(4);
  const auto gather = [&](auto like, auto x) {   // the functions of the namespace of its precision
    using Vector = decltype(like);
    const auto numbers = random<TestType>(4 * 100, engine);
    std::vector<Vector> v(100);
    for (std::size_t i = 0; i < v.size(); ++i) v[i] = {numbers[4 * i], numbers[4 * i + 1], numbers[4 * i + 2], 0};
    for (int round = 0; round < 20; ++round) {
      std::vector<int> at(LANES);
      for (int &place : at) place = std::uniform_int_distribution<int>(0, 99)(engine);
      auto y = x, z = x;
      gather_lanes(v.data(), at.data(), &x, &y, &z);
      for (int q = 0; q < LANES; ++q) {
        const auto from = 4 * static_cast<std::size_t>(at[static_cast<std::size_t>(q)]);
        CHECK(same_bits(LANE(x, q), numbers[from]));
        CHECK(same_bits(LANE(y, q), numbers[from + 1]));
        CHECK(same_bits(LANE(z, q), numbers[from + 2]));
      }
      std::vector<int> to(LANES);
      for (std::size_t q = 0; q < LANES; ++q) to[q] = static_cast<int>((7 * q + static_cast<std::size_t>(round)) % 100);
      const int count = round % (LANES + 1);
      std::vector<Vector> written(100, Vector{2, 2, 2, 2});
      scatter_lanes(written.data(), to.data(), count, x, y, z);
      for (int q = 0; q < count; ++q) {
        Vector &there = written[static_cast<std::size_t>(to[static_cast<std::size_t>(q)])];
        CHECK(same_bits(there.x, LANE(x, q)));
        CHECK(same_bits(there.y, LANE(y, q)));
        CHECK(same_bits(there.z, LANE(z, q)));
        CHECK(same_bits(there.w, TestType(0)));
        there = {2, 2, 2, 2};
      }
      for (const Vector &there : written) CHECK(there.x == 2);
    }
  };
  if constexpr (sizeof(TestType) == 4)
    gather(kernels::f32::vec4{}, kernels::f32::lanes{});
  else
    gather(kernels::f64::vec4{}, kernels::f64::lanes{});
}

TEST_CASE("lanes choose, invert and take roots as one number does", "[lanes]")
{
  std::mt19937 engine(5);
  for (int round = 0; round < 50; ++round) {
    const auto a = random<float>(LANES, engine), b = random<float>(LANES, engine);
    const auto most = kernels::lanes_max(lanes_of(a), lanes_of(b)),
               least = kernels::lanes_min(lanes_of(a), lanes_of(b));
    const auto inverse = kernels::lanes_inverse(lanes_of(a)),
               root = kernels::lanes_inverse_root(lanes_of(a) * lanes_of(a));
    for (int q = 0; q < LANES; ++q) {
      CHECK(same_bits(LANE(most, q), std::max(a[q], b[q])));
      CHECK(same_bits(LANE(least, q), std::min(a[q], b[q])));
      CHECK(same_bits(LANE(inverse, q), float(1.0 / a[q])));
      CHECK(LANE(root, q) == Approx(1 / std::abs(a[q])).epsilon(4e-7));
    }
  }
}

TEST_CASE("what moves past each other keeps the separation along the direction between", "[lanes]")
{
  // A vertex 10 mm above a face goes 1 m sideways, then down to 4 mm beside it: it keeps 4 mm along z. It would be a
  // contact if its motion could have any direction.
  const kernels::swept_vertex face[3] = {
      {0, 0, 0, 0, 0, 0, 1e-3f, 0}, {1, 0, 0, 0, 0, 0, 1e-3f, 0}, {0, 1, 0, 0, 0, 0, 1e-3f, 0}};
  for (const float height : {0.01f, 0.004f, 0.0005f}) {
    const kernels::swept_vertex vertex{1 / 3.0f, 1 / 3.0f, 0.01f, 1, 0, height - 0.01f, 1e-3f, 0};
    CAPTURE(height);
    const float along = kernels::gap_bound_along(0, vertex, face[0], face[1], face[2], kernels::fvec3_make(0, 0, 1), 0);
    CHECK(along == Approx(height > 1e-3f ? height : 0).margin(1e-7));
    const std::vector<kernels::swept_vertex> swept{vertex, face[0], face[1], face[2]};
    const kernels::pair candidate{0, 0};
    const kernels::face_nodes nodes{{1, 2, 3}};
    const kernels::edge_nodes none{{0, 0}};
    const float rounding = 0;
    for (const int contacts : {0, 1}) {
      kernels::fvec3 direction;
      float gap_bound = -1;
      kernels::cull_separated_pairs(1, 0, contacts, &candidate, &nodes, &none, swept.data(), &rounding, &direction,
                                    &gap_bound);
      CAPTURE(contacts, direction.x, direction.y, direction.z);
      CHECK(gap_bound == Approx(contacts || height < 1e-3f ? 0 : height).epsilon(1e-3));
    }
  }
}

TEST_CASE("a single pair of swept vertices has the gap_bound of its lane", "[lanes]")
{
  // A face in the plane z = 0 and a vertex above it: the result is the height minus motion and radius, if that exceeds
  // the thickness.
  const auto swept_vertex = [](float x, float y, float z, float dz, float radius) {
    return kernels::swept_vertex{x, y, z, 0, 0, dz, 1e-3f, radius};
  };
  const auto gap_bound = [&](float height, float falls, float radius) {
    return kernels::gap_bound_along(0, swept_vertex(0.2f, 0.2f, height, -falls, radius), swept_vertex(0, 0, 0, 0, 0),
                                    swept_vertex(1, 0, 0, 0, 0), swept_vertex(0, 1, 0, 0, 0),
                                    kernels::fvec3_make(0, 0, 1), 0);
  };
  CHECK(gap_bound(0.5f, 0, 0) == Approx(0.5));
  CHECK(gap_bound(0.5f, 0.1f, 0) == Approx(0.4).epsilon(1e-5));
  CHECK(gap_bound(0.5f, 0.1f, 0.2f) == Approx(0.2).epsilon(1e-5));
  CHECK(gap_bound(0.9e-3f, 0, 0) == 0);  // not beyond the thickness
  CHECK(gap_bound(-0.5f, 0, 0) == 0);
}
