// First words of Description::work_bound for renderers whose frames may miss a tick within their bound.
#pragma once

#include <string_view>

namespace palpate::render {

/// No bound is known.
inline constexpr std::string_view kUnbounded = "unbounded";
/// The worst frame within the bound takes longer than 1 ms; its time and cause follow.
inline constexpr std::string_view kLongerThanATick = "longer than a tick at worst: ";

/// True if a renderer declares that a frame may take longer than 1 ms.
[[nodiscard]] constexpr bool may_miss_a_tick(std::string_view work_bound) noexcept {
  return work_bound.starts_with(kUnbounded) || work_bound.starts_with(kLongerThanATick);
}

}  // namespace palpate::render
