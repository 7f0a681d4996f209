// Rivals that take depth images: what is felt of a still and of a moving surface, frames that are no use,
// depth edges, and two threads.
#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <functional>
#include <memory>
#include <new>
#include <string>
#include <thread>
#include <vector>

#include "baselines/renderers/depth_rebuild.h"
#include "baselines/renderers/mesh_body.h"
#include "tests/baselines/small_models.h"
#include "tests/house/allocation_count.h"
#include "tests/toolkit/messages.h"

namespace palpate::baselines {
namespace {

using test::kStiffness;
using test::Probe;

/// Depth that the camera sees along a ray (x, y, 1); 0: nothing.
using Seen = std::function<double(const Vec3& ray)>;

/// A camera at the origin that looks along z at what is 1 m away: pixels of 2 mm, and larger than the window.
stream::DepthCamera small_camera() {
  stream::DepthCamera camera;
  camera.width = 200;
  camera.height = 160;
  camera.fx_px = camera.fy_px = 500.0;
  camera.cx_px = 99.5;
  camera.cy_px = 79.5;
  return camera;
}

Seen plane_at(double z_mm) {
  return [z_mm](const Vec3&) { return z_mm; };
}
const Seen kNothing = plane_at(0.0);
/// Before and behind a plane 1 m away.
const Vec3 kAbove{3, 4, 960}, kInside{3, 4, 1005};

stream::DepthFrame image_of(const stream::DepthCamera& camera, const Seen& seen, std::uint64_t number) {
  stream::DepthFrame frame;
  frame.number = number;
  frame.captured_s = frame.arrived_s = static_cast<double>(number) * camera.period_s;
  const render::PixelRays rays(camera);
  for (std::size_t i = 0; i < camera.pixels(); ++i)
    frame.depth_mm.push_back(static_cast<float>(seen(rays.ray(i))));
  return frame;
}

/// A renderer of a stream whose first frame was `seen`; no image has come yet.
struct Rig {
  stream::DepthCamera camera = small_camera();
  Probe probe;
  std::uint64_t images = 0;

  Rig(const std::string& options, const Seen& seen) {
    std::vector<Vec3> points;
    const stream::DepthFrame first = image_of(camera, seen, 0);
    const render::PixelRays rays(camera);
    for (std::size_t i = 0; i < camera.pixels(); ++i)
      if (render::is_measured(first.depth_mm[i])) points.push_back(double{first.depth_mm[i]} * rays.ray(i));
    render::ModelInput model = test::model_of(points);
    model.camera = std::make_shared<const stream::DepthCamera>(camera);
    probe = test::prepare(model, options);
  }
  [[nodiscard]] stream::DepthReceiver& receiver() const { return *probe.renderer.get()->depth_receiver(); }
  stream::ReceiveReport show(const Seen& seen, const Vec3& hip) {
    return receiver().receive(image_of(camera, seen, images++), hip);
  }
  /// From above into a plane 1 m away, once it is shown.
  void press() {
    (void)show(plane_at(1000.0), kAbove);
    (void)probe.press(kAbove, kInside, 0.5);
  }
};

constexpr const char* kMesh = "mesh-godobject";
constexpr const char* kProxy = "stream-proxy";
/// Error of the felt depth in mm: a mesh through the pixels of a plane is that plane, up to the pixels' float
/// depths; a proxy among noiseless points 2 mm apart rests within a fortieth of their distance.
double allowed_mm(const std::string& rival) {
  return rival == kMesh ? 1e-3 : 0.05;
}

class Streams : public testing::TestWithParam<const char*> {};
INSTANTIATE_TEST_SUITE_P(Rivals, Streams, testing::Values(kMesh, kProxy), [](const auto& rival) {
  return rival.param == std::string(kMesh) ? "Mesh" : "Proxy";
});

TEST(DepthRebuilds, WithoutMemoryTheLastSurfaceStays) {
  const stream::DepthCamera camera = small_camera();
  render::ModelInput model = test::model_of(std::vector<Vec3>{Vec3(0, 0, 1000)});
  model.camera = std::make_shared<const stream::DepthCamera>(camera);
  bool memory = true;
  DepthRebuild<int> rebuild(model, Vec3::Zero(), [&](const DepthPatch&) {
    if (!memory) throw std::bad_alloc();
    return std::make_shared<int>(7);
  });
  const Vec3 hip(0, 0, 960);
  EXPECT_EQ(rebuild.receive(image_of(camera, plane_at(1000.0), 0), hip).fate, stream::FrameFate::kTaken);
  ASSERT_TRUE(rebuild.take());
  memory = false;
  EXPECT_EQ(rebuild.receive(image_of(camera, plane_at(1000.0), 1), hip).fate, stream::FrameFate::kFailed);
  EXPECT_FALSE(rebuild.take());
  ASSERT_NE(rebuild.newest(), nullptr);
  EXPECT_EQ(*rebuild.newest(), 7);
}

TEST_P(Streams, AHeldContactFollowsASurfaceThatComesAndGoes) {
  Rig rig(GetParam(), plane_at(1000.0));
  rig.press();
  // 50 mm a second at 30 images a second, to the user and away again.
  for (int image = 1; image <= 12; ++image) {
    const double z_mm = 1000.0 - (image <= 6 ? image : 12 - image) * 50.0 / 30.0;
    (void)rig.show(plane_at(z_mm), kInside);
    render::Frame frame;
    for (int tick = 0; tick < 33; ++tick) frame = rig.probe.to(kInside);
    ASSERT_TRUE(frame.contact) << image;
    EXPECT_NEAR(frame.force_n.z(), -kStiffness * (1005.0 - z_mm), kStiffness * allowed_mm(GetParam()))
        << image;
  }
  EXPECT_GE(rig.probe.renderer->counters().swaps, 12u);
}

TEST_P(Streams, FramesThatAreNoUseChangeNothing) {
  Rig rig(GetParam(), plane_at(1000.0));
  rig.images = 5;
  (void)rig.show(plane_at(1000.0), kAbove);
  const render::Frame before = rig.probe.press(kAbove, kInside, 0.5);
  const std::uint64_t swaps = rig.probe.renderer->counters().swaps;
  EXPECT_EQ(rig.receiver().receive(image_of(rig.camera, plane_at(900.0), 5), kInside).fate,
            stream::FrameFate::kRepeated);
  EXPECT_EQ(rig.receiver().receive(image_of(rig.camera, plane_at(900.0), 4), kInside).fate,
            stream::FrameFate::kLate);
  stream::DepthFrame cut = image_of(rig.camera, plane_at(900.0), 6);
  cut.depth_mm.pop_back();
  EXPECT_EQ(rig.receiver().receive(cut, kInside).fate, stream::FrameFate::kTruncated);
  cut = image_of(rig.camera, plane_at(900.0), 6);
  cut.world_from_camera.translation_mm.x() = std::nan("");
  EXPECT_EQ(rig.receiver().receive(cut, kInside).fate, stream::FrameFate::kTruncated);
  EXPECT_EQ(rig.probe.to(kInside).force_n, before.force_n);
  EXPECT_EQ(rig.probe.renderer->counters().swaps, swaps);
}

TEST_P(Streams, WhatIsNotMeasuredIsFreeUntilItIsMeasuredAgain) {
  Rig rig(GetParam(), plane_at(1000.0));
  (void)rig.show(kNothing, kAbove);
  EXPECT_FALSE(rig.probe.press(kAbove, kInside, 0.5).contact);
  (void)rig.show(plane_at(1000.0), kAbove);
  EXPECT_TRUE(rig.probe.press(kAbove, kInside, 0.5).contact);
  (void)rig.show(kNothing, kAbove);
  EXPECT_FALSE(rig.probe.to(kInside).contact);
}

TEST_P(Streams, AWholeImageIsFeltBesideTheWindow) {
  Rig rig(GetParam(), plane_at(1000.0));
  const Vec3 seen_at{3, 4, 960}, above{190, 150, 960};  // the image's corner, past the window's rim
  (void)rig.show(plane_at(1000.0), seen_at);
  EXPECT_TRUE(rig.probe.press(above, above + Vec3(0, 0, 45), 0.5).contact);
  // A hand that the camera does not see.
  const stream::ReceiveReport report = rig.show(plane_at(1000.0), {0, 0, -10});
  EXPECT_EQ(report.window_ms, report.whole_ms);
  EXPECT_GT(report.whole_ms, 0.0);
}

TEST_P(Streams, ThePoseOfTheCameraPlacesTheSurface) {
  Rig rig(GetParam(), plane_at(1000.0));
  stream::DepthFrame frame = image_of(rig.camera, plane_at(1000.0), 0);
  frame.world_from_camera.translation_mm = {0, 0, 20};
  const Vec3 above{3, 4, 990}, inside{3, 4, 1025};
  (void)rig.receiver().receive(frame, above);
  const render::Frame felt = rig.probe.press(above, inside, 0.5);
  EXPECT_NEAR(felt.force_n.z(), -kStiffness * 5.0, kStiffness * allowed_mm(GetParam()));
}

TEST_P(Streams, AReplayBeginsWithoutEarlierImages) {
  Rig rig(GetParam(), plane_at(1000.0));
  const auto replay = [&] {
    rig.receiver().forget_frames();
    rig.images = 0;
    rig.probe.renderer->restart(kAbove);
    Vec3 sum = Vec3::Zero();
    for (int image = 0; image < 3; ++image) {
      (void)rig.show(plane_at(1000.0 - image), kInside);
      sum += rig.probe.glide(kAbove, kInside, 0.5).force_n * (1.0 + image);
    }
    return sum;
  };
  const Vec3 first = replay();
  EXPECT_LT(first.z(), -1.0);
  EXPECT_EQ(replay(), first);
}

TEST_P(Streams, FramesAllocateNothingWhileImagesCome) {
  Rig rig(GetParam(), plane_at(1000.0));
  rig.press();
  std::uint64_t blocks = 0;
  for (int image = 0; image < 4; ++image) {
    (void)rig.show(image == 2 ? kNothing : plane_at(1000.0 - image), kInside);
    const house::AllocationCount counted;
    for (int tick = 0; tick < 5; ++tick) (void)rig.probe.to(kInside);
    blocks += counted.count();
  }
  EXPECT_EQ(blocks, 0u);
}

/// One thread takes images of a wall that comes and goes while another presses on it.
TEST_P(Streams, ImagesAndFramesRunInTwoThreads) {
  Rig rig(GetParam(), plane_at(1000.0));
  rig.press();
  std::atomic<bool> done{false};
  std::thread camera([&] {
    for (int image = 0; image < 30; ++image) (void)rig.show(plane_at(1000.0 - (image % 3)), kInside);
    done = true;
  });
  int held = 0, frames = 0;
  bool finite = true;
  while (!done || frames < 1000) {
    const render::Frame frame = rig.probe.to(kInside);
    finite = finite && is_finite(frame.force_n) && frame.force_n.norm() < kStiffness * 20.0;
    held += frame.contact;
    ++frames;
  }
  camera.join();
  EXPECT_TRUE(finite);
  EXPECT_EQ(held, frames);
  EXPECT_GE(rig.probe.renderer->counters().swaps, 1u);
}

/// Before a wall stands a box whose right side the camera sees at x = 0.
double box_before_wall(const Vec3& ray) {
  return ray.x() < 0.0 ? 900.0 : 1000.0;
}

TEST(StreamMesh, DepthEdgesAreNoWalls) {
  Rig rig(kMesh, box_before_wall);
  (void)rig.show(box_before_wall, {10, 0, 800});
  // Along the wall's front, past the box's side, and behind the box: only air until the wall.
  (void)rig.probe.press({10, 0, 800}, {10, 0, 950}, 0.5);
  EXPECT_FALSE(rig.probe.glide({10, 0, 950}, {-30, 0, 950}, 0.5).contact);
  EXPECT_TRUE(rig.probe.press({-30, 0, 800}, {-30, 0, 903}, 0.5).contact);
  EXPECT_TRUE(rig.probe.press({30, 0, 800}, {30, 0, 1003}, 0.5).contact);
}

TEST(StreamMesh, AWallThatPassesARestingHandMeetsIt) {
  Rig rig(kMesh, plane_at(1000.0));
  const Vec3 hand{3, 4, 998};
  (void)rig.show(plane_at(1000.0), hand);
  EXPECT_FALSE(rig.probe.press({3, 4, 960}, hand, 0.5).contact);
  (void)rig.show(plane_at(990.0), hand);
  const render::Frame frame = rig.probe.to(hand);
  ASSERT_TRUE(frame.contact);
  EXPECT_NEAR(frame.force_n.z(), -kStiffness * 8.0, kStiffness * 1e-3);
}

TEST(StreamMesh, NoiseLeavesNoHoles) {
  stream::DepthCamera camera = small_camera();
  camera.noise_per_mm = 2e-6;  // 2 mm at 1 m
  Random random(3);
  const stream::DepthFrame frame = image_of(
      camera, [&](const Vec3&) { return 1000.0 + 2.0 * random.normal(); }, 0);
  const render::PixelRays rays(camera);
  const RasterSheet sheet = sheet_of({rays, frame, rays.whole()});
  const auto squares = std::count(sheet.square.begin(), sheet.square.end(), 1);
  EXPECT_GT(static_cast<double>(squares), 0.999 * 199 * 159);
}

/// The raster's mesh is the one that the general way makes of the same triangles.
TEST(StreamMesh, NeighboursAreThoseOfTheSameTriangles) {
  const stream::DepthCamera camera = small_camera();
  const stream::DepthFrame frame = image_of(
      camera, [](const Vec3& ray) { return ray.squaredNorm() > 1.02 ? 0.0 : box_before_wall(ray); }, 0);
  const render::PixelRays rays(camera);
  const SurfaceMesh fast = SurfaceMesh::of_raster(sheet_of({rays, frame, rays.whole()}), Vec3::Zero());
  const auto general = SurfaceMesh::build(fast.as_mesh(), 1, MeshOrder::kGiven, MeshFrame::kWorld);
  ASSERT_TRUE(general.ok());
  ASSERT_EQ(fast.facets().size(), general->facets().size());
  ASSERT_GT(fast.facets().size(), 1000u);
  std::size_t different = 0;
  for (std::uint32_t f = 0; f < fast.facets().size(); ++f) {
    for (std::uint32_t e = 0; e < 3; ++e)
      for (std::uint32_t side = 0; side < 2; ++side)
        different += fast.neighbour(half_facet(f, side), e) != general->neighbour(half_facet(f, side), e);
    for (const std::uint32_t v : fast.facet(f).vertex) {
      const auto ours = fast.star(v), theirs = general->star(v);
      different += !std::equal(ours.begin(), ours.end(), theirs.begin(), theirs.end());
    }
    // Facing the camera.
    different += !(fast.normal(half_facet(f, 0)).z() < 0.0);
  }
  EXPECT_EQ(different, 0u);
}

TEST(StreamMesh, WhatCannotBeDoneForEveryImageIsRefused) {
  Rig rig(kMesh, plane_at(1000.0));
  render::ModelInput model = test::model_of(test::flat_points(20, 2.0));
  model.camera = std::make_shared<const stream::DepthCamera>(rig.camera);
  for (const char* options : {"mesh-proxy", "mesh-godobject:repair=true",
                              "mesh-godobject:mesh=advancing-front", "mesh-godobject:crossings=true"})
    EXPECT_FALSE(test::refusal(options, test::scene_of(model)).what.empty()) << options;
}

}  // namespace
}  // namespace palpate::baselines
