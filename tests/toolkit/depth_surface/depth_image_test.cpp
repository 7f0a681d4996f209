// What a hand feels of surfaces from depth images: against the truth, at swaps, at edges, of things that
// move.
#include <gtest/gtest.h>

#include <numbers>

#include "tests/toolkit/depth_surface/simulated_depth.h"

namespace palpate::depth_surface {

using namespace render;

namespace {

using test::Felt;
using test::SimulatedCamera;
using test::StreamRig;

constexpr double kNotCompared = std::numeric_limits<double>::quiet_NaN();
constexpr double kTurn = 2.0 * std::numbers::pi;

double nothing_to_compare(const Vec3&, double) {
  return kNotCompared;
}

double level(const Vec3& o, const Vec3& ray, double) {
  return test::depth_of_plane(o, ray, 0.0);
}
/// Comes down to 2 mm under the plane in half a second, wanders there.
Vec3 pressing(double t) {
  const double down = std::min(1.0, t / 0.5);
  return {20.0 * std::sin(t), 15.0 * std::sin(1.3 * t), 10.0 - 12.0 * down};
}
double under_level(const Vec3& hip, double t) {
  return t < 0.1 ? kNotCompared : StreamRig::kStiffness * std::max(0.0, -hip.z());
}

TEST(DepthImage, APlaneIsExactAndSwapsAreNotFelt) {
  StreamRig rig(SimulatedCamera(), level);
  rig.prepare(pressing(0.0));
  const Felt felt = test::feel(rig, 3.0, pressing, under_level);
  EXPECT_EQ(felt.lost, 0u);
  EXPECT_LT(felt.worst_error_n, 1e-3);
  EXPECT_LT(felt.swap_step_n, 0.0275);
}

TEST(DepthImage, NoiseIsFusedAway) {
  StreamRig rig(SimulatedCamera(1000.0, true), level);
  rig.prepare(pressing(0.0));
  const auto resting = [](double t) { return pressing(std::min(t, 1.0)); };
  const Felt felt = test::feel(
      rig, 4.0, resting, [](const Vec3& h, double t) { return t < 1.0 ? kNotCompared : under_level(h, t); });
  EXPECT_EQ(felt.lost, 0u);
  EXPECT_LT(felt.swap_step_n, 0.1);
}

/// 50 mm at 1 Hz.
double swing(double t) {
  return 50.0 * std::sin(kTurn * t);
}
double swinging_wall(const Vec3& o, const Vec3& ray, double t) {
  return test::depth_of_plane(o, ray, swing(t));
}
constexpr double kMostChangeN = 0.5;  // in a millisecond

TEST(DepthImage, AMovingWallIsHeldByALightHand) {
  for (const bool noisy : {false, true}) {
    StreamRig rig(SimulatedCamera(1000.0, noisy), swinging_wall);
    // A hand that presses with 1 N and gives way by 500 mm/s a newton more: faster than the wall.
    constexpr double kHandN = 1.0, kGivesMmPerS = 500.0;
    Vec3 hip(3.0, 2.0, 30.0);
    rig.prepare(hip);
    Vec3 before = Vec3::Zero();
    double largest = 0.0, lag = 0.0;
    std::size_t lost = 0;
    while (rig.time_s() < 4.0) {
      const Frame frame = rig.step(hip);
      hip.z() += kGivesMmPerS * (frame.force_n.z() - kHandN) * StreamRig::kTickS;
      largest = std::max(largest, (frame.force_n - before).norm());
      before = frame.force_n;
      if (rig.time_s() < 0.5) continue;
      lost += !frame.contact;
      lag = std::max(lag, std::abs(frame.god_object_mm.z() - swing(rig.time_s())));
    }
    EXPECT_EQ(lost, 0u);
    EXPECT_LT(largest, kMostChangeN);
    // It goes on between images, half a period behind on average: 5.3 mm at 314 mm/s. A turn comes 1 mm late.
    EXPECT_LT(lag, noisy ? 7.5 : 6.0);
  }
}

TEST(DepthImage, AWallThatPassesARestingHandTakesItAlong) {
  for (const bool noisy : {false, true}) {
    StreamRig rig(SimulatedCamera(1000.0, noisy), swinging_wall);
    // The wall is under the hand for the first time at 0.5 s, and over it by 45 mm at 1.25 s.
    const Vec3 hip(3.0, 2.0, 5.0);
    rig.prepare(hip);
    const auto resting = [&](double) { return hip; };
    (void)test::feel(rig, 0.9, resting, nothing_to_compare);
    const Felt felt = test::feel(rig, 1.25, resting, [](const Vec3& h, double t) {
      return t < 1.06 ? kNotCompared : StreamRig::kStiffness * (swing(t) - h.z());
    });
    EXPECT_LT(felt.contacts, 240u) << "free while the wall is under the hand, to 1.016 s";
    EXPECT_EQ(felt.lost, 0u);
    EXPECT_LT(felt.largest_step_n, kMostChangeN);
  }
}

TEST(DepthImage, ASurfaceThatComesOverALeavingHandHoldsIt) {
  constexpr double kCameMm = 5.0, kLeavesS = 0.566;  // a tick before the image that shows it
  StreamRig rig(SimulatedCamera(), [](const Vec3& o, const Vec3& ray, double t) {
    return test::depth_of_plane(o, ray, t < 0.55 ? 0.0 : kCameMm);
  });
  // Hardly in touch, then a millimetre out at 100 mm/s.
  const auto hip = [](double t) {
    const double out = std::clamp(100.0 * (t - kLeavesS), 0.0, 1.0);
    return Vec3(3.0, 2.0, t < 0.2 ? 5.0 - 25.1 * t : out - 0.02);
  };
  rig.prepare(hip(0.0));
  const Felt felt = test::feel(rig, 1.0, hip, [](const Vec3& h, double t) {
    return t < 0.65 ? kNotCompared : StreamRig::kStiffness * (kCameMm - h.z());
  });
  EXPECT_EQ(felt.lost, 0u);
  EXPECT_LT(felt.worst_error_n, 1e-2);
}

TEST(DepthImage, AHoleInWhatMovesIsNoPit) {
  // A pixel and its neighbours are blind in every fifth image of the wall.
  StreamRig rig(SimulatedCamera(), [](const Vec3& o, const Vec3& ray, double t) {
    const double z = swinging_wall(o, ray, t);
    const bool blind = static_cast<int>(std::lround(t * 30.0)) % 5 == 0;
    return blind && (z * ray.head<2>() + o.head<2>()).norm() < 3.0 ? test::kNothing : z;
  });
  const auto hip = [](double t) { return Vec3(1.0, 1.5, t < 0.1 ? 5.0 : swing(t - 0.033) - 6.0); };
  rig.prepare(hip(0.0));
  double aside = 0.0;
  while (rig.time_s() < 2.0) {
    const Frame frame = rig.step(hip(rig.time_s() + StreamRig::kTickS));
    if (rig.time_s() > 0.3) aside = std::max(aside, frame.force_n.head<2>().norm());
  }
  EXPECT_LT(aside, 0.05);
}

TEST(DepthImage, NoPoppingThroughAtHalfAMetreASecond) {
  for (const bool noisy : {false, true}) {
    StreamRig rig(SimulatedCamera(1000.0, noisy), level);
    const auto hip = [](double t) {
      const double way = std::fmod(0.5 * t, 0.04), z = 0.01 - std::min(way, 0.04 - way);
      return Vec3(30.0 * std::sin(2.0 * t), 0.0, 1000.0 * z);
    };
    rig.prepare(hip(0.0));
    const Felt felt = test::feel(rig, 4.0, hip, [](const Vec3& h, double t) {
      return t < 0.5 || std::abs(h.z()) < 1.5 ? kNotCompared : under_level(h, t);
    });
    EXPECT_EQ(felt.lost, 0u);
  }
}

TEST(DepthImage, ABallOnATable) {
  const Vec3 centre(0.0, 0.0, 50.0);
  StreamRig rig(SimulatedCamera(), [&](const Vec3& o, const Vec3& ray, double) {
    return std::min(test::depth_of_plane(o, ray, 0.0), test::depth_of_ball(o, ray, centre, 50.0));
  });
  // Around the ball 1 mm under its surface, up to 45 degrees from its top.
  const auto hip = [&](double t) {
    const double a = 0.25 * std::numbers::pi * std::sin(t), b = 3.0 * t, r = t < 0.2 ? 60.0 - 55.0 * t : 49.0;
    return Vec3(centre + r * Vec3(std::sin(a) * std::cos(b), std::sin(a) * std::sin(b), std::cos(a)));
  };
  rig.prepare(hip(0.0));
  double worst = 0.0, square = 0.0;
  std::size_t n = 0;
  while (rig.time_s() < 4.0) {
    const Vec3 at = hip(rig.time_s() + StreamRig::kTickS);
    const Frame frame = rig.step(at);
    if (rig.time_s() < 0.3) continue;
    const Vec3 from = at - centre,
               wanted = from.normalized() * (StreamRig::kStiffness * (50.0 - from.norm()));
    const double off = (frame.force_n - wanted).norm();
    worst = std::max(worst, off);
    square += off * off;
    ++n;
  }
  EXPECT_LT(worst, 0.05);
}

TEST(DepthImage, AThinPartIsAsWideAsItsPixels) {
  // A bar of 6 mm, three pixels, 60 mm over a table.
  StreamRig rig(SimulatedCamera(), [](const Vec3& o, const Vec3& ray, double) {
    const double high = test::depth_of_plane(o, ray, 60.0), x = o.x() + high * ray.x();
    return std::abs(x) < 3.0 ? high : test::depth_of_plane(o, ray, 0.0);
  });
  for (const double x : {-6.0, -2.2, 0.0, 2.2, 6.0}) {
    const auto hip = [&](double t) { return Vec3(x, 4.0 * std::sin(t), 62.0 - 4.0 * std::min(1.0, t)); };
    if (x < -5.0) rig.prepare(hip(0.0));
    rig.restart(hip(0.0));
    Frame frame;
    while (rig.time_s() < 2.0) frame = rig.step(hip(rig.time_s() + StreamRig::kTickS));
    EXPECT_NEAR(frame.force_n.z(), std::abs(x) < 3.0 ? StreamRig::kStiffness * 2.0 : 0.0, 1e-2) << x;
  }
}

TEST(DepthImage, AStepIsNoWall) {
  // Left of x = 0 a table 100 mm higher.
  const auto step = [](const Vec3& o, const Vec3& ray, double) {
    const double high = test::depth_of_plane(o, ray, 100.0);
    return o.x() + high * ray.x() < 0.0 ? high : test::depth_of_plane(o, ray, 0.0);
  };
  StreamRig rig(SimulatedCamera(), step);
  // Between the two heights from right to left, far under the higher one, and back: nothing is there.
  const auto hip = [](double t) { return Vec3(40.0 * std::cos(3.0 * t), 5.0, 50.0); };
  rig.prepare(hip(0.0));
  Felt felt = test::feel(rig, 3.0, hip, nothing_to_compare);
  EXPECT_EQ(felt.contacts, 0u);
  // On the higher one to a pixel before its edge.
  const auto on_it = [](double t) {
    return Vec3(-4.0 - 30.0 * std::abs(std::sin(t)), 5.0, t < 0.2 ? 105.0 - 32.0 * t : 98.6);
  };
  rig.restart(on_it(0.0));
  felt = test::feel(rig, 3.0, on_it, [](const Vec3& h, double t) {
    return t < 0.3 ? kNotCompared : StreamRig::kStiffness * (100.0 - h.z());
  });
  EXPECT_EQ(felt.lost, 0u);
  EXPECT_LT(felt.worst_error_n, 1e-2);
}

TEST(DepthImage, WhatStandsOnATableHoldsWhoSlidesAgainstItUntilItsTopIsNearer) {
  constexpr double kTopMm = 20.0;  // steeper than any one surface shows
  StreamRig rig(SimulatedCamera(), [](const Vec3& o, const Vec3& ray, double) {
    const double high = test::depth_of_plane(o, ray, kTopMm);
    return o.x() + high * ray.x() < 0.0 ? high : test::depth_of_plane(o, ray, 0.0);
  });
  constexpr double kDeepMm = 2.0, kPixelMm = 2.0;
  double x = 30.0, largest = 0.0;
  const auto hip = [&] { return Vec3(x, 5.0, rig.time_s() < 0.1 ? 5.0 : -kDeepMm); };
  rig.prepare(hip());
  Frame frame, before;
  const auto slide = [&](double to) {
    for (; x > to; x -= 0.1) {
      frame = rig.step(hip());
      if (rig.time_s() > 0.2) largest = std::max(largest, (frame.force_n - before.force_n).norm());
      before = frame;
    }
  };
  slide(-5.0);
  EXPECT_NEAR(frame.force_n.x(), StreamRig::kStiffness * 5.0, StreamRig::kStiffness * kPixelMm);
  EXPECT_NEAR(frame.force_n.z(), StreamRig::kStiffness * kDeepMm, 0.1);
  slide(-60.0);
  EXPECT_NEAR(frame.force_n.x(), 0.0, 1e-2);
  EXPECT_NEAR(frame.force_n.z(), StreamRig::kStiffness * (kTopMm + kDeepMm), 1e-2);
  EXPECT_LT(largest, 0.55);
}

}  // namespace
}  // namespace palpate::depth_surface
