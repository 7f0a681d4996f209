#include "toolkit/renderers/cloud_on_vertices.h"

#include <fmt/format.h>

#include <utility>

#include "toolkit/core/try.h"
#include "toolkit/deformation/moving_vertices.h"
#include "toolkit/render/shading_decision.h"
#include "toolkit/renderers/cloud_model.h"
#include "toolkit/renderers/editable_renderer.h"

namespace palpate::render {
namespace {

class CloudOnVertices final : public EditableShellRenderer<CloudModel> {
 public:
  static constexpr Features kFelt = kFeltOnVertices;
  // Measured (see kExpectedOn); they say what to expect, no decision rests on them. A frame in contact:
  // bench_frame at 1,002,001 points. Preparation on two threads: reproduce, neighbours known from a scan's
  // order or searched.
  static constexpr double kFrameUs = 0.25;
  static constexpr double kScanOrderMsPerMillion = 450.0, kSearchMsPerMillion = 900.0;

  explicit CloudOnVertices(const Options& options) : EditableShellRenderer(options) {}

  Description describe() const override {
    return {"cloud", "chapter 3 made right",
            "El-Far, chapter 3; side, bounds, creases, friction cone and joint contact ours",
            fmt::format("a model near the HIP: {} moves of the god object and {} along an edge, {} wider "
                        "looks of 64 points, {} "
                        "box tests, segments of {} cells, at a crease {} facets and as many lines a frame; "
                        "what is left is done "
                        "in the next; of models touched at once the {} deepest",
                        kMaxWalkSteps, kMaxFaceMoves, kMaxRescues, kMaxBoxTests, kMaxSegmentCells,
                        neighbourhood::kNeighbours, kMaxTouched),
            options_};
  }

 private:
  Status add_models(const SceneInput& scene, const PrepareContext& context, PrepareReport& report) override {
    for (const ModelInput& input : scene.models) PALPATE_TRY(prepare_model(input, context, report));
    return Done{};
  }
  [[nodiscard]] Combine combine() const override {
    return options_.text("combine") == "sum" ? Combine::kSum : Combine::kJoint;
  }

  /// What the options mean for a model.
  [[nodiscard]] PointModelOptions options_for(const ModelInput& input) const {
    PointModelOptions o = point_model_options(options_);
    o.blend_resolutions = kBlendResolutions;
    o.moving = is_moving(input);
    if (o.moving) o.spare_points = deformer_room(input.cloud->size()).spare_points;
    return o;
  }
  [[nodiscard]] ShadingDecision shading_of(const PointModelDecision& decided) const {
    return decide_shading(options_.text("shading"), decided.surface.largest_stiffness_n_per_mm,
                          decided.points.max_spacing_mm, decided.points.moving);
  }

  Result<ModelDecisions> decide_model(const ModelInput& input, const PrepareContext& context) const override {
    const Result<PointModelDecision> decided = decide_point_model(input, options_for(input), context);
    if (!decided) return decided.error();
    return said(input, *decided);
  }
  [[nodiscard]] ModelDecisions said(const ModelInput& input, const PointModelDecision& decided) const {
    const PointDecision& points = decided.points;
    ModelDecisions out;
    out.name = input.name;
    say_points(*input.cloud, options_for(input), points, out);
    const double millions = 1e-6 * static_cast<double>(input.cloud->size());
    out.prepare_ms = millions * (points.from_scan ? kScanOrderMsPerMillion : kSearchMsPerMillion);
    out.frame_us = kFrameUs;
    out.decisions.push_back(shading_of(decided).said);
    say_surface(input, decided.surface, kFelt, input.cloud->size(), out);
    if (points.moving) {
      const DeformerRoom room = deformer_room(input.cloud->size());
      say_giving_way("points move with their links", room, out);
      out.bytes += Deformer::bytes_for(input.cloud->size(), room) +
                   MovingVertices::bytes_for(input.cloud->size(), room.journal_points);
    }
    if (input.motion != nullptr)
      out.decisions.push_back({"motion", "pose read in each frame", "the scene moves it", true});
    return out;
  }

  Status prepare_model(const ModelInput& input, const PrepareContext& context, PrepareReport& report) {
    auto made = std::make_unique<CloudModel>();
    Result<PointBody> built = build_point_body(input, options_for(input), context, report);
    if (!built) return std::move(built).error();
    made->body = std::move(*built);
    const PointModel& points = *made->body.points;
    const PointModelDecision decided = made->body.decided();
    const ShadingDecision shading = shading_of(decided);
    report.decisions.models.push_back(said(input, decided));
    if (!shading.said.given) report.notes.push_back(note_of(shading.said));
    made->shading = shading.shading;
    made->by_spacing = shading.by_spacing;
    made->felt_spacing_sq_mm2 = shading.felt_spacing_mm * shading.felt_spacing_mm;
    made->contact.attach(points);
    for (const StoredPoint& p : points.points) made->prepared_box_mm.add(p.at());
    made->prepared_box_mm.low_mm -= points.largest_half_box_mm;
    made->prepared_box_mm.high_mm += points.largest_half_box_mm;
    if (decided.points.moving) {
      const DeformerRoom room = deformer_room(input.cloud->size());
      give_way(made->giving, input,
               std::make_unique<MovingVertices>(*made->body.moving, made->body.surface, room.spare_points),
               room, made->prepared_box_mm, report);
    }
    models_.add(std::move(made));
    return Done{};
  }
};

}  // namespace

std::unique_ptr<HapticRenderer> make_cloud_on_vertices(const Options& options) {
  return std::make_unique<CloudOnVertices>(options);
}

}  // namespace palpate::render
