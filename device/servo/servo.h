// One haptic frame with a device: read, step the renderer, govern, send. The thread that calls it at a steady
// rate, with real-time priority, is another matter; here time is whatever the clock says.
#pragma once

#include <atomic>
#include <cstdint>
#include <optional>

#include "device/interface/device.h"
#include "device/interface/force_governor.h"
#include "device/safety/heartbeat.h"
#include "device/servo/device_map.h"
#include "toolkit/core/at_stop.h"
#include "toolkit/core/clock.h"
#include "toolkit/render/bring_up.h"
#include "toolkit/render/renderer.h"

namespace palpate::device {

/// What happened in a tick, for recordings.
struct Tick {
  std::int64_t t_ns = 0;         ///< the servo's clock
  double t_s = 0.0;              ///< the same in seconds, as the renderer got it
  std::int64_t step_ns = 0;      ///< what the renderer took; 0 where it was not stepped
  std::int64_t exchange_ns = 0;  ///< what reading and sending took: the exchange with the device
  bool rearmed = false;          ///< the first tick after start or rearm
  bool restarted = false;        ///< the renderer was restarted first, in O(points); step_ns holds that
  std::int64_t due_ns = 0;       ///< when a loop wanted it to begin; 0: nobody did
  std::uint64_t missed = 0;      ///< whole periods that the loop skipped, between due_ns and this tick
  DeviceState state;
  Vec3 hip_mm = Vec3::Zero();  ///< world frame; default where the renderer was not stepped
  render::Frame frame;         ///< world frame; default where the renderer was not stepped
  Vec3 sent_n = Vec3::Zero();  ///< device frame
  Fault fault = Fault::kNone;  ///< latched
};

/// Connects a prepared renderer to a device through a governor of its own; keeps references to renderer,
/// device and clock. One thread. The device gets zero at every end: stop(), the destructor, a stop of the
/// program (toolkit/core/at_stop.h).
class Servo {
 public:
  Servo(render::HapticRenderer& renderer, const GovernorOptions& options, Device& device, const Clock& clock,
        const DeviceMap& map)
      : renderer_(renderer),
        options_(options),
        device_(device),
        clock_(clock),
        map_(map) {}
  Servo(const Servo&) = delete;
  Servo& operator=(const Servo&) = delete;
  ~Servo() { stop(); }

  /// Beats in every tick, and is obeyed where it was tripped. Before start; null: nobody watches.
  void watched_by(Heartbeat* heart) noexcept { heart_ = heart; }

  /// Opens the device, makes a governor for its limits, which are valid only then, and arms it. The renderer
  /// is restarted at the first good position, which is taken to be free; that may take O(points), and the
  /// soft start begins after it. From `free_mm` (world), a place known to be free, it is brought up to that
  /// position instead.
  [[nodiscard]] Status start(const std::optional<Vec3>& free_mm = std::nullopt);
  /// After a fault: soft start again, the watchdog's included. The renderer lets go where the HIP was last
  /// free and is brought up from there to the next good position: dents, and the sides of closed surfaces,
  /// stay. O(models).
  void rearm() noexcept;
  /// From the next tick on, in the thread that ticks. The HIP must not jump by it: that is the caller's to
  /// see to, as a clutch does.
  void remap(const DeviceMap& map) noexcept { map_ = map; }
  [[nodiscard]] const DeviceMap& map() const noexcept { return map_; }
  /// Sends zero and closes the device. Twice is fine.
  void stop() noexcept;
  /// The same for a thread that runs the ticks and does not own this: it never waits, not even for a program
  /// that is being stopped. stop() is still to follow.
  void end() noexcept;

  /// Null before start. Stays after stop, for its counters.
  [[nodiscard]] const ForceGovernor* governor() const noexcept { return governor_ ? &*governor_ : nullptr; }

  /// One frame. No allocation of its own. A position that is not finite or not homed, or a fault, never
  /// reaches the renderer. Before start nothing is sent.
  Tick tick() noexcept;

 private:
  bool place(const Vec3& hip_mm, double t_s) noexcept;
  [[nodiscard]] bool usable(const DeviceState& state) const noexcept;
  [[nodiscard]] GovernedForce govern(const Tick& tick, const Vec3& wanted_n) noexcept;
  [[nodiscard]] bool given_up() const noexcept;
  void halt() noexcept;

  render::HapticRenderer& renderer_;
  GovernorOptions options_;
  Device& device_;
  const Clock& clock_;
  DeviceMap map_;
  std::optional<ForceGovernor> governor_;
  Heartbeat* heart_ = nullptr;
  bool started_ = false;
  std::atomic<bool> halted_{false};  // the program is being stopped: zero for good
  AtStop at_stop_;
  bool placed_ = false;   // the renderer knows where the HIP is
  bool rearmed_ = false;  // and not ticked since
  render::BringUp bring_up_;
  std::optional<Vec3> last_free_mm_;  // where the HIP was last known to be free
};

}  // namespace palpate::device
