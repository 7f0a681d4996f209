// Tick observers for device buttons that switch renderers and move the scene.
#pragma once

#include <cstdint>

#include <palpate/device/servo.h>
#include "device/live/mixer.h"
#include "device/live/workspace.h"

namespace palpate::device {

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
