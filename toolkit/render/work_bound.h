// How the words of Description::work_bound begin where a frame may miss its tick although it keeps its bound.
#pragma once

#include <string_view>

namespace palpate::render {

/// No bound is known.
inline constexpr std::string_view kUnbounded = "unbounded";
/// There is one, and its worst frame takes longer than 1 ms: how long, and of what, follows.
inline constexpr std::string_view kLongerThanATick = "longer than a tick at worst: ";

/// Whether a renderer says of itself that a frame may take longer than 1 ms.
[[nodiscard]] constexpr bool may_miss_a_tick(std::string_view work_bound) noexcept {
  return work_bound.starts_with(kUnbounded) || work_bound.starts_with(kLongerThanATick);
}

}  // namespace palpate::render
