// SPDX-License-Identifier: Apache-2.0
#include "run/pipeline_factory.hpp"

#include <algorithm>
#include <optional>
#include <utility>

#include "stages/abrupt_contact.hpp"
#include "stages/advance_positions.hpp"
#include "stages/body_contacts.hpp"
#include "stages/contact_terms.hpp"
#include "stages/element_forces.hpp"
#include "stages/estimate_error.hpp"
#include "stages/extrapolate.hpp"
#include "stages/find_contacts.hpp"
#include "stages/finish_step.hpp"
#include "stages/forget_separated.hpp"
#include "stages/front_search.hpp"
#include "stages/keep_friction.hpp"
#include "stages/linear_solve.hpp"
#include "stages/matrix_assembly.hpp"
#include "stages/newton.hpp"
#include "stages/penetration_handling.hpp"
#include "stages/plastic_bending.hpp"
#include "stages/prescribed_motion.hpp"
#include "stages/proximity_search.hpp"
#include "stages/reactions.hpp"
#include "stages/rigid_bodies.hpp"
#include "stages/tree_search.hpp"

namespace cama {
namespace {

/// Fronts hold triangles only: exact obstacles need trees. A search owns its room of the state.
std::unique_ptr<CandidateSearch> make_search(const Scene &scene, State &state, ListedPairs &listed)
{
  const bool exact = std::any_of(scene.obstacles.begin(), scene.obstacles.end(),
                                 [](const Obstacle &o) { return o.shape != ObstacleShape::mesh; });
  if (state.options.paper.search == SearchKind::fronts && !exact) {
    auto search = std::make_unique<FrontSearch>(state);
    state.fronts = &search->streams();
    return search;
  }
  auto search = std::make_unique<TreeSearch>(*state.backend, listed);
  state.trees = &search->streams();
  return search;
}

/// Work that needs no contacts, for the device while it searches for pairs.
class EarlyWork {
public:
  virtual ~EarlyWork() = default;
  virtual void begin(State &state, Fork &fork) = 0;
  virtual void forget() = 0;  ///< what was begun for an attempt at a step that failed
};

/// Proximity checking owns the search, the flags and the bounds, which penetration handling uses as well.
class ProximityChecking final : public Pipeline {
public:
  ProximityChecking(const Scene &scene, State &state)
      : Pipeline("proximity checking", "contact"), listed(*state.backend), bounds(*state.backend, listed),
        search(make_search(scene, state, listed))
  {
    add<ProximitySearch>(*search);
    add<FindContacts>(*state.backend, listed, bounds);
  }
  void run(State &state) override
  {
    search->meanwhile = nullptr;
    if (early) {
      early->forget();
      search->meanwhile = [&](Fork &fork) { early->begin(state, fork); };
    }
    Pipeline::run(state);
    search->meanwhile = nullptr;
  }
  ListedPairs listed;
  GapBounds bounds;
  std::unique_ptr<CandidateSearch> search;
  EarlyWork *early = nullptr;
};

/// Elements, terms and the matrix. Where terms need only the forces at the start of the step, the device may work on
/// elements and matrix aside: while it searches for pairs, or else while it makes the terms.
template <class Real> class MatrixAssembly final : public Pipeline, public EarlyWork {
public:
  MatrixAssembly(const Scene &scene, Backend &b, bool has_terms)
      : Pipeline("matrix assembly"), elements(add<EvaluateElements<Real>>(scene)),
        terms(has_terms ? &add<EvaluateTerms<Real>>(b) : nullptr), matrix(add<AssembleMatrix<Real>>(b)), prediction_(b)
  {}
  void begin(State &state, Fork &fork) override
  {
    began_ = separable(state);
    began_with_start_ = had_contacts_;
    if (!began_) return;
    fork.aside([&] {
      prediction_.run(state);
      elements.timed(state, [&] {
        if (began_with_start_) elements.begin(state);
        elements.finish(state);
      });
      matrix.timed_run(state);
    });
  }
  void forget() override { began_ = false; }
  void run(State &state) override
  {
    had_contacts_ = state.contact.contacts > 0;
    const bool done = std::exchange(began_, false) && (began_with_start_ || !had_contacts_);
    if (!terms || !(done || separable(state))) return Pipeline::run(state);
    if (done) return terms->timed_run(state);
    std::optional<Fork> fork;
    elements.timed(state, [&] {
      if (had_contacts_) elements.begin(state);
      fork.emplace(*state.backend);
      fork->aside([&] { elements.finish(state); });
    });
    fork->aside([&] { matrix.timed_run(state); });
    terms->timed_run(state);
  }
  EvaluateElements<Real> &elements;
  EvaluateTerms<Real> *terms;
  AssembleMatrix<Real> &matrix;

private:
  bool separable(const State &state) const
  {
    return state.backend->forks() && state.time.predicted && !state.wait_for_stages &&
           matrix.independent(state.options);
  }
  PredictState prediction_;
  bool had_contacts_ = false;  // in the step before: most likely there will be some
  bool began_ = false, began_with_start_ = false;
};

}  // namespace

bool needs_motion(const Scene &scene)
{
  return !scene.pins.empty() ||
         std::any_of(scene.obstacles.begin(), scene.obstacles.end(), [](const Obstacle &o) { return !o.is_static(); });
}

template <class Real> std::unique_ptr<Pipeline> make_pipeline(const Scene &scene, State &state)
{
  Backend &b = *state.backend;
  const Options &options = state.options;
  auto result = std::make_unique<Pipeline>("step");
  Pipeline &step = *result;
  const bool contact = scene.has_contact();
  ProximityChecking *proximity = nullptr;
  if (options.integrator == Integrator::bdf2) step.add<Extrapolate>();
  const bool rigid = !state.rigid.body.empty();
  std::shared_ptr<BodyContacts> touching;
  if (BodyContacts::needed(scene))
    touching = std::make_shared<BodyContacts>(scene, state.mesh, options.intersections == StartPolicy::exempt);
  if (rigid) step.add<PredictBodies>(touching);
  PrescribedMotion *motion = needs_motion(scene) ? &step.add<PrescribedMotion>(scene, b) : nullptr;
  if (touching) touching->follow(*motion);
  if (contact) proximity = &step.add<ProximityChecking>(scene, state);
  CoupleBodies<Real> *coupling = rigid ? &step.add<CoupleBodies<Real>>(b, *motion, touching) : nullptr;
  Pipeline &solving = coupling ? *coupling : step;
  if (options.integrator == Integrator::bdf2) solving.add<PredictState>(b);
  const bool plastic = state.elements.plastic_curvature.size() > 0;
  if (plastic) solving.add<FollowCurvature<Real>>();
  auto &assembly = solving.add<MatrixAssembly<Real>>(scene, b, contact || state.elements.stitches);
  LinearSolve<Real> &solve = solving.add<LinearSolve<Real>>(b);
  solving.add<AdvancePositions>();
  if (proximity && !coupling && !plastic) proximity->early = &assembly;
  if (options.newton_iterations > 1)
    solving.add<NewtonIterations<Real>>(b, assembly.elements, assembly.matrix, solve, state.system.masses());
  if (contact && options.integrator == Integrator::bdf2) step.add<SplitContact<Real>>(b);
  if (state.contact.kept.key.backend()) step.add<KeepFriction<Real>>();
  if (options.forces) step.add<SolveReactions<Real>>(b);
  if (contact) step.add<PenetrationHandling>(b, *proximity->search, proximity->listed, proximity->bounds);
  if (plastic) step.add<YieldCurvature<Real>>();
  step.add<FinishStep>(b);
  if (state.time.error > 0) step.add<EstimateError>(b, scene, state.mesh, state.system.masses());
  if (options.forces) step.add<ImpactReactions>(b);
  if (coupling) step.add<FinishBodies>(b, coupling->sums, touching);
  if (contact && (options.intersections == StartPolicy::exempt || options.pinch == Pinch::release))
    step.add<ForgetSeparated>();
  return result;
}

template std::unique_ptr<Pipeline> make_pipeline<double>(const Scene &, State &);
template std::unique_ptr<Pipeline> make_pipeline<float>(const Scene &, State &);

}  // namespace cama
