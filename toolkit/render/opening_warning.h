// A warning about closed bodies with wide openings.
#pragma once

#include <optional>
#include <string>

namespace palpate::render {

/// Warns if a one-sided piece has holes so wide that a probe may be meant to enter through them
/// (geometry::kWideOpeningFraction). `min_enclosed` is 1 - geometry::opening_fraction() of the worst such
/// piece; 1 if none.
[[nodiscard]] std::optional<std::string> wide_mouth_warning(double min_enclosed);

}  // namespace palpate::render
