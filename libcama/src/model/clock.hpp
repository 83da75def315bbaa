// SPDX-License-Identifier: Apache-2.0
// Room of the state: time.
#pragma once
#include "model/life.hpp"

namespace cama {

constexpr int most_smoothed_steps = 31;  // the step itself and thirty after it

/// The times of a step, s.
struct Clock {
  double now = 0;  // at the start of the step; at its end from FinishStep on
  double step = 0;  // the time step
  double start = 0;  // now = start + (number of the step - start_step) step
  int start_step = 0;
  int division = 0;  // a failed step is done in pieces; this one is 1/2^division of it
  double implicit_step = 0;  // h of v = v* + h M^-1 f(x* + h v): step, or a share of it with a history
  bool predicted = false;  // BDF2: the step is linearised at a predicted state, otherwise at its base
  bool multistep = false;  // BDF2: this step uses the previous state
  bool history = false;  // BDF2: the next step may use this one
  double step_before = 0;  // BDF2: time step of the last step
  double memory = 0;  // BDF2: share of the last change of the state that the base of this step carries on
  double ratio = 0;  // BDF2: of the step to the last one
  int smoothed_steps = 0;  // BDF2: coming steps whose prediction is smoothed
  // Error control; 0 without it.
  double error = 0;  // m in a frame of 1/60 s
  double frame = 0;  // s, which whole steps fill
  double shortest = 0, longest = 0;  // s, of a step
  double end = 0;  // s, of the step
  double step_error = 0;  // m, of the step: an estimate
  double wanted = 0;  // s, longest next step
  double last_share = 0;  // of the error that was allowed in the last step
  int stretched = 0;  // edges of cloth that the step makes much longer
  double crowding = 0;  // candidates of the step over those from which it is too long, where cloth moves far
  double max_by_stretch = 0;  // s, longest next step after one was too long for edges; 0: none was

  template <class F> void visit(F &&f)
  {
    f("time", Life::run, now);
    f("time_step", Life::scene, step);
    f("start_time", Life::run, start);
    f("start_step", Life::run, start_step);
    f("division", Life::step, division);
    f("implicit_step", Life::step, implicit_step);
    f("predicted", Life::scene, predicted);
    f("multistep", Life::step, multistep);
    f("history", Life::run, history);
    f("step_before", Life::run, step_before);
    f("memory", Life::step, memory);
    f("ratio", Life::step, ratio);
    f("smoothed_steps", Life::run, smoothed_steps);
    f("error", Life::scene, error);
    f("frame", Life::scene, frame);
    f("shortest_step", Life::scene, shortest);
    f("longest_step", Life::scene, longest);
    f("step_end", Life::step, end);
    f("step_error", Life::step, step_error);
    f("wanted_step", Life::run, wanted);
    f("last_share", Life::run, last_share);
    f("stretched", Life::step, stretched);
    f("crowding", Life::step, crowding);
    f("max_step_by_stretch", Life::run, max_by_stretch);
  }
};

}  // namespace cama
