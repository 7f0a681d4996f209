// A depth camera of a few lines: depths of planes and balls in closed form, with noise that a seed decides,
// and the loop that a replay of a stream is.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include <palpate/cloud.h>
#include <palpate/depth_stream.h>
#include <palpate/registry.h>
#include <palpate/renderer.h>

namespace palpate::test {

/// The least distance along a unit-z ray of the camera at which something is, in mm of depth; infinite: none.
using Depths = std::function<double(const Vec3& origin, const Vec3& ray, double t_s)>;

inline constexpr double kNothing = std::numeric_limits<double>::infinity();

/// z = height, world.
inline double depth_of_plane(const Vec3& o, const Vec3& ray, double height) {
  const double t = (height - o.z()) / ray.z();
  return t > 0.0 ? t : kNothing;
}
inline double depth_of_ball(const Vec3& o, const Vec3& ray, const Vec3& centre, double radius) {
  const Vec3 to = o - centre;
  const double a = ray.squaredNorm(), b = ray.dot(to), c = to.squaredNorm() - radius * radius;
  const double root = b * b - a * c;
  return root > 0.0 ? (-b - std::sqrt(root)) / a : kNothing;
}

/// A camera at a height over the world's origin that looks down: the middle of a usual one's image.
struct SimulatedCamera {
  stream::DepthCamera camera;
  geometry::RigidTransform pose;
  double noise_per_mm = 0.0;
  std::mt19937 random{1};

  explicit SimulatedCamera(double height_mm = 1000.0, bool noisy = false) {
    camera.width = 160;
    camera.height = 120;
    camera.cx_px = 79.5;
    camera.cy_px = 59.5;
    pose.rotation = Eigen::Quaterniond(0.0, 1.0, 0.0, 0.0);
    pose.translation_mm = Vec3(0.0, 0.0, height_mm);
    if (noisy) make_noisy();
  }
  /// Noise of 2 mm at 1 m, growing with the square.
  void make_noisy() { camera.noise_per_mm = noise_per_mm = 2e-6; }

  void take(const Depths& scene, double t_s, std::uint64_t number, stream::DepthFrame& frame) {
    frame.number = number;
    frame.captured_s = frame.arrived_s = t_s;
    frame.world_from_camera = pose;
    frame.depth_mm.resize(camera.pixels());
    std::normal_distribution<double> normal;
    std::size_t i = 0;
    for (int v = 0; v < camera.height; ++v)
      for (int u = 0; u < camera.width; ++u, ++i) {
        const Vec3 ray((u - camera.cx_px) / camera.fx_px, (v - camera.cy_px) / camera.fy_px, 1.0);
        double z = scene(pose.translation_mm, pose.rotation * ray, t_s);
        if (noise_per_mm > 0.0) z += noise_per_mm * z * z * normal(random);
        frame.depth_mm[i] = std::isfinite(z) ? static_cast<float>(z) : 0.0F;
      }
  }
};

/// A renderer of a stream, stepped at 1 kHz; images come when they are due.
class StreamRig {
 public:
  static constexpr double kTickS = 1e-3;
  static constexpr double kStiffness = 0.5;

  StreamRig(const SimulatedCamera& camera, Depths scene) : camera_(camera), scene_(std::move(scene)) {
    render::register_toolkit_renderers(registry_);
    input_.models.resize(1);
    render::ModelInput& model = input_.models[0];
    model.name = "stream";
    model.cloud = std::make_shared<const cloud::Cloud>();
    model.camera = std::make_shared<const stream::DepthCamera>(camera.camera);
    model.surface.stiffness_n_per_mm = kStiffness;
  }
  render::SceneInput& input() { return input_; }
  SimulatedCamera& camera() { return camera_; }
  stream::DepthFrame& image() { return image_; }
  render::HapticRenderer& renderer() { return *renderer_; }
  stream::DepthReceiver& receiver() { return *renderer_->depth_receiver(); }

  void prepare(const Vec3& hip) {
    auto made = registry_.make("depth-image", {});
    ASSERT_TRUE(made) << made.error().message();
    renderer_ = *std::move(made);
    const auto prepared = renderer_->prepare(input_, {});
    ASSERT_TRUE(prepared) << prepared.error().message();
    ASSERT_NE(renderer_->depth_receiver(), nullptr);
    restart(hip);
  }
  void restart(const Vec3& hip) {
    receiver().forget_frames();
    renderer_->restart(hip, 0.0);
    tick_ = number_ = 0;
    camera_.random.seed(1);
  }
  stream::ReceiveReport receive(const Vec3& hip) {
    camera_.take(scene_, time_s(), number_++, image_);
    return receiver().receive(image_, hip);
  }
  [[nodiscard]] double time_s() const { return kTickS * static_cast<double>(tick_); }

  /// One tick; an image first where one is due.
  render::Frame step(const Vec3& hip) {
    ++tick_;
    if (time_s() >= static_cast<double>(number_) * camera_.camera.period_s) (void)receive(hip);
    return renderer_->step(hip, time_s());
  }

 private:
  SimulatedCamera camera_;
  Depths scene_;
  render::Registry registry_;
  render::SceneInput input_;
  std::unique_ptr<render::HapticRenderer> renderer_;
  stream::DepthFrame image_;
  std::uint64_t tick_ = 0, number_ = 0;
};

/// What a trace's swaps and contacts were like.
struct Felt {
  double swap_step_n = 0.0;     ///< largest change of force in a frame that took a new surface
  double largest_step_n = 0.0;  ///< in any frame
  double worst_error_n = 0.0;   ///< against the truth, where given
  double error_square = 0.0;
  std::size_t frames = 0, contacts = 0, swaps = 0, lost = 0;
};

/// Moves the HIP and compares. `truth(hip, t)`: the force along z, or NaN where none is compared.
inline Felt feel(StreamRig& rig, double seconds, const std::function<Vec3(double)>& hip,
                 const std::function<double(const Vec3&, double)>& truth) {
  Felt felt;
  Vec3 before = Vec3::Zero();
  std::size_t compared = 0;
  for (bool first = true; rig.time_s() < seconds; first = false) {
    const Vec3 at = hip(rig.time_s() + StreamRig::kTickS);
    const std::uint64_t swaps = rig.renderer().counters().swaps;
    const render::Frame frame = rig.step(at);
    const bool swapped = rig.renderer().counters().swaps != swaps;
    const double step = first ? 0.0 : (frame.force_n - before).norm();
    felt.largest_step_n = std::max(felt.largest_step_n, step);
    if (swapped) felt.swap_step_n = std::max(felt.swap_step_n, step);
    felt.swaps += swapped;
    ++felt.frames;
    felt.contacts += frame.contact;
    const double wanted = truth(at, rig.time_s());
    if (!std::isnan(wanted)) {
      const double off = std::abs(frame.force_n.z() - wanted);
      felt.worst_error_n = std::max(felt.worst_error_n, off);
      felt.error_square += off * off;
      ++compared;
      felt.lost += wanted > 0.0 && !frame.contact;
    }
    before = frame.force_n;
  }
  if (compared > 0) felt.error_square /= static_cast<double>(compared);
  return felt;
}

}  // namespace palpate::test
