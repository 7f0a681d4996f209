// Rules of switching renderers under a hand. They are numbers and pure functions of a frame's data. Lengths
// and speeds are the device's, which the hand feels.
//
//   free space   both without force and contact for 150 ms, and the HIP over 1 mm from the last contact of
//                either: an immediate swap that is not felt.
//   in contact   forces differ by less than min(1 N, a quarter of the device's), both or neither touch,
//                the hand is slower than 150 mm/s, none is saturated: a raised-cosine fade.
//   else         refused with the reason, or waits for free space, by option.
//
// The numbers rest on docs/results/hands-and-loops.md: fades of 20 to 50 ms move the hand nearly like a hard
// switch, because hand and device respond at about 10 Hz; 100 to 200 ms do not.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <optional>

#include <palpate/result.h>
#include <palpate/vec.h>

namespace palpate::device {

// Requests to a mixer from any thread: a lock-free single slot in which the newest request replaces an
// untaken one.

/// The origin of a request.
enum class SwitchSource : std::uint8_t { kProgram, kKey, kButton, kTimer, kParameters };
[[nodiscard]] constexpr const char* source_text(SwitchSource source) noexcept {
  constexpr std::array kTexts = {"program", "key", "button", "timer", "parameters"};
  static_assert(kTexts.size() == static_cast<std::size_t>(SwitchSource::kParameters) + 1);
  const auto at = static_cast<std::size_t>(source);
  return at < kTexts.size() ? kTexts[at] : "unknown";
}

struct SwitchRequest {
  enum class Kind : std::uint8_t {
    kNone,
    kSelect,  ///< the renderer of this lane
    kNext,    ///< the lane after the felt one
    kCancel,  ///< cancels waiting; a fade continues to its end
  };
  Kind kind = Kind::kNone;
  SwitchSource source = SwitchSource::kProgram;
  std::uint8_t lane = 0;  ///< of kSelect

  [[nodiscard]] bool operator==(const SwitchRequest&) const = default;
};

/// Any threads post, one takes. Wait-free both.
class RequestSlot {
 public:
  void post(const SwitchRequest& request) noexcept {
    // Release: who acts on the request sees what the poster did before.
    slot_.store(packed(request), std::memory_order_release);
  }
  /// Takes the request and empties the slot; kNone if empty.
  [[nodiscard]] SwitchRequest take() noexcept {
    return unpacked(slot_.exchange(0, std::memory_order_acquire));
  }
  /// Reads without taking.
  [[nodiscard]] SwitchRequest peek() const noexcept {
    return unpacked(slot_.load(std::memory_order_acquire));
  }

 private:
  static constexpr unsigned kSourceShift = 8, kLaneShift = 16;
  static constexpr std::uint32_t kByte = 0xff;
  static constexpr std::uint32_t packed(const SwitchRequest& r) noexcept {
    return static_cast<std::uint32_t>(r.kind) | static_cast<std::uint32_t>(r.source) << kSourceShift |
           static_cast<std::uint32_t>(r.lane) << kLaneShift;
  }
  static constexpr SwitchRequest unpacked(std::uint32_t bits) noexcept {
    return {static_cast<SwitchRequest::Kind>(bits & kByte),
            static_cast<SwitchSource>(bits >> kSourceShift & kByte),
            static_cast<std::uint8_t>(bits >> kLaneShift & kByte)};
  }
  std::atomic<std::uint32_t> slot_{0};
  static_assert(std::atomic<std::uint32_t>::is_always_lock_free);
};

/// Handling of a request while not in free space.
enum class SwitchRule : std::uint8_t {
  kFreeSpace,          ///< waits for free space: for studies
  kContactElseRefuse,  ///< fades in contact if allowed, else refuses
  kContactElseWait,    ///< fades in contact if allowed, else waits for free space
};

/// The reason why a switch is not done, or not yet.
enum class SwitchReason : std::uint8_t {
  kNone,
  kNotFree,         ///< waits: too short a time or distance from the surface
  kBringingUp,      ///< waits: the other one is still brought up
  kForcesDiffer,    ///< too different for a fade
  kContactDiffers,  ///< one touches and the other does not
  kTooFast,         ///< the hand
  kSaturated,       ///< one is at the force limit: the difference is unknown
  kHalfRate,        ///< the other one is stepped every second frame
  kDisqualified,    ///< the other one was too slow, or gave a NaN force
  kNoSuchRenderer,
  kAlreadyFelt,
  kFault,       ///< aborted: a fault or re-arming
  kOverridden,  ///< another request came
};
/// For the user: "the forces are too far apart".
[[nodiscard]] const char* reason_text(SwitchReason reason) noexcept;

struct SwitchOptions {
  SwitchRule rule = SwitchRule::kContactElseWait;
  double device_force_max_n = 0.0;  ///< of the device; above 0
  double force_limit_n = 0.0;       ///< of the governor; a force that reaches it is saturated; above 0
  double world_per_device = 1.0;    ///< mm of the scene for a mm of the device
  double period_s = 1e-3;           ///< of the servo

  /// Below this there is no force: under the smallest step of a common device (kPerceptibleForceStepN, 0.0275
  /// N).
  double free_force_n = 0.02;
  /// Longer than between taps: free for this long means it has left.
  double free_s = 0.15;
  /// From the last contact; a trembling hand moves by tenths of a millimetre.
  double clearance_mm = 1.0;
  /// Waiting time after which the hand is asked to lift off.
  double lift_off_s = 5.0;
  /// A hand of 0.25 N/mm on a wall of 0.8 N/mm yields to 1 N by 1 mm; more feels like a push.
  double difference_most_n = 1.0;
  double difference_share = 0.25;  ///< of device_force_max_n, for small devices
  /// In a fade of 150 ms such a hand moves 22 mm along the surface.
  double speed_most_mm_s = 150.0;
  /// 100 to 200 ms; 1 ms to 1 s for measurements.
  double fade_s = 0.15;
  /// Of the period: limit for all renderers together; the rest is for device, governor and jitter.
  double load_share = 0.6;
  /// Of the period: a frame that needs more with its standby does not fit.
  double budget_share = 0.9;
};
/// An Error names the invalid number.
[[nodiscard]] Status check(const SwitchOptions& options);

/// Largest difference of forces for a fade, N.
[[nodiscard]] double difference_limit_n(const SwitchOptions& options) noexcept;

/// w(u) = (1 - cos(pi u)) / 2 for u in [0, 1], 0 before and 1 after; slope at most pi/2. Own cosine:
/// bit-identical everywhere, within 1e-15.
[[nodiscard]] double raised_cosine(double u) noexcept;

/// Measures the time that a renderer has been free, and keeps its last contact.
class FreeWatch {
 public:
  void restart(double t_s) noexcept {
    quiet_since_s_ = t_s;
    touched_mm_.reset();
  }
  /// A frame at `t_s`.
  void observe(const Vec3& hip_mm, bool contact, double force_n, double t_s,
               const SwitchOptions& options) noexcept {
    // A NaN force counts as force.
    if (!contact && force_n < options.free_force_n) return;
    quiet_since_s_ = t_s;
    touched_mm_ = hip_mm;
  }
  /// Contact is unknown up to `t_s`.
  void disturb(double t_s) noexcept { quiet_since_s_ = t_s; }
  [[nodiscard]] bool is_free(const Vec3& hip_mm, double t_s, const SwitchOptions& options) const noexcept;

 private:
  double quiet_since_s_ = 0.0;
  std::optional<Vec3> touched_mm_;  ///< world frame
};

/// One side of a switch in a frame.
struct SwitchSide {
  Vec3 force_n = Vec3::Zero();
  bool contact = false;
};
/// The reason why the contact rule forbids a fade now, if it does. `speed_mm_s` of the device.
[[nodiscard]] SwitchReason fade_refusal(const SwitchSide& from, const SwitchSide& to, double speed_mm_s,
                                        const SwitchOptions& options) noexcept;

/// Hand speed from positions quantised by encoder steps. A few operations a frame.
class HandSpeed {
 public:
  void restart() noexcept {
    known_ = false;
    velocity_mm_s_.setZero();
  }
  void observe(const Vec3& hip_mm, double dt_s) noexcept;
  /// In the scene's millimetres.
  [[nodiscard]] double mm_s() const noexcept { return velocity_mm_s_.norm(); }

 private:
  Vec3 last_mm_ = Vec3::Zero();
  Vec3 velocity_mm_s_ = Vec3::Zero();
  bool known_ = false;
};

}  // namespace palpate::device
