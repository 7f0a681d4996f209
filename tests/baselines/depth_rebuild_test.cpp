// What is made of depth images changes hands without a lock: one thread makes, another reads.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <memory>
#include <thread>
#include <vector>

#include "baselines/renderers/depth_rebuild.h"

namespace palpate::baselines {
namespace {

/// All depths of a patch, which are equal in every image here.
struct Depths {
  std::vector<double> mm;
  render::PixelWindow window;
};

std::shared_ptr<Depths> depths_of(const DepthPatch& patch) {
  auto made = std::make_shared<Depths>();
  made->window = patch.window;
  for (int row = patch.window.first_row; row < patch.window.last_row; ++row)
    for (int column = patch.window.first_column; column < patch.window.last_column; ++column)
      made->mm.push_back(patch.depth_mm(patch.rays.index(column, row)));
  return made;
}

struct Rig {
  render::ModelInput model;
  Rig() {
    auto camera = std::make_shared<stream::DepthCamera>();
    camera->width = 320;
    camera->height = 240;
    camera->cx_px = 159.5;
    camera->cy_px = 119.5;
    model.camera = camera;
  }
  [[nodiscard]] stream::DepthFrame image(std::uint64_t number) const {
    stream::DepthFrame frame;
    frame.number = number;
    frame.captured_s = frame.arrived_s = static_cast<double>(number);
    frame.depth_mm.assign(model.camera->pixels(), 1000.0F + static_cast<float>(number));
    return frame;
  }
};

TEST(DepthRebuild, TheWindowComesBeforeTheWhole) {
  const Rig rig;
  std::vector<render::PixelWindow> made;
  DepthRebuild<Depths> images(rig.model, Vec3::Zero(), [&](const DepthPatch& patch) {
    made.push_back(patch.window);
    return depths_of(patch);
  });
  (void)images.receive(rig.image(0), {0, 0, 900});
  ASSERT_EQ(made.size(), 2u);
  EXPECT_EQ(made[0].columns(), kDepthWindow);
  EXPECT_EQ(made[0].rows(), kDepthWindow);
  EXPECT_EQ(made[1].columns(), 320);
  // Nobody sees the hand: there is no window.
  (void)images.receive(rig.image(1), {0, 0, -900});
  EXPECT_EQ(made.size(), 3u);
  ASSERT_TRUE(images.take());
  EXPECT_EQ(images.newest()->mm.front(), 1001.0);
  images.forget_frames();
  ASSERT_TRUE(images.take());
  EXPECT_EQ(images.newest(), nullptr);
}

TEST(DepthRebuildThreads, TheReaderSeesWholeImagesInOrder) {
  const Rig rig;
  DepthRebuild<Depths> images(rig.model, Vec3::Zero(), depths_of);
  constexpr std::uint64_t kImages = 60;
  std::atomic<bool> done{false};
  std::thread camera([&] {
    for (std::uint64_t i = 0; i < kImages; ++i) (void)images.receive(rig.image(i), {0, 0, 900});
    done = true;
  });
  double last_mm = 0.0;
  bool whole = true, in_order = true;
  const auto look = [&] {
    if (!images.take()) return;
    const Depths& seen = *images.newest();
    whole = whole && std::all_of(seen.mm.begin(), seen.mm.end(), [&](double mm) { return mm == seen.mm[0]; });
    in_order = in_order && seen.mm[0] >= last_mm;
    last_mm = seen.mm[0];
  };
  while (!done) look();
  camera.join();
  look();
  EXPECT_TRUE(whole);
  EXPECT_TRUE(in_order);
  EXPECT_EQ(last_mm, 1000.0 + kImages - 1);
}

}  // namespace
}  // namespace palpate::baselines
