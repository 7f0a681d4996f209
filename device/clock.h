// The servo's time. Everything in device/ takes its time from here, so that tests run minutes of servo in
// milliseconds and never wait.
#pragma once

namespace palpate::device {

/// Seconds since some start; never goes back.
class Clock {
 public:
  Clock() = default;
  Clock(const Clock&) = delete;
  Clock& operator=(const Clock&) = delete;
  virtual ~Clock() = default;
  [[nodiscard]] virtual double now_s() const noexcept = 0;
};

/// Moves only when told to.
class VirtualClock final : public Clock {
 public:
  [[nodiscard]] double now_s() const noexcept override { return now_s_; }
  /// by_s >= 0; anything else leaves the clock where it is.
  void advance(double by_s) noexcept {
    if (by_s > 0.0) now_s_ += by_s;
  }

 private:
  double now_s_ = 0.0;
};

}  // namespace palpate::device
