#include "toolkit/depth_surface/depth_image_receiver.h"

#include <algorithm>
#include <cmath>

#include <palpate/clock.h>

namespace palpate::depth_surface {

DepthImageReceiver::DepthImageReceiver(const stream::DepthCamera& camera,
                                       const geometry::RigidTransform& local_from_world)
    : camera_(camera),
      local_from_world_(local_from_world),
      gate_(camera.pixels()),
      fusion_(camera),
      newest_(camera),
      published_(newest_) {}

std::size_t DepthImageReceiver::bytes() const noexcept {
  constexpr std::size_t kSurfaces = 4;
  return fusion_.bytes() + kSurfaces * newest_.bytes();
}

stream::ReceiveReport DepthImageReceiver::receive(const stream::DepthFrame& frame,
                                                  const Vec3& hip_mm) noexcept {
  stream::ReceiveReport report;
  report.fate = gate_.judge(frame);
  if (report.fate != stream::FrameFate::kTaken) return report;
  const Stopwatch watch;
  fusion_.begin(frame, newest_);
  const DepthPlace at = newest_.place(newest_.to_camera(local_from_world_ * hip_mm));
  if (at.pixel != 0) {
    const int u = static_cast<int>(at.u) - kFirstWindow / 2, v = static_cast<int>(at.v) - kFirstWindow / 2;
    fusion_.update(frame,
                   {std::max(0, u), std::max(0, v), std::min(camera_.width, u + kFirstWindow),
                    std::min(camera_.height, v + kFirstWindow)},
                   newest_);
    publish();
    report.window_ms = watch.ms();
  }
  fusion_.update(frame, {0, 0, camera_.width, camera_.height}, newest_);
  fusion_.finish();
  publish();
  report.whole_ms = watch.ms();
  if (at.pixel == 0) report.window_ms = report.whole_ms;
  return report;
}

/// Outside the window the last image's pixels stay until the whole is there, farther from the HIP than it
/// goes in that time.
void DepthImageReceiver::publish() noexcept {
  published_.back() = newest_;  // equal sizes: no allocation
  published_.publish();
}

void DepthImageReceiver::forget_frames() noexcept {
  gate_.forget();
  fusion_.forget();
  for (std::vector<float>* layer : {&newest_.front, &newest_.rate, &newest_.hidden})
    std::fill(layer->begin(), layer->end(), 0.0F);
  newest_.image = 0;
  publish();
}

}  // namespace palpate::depth_surface
