// No tick allocates, including counting, observing and rearming.
#include <gtest/gtest.h>

#include <array>

#include <palpate/device/servo_loop.h>
#include "device/simulated/arm_models.h"
#include "tests/device/rig.h"
#include "tests/house/allocation_count.h"

namespace palpate::device {
namespace {

struct Counting final : TickObserver {
  void took(const Tick& tick) noexcept override { touched += tick.frame.contact ? 1 : 0; }
  int touched = 0;
};

TEST(Frames, NoTickOfTheServoLoopAllocates) {
  constexpr std::int64_t kNs = 2'000'000'000;
  VirtualClock clock;
  SpringPlane plane(0.5);
  const HandScript script =
      HandScript::create("press", {0.0, 0.2, 0.6}, {Vec3{0, 0, 5}, Vec3{0, 0, 5}, Vec3{0, 0, -3}},
                         HandScript::Between::kStraight)
          .value();
  SimulatedArm arm(arm_models().front(), hand_models()[1], script, clock);
  GovernorOptions governed;
  governed.period_s = 0.00025;
  Servo servo(plane, governed, arm, clock, {});
  Counting counting;
  const std::array<TickObserver*, 1> observers = {&counting};
  auto loop = ServoLoop::create(servo, clock, 4000, observers).value();
  ASSERT_TRUE(servo.start());
  int asked = 0;
  const house::AllocationCount count;
  const std::uint64_t ticks = run_accelerated(*loop, clock, kNs, [&] {
    constexpr int kRearmEvery = 3000;
    if (++asked % kRearmEvery == 0) loop->request_rearm();
    return true;
  });
  const std::uint64_t blocks = count.count();
  servo.stop();
  EXPECT_EQ(blocks, 0u);
  EXPECT_EQ(ticks, 8001u);
  EXPECT_GT(counting.touched, 1000) << "nothing was felt";
  EXPECT_EQ(loop->histograms().statistics().ticks, ticks);
}

}  // namespace
}  // namespace palpate::device
