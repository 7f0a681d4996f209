#include "toolkit/renderers/renderer_infos.h"

#include <cmath>
#include <cstdint>
#include <memory>
#include <utility>

#include <palpate/result.h>
#include "toolkit/core/option_specs.h"
#include "toolkit/core/tolerances.h"
#include "toolkit/geometry/segment_box.h"
#include "toolkit/points/point_model.h"
#include "toolkit/points/point_walk.h"
#include "toolkit/render/frame_loop_renderer.h"
#include "toolkit/render/shading.h"
#include "toolkit/render/surface_response.h"
#include "toolkit/search/uniform_grid.h"

namespace palpate::render {
namespace {

using search::Cell;

/// The cells that a segment searches.
enum class CellRule : std::uint8_t {
  kSampled,   ///< as printed (section 3.1.3): cells at the starts of sub-segments
  kCrossed,   ///< every cell the segment crosses
  kAdjacent,  ///< also those whose boxes can reach into it (first remedy of 3.1.4)
};

struct LiteralOptions {
  CellRule cells = CellRule::kSampled;
  bool text_form = false;  ///< uses the exit test of section 3.2.4's text, not the figure's
};

/// One model of `cloud-literal`: figures 36 and 42 and section 3.5 to the letter, with their defects. Belongs
/// to one thread. Work per update as printed: cells crossed times points per cell, unbounded; walks
/// of at most kMaxWalkSteps moves.
class LiteralModel {
 public:
  LiteralModel(points::PointInstance body, Shading shading, const LiteralOptions& options) noexcept
      : body_(std::move(body)), model_(*body_.points), shading_(shading), options_(options) {}

  // A local model of the frame loop. The thesis does not say how several contacts combine.
  struct Memory {};
  static constexpr bool kForcesAddUp = true;
  [[nodiscard]] ModelPose& pose() noexcept { return body_.pose; }
  [[nodiscard]] const ModelPose& pose() const noexcept { return body_.pose; }
  void release_contact(const Vec3& h) noexcept;
  void release() noexcept {}  // friction rolls the god object back and keeps no other state
  [[nodiscard]] bool touch(const Vec3& goal, const Vec3& h, Memory& memory, SurfaceContact& contact,
                           FrameStatus& status, FrameCounters& counters) noexcept;
  [[nodiscard]] SurfaceResponse respond(const SurfaceContact& /*contact*/) const noexcept { return answer_; }

 private:
  void answer(const Vec3& h, std::uint32_t from, FrameStatus& status, FrameCounters& counters) noexcept;
  [[nodiscard]] double sphere_radius(std::uint32_t place) const noexcept;
  template <class Test>
  bool any_in_cells(const Vec3& a, const Vec3& b, FrameCounters& counters, Test&& test) const noexcept;
  template <class Test>
  bool any_sampled(const Vec3& a, const Vec3& b, Test&& test) const noexcept;
  bool clip(const Vec3& a, const Vec3& d, double& t0, double& t1) const noexcept;
  [[nodiscard]] bool resting(const Vec3& a, const Vec3& b) const noexcept;
  [[nodiscard]] bool touches(const geometry::SegmentProbe& probe, std::uint32_t place,
                             FrameCounters& counters) const noexcept;
  [[nodiscard]] bool crosses(const Vec3& a, Vec3 b, FrameCounters& counters) const noexcept;
  [[nodiscard]] std::uint32_t nearest_crossed(const Vec3& h, const Vec3& before,
                                              FrameCounters& counters) const noexcept;

  points::PointInstance body_;
  const points::PointModel& model_;
  Shading shading_;
  LiteralOptions options_;
  Vec3 previous_ = Vec3::Zero();
  Vec3 last_direction_ = Vec3::UnitZ();
  std::uint32_t god_ = 0;  ///< of the last contact frame, after friction
  bool collided_ = false;
  SurfaceResponse answer_;  ///< of the last touch
};

/// Clearance of the god object sphere from the box's corner, as a share of the half diagonal (the printed
/// "small margin").
constexpr double kSphereMargin = 1e-3;
/// A HIP that moves less than this share of the box per axis rests (the printed "small value"); such moves
/// are a hundredth of the box test's precision.
constexpr double kRestShare = 1e-4;
/// 2^53, the integer range of a double; more sub-segments are indistinguishable.
constexpr double kMaxPieces = 9007199254740992.0;
constexpr std::uint32_t kNoPoint = ~std::uint32_t{0};

[[nodiscard]] bool same(const Cell& a, const Cell& b) noexcept {
  return a.x == b.x && a.y == b.y && a.z == b.z;
}

void LiteralModel::release_contact(const Vec3& h) noexcept {
  previous_ = h;
  collided_ = false;
}

bool LiteralModel::touch(const Vec3& /*goal*/, const Vec3& h, Memory& /*memory*/, SurfaceContact& contact,
                         FrameStatus& status, FrameCounters& counters) noexcept {
  const Vec3 before = previous_;
  previous_ = h;
  // Figure 42. Both branches begin with figure 36, with the segment from the old HIP to this one.
  if (collided_) {
    // The figure then tests the way to the sphere; the text, at t3, the way to the god object.
    if (crosses(before, h, counters)) {
      const Vec3 g = model_.points[god_].at();
      const Vec3 aim = options_.text_form ? g : Vec3(g + sphere_radius(god_) * last_direction_);
      if (!crosses(h, aim, counters)) {
        collided_ = false;
        return false;
      }
    }
    answer(h, god_, status, counters);
  } else {
    const std::uint32_t first = nearest_crossed(h, before, counters);
    if (first == kNoPoint) return false;
    answer(h, first, status, counters);
  }
  contact.hip = h;
  contact.pull = answer_.god_object_mm - h;
  return true;
}

void LiteralModel::answer(const Vec3& h, std::uint32_t from, FrameStatus& status,
                          FrameCounters& counters) noexcept {
  int steps = points::kMaxWalkSteps;
  points::WalkResult end = points::walk(model_, from, h, steps, [](std::uint32_t) {});
  counters.walk_steps += static_cast<std::uint64_t>(points::kMaxWalkSteps - steps);
  if (steps == 0) status = FrameStatus::kBoundHit;
  // Section 3.5.2, then 3.4, then figure 46: friction moves the god object, shading reads the points around
  // it, deformation scales the rigid force there. The moved god object is the only one: the next walk starts
  // from it, and the sphere shares its point.
  if (collided_ && (body_.surface.features & kFriction) != 0) {
    const std::uint32_t rolled = roll_back_friction(
        end.place, god_, h, body_.surface.static_friction(god_), points::kMaxWalkSteps,
        [this](std::uint32_t p) { return model_.points[p].at(); },
        [this](std::uint32_t p, auto&& use) {
          for (const std::uint32_t other : model_.neighbours[p]) use(other);
        });
    if (rolled != end.place) {
      end.place = rolled;
      end.load_neighbours(model_, h);
    }
  }
  god_ = end.place;
  collided_ = true;
  const Vec3 g = model_.points[god_].at();
  Vec3 pull = g - h;
  const double length = pull.norm();
  // The sphere's side is the direction of the last contact's pull.
  if (length > 0.0) last_direction_ = pull / length;
  if (shading_ != Shading::kNone) {
    const points::NearestTwo two = points::nearest_two(model_, end);
    pull = shaded_vector(shading_, h, g, model_.points[two.first].at(), model_.points[two.second].at());
  }
  const double stiffness = (body_.surface.features & kVaried) != 0
                               ? static_cast<double>(body_.surface.by_point[god_].stiffness_n_per_mm)
                               : body_.surface.stiffness_n_per_mm;
  answer_ = {stiffness * pull, g};
}

double LiteralModel::sphere_radius(std::uint32_t place) const noexcept {
  return model_.half_box(place).norm() * (1.0 + kSphereMargin);
}

/// Calls test(place) for points of the rule's cells until it returns true.
template <class Test>
bool LiteralModel::any_in_cells(const Vec3& a, const Vec3& b, FrameCounters& counters,
                                Test&& test) const noexcept {
  const auto in_cell = [&](const Cell& cell) {
    ++counters.cells_visited;
    const search::IndexRange range = model_.grid.find(cell);
    for (std::uint32_t place = range.begin; place < range.end; ++place)
      if (test(place)) return true;
    return false;
  };
  if (options_.cells != CellRule::kSampled || model_.sphere_mm > 0.0) {
    Vec3 reach = options_.cells == CellRule::kAdjacent ? model_.largest_half_box_mm : Vec3(Vec3::Zero());
    reach += Vec3::Constant(model_.sphere_mm);  // a swept sphere crosses cells with its volume
    return !visit_cells(model_.grid, a, b, reach, [&](const Cell& cell) { return !in_cell(cell); });
  }
  return any_sampled(a, b, in_cell);
}

/// Calls test(cell), until it returns true, for the cells of section 3.1.3: those at the starts of
/// sub-segments at most one cell long, and that at the end of the last one.
template <class Test>
bool LiteralModel::any_sampled(const Vec3& a, const Vec3& b, Test&& test) const noexcept {
  const Vec3 d = b - a;
  const double pieces = std::max(1.0, std::ceil(d.norm() / model_.grid.cell_mm()));
  if (!(pieces < kMaxPieces)) return false;
  // Samples only the part of the segment inside the cloud's box, so the grid bounds the count for a far HIP
  // too.
  const double most = 4.0 * static_cast<double>(model_.grid.last_cell() + 2);
  double t0 = 0.0, t1 = 1.0;
  if (pieces > most && !clip(a, d, t0, t1)) return false;
  const double first = std::floor(t0 * pieces), last = std::min(std::ceil(t1 * pieces), first + most);
  Cell before{-1, -1, -1};  // no such cell
  for (double i = first; i <= last; ++i) {
    const Cell cell = model_.grid.cell_of(i == pieces ? b : Vec3(a + (i / pieces) * d));
    if (same(cell, before)) continue;
    if (test(cell)) return true;
    before = cell;
  }
  return false;
}

/// The part [t0, t1] of a + t d inside the grid.
bool LiteralModel::clip(const Vec3& a, const Vec3& d, double& t0, double& t1) const noexcept {
  const Vec3 low = model_.grid.lattice().low_mm;
  const double side = static_cast<double>(model_.grid.last_cell() + 1) * model_.grid.cell_mm();
  for (int axis = 0; axis < 3; ++axis) {
    if (d[axis] == 0.0) {
      if (a[axis] < low[axis] || a[axis] > low[axis] + side) return false;
      continue;
    }
    const double s = (low[axis] - a[axis]) / d[axis], e = (low[axis] + side - a[axis]) / d[axis];
    t0 = std::max(t0, std::min(s, e));
    t1 = std::min(t1, std::max(s, e));
  }
  return t0 <= t1;
}

bool LiteralModel::resting(const Vec3& a, const Vec3& b) const noexcept {
  return ((b - a).cwiseAbs().array() < kRestShare * model_.largest_half_box_mm.array()).all();
}

/// The test of section 3.1.1.2, or the swept sphere of 3.1.4.
bool LiteralModel::touches(const geometry::SegmentProbe& probe, std::uint32_t place,
                           FrameCounters& counters) const noexcept {
  const Vec3 centre = model_.points[place].at(), half = model_.half_box(place);
  const bool crossed = geometry::segment_touches_box(probe, centre, half);
  if (crossed || !(model_.sphere_mm > 0.0)) return crossed;
  if (!geometry::swept_sphere_touches_box(probe, model_.sphere_mm, centre, half)) return false;
  ++counters.sphere_only;
  return true;
}

/// True if the segment crosses any vertex AABB.
bool LiteralModel::crosses(const Vec3& a, Vec3 b, FrameCounters& counters) const noexcept {
  if (resting(a, b)) b = a;
  const geometry::SegmentProbe probe(a, b);
  return any_in_cells(a, b, counters, [&](std::uint32_t place) {
    ++counters.box_tests;
    return touches(probe, place, counters);
  });
}

/// The crossed vertex nearest to the old HIP; ties go to the first in grid order.
std::uint32_t LiteralModel::nearest_crossed(const Vec3& h, const Vec3& before,
                                            FrameCounters& counters) const noexcept {
  const Vec3 b = resting(before, h) ? before : h;
  const geometry::SegmentProbe probe(before, b);
  std::uint32_t found = kNoPoint;
  double nearest = 0.0;
  any_in_cells(before, b, counters, [&](std::uint32_t place) {
    ++counters.box_tests;
    const points::StoredPoint& p = model_.points[place];
    if (!touches(probe, place, counters)) return false;
    const double d = points::distance_sq(p, before);
    if (found == kNoPoint || d < nearest || (d == nearest && place < found)) {
      found = place;
      nearest = d;
    }
    return false;
  });
  return found;
}

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
