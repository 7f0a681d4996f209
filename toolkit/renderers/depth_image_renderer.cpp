#include "toolkit/renderers/renderer_infos.h"

#include <fmt/format.h>

#include <algorithm>
#include <memory>
#include <utility>

#include <palpate/result.h>
#include "toolkit/depth_surface/depth_contact.h"
#include "toolkit/depth_surface/depth_image_receiver.h"
#include "toolkit/render/frame_loop_renderer.h"
#include "toolkit/render/prepare.h"
#include "toolkit/render/surface_field.h"
#include "toolkit/render/surface_response.h"

namespace palpate::render {
namespace {

/// 4096 x 4096, ten times a depth camera's: the rasters take 2 GB then.
constexpr int kMostPixels = 1 << 24;

/// The local model of `depth-image`. Its local frame is the images' world, which the model's pose places.
class DepthImageModel {
 public:
  struct Memory {};
  static constexpr bool kTemplatedOnFeatures = true;

  DepthImageModel(const ModelInput& input, SurfaceField surface)
      : pose_(input, Vec3::Zero()),
        surface_(std::move(surface)),
        silent_s_(depth_surface::kStalledPeriods * input.camera->period_s),
        receiver_(*input.camera, pose_.model_from_world),
        contact_(surface_.stiffness_n_per_mm, input.camera->period_s) {}

  [[nodiscard]] ModelPose& pose() noexcept { return pose_; }
  [[nodiscard]] unsigned features() const noexcept { return surface_.features; }
  [[nodiscard]] stream::DepthReceiver* depth_receiver() noexcept { return &receiver_; }
  [[nodiscard]] std::size_t bytes() const noexcept { return receiver_.bytes() + sizeof(*this); }

  void release_contact(const Vec3& h) noexcept {
    contact_.release(h);
    state_.release();
    timed_ = false;
  }
  void release() noexcept { state_.release(); }
  void begin_frame(double t_s) noexcept {
    if (!timed_) taken_s_ = t_s;
    dt_s_ = timed_ ? std::max(0.0, t_s - now_s_) : 0.0;
    timed_ = true;
    now_s_ = t_s;
    swapped_ = receiver_.newest();
    if (swapped_) taken_s_ = t_s;
  }

  template <unsigned kFeatures>
  [[nodiscard]] bool touch(const Vec3& /*goal*/, const Vec3& h, Memory& /*memory*/, SurfaceContact& contact,
                           FrameStatus& status, FrameCounters& counters) noexcept {
    const depth_surface::DepthSheets& sheets = receiver_.sheets();
    counters.swaps += swapped_;
    counters.stalled_frames += sheets.image != 0 && now_s_ - taken_s_ > silent_s_;
    Vec3 pull;
    if (!contact_.step(sheets, swapped_, h, dt_s_, pull, status, counters)) return false;
    contact = uniform_contact(surface_, h, pull);
    return true;
  }
  template <unsigned kFeatures>
  [[nodiscard]] SurfaceResponse respond(const SurfaceContact& contact) noexcept {
    return state_.respond<kFeatures>(contact, surface_.texture, Vec3::Zero());
  }

 private:
  ModelPose pose_;
  SurfaceField surface_;
  double silent_s_;
  depth_surface::DepthImageReceiver receiver_;
  depth_surface::DepthContact contact_;
  SurfaceState state_;
  bool timed_ = false, swapped_ = false;
  double now_s_ = 0.0, dt_s_ = 0.0;
  double taken_s_ = 0.0;  ///< when the last surface was taken
};

class DepthImageRenderer final : public FrameLoopRenderer<DepthImageModel> {
 public:
  static constexpr Features kSupportedFeatures = Feature::kFriction | Feature::kSoftness | Feature::kTexture |
                                                 Feature::kManyModels | Feature::kJointContact;
  // Measured estimate (see kReferenceMachine): the test's hand on a plane, 640 x 480.
  static constexpr double kFrameUs = 0.2;

  explicit DepthImageRenderer(const Options& options) : FrameLoopRenderer(options) {}

  Description describe() const override {
    return {"depth-image", "a surface from depth images, fused over time, with contact that outlives it",
            "ours: B-spline of inverse depth in the camera's raster",
            fmt::format(
                "a model: {} looks along the HIP's way at two layers when free, {} moves of the god object "
                "when held, twice that when a new surface is taken; an image is exchanged in O(1)",
                depth_surface::kMaxDepthSamples, depth_surface::kMaxDepthMoves + 1),
            options_};
  }

 private:
  Result<ModelDecisions> decide_model(const ModelInput& input,
                                      const PrepareContext& /*context*/) const override {
    if (input.camera == nullptr)
      return Error{fmt::format("model '{}' has no depth camera", input.name),
                   "give it a stream of depth images (--stream), or choose heightfield or cloud"};
    const stream::DepthCamera& camera = *input.camera;
    if (!(camera.width > 0 && camera.height > 0 && camera.fx_px > 0.0 && camera.fy_px > 0.0 &&
          camera.period_s > 0.0))
      return Error{fmt::format("the camera of model '{}' has no size, focal length or period", input.name),
                   "give width, height, fx, fy and rate above 0"};
    if (camera.height > kMostPixels / camera.width)
      return Error{fmt::format("the camera of model '{}' has more than {} pixels", input.name, kMostPixels),
                   "give smaller images"};
    PALPATE_ASSIGN(const SurfaceDecision surface, decide_surface(input));
    ModelDecisions out;
    out.name = input.name;
    out.points = camera.pixels();
    out.decisions.push_back(
        {"surface", "depth images",
         fmt::format("a camera of {} x {} pixels, {:.3g} images a second, each fused with those "
                     "before it; nothing is felt before the first",
                     camera.width, camera.height, 1.0 / camera.period_s)});
    describe_surface(input, surface, kSupportedFeatures, camera.pixels(), out);
    out.frame_us = kFrameUs;
    return out;
  }

  Status add_models(const SceneInput& scene, const PrepareContext& context, PrepareReport& report) override {
    PreparePhases phases(report, context);
    phases.begin("set up");
    for (const ModelInput& input : scene.models) {
      PALPATE_ASSIGN(ModelDecisions decided, decide_model(input, context));
      report.decisions.models.push_back(std::move(decided));
      PALPATE_ASSIGN(SurfaceField surface, build_uniform_surface_field(input.surface, report));
      auto model = std::make_unique<DepthImageModel>(input, std::move(surface));
      report.bytes += model->bytes();
      models_.add(std::move(model));
    }
    phases.end();
    return Done{};
  }
};

}  // namespace

RendererInfo depth_image_info() {
  RendererInfo info;
  info.name = "depth-image";
  info.summary = "a surface from a depth camera's images, fused over time";
  info.source = "ours: B-spline of inverse depth in the camera's raster";
  info.role = Role::kOurs;
  info.geometry = Geometry::kImages;
  info.supports = DepthImageRenderer::kSupportedFeatures;
  info.make = [](const Options& options) { return std::make_unique<DepthImageRenderer>(options); };
  return info;
}

}  // namespace palpate::render
