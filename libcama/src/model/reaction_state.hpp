// SPDX-License-Identifier: Apache-2.0
// Room of the state: what cloth exerts on what is prescribed.
#pragma once
#include "cama/stream.hpp"
#include "cama/types.hpp"
#include "model/life.hpp"

namespace cama {

/// Impulses, N s, and their moments about the origin, N m s, [vertices].
struct Impulses {
  Stream<dvec3> linear, angular;

  void fill_zero();
  void swap(Impulses &other) noexcept;
  /// this += share other
  void add(double share, const Impulses &other);
};

/// What the cloth gave to what is prescribed, with the option forces: each obstacle vertex, pinned and attached vertex.
/// A free vertex has the momentum that nothing else received: what the commit took from it against other cloth, and
/// what BDF2 does not carry on after a blow.
struct ReactionState {
  bool measured = false, carries = false;
  Impulses step;  // of the last step
  Impulses pieces;  // of the step that is computed: of its pieces up to now
  Impulses piece;  // of the piece that is computed
  Impulses smooth, smooth_next;  // with BDF2: of the solve alone, which it carries on, of the last step and of this
  Impulses interval;  // since the interval began
  double interval_time = 0;  // s
  Impulses push;  // of impacts, kg m, kg m^2
  Stream<dvec3> solved_velocity;  // [cloth vertices] m/s
  Stream<dvec3> contact;  // [contacts] on side A, N s
  double contact_time = 0;  // s, over which `contact` acted

  /// carried: by BDF2.
  void set_up(Backend &backend, int vertices, int cloth_vertices, bool carried);
  void begin_interval();
  void begin_step();
  /// `piece` has the impulses of the solve. memory: Clock::memory.
  void carry_on(double memory);
  /// The piece is complete.
  void accept_piece();
  /// The step is complete. time_step: s.
  void accept_step(double time_step);

  template <class F> void visit(F &&f)
  {
    const auto both = [&](const char *linear, const char *angular, Impulses &i, Life life = Life::step) {
      f(linear, life, i.linear);
      f(angular, life, i.angular);
    };
    both("reactions.step", "reactions.step_moment", step);
    both("reactions.pieces", "reactions.pieces_moment", pieces);
    both("reactions.piece", "reactions.piece_moment", piece);
    both("reactions.smooth", "reactions.smooth_moment", smooth, Life::run);
    both("reactions.smooth_next", "reactions.smooth_next_moment", smooth_next);
    both("reactions.interval", "reactions.interval_moment", interval);
    both("reactions.push", "reactions.push_moment", push);
    f("reactions.solved_velocity", Life::step, solved_velocity);
    f("reactions.contact", Life::step, contact);
  }
};

}  // namespace cama
