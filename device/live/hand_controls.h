// Controls of a hand: clutch, buttons, place of the scene. The clutch moves the scene in the device's
// workspace; buttons switch renderers and hold the clutch.
#pragma once

#include <cstdint>

#include <palpate/device/device.h>
#include <palpate/device/servo.h>
#include <palpate/geometry.h>
#include <palpate/result.h>
#include "device/live/mixer.h"

namespace palpate::device {

enum class WorkspaceFit : std::uint8_t {
  kOneToOne,  ///< a mm is a mm; the clutch reaches what is larger than the workspace
  kFitted,    ///< the scene's box fits nine tenths of the workspace
  kFactor,    ///< by a number
};

struct WorkspaceOptions {
  WorkspaceFit fit = WorkspaceFit::kOneToOne;
  double factor = 1.0;  ///< for kFactor: mm of the scene for a mm of the device
};

/// Centres the scene's box in the workspace, unrotated. Errors: a factor that is not finite and above 0; to
/// fit, a box or workspace without extent.
[[nodiscard]] Result<DeviceMap> map_for(const geometry::Aabb& scene_mm, const DeviceLimits& limits,
                                        const WorkspaceOptions& options);

/// Half lengths of the largest box, of the workspace box's proportions, inside its shape.
[[nodiscard]] Vec3 reachable_half_mm(const DeviceLimits& limits) noexcept;

/// The clutch, like lifting a mouse: while held the HIP rests and the device moves freely; on release the
/// scene has moved with the hand. Engages only in free space, where a resting HIP feels nothing, so no force
/// depends on it. Servo thread, between ticks.
class Clutch {
 public:
  /// The map for the next ticks. `free`: the last frame had neither contact nor force. `device_mm`: the
  /// device's position in it, finite.
  [[nodiscard]] DeviceMap update(const DeviceMap& now, bool pressed, bool free,
                                 const Vec3& device_mm) noexcept;
  [[nodiscard]] bool engaged() const noexcept { return engaged_; }

 private:
  bool engaged_ = false;
  DeviceMap before_;
  Vec3 held_mm_ = Vec3::Zero();
};

/// A debounced button: changes once the input is steady for `settle_s`.
class Debounced {
 public:
  /// Mechanical switches bounce for some milliseconds.
  static constexpr double kSettleS = 0.02;
  explicit Debounced(double settle_s = kSettleS) noexcept : settle_s_(settle_s) {}
  /// The state at `t_s`. A first press counts at once; bounces within the time do not.
  [[nodiscard]] bool update(bool raw, double t_s) noexcept {
    if (raw != pressed_ && t_s - changed_s_ >= settle_s_) {
      pressed_ = raw;
      changed_s_ = t_s;
    }
    return pressed_;
  }

 private:
  double settle_s_;
  double changed_s_ = -1e9;
  bool pressed_ = false;
};

struct ButtonOptions {
  std::uint32_t switch_mask = 1u << 0;  ///< of DeviceState::buttons
  std::uint32_t clutch_mask = 1u << 1;
  /// Delay of the decision, because a press moves the hand.
  double decide_after_s = 0.2;
  /// Held longer it is momentary: release returns to the previous renderer.
  double momentary_s = 0.5;
};

/// A press selects the next renderer; held, for as long as it is held.
class SwitchButton final : public TickObserver {
 public:
  explicit SwitchButton(Mixer& mixer, const ButtonOptions& options = {}) noexcept
      : mixer_(mixer), options_(options) {}
  void took(const Tick& tick) noexcept override;

 private:
  Mixer& mixer_;
  ButtonOptions options_;
  Debounced button_;
  bool was_pressed_ = false, asks_ = false;
  double pressed_s_ = 0.0, asks_at_s_ = 0.0;
  SwitchRequest request_;
  std::uint8_t lane_before_ = 0;
};

/// The clutch of a workspace.
class ClutchButton final : public TickObserver {
 public:
  ClutchButton(Servo& servo, const Mixer& mixer, const ButtonOptions& options = {}) noexcept
      : servo_(servo), mixer_(mixer), options_(options) {}
  void took(const Tick& tick) noexcept override;
  [[nodiscard]] bool engaged() const noexcept { return clutch_.engaged(); }

 private:
  Servo& servo_;
  const Mixer& mixer_;
  ButtonOptions options_;
  Debounced button_;
  Clutch clutch_;
};

}  // namespace palpate::device
