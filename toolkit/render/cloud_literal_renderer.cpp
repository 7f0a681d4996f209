#include "toolkit/render/cloud_literal_renderer.h"

#include <memory>

#include "toolkit/render/literal_model.h"
#include "toolkit/render/summed_models.h"

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
    PointModelOptions o = point_model_options(options_);
    o.normals = false;
    models_.clear(scene.force_limit_n);
    for (const ModelInput& input : scene.models) {
      Result<PointModel> built = build_point_model(input, o, context, report);
      if (!built) return std::move(built).error();
      if (built->surface.texture.any())
        report.notes.push_back("texture: not rendered by the literal form, which prints no formula for it");
      const Shading shading = shading_of(*built, report);
      models_.add(std::make_unique<LiteralModel>(std::move(*built), shading, literal));
    }
    reset(Vec3::Zero());
    return report;
  }

  void reset(const Vec3& hip_mm) noexcept override { models_.reset(hip_mm); }
  Frame step(const Vec3& hip_mm, double dt_s) noexcept override { return models_.step(hip_mm, dt_s); }
  FrameCounters counters() const noexcept override { return models_.counters(); }

  Description describe() const override {
    return {
        "cloud-literal", "chapter 3 as printed", "El-Far, chapter 3, figures 36 and 42",
        "unbounded, as printed: cells crossed times points a cell; the walk is bounded by 64 moves a frame",
        options_};
  }

 private:
  Shading shading_of(const PointModel& model, PrepareReport& report) const {
    if (options_.text("shading") != "auto") return parse_shading(options_.text("shading"));
    const bool shade = model.resolution_mm > kLiteralShadingResolutionMm;
    report.notes.push_back(shade ? "shading: area-raw, the resolution is above 0.2 mm"
                                 : "shading: none, the resolution is at most 0.2 mm");
    return shade ? Shading::kAreaRaw : Shading::kNone;
  }

  Options options_;
  SummedModels<LiteralModel> models_;
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
