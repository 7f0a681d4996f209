// When one renderer may take over from another under a hand, and how: the rules, as numbers and as pure
// functions of what is known in a frame. Lengths and speeds are the device's, not the scene's: a hand feels
// those.
//
//   free space   both without force and out of contact for 150 ms, and the HIP over 1 mm away from the last
//                place where either touched: one takes over from the other at once, nothing is felt.
//   in contact   the forces differ by less than min(1 N, a quarter of what the device can), both touch or
//                neither does, the hand is slower than 150 mm/s, none is saturated: a raised-cosine fade.
//   else         refused with the reason, or it waits for free space, by choice.
//
// The figures that these numbers rest on are those of docs/live.md: a fade of 20 to 50 ms moves the hand
// nearly as a hard switch does, since hand and device answer at some 10 Hz; 100 to 200 ms do not.
#pragma once

#include <cstdint>
#include <optional>

#include "toolkit/core/result.h"
#include "toolkit/core/vec.h"

namespace palpate::device {

/// What is done with a request that free space does not allow at once.
enum class SwitchRule : std::uint8_t {
  kFreeSpace,          ///< it waits for free space: studies
  kContactElseRefuse,  ///< a fade in contact where that is allowed, else it is refused
  kContactElseWait,    ///< a fade in contact where that is allowed, else it waits for free space
};

/// Why a switch is not done, or not yet.
enum class SwitchReason : std::uint8_t {
  kNone,
  kNotFree,         ///< waits: not long enough, or not far enough, away from the surface
  kBringingUp,      ///< waits: the other one does not yet know where the hand is
  kForcesDiffer,    ///< too far apart for a fade
  kContactDiffers,  ///< one touches and the other does not
  kTooFast,         ///< the hand
  kSaturated,       ///< one is at the limit of force: the difference is not known
  kHalfRate,        ///< the other one is stepped every second frame only
  kDisqualified,    ///< the other one missed its time, or answered what is no number
  kNoSuchRenderer,
  kAlreadyFelt,
  kFault,       ///< aborted: a fault, or a re-arming
  kOverridden,  ///< another request came
};
/// For people: "the forces are too far apart".
[[nodiscard]] const char* reason_text(SwitchReason reason) noexcept;

struct SwitchOptions {
  SwitchRule rule = SwitchRule::kContactElseWait;
  double device_force_max_n = 0.0;  ///< what the device can; above 0
  double force_limit_n = 0.0;       ///< of the governor: a force that reaches it is saturated; above 0
  double world_per_device = 1.0;    ///< mm of the scene for a mm of the device
  double period_s = 1e-3;           ///< of the servo

  /// No force: below the smallest step that a common device shows (kFeltForceStepN, 0.0275 N).
  double free_force_n = 0.02;
  /// Longer than a tap's way up and down: who is out for so long has left.
  double free_s = 0.15;
  /// From the last place of contact: a trembling hand moves by tenths of a millimetre.
  double clearance_mm = 1.0;
  /// After so long of waiting the hand is asked to lift off.
  double lift_off_s = 5.0;
  /// A hand of 0.25 N/mm on a wall of 0.8 N/mm gives way to 1 N by 1 mm: more is felt as being pushed.
  double difference_most_n = 1.0;
  double difference_share = 0.25;  ///< of device_force_max_n: small devices show less
  /// Within a fade of 150 ms such a hand goes 22 mm, over as much surface.
  double speed_most_mm_s = 150.0;
  /// Between 100 and 200 ms; also from 1 ms to 1 s for measurements.
  double fade_s = 0.15;
  /// Of the period: what all renderers may take together. The rest is for device, governor and jitter.
  double load_share = 0.6;
  /// Of the period: a frame that needs more with its standby does not fit.
  double budget_share = 0.9;
};
/// An Error names the number that is not right.
[[nodiscard]] Status check(const SwitchOptions& options);

/// By how much forces may differ for a fade, N.
[[nodiscard]] double difference_limit_n(const SwitchOptions& options) noexcept;

/// w(u) = (1 - cos(pi u)) / 2 for u from 0 to 1, 0 before and 1 after; its slope is at most pi/2. Without the
/// platform's cosine: the same bits everywhere, within 1e-15 of it.
[[nodiscard]] double raised_cosine(double u) noexcept;

/// How long a renderer has been free, and where it last touched.
class FreeWatch {
 public:
  void restart(double t_s) noexcept {
    quiet_since_s_ = t_s;
    touched_mm_.reset();
  }
  /// A frame at `t_s`.
  void observe(const Vec3& hip_mm, bool contact, double force_n, double t_s,
               const SwitchOptions& options) noexcept {
    // A force that is not a number is none that is small.
    if (!contact && force_n < options.free_force_n) return;
    quiet_since_s_ = t_s;
    touched_mm_ = hip_mm;
  }
  /// Nothing is known up to `t_s` of whether it touched.
  void disturb(double t_s) noexcept { quiet_since_s_ = t_s; }
  [[nodiscard]] bool is_free(const Vec3& hip_mm, double t_s, const SwitchOptions& options) const noexcept;

 private:
  double quiet_since_s_ = 0.0;
  std::optional<Vec3> touched_mm_;  ///< world frame
};

/// One of the two sides of a switch, in one frame.
struct SwitchSide {
  Vec3 force_n = Vec3::Zero();
  bool contact = false;
};
/// Whether the rule for contact allows a fade now; the reason where it does not. `speed_mm_s` of the device.
[[nodiscard]] SwitchReason fade_refusal(const SwitchSide& from, const SwitchSide& to, double speed_mm_s,
                                        const SwitchOptions& options) noexcept;

/// The speed of the hand, out of positions that go by encoder steps. Work: a few operations a frame.
class HandSpeed {
 public:
  void restart() noexcept {
    known_ = false;
    velocity_mm_s_.setZero();
  }
  void observe(const Vec3& hip_mm, double dt_s) noexcept;
  /// Of the scene's millimetres.
  [[nodiscard]] double mm_s() const noexcept { return velocity_mm_s_.norm(); }

 private:
  Vec3 last_mm_ = Vec3::Zero();
  Vec3 velocity_mm_s_ = Vec3::Zero();
  bool known_ = false;
};

}  // namespace palpate::device
