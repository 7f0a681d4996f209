#include "baselines/rivals.h"

#include <fmt/format.h>
#include <Eigen/Geometry>  // cross products

#include <array>
#include <cmath>
#include <cstddef>
#include <memory>
#include <string>
#include <utility>

#include <palpate/result.h>
#include <palpate/vec.h>
#include "baselines/points/point_contact.h"
#include "baselines/points/sheet.h"
#include "toolkit/core/tolerances.h"
#include "toolkit/geometry/half_space_projection.h"
#include "toolkit/render/frame_loop_renderer.h"
#include "toolkit/render/joint_contact.h"
#include "toolkit/render/shading.h"
#include "toolkit/render/surface_response.h"
#include "toolkit/search/neighbour_table.h"

namespace palpate::baselines::vertices {
namespace {

/// The nearer of two neighbours within 15 degrees of each other (cos 0.966; the sine is kMinFacetSine) is a
/// corner; a facet between them would be a sliver with a noisy plane.
constexpr double kSameDirectionCosine = 0.966;

/// Neighbours around a point, counter-clockwise from outside: corners of the facets there.
struct TriangleFan {
  struct Corner {
    Vec3 d;  ///< relative to the point
    double u, v, square, turn;
  };
  std::array<Corner, search::kNeighbours> corner;
  std::size_t size = 0;

  [[nodiscard]] std::size_t after(std::size_t i) const noexcept { return i + 1 == size ? 0 : i + 1; }
  /// Adds a corner unless a nearer one in the same direction was added.
  void take(const Vec3& d, double du, double dv) noexcept {
    const double in_plane = du * du + dv * dv;
    // The place is on the normal line, or the point itself.
    if (!(in_plane > kMinFacetSine * kMinFacetSine * d.squaredNorm())) return;
    for (std::size_t i = 0; i < size; ++i) {
      const double same = corner[i].u * du + corner[i].v * dv;
      if (same > 0.0 &&
          same * same > kSameDirectionCosine * kSameDirectionCosine * corner[i].square * in_plane)
        return;
    }
    // Grows with the angle, from -2 to 2.
    const double share = dv / (std::abs(du) + std::abs(dv));
    const double at = du >= 0.0 ? share : dv >= 0.0 ? 2.0 - share : -2.0 - share;
    std::size_t i = size++;
    for (; i > 0 && corner[i - 1].turn > at; --i) corner[i] = corner[i - 1];
    corner[i] = {d, du, dv, in_plane, at};
  }
  /// No gap over 165 degrees: a facet fits between successive corners.
  [[nodiscard]] bool closed() const noexcept {
    if (size < 3) return false;
    for (std::size_t i = 0; i < size; ++i) {
      const Corner &a = corner[i], &b = corner[after(i)];
      const double across = a.u * b.v - a.v * b.u;
      if (!(across > 0.0 && across * across > kMinFacetSine * kMinFacetSine * a.square * b.square))
        return false;
    }
    return true;
  }
};

/// The fan around a point with outward unit normal `outward`. corner(k): its neighbour k relative to it,
/// nearest first; the point itself if absent. Allocates nothing.
template <class Corner>
TriangleFan triangle_fan(const Vec3& outward, Corner&& corner) noexcept {
  const Vec3 e = outward.unitOrthogonal(), f = outward.cross(e);
  TriangleFan fan;
  for (std::size_t k = 0; k < search::kNeighbours; ++k) {
    const Vec3 d = corner(k);
    fan.take(d, e.dot(d), f.dot(d));
  }
  return fan;
}

/// The vector from r to the nearest place on the fan.
Vec3 pull_to(const TriangleFan& fan, const Vec3& r) noexcept {
  double least = r.squaredNorm();
  Vec3 best = -r;
  std::array<Vec3, search::kNeighbours> aside;  // corner x r
  for (std::size_t i = 0; i < fan.size; ++i) {
    const Vec3& d = fan.corner[i].d;
    aside[i] = d.cross(r);
    const double along = d.dot(r);
    if (!(along > 0.0)) continue;
    const Vec3 to_line = (along / d.squaredNorm()) * d - r;
    const double square = to_line.squaredNorm();
    if (!(square < least)) continue;
    least = square;
    best = to_line;
  }
  for (std::size_t i = 0; i < fan.size; ++i) {
    const std::size_t j = fan.after(i);
    const Vec3 n = fan.corner[i].d.cross(fan.corner[j].d);
    if (!(n.dot(aside[i]) >= 0.0 && n.dot(aside[j]) <= 0.0)) continue;  // the projection is beside the facet
    const double height = n.dot(r), area_sq = n.squaredNorm();
    if (!(height * height < least * area_sq)) continue;
    least = height * height / area_sq;
    best = (-height / area_sq) * n;
  }
  return best;
}

}  // namespace

Vec3 pull_at_crease(const points::PointModel& model, const points::WalkResult& end, const Vec3& outward,
                    const Vec3& h, const Vec3& pull) noexcept {
  const Vec3 g = model.points[end.place].at();
  const TriangleFan fan = triangle_fan(
      outward, [&](std::size_t k) { return Vec3(Vec3(end.x_mm[k], end.y_mm[k], end.z_mm[k]) - g); });
  return fan.closed() ? pull_to(fan, h - g) : pull;
}

namespace {

/// The local model of `cloud-vertices`: one cloud's contact, read as pull, plane and properties. Belongs to
/// one thread. The model stays where it is once its contact is attached, which refers to the points.
class VerticesModel {
 public:
  using Memory = points::WalkResult;
  static constexpr bool kTemplatedOnFeatures = true;

  [[nodiscard]] ModelPose& pose() noexcept { return body.pose; }
  [[nodiscard]] const ModelPose& pose() const noexcept { return body.pose; }
  [[nodiscard]] unsigned features() const noexcept { return body.surface.features; }
  [[nodiscard]] const geometry::Aabb& box_mm() const noexcept { return prepared_box_mm; }
  [[nodiscard]] bool touching() const noexcept { return contact.contact(); }

  void restart(const Vec3& h) noexcept {
    contact.reset(h);
    release();
  }
  void release_contact(const Vec3& h) noexcept {
    contact.start_from(h);
    release();
  }
  void release() noexcept { state.release(); }

  template <unsigned kFeatures>
  [[nodiscard]] bool touch(const Vec3& /*goal*/, const Vec3& h, points::WalkResult& end,
                           SurfaceContact& answer, FrameStatus& status, FrameCounters& counters) noexcept {
    const bool held = contact.update(h, end, counters);
    if (contact.bound_hit()) status = FrameStatus::kBoundHit;
    if (held) answer = contact_at<kFeatures>(end, h);
    return held;
  }
  template <unsigned kFeatures>
  [[nodiscard]] SurfaceResponse respond(const SurfaceContact& at) noexcept {
    return state.respond<kFeatures>(at, body.surface.texture, body.pose.origin_mm);
  }
  void planes_near(const points::WalkResult& end, const Vec3& at_world, JointPlanes& planes,
                   FrameCounters& counters) const noexcept {
    planes.add(plane_near(end.place, body.pose.to_local(at_world), counters));
  }
  points::PointInstance body;
  PointContact contact;
  SurfaceState state;
  geometry::Aabb prepared_box_mm;  ///< local; prepared points with the reach of their boxes
  Shading shading = Shading::kNone;
  bool by_spacing = false;  ///< shaded only where the spacing is felt
  double felt_spacing_sq_mm2 = 0.0;

 private:
  template <unsigned kFeatures>
  [[nodiscard]] SurfaceContact contact_at(const points::WalkResult& end, const Vec3& h) const noexcept;
  [[nodiscard]] geometry::HalfSpace plane_near(std::uint32_t start, const Vec3& at,
                                               FrameCounters& counters) const noexcept;
};

/// The frictionless contact at the walk's end, local.
template <unsigned kFeatures>
inline SurfaceContact VerticesModel::contact_at(const points::WalkResult& end, const Vec3& h) const noexcept {
  const points::PointModel& model = *body.points;
  const Vec3 g = model.points[end.place].at();
  SurfaceContact at = uniform_contact(body.surface, h, g - h);
  points::NearestTwo two{end.place, end.place};
  const bool varied = (kFeatures & kVaried) != 0 && !body.surface.by_point.empty();
  if (shading != Shading::kNone || varied) {
    two = shading == Shading::kFacet || varied ? enclosing_two(model, end, contact.outward(), h)
                                               : points::nearest_two(model, end);
    __builtin_prefetch(&model.neighbours[two.first]);  // the god object's likely next place
    const Vec3 b = model.points[two.first].at();
    if (shading != Shading::kNone && (!by_spacing || (b - g).squaredNorm() > felt_spacing_sq_mm2)) {
      const Vec3 c = model.points[two.second].at();
      if (shading == Shading::kFacet) {
        const FacetPlane plane = facet_plane(g, b, c);
        if (plane.usable) {
          const Vec3& n = plane.scaled_normal;
          at.pull = (at.pull.dot(n) / plane.area_sq) * n;
          if (at_crease(plane, contact.outward()) && beside(plane, b - g, c - g, h - g)) [[unlikely]]
            at.pull = pull_at_crease(model, end, contact.outward(), h, at.pull);
        }
      } else {
        at.pull = shaded_vector(shading, h, g, b, c);
      }
    }
  }
  if (varied) {
    const PointSurface& here = body.surface.by_point[end.place];
    const auto stiffness = [&](std::uint32_t place) {
      return static_cast<double>(body.surface.by_point[place].stiffness_n_per_mm);
    };
    const FacetStiffness k =
        stiffness_on_facet(g, model.points[two.first].at(), model.points[two.second].at(),
                           static_cast<double>(here.stiffness_n_per_mm), stiffness(two.first),
                           stiffness(two.second), h + at.pull);
    at.stiffness_n_per_mm = k.n_per_mm;
    at.stiffness_gradient = k.gradient;
    at.static_friction = static_cast<double>(here.static_friction);
    at.dynamic_friction = static_cast<double>(here.dynamic_friction);
  }
  return at;
}

/// The surface's plane near a place, found without moving the contact: a half-space in the world.
inline geometry::HalfSpace VerticesModel::plane_near(std::uint32_t start, const Vec3& at,
                                                     FrameCounters& counters) const noexcept {
  const points::PointModel& model = *body.points;
  Sheet sheet = contact.sheet();
  sheet.place = start;
  int steps = points::kMaxWalkSteps;
  const points::WalkResult end = follow(model, sheet, at, steps, counters);
  const Vec3 g = model.points[end.place].at();
  Vec3 normal = sheet.outward;
  if (shading != Shading::kNone) {
    const points::NearestTwo two = enclosing_two(model, end, sheet.outward, at);
    const FacetPlane plane = facet_plane(g, model.points[two.first].at(), model.points[two.second].at());
    if (plane.usable)
      normal = plane.scaled_normal.normalized() * (plane.scaled_normal.dot(sheet.outward) < 0.0 ? -1.0 : 1.0);
  }
  const Vec3 n = body.pose.direction_to_world(normal);
  return {n, n.dot(body.pose.to_world(g))};
}

constexpr const char* kSummary = "the thesis's chapter 3 made right: a plane at every point";
constexpr const char* kSource =
    "El-Far, chapter 3; side, bounds, creases, friction cone and joint contact ours";

struct SpacedShading : ShadingDecision {
  bool by_spacing = false;       ///< only where the next point is farther off than felt_spacing_mm
  double felt_spacing_mm = 0.0;  ///< a change of point over it is felt: kPerceptibleForceStepN / stiffness
};

/// A change of point moves the force by stiffness x spacing. Contacts are shaded by the facet where that is
/// felt, and not at all if no spacing is so large, which spares time and bytes.
SpacedShading shading_for(const std::string& choice, const points::PointModelDecision& decided) {
  if (choice != "auto") return {given_shading(choice)};
  const double stiffness = decided.surface.largest_stiffness_n_per_mm,
               spacing = decided.points.max_spacing_mm;
  const double step_n = stiffness * spacing;
  SpacedShading shading;
  shading.by_spacing = step_n > kPerceptibleForceStepN;
  shading.felt_spacing_mm = kPerceptibleForceStepN / stiffness;
  if (shading.by_spacing) shading.shading = Shading::kFacet;
  shading.explanation = {
      "shading", shading.by_spacing ? "facet, where a point's spacing asks for it" : "none",
      fmt::format(
          "a change of point moves the force by {} {:.3g} N/mm x {:.3g} mm = {:.3g} N, and {} N is felt",
          shading.by_spacing ? "up to" : "at most", stiffness, spacing, step_n, kPerceptibleForceStepN)};
  return shading;
}

class CloudVertices final : public FrameLoopRenderer<VerticesModel> {
 public:
  static constexpr Features kFelt = kAllOfRigidSurfaces | Feature::kJointContact;
  // Measured (see kReferenceMachine); they say what to expect, no decision rests on them. A frame in contact:
  // 1,002,001 points. Preparation on two threads: reproduce, neighbours known from a scan's
  // order or searched.
  static constexpr double kFrameUs = 0.25;
  static constexpr double kScanOrderMsPerMillion = 450.0, kSearchMsPerMillion = 900.0;

  explicit CloudVertices(const Options& options) : FrameLoopRenderer(options) {}

  Description describe() const override {
    return {"cloud-vertices", kSummary, kSource,
            fmt::format(
                "a model near the HIP: {} moves of the god object and {} along an edge, {} wider looks of 64 "
                "points, {} box tests, segments of {} cells, at a crease {} facets and as many lines a "
                "frame; what is left is done in the next; of models touched at once the {} deepest",
                points::kMaxWalkSteps, kMaxFaceMoves, kMaxEscapes, kMaxBoxTests, kMaxSegmentCells,
                search::kNeighbours, kMaxTouched),
            options_};
  }

 private:
  Status add_models(const SceneInput& scene, const PrepareContext& context, PrepareReport& report) override {
    for (const ModelInput& input : scene.models) PALPATE_TRY(prepare_model(input, context, report));
    return Done{};
  }
  [[nodiscard]] points::PointModelOptions point_options() const {
    points::PointModelOptions o = points::point_model_options(options_);
    o.blend_resolutions = kBlendResolutions;
    return o;
  }
  [[nodiscard]] SpacedShading shading_of(const points::PointModelDecision& decided) const {
    return shading_for(options_.text("shading"), decided);
  }

  Result<ModelDecisions> decide_model(const ModelInput& input, const PrepareContext& context) const override {
    PALPATE_ASSIGN(const points::PointModelDecision decided,
                   points::decide_point_model(input, point_options(), context));
    return decisions_for(input, decided);
  }
  [[nodiscard]] ModelDecisions decisions_for(const ModelInput& input,
                                             const points::PointModelDecision& decided) const {
    const points::PointDecision& points = decided.points;
    ModelDecisions out;
    out.name = input.name;
    points::describe_points(*input.cloud, point_options(), points, out);
    const double millions = 1e-6 * static_cast<double>(input.cloud->size());
    out.prepare_ms = millions * (points.from_scan ? kScanOrderMsPerMillion : kSearchMsPerMillion);
    out.frame_us = kFrameUs;
    out.decisions.push_back(shading_of(decided).explanation);
    describe_surface(input, decided.surface, kFelt, input.cloud->size(), out);
    if (input.motion != nullptr)
      out.decisions.push_back({"motion", "pose read in each frame", "the scene moves it", true});
    return out;
  }

  Status prepare_model(const ModelInput& input, const PrepareContext& context, PrepareReport& report) {
    auto made = std::make_unique<VerticesModel>();
    PALPATE_ASSIGN(made->body, points::build_point_body(input, point_options(), context, report));
    const points::PointModel& points = *made->body.points;
    const points::PointModelDecision decided = made->body.decided();
    const SpacedShading shading = shading_of(decided);
    report.decisions.models.push_back(decisions_for(input, decided));
    if (!shading.explanation.given) report.notes.push_back(note_text(shading.explanation));
    made->shading = shading.shading;
    made->by_spacing = shading.by_spacing;
    made->felt_spacing_sq_mm2 = shading.felt_spacing_mm * shading.felt_spacing_mm;
    made->contact.attach(points);
    for (const points::StoredPoint& p : points.points) made->prepared_box_mm.add(p.at());
    made->prepared_box_mm.low_mm -= points.largest_half_box_mm;
    made->prepared_box_mm.high_mm += points.largest_half_box_mm;
    models_.add(std::move(made));
    return Done{};
  }
};

}  // namespace

}  // namespace palpate::baselines::vertices

namespace palpate::baselines {

render::RendererInfo cloud_vertices_info() {
  using namespace vertices;
  RendererInfo info;
  info.name = "cloud-vertices";
  info.summary = kSummary;
  info.source = kSource;
  info.supports = CloudVertices::kFelt;
  info.options = points::point_model_specs();
  for (OptionSpec& spec : info.options) {
    if (spec.key != "cell") continue;
    spec.default_value = "0";
    spec.only_with = {{"partition", {"grid"}}};  // the leaves of a tree choose their own sizes
  }
  for (OptionSpec& spec : points::box_test_specs()) info.options.push_back(std::move(spec));
  info.options.push_back(points::partition_spec());
  info.options.push_back(shading_spec("force shading; auto: facet where stiffness x local spacing is felt"));
  info.make = [](const Options& options) { return std::make_unique<CloudVertices>(options); };
  return info;
}

}  // namespace palpate::baselines
