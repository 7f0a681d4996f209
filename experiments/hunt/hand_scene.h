// A hand's quarry as a scene file, and its stage.
#pragma once

#include <string>

#include "experiments/hunt/trial.h"

namespace palpate::experiments {

/// "key = value" lines.
[[nodiscard]] std::string toml_lines(const Options& options);
/// The table [model.surface].
[[nodiscard]] std::string surface_toml(const Quarry& quarry);
/// The generated model of a hand's quarry, with its surface.
[[nodiscard]] Result<std::string> hand_scene_toml(const Quarry& quarry);

/// The path of quarry.hand on the exact shape with its truth. Both end where the true god object nears an
/// open surface's border, beyond which only the formula continues. Error: a shape too fine for its points or
/// the press, or a hand soon at a border.
[[nodiscard]] Result<HuntScene> make_hand_scene(const Quarry& quarry);

}  // namespace palpate::experiments
