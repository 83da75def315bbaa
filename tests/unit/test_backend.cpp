// SPDX-License-Identifier: Apache-2.0
// The backend's primitives against the standard library, streams, and the arithmetic that replaces the maths library.
#include "../backends.hpp"
#include "../catch.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <numeric>
#include <optional>
#include <random>

#include "../engine.hpp"
#include "../meshes.hpp"
#include "../stable_sort.hpp"
#include "cama/error.hpp"
#include "device/launch.hpp"

using namespace cama;

namespace {

/// Keys of several kinds, some with many equal ones.
std::vector<std::vector<key64>> key_sets(int n, int bits)
{
  std::mt19937_64 random(11);
  const key64 mask = bits == 64 ? ~key64(0) : (key64(1) << bits) - 1;
  std::vector<std::vector<key64>> sets(5, std::vector<key64>(static_cast<std::size_t>(n)));
  for (std::size_t i = 0; i < sets[0].size(); ++i) {
    sets[0][i] = random() & mask;
    sets[1][i] = random() % 3;
    sets[2][i] = mask;
    sets[3][i] = (mask - i) & mask;
    sets[4][i] = (i % 5) << (bits - 4);
  }
  return sets;
}

/// Distance in units in the last place of the expected value.
template <class Real> double ulps(Real value, Real expected)
{
  if (value == expected) return 0;
  const Real size = std::max(std::abs(expected), std::numeric_limits<Real>::min());
  const Real unit = std::nextafter(size, std::numeric_limits<Real>::infinity()) - size;
  return std::abs(static_cast<double>(value) - static_cast<double>(expected)) / static_cast<double>(unit);
}

template <class Real, class Plain> double worst_atan2(Plain plain)
{
  double worst = 0;
  const auto look = [&](Real y, Real x) { worst = std::max(worst, ulps<Real>(plain(y, x), std::atan2(y, x))); };
  const int steps = 200000;
  for (int i = 0; i <= steps; ++i) {   // around the circle
    const double angle = (2.0 * i / steps - 1) * 3.14159265358979;
    look(static_cast<Real>(std::sin(angle)), static_cast<Real>(std::cos(angle)));
  }
  for (int e = -30; e <= 30; ++e)   // all ratios, all quadrants
    for (int i = 0; i < 500; ++i) {
      const Real y = static_cast<Real>(std::ldexp(1 + i / 500.0, e));
      for (Real sy : {Real(-1), Real(1)})
        for (Real sx : {Real(-1), Real(1)}) look(sy * y, sx * Real(1.3));
    }
  return worst;
}

/// The CPU with one thread and with three, then the other available backends.
std::vector<std::unique_ptr<Backend>> every_backend()
{
  std::vector<std::unique_ptr<Backend>> backends;
  backends.push_back(make_backend("cpu", 0, 1));
  backends.push_back(make_backend("cpu", 0, 3));
  for (const std::string &name : backends_here())
    if (name != "cpu") backends.push_back(make_backend(name));
  return backends;
}

}  // namespace

TEST_CASE("scan equals the running sum", "[backend]")
{
  std::mt19937 random(3);
  for (const auto &backend : every_backend()) {
    INFO(backend->name());
    for (int n : {0, 1, 2, 255, 256, 257, 4096, 4097, 8192, 8193, 16384, 16385, 32768, 32769, 100000, 1 << 22,
                  (1 << 22) + 1, (1 << 24) + 1}) {
      std::vector<int> values(static_cast<std::size_t>(n));
      for (int &v : values) v = static_cast<int>(random() % 7);
      Stream<int> from(*backend, values), to(*backend, n + 1);
      backend->scan(from.buffer(), to.buffer(), n);
      std::vector<int> expected(values.size() + 1, 0);
      std::partial_sum(values.begin(), values.end(), expected.begin() + 1);
      REQUIRE(to.download() == expected);
      REQUIRE(from.download() == values);
    }
  }
}

TEST_CASE("scan refuses a list of 2^31 entries", "[backend]")
{
  for (const auto &backend : every_backend()) {
    INFO(backend->name());
    Stream<int> fits(*backend, std::vector<int>{0x7fffffff, 0}), beyond(*backend, std::vector<int>{0x7fffffff, 1}),
        to(*backend, 3);
    backend->scan(fits.buffer(), to.buffer(), 2);
    CHECK(to.at(2) == 0x7fffffff);
    // It throws at the latest when the total is read.
    CHECK_THROWS_AS((backend->scan(beyond.buffer(), to.buffer(), 2), to.at(2)), MemoryError);
    CHECK_THROWS_AS((backend->scan(beyond.buffer(), to.buffer(), 2), backend->synchronize()), ListOverflow);
    backend->scan(fits.buffer(), to.buffer(), 2);   // and the backend still works
    CHECK(to.at(2) == 0x7fffffff);
    std::vector<int> ones(300000, 1 << 13);   // 2.4e9: the sum of many
    Stream<int> many(*backend, ones), places(*backend, 300001);
    CHECK_THROWS_AS((backend->scan(many.buffer(), places.buffer(), 300000), places.at(1)), MemoryError);
  }
}

TEST_CASE("a stream refuses 2^31 elements, also where a sum of sizes has overflowed, and stays as it is", "[backend]")
{
  const auto backend = make_backend("cpu", 0, 1);
  Stream<char> stream(*backend, std::vector<char>{1, 2, 3});
  const volatile int most = 0x7fffffff;
  for (const long long size : {0x7fffffffll, 0x80000000ll, 0x100000003ll,
                               static_cast<long long>(static_cast<int>(static_cast<unsigned>(most) + 3u)), -1ll}) {
    INFO(size);
    CHECK_THROWS_AS(stream.grow(size), MemoryError);
    CHECK_THROWS_AS(stream.resize(size), MemoryError);
    CHECK(stream.download() == std::vector<char>{1, 2, 3});
  }
}

TEST_CASE("sort is std::stable_sort of keys with their values", "[backend]")
{
  for (const auto &backend : every_backend()) {
    INFO(backend->name());
    for (int bits : {11, 30, 62, 63, 64})
      for (int n : {0, 1, 2, 255, 512, 513, 1000, 2048, 2049, 4096, 4097, 100000}) {
        if (n == 100000 && bits != 63) continue;
        CAPTURE(n, bits);
        for (const auto &keys : key_sets(n, bits)) REQUIRE(sorts_stably(*backend, keys, bits));
      }
  }
}

TEST_CASE("a stream grows from capacity 1 and loses nothing that is written after", "[backend]")
{
  for (const auto &backend : every_backend()) {
    INFO(backend->name());
    Stream<int> s(*backend, 1);
    REQUIRE(s.capacity() == 1);
    for (int n : {1, 2, 3, 10, 9, 1000, 0, 1001}) {
      std::vector<int> values(static_cast<std::size_t>(n));
      std::iota(values.begin(), values.end(), n);
      s.assign(values);
      REQUIRE(s.size() == n);
      REQUIRE(s.capacity() >= n);
      REQUIRE(s.download() == values);
      if (n) REQUIRE(s.at(n - 1) == 2 * n - 1);
    }
    CHECK_THROWS_AS(s.resize(-1), MemoryError);
    const int before = s.capacity();
    s.resize(5);
    CHECK(s.capacity() == before);   // shrinking keeps the memory
  }
}

TEST_CASE("streams move, swap and copy", "[backend]")
{
  for (const auto &backend : every_backend()) {
    INFO(backend->name());
    Stream<double> a(*backend, std::vector<double>{1, 2, 3}), b(*backend, std::vector<double>{4}), c;
    a.swap(b);
    CHECK(b.download() == std::vector<double>{1, 2, 3});
    c = std::move(b);
    CHECK(c.size() == 3);
    a.copy_from(c);
    CHECK(a.download() == std::vector<double>{1, 2, 3});
    a.fill_zero();
    CHECK(a.download() == std::vector<double>{0, 0, 0});
  }
}

TEST_CASE("memory is aligned to 64 bytes and accounted for", "[backend]")
{
  for (const auto &backend : every_backend()) {
    INFO(backend->name());
    REQUIRE(backend->allocated_bytes() == 0);
    {
      std::vector<Stream<char>> streams;
      std::size_t bytes = 0;
      for (int n : {1, 3, 63, 64, 65, 1000}) {
        streams.emplace_back(*backend, n);
        bytes += static_cast<std::size_t>(n);
        if (backend->name() == "cpu") CHECK(reinterpret_cast<std::uintptr_t>(streams.back().buffer()) % 64 == 0);
        CHECK(backend->allocated_bytes() == bytes);
      }
      CHECK(backend->peak_bytes() == bytes);
      streams.back().resize(2000);   // grows by half, after the old memory is released
      CHECK(backend->allocated_bytes() == bytes - 1000 + 3000);
    }
    CHECK(backend->allocated_bytes() == 0);
    CHECK(backend->peak_bytes() == 1 + 3 + 63 + 64 + 65 + 3000);
  }
}

TEST_CASE("memory that cannot be allocated throws an error with the size", "[backend]")
{
  for (const auto &backend : every_backend()) {
    INFO(backend->name());
    const std::string text = thrown<MemoryError>([&] { backend->allocate(std::size_t(1) << 60); });
    CHECK(contains(text, std::to_string(std::size_t(1) << 60)));
    CHECK(backend->allocated_bytes() == 0);
  }
}

TEST_CASE("new streams hold NaN in debug builds of the library", "[backend]")
{
  const auto backend = make_backend("cpu", 0, 1);
  // The allocator returns memory that was just zeroed and released; a new stream fills it with NaN again.
  {
    Stream<double> zero(*backend, 32);
    zero.fill_zero();
  }
  Stream<double> d(*backend, 32);
  const std::vector<double> values = d.download();
  const bool poisoned = std::all_of(values.begin(), values.end(), [](double x) { return std::isnan(x); });
#ifndef NDEBUG
  CHECK(poisoned);
#else
  CHECK_FALSE(poisoned);
#endif
}

TEST_CASE("backends that are not there are named", "[backend]")
{
  CHECK(contains(thrown<BackendError>([] { make_backend("vulkan"); }), "vulkan"));
  CHECK_THROWS_AS(make_backend("cpu", 3), BackendError);
  CHECK_THROWS_AS(make_backend("cpu", 0, -1), BackendError);
}

TEST_CASE("a scene gets the threads of the CPU backend that it keeps busy, no more than there are", "[backend]")
{
  for (int triangles : {0, 1, 999, 1000, 1999}) CHECK(useful_threads(triangles) == 1);
  CHECK(useful_threads(3500) == std::min(3, cpu_count()));
  CHECK(useful_threads(std::numeric_limits<int>::max()) == cpu_count());
  const auto device = [](int cells, int threads) {
    Options o = serial();
    o.backend = "cpu";
    o.threads = threads;
    return Simulation(meshes::hanging(cells), o).backend().device();
  };
  const auto ends_with = [](const std::string &text, const std::string &end) {
    return text.size() > end.size() && text.substr(text.size() - end.size()) == end;
  };
  CHECK(ends_with(device(8, 0), ", 1 thread"));
  CHECK(ends_with(device(8, 3), ", 3 threads"));
  CHECK(ends_with(device(60, 0), cpu_count() > 1 ? " threads" : ", 1 thread"));   // 7,200 triangles
}

TEST_CASE("downloads start where they are told, copies and fills end there", "[backend]")
{
  for (const auto &backend : every_backend()) {
    INFO(backend->name());
    Stream<int> s(*backend, std::vector<int>{1, 2, 3, 4, 5, 6, 7}), t(*backend, std::vector<int>(7, -1));
    int two[2];
    backend->download(two, s.buffer(), sizeof two, 4 * sizeof(int));
    CHECK((two[0] == 5 && two[1] == 6));
    backend->copy(t.buffer(), s.buffer(), 3 * sizeof(int));
    CHECK(t.download() == std::vector<int>{1, 2, 3, -1, -1, -1, -1});
    for (int bytes : {1, 4, 16, 20, 28}) {
      s.assign({-1, -1, -1, -1, -1, -1, -1});
      backend->fill(s.buffer(), 0, static_cast<std::size_t>(bytes));
      const std::vector<int> values = s.download();
      const auto *byte = reinterpret_cast<const unsigned char *>(values.data());
      for (int i = 0; i < 28; ++i) CHECK(byte[i] == (i < bytes ? 0 : 255));
    }
  }
}

TEST_CASE("downloads of every size, short and long, give what was uploaded", "[backend]")
{
  for (const auto &backend : every_backend()) {
    INFO(backend->name());
    for (int n : {1, 2, 3, 4, 5, 255, 8188, 8191, 8192, 8193, 8196, 100000})
      for (int first : {0, 1, 4}) {
        std::vector<unsigned char> values(static_cast<std::size_t>(n + first)), got(static_cast<std::size_t>(n));
        for (std::size_t i = 0; i < values.size(); ++i) values[i] = static_cast<unsigned char>(31 * i + 7);
        const Stream<unsigned char> s(*backend, values);
        const long before = backend->waits();
        backend->download(got.data(), s.buffer(), got.size(), static_cast<std::size_t>(first));
        REQUIRE(std::equal(got.begin(), got.end(), values.begin() + first));
        CHECK(backend->waits() == before + 1);
      }
  }
}

TEST_CASE("what follows launches side by side, and work aside, waits for all of it", "[backend]")
{
  for (const auto &backend : every_backend())
    for (const bool in_batches : {false, true})
      for (const int n : {1000, 1 << 20}) {   // long enough for a launch behind a short one to begin too early
        INFO(backend->name() << ", " << n << (in_batches ? ", in batches" : ""));
        std::optional<Batches> batches;
        if (in_batches) batches.emplace(*backend);
        Stream<dvec3> x(*backend, std::vector<dvec3>(n, {1, 1, 1})), y(*backend, n);
        Stream<int> mark(*backend, 1);
        y.fill_zero();
        const auto same = [&](double ofx, double ofy) {
          const auto all = [](const std::vector<dvec3> &v, double expected) {
            return std::all_of(v.begin(), v.end(), [&](dvec3 a) { return a.x == expected && a.z == expected; });
          };
          return all(x.download(), ofx) && all(y.download(), ofy);
        };
        for (int turn = 0; turn < 5; ++turn) {
          {
            const SideBySide side_by_side(*backend);
            CAMA_LAUNCH(*backend, scale_vectors, n, 2.0, x);
            CAMA_LAUNCH(*backend, set_int, 1, 0, turn, mark);
          }
          CAMA_LAUNCH(*backend, add_impulses, n, 1.0, x, y);
          CHECK(same(2, 2));
          CAMA_LAUNCH(*backend, scale_vectors, n, 2.0, x);
          {
            const SideBySide side_by_side(*backend);   // each after what came before the first
            CAMA_LAUNCH(*backend, set_int, 1, 0, turn, mark);
            CAMA_LAUNCH(*backend, add_impulses, n, -0.5, x, y);
          }
          CHECK(same(4, 0));
          CAMA_LAUNCH(*backend, scale_vectors, n, 0.5, x);
          CAMA_LAUNCH(*backend, add_impulses, n, 1.0, x, y);
          CAMA_LAUNCH(*backend, scale_vectors, n, 2.0, x);
          {
            Fork fork(*backend);
            CAMA_LAUNCH(*backend, scale_vectors, n, 0.5, y);
            fork.aside([&] { CAMA_LAUNCH(*backend, scale_vectors, n, 0.25, x); });
            CAMA_LAUNCH(*backend, set_int, 1, 0, -turn, mark);
          }
          CAMA_LAUNCH(*backend, add_impulses, n, -1.0, x, y);
          CHECK(same(1, 0));
          CHECK(mark.at(0) == -turn);
        }
        CHECK_THROWS_AS(Fork(*backend).aside([] { throw MemoryError("aside"); }), MemoryError);
        CAMA_LAUNCH(*backend, scale_vectors, n, 3.0, x);   // and the backend still works
        CHECK(same(3, 0));
      }
}

TEST_CASE("launches in batches give what they give one by one", "[backend]")
{
  for (const auto &backend : every_backend()) {
    INFO(backend->name());
    std::mt19937 random(5);
    for (int turn = 0; turn < 12; ++turn) {   // the same launches again and again, of other sizes and buffers
      const Batches batches(*backend);
      const int n = 100 + 700 * (turn % 3);
      std::vector<int> order(static_cast<std::size_t>(n));
      std::iota(order.begin(), order.end(), 0);
      std::shuffle(order.begin(), order.end(), random);
      const Stream<int> next(*backend, order);
      std::vector<int> places(order.size());
      std::iota(places.begin(), places.end(), 0);
      Stream<key64> key(*backend, std::vector<key64>(order.begin(), order.end()));
      Stream<int> place(*backend, places), sums(*backend, n + 1), all(*backend, n);
      {
        Stream<int> twice(*backend, n);   // released before it is used
        CAMA_LAUNCH(*backend, take_items, n, next, next, twice);
        Stream<int> thrice(*backend, n);
        CAMA_LAUNCH(*backend, take_items, n, twice, next, thrice);
        twice.fill_zero();
        all.copy_from(thrice);
      }
      Stream<int> other(*backend, n);   // perhaps in the memory of one of these
      other.fill_zero();
      backend->sort(key.buffer(), place.buffer(), n, 11);
      backend->scan(all.buffer(), sums.buffer(), n);
      std::vector<int> expected(order.size()), running(order.size() + 1, 0);
      for (std::size_t i = 0; i < order.size(); ++i) {
        expected[i] = order[static_cast<std::size_t>(order[static_cast<std::size_t>(order[i])])];
        places[static_cast<std::size_t>(order[i])] = static_cast<int>(i);
      }
      std::partial_sum(expected.begin(), expected.end(), running.begin() + 1);
      CHECK(all.download() == expected);
      CHECK(sums.download() == running);
      CHECK(place.download() == places);
    }
    // More lists than a backend keeps: 3^6 orders of three kernels that do not commute, again and again.
    Stream<dvec3> x(*backend, 3), y(*backend, 3);
    int wrong = 0;
    for (int round = 0; round < 6; ++round)
      for (int list = 0; list < 729; ++list) {
        x.assign({{1, 2, 3}, {4, 5, 6}, {7, 8, 9}});
        y.assign({{1, 1, 1}, {2, 2, 2}, {3, 3, 3}});
        double expected_x = 7, expected_y = 3;
        {
          const Batches batches(*backend);
          for (int k = 0, left = list; k < 6; ++k, left /= 3) {
            const double factor = 1 + (k + round) % 2;
            if (left % 3 == 0) {
              CAMA_LAUNCH(*backend, scale_vectors, 3, factor, x);
              expected_x *= factor;
            } else if (left % 3 == 1) {
              CAMA_LAUNCH(*backend, add_impulses, 3, factor, x, y);
              expected_y += factor * expected_x;
            } else {
              x.copy_from(y);
              expected_x = expected_y;
            }
          }
        }
        wrong += x.at(2).x != expected_x || y.at(2).x != expected_y;
      }
    CHECK(wrong == 0);
  }
}

TEST_CASE("launch counts its calls and skips empty ones", "[backend]")
{
  for (const auto &backend : every_backend()) {
    INFO(backend->name());
    Stream<int> s(*backend, 1000);
    CAMA_LAUNCH(*backend, set_int, 1000, 0, 7, s);
    CHECK(s.download() == std::vector<int>(1000, 7));
    CHECK(backend->launches() == 1);
    CAMA_LAUNCH(*backend, set_int, 0, 0, 9, s);
    CHECK(backend->launches() == 1);
  }
}

TEST_CASE("integer atomics count, and keep the least and the most", "[backend]")
{
  int sum = 0, least = 1 << 30, most = -(1 << 30);
#pragma omp parallel for num_threads(4)
  for (int i = 0; i < 20000; ++i) {
    atomic_add_int(&sum, i % 3);
    atomic_min_int(&least, (i * 7919) % 20011 - 5);
    atomic_max_int(&most, (i * 7919) % 20011);
  }
  int s = 0, lo = 1 << 30, hi = -(1 << 30);
  for (int i = 0; i < 20000; ++i) {
    s += i % 3;
    lo = std::min(lo, (i * 7919) % 20011 - 5);
    hi = std::max(hi, (i * 7919) % 20011);
  }
  CHECK(sum == s);
  CHECK(least == lo);
  CHECK(most == hi);
}

TEST_CASE("atan2_plain is within 4 units in the last place of std::atan2", "[backend]")
{
  CHECK(worst_atan2<double>([](double y, double x) { return kernels::f64::atan2_plain(y, x); }) <= 4);
  CHECK(worst_atan2<float>([](float y, float x) { return kernels::f32::atan2_plain(y, x); }) <= 4);
}

TEST_CASE("atan2_plain on the axes and at the origin", "[backend]")
{
  const double pi = 3.14159265358979323846;
  CHECK(kernels::f64::atan2_plain(0, 0) == 0);
  CHECK(kernels::f64::atan2_plain(0, 2) == 0);
  CHECK(kernels::f64::atan2_plain(0, -2) == pi);
  CHECK(kernels::f64::atan2_plain(3, 0) == pi / 2);
  CHECK(kernels::f64::atan2_plain(-3, 0) == -pi / 2);
  CHECK(kernels::f64::atan2_plain(1e-300, 1) == 1e-300);
}

TEST_CASE("float_below and float_above bracket every double closely", "[backend]")
{
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> mantissa(-2, 2);
  int wrong = 0;
  double widest = 0;
  const auto look = [&](double x) {
    const float lo = kernels::float_below(x), hi = kernels::float_above(x);
    wrong += !(static_cast<double>(lo) <= x && x <= static_cast<double>(hi));
    wrong += std::fpclassify(lo) == FP_SUBNORMAL || std::fpclassify(hi) == FP_SUBNORMAL;
    if (std::abs(x) > 1e-29)
      widest = std::max({widest, ulps<float>(lo, static_cast<float>(x)), ulps<float>(hi, static_cast<float>(x))});
  };
  for (int e = -140; e <= 120; ++e)
    for (int i = 0; i < 1000; ++i) look(std::ldexp(mantissa(random), e));
  for (int i = 0; i < 100000; ++i) {   // at floats and next to them
    const float f = static_cast<float>(std::ldexp(mantissa(random), static_cast<int>(random() % 60) - 30));
    for (double x : {static_cast<double>(f), std::nextafter(static_cast<double>(f), 1e9),
                     std::nextafter(static_cast<double>(f), -1e9)})
      look(x);
  }
  for (double x : {0.0, -0.0, 1e-45, -1e-45, 1e-38, 1e-30, 5e-324, 1.0, -1.0}) look(x);
  CHECK(wrong == 0);
  CHECK(widest <= 3);
}

// One ctest for each backend (backend.cpu, ...), so that an absent one is visible: other tests run on the available
// ones.
TEST_CASE("a backend runs a kernel", "[.][presence]")
{
  const char *name = std::getenv("CAMA_TEST_BACKEND");
  REQUIRE(name);
  if (!backend_here(name)) {
    ++skipped;
    return;
  }
  const auto backend = make_backend(name);
  Stream<int> numbers(*backend, 1000);
  CAMA_LAUNCH(*backend, set_int, 1000, 0, 7, numbers);
  CHECK(numbers.download() == std::vector<int>(1000, 7));
}
