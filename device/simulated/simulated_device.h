// A simulated device that plays a recorded path. It runs on the servo's clock, records commands, and fails on
// request.
#pragma once

#include <vector>

#include <palpate/clock.h>
#include <palpate/device/device.h>
#include <palpate/trace.h>

namespace palpate::device {

/// A fault from `start_s` (path time) for `duration_s`.
struct ScriptedFault {
  enum class Kind : std::uint8_t { kSilence, kNonFinitePosition, kJump, kLost };
  Kind kind = Kind::kSilence;
  double start_s = 0.0;
  double duration_s = 0.0;
  Vec3 jump_mm = Vec3::Zero();  ///< added to the position, for kJump
};

struct SentForce {
  double t_s = 0.0;  ///< clock
  Vec3 force_n = Vec3::Zero();
};

/// Path time starts with open(). The position is that of the newest sample, without interpolation; it rests
/// before the first and after the last. Keeps references to path and clock.
class SimulatedDevice final : public Device {
 public:
  /// Records `max_sent` commands and counts later ones. Memory is reserved here: send() does not allocate.
  SimulatedDevice(const trace::ProbePath& path, const Clock& clock, const DeviceLimits& limits,
                  std::size_t max_sent, std::vector<ScriptedFault> faults = {});

  [[nodiscard]] std::string name() const override { return "sim:" + path_.name; }
  /// An Error for a path without samples.
  [[nodiscard]] Status open() override;
  void close() noexcept override;
  [[nodiscard]] DeviceLimits limits() const noexcept override { return limits_; }
  [[nodiscard]] DeviceState read() noexcept override;
  void send(GovernedForce force) noexcept override;

  [[nodiscard]] bool is_open() const noexcept { return open_; }
  [[nodiscard]] const std::vector<SentForce>& sent() const noexcept { return sent_; }
  [[nodiscard]] std::size_t unrecorded() const noexcept { return unrecorded_; }
  /// Present motor force: the last command, zero after close().
  [[nodiscard]] const Vec3& held_n() const noexcept { return held_n_; }

 private:
  const trace::ProbePath& path_;
  const Clock& clock_;
  DeviceLimits limits_;
  std::size_t max_sent_;
  std::vector<ScriptedFault> faults_;
  bool open_ = false;
  double opened_s_ = 0.0;
  double last_read_s_ = -1.0;  // path time of the last fresh state; negative: none yet
  std::size_t sample_ = 0;
  DeviceState last_;
  std::vector<SentForce> sent_;
  std::size_t unrecorded_ = 0;
  Vec3 held_n_ = Vec3::Zero();
};

}  // namespace palpate::device
