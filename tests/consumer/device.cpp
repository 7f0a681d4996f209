// A device of the application's own under the servo: pressed in within a second, the last force that it got.
#include "device.h"

#include <cstdint>
#include <cstdio>
#include <string>
#include <utility>

#include <palpate/clock.h>
#include <palpate/device/device.h>
#include <palpate/device/drivers.h>
#include <palpate/device/servo.h>

namespace {

namespace device = palpate::device;
using palpate::Vec3;

// Its hand is moved by the program; it has no motors.
class Still final : public device::Device {
 public:
  explicit Still(const palpate::Clock& clock) : clock_(clock) {}

  void move_to(const Vec3& place_mm) noexcept { place_mm_ = place_mm; }
  [[nodiscard]] const Vec3& got_n() const noexcept { return got_n_; }

  [[nodiscard]] std::string name() const override { return "still"; }
  [[nodiscard]] palpate::Status open() override { return palpate::Done{}; }
  void close() noexcept override { got_n_.setZero(); }
  [[nodiscard]] device::DeviceLimits limits() const noexcept override {
    device::DeviceLimits limits;
    limits.force_max_n = 3.0;
    limits.workspace_mm.add({-50.0, -50.0, -50.0});
    limits.workspace_mm.add({50.0, 50.0, 50.0});
    limits.resolution_mm = 0.01;
    limits.rate_hz = 1000.0;
    return limits;
  }
  [[nodiscard]] device::DeviceState read() noexcept override {
    device::DeviceState state;
    state.status = device::ReadStatus::kFresh;
    state.position_mm = place_mm_;
    state.packet_ns = clock_.now_ns();
    return state;
  }
  void send(device::GovernedForce force) noexcept override { got_n_ = force.newtons(); }

 private:
  const palpate::Clock& clock_;
  Vec3 place_mm_ = Vec3::Zero();
  Vec3 got_n_ = Vec3::Zero();
};

}  // namespace

int hold(palpate::render::HapticRenderer& renderer, const Vec3& surface_mm, const Vec3& normal) {
  device::Drivers drivers;
  device::register_simulated_drivers(drivers);
  for (const device::Driver& driver : drivers.all()) std::printf("driver %s\n", driver.name.c_str());

  palpate::VirtualClock clock;
  Still still(clock);
  palpate::geometry::RigidTransform world_from_device;
  world_from_device.translation_mm = surface_mm;
  device::Servo servo(renderer, {}, still, clock, device::DeviceMap(world_from_device));
  still.move_to(normal);
  if (auto started = servo.start(); !started) {
    std::fprintf(stderr, "%s\n", started.error().message().c_str());
    return 1;
  }
  // From 1 mm outside to 1 mm inside, and a second of rest.
  for (int ms = 1; ms <= 2000; ++ms) {
    clock.advance(1e-3);
    still.move_to((1.0 - 0.002 * (ms < 1000 ? ms : 1000)) * normal);
    servo.tick();
  }
  const Vec3 felt_n = still.got_n();
  servo.stop();
  std::printf("%s, 1 mm deep: %.3f N\n", still.name().c_str(), felt_n.norm());
  return felt_n.dot(normal) > 0.25 && felt_n.norm() < 1.0 ? 0 : 1;
}
