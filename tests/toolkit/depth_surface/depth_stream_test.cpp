// What a stream does to a renderer besides its surface: bad images, silence, motion of the camera, occlusion,
// memory.
#include <gtest/gtest.h>

#include <algorithm>

#include "tests/house/allocation_count.h"
#include "tests/toolkit/depth_surface/simulated_depth.h"

namespace palpate::depth_surface {

using namespace render;

namespace {

using stream::FrameFate;
using test::SimulatedCamera;
using test::StreamRig;

double flat(const Vec3& o, const Vec3& ray, double) {
  return test::depth_of_plane(o, ray, 0.0);
}
constexpr double kPressedMm = 2.0, kPressedN = StreamRig::kStiffness * kPressedMm;
const Vec3 kAbove(3.0, 2.0, 5.0), kPressed(3.0, 2.0, -kPressedMm);

/// From above to under the plane at 50 mm/s.
Frame press(StreamRig& rig) {
  Frame frame;
  for (int k = 0; k < 40; ++k) (void)rig.step(kAbove);
  for (int k = 0; k <= 140; ++k) frame = rig.step(kAbove + (kPressed - kAbove) * (k / 140.0));
  return frame;
}

TEST(DepthStream, NeedsACamera) {
  StreamRig rig(SimulatedCamera(), flat);
  rig.input().models[0].camera = nullptr;
  Registry registry;
  register_toolkit_renderers(registry);
  const auto renderer = registry.make("depth-image", {}).value();
  const auto decided = renderer->decide(rig.input(), {});
  const auto prepared = renderer->prepare(rig.input(), {});
  ASSERT_FALSE(decided);
  ASSERT_FALSE(prepared);
  EXPECT_EQ(decided.error().message(), prepared.error().message());
  EXPECT_NE(prepared.error().remedy.find("--stream"), std::string::npos);
  EXPECT_FALSE(registry.check_supports(*registry.find("depth-image"), rig.input()));
}

TEST(DepthStream, BadImagesChangeNothing) {
  StreamRig rig(SimulatedCamera(), flat);
  rig.prepare(kAbove);
  ASSERT_NEAR(press(rig).force_n.z(), kPressedN, 1e-3);
  const stream::DepthFrame good = rig.image();
  const auto fate = [&](auto&& spoil) {
    stream::DepthFrame image = good;
    image.number += 1;
    image.captured_s += 0.01;
    for (float& z : image.depth_mm) z -= 20.0F;
    spoil(image);
    return rig.receiver().receive(image, kPressed).fate;
  };
  EXPECT_EQ(fate([&](auto& image) { image.number = good.number; }), FrameFate::kRepeated);
  EXPECT_EQ(fate([&](auto& image) { image.captured_s = good.captured_s - 1.0; }), FrameFate::kLate);
  EXPECT_EQ(fate([](auto& image) { image.depth_mm.pop_back(); }), FrameFate::kTruncated);
  EXPECT_EQ(fate([](auto& image) { image.depth_mm.clear(); }), FrameFate::kTruncated);
  EXPECT_EQ(fate([](auto& image) { image.world_from_camera.translation_mm.x() = test::kNothing; }),
            FrameFate::kTruncated);
  EXPECT_EQ(fate([](auto& image) { image.world_from_camera.rotation.coeffs() *= 2.0; }),
            FrameFate::kTruncated);
  const std::uint64_t swaps = rig.renderer().counters().swaps;
  EXPECT_NEAR(rig.renderer().step(kPressed, rig.time_s() + 1e-3).force_n.z(), kPressedN, 1e-3);
  EXPECT_EQ(rig.renderer().counters().swaps, swaps);
  // One that would be infinite as an inverse depth is none.
  EXPECT_EQ(fate([&](auto& image) {
              image.depth_mm = good.depth_mm;
              for (std::size_t i = 0; i < image.depth_mm.size(); i += 97)
                image.depth_mm[i] = std::numeric_limits<float>::denorm_min();
            }),
            FrameFate::kTaken);
  EXPECT_NEAR(rig.renderer().step(kPressed, rig.time_s() + 2e-3).force_n.z(), kPressedN, 1e-2);
  // Depths that are none are holes.
  EXPECT_EQ(fate([](auto& image) {
              image.number += 1;
              image.captured_s += 0.01;
              for (std::size_t i = 0; i < image.depth_mm.size(); ++i)
                image.depth_mm[i] = i % 3 == 0   ? std::numeric_limits<float>::quiet_NaN()
                                    : i % 3 == 1 ? -5.0F
                                                 : 0.0F;
            }),
            FrameFate::kTaken);
}

TEST(DepthStream, ASilentCameraLeavesItsLastSurface) {
  StreamRig rig(SimulatedCamera(), flat);
  rig.prepare(kAbove);
  (void)press(rig);
  EXPECT_EQ(rig.renderer().counters().stalled_frames, 0u);
  double t = rig.time_s();
  Frame frame;
  for (int k = 0; k < 1000; ++k) frame = rig.renderer().step(kPressed, t += 1e-3);
  EXPECT_NEAR(frame.force_n.z(), kPressedN, 1e-3);
  const std::uint64_t stalled = rig.renderer().counters().stalled_frames;
  EXPECT_GT(stalled, 890u);
  EXPECT_LT(stalled, 935u);
}

TEST(DepthStream, AVanishedSurfaceLetsGoInSteps) {
  bool there = true;
  StreamRig rig(SimulatedCamera(), [&](const Vec3& o, const Vec3& ray, double t) {
    return there ? flat(o, ray, t) : test::depth_of_plane(o, ray, -500.0);
  });
  rig.prepare(kAbove);
  Frame before = press(rig);
  there = false;
  double largest = 0.0;
  int held = 0;
  for (int k = 0; k < 200; ++k) {
    const Frame frame = rig.step(kPressed);
    largest = std::max(largest, (frame.force_n - before.force_n).norm());
    held += frame.contact;
    before = frame;
  }
  EXPECT_FALSE(before.contact);
  EXPECT_GT(held, 40);
  EXPECT_LT(held, 100);
  EXPECT_LT(largest, 0.0275);
}

TEST(DepthStream, AHandBetweenCameraAndSurfaceHidesItForTwoSeconds) {
  bool hand = false;
  StreamRig rig(SimulatedCamera(), [&](const Vec3& o, const Vec3& ray, double t) {
    return hand ? test::depth_of_ball(o, ray, Vec3(0, 0, 200), 60.0) < test::kNothing
                      ? test::depth_of_ball(o, ray, Vec3(0, 0, 200), 60.0)
                      : flat(o, ray, t)
                : flat(o, ray, t);
  });
  rig.prepare(kAbove);
  (void)press(rig);
  hand = true;
  double worst = 0.0;
  for (int k = 0; k < 1500; ++k)
    worst = std::max(worst, std::abs(rig.step(kPressed).force_n.z() - kPressedN));
  EXPECT_LT(worst, 1e-3);
  bool held = true;
  for (int k = 0; k < 1000; ++k) held = rig.step(kPressed).contact;
  EXPECT_FALSE(held);
}

TEST(DepthStream, AMovingCameraSeesTheSameSurface) {
  for (const bool noisy : {false, true}) {
    StreamRig rig(SimulatedCamera(1000.0, noisy), flat);
    rig.prepare(kAbove);
    double worst = 0.0, step = 0.0;
    Vec3 before = Vec3::Zero();
    for (int k = 0; k < 3000; ++k) {
      const double t = 1e-3 * k, turn = 0.05 * std::sin(2.0 * t);
      auto& pose = rig.camera().pose;
      pose.translation_mm =
          Vec3(40.0 * std::sin(3.0 * t), 20.0 * std::sin(2.0 * t), 1000.0 + 30.0 * std::sin(t));
      pose.rotation =
          Eigen::Quaterniond(0.0, 1.0, 0.0, 0.0) * Eigen::AngleAxisd(turn, Vec3(0.3, 0.9, 0.3).normalized());
      const Frame frame = rig.step(k < 500 ? Vec3(kAbove + (kPressed - kAbove) * (k / 500.0)) : kPressed);
      if (k > 1000) {
        worst = std::max(worst, (frame.force_n - Vec3(0, 0, kPressedN)).norm());
        step = std::max(step, (frame.force_n - before).norm());
      }
      before = frame.force_n;
    }
    EXPECT_LT(worst, noisy ? 0.5 : 1e-3);
    EXPECT_LT(step, noisy ? 0.1 : 0.0275);
  }
}

TEST(DepthStream, ALensIsUndone) {
  SimulatedCamera camera;
  camera.camera.distortion = {-0.2, 0.05, 1e-3, -1e-3, 0.0};
  // Seen through the lens: each pixel's ray is where the lens bends it from.
  StreamRig rig(camera, [&](const Vec3& o, const Vec3& ray, double t) { return flat(o, ray, t); });
  rig.prepare(kAbove);
  EXPECT_NEAR(press(rig).force_n.z(), kPressedN, 1e-3) << "a plane across the axis has one depth everywhere";
}

TEST(DepthStream, RunsAreEqual) {
  StreamRig rig(SimulatedCamera(1000.0, true), flat);
  rig.prepare(kAbove);
  std::vector<Vec3> first;
  for (int run = 0; run < 2; ++run) {
    rig.restart(kAbove);
    for (int k = 0; k < 600; ++k) {
      const Vec3 force = rig.step(kAbove + (kPressed - kAbove) * std::min(1.0, k / 200.0)).force_n;
      if (run == 0)
        first.push_back(force);
      else
        ASSERT_EQ(force, first[static_cast<std::size_t>(k)]) << k;
    }
  }
}

TEST(DepthStream, NothingIsAllocatedAndNothingGrows) {
  SimulatedCamera camera;
  camera.make_noisy();
  camera.camera.width = 64;
  camera.camera.height = 48;
  camera.camera.cx_px = 31.5;
  camera.camera.cy_px = 23.5;
  StreamRig rig(camera, flat);
  rig.prepare(kAbove);
  (void)press(rig);
  std::uint64_t blocks = 0;
  Frame frame;
  for (int image = 0; image < 300; ++image) {
    if (image % 100 == 50) rig.camera().pose.translation_mm.x() += 1.0;
    rig.camera().take(flat, rig.time_s() + (image + 1) / 30.0, 1000 + static_cast<std::uint64_t>(image),
                      rig.image());
    const house::AllocationCount count;
    ASSERT_EQ(rig.receiver().receive(rig.image(), kPressed).fate, FrameFate::kTaken);
    for (int k = 0; k < 33; ++k)
      frame = rig.renderer().step(kPressed, rig.time_s() + (image + 1) / 30.0 + 1e-3 * k);
    blocks += count.count();
  }
  EXPECT_EQ(blocks, 0u);
  EXPECT_TRUE(frame.contact);
}

}  // namespace
}  // namespace palpate::depth_surface
