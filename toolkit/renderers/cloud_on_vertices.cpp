#include "toolkit/renderers/cloud_on_vertices.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "toolkit/core/try.h"
#include "toolkit/deformation/editable.h"
#include "toolkit/render/shading_decision.h"
#include "toolkit/render/shell_renderer.h"
#include "toolkit/renderers/cloud_model.h"

namespace palpate::render {
namespace {

/// Points that a surface that gives way may gain by stretching, as a share of those it has, and at least.
constexpr double kSpareShare = 0.125;
constexpr std::size_t kLeastSpare = 256;
/// Changes remembered for undo: some four thousand frames of a full dent, 32 MB.
constexpr std::size_t kJournalPoints = std::size_t{1} << 19;

class CloudOnVertices final : public BoxedShellRenderer<CloudModel>, public Editable {
 public:
  static constexpr Features kFelt = kFeltOnVertices;
  // Measured (see kExpectedOn); they say what to expect, no decision rests on them. A frame in contact:
  // bench_frame at 1,002,001 points. Preparation on two threads: reproduce, neighbours known from a scan's
  // order or searched.
  static constexpr double kFrameUs = 0.25;
  static constexpr double kScanOrderMsPerMillion = 450.0, kSearchMsPerMillion = 900.0;

  explicit CloudOnVertices(const Options& options) : BoxedShellRenderer(options) {}

  bool undo(std::size_t model) noexcept override {
    if (!gives_way(model)) return false;
    CloudModel& cloud = models_[model];
    bool any = false;
    cloud.put_back(models_.counters(), [&](auto&& told) { any = cloud.deformer->undo(told); });
    return any;
  }
  void restore(std::size_t model) noexcept override {
    if (!gives_way(model)) return;
    CloudModel& cloud = models_[model];
    cloud.put_back(models_.counters(), [&](auto&& told) { cloud.deformer->reset(told); });
  }
  Result<cloud::Cloud> edited(std::size_t model) const override {
    if (!gives_way(model))
      return Error{"this model does not give way", "give it a [model.surface.dent]", {}, 0};
    return models_[model].deformer->edited();
  }
  DeformCounters deform_counters(std::size_t model) const noexcept override {
    return gives_way(model) ? models_[model].deformer->counters() : DeformCounters{};
  }

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

  [[nodiscard]] bool gives_way(std::size_t model) const noexcept {
    return model < models_.size() && models_[model].deformer != nullptr;
  }

  /// What the options mean for a model.
  [[nodiscard]] PointModelOptions options_for(const ModelInput& input) const {
    PointModelOptions o = point_model_options(options_);
    o.blend_resolutions = kBlendResolutions;
    o.moving = input.surface.dent.any() || input.moves != nullptr;
    if (o.moving)
      o.spare_points =
          static_cast<std::size_t>(kSpareShare * static_cast<double>(input.cloud->size())) + kLeastSpare;
    return o;
  }
  static Deformer::Options deformer_options(const ModelInput& input, const PointDecision& points) {
    Deformer::Options deform;
    deform.spare_points = points.spare_points;
    deform.journal_points = std::min(input.cloud->size() + points.spare_points, kJournalPoints);
    return deform;
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
      const Deformer::Options deform = deformer_options(input, points);
      out.decisions.push_back({"deformable geometry", "points move with their links",
                               fmt::format("up to {} points a frame, {} spare ones, {} changes undone; the "
                                           "first shape is kept",
                                           kMaxMovedPoints, deform.spare_points, deform.journal_points),
                               true});
      out.bytes += Deformer::bytes_for(input.cloud->size(), deform);
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
      const Deformer::Options deform = deformer_options(input, decided.points);
      made->deformer = std::make_unique<Deformer>(*made->body.moving, made->body.surface, deform);
      made->dent = input.surface.dent;
      if (input.moves != nullptr) made->moves = input.moves->subscribe();
      report.bytes += made->deformer->bytes();
      report.notes.push_back(
          fmt::format("deformation: up to {} points a frame, {} spare ones, {} changes undone",
                      kMaxMovedPoints, deform.spare_points, deform.journal_points));
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
