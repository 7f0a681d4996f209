// A hand's quarry as a scene file, and the stage that `palpate replay` makes of that.
#pragma once

#include <string>

#include "experiments/hunt/trial.h"

namespace palpate::experiments {

/// "key = value", one a line.
[[nodiscard]] std::string toml_lines(const Options& options);
/// The table [model.surface].
[[nodiscard]] std::string surface_toml(const Quarry& quarry);
/// The model of a hand's quarry, to be generated, with its surface.
[[nodiscard]] Result<std::string> hand_scene_toml(const Quarry& quarry);

/// The path of quarry.hand on the exact shape, and the truth along it. Both end where the true god object
/// comes near the border of an open surface: there the points end and the formula goes on. An Error where
/// the shape is too fine for its points or for the press, or the hand is soon at a border: nothing to be
/// judged by.
[[nodiscard]] Result<HuntScene> make_hand_scene(const Quarry& quarry);

}  // namespace palpate::experiments
