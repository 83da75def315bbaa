// SPDX-License-Identifier: Apache-2.0
// Work aside and launches side by side, on a CPU that does them in another order: work aside as late as it may be or at
// once, launches side by side from the last one to the first. Every order has to give the same bits.
#include "../catch.hpp"

#include <cstring>
#include <functional>
#include <map>
#include <stdexcept>

#include "../engine.hpp"
#include "../meshes.hpp"
#include "../precision.hpp"
#include "cama/error.hpp"
#include "device/fnv.hpp"
#include "device/launch.hpp"
#include "everything.hpp"

using namespace cama;

namespace {

enum class Order { late, at_once };

/// A CPU that claims to be a GPU with forks.
class Reordering final : public Backend {
public:
  explicit Reordering(Order order) : inner_(make_backend("cpu", 0, 1)), order_(order) {}
  std::string_view name() const override { return inner_->name(); }
  std::string device() const override { return inner_->device(); }
  bool wide_workers() const override { return false; }
  int workers() const override { return 1 << 18; }
  bool forks() const override { return true; }

  Buffer allocate(std::size_t bytes) override
  {
    Buffer buffer = inner_->allocate(bytes);
    bytes_[buffer] = bytes;
    return buffer;
  }
  /// What is released in a fork is spoilt, and stays until the end of the fork.
  void release(Buffer buffer) noexcept override
  {
    const std::size_t bytes = bytes_[buffer];
    bytes_.erase(buffer);
    if (!forked_) return inner_->release(buffer);
    if (!aside_) inner_->fill(buffer, 0xff, bytes);
    released_.push_back(buffer);
  }
  void upload(Buffer to, const void *from, std::size_t bytes) override
  {
    refuse_aside();
    inner_->upload(to, from, bytes);
  }
  void download(void *to, Buffer from, std::size_t bytes, std::size_t offset) override
  {
    refuse_aside();
    if (!late_.empty() && failures > 0) {
      --failures;
      throw BackendError("planted");
    }
    inner_->download(to, from, bytes, offset);
  }
  void copy(Buffer to, Buffer from, std::size_t bytes) override
  {
    later_if_aside([this, to, from, bytes] { inner_->copy(to, from, bytes); });
  }
  void fill(Buffer buffer, unsigned char byte, std::size_t bytes) override
  {
    later_if_aside([this, buffer, byte, bytes] { inner_->fill(buffer, byte, bytes); });
  }
  void launch(const KernelKey &kernel, int n, const Argument *arguments, int count) override
  {
    std::vector<Argument> own(arguments, arguments + count);
    std::vector<double> scalars(own.size());
    for (std::size_t i = 0; i < own.size(); ++i)
      if (!own[i].is_buffer) std::memcpy(&scalars[i], own[i].scalar, own[i].size);
    const auto work = [this, kernel, n, own, scalars]() mutable {
      for (std::size_t i = 0; i < own.size(); ++i)
        if (!own[i].is_buffer) own[i].scalar = &scalars[i];
      inner_->launch(kernel, n, own.data(), static_cast<int>(own.size()));
    };
    if (side_by_side_)
      beside_.push_back(work);
    else
      later_if_aside(work);
  }
  void begin_side_by_side() override
  {
    REQUIRE_FALSE(side_by_side_);
    side_by_side_ = true;
  }
  void end_side_by_side() override
  {
    side_by_side_ = false;
    several += beside_.size() > 1;
    for (auto work = beside_.rbegin(); work != beside_.rend(); ++work) later_if_aside(*work);
    beside_.clear();
  }
  void fork() override
  {
    REQUIRE_FALSE(forked_);
    forked_ = true;
  }
  void begin_aside() override
  {
    REQUIRE(forked_);
    aside_ = true;
    ++asides;
  }
  void end_aside() override { aside_ = false; }
  void meet() noexcept override
  {
    forked_ = false;
    for (const auto &work : late_) work();
    late_.clear();
    for (Buffer buffer : released_) inner_->release(buffer);
    released_.clear();
  }
  void scan(Buffer from, Buffer to, int n) override
  {
    refuse_aside();
    inner_->scan(from, to, n);
  }
  void sort(Buffer keys, Buffer values, int n, int bits) override
  {
    refuse_aside();
    inner_->sort(keys, values, n, bits);
  }
  void synchronize() override
  {
    refuse_aside();
    inner_->synchronize();
  }

  int asides = 0, several = 0;  // work aside, and scopes with more than one launch
  int failures = 0;  // downloads that fail, while work aside has not been done

private:
  void later_if_aside(const std::function<void()> &work)
  {
    if (aside_ && order_ == Order::late)
      late_.push_back(work);
    else
      work();
  }
  void refuse_aside() const
  {
    if (aside_) throw std::logic_error("waits, scans and sorts have no place in work aside");
  }

  std::unique_ptr<Backend> inner_;
  Order order_;
  bool side_by_side_ = false, forked_ = false, aside_ = false;
  std::vector<std::function<void()>> beside_, late_;
  std::map<Buffer, std::size_t> bytes_;
  std::vector<Buffer> released_;
};

/// Fails as often as it is told.
class Overflow final : public StageOn<const StepReport> {
public:
  std::string_view name() const override { return "planted overflow"; }
  void run_on(const Rooms &) override
  {
    if (failures == 0) return;
    --failures;
    throw ListOverflow();
  }
  int failures = 0;
};

/// An engine whose step can fail between the search and the assembly.
struct Run : StagedEngine {
  Run(const Scene &scene, const Options &options, std::unique_ptr<Backend> backend)
      : StagedEngine(scene, options, std::move(backend))
  {
    auto stage = std::make_unique<Overflow>();
    overflow = stage.get();
    pipeline->insert_after("proximity checking", std::move(stage));
  }
  void step(int count = 1)
  {
    for (int i = 0; i < count; ++i) take([] {});
  }
  std::uint64_t hash() const
  {
    const std::size_t bytes = sizeof(dvec3) * static_cast<std::size_t>(state.mesh.cloth_vertices);
    return fnv1a(state.mesh.velocity.download().data(), bytes, fnv1a(state.mesh.position.download().data(), bytes));
  }
  Overflow *overflow;
};

std::map<std::string, Scene> scenes()
{
  std::map<std::string, Scene> all;
  all["sheet on ball"] = meshes::sheet_on_ball();
  all["pile"] = meshes::pile(12);  // so many vertices that the preconditioner has three levels
  all["no contact of cloth with itself"] = meshes::pile(6);
  all["no contact of cloth with itself"].contact.self = false;
  all["hanging in the wind"] = meshes::hanging(8);
  all["hanging in the wind"].wind = Wind{{1, 2, 0}, 1.2, 0.1};
  all["hanging in the wind"].cloths[0].material.damping = 0.003;
  all["limited strain"] = meshes::pile(6);
  all["limited strain"].cloths[0].material.strain_limit = 0.02;
  all["everything but yield"] = everything_scene::everything_of_paper(5);
  all["everything"] = everything_scene::everything(5);
  all["lands"] = meshes::sheet_on_ball();  // contacts appear
  for (dvec3 &x : all["lands"].cloths[0].mesh.position) x.z += 0.03;
  return all;
}

}  // namespace

TEST_CASE("steps give the same bits in every order of work aside and side by side", "[forks]")
{
  for (const auto &[name, scene] : scenes())
    for (const char *precision : {"double", "mixed"}) {
      INFO(name << ", " << precision);
      Options o = serial();
      o.precision = precision_of(precision);
      Run plain(scene, o, make_backend("cpu", 0, 1));
      plain.step(12);
      for (Order order : {Order::late, Order::at_once}) {
        auto owned = std::make_unique<Reordering>(order);
        const Reordering &backend = *owned;
        Run other(scene, o, std::move(owned));
        other.step(12);
        CHECK(other.hash() == plain.hash());
        CHECK(backend.asides >= 2 * 12);  // the fine factors of two solves; mostly elements and matrices as well
        CHECK(backend.several > 12);
      }
    }
}

TEST_CASE("steps that fail while there is work aside are undone and done again", "[forks]")
{
  const Scene scene = meshes::pile(6);
  Run plain(scene, serial(), make_backend("cpu", 0, 1));
  plain.step(4);
  plain.overflow->failures = 1;
  plain.step(3);
  for (Order order : {Order::late, Order::at_once}) {
    auto owned = std::make_unique<Reordering>(order);
    Reordering &backend = *owned;
    Run other(scene, serial(), std::move(owned));
    other.step(4);
    other.overflow->failures = 1;  // the step is divided
    other.step(2);
    if (order == Order::late) {
      const std::uint64_t before = other.hash();
      backend.failures = 1;
      CHECK_THROWS_AS(other.step(), BackendError);
      CHECK(backend.failures == 0);
      CHECK(other.hash() == before);
    }
    other.step();
    CHECK(other.hash() == plain.hash());
  }
}
