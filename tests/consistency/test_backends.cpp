// SPDX-License-Identifier: Apache-2.0
// Backends agree to the bit: each available one with the serial reference, stage by stage and in free runs. An absent
// one is reported.
#include "../backends.hpp"
#include "../engine.hpp"
#include "everything.hpp"
#include "lockstep.hpp"

using namespace cama;
using namespace everything_scene;

namespace {

/// The backends besides cpu that have a device on this machine.
std::vector<std::string> device_backends()
{
  std::vector<std::string> names;
  for (const char *name : {"opencl", "cuda"})
    if (backend_here(name)) names.push_back(name);
  return names;
}

}  // namespace

TEST_CASE("lock step: every backend agrees with cpu on every stream after every stage", "[lockstep]")
{
  if (!lockstep::strict_build()) return;
  for (const std::string &backend : device_backends()) {
    INFO(backend);
    const Scene scene = everything(10);
    for (const char *precision : {"double", "single"})
      for (Assembly assembly : {Assembly::gather, Assembly::algorithm1, Assembly::sorted}) {
        INFO(precision << ", assembly " << static_cast<int>(assembly));
        StagedEngine reference(scene, with(precision, 1, assembly)),
            candidate(scene, with(precision, 0, assembly, backend));
        REQUIRE(candidate.backend->name() == backend);
        CHECK(lockstep::run(reference, candidate, 10) == "");
      }
  }
}

TEST_CASE("lock step: every backend agrees with cpu in the paper's mode, fronts included", "[lockstep]")
{
  if (!lockstep::strict_build()) return;
  for (const std::string &backend : device_backends()) {
    INFO(backend);
    Options serial_cpu = Options::at(Accuracy::paper), other = serial_cpu;
    serial_cpu.backend = "cpu";
    serial_cpu.threads = 1;
    serial_cpu.forces = other.forces = true;
    other.backend = backend;
    StagedEngine reference(elastic(everything(8)), serial_cpu), candidate(elastic(everything(8)), other);
    CHECK(lockstep::run(reference, candidate, 10) == "");
  }
}

TEST_CASE("the state hash after 30 steps is the same on every backend", "[determinism]")
{
  if (!lockstep::strict_build()) return;
  for (const std::string &backend : device_backends()) {
    INFO(backend);
    const Scene scene = everything(12);
    for (const char *precision : {"double", "single"}) {
      INFO(precision);
      const Outcome cpu = simulate(scene, with(precision, 2), 30);
      CHECK(cpu.contacts > 100);
      CHECK(cpu.impacts > 0);
      const Outcome other = simulate(scene, with(precision, 0, Assembly::gather, backend), 30);
      CHECK(other.hash == cpu.hash);
      CHECK(other.contacts == cpu.contacts);
    }
  }
}

TEST_CASE("the state hash in the paper's mode is the same on every backend", "[determinism]")
{
  if (!lockstep::strict_build()) return;
  for (const std::string &backend : device_backends()) {
    INFO(backend);
    const Scene scene = elastic(everything(8));
    for (const char *precision : {"double", "single"})
      for (Assembly assembly : {Assembly::algorithm1, Assembly::sorted}) {
        INFO(precision << ", assembly " << static_cast<int>(assembly));
        Options o = Options::at(Accuracy::paper);
        o.precision = precision_of(precision);
        o.paper.assembly = assembly;
        o.backend = "cpu";
        const Outcome cpu = simulate(scene, o, 10);
        o.backend = backend;
        CHECK(simulate(scene, o, 10).hash == cpu.hash);
      }
  }
}
