#include "toolkit/renderers/renderer_infos.h"

#include <memory>

#include <palpate/result.h>
#include "toolkit/core/option_specs.h"
#include "toolkit/render/frame_loop_renderer.h"
#include "toolkit/render/shading.h"
#include "toolkit/renderers/literal_model.h"

namespace palpate::render {
namespace {

class CloudLiteral final : public FrameLoopRenderer<LiteralModel> {
 public:
  static constexpr Features kSupportedFeatures = kAllOfRigidSurfaces.without(Feature::kTexture);
  // Measured estimates (see kReferenceMachine): tables 7 of reproduce.
  static constexpr double kFrameUs = 0.32, kMsPerMillion = 160.0;

  explicit CloudLiteral(const Options& options) : FrameLoopRenderer(options) {}

  Description describe() const override {
    return {
        "cloud-literal", "chapter 3 as printed", "El-Far, chapter 3, figures 36 and 42",
        "unbounded, as printed: cells crossed times points a cell; the walk is bounded by 64 moves a frame",
        options_};
  }

 private:
  [[nodiscard]] LiteralOptions literal_options() const {
    const std::string& cells = options_.text("cells");
    LiteralOptions literal;
    literal.cells = cells == "sampled"   ? CellRule::kSampled
                    : cells == "crossed" ? CellRule::kCrossed
                                         : CellRule::kAdjacent;
    literal.text_form = options_.text("exit_test") == "text";
    return literal;
  }
  [[nodiscard]] points::PointModelOptions point_options() const {
    points::PointModelOptions o = points::point_model_options(options_);
    o.normals = false;
    return o;
  }
  [[nodiscard]] ShadingDecision shading_of(const points::PointDecision& points) const {
    return decide_literal_shading(options_.text("shading"), points.resolution_mm);
  }

  Result<ModelDecisions> decide_model(const ModelInput& input, const PrepareContext& context) const override {
    PALPATE_ASSIGN(const points::PointModelDecision decided,
                   points::decide_point_model(input, point_options(), context));
    return explanation(input, decided);
  }
  [[nodiscard]] ModelDecisions explanation(const ModelInput& input,
                                           const points::PointModelDecision& decided) const {
    const points::PointDecision& points = decided.points;
    ModelDecisions out;
    out.name = input.name;
    points::describe_points(*input.cloud, point_options(), points, out);
    out.prepare_ms = kMsPerMillion * 1e-6 * static_cast<double>(input.cloud->size());
    out.frame_us = kFrameUs;
    const bool sampled = literal_options().cells == CellRule::kSampled;
    out.decisions.push_back(
        sampled && points.sphere_mm > 0.0
            ? Decision{"cells", "crossed",
                       "all that the swept sphere crosses, which no sampling of a segment finds"}
            : Decision{
                  "cells", options_.text("cells"),
                  sampled ? "those of the sub-segments' starting points, as printed (3.1.3)" : "as given",
                  !sampled});
    out.decisions.push_back(shading_of(points).explanation);
    describe_surface(input, decided.surface, kSupportedFeatures, input.cloud->size(), out);
    return out;
  }

  Status add_models(const SceneInput& scene, const PrepareContext& context, PrepareReport& report) override {
    const LiteralOptions literal = literal_options();
    const points::PointModelOptions o = point_options();
    if (literal.cells == CellRule::kSampled && o.swept_sphere)
      report.notes.push_back(
          "cells: all that the swept sphere crosses, which no sampling of a segment finds");
    for (const ModelInput& input : scene.models) {
      PALPATE_ASSIGN(points::PointInstance built, points::build_point_body(input, o, context, report));
      const points::PointModelDecision decided = built.decided();
      const ShadingDecision shading = shading_of(decided.points);
      report.decisions.models.push_back(explanation(input, decided));
      if (!shading.explanation.given) report.notes.push_back(note_text(shading.explanation));
      models_.add(std::make_unique<LiteralModel>(std::move(built), shading.shading, literal));
    }
    return Done{};
  }
  [[nodiscard]] ContactCombination combine() const override { return ContactCombination::kSum; }
};

}  // namespace

RendererInfo cloud_literal_info() {
  RendererInfo info;
  info.name = "cloud-literal";
  info.summary = "the thesis's chapter 3 as printed, defects included";
  info.source = "El-Far, chapter 3, figures 36 and 42";
  info.role = Role::kLiteral;
  info.supports = CloudLiteral::kSupportedFeatures;
  info.options = points::point_model_specs(false);
  for (OptionSpec& spec : points::box_test_specs()) info.options.push_back(std::move(spec));
  info.options.push_back(shading_spec("force shading; auto: area-raw above 0.2 mm, else none"));
  info.options.push_back(
      option::choice("cells", "sampled",
                     "cells searched: sampled as printed (a swept sphere: all crossed), all crossed, or "
                     "adjacent ones too",
                     {"sampled", "crossed", "adjacent"}));
  info.options.push_back(option::choice(
      "exit_test", "figure",
      "what figure 42 tests on the way out: the sphere (figure) or the god object (text of 3.2.4)",
      {"figure", "text"}));
  info.make = [](const Options& options) { return std::make_unique<CloudLiteral>(options); };
  return info;
}

}  // namespace palpate::render
