#include "toolkit/renderers/cloud_literal_renderer.h"

#include <memory>

#include "toolkit/render/shell_renderer.h"
#include "toolkit/renderers/literal_model.h"
#include "toolkit/renderers/literal_shading.h"

namespace palpate::render {
namespace {

class CloudLiteral final : public ShellRenderer<LiteralModel> {
 public:
  explicit CloudLiteral(const Options& options) : ShellRenderer(options) {}

  Description describe() const override {
    return {
        "cloud-literal", "chapter 3 as printed", "El-Far, chapter 3, figures 36 and 42",
        "unbounded, as printed: cells crossed times points a cell; the walk is bounded by 64 moves a frame",
        options_};
  }

 private:
  Status add_models(const SceneInput& scene, const PrepareContext& context, PrepareReport& report) override {
    const std::string& cells = options_.text("cells");
    LiteralOptions literal;
    literal.cells = cells == "sampled"   ? CellRule::kSampled
                    : cells == "crossed" ? CellRule::kCrossed
                                         : CellRule::kAdjacent;
    literal.text_form = options_.text("exit_test") == "text";
    literal.count_missed = options_.flag("count_missed");
    PointModelOptions o = point_model_options(options_);
    o.normals = false;
    if (literal.cells == CellRule::kSampled && o.swept_sphere)
      report.notes.push_back(
          "cells: all that the swept sphere crosses, which no sampling of a segment finds");
    for (const ModelInput& input : scene.models) {
      Result<PointBody> built = build_point_body(input, o, context, report);
      if (!built) return std::move(built).error();
      const Shading shading = literal_shading(options_.text("shading"), built->points->resolution_mm, report);
      models_.add(std::make_unique<LiteralModel>(std::move(*built), shading, literal));
    }
    return Done{};
  }
  [[nodiscard]] Combine combine() const override { return Combine::kSum; }
};

}  // namespace

RendererInfo cloud_literal_info() {
  using enum OptionKind;
  RendererInfo info;
  info.name = "cloud-literal";
  info.summary = "chapter 3 of the thesis as printed, defects included";
  info.source = "El-Far, chapter 3, figures 36 and 42";
  info.role = Role::kLiteral;
  info.supports = kAllOfRigidSurfaces.without(Feature::kTexture);
  info.options = point_model_specs(false);
  for (OptionSpec& spec : box_test_specs()) info.options.push_back(std::move(spec));
  info.options.push_back(shading_spec("force shading; auto: area-raw above 0.2 mm, else none"));
  info.options.push_back({"cells",
                          kChoice,
                          "sampled",
                          "cells searched: sampled as printed (a swept sphere: all crossed), all crossed, or "
                          "adjacent ones too",
                          {"sampled", "crossed", "adjacent"}});
  info.options.push_back(
      {"exit_test",
       kChoice,
       "figure",
       "what figure 42 tests on the way out: the sphere (figure) or the god object (text of 3.2.4)",
       {"figure", "text"}});
  info.options.push_back({"count_missed",
                          kFlag,
                          "false",
                          "count cells that the printed sampling skips (slower)",
                          {},
                          0.0,
                          0.0,
                          {{"cells", {"sampled"}}, {"test", {"box"}}}});
  info.make = [](const Options& options) { return std::make_unique<CloudLiteral>(options); };
  return info;
}

}  // namespace palpate::render
