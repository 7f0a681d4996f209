// What is said of a body with a wide mouth.
#pragma once

#include <optional>
#include <string>

namespace palpate::render {

/// A warning where a piece that is felt from one side has holes so wide that a probe may be meant to go in
/// through them (geometry::kWideMouthShare). `least_enclosed`: 1 less the geometry::mouth_share() of the
/// worst such piece, 1 where there is none.
[[nodiscard]] std::optional<std::string> wide_mouth_warning(double least_enclosed);

}  // namespace palpate::render
