// What the governor does with places, speeds, homing and rates; the rest is in force_governor_test.cpp.

#include <cmath>

#include <palpate/device/force_governor.h>
#include "tests/device/governor_rig.h"
#include "tests/device/helpers.h"
#include "toolkit/core/random.h"

namespace palpate::device {
namespace {

constexpr double kPeriod4kS = 0.25e-3;

// ---- the workspace's edge

TEST(WorkspaceEdge, WhatPushesOutFadesAndWhatPushesInStays) {
  const DeviceLimits limits = arm_limits();
  const auto x_at = [&](double x_mm, double force) {
    return faded_at_edge(limits, 0.1, 0.0, Vec3{x_mm, 0, 0}, Vec3::Zero(), Vec3{force, 0.3, 0}).x();
  };
  EXPECT_EQ(x_at(72.0, 1.0), 1.0) << "a tenth of 80 mm from the edge it begins";
  EXPECT_NEAR(x_at(76.0, 1.0), 0.5, 1e-12);
  EXPECT_EQ(x_at(80.0, 1.0), 0.0);
  EXPECT_EQ(x_at(1e6, 1.0), 0.0);
  EXPECT_EQ(x_at(80.0, -1.0), -1.0);
  EXPECT_NEAR(x_at(-76.0, -1.0), -0.5, 1e-12) << "the other side";
  EXPECT_EQ(x_at(-80.0, 1.0), 1.0);
  EXPECT_EQ(faded_at_edge(limits, 0.1, 0.0, Vec3{80, 0, 0}, Vec3::Zero(), Vec3{1, 0.3, 0}).y(), 0.3)
      << "along the edge it stays";
}

TEST(WorkspaceEdge, EachShapeHasItsOwnEdge) {
  const Vec3 diagonal = Vec3{80, 60, 40} / std::sqrt(3.0);  // on the ellipsoid, well inside the box
  const Vec3 out{1, 1, 1};
  const auto left = [&](WorkspaceShape shape, const Vec3& at) {
    return faded_at_edge(arm_limits(shape), 0.1, 0.0, at, Vec3::Zero(), out);
  };
  EXPECT_EQ(left(WorkspaceShape::kBox, diagonal), out);
  const Vec3 normal = diagonal.cwiseQuotient(Vec3{6400, 3600, 1600}).normalized();
  EXPECT_NEAR(left(WorkspaceShape::kEllipsoid, diagonal).dot(normal), 0.0, 1e-12);
  EXPECT_EQ(left(WorkspaceShape::kCylinder, diagonal), out) << "0.82 of the way to the mantle";
  EXPECT_NEAR(left(WorkspaceShape::kCylinder, Vec3{0, 0, 40}).z(), 0.0, 1e-12);
  EXPECT_NEAR(left(WorkspaceShape::kCylinder, Vec3{80, 0, 0}).x(), 0.0, 1e-12);
  EXPECT_EQ(left(WorkspaceShape::kEllipsoid, Vec3::Zero()), out) << "the very middle";
}

TEST(WorkspaceEdge, IsContinuousEverywhere) {
  Random random(7);
  for (const WorkspaceShape shape :
       {WorkspaceShape::kBox, WorkspaceShape::kEllipsoid, WorkspaceShape::kCylinder}) {
    for (int i = 0; i < 20000; ++i) {
      const Vec3 at{random.uniform(-90, 90), random.uniform(-70, 70), random.uniform(-50, 50)};
      const Vec3 step = 1e-4 * Vec3{random.normal(), random.normal(), random.normal()};
      const Vec3 force{random.normal(), random.normal(), random.normal()};
      const auto left = [&](const Vec3& p) {
        return faded_at_edge(arm_limits(shape), 0.1, 0.004, p, Vec3{100, -50, 20}, force);
      };
      // The gain's steepest slope is 1.5 over the fade's width, 4 mm on the shortest axis; force and damping
      // together stay below |F| + 0.5 N; the normals of the curved walls turn no faster than 1/20 mm.
      const double most = (1.5 / 4.0 + 2.0 / 20.0) * (force.norm() + 0.5) * step.norm();
      ASSERT_LE((left(at + step) - left(at)).norm(), 1.8 * most) << "seed 7, case " << i;
    }
  }
}

/// Energy that a force field gives to who moves along a path, mJ.
template <class Field>
double work_mj(const Field& field, const std::vector<Vec3>& path) {
  double sum = 0.0;
  for (std::size_t i = 1; i < path.size(); ++i) {
    const Vec3 step = path[i] - path[i - 1];
    sum += field(0.5 * (path[i] + path[i - 1]), step * 1e3).dot(step);
  }
  return sum;
}

TEST(WorkspaceEdge, OutAndInAgainItMakesNoEnergyAndOutwardItGivesLess) {
  std::vector<Vec3> out, in;
  for (int i = 0; i <= 4000; ++i) out.push_back(Vec3{60.0 + 0.005 * i, 10, 5});
  in.assign(out.rbegin(), out.rend());
  const auto push = [](const Vec3& p) { return Vec3{0.2 + 0.05 * (p.x() - 60.0), 0, 0}; };
  for (const double damping : {0.0, 0.004}) {
    const auto field = [&](const Vec3& p, const Vec3& v) {
      return faded_at_edge(arm_limits(), 0.1, damping, p, v, push(p));
    };
    const double given = work_mj(field, out), taken = work_mj(field, in);
    const double full = work_mj([&](const Vec3& p, const Vec3&) { return push(p); }, out);
    EXPECT_LT(given, 0.8 * full);
    if (damping == 0.0)
      EXPECT_NEAR(given + taken, 0.0, 1e-9);
    else
      EXPECT_NEAR(given + taken, -0.004 * 5.0 * 8.0 * 0.5, 1e-3) << "the damper takes, outward alone";
  }
}

TEST(GovernorEdge, AnArmThatIsPushedOutMeetsItsStopWithoutForce) {
  ForceGovernor g = governor();
  double t = rest(g, Vec3{60, 0, 0}, Vec3{2, 0, 0});
  double last = 2.0;
  for (double x = 60.0; x <= 80.0; x += 0.1) {
    t += kMs;
    const double out = g.govern(t, at(Vec3{x, 0, 0}), Vec3{2, 0, 0}).newtons().x();
    EXPECT_LE(out, last);
    last = out;
  }
  EXPECT_NEAR(last, 0.0, 1e-3);
  EXPECT_GT(g.counters().edge_faded, 50u);
  EXPECT_EQ(g.fault(), Fault::kNone);
}

TEST(GovernorEdge, WantsAWorkspaceUnlessItIsSwitchedOff) {
  DeviceLimits none = arm_limits();
  none.workspace_mm = {};
  GovernorOptions options;
  EXPECT_FALSE(ForceGovernor::create(none, options));
  options.edge_share = 0.0;
  EXPECT_TRUE(ForceGovernor::create(none, options).ok());
  options.edge_share = 1.5;
  EXPECT_FALSE(ForceGovernor::create(arm_limits(), options));
}

// ---- speed

TEST(GovernorSpeed, WhatPushesAlongFadesAndWhatBrakesStays) {
  // By which share of 1 N along and against a motion of some speed is let through.
  const auto shares = [](double mm_per_s, double sign) {
    GovernorOptions options{.edge_share = 0.0};
    ForceGovernor g = governor(options);
    double t = rest(g, Vec3::Zero(), Vec3{sign, 0, 0});
    double out = 0.0, x = 0.0;
    for (int i = 0; i < 40; ++i) {  // twenty of the smoothing's times
      t += kMs;
      x += mm_per_s * kMs;
      out = g.govern(t, at(Vec3{x, 0, 0}), Vec3{sign, 0, 0}).newtons().x();
    }
    EXPECT_EQ(g.fault(), Fault::kNone);
    return out;
  };
  EXPECT_EQ(shares(900.0, 1.0), 1.0);
  EXPECT_NEAR(shares(1250.0, 1.0), 0.5, 1e-3);
  EXPECT_NEAR(shares(1600.0, 1.0), 0.0, 1e-12);
  EXPECT_EQ(shares(1600.0, -1.0), -1.0);
  EXPECT_EQ(shares(-1600.0, 1.0), 1.0);
}

TEST(GovernorSpeed, RefusesAFadeThatEndsBeforeItBegins) {
  GovernorOptions options{.fade_to_mm_per_s = 900.0};
  EXPECT_FALSE(ForceGovernor::create(arm_limits(), options));
  options.fade_from_mm_per_s = 0.0;
  EXPECT_TRUE(ForceGovernor::create(arm_limits(), options).ok()) << "off";
}

// ---- rates: the same hand and the same jitter at 1 and at 4 kHz

TEST(GovernorRates, OrdinaryJitterTripsNothingAtFourKilohertz) {
  GovernorOptions options{.period_s = kPeriod4kS};
  ForceGovernor g = governor(options);
  const Vec3 wanted{1, 0, 0};
  const double t = rest(g, Vec3::Zero(), wanted, kPeriod4kS);
  EXPECT_EQ(g.govern(t + 5e-3, at(Vec3::Zero()), wanted).newtons(), wanted) << "19 periods late";
  EXPECT_EQ(g.govern(t + 10.5e-3, at(Vec3::Zero()), wanted).newtons(), Vec3::Zero()) << "5.25 ms late";
  EXPECT_EQ(g.counters().late_zeroed, 1u);
}

TEST(GovernorRates, AJumpIsASpeedWhateverTheRate) {
  for (const double period_s : {kMs, kPeriod4kS, 0.125e-3}) {
    GovernorOptions options{.period_s = period_s};
    for (const double mm_per_s : {4900.0, 5100.0}) {
      ForceGovernor g = governor(options);
      const double t = rest(g, Vec3::Zero(), Vec3::Zero(), period_s);
      (void)g.govern(t + period_s, at(Vec3{0, mm_per_s * period_s, 0}), Vec3::Zero());
      EXPECT_EQ(g.fault(), mm_per_s > 5000.0 ? Fault::kJump : Fault::kNone) << period_s << " " << mm_per_s;
    }
  }
}

TEST(GovernorRates, AStepOfACoarseDeviceIsNoJump) {
  DeviceLimits coarse = arm_limits();
  coarse.resolution_mm = 1.0;
  GovernorOptions options{.period_s = kPeriod4kS};
  ForceGovernor g = governor(options, coarse);
  double t = rest(g, Vec3::Zero(), Vec3::Zero(), kPeriod4kS);
  t += kPeriod4kS;
  (void)g.govern(t, at(Vec3{1, 1, 1}), Vec3::Zero());
  EXPECT_EQ(g.fault(), Fault::kNone) << "a step along each axis at once";
  (void)g.govern(t + kPeriod4kS, at(Vec3{1, 1, 4.1}), Vec3::Zero());
  EXPECT_EQ(g.fault(), Fault::kJump);
}

// ---- homing

TEST(GovernorHoming, NoForceBeforeItAndASoftStartAfterIt) {
  ForceGovernor g = governor();
  const Vec3 wanted{1, 0, 0};
  g.arm(0.0);
  double t = 0.0;
  for (int i = 0; i < 2000; ++i, t += kMs) {
    ASSERT_EQ(g.govern(t, unhomed_at(Vec3{i % 50 * 1.0, 0, 0}), wanted).newtons(), Vec3::Zero());
    ASSERT_TRUE(g.settling());
  }
  EXPECT_EQ(g.fault(), Fault::kNone) << "counters that jump before homing are no fault";
  int settling = 0;
  double out = 0.0;
  for (int i = 0; i < 700; ++i, t += kMs) {
    out = g.govern(t, at(Vec3{0, 0, 0}), wanted).newtons().x();
    if (g.settling()) ++settling;
    ASSERT_LE(out, std::max(0.0, (i - 48) / 500.0));
  }
  EXPECT_NEAR(settling, 50, 1);
  EXPECT_EQ(out, 1.0);
  EXPECT_EQ(g.govern(t, unhomed_at(Vec3::Zero()), wanted).newtons(), Vec3::Zero());
  EXPECT_EQ(g.fault(), Fault::kHomingLost);
  g.arm(t);
  EXPECT_EQ(g.govern(t, unhomed_at(Vec3::Zero()), wanted).newtons(), Vec3::Zero());
  EXPECT_EQ(g.fault(), Fault::kNone) << "armed again it waits for the homing";
}

TEST(GovernorHoming, NoForceWithoutAnyPosition) {
  ForceGovernor g = governor();
  g.arm(0.0);
  DeviceState none;
  for (int i = 0; i < 20; ++i) EXPECT_EQ(g.govern(i * kMs, none, Vec3{1, 0, 0}).newtons(), Vec3::Zero());
  (void)g.govern(0.021, none, Vec3{1, 0, 0});
  EXPECT_EQ(g.fault(), Fault::kSilence);
}

// ---- faults from elsewhere, stiffness

TEST(GovernorLatch, TheFirstFaultStaysUntilArmed) {
  ForceGovernor g = governor();
  const double t = rest(g, Vec3::Zero(), Vec3{1, 0, 0});
  g.latch(Fault::kStalled);
  g.latch(Fault::kLost);
  EXPECT_EQ(g.fault(), Fault::kStalled);
  EXPECT_EQ(g.counters().faults, 1u);
  EXPECT_EQ(g.govern(t + kMs, at(Vec3::Zero()), Vec3{1, 0, 0}).newtons(), Vec3::Zero());
  g.arm(t + 2 * kMs);
  EXPECT_EQ(g.fault(), Fault::kNone);
}

TEST(SurfaceFits, NamesTheLimitThatAScaledSurfaceBreaks) {
  DeviceLimits limits = arm_limits();
  EXPECT_TRUE(surface_fits(limits, 100.0, 100.0).ok()) << "limits that nobody knows limit nothing";
  limits.stiffness_max_n_per_mm = 1.0;
  limits.damping_max_n_s_per_mm = 0.005;
  EXPECT_TRUE(surface_fits(limits, 1.0, 0.005).ok());
  const Status stiff = surface_fits(limits, 1.2, 0.0);
  ASSERT_FALSE(stiff);
  EXPECT_TRUE(says(stiff.error().what, "stiffness is 1.2"));
  EXPECT_FALSE(stiff.error().remedy.empty());
  EXPECT_FALSE(surface_fits(limits, 0.5, 0.006));
  EXPECT_FALSE(surface_fits(limits, std::nan(""), 0.0));
}

TEST(SurfaceFits, FramesThatAskForMoreAreCounted) {
  DeviceLimits limits = arm_limits();
  limits.stiffness_max_n_per_mm = 1.0;
  for (const double stiffness : {0.9, 3.0}) {
    ForceGovernor g = governor({}, limits);
    double t = rest(g, Vec3::Zero(), Vec3::Zero());
    for (int i = 1; i <= 20; ++i)
      (void)g.govern(t += kMs, at(Vec3{0, 0, -0.2 * i}), Vec3{0, 0, 0.2 * i * stiffness});
    EXPECT_EQ(g.counters().too_stiff, stiffness > 1.0 ? 20u : 0u);
  }
}

}  // namespace
}  // namespace palpate::device
