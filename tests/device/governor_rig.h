// A governor alone, on times and states given by hand.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <utility>

#include <palpate/device/force_governor.h>

namespace palpate::device {

inline constexpr double kMs = 1e-3;

inline DeviceLimits arm_limits(WorkspaceShape shape = WorkspaceShape::kBox) {
  return {3.3, {Vec3{-80, -60, -40}, Vec3{80, 60, 40}}, 0.055, 1000.0, 0.0, 0.0, shape};
}

inline DeviceState at(const Vec3& position_mm, ReadStatus status = ReadStatus::kFresh) {
  return {.status = status, .position_mm = position_mm};
}

inline DeviceState unhomed_at(const Vec3& position_mm) {
  DeviceState state = at(position_mm);
  state.homed = false;
  return state;
}

inline ForceGovernor governor(const GovernorOptions& options = {},
                              const DeviceLimits& limits = arm_limits()) {
  Result<ForceGovernor> made = ForceGovernor::create(limits, options);
  EXPECT_TRUE(made) << made.error().message();
  return std::move(made).value();
}

/// Armed at 0, it rests at a place with a steady wish until the soft start is over; the time of the last
/// frame.
inline double rest(ForceGovernor& g, const Vec3& at_mm, const Vec3& wanted_n, double period_s = kMs) {
  g.arm(0.0);
  const int frames = static_cast<int>(std::lround(0.6 / period_s));
  for (int i = 0; i <= frames; ++i) (void)g.govern(i * period_s, at(at_mm), wanted_n);
  return frames * period_s;
}

}  // namespace palpate::device
