// Whether points can be a surface at all.
#pragma once

#include <cstddef>
#include <optional>
#include <string>

#include "toolkit/cloud/cloud.h"

namespace palpate::cloud {

/// A surface has a plane: three places that are not in one line.
inline constexpr std::size_t kFewestPlaces = 3;

/// Why the points are no surface, for a person ("its 1000 points stand in one place; ..."), or nothing where
/// they can be one. O(n), and O(n log n) where they cannot.
[[nodiscard]] std::optional<std::string> why_no_surface(const Cloud& cloud);

}  // namespace palpate::cloud
