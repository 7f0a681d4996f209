// One haptic frame with a device: read, step the renderer, govern, send. Timing and priority are the
// caller's; here time is what the clock says.
//
// First:
//   palpate::device::Servo servo(*renderer, {.user_limit_n = 1.0}, device, clock, {});
//   if (auto started = servo.start(); !started) return failed(started.error());
//   while (going_on()) {  // each millisecond: see servo_thread.h
//     if (servo.tick().fault != palpate::device::Fault::kNone) servo.rearm();
//   }
#pragma once

#include <atomic>
#include <cstdint>
#include <optional>

#include <palpate/clock.h>
#include <palpate/device/contact_catch_up.h>
#include <palpate/device/device.h>
#include <palpate/device/force_governor.h>
#include <palpate/device/heartbeat.h>
#include <palpate/progress.h>
#include <palpate/renderer.h>

namespace palpate::device {

/// A tick's data, for recordings.
struct Tick {
  std::int64_t t_ns = 0;         ///< the servo's clock
  double t_s = 0.0;              ///< the renderer's time, in seconds
  std::int64_t step_ns = 0;      ///< the renderer's time; 0 if not stepped
  std::int64_t exchange_ns = 0;  ///< the exchange with the device: reading and sending
  bool rearmed = false;          ///< the first tick after start or rearm
  bool restarted = false;        ///< the renderer was restarted first, in O(points); included in step_ns
  std::int64_t due_ns = 0;       ///< when a loop wanted it to begin; 0: unknown
  std::uint64_t missed = 0;      ///< whole periods skipped between due_ns and this tick
  DeviceState state;
  Vec3 hip_mm = Vec3::Zero();  ///< world frame; default without a valid position
  render::Frame frame;         ///< world frame; default if the renderer was not stepped
  Vec3 sent_n = Vec3::Zero();  ///< device frame
  Fault fault = Fault::kNone;  ///< latched
};

/// Connects a prepared renderer to a device through its own governor; keeps references to renderer, device
/// and clock. One thread. The device gets zero at every end: stop(), destructor, a stop of the program
/// (palpate/progress.h).
class Servo {
 public:
  Servo(render::HapticRenderer& renderer, const GovernorOptions& options, Device& device, const Clock& clock,
        const DeviceMap& map)
      : renderer_(renderer), options_(options), device_(device), clock_(clock), map_(map) {}
  Servo(const Servo&) = delete;
  Servo& operator=(const Servo&) = delete;
  ~Servo() { stop(); }

  /// Beats in every tick, and stops forces when tripped. Set before start; null: none.
  void watched_by(Heartbeat* heart) noexcept { heart_ = heart; }

  /// Opens the device, makes a governor for its limits, and arms it. Restarts the renderer at the first valid
  /// position, assumed free; that may take O(points), and the soft start begins afterwards. With `free_mm`
  /// (world, known to be free) it is brought up from there to that position instead.
  [[nodiscard]] Status start(const std::optional<Vec3>& free_mm = std::nullopt);
  /// After a fault, the watchdog's included: soft start again. The renderer releases at the last free HIP and
  /// is brought up to the next valid position; dents and the sides of closed surfaces stay. O(models).
  void rearm() noexcept;
  /// Changes the map from the next tick on, in the ticking thread. The caller must keep the HIP from jumping,
  /// as a clutch does.
  void remap(const DeviceMap& map) noexcept { map_ = map; }
  [[nodiscard]] const DeviceMap& map() const noexcept { return map_; }
  /// Sends zero and closes the device. Repeatable.
  void stop() noexcept;
  /// The same for the ticking thread that does not own this: never waits, not even for a stopping program.
  /// stop() must follow.
  void end() noexcept;

  /// Null before start. Kept after stop, for its counters.
  [[nodiscard]] const ForceGovernor* governor() const noexcept { return governor_ ? &*governor_ : nullptr; }

  /// One frame. Allocates nothing itself. The renderer is not stepped on faults or with a non-finite or
  /// unhomed position. Sends nothing before start.
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
  std::atomic<bool> halted_{false};  // the program is stopping: zero for good
  StopCallback stop_callback_;
  bool placed_ = false;   // the renderer knows the HIP
  bool rearmed_ = false;  // no tick since
  render::ContactCatchUp catch_up_;
  std::optional<Vec3> last_free_mm_;  // the HIP's last free place
};

/// An observer of every tick: recorders, histograms, a window.
class TickObserver {
 public:
  TickObserver() = default;
  TickObserver(const TickObserver&) = delete;
  TickObserver& operator=(const TickObserver&) = delete;
  virtual ~TickObserver() = default;

  /// Called in the servo thread, after sending. It must not block, allocate, lock or log, and counts lost
  /// ticks.
  virtual void took(const Tick& tick) noexcept = 0;
};

}  // namespace palpate::device
