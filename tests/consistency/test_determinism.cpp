// SPDX-License-Identifier: Apache-2.0
// The same bits for every number of threads and every run; and the lock-step comparator, which is first shown to detect
// errors.
#include "../catch.hpp"

#include <cmath>
#include <limits>

#include "everything.hpp"
#include "lockstep.hpp"

using namespace cama;
using namespace everything_scene;

namespace {

/// The next double after v.
double bump(double v) { return std::nextafter(v, std::numeric_limits<double>::infinity()); }

}  // namespace

TEST_CASE("the state hash is the same for 1, 2 and 7 threads and for every run", "[determinism]")
{
  const Scene scene = everything(12);
  for (const char *precision : {"double", "single"}) {
    INFO(precision);
    const Outcome one = simulate(scene, with(precision, 1), 30);
    CHECK(one.contacts > 100);
    CHECK(one.impacts > 0);
    for (int threads : {1, 2, 7}) {
      INFO(threads << " threads");
      CHECK(simulate(scene, with(precision, threads), 30).hash == one.hash);
    }
  }
}

TEST_CASE("the state hash does not depend on threads in the paper's mode either", "[determinism]")
{
  const Scene scene = elastic(everything(8));
  for (Assembly assembly : {Assembly::algorithm1, Assembly::sorted}) {
    Options o = Options::at(Accuracy::paper);
    o.paper.assembly = assembly;
    o.threads = 1;
    const Outcome one = simulate(scene, o, 10);
    o.threads = 5;
    CHECK(simulate(scene, o, 10).hash == one.hash);
  }
}

TEST_CASE("a bit of the input is a difference in the hash", "[determinism]")
{
  Scene scene = everything(8);
  const Outcome before = simulate(scene, with("double", 1), 3);
  scene.cloths[0].velocity.x = bump(scene.cloths[0].velocity.x);
  CHECK(simulate(scene, with("double", 1), 3).hash != before.hash);
}

TEST_CASE("lock step: one thread and seven agree on every stream after every stage", "[lockstep]")
{
  const Scene scene = everything(10);
  for (const char *precision : {"double", "single"})
    for (Assembly assembly : {Assembly::gather, Assembly::algorithm1, Assembly::sorted}) {
      INFO(precision << ", assembly " << static_cast<int>(assembly));
      StagedEngine reference(scene, with(precision, 1, assembly)), candidate(scene, with(precision, 7, assembly));
      CHECK(lockstep::run(reference, candidate, 10) == "");
    }
}

TEST_CASE("lock step: one thread and seven agree in the paper's mode, fronts included", "[lockstep]")
{
  Options one = Options::at(Accuracy::paper), seven = one;
  one.backend = seven.backend = "cpu";
  one.threads = 1;
  seven.threads = 7;
  StagedEngine reference(elastic(everything(8)), one), candidate(elastic(everything(8)), seven);
  REQUIRE(reference.has_stream("self_front"));
  CHECK(lockstep::run(reference, candidate, 10) == "");
}

TEST_CASE("lock step: every stage of a step is among the leaves, and sees contacts", "[lockstep]")
{
  StagedEngine reference(everything(10), with("double", 1)), candidate(everything(10), with("double", 2));
  std::map<std::string, int> seen;
  int contacts = 0;
  const auto watch = [&](int, const std::string &stage, State &state) {
    ++seen[stage];
    contacts = std::max(contacts, state.contact.contacts);
  };
  REQUIRE(lockstep::run(reference, candidate, 4, watch) == "");
  CHECK(contacts > 30);
  for (const char *stage :
       {"prescribed motion", "candidate search", "contacts", "element forces", "contact terms", "matrix assembly",
        "linear solve", "advance positions", "penetration handling", "finish step"}) {
    INFO(stage);
    CHECK(seen[stage] == 4);
  }
}

TEST_CASE("lock step finds and names a planted error of one unit in the last place in any stream", "[lockstep]")
{
  const Scene scene = everything(5);
  struct Plant {
    int step;
    const char *stage, *stream;
    int index;
  };
  for (const Plant &plant :
       {Plant{2, "element forces", "force", 7}, Plant{1, "matrix assembly", "block", 31},
        Plant{2, "linear solve", "solution", 3}, Plant{2, "contacts", "contact", 2},
        Plant{3, "contact terms", "term", 1}, Plant{1, "advance positions", "position_next", 11},
        Plant{2, "element forces", "hinge_factor", 4}, Plant{3, "candidate search", "predicted", 0}}) {
    StagedEngine reference(scene, with("double", 1)), candidate(scene, with("double", 1));
    const auto tamper = [&](int step, const std::string &stage, State &state) {
      if (step != plant.step || stage != plant.stage) return;
      state.visit_streams([&](const char *name, auto &stream) {
        using T = typename std::decay_t<decltype(stream)>::value_type;
        if (std::string(name) != plant.stream) return;
        auto values = stream.download();
        REQUIRE(static_cast<int>(values.size()) > plant.index);
        // The last double of the element, whatever the struct.
        auto *end = reinterpret_cast<unsigned char *>(&values[static_cast<std::size_t>(plant.index)]) + sizeof(T) -
                    sizeof(double);
        double v;
        std::memcpy(&v, end, sizeof v);
        v = bump(v);
        std::memcpy(end, &v, sizeof v);
        stream.assign(values);
      });
    };
    const std::string text = lockstep::run(reference, candidate, 3, tamper);
    CHECK(text == "step " + std::to_string(plant.step) + ", stage " + plant.stage + ", stream " + plant.stream +
                      ", index " + std::to_string(plant.index) + ": values differ");
  }
}

TEST_CASE("lock step finds a wrong integer, a wrong size and a wrong count", "[lockstep]")
{
  const Scene scene = everything(5);
  const auto caught = [&](const lockstep::Tamper &tamper) {
    StagedEngine reference(scene, with("single", 1)), candidate(scene, with("single", 1));
    return lockstep::run(reference, candidate, 1, tamper);
  };
  const std::string integer = caught([](int, const std::string &stage, State &s) {
    if (stage != "candidate search") return;
    auto pairs = s.contact.vertex_face.pairs.download();
    pairs.at(1).b ^= 1;
    s.contact.vertex_face.pairs.assign(pairs);
  });
  CHECK(integer == "step 1, stage candidate search, stream vertex_face.pairs, index 1: values differ");
  const std::string size = caught([](int, const std::string &stage, State &s) {
    if (stage == "contacts") s.contact.contact.resize(s.contact.contact.size() - 1);
  });
  CHECK(contains(size, "stage contacts, stream contact, index 0: sizes "));
  CHECK(contains(caught([](int, const std::string &stage, State &s) { s.system.terms += stage == "contact terms"; }),
                 "stream terms"));
}

TEST_CASE("lock step counts padding and the payload of NaN as nothing, the sign of zero as something", "[lockstep]")
{
  kernels::stitch a, b;  // four bytes of padding behind node
  std::memset(&a, 0x00, sizeof a);
  std::memset(&b, 0xff, sizeof b);
  for (kernels::stitch *s : {&a, &b}) {
    s->node[0] = 1;
    s->node[1] = 2;
    s->node[2] = 3;
    s->ratio = 0.5;
    s->stiffness = std::nan(s == &a ? "1" : "2");
  }
  const auto backend = make_backend("cpu", 0, 1);
  const auto differ = [&](kernels::stitch x, kernels::stitch y) {
    return lockstep::compare("stitch", Stream<kernels::stitch>(*backend, std::vector<kernels::stitch>{x}),
                             Stream<kernels::stitch>(*backend, std::vector<kernels::stitch>{y}))
        .has_value();
  };
  CHECK_FALSE(differ(a, b));
  b.ratio = bump(0.5);
  CHECK(differ(a, b));
  a.ratio = 0.0;
  b.ratio = -0.0;
  CHECK(differ(a, b));
  b.ratio = 0.0;
  b.stiffness = 1;
  CHECK(differ(a, b));
}
