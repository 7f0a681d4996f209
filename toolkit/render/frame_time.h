// The time between frames, for renderers and their wrappers.
#pragma once

namespace palpate::render {

/// Measures the time between a renderer's frames from the caller's times.
class FrameTime {
 public:
  void restart(double t_s) noexcept { now_s_ = t_s; }
  /// After release_contact() the past is unknown: the next frame counts no time.
  void release_contact() noexcept { resumed_ = true; }
  /// Takes a frame at `t_s`; returns the time since the last one.
  double advance(double t_s) noexcept {
    const double dt_s = resumed_ ? 0.0 : t_s - now_s_;
    resumed_ = false;
    now_s_ = t_s;
    return dt_s;
  }
  [[nodiscard]] double now_s() const noexcept { return now_s_; }

 private:
  double now_s_ = 0.0;
  bool resumed_ = false;
};

}  // namespace palpate::render
