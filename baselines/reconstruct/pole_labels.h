// The power crust's second step: which polar balls are inside the surface (Amenta, Choi and Kolluri 2001).
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace palpate::baselines {

/// Two poles that say something about each other, with how sure, in (0, 1].
struct PoleLink {
  std::uint32_t a = 0, b = 0;
  float confidence = 0.0F;
  bool opposite = false;  ///< of one sample, on either side of the surface; else balls that overlap deeply
};

/// Whether each of `poles` poles is inside. `outside` are known to be outside; from them labels spread along
/// the links, the most confident first, a pole's own confidence dimming what it passes on. What no label
/// reaches is outside. O(links log links), the same on every run.
[[nodiscard]] std::vector<bool> label_poles(std::size_t poles, std::span<const PoleLink> links,
                                            std::span<const std::uint32_t> outside);

}  // namespace palpate::baselines
