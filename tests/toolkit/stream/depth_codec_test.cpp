#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <functional>
#include <limits>

#include "tests/toolkit/messages.h"
#include "toolkit/core/random.h"
#include "toolkit/stream/depth_codec.h"

namespace palpate::stream {
namespace {

using palpate::test::refused;

DepthCamera small_camera() {
  DepthCamera camera;
  camera.width = 40;
  camera.height = 30;
  return camera;
}

/// Depths as a camera gives them: a slope with noise of `noise_mm`, holes, and what no camera should give.
DepthFrame noisy_frame(const DepthCamera& camera, double noise_mm) {
  DepthFrame frame;
  frame.number = 0xFFFFFFFF01u;
  frame.captured_s = 12.25;
  frame.arrived_s = 12.5;
  frame.world_from_camera = {Eigen::Quaterniond(0.5, 0.5, -0.5, 0.5), Vec3(1.0, -2.0, 1e9)};
  Random random(7);
  for (std::size_t i = 0; i < camera.pixels(); ++i)
    frame.depth_mm.push_back(i % 13 == 0 ? 0.0f
                                         : static_cast<float>(1000.0 + 0.01 * static_cast<double>(i % 640) +
                                                              noise_mm * random.normal()));
  frame.depth_mm[1] = std::numeric_limits<float>::quiet_NaN();
  frame.depth_mm[2] = -std::numeric_limits<float>::infinity();
  frame.depth_mm[3] = -0.0f;
  return frame;
}

std::vector<std::byte> encoded(DepthCodec& codec, const DepthFrame& frame) {
  const auto bytes = test::value_of(codec.encode(frame));
  return {bytes.begin(), bytes.end()};
}

void expect_same(const DepthFrame& a, const DepthFrame& b) {
  EXPECT_EQ(a.number, b.number);
  EXPECT_EQ(a.captured_s, b.captured_s);
  EXPECT_EQ(a.arrived_s, b.arrived_s);
  EXPECT_EQ(a.world_from_camera.rotation.coeffs(), b.world_from_camera.rotation.coeffs());
  EXPECT_EQ(a.world_from_camera.translation_mm, b.world_from_camera.translation_mm);
  ASSERT_EQ(a.depth_mm.size(), b.depth_mm.size());
  if (a.depth_mm.empty()) return;
  EXPECT_EQ(std::memcmp(a.depth_mm.data(), b.depth_mm.data(), a.depth_mm.size() * sizeof(float)), 0);
}

TEST(DepthCodec, GivesEveryBitBack) {
  const DepthCamera camera = small_camera();
  DepthCodec codec(camera);
  for (const double noise_mm : {0.0, 1e-3, 2.0, 1e6}) {
    DepthFrame frame = noisy_frame(camera, noise_mm), back;
    for (const std::size_t depths : {camera.pixels(), camera.pixels() - 55, std::size_t{3}, std::size_t{0}}) {
      frame.depth_mm.resize(depths);
      ASSERT_TRUE(codec.decode(encoded(codec, frame), back));
      expect_same(frame, back);
    }
  }
}

TEST(DepthCodec, PacksASmoothImage) {
  const DepthCamera camera = small_camera();
  DepthCodec codec(camera);
  DepthFrame frame;
  frame.depth_mm.assign(camera.pixels(), 1000.0f);
  EXPECT_LT(encoded(codec, frame).size(), 400u);
  EXPECT_LT(encoded(codec, noisy_frame(camera, 2.0)).size(), camera.pixels() * sizeof(float) + 400u);
}

TEST(DepthCodec, RefusesEveryTruncationAndEveryChangedByte) {
  const DepthCamera camera = small_camera();
  DepthCodec codec(camera);
  const std::vector<std::byte> good = encoded(codec, noisy_frame(camera, 2.0));
  DepthFrame back;
  const auto damaged = [&](const std::vector<std::byte>& bytes) {
    EXPECT_TRUE(refused(codec.decode(bytes, back), "damaged"));
  };
  test::each_cut(good, good.size(), damaged);
  test::each_flip(good, {0x10}, damaged);
  EXPECT_TRUE(codec.decode(good, back)) << "a damaged one before leaves nothing behind";
}

TEST(DepthCodec, RefusesMoreDepthsThanTheCameraHas) {
  const DepthCamera camera = small_camera();
  DepthCamera large = camera;
  large.width *= 3;
  large.height *= 3;
  DepthCodec codec(camera), other(large);
  const DepthFrame frame = noisy_frame(large, 0.0);
  EXPECT_TRUE(refused(codec.encode(frame), "no camera's"));
  DepthFrame back;
  EXPECT_TRUE(refused(codec.decode(encoded(other, frame), back), "damaged"));
}

TEST(DepthCodec, KeepsTheCamera) {
  DepthCamera camera = small_camera();
  camera.distortion = {0.1, -0.2, 0.003, 0.004, 0.5};
  camera.period_s = 1.0 / 60.0;
  camera.noise_per_mm = 2e-6;
  const std::vector<std::byte> bytes = encode_camera(camera);
  const DepthCamera back = test::value_of(decode_camera(bytes));
  EXPECT_EQ(back.width, camera.width);
  EXPECT_EQ(back.distortion, camera.distortion);
  EXPECT_EQ(back.period_s, camera.period_s);
  EXPECT_EQ(back.noise_per_mm, camera.noise_per_mm);
  const auto damaged = [](const std::vector<std::byte>& wrong) {
    EXPECT_TRUE(refused(decode_camera(wrong), "damaged"));
  };
  test::each_cut(bytes, bytes.size(), damaged);
  test::each_flip(bytes, {0x10}, damaged);
  for (const auto& damage : std::vector<std::function<void(DepthCamera&)>>{
           [](DepthCamera& c) { c.width = 0; }, [](DepthCamera& c) { c.height = 1 << 20; },
           [](DepthCamera& c) { c.fx_px = 0.0; }, [](DepthCamera& c) { c.cy_px = std::nan(""); },
           [](DepthCamera& c) { c.period_s = -1.0; }}) {
    DepthCamera bad = camera;
    damage(bad);
    EXPECT_TRUE(refused(decode_camera(encode_camera(bad)), "damaged"));
  }
}

}  // namespace
}  // namespace palpate::stream
