// A servo thread feels while another receives images.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <thread>

#include "tests/toolkit/depth_surface/simulated_depth.h"

namespace palpate::depth_surface {
namespace {

using test::SimulatedCamera;
using test::StreamRig;

TEST(DepthStreamThreads, AServoFeelsWhileImagesCome) {
  SimulatedCamera camera;
  camera.camera.width = 96;
  camera.camera.height = 64;
  camera.camera.cx_px = 47.5;
  camera.camera.cy_px = 31.5;
  StreamRig rig(camera,
                [](const Vec3& o, const Vec3& ray, double) { return test::depth_of_plane(o, ray, 0.0); });
  const Vec3 above(3.0, 2.0, 5.0), pressed(3.0, 2.0, -2.0);
  const double wanted_n = 2.0 * StreamRig::kStiffness;
  rig.prepare(above);
  for (int k = 0; k < 200; ++k) (void)rig.step(above + (pressed - above) * (k / 199.0));
  std::atomic<bool> done{false};
  std::thread images([&] {
    stream::DepthFrame image = rig.image();
    for (int k = 0; k < 80; ++k) {
      image.number += 1;
      image.captured_s += 1.0 / 30.0;
      EXPECT_EQ(rig.receiver().receive(image, pressed).fate, stream::FrameFate::kTaken);
    }
    done = true;
  });
  double worst = 0.0, t = rig.time_s();
  while (!done)
    worst = std::max(worst, std::abs(rig.renderer().step(pressed, t += 1e-3).force_n.z() - wanted_n));
  images.join();
  EXPECT_LT(worst, 1e-3);
  EXPECT_GT(rig.renderer().counters().swaps, 10u);
}

}  // namespace
}  // namespace palpate::depth_surface
