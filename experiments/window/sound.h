// The force as a tone, for who wants to hear what is felt: higher and louder with the force. Off until asked
// for; only where the program was built with SDL 2.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <span>

#include "toolkit/core/result.h"

namespace palpate::experiments {

/// The samples of the tone. No device: whoever plays calls fill() with the force of the moment.
class ForceTone {
 public:
  static constexpr int kRateHz = 48'000;
  /// Two octaves from no force to the governor's limit, where a small loudspeaker is heard and nobody minds.
  static constexpr double kLowestHz = 180.0, kHighestHz = 720.0;
  /// Of full scale at the limit; a tone of a sine is heard well below this.
  static constexpr double kLoudest = 0.35;
  /// In which a step of the force is followed: shorter ones click.
  static constexpr double kFollowS = 0.01;

  /// `share`: of the limit, 0 to 1; what is not a number is silence.
  void fill(std::span<std::int16_t> samples, double share) noexcept;

 private:
  double phase_ = 0.0;  // of a turn
  double level_ = 0.0;  // the share as heard, which follows
};

/// Plays a tone on the usual audio device from a thread of the audio system, until it goes.
class Sound {
 public:
  /// Errors: built without sound; no audio device. `force_n` is read by the audio thread and outlives this;
  /// `limit_n` above 0: of the governor.
  [[nodiscard]] static Result<std::unique_ptr<Sound>> open(const std::atomic<float>& force_n, double limit_n);
  virtual ~Sound() = default;
  Sound() = default;
  Sound(const Sound&) = delete;
  Sound& operator=(const Sound&) = delete;
};

}  // namespace palpate::experiments
