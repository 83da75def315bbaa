// SPDX-License-Identifier: Apache-2.0
#include "run/pipeline_factory.hpp"

#include <algorithm>

#include "stages/candidate_search.hpp"
#include "stages/find_contacts.hpp"
#include "stages/finish_step.hpp"
#include "stages/front_search.hpp"
#include "stages/linear_solve.hpp"
#include "stages/matrix_assembly.hpp"
#include "stages/newton.hpp"
#include "stages/penetration_handling.hpp"

namespace cama {
namespace {

constexpr double certified_distance = 1e-2;   // of the smallest contact thickness of a pair
constexpr double impact_distance = 0.1;       // the same after an impact

/// Fronts are of triangles: exact obstacles are searched by trees.
std::unique_ptr<CandidateSearch> make_search(const Scene &scene, State &state, FlaggedPairs &flagged)
{
  const bool exact = std::any_of(scene.obstacles.begin(), scene.obstacles.end(),
                                 [](const Obstacle &o) { return o.shape != ObstacleShape::mesh; });
  if (state.options.search == SearchKind::fronts && !exact) return std::make_unique<FrontSearch>(state);
  return std::make_unique<TreeSearch>(*state.backend, flagged);
}

/// Proximity checking owns the search and the flags that penetration handling uses again.
class ProximityChecking final : public Pipeline {
public:
  ProximityChecking(const Scene &scene, State &state)
      : Pipeline("proximity checking", "contact"), flagged(*state.backend), search(make_search(scene, state, flagged))
  {
    add<ProximitySearch>(*search);
    add<FindContacts>(*state.backend, flagged);
  }
  FlaggedPairs flagged;
  std::unique_ptr<CandidateSearch> search;
};

bool needs_motion(const Scene &scene)
{
  return !scene.pins.empty() || std::any_of(scene.obstacles.begin(), scene.obstacles.end(),
                                            [](const Obstacle &o) { return !o.motion.is_static(); });
}

}  // namespace

template <class Real> StepPipeline make_pipeline(const Scene &scene, State &state)
{
  Backend &b = *state.backend;
  StepPipeline result{std::make_unique<Pipeline>("step"), nullptr};
  Pipeline &step = *result.step;
  const bool contact = scene.has_contact();
  ProximityChecking *proximity = nullptr;
  if (state.options.integrator == Integrator::bdf2) step.add<Extrapolate>();
  if (needs_motion(scene)) result.motion = &step.add<PrescribedMotion>(scene, state);
  if (contact) proximity = &step.add<ProximityChecking>(scene, state);
  Pipeline &assembly = step.add<Pipeline>("matrix assembly");
  EvaluateElements<Real> &elements = assembly.add<EvaluateElements<Real>>(scene);
  if (contact || state.stitches) assembly.add<EvaluateTerms<Real>>(b);
  AssembleMatrix<Real> &matrix = assembly.add<AssembleMatrix<Real>>(b);
  LinearSolve<Real> &solve = step.add<LinearSolve<Real>>(b);
  step.add<AdvancePositions>();
  if (state.options.newton_iterations > 1) step.add<NewtonIterations<Real>>(scene, b, elements, matrix, solve);
  if (contact)
    step.add<PenetrationHandling>(b, *proximity->search, proximity->flagged)
        .set_distances(certified_distance, impact_distance);
  step.add<FinishStep>(b);
  if (contact && (state.options.intersections == StartPolicy::exempt || state.options.pinch == Pinch::release))
    step.add<ForgetSeparated>();
  return result;
}

template StepPipeline make_pipeline<double>(const Scene &, State &);
template StepPipeline make_pipeline<float>(const Scene &, State &);

}  // namespace cama
