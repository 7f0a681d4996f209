// What a hand feels of surfaces from depth images: against the truth, at swaps, at edges, of things that
// move.
#include <gtest/gtest.h>

#include <cstdio>
#include <numbers>

#include "tests/toolkit/depth_surface/simulated_depth.h"

namespace palpate::render {
namespace {

using test::Felt;
using test::SimulatedCamera;
using test::StreamRig;

constexpr double kNotCompared = std::numeric_limits<double>::quiet_NaN();
constexpr double kTurn = 2.0 * std::numbers::pi;

double nothing_to_compare(const Vec3&, double) {
  return kNotCompared;
}
void say(const char* what, const Felt& f) {
  std::printf(
      "%s: swap step %.4f N, largest step %.4f N, error rms %.4f worst %.4f N, contact %zu of %zu, lost %zu, "
      "swaps %zu\n",
      what, f.swap_step_n, f.largest_step_n, std::sqrt(f.error_square), f.worst_error_n, f.contacts, f.frames,
      f.lost, f.swaps);
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
  say("plane", felt);
  EXPECT_EQ(felt.lost, 0u);
  EXPECT_LT(felt.worst_error_n, 1e-3);
  EXPECT_LT(felt.swap_step_n, 0.0275);
}

TEST(DepthImage, NoiseIsFusedAway) {
  SimulatedCamera camera;
  camera.make_noisy();
  StreamRig rig(camera, level);
  rig.prepare(pressing(0.0));
  const auto resting = [](double t) { return pressing(std::min(t, 1.0)); };
  const Felt felt = test::feel(
      rig, 4.0, resting, [](const Vec3& h, double t) { return t < 1.0 ? kNotCompared : under_level(h, t); });
  say("noisy plane", felt);
  EXPECT_EQ(felt.lost, 0u);
  EXPECT_LT(felt.swap_step_n, 0.1);
}

/// 50 mm at 1 Hz, and a hand that stays 2 mm in front of where it is at its middle.
double swing(double t) {
  return 50.0 * std::sin(kTurn * t);
}

TEST(DepthImage, AMovingWallPushesAtItsSpeed) {
  for (const bool noisy : {false, true}) {
    SimulatedCamera camera;
    if (noisy) camera.make_noisy();
    StreamRig rig(camera, [](const Vec3& o, const Vec3& ray, double t) {
      return test::depth_of_plane(o, ray, swing(t));
    });
    // The hand gives way: it stays 5 mm under the wall of a moment ago.
    const auto hip = [](double t) {
      return Vec3(0.0, 0.0,
                  t < 0.3 ? 60.0 - 200.0 * std::max(0.0, t - 0.25)
                          : swing(t - 0.06) - 5.0 + 55.0 * std::exp(-(t - 0.3) * 10));
    };
    rig.prepare(hip(0.0));
    const Felt felt = test::feel(rig, 4.0, hip, nothing_to_compare);
    say(noisy ? "noisy wall" : "wall", felt);
    EXPECT_LT(felt.largest_step_n, 0.5);
  }
}

TEST(DepthImage, NoPoppingThroughAtHalfAMetreASecond) {
  for (const bool noisy : {false, true}) {
    SimulatedCamera camera;
    if (noisy) camera.make_noisy();
    StreamRig rig(camera, level);
    const auto hip = [](double t) {
      const double way = std::fmod(0.5 * t, 0.04), z = 0.01 - std::min(way, 0.04 - way);
      return Vec3(30.0 * std::sin(2.0 * t), 0.0, 1000.0 * z);
    };
    rig.prepare(hip(0.0));
    const Felt felt = test::feel(rig, 4.0, hip, [](const Vec3& h, double t) {
      return t < 0.5 || std::abs(h.z()) < 1.5 ? kNotCompared : under_level(h, t);
    });
    say("fast hand", felt);
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
  std::printf("ball: rms %.4f worst %.4f N\n", std::sqrt(square / double(n)), worst);
  EXPECT_LT(worst, 0.05);
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
  say("step", felt);
  EXPECT_EQ(felt.contacts, 0u);
  // On the higher one to a pixel before its edge.
  const auto on_it = [](double t) {
    return Vec3(-4.0 - 30.0 * std::abs(std::sin(t)), 5.0, t < 0.2 ? 105.0 - 32.0 * t : 98.6);
  };
  rig.restart(on_it(0.0));
  felt = test::feel(rig, 3.0, on_it, [](const Vec3& h, double t) {
    return t < 0.3 ? kNotCompared : StreamRig::kStiffness * (100.0 - h.z());
  });
  say("rim", felt);
  EXPECT_EQ(felt.lost, 0u);
  EXPECT_LT(felt.worst_error_n, 1e-2);
}

TEST(DepthImage, Times) {
  SimulatedCamera camera;
  camera.make_noisy();
  StreamRig rig(camera, level);
  const Vec3 hip(0.0, 0.0, 10.0);
  rig.prepare(hip);
  for (int k = 0; k < 24; ++k) {
    if (k >= 16) rig.camera().pose.translation_mm.x() += 1.0;
    for (int tick = 0; tick < 33; ++tick) (void)rig.renderer().step(hip, rig.time_s());
    const auto r = rig.receive_next(hip);
    std::printf("%.2f/%.2f ", r.window_ms, r.whole_ms);
  }
  std::printf("ms window/whole\n");
}

}  // namespace
}  // namespace palpate::render
