#include "toolkit/renderers/cloud_on_stars.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "toolkit/core/try.h"
#include "toolkit/deformation/deformed_stars.h"
#include "toolkit/render/model_store.h"
#include "toolkit/render/prepare_phases.h"
#include "toolkit/render/wide_mouth.h"
#include "toolkit/renderers/editable_renderer.h"
#include "toolkit/renderers/star_model.h"
#include "toolkit/stars/refine.h"

namespace palpate::render {
namespace {

// Measured (see kExpectedOn): what to expect, no decision rests on them.
constexpr double kStarFrameUs = 0.1, kStarMsPerMillion = 1'000.0, kRasterMsPerMillion = 300.0;
constexpr double kRefineMsPerMillion = 500.0;  // of places that are new
// Points with their rings, rings apart of one random point in thirty, boxes and layers of the tree.
constexpr double kStarBytesPerPoint = 32.0 + 1.5 + 6.0;
/// More open points than the border of a square sheet has, 4 sqrt(n), and this share besides, are no border:
/// the points are too noisy or too few for facets.
constexpr double kDoubtfulShare = 0.05, kBorderOfSquare = 4.0;

double share(std::uint64_t part, std::uint64_t all) noexcept {
  return all == 0 ? 0.0 : static_cast<double>(part) / static_cast<double>(all);
}

class CloudOnStars final : public EditableShellRenderer<StarModel> {
 public:
  explicit CloudOnStars(const Options& options)
      : EditableShellRenderer(options),
        asked_{options.text("sides") == "both", options.text("raster") != "off"} {}

  Description describe() const override {
    return {
        "cloud", "chapter 3 made right: the points' own triangles, a god object that only descends",
        "El-Far, chapter 3; stars of points, their frame, friction cone and joint contact ours",
        fmt::format(
            "a model near the HIP: {} moves of the god object from facet to facet, {} flights of {} nodes of "
            "eight boxes and {} triangles; what is left is done in the next; of models touched at once the "
            "{} deepest; where points move, {} of a dent or {} of a batch, {} new ones and {} blocks of the "
            "tree",
            walk_steps(), stars::kMaxFlights, stars::kMaxNodes, stars::kMaxTested, kMaxTouched,
            kMaxMovedPoints, kMaxBatch, kMaxInferredPoints, stars::kMaxRefitBlocks),
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

  Result<ModelDecisions> decide_model(const ModelInput& input,
                                      const PrepareContext& /*context*/) const override {
    if (input.cloud->empty()) return no_points();
    const Result<SurfaceDecision> surface = decide_surface(input);
    if (!surface) return surface.error();
    return said(input, *surface);
  }
  [[nodiscard]] int levels_asked() const { return static_cast<int>(options_.integer("refine")); }
  [[nodiscard]] int walk_steps() const { return static_cast<int>(options_.integer("walk_steps")); }
  /// Where points move every corner has to be one of them: who moves them knows no others.
  [[nodiscard]] int levels_of(const ModelInput& input) const { return is_moving(input) ? 0 : levels_asked(); }
  static Error no_points() {
    return {"the cloud has no points", "give a file with at least one point", {}, 0};
  }

  [[nodiscard]] ModelDecisions said(const ModelInput& input, const SurfaceDecision& surface) const {
    ModelDecisions out;
    out.name = input.name;
    out.points = input.cloud->size();
    const auto n = static_cast<double>(out.points);
    out.decisions.push_back(
        {"surface", "stars",
         "triangles that the points agree on; options of the vertices' boxes take vertices"});
    // Each level has four places for one.
    const int levels = levels_of(input);
    const double places = n * std::pow(4.0, levels);
    out.bytes = static_cast<std::uint64_t>(kStarBytesPerPoint * places);
    const bool is_raster = input.cloud->raster.has_value() && asked_.raster;
    if (is_raster)
      out.decisions.push_back(
          {"raster", "read", "triangles lie between its rows and columns, where these are a surface"});
    out.prepare_ms = 1e-6 * (n * (is_raster ? kRasterMsPerMillion : kStarMsPerMillion) +
                             (places - n) * kRefineMsPerMillion);
    if (levels > 0)
      out.decisions.push_back({"refined", fmt::format("{} times", levels), "option refine", true});
    else if (levels_asked() > 0)
      out.decisions.push_back({"refined", "no", "its points move: each triangle is one of theirs"});
    out.frame_us = kStarFrameUs;
    say_surface(input, surface, kFeltOnStars, out.points, out);
    if (is_moving(input)) {
      const DeformerRoom room = deformer_room(out.points);
      say_giving_way("points move with their triangles", room, out);
      out.bytes += Deformer::bytes_for(out.points, room) +
                   DeformedStars::bytes_for(out.points, room.spare_points, room.journal_points);
    }
    if (input.motion != nullptr)
      out.decisions.push_back({"motion", "pose read in each frame", "the scene moves it", true});
    return out;
  }

  Status prepare_model(const ModelInput& input, const PrepareContext& context, PrepareReport& report) {
    if (input.cloud->empty()) return no_points();
    auto made = std::make_unique<StarModel>();
    std::shared_ptr<StarGeometry> own;  // nobody else's, and not in the store
    PALPATE_TRY(prepare_geometry(input, context, *made, own, report));
    const stars::StarMesh& mesh = made->geometry->mesh;
    made->placed = ModelPose(input, mesh.origin_mm());
    Result<SurfaceField> field = build_surface_field(input, mesh.order(), report);
    if (!field) return std::move(field).error();
    made->surface = *std::move(field);
    if (own != nullptr) {
      // Which of the cloud's points stands where: nobody will ask.
      report.bytes -= own->bytes();
      own->mesh.drop_order();
      report.bytes += own->bytes();
    }
    blend(mesh, made->surface, report);
    report.bytes += made->surface.bytes();
    if (made->moving != nullptr) prepare_giving_way(input, context, *made, report);
    made->contact.attach(mesh, made->geometry->tree);
    made->contact.bound_moves(walk_steps());
    report.decisions.models.push_back(said(input, made->surface));
    models_.add(std::move(made));
    return Done{};
  }

  /// From the store where there is one, but where points may move: those are nobody else's.
  Status prepare_geometry(const ModelInput& input, const PrepareContext& context, StarModel& made,
                          std::shared_ptr<StarGeometry>& own, PrepareReport& report) const {
    if (is_moving(input)) {
      made.geometry = made.moving = build_geometry(*input.cloud, 0, true, false, context, report);
      return Done{};
    }
    const int levels = levels_of(input);
    const bool varied = varies(input.surface);
    Result<std::shared_ptr<const StarGeometry>> geometry = held_or_made<StarGeometry>(
        context, report,
        [&] {
          return fmt::format("stars {:016x} {} {} {} {} {}", cloud::content_hash(*input.cloud),
                             input.cloud->size(), varied, levels, asked_.both_sides, asked_.raster);
        },
        [&](PrepareReport& to) -> Result<std::shared_ptr<const StarGeometry>> {
          std::shared_ptr<StarGeometry> built =
              build_geometry(*input.cloud, levels, varied, true, context, to);
          if (context.store == nullptr) own = built;
          return std::shared_ptr<const StarGeometry>(std::move(built));
        });
    if (!geometry) return std::move(geometry).error();
    made.geometry = *std::move(geometry);
    return Done{};
  }

  std::shared_ptr<StarGeometry> build_geometry(const cloud::Cloud& cloud, int levels, bool keep_order,
                                               bool with_tree, const PrepareContext& context,
                                               PrepareReport& report) const {
    auto made = std::make_shared<StarGeometry>();
    PreparePhases phases(report, context);
    bool running = false;
    const auto on_step = [&](std::string_view step) {
      if (running) phases.end();
      phases.begin(std::string(step));
      running = true;
    };
    made->mesh = stars::StarMesh::build(cloud, context.threads, on_step, asked_);
    phases.end();
    if (levels > 0) {
      phases.begin("refine");
      made->mesh = stars::refined(std::move(made->mesh), levels, context.threads);
      phases.end();
    }
    if (with_tree) {
      phases.begin("tree");
      made->tree = stars::StarTree::build(made->mesh, context.threads);
      phases.end();
    }
    if (!keep_order) made->mesh.drop_order();
    report.bytes += made->bytes();
    note(made->mesh.counts(), made->mesh.size(), report);
    return made;
  }

  static void prepare_giving_way(const ModelInput& input, const PrepareContext& context, StarModel& made,
                                 PrepareReport& report) {
    StarGeometry& own = *made.moving;
    const DeformerRoom room = deformer_room(own.mesh.size());
    PreparePhases phases(report, context);
    phases.begin("tree");
    report.bytes -= own.bytes() + made.surface.bytes();
    auto points =
        std::make_unique<DeformedStars>(own.mesh, own.tree, made.surface, room.spare_points, context.threads);
    own.mesh.drop_order();
    report.bytes += own.bytes() + made.surface.bytes();
    give_way(made.giving, input, std::move(points), room, own.tree.box_mm(), report);
    phases.end();
  }

  static void note(const stars::StarCounts& counts, std::uint64_t points, PrepareReport& report) {
    report.notes.push_back(fmt::format(
        "{} triangles in {} pieces, {} of them closed and {} closed but for holes; of {} points {:.3g} % "
        "agree with all around them; {} "
        "triangles by "
        "vote, {} in small gaps, {} torn; {} points doubled, {} without a triangle, {} at borders and gaps",
        counts.triangles, counts.pieces, counts.closed_pieces - counts.pieces_with_holes,
        counts.pieces_with_holes, points, 100.0 * share(counts.agreed_points, points), counts.voted,
        counts.filled, counts.torn, counts.welded, counts.unused, counts.open_points));
    if (counts.raster_points > 0)
      report.notes.push_back(
          fmt::format("raster: the triangles of {} of {} points are read from its rows and columns; "
                      "raster=off makes them as of any points",
                      counts.raster_points, points));
    if (counts.pieces_with_holes > 0)
      report.notes.push_back(
          fmt::format("{} closed but for holes: felt from the side where the replay begins; sides=both feels "
                      "both, as of a vase",
                      counts.pieces_with_holes));
    if (auto wide = wide_mouth_warning(counts.least_enclosed)) report.warnings.push_back(*std::move(wide));
    const double border = kBorderOfSquare / std::sqrt(static_cast<double>(points));
    if (const double open = share(counts.open_points + counts.unused, points); open > kDoubtfulShare + border)
      report.warnings.push_back(
          fmt::format("{:.0f} % of the points lie at gaps: they are too noisy, or too few, for facets "
                      "between them; take cloud-smooth, or "
                      "clean them (palpate clean)",
                      100.0 * open));
  }

  /// Stiffness that varies rises no faster than what can be felt as a slope, see blend_stiffness().
  static void blend(const stars::StarMesh& mesh, SurfaceField& field, PrepareReport& report) {
    if (field.of_place.empty()) return;
    std::vector<surface::SurfacePoint> points(mesh.size());
    std::vector<neighbourhood::Neighbours> links(mesh.size());
    double longest_sq = 0.0;
    for (std::uint32_t i = 0; i < mesh.size(); ++i) {
      const Vec3f p = mesh.at(i).cast<float>();
      points[i] = {p.x(), p.y(), p.z(), surface::kNoNormal};
      const stars::Ring ring = mesh.ring(i);
      links[i].fill(i);
      std::copy_n(ring.of, std::min<std::size_t>(ring.size, links[i].size()), links[i].begin());
      for (const std::uint32_t other : links[i])
        longest_sq = std::max(longest_sq, (mesh.at(other) - mesh.at(i)).squaredNorm());
    }
    const double blend_mm = kBlendResolutions * std::sqrt(longest_sq);
    if (const std::size_t softer = blend_stiffness(field, points, links, blend_mm); softer > 0)
      report.notes.push_back(
          fmt::format("stiffness blended over {:.3g} mm: {} points made softer", blend_mm, softer));
  }

  stars::StarBuild asked_;
};

}  // namespace

std::unique_ptr<HapticRenderer> make_cloud_on_stars(const Options& options) {
  return std::make_unique<CloudOnStars>(options);
}

}  // namespace palpate::render
