// SPDX-License-Identifier: Apache-2.0
#include "pipeline_factory.hpp"

#include <algorithm>

#include "stages/candidate_search.hpp"
#include "stages/find_contacts.hpp"
#include "stages/finish_step.hpp"
#include "stages/front_search.hpp"
#include "stages/linear_solve.hpp"
#include "stages/matrix_assembly.hpp"
#include "stages/penetration_handling.hpp"

namespace cama {
namespace {

constexpr double certified_distance = 1e-2;   // of the smallest contact thickness
constexpr double impact_distance = 0.1;       // of the smallest contact thickness, after an impact

std::unique_ptr<CandidateSearch> make_search(State &state)
{
  if (state.options.search == SearchKind::fronts) return std::make_unique<FrontSearch>(state);
  return std::make_unique<TreeSearch>(*state.backend);
}

/// Proximity checking owns the search that penetration handling uses again.
class ProximityChecking final : public Pipeline {
public:
  explicit ProximityChecking(State &state) : Pipeline("proximity checking", "contact"), search(make_search(state))
  {
    add<ProximitySearch>(*search);
    add<FindContacts>(*state.backend);
  }
  std::unique_ptr<CandidateSearch> search;
};

bool needs_motion(const Scene &scene)
{
  return !scene.pins.empty() ||
         std::any_of(scene.obstacles.begin(), scene.obstacles.end(), [](const Obstacle &o) { return !o.motion.is_static(); });
}

}  // namespace

template <class Real> StepPipeline make_pipeline(const Scene &scene, State &state)
{
  Backend &b = *state.backend;
  StepPipeline result{std::make_unique<Pipeline>("step"), nullptr};
  Pipeline &step = *result.step;
  const bool contact = scene.has_contact();
  ProximityChecking *proximity = nullptr;
  if (needs_motion(scene)) result.motion = &step.add<PrescribedMotion>(scene, state);
  if (contact) proximity = &step.add<ProximityChecking>(state);
  Pipeline &assembly = step.add<Pipeline>("matrix assembly");
  assembly.add<EvaluateElements<Real>>(scene);
  if (contact || state.stitches) assembly.add<EvaluateTerms<Real>>(b);
  assembly.add<AssembleMatrix<Real>>(b);
  step.add<LinearSolve<Real>>(b);
  step.add<AdvancePositions>();
  if (contact)
    step.add<PenetrationHandling>(b, *proximity->search)
        .set_distances(certified_distance * state.least_thickness, impact_distance * state.least_thickness);
  step.add<FinishStep>(b);
  if (contact && (state.options.intersections == Intersections::exempt || state.options.pinch == Pinch::release)) step.add<ForgetSeparated>();
  return result;
}

template StepPipeline make_pipeline<double>(const Scene &, State &);
template StepPipeline make_pipeline<float>(const Scene &, State &);

}  // namespace cama
