#include "toolkit/renderers/renderer_infos.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>

#include <palpate/model_store.h>
#include <palpate/result.h>
#include "toolkit/core/option_specs.h"
#include "toolkit/deformation/deformed_local_delaunay.h"
#include "toolkit/local_delaunay/local_delaunay_mesh.h"
#include "toolkit/render/frame_loop_renderer.h"
#include "toolkit/render/prepare.h"
#include "toolkit/renderers/local_delaunay_model.h"

namespace palpate::render {
namespace {

// Measured estimates (see kReferenceMachine); no decision uses them.
constexpr double kDelaunayFrameUs = 0.1, kDelaunayMsPerMillion = 1'000.0, kRasterMsPerMillion = 300.0;
constexpr double kRefineMsPerMillion = 500.0;  // per million new places
// Points with rings, separate rings of one random point in thirty, boxes and tree levels.
constexpr double kDelaunayBytesPerPoint = 32.0 + 1.5 + 6.0;
/// A square sheet's border has 4 sqrt(n) open points. More than that plus this share means that the points
/// are too noisy or too few for facets.
constexpr double kDoubtfulShare = 0.05, kBorderOfSquare = 4.0;

double share(std::uint64_t part, std::uint64_t all) noexcept {
  return all == 0 ? 0.0 : static_cast<double>(part) / static_cast<double>(all);
}

constexpr const char* kCloudSummary = "the thesis's chapter 3 made right: the points' triangles";
constexpr const char* kCloudSource =
    "El-Far, chapter 3; stars of points, contact side, friction cone, joint contact and bounds are ours";
constexpr const char* kBruteSummary = "cloud with every triangle looked at: the oracle of tests";
constexpr Features kFeltRigid = kAllOfRigidSurfaces | Feature::kJointContact;
constexpr Features kFeaturesOnLocalDelaunay = kFeltRigid | Feature::kDent | Feature::kMovedPoints;

/// Search for triangles near the HIP.
enum class StarSearch : std::uint8_t { kTree, kNone };

class CloudRenderer final : public FrameLoopRenderer<LocalDelaunayModel>, public deformation::Editable {
 public:
  CloudRenderer(const Options& options, StarSearch search)
      : FrameLoopRenderer(options),
        search_(search),
        asked_{options.text("sides") == "both", options.text("raster") != "off"} {}

  Description describe() const override {
    if (has_no_tree())
      return {"brute-force", kBruteSummary, "oracle", "unbounded: a look reads all triangles", options_};
    return {
        "cloud", kCloudSummary, kCloudSource,
        fmt::format(
            "a model near the HIP: {} moves of the god object from facet to facet, {} flights of {} nodes of "
            "eight boxes and {} triangles; what is left is done in the next; of models touched at once the "
            "{} deepest; where points move, {} of a dent or {} of a batch, {} new ones and {} blocks of the "
            "tree",
            walk_steps(), local_delaunay::kMaxFlights, local_delaunay::kMaxNodes,
            local_delaunay::kMaxTestedTriangles, kMaxTouched, deformation::kMaxMovedPoints, kMaxBatch,
            deformation::kMaxInferredPoints, local_delaunay::kMaxRefitBlocks),
        options_};
  }

  bool undo(std::size_t model) noexcept override {
    deformation::Deformer* const deformer = deformer_of(model);
    if (deformer == nullptr) return false;
    bool any = false;
    put_back(model, [&](auto&& on_moved) noexcept { any = deformer->undo(on_moved); });
    return any;
  }
  void restore(std::size_t model) noexcept override {
    deformation::Deformer* const deformer = deformer_of(model);
    if (deformer == nullptr) return;
    put_back(model, [&](auto&& on_moved) noexcept { deformer->reset(on_moved); });
  }
  Result<cloud::Cloud> edited(std::size_t model) const override {
    if (const deformation::Deformer* const deformer = deformer_of(model)) return deformer->edited();
    return Error{"this model does not give way", "give it a [model.surface.dent]"};
  }
  std::optional<Vec3> point_position_mm(std::size_t model, std::uint32_t point) const noexcept override {
    const deformation::Deformer* const deformer = deformer_of(model);
    if (deformer == nullptr) return std::nullopt;
    return deformer->point_mm(point);
  }
  deformation::DeformCounters deform_counters(std::size_t model) const noexcept override {
    const deformation::Deformer* const deformer = deformer_of(model);
    return deformer == nullptr ? deformation::DeformCounters{} : deformer->counters();
  }

 private:
  Status add_models(const SceneInput& scene, const PrepareContext& context, PrepareReport& report) override {
    for (const ModelInput& input : scene.models) PALPATE_TRY(prepare_model(input, context, report));
    return Done{};
  }
  [[nodiscard]] ContactCombination combine() const override {
    return options_.text("combine") == "sum" ? ContactCombination::kSum : ContactCombination::kJoint;
  }

  Result<ModelDecisions> decide_model(const ModelInput& input,
                                      const PrepareContext& /*context*/) const override {
    if (input.cloud->empty()) return no_points();
    PALPATE_ASSIGN(const SurfaceDecision surface, decide_surface(input));
    return explanation(input, surface);
  }
  [[nodiscard]] int levels_asked() const { return static_cast<int>(options_.integer("refine")); }
  [[nodiscard]] int walk_steps() const { return static_cast<int>(options_.integer("walk_steps")); }
  [[nodiscard]] bool has_no_tree() const { return search_ == StarSearch::kNone; }
  [[nodiscard]] bool can_deform(const ModelInput& input) const {
    return !has_no_tree() && deformation::is_deformable(input);
  }
  /// Moving points need every corner to be a cloud point, so no places are added.
  [[nodiscard]] int levels_of(const ModelInput& input) const {
    return can_deform(input) ? 0 : levels_asked();
  }
  static Error no_points() {
    return {"the cloud has no points", "give a file with at least one point", {}, 0};
  }

  [[nodiscard]] ModelDecisions explanation(const ModelInput& input, const SurfaceDecision& surface) const {
    ModelDecisions out;
    out.name = input.name;
    out.points = input.cloud->size();
    const auto n = static_cast<double>(out.points);
    out.decisions.push_back({"surface", "stars", "triangles that the points agree on"});
    if (has_no_tree()) out.decisions.push_back({"search", "none", "a look reads all triangles"});
    // Each level multiplies the places by four.
    const int levels = levels_of(input);
    const double places = n * std::pow(4.0, levels);
    out.bytes = static_cast<std::uint64_t>(kDelaunayBytesPerPoint * places);
    const bool is_raster = input.cloud->raster.has_value() && asked_.raster;
    if (is_raster)
      out.decisions.push_back(
          {"raster", "read", "triangles lie between its rows and columns, where these are a surface"});
    out.prepare_ms = 1e-6 * (n * (is_raster ? kRasterMsPerMillion : kDelaunayMsPerMillion) +
                             (places - n) * kRefineMsPerMillion);
    if (levels > 0)
      out.decisions.push_back({"refined", fmt::format("{} times", levels), "option refine", true});
    else if (levels_asked() > 0)
      out.decisions.push_back({"refined", "no", "its points move: each triangle is one of theirs"});
    out.frame_us = kDelaunayFrameUs;
    describe_surface(input, surface, has_no_tree() ? kFeltRigid : kFeaturesOnLocalDelaunay, out.points, out);
    if (can_deform(input)) {
      const deformation::DeformerCapacity room = deformation::deformer_capacity(out.points);
      out.decisions.push_back(
          {"deformable geometry", "points move with their triangles",
           fmt::format("up to {} points a frame, {} spare ones, {} changes undone; the first shape is kept",
                       deformation::kMaxMovedPoints, room.spare_points, room.journal_points),
           true});
      out.bytes +=
          deformation::Deformer::bytes_for(out.points, room) +
          deformation::DeformedLocalDelaunay::bytes_for(out.points, room.spare_points, room.journal_points);
    }
    if (input.motion != nullptr)
      out.decisions.push_back({"motion", "pose read in each frame", "the scene moves it", true});
    return out;
  }

  Status prepare_model(const ModelInput& input, const PrepareContext& context, PrepareReport& report) {
    if (input.cloud->empty()) return no_points();
    auto made = std::make_unique<LocalDelaunayModel>();
    std::shared_ptr<LocalDelaunayGeometry> own;  // private to this renderer, not in the store
    PALPATE_TRY(prepare_geometry(input, context, *made, own, report));
    const local_delaunay::LocalDelaunayMesh& mesh = made->geometry->mesh;
    made->placed = ModelPose(input, mesh.origin_mm());
    PALPATE_ASSIGN(made->surface, build_surface_field(input, mesh.order(), report));
    if (own != nullptr) {
      // Frees the map from places to cloud points, which is not needed.
      report.bytes -= own->bytes();
      own->mesh.drop_order();
      report.bytes += own->bytes();
    }
    blend(mesh, made->surface, report);
    report.bytes += made->surface.bytes();
    if (made->moving != nullptr) prepare_deformation(input, context, *made, report);
    made->contact.attach(mesh, made->geometry->tree);
    made->contact.bound_moves(walk_steps());
    report.decisions.models.push_back(explanation(input, made->surface));
    models_.add(std::move(made));
    return Done{};
  }

  /// Takes the geometry from the store unless points may move: then it is private.
  Status prepare_geometry(const ModelInput& input, const PrepareContext& context, LocalDelaunayModel& made,
                          std::shared_ptr<LocalDelaunayGeometry>& own, PrepareReport& report) const {
    if (can_deform(input)) {
      made.geometry = made.moving = build_geometry(*input.cloud, 0, true, false, context, report);
      return Done{};
    }
    const int levels = levels_of(input);
    const bool varied = varies(input.surface);
    PALPATE_ASSIGN(made.geometry,
                   get_or_build<LocalDelaunayGeometry>(
                       context, report,
                       [&] {
                         return fmt::format("stars {:016x} {} {} {} {} {} {}",
                                            cloud::content_hash(*input.cloud), input.cloud->size(), varied,
                                            levels, asked_.both_sides, asked_.raster, has_no_tree());
                       },
                       [&](PrepareReport& to) -> Result<std::shared_ptr<const LocalDelaunayGeometry>> {
                         std::shared_ptr<LocalDelaunayGeometry> built =
                             build_geometry(*input.cloud, levels, varied, true, context, to);
                         if (context.store == nullptr) own = built;
                         return std::shared_ptr<const LocalDelaunayGeometry>(std::move(built));
                       }));
    return Done{};
  }

  std::shared_ptr<LocalDelaunayGeometry> build_geometry(const cloud::Cloud& cloud, int levels,
                                                        bool keep_order, bool with_tree,
                                                        const PrepareContext& context,
                                                        PrepareReport& report) const {
    auto made = std::make_shared<LocalDelaunayGeometry>();
    PreparePhases phases(report, context);
    bool running = false;
    const auto on_step = [&](std::string_view step) {
      if (running) phases.end();
      phases.begin(std::string(step));
      running = true;
    };
    made->mesh = local_delaunay::LocalDelaunayMesh::build(cloud, context.threads, on_step, asked_);
    phases.end();
    if (levels > 0) {
      phases.begin("refine");
      made->mesh = local_delaunay::refined(std::move(made->mesh), levels, context.threads);
      phases.end();
    }
    if (with_tree) {
      phases.begin("tree");
      made->tree = has_no_tree() ? local_delaunay::BlockBvh::none(made->mesh)
                                 : local_delaunay::BlockBvh::build(made->mesh, context.threads);
      phases.end();
    }
    if (!keep_order) made->mesh.drop_order();
    report.bytes += made->bytes();
    note(made->mesh.counts(), made->mesh.size(), report);
    return made;
  }

  static void prepare_deformation(const ModelInput& input, const PrepareContext& context,
                                  LocalDelaunayModel& made, PrepareReport& report) {
    LocalDelaunayGeometry& own = *made.moving;
    const deformation::DeformerCapacity room = deformation::deformer_capacity(own.mesh.size());
    PreparePhases phases(report, context);
    phases.begin("tree");
    report.bytes -= own.bytes() + made.surface.bytes();
    auto points = std::make_unique<deformation::DeformedLocalDelaunay>(own.mesh, own.tree, made.surface,
                                                                       room.spare_points, context.threads);
    own.mesh.drop_order();
    report.bytes += own.bytes() + made.surface.bytes();
    made.deformation.begin(input, std::move(points), room.journal_points, own.tree.box_mm());
    report.bytes += made.deformation.deformer()->bytes();
    report.notes.push_back(
        fmt::format("deformation: up to {} points a frame, {} spare ones, {} changes undone",
                    deformation::kMaxMovedPoints, room.spare_points, room.journal_points));
    phases.end();
  }

  static void note(const local_delaunay::MeshStatistics& counts, std::uint64_t points,
                   PrepareReport& report) {
    report.notes.push_back(fmt::format(
        "{} triangles in {} pieces, {} of them closed and {} closed but for holes; of {} points {:.3g} % "
        "agree with all around them; {} "
        "triangles by "
        "vote, {} in small gaps, {} torn; {} points doubled, {} without a triangle, {} at borders and gaps",
        counts.triangles, counts.pieces, counts.closed_components - counts.components_with_holes,
        counts.components_with_holes, points, 100.0 * share(counts.agreed_points, points), counts.voted,
        counts.filled, counts.unorientable, counts.welded, counts.unused, counts.open_points));
    if (counts.raster_points > 0)
      report.notes.push_back(
          fmt::format("raster: the triangles of {} of {} points are read from its rows and columns; "
                      "raster=off makes them as of any points",
                      counts.raster_points, points));
    if (counts.components_with_holes > 0)
      report.notes.push_back(
          fmt::format("{} closed but for holes: felt from the side where the replay begins; sides=both feels "
                      "both, as of a vase",
                      counts.components_with_holes));
    if (auto wide = wide_mouth_warning(counts.min_enclosed)) report.warnings.push_back(*std::move(wide));
    const double border = kBorderOfSquare / std::sqrt(static_cast<double>(points));
    if (const double open = share(counts.open_points + counts.unused, points); open > kDoubtfulShare + border)
      report.warnings.push_back(
          fmt::format("{:.0f} % of the points lie at gaps: they are too noisy, or too few, for facets "
                      "between them; take cloud-smooth, or "
                      "clean them (palpate clean)",
                      100.0 * open));
  }

  /// Limits the slope of a varying stiffness to what can be felt (blend_stiffness()).
  static void blend(const local_delaunay::LocalDelaunayMesh& mesh, SurfaceField& field,
                    PrepareReport& report) {
    if (field.by_point.empty()) return;
    std::vector<surface::OrientedPoint> points(mesh.size());
    std::vector<search::Neighbours> links(mesh.size());
    double longest_sq = 0.0;
    for (std::uint32_t i = 0; i < mesh.size(); ++i) {
      const Vec3f p = mesh.at(i).cast<float>();
      points[i] = {p.x(), p.y(), p.z(), surface::kNoNormal};
      const local_delaunay::Ring ring = mesh.ring(i);
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

  [[nodiscard]] deformation::Deformer* deformer_of(std::size_t model) const noexcept {
    return model < models_.size() ? models_[model].deformation.deformer() : nullptr;
  }
  template <class Change>
  void put_back(std::size_t model, Change&& change) noexcept {
    models_[model].put_back(models_.counters(), std::forward<Change>(change));
  }

  StarSearch search_;
  local_delaunay::BuildOptions asked_;
};

std::vector<OptionSpec> cloud_specs() {
  return {
      option::choice("combine", "joint",
                     "several models touched at once: constrained jointly, or the sum of their forces",
                     {"joint", "sum"}),
      option::choice("sides", "auto",
                     "of a piece that encloses a volume but for holes: the one where the replay begins "
                     "is felt (auto), or both, as of a vase",
                     {"auto", "both"}),
      option::integer("refine", "0",
                      "times that every triangle is cut into four on curves through the points: half the "
                      "error and four times the memory each",
                      0.0, static_cast<double>(local_delaunay::kMaxRefinement)),
      option::choice("raster", "auto",
                     "triangles are read from the rows and columns of a scan where its cells are a "
                     "surface (auto), or made as of any points (off)",
                     {"auto", "off"}),
      option::integer("walk_steps", fmt::format("{}", local_delaunay::kMaxFacetMoves),
                      "moves of the god object from facet to facet in a frame, at most; what is left is done "
                      "in the next",
                      16.0, 4096.0),
  };
}

}  // namespace

RendererInfo cloud_info() {
  RendererInfo info;
  info.name = "cloud";
  info.summary = kCloudSummary;
  info.source = kCloudSource;
  info.role = Role::kOurs;
  info.supports = kFeaturesOnLocalDelaunay;
  info.options = cloud_specs();
  info.make = [](const Options& options) {
    return std::make_unique<CloudRenderer>(options, StarSearch::kTree);
  };
  return info;
}

RendererInfo brute_force_info() {
  RendererInfo info;
  info.name = "brute-force";
  info.summary = kBruteSummary;
  info.source = "oracle";
  info.role = Role::kOracle;
  info.supports = kFeltRigid;
  info.options = cloud_specs();
  info.make = [](const Options& options) {
    return std::make_unique<CloudRenderer>(options, StarSearch::kNone);
  };
  return info;
}

}  // namespace palpate::render
