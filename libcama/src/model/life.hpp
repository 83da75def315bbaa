// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace cama {

/// How long a stream or a number lives. scene: unchanged since the scene was set up; run: kept from step to step, so
/// that a step that fails restores it and a checkpoint holds it (vectors of all vertices or triangles, and numbers);
/// step: computed in every step.
enum class Life { scene, run, step };

}  // namespace cama
