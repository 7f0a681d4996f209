// One haptic frame with a device: read, step the renderer, govern, send. The thread that calls it at a steady
// rate, with real-time priority, is another matter; here time is whatever the clock says.
#pragma once

#include <cstdint>

#include "device/clock.h"
#include "device/device.h"
#include "device/force_governor.h"
#include "toolkit/geometry/rigid_transform.h"
#include "toolkit/render/renderer.h"

namespace palpate::device {

/// What happened in a tick, for recordings.
struct Tick {
  double t_s = 0.0;
  DeviceState state;
  render::Frame frame;         ///< world frame; default where the renderer was not stepped
  Vec3 sent_n = Vec3::Zero();  ///< device frame
  Fault fault = Fault::kNone;  ///< latched
};

/// Connects a prepared renderer to a device through a governor; keeps references to all. One thread.
class Servo {
 public:
  Servo(render::HapticRenderer& renderer, ForceGovernor& governor, Device& device, const Clock& clock,
        const geometry::RigidTransform& world_from_device)
      : renderer_(renderer),
        governor_(governor),
        device_(device),
        clock_(clock),
        world_from_device_(world_from_device) {}

  /// Opens the device and arms the governor. The first good position puts the renderer's HIP into free space
  /// there.
  [[nodiscard]] Status start();
  /// After a fault: soft start again, the renderer reset at the next good position.
  void rearm() noexcept;
  /// Sends zero and closes the device.
  void stop() noexcept;

  /// One frame. No allocation of its own. A position that is not finite, or a fault, never reaches the
  /// renderer.
  Tick tick() noexcept;

 private:
  render::HapticRenderer& renderer_;
  ForceGovernor& governor_;
  Device& device_;
  const Clock& clock_;
  geometry::RigidTransform world_from_device_;
  bool placed_ = false;  // the renderer knows where the HIP is
  double last_s_ = 0.0;
};

}  // namespace palpate::device
