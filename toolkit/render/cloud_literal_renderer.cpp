#include "toolkit/render/cloud_literal_renderer.h"

#include <memory>
#include <vector>

#include "toolkit/core/tolerances.h"
#include "toolkit/render/literal_model.h"

namespace palpate::render {
namespace {

class CloudLiteral final : public HapticRenderer {
 public:
  explicit CloudLiteral(const Options& options) : options_(options) {}

  Result<PrepareReport> prepare(const SceneInput& scene, const PrepareContext& context) override {
    PrepareReport report;
    if (scene.models.empty()) return Error{"the scene has no model", "add a [[model]]", {}, 0};
    const std::string& cells = options_.text("cells");
    LiteralOptions literal;
    literal.cells = cells == "sampled"   ? CellRule::kSampled
                    : cells == "crossed" ? CellRule::kCrossed
                                         : CellRule::kAdjacent;
    literal.text_form = options_.text("exit_test") == "text";
    literal.count_missed = options_.flag("count_missed");
    force_limit_n_ = scene.force_limit_n;
    PointModelOptions o = point_model_options(options_);
    o.normals = false;
    models_.clear();
    motions_.clear();
    for (const ModelInput& input : scene.models) {
      Result<PointModel> built = build_point_model(input, o, context, report);
      if (!built) return std::move(built).error();
      if (built->surface.texture.any())
        report.notes.push_back("texture: not rendered by the literal form, which prints no formula for it");
      const Shading shading = shading_of(*built, report);
      models_.push_back(std::make_unique<LiteralModel>(std::move(*built), shading, literal));
      motions_.push_back(input.motion);
    }
    reset(Vec3::Zero());
    return report;
  }

  void reset(const Vec3& hip_mm) noexcept override {
    now_s_ = 0.0;
    for (std::size_t i = 0; i < models_.size(); ++i) {
      pose(i);
      models_[i]->reset(models_[i]->model().to_local(hip_mm));
    }
    counters_ = {};
  }

  /// Several models: the sum of their forces, since the thesis does not say how they combine.
  Frame step(const Vec3& hip_mm, double dt_s) noexcept override {
    ++counters_.frames;
    now_s_ += dt_s;
    Frame frame;
    if (!is_finite(hip_mm)) {
      frame.status = FrameStatus::kNonFinite;
      return frame;
    }
    frame.god_object_mm = hip_mm;
    double strongest_sq = -1.0;
    for (std::size_t i = 0; i < models_.size(); ++i) {
      pose(i);
      const PointModel& model = models_[i]->model();
      const LiteralAnswer answer = models_[i]->update(model.to_local(hip_mm), counters_);
      if (answer.bound_hit) frame.status = FrameStatus::kBoundHit;
      if (!answer.contact) continue;
      frame.contact = true;
      frame.force_n += model.direction_to_world(answer.force_n);
      if (answer.force_n.squaredNorm() <= strongest_sq) continue;
      strongest_sq = answer.force_n.squaredNorm();
      frame.model = static_cast<std::int32_t>(i);
      frame.god_object_mm = model.to_world(answer.god_object);
    }
    frame.force_n = limited(frame.force_n, force_limit_n_);
    return frame;
  }

  FrameCounters counters() const noexcept override { return counters_; }

  Description describe() const override {
    return {
        "cloud-literal", "chapter 3 as printed", "El-Far, chapter 3, figures 36 and 42",
        "unbounded, as printed: cells crossed times points a cell; the walk is bounded by 64 moves a frame",
        options_};
  }

 private:
  /// Section 3.3.1: the HIP is taken into the model's frame of this instant.
  void pose(std::size_t i) noexcept {
    if (motions_[i] != nullptr) models_[i]->model().set_pose(motions_[i]->newest().at(now_s_));
  }

  Shading shading_of(const PointModel& model, PrepareReport& report) const {
    if (options_.text("shading") != "auto") return parse_shading(options_.text("shading"));
    const bool shade = model.resolution_mm > kLiteralShadingResolutionMm;
    report.notes.push_back(shade ? "shading: area-raw, the resolution is above 0.2 mm"
                                 : "shading: none, the resolution is at most 0.2 mm");
    return shade ? Shading::kAreaRaw : Shading::kNone;
  }

  Options options_;
  std::vector<std::unique_ptr<LiteralModel>> models_;
  std::vector<std::shared_ptr<MovingModel>> motions_;  ///< of each, or null: at rest
  double now_s_ = 0.0;
  double force_limit_n_ = 0.0;
  FrameCounters counters_;
};

}  // namespace

RendererInfo cloud_literal_info() {
  using enum OptionKind;
  RendererInfo info;
  info.name = "cloud-literal";
  info.summary = "chapter 3 of the thesis as printed, defects included";
  info.source = "El-Far, chapter 3, figures 36 and 42";
  info.options = point_model_specs();
  for (OptionSpec& spec : box_test_specs()) info.options.push_back(std::move(spec));
  info.options.push_back(shading_spec("force shading; auto: area-raw above 0.2 mm, else none"));
  info.options.push_back({"cells",
                          kChoice,
                          "sampled",
                          "cells searched: sampled as printed, all crossed, or adjacent ones too",
                          {"sampled", "crossed", "adjacent"}});
  info.options.push_back(
      {"exit_test",
       kChoice,
       "figure",
       "what figure 42 tests on the way out: the sphere (figure) or the god object (text of 3.2.4)",
       {"figure", "text"}});
  info.options.push_back(
      {"count_missed", kFlag, "false", "count cells that the printed sampling skips (slower)", {}});
  info.make = [](const Options& options) { return std::make_unique<CloudLiteral>(options); };
  return info;
}

}  // namespace palpate::render
