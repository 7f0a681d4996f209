// Rebuilds a surface from every depth image, off the servo. It is first made from the window around the HIP,
// which is felt meanwhile, then from the whole. The frame takes the newest finished one by one exchange.
#pragma once

#include <exception>
#include <functional>
#include <limits>
#include <memory>
#include <utility>

#include <palpate/clock.h>
#include <palpate/depth_stream.h>
#include <palpate/renderer.h>
#include <palpate/triple_buffer.h>
#include "toolkit/render/depth_camera.h"

namespace palpate::baselines {

/// Pixels on each side of the window: at 0.5 m/s and 30 images a second a hand 1 m from a usual camera
/// (f = 525 pixels) crosses 9 pixels between two images, so it is never at the window's rim.
inline constexpr int kDepthWindow = 128;

/// Reach of a contact that is carried over to the next image, in pixels of its depth: 2 m/s at 1 m from a
/// usual camera, 30 images a second.
inline constexpr double kMatchPixels = 35.0;

/// A part of an image, in the model's local coordinates. Refers to the frame; for one call.
struct DepthPatch {
  const render::PixelRays& rays;
  const stream::DepthFrame& frame;
  render::PixelWindow window;
  Mat3 turn = Mat3::Identity();  ///< local from camera
  Vec3 camera_mm = Vec3::Zero();

  /// 0 if the pixel was not measured.
  [[nodiscard]] double depth_mm(std::size_t pixel) const noexcept {
    const float depth = frame.depth_mm[pixel];
    return render::is_measured(depth) ? static_cast<double>(depth) : 0.0;
  }
  [[nodiscard]] Vec3 at(std::size_t pixel, double depth_mm) const noexcept {
    return turn * (depth_mm * rays.ray(pixel)) + camera_mm;
  }
};

/// Belongs to the receiving thread, but for take() and newest(), which are the servo thread's. Makes of T are
/// freed by the receiving thread. The model is taken to rest at its first pose.
template <class T>
class DepthRebuild final : public stream::DepthReceiver {
 public:
  /// Makes what is felt of a patch; null: nothing.
  using Make = std::function<std::shared_ptr<T>(const DepthPatch&)>;

  /// `input` has a camera; `origin_mm`: of the local coordinates, model frame.
  DepthRebuild(const render::ModelInput& input, const Vec3& origin_mm, Make make)
      : rays_(*input.camera),
        gate_(input.camera->pixels()),
        model_from_world_(input.world_from_model.inverse()),
        origin_mm_(origin_mm),
        make_(std::move(make)) {}

  [[nodiscard]] stream::ReceiveReport receive(const stream::DepthFrame& frame,
                                              const Vec3& hip_mm) noexcept override {
    const Stopwatch watch;
    stream::ReceiveReport report;
    report.fate = gate_.judge(frame);
    if (report.fate != stream::FrameFate::kTaken) return report;
    try {
      rebuild(frame, hip_mm, watch, report);
    } catch (const std::exception&) {
      report.fate = stream::FrameFate::kFailed;
    }
    return report;
  }
  void forget_frames() noexcept override {
    gate_.forget();
    publish(nullptr);
  }

  /// Servo: true if there is a newer one than at the last call.
  [[nodiscard]] bool take() noexcept { return newest_.acquire(); }
  /// Servo: the one that was taken, or null.
  [[nodiscard]] T* newest() const noexcept { return newest_.front().get(); }

 private:
  void rebuild(const stream::DepthFrame& frame, const Vec3& hip_mm, const Stopwatch& watch,
               stream::ReceiveReport& report) {
    const geometry::RigidTransform& pose = frame.world_from_camera;
    DepthPatch patch{rays_, frame, rays_.around(pose.inverse() * hip_mm, kDepthWindow)};
    patch.turn = (model_from_world_.rotation * pose.rotation).toRotationMatrix();
    patch.camera_mm = model_from_world_ * pose.translation_mm - origin_mm_;
    const bool in_two = !patch.window.empty() && !patch.window.holds(rays_.whole());
    if (in_two) {
      publish(make_(patch));
      report.window_ms = watch.ms();
    }
    patch.window = rays_.whole();
    publish(make_(patch));
    report.whole_ms = watch.ms();
    if (!in_two) report.window_ms = report.whole_ms;
  }
  void publish(std::shared_ptr<T> made) noexcept {
    newest_.back() = std::move(made);
    newest_.publish();
  }

  render::PixelRays rays_;
  render::FrameGate gate_;
  geometry::RigidTransform model_from_world_;
  Vec3 origin_mm_;
  Make make_;
  TripleBuffer<std::shared_ptr<T>> newest_;
};

}  // namespace palpate::baselines
