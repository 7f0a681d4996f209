// The force as a tone: higher and louder with the force. Off by default; only with SDL 2.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <span>

#include <palpate/result.h>

namespace palpate::experiments {

/// The tone's samples, without a device: the player calls fill() with the present force.
class ForceTone {
 public:
  static constexpr int kRateHz = 48'000;
  /// Two octaves from no force to the governor's limit, audible on small loudspeakers.
  static constexpr double kLowestHz = 180.0, kHighestHz = 720.0;
  /// Share of full scale at the limit; sines are audible well below it.
  static constexpr double kLoudest = 0.35;
  /// Smoothing time of force steps: shorter ones click.
  static constexpr double kFollowS = 0.01;

  /// `share` of the limit, 0 to 1; NaN is silence.
  void fill(std::span<std::int16_t> samples, double share) noexcept;

 private:
  double phase_ = 0.0;  // in turns
  double level_ = 0.0;  // the smoothed share
};

/// Plays a tone on the default audio device from an audio thread while it lives.
class Sound {
 public:
  /// Errors: built without sound; no audio device. `force_n` is read by the audio thread and outlives this;
  /// `limit_n` above 0: the governor's.
  [[nodiscard]] static Result<std::unique_ptr<Sound>> open(const std::atomic<float>& force_n, double limit_n);
  virtual ~Sound() = default;
  Sound() = default;
  Sound(const Sound&) = delete;
  Sound& operator=(const Sound&) = delete;
};

}  // namespace palpate::experiments
