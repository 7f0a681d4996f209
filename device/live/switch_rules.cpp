#include "device/live/switch_rules.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <string>

namespace palpate::device {
namespace {

// At 1 kHz one encoder step of 0.055 mm looks like 55 mm/s; averaged over 10 ms it is 5, and a hand's speed
// changes more slowly.
constexpr double kSpeedMemoryS = 0.01;
// Shorter is no fade at 1 kHz; nobody waits longer than a second.
constexpr double kShortestFadeS = 1e-3, kLongestFadeS = 1.0;
// Terms of the sine series for arguments up to pi/4: the next is below (pi/4)^19 / 19! = 1e-19.
constexpr int kSineTerms = 9;

}  // namespace

const char* reason_text(SwitchReason reason) noexcept {
  constexpr std::array kTexts = {"",
                                 "waiting for free space: lift off",
                                 "the other renderer is being brought to the hand",
                                 "the forces are too far apart",
                                 "one renderer touches and the other does not",
                                 "the hand is too fast",
                                 "a force is at its limit",
                                 "the renderers together are too slow for a switch in contact",
                                 "the other renderer is disqualified",
                                 "there is no such renderer",
                                 "it is felt already",
                                 "a fault, or a re-arming",
                                 "another request came"};
  static_assert(kTexts.size() == static_cast<std::size_t>(SwitchReason::kOverridden) + 1);
  const auto at = static_cast<std::size_t>(reason);
  return at < kTexts.size() ? kTexts[at] : "unknown";
}

Status check(const SwitchOptions& options) {
  struct Named {
    const char* name;
    double value, least, most;
  };
  constexpr double kAnything = 1e9;
  const auto numbers = std::to_array<Named>({
      {"the device's force", options.device_force_max_n, 0.0, kAnything},
      {"force_limit_n", options.force_limit_n, 0.0, kAnything},
      {"world_per_device", options.world_per_device, 0.0, kAnything},
      {"period_s", options.period_s, 0.0, 1.0},
      {"free_force_n", options.free_force_n, 0.0, kAnything},
      {"free_s", options.free_s, 0.0, kAnything},
      {"clearance_mm", options.clearance_mm, 0.0, kAnything},
      {"lift_off_s", options.lift_off_s, 0.0, kAnything},
      {"difference_most_n", options.difference_most_n, 0.0, kAnything},
      {"difference_share", options.difference_share, 0.0, 1.0},
      {"speed_most_mm_s", options.speed_most_mm_s, 0.0, kAnything},
      {"fade_s", options.fade_s, kShortestFadeS, kLongestFadeS},
      {"load_share", options.load_share, 0.0, 1.0},
      {"budget_share", options.budget_share, 0.0, 1.0},
  });
  for (const Named& one : numbers) {
    if (one.value > 0.0 && one.value >= one.least && one.value <= one.most) continue;
    return Error{std::string(one.name) + " is " + std::to_string(one.value),
                 one.least > 0.0 ? "give " + std::to_string(one.least) + " to " + std::to_string(one.most)
                                 : "give a number above 0, at most " + std::to_string(one.most)};
  }
  return Done{};
}

double difference_limit_n(const SwitchOptions& options) noexcept {
  return std::min(options.difference_most_n, options.difference_share * options.device_force_max_n);
}

double raised_cosine(double u) noexcept {
  if (!(u > 0.0)) return 0.0;
  if (u >= 1.0) return 1.0;
  // (1 - cos(pi u)) / 2 = sin^2(pi u / 2); beyond the middle 1 - w(1 - u), so arguments stay below pi/4 and
  // both ends are equally exact.
  const bool second_half = u > 0.5;
  const double x = 0.5 * std::numbers::pi * (second_half ? 1.0 - u : u);
  double sine = 0.0, term = x;
  for (int k = 1; k <= kSineTerms; ++k) {
    sine += term;
    term *= -x * x / static_cast<double>((2 * k) * (2 * k + 1));
  }
  return second_half ? 1.0 - sine * sine : sine * sine;
}

bool FreeWatch::is_free(const Vec3& hip_mm, double t_s, const SwitchOptions& options) const noexcept {
  if (t_s - quiet_since_s_ < options.free_s) return false;
  if (!touched_mm_) return true;
  return (hip_mm - *touched_mm_).norm() > options.clearance_mm * options.world_per_device;
}

SwitchReason fade_refusal(const SwitchSide& from, const SwitchSide& to, double speed_mm_s,
                          const SwitchOptions& options) noexcept {
  if (from.contact != to.contact) return SwitchReason::kContactDiffers;
  if (!(from.force_n.norm() < options.force_limit_n) || !(to.force_n.norm() < options.force_limit_n))
    return SwitchReason::kSaturated;
  if (!((from.force_n - to.force_n).norm() < difference_limit_n(options))) return SwitchReason::kForcesDiffer;
  if (!(speed_mm_s < options.speed_most_mm_s)) return SwitchReason::kTooFast;
  return SwitchReason::kNone;
}

void HandSpeed::observe(const Vec3& hip_mm, double dt_s) noexcept {
  if (known_ && dt_s > 0.0) {
    const double share = dt_s < kSpeedMemoryS ? dt_s / kSpeedMemoryS : 1.0;
    velocity_mm_s_ += share * ((hip_mm - last_mm_) / dt_s - velocity_mm_s_);
  }
  last_mm_ = hip_mm;
  known_ = true;
}

}  // namespace palpate::device
