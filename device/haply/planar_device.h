// Haply's 2DIY over its serial line. Two degrees of freedom: the grip moves in a plane, z is always 0, and a
// force along z is not shown. Its board holds the last torque for ever, so zero is sent on every path: when
// it is opened, closed and destroyed, by cut_force, by the guard, and at once when a force ends.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "device/haply/planar_protocol.h"
#include "device/interface/device.h"
#include "device/interface/link.h"
#include "toolkit/core/clock.h"

namespace palpate::device {

struct PlanarOptions {
  double torque_cap_n_mm = 123.0;  ///< what the board clamps each motor at; both are scaled together
  double force_max_n = 1.5;        ///< that the motors can show everywhere in the workspace
  int open_tries = 200;            ///< how often open() looks for a first reply, 5 ms apart; 0: it does not
};

/// For a guard process, over an open link of its own: lets the motors go whatever part of a command the dead
/// program has left in the board. The first bytes do; then, twice, the board is silent, is sent one zero more
/// and must answer it, or all begins again, five times at most: 0.4 s. False: it did not.
[[nodiscard]] bool planar_let_go(Link& link) noexcept;

/// Keeps references to clock and model.
class PlanarDevice final : public Device {
 public:
  PlanarDevice(std::unique_ptr<Link> link, const Clock& clock, const PlanarModel& model,
               const PlanarOptions& options = {});
  ~PlanarDevice() override { close(); }

  [[nodiscard]] std::string name() const override { return "planar"; }
  /// The grip must be in its rest pose, at the base: the encoders begin there.
  [[nodiscard]] Status open() override;
  void close() noexcept override;
  [[nodiscard]] DeviceLimits limits() const noexcept override;
  [[nodiscard]] DeviceState read() noexcept override;
  /// A command for each reply; one more where none came for 20 ms, and at once where the force ends.
  void send(GovernedForce force) noexcept override;
  bool cut_force() noexcept override;

  /// Middle of the workspace in the pantograph's plane, mm.
  [[nodiscard]] Eigen::Vector2d origin_mm() const noexcept;
  static constexpr int kMostPolls = 8;

 private:
  void take(const std::array<float, 2>& degrees) noexcept;
  void poll_all() noexcept;
  [[nodiscard]] std::array<float, 2> torques_for(const Vec3& force_n) const noexcept;

  std::unique_ptr<Link> link_;
  const Clock& clock_;
  const PlanarModel& model_;
  PlanarOptions options_;
  CommandBytes zero_;
  PlanarReader reader_;
  DeviceState state_;
  std::optional<PantographPose> pose_;
  bool open_ = false, gone_ = false, awaiting_ = false, sent_zero_ = true;
  std::int64_t sent_ns_ = 0;
};

}  // namespace palpate::device
