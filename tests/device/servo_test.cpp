// Renderer, governor and simulated device together on a virtual clock.
#include <palpate/device/servo.h>

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "device/simulated/simulated_device.h"
#include "toolkit/render/wrapped_renderer.h"

namespace palpate::device {
namespace {

constexpr double kPeriodS = 1e-3;
constexpr double kServoNan = std::numeric_limits<double>::quiet_NaN();

// A half space z < 0 in the world with a spring; answers NaN on request.
class Wall final : public render::SceneFreeRenderer {
 public:
  void restart(const Vec3& hip_mm, double t_s) noexcept override {
    ++restarts;
    placed_at_mm = hip_mm;
    last_s = t_s;
  }
  void release_contact(const Vec3& hip_mm) noexcept override {
    ++lettings_go;
    placed_at_mm = hip_mm;
  }
  render::Frame step(const Vec3& hip_mm, double t_s) noexcept override {
    ++steps;
    EXPECT_TRUE(is_finite(hip_mm));
    EXPECT_GT(t_s, last_s) << "time rises";
    last_s = t_s;
    last_hip_mm = hip_mm;
    render::Frame frame;
    frame.god_object_mm = hip_mm;
    if (hip_mm.z() < 0.0) {
      frame.contact = true;
      frame.god_object_mm.z() = 0.0;
      frame.force_n.z() = -0.5 * hip_mm.z();
    }
    if (steps == nan_at) frame.force_n.setConstant(kServoNan);
    return frame;
  }
  render::Description describe() const override { return {"wall", "", "", "constant", {}}; }

  int restarts = 0, lettings_go = 0, steps = 0, nan_at = -1;
  double last_s = 0.0;
  Vec3 placed_at_mm = Vec3::Zero(), last_hip_mm = Vec3::Zero();
};

// A second of resting 2 mm deep after a second in the air.
trace::ProbePath resting_path() {
  trace::ProbePath path;
  path.name = "rest";
  for (int i = 0; i <= 3000; ++i) {
    path.t_s.push_back(5.0 + i * kPeriodS);  // a recording need not start at 0
    path.hip_mm.emplace_back(0.0, 0.0, std::max(-2.0, 1.0 - 0.003 * i));
  }
  return path;
}

DeviceLimits limits() {
  return {3.3, {Vec3::Constant(-80), Vec3::Constant(80)}, 0.055, 1000.0};
}

struct Rig {
  explicit Rig(std::vector<ScriptedFault> faults = {}, geometry::RigidTransform world_from_device = {})
      : path(resting_path()),
        device(path, clock, limits(), 10'000, std::move(faults)),
        servo(wall, {}, device, clock, world_from_device) {}

  std::vector<Tick> run(int ticks) {
    std::vector<Tick> all;
    for (int i = 0; i < ticks; ++i) {
      all.push_back(servo.tick());
      clock.advance(kPeriodS);
    }
    return all;
  }

  VirtualClock clock;
  trace::ProbePath path;
  Wall wall;
  SimulatedDevice device;
  Servo servo;
};

TEST(SimulatedDevice, PlaysThePathSampleBySample) {
  Rig rig;
  ASSERT_TRUE(rig.servo.start());
  const std::vector<Tick> ticks = rig.run(3100);
  for (std::size_t i = 0; i < ticks.size(); ++i) {
    const std::size_t sample = std::min<std::size_t>(i, rig.path.size() - 1);
    ASSERT_EQ(ticks[i].state.position_mm, rig.path.hip_mm[sample]) << i;
    ASSERT_EQ(ticks[i].state.status, ReadStatus::kFresh);
  }
  EXPECT_EQ(rig.device.sent().size(), 3100u);
  EXPECT_EQ(rig.device.unrecorded(), 0u);
  EXPECT_EQ(rig.device.name(), "sim:rest");
}

TEST(SimulatedDevice, SaysNothingNewWithinOneInstantAndLostWhenClosed) {
  Rig rig;
  EXPECT_EQ(rig.device.read().status, ReadStatus::kLost);
  ASSERT_TRUE(rig.device.open());
  EXPECT_EQ(rig.device.read().status, ReadStatus::kFresh);
  EXPECT_EQ(rig.device.read().status, ReadStatus::kNothingNew);
  rig.device.close();
  EXPECT_EQ(rig.device.read().status, ReadStatus::kLost);
}

TEST(Servo, TheForceOfTheRendererArrives) {
  Rig rig;
  ASSERT_TRUE(rig.servo.start());
  const std::vector<Tick> ticks = rig.run(2500);
  EXPECT_EQ(rig.wall.restarts, 1);
  EXPECT_EQ(rig.wall.placed_at_mm, rig.path.hip_mm[0]);
  EXPECT_NEAR(ticks.back().sent_n.z(), 1.0, 1e-12);  // 0.5 N/mm x 2 mm, soft start long over
  EXPECT_EQ(rig.device.held_n(), ticks.back().sent_n);
  rig.servo.stop();
  EXPECT_EQ(rig.device.held_n(), Vec3::Zero());
  EXPECT_FALSE(rig.device.is_open());
}

TEST(Servo, FramesOfDeviceAndWorldAreKeptApart) {
  geometry::RigidTransform world_from_device;
  world_from_device.rotation =
      Eigen::AngleAxisd(std::acos(0.0), Vec3::UnitX());  // device y is up in the world
  world_from_device.translation_mm = {0.0, 0.0, -1.5};
  Rig rig({}, world_from_device);
  ASSERT_TRUE(rig.servo.start());
  const std::vector<Tick> ticks = rig.run(2500);
  // The device's z maps to the world's -y: the HIP rests at world z = -1.5, force 0.75 N up, along the
  // device's y.
  EXPECT_NEAR((ticks.back().sent_n - Vec3(0.0, 0.75, 0.0)).norm(), 0.0, 1e-12);
}

TEST(Servo, NanFromARendererNeverReachesTheDevice) {
  Rig rig;
  rig.wall.nan_at = 2001;
  ASSERT_TRUE(rig.servo.start());
  const std::vector<Tick> ticks = rig.run(2500);
  EXPECT_GT(ticks[1999].sent_n.z(), 0.9);
  EXPECT_EQ(ticks[2000].fault, Fault::kNonFiniteForce);
  for (std::size_t i = 2000; i < ticks.size(); ++i) ASSERT_EQ(ticks[i].sent_n, Vec3::Zero());
  for (const SentForce& sent : rig.device.sent()) ASSERT_TRUE(is_finite(sent.force_n));
  EXPECT_EQ(rig.wall.steps, 2001) << "a latched fault stops the renderer too";
}

// Which faults end in zero is told by watchdog_test.cpp, through packets; here it is who is asked after one.
TEST(Servo, AfterAFaultItIsArmedSoftlyAndTheRendererIsPlacedWhereItWasLastFree) {
  Rig rig({{ScriptedFault::Kind::kNonFinitePosition, 1.9995, 0.001, Vec3::Zero()}});
  ASSERT_TRUE(rig.servo.start());
  const std::vector<Tick> ticks = rig.run(2100);
  EXPECT_GT(ticks[1999].sent_n.z(), 0.9);
  EXPECT_EQ(ticks[2000].fault, Fault::kNonFinitePosition);
  for (std::size_t i = 2000; i < ticks.size(); ++i) ASSERT_EQ(ticks[i].sent_n, Vec3::Zero()) << i;
  rig.servo.rearm();
  const std::vector<Tick> again = rig.run(700);
  EXPECT_LT(again[1].sent_n.norm(), 0.01);
  EXPECT_NEAR(again.back().sent_n.z(), 1.0, 1e-12);
  EXPECT_EQ(rig.wall.restarts, 1) << "shapes and sides stay";
  EXPECT_EQ(rig.wall.lettings_go, 1);
  EXPECT_GE(rig.wall.placed_at_mm.z(), 0.0) << "where it was last free";
}

TEST(Servo, RearmedInContactItIsBroughtUpInSmallSteps) {
  Rig rig;
  ASSERT_TRUE(rig.servo.start());
  (void)rig.run(2000);  // rests 2 mm deep
  rig.servo.rearm();
  const int steps = rig.wall.steps;
  const Tick first = rig.servo.tick();
  // From the last free place, 1 um up, to -2 mm in steps of at most 0.5 mm: one tick.
  EXPECT_EQ(rig.wall.steps - steps, 5);
  EXPECT_EQ(rig.wall.last_hip_mm, rig.path.hip_mm[2000]);
  EXPECT_NEAR(first.frame.force_n.z(), 1.0, 1e-12);
  EXPECT_LT(first.sent_n.norm(), 0.01) << "the soft start begins again";
}

TEST(Servo, StartedInContactItIsBroughtUpFromAPlaceKnownToBeFree) {
  Rig rig;
  rig.path.hip_mm.assign(rig.path.size(), Vec3(0, 0, -2));
  ASSERT_TRUE(rig.servo.start(Vec3(0, 0, 30)));
  // 32 mm in steps of 0.5 mm, 16 a tick: four ticks without force, for none of their places is the HIP's.
  const std::vector<Tick> ticks = rig.run(1000);
  for (int i = 0; i < 3; ++i) EXPECT_EQ(ticks[static_cast<std::size_t>(i)].frame.force_n, Vec3::Zero()) << i;
  EXPECT_NEAR(ticks[3].frame.force_n.z(), 1.0, 1e-12);
  EXPECT_NEAR(ticks.back().sent_n.z(), 1.0, 1e-12);
  EXPECT_EQ(rig.wall.restarts, 1);
  EXPECT_EQ(rig.wall.lettings_go, 1);
}

}  // namespace
}  // namespace palpate::device
