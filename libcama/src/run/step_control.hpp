// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>

#include "model/state.hpp"

namespace cama {

constexpr double longest_step = 0.1;  // s, that error control takes; a fixed one above it resolves no motion

/// The error that a text allows in a frame of 1/60 s, m: "1 mm", "0.002 m", or a share of the cloth's size, "0.1 %".
/// size: m. Throws SceneError.
double allowed_error(const std::string &text, double size);

/// The largest side of any cloth, m: of its bounding box at the start or in material space, whichever is smaller, but
/// in material space at least that of a square of its area.
double cloth_size(const Scene &scene);

/// The shortest step that error control takes for the error, s; error in metres, and the size of the cloth. An error of
/// second order asks for steps in proportion to its root, one of first order, as in contact, in proportion to it; where
/// it does not fall with them, this ends the search. 1 %: 5 steps in 1/60 s, 0.2 %: 12.5, 0.01 %: 250, and the nearest
/// whole number of them in a frame, s.
double shortest_step(double error, double size, double frame);

// Error control: time steps from an estimate of each step's error. Nothing of it where Clock::error is 0.

/// Sets the length and the end of the next step: at most Clock::wanted, whole steps filling the frame.
void choose_step(Clock &time);
/// Whether the step that was taken may stay, by Clock::step_error; sets Clock::wanted for the next one.
bool judge_step(Clock &time);
/// Whether the step that stays is one that would have been taken back, were it longer than the shortest.
bool over_error(const Clock &time);
/// Whether the present is the end of a frame.
bool ends_frame(const Clock &time);

}  // namespace cama
