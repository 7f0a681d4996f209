#include "toolkit/render/cloud_literal_renderer.h"

#include <cmath>

#include "toolkit/core/tolerances.h"
#include "toolkit/geometry/segment_box.h"
#include "toolkit/partition/cell_walk.h"
#include "toolkit/render/point_walk.h"
#include "toolkit/render/shading.h"

namespace palpate::render {
namespace {

using partition::Cell;

enum class CellRule : std::uint8_t {
  kSampled,   ///< section 3.1.3 as printed: the cells of the sub-segments' starting points
  kCrossed,   ///< every cell the segment crosses
  kAdjacent,  ///< and those whose boxes can reach into it (3.1.4's first remedy)
};

/// The god object sphere clears the box's corner by this share of the half diagonal (the printed "small
/// margin").
constexpr double kSphereMargin = 1e-3;
/// A HIP that moved less than this share of the box per axis rests (the printed "small value"): below it a
/// move is less than a hundredth of the box test's own meaning.
constexpr double kRestShare = 1e-4;
constexpr std::uint32_t kNone = ~std::uint32_t{0};

class CloudLiteral final : public HapticRenderer {
 public:
  explicit CloudLiteral(const Options& options) : options_(options) {}

  Result<PrepareReport> prepare(const SceneInput& scene, const PrepareContext& context) override {
    PrepareReport report;
    PointModelOptions o = point_model_options(options_);
    o.normals = false;
    Result<PointModel> built = build_point_model(scene, o, context, report);
    if (!built) return std::move(built).error();
    model_ = std::move(*built);
    force_limit_n_ = scene.force_limit_n;
    const std::string& cells = options_.text("cells");
    cells_ = cells == "sampled"   ? CellRule::kSampled
             : cells == "crossed" ? CellRule::kCrossed
                                  : CellRule::kAdjacent;
    text_form_ = options_.text("exit_test") == "text";
    count_missed_ = options_.flag("count_missed");
    const std::string& shading = options_.text("shading");
    if (shading == "auto") {
      const bool shade = model_.resolution_mm > kLiteralShadingResolutionMm;
      shading_ = shade ? Shading::kAreaRaw : Shading::kNone;
      report.notes.push_back(shade ? "shading: area-raw, the resolution is above 0.2 mm"
                                   : "shading: none, the resolution is at most 0.2 mm");
    } else {
      shading_ = parse_shading(shading);
    }
    return report;
  }

  void reset(const Vec3& hip_mm) noexcept override {
    previous_ = model_.to_local(hip_mm);
    collided_ = false;
    counters_ = {};
  }

  Frame step(const Vec3& hip_mm, double) noexcept override {
    ++counters_.frames;
    if (!is_finite(hip_mm)) {
      Frame bad;
      bad.status = FrameStatus::kNonFinite;
      return bad;
    }
    const Vec3 h = model_.to_local(hip_mm);
    const Vec3 before = previous_;
    previous_ = h;
    // Figure 42.
    if (collided_) {
      // The figure tests the way back to the old HIP, then to the sphere; the text, at t3, the way to the god
      // object.
      if (crosses(h, before) != kNone) {
        const Vec3 g = model_.points[god_].at();
        const Vec3 aim = text_form_ ? g : Vec3(g + sphere_radius(god_) * last_direction_);
        if (crosses(h, aim) == kNone) {
          collided_ = false;
          return free_frame(hip_mm);
        }
      }
      return contact_frame(h, god_);
    }
    const std::uint32_t first = nearest_crossed(h, before);
    if (first == kNone) return free_frame(hip_mm);
    collided_ = true;
    return contact_frame(h, first);
  }

  FrameCounters counters() const noexcept override { return counters_; }

  Description describe() const override {
    return {
        "cloud-literal", "chapter 3 as printed", "El-Far, chapter 3, figures 36 and 42",
        "unbounded, as printed: cells crossed times points a cell; the walk is bounded by 64 moves a frame",
        options_};
  }

 private:
  double sphere_radius(std::uint32_t place) const noexcept {
    return model_.half_box(place).norm() * (1.0 + kSphereMargin);
  }

  Frame free_frame(const Vec3& hip_mm) const noexcept {
    Frame frame;
    frame.god_object_mm = hip_mm;
    return frame;
  }

  Frame contact_frame(const Vec3& h, std::uint32_t from) noexcept {
    int steps = kMaxWalkSteps;
    const WalkEnd end = walk(model_, from, h, steps, [](std::uint32_t) {});
    counters_.walk_steps += static_cast<std::uint64_t>(kMaxWalkSteps - steps);
    const bool bound = steps == 0;
    counters_.bound_hits += bound;
    god_ = end.place;
    const Vec3 g = model_.points[god_].at();
    Vec3 pull = g - h;
    const double length = pull.norm();
    // The sphere's side comes from the last contact: the direction of the last force.
    if (length > 0.0) last_direction_ = pull / length;
    if (shading_ != Shading::kNone) {
      const NearestTwo two = nearest_two(model_, end);
      pull = shaded_vector(shading_, h, g, model_.points[two.first].at(), model_.points[two.second].at());
    }
    Frame frame;
    frame.contact = true;
    frame.model = 0;
    frame.god_object_mm = model_.to_world(g);
    frame.force_n = limited(model_.direction_to_world(model_.stiffness_n_per_mm * pull), force_limit_n_);
    frame.status = bound ? FrameStatus::kBoundHit : FrameStatus::kOk;
    return frame;
  }

  /// Calls test(place) for the points of the cells the rule selects, until it returns true.
  template <class Test>
  bool any_in_cells(const Vec3& a, const Vec3& b, Test&& test) noexcept {
    const auto in_cell = [&](const Cell& cell) {
      ++counters_.cells_visited;
      const partition::PlaceRange range = model_.grid.find(cell);
      for (std::uint32_t place = range.begin; place < range.end; ++place)
        if (test(place)) return true;
      return false;
    };
    if (cells_ != CellRule::kSampled) {
      const Vec3 reach = cells_ == CellRule::kAdjacent ? model_.largest_half_box_mm : Vec3(Vec3::Zero());
      return !visit_cells(model_.grid, a, b, reach, [&](const Cell& cell) { return !in_cell(cell); });
    }
    // Sub-segments one cell long; the cell of each starting point. A HIP outside the cloud's box is far from
    // all cells: the part of the segment inside it is all that is sampled, so the count is bounded by the
    // grid.
    const Vec3 d = b - a;
    const double pieces = std::max(1.0, std::ceil(d.norm() / model_.grid.cell_mm()));
    const double most = 4.0 * static_cast<double>(model_.grid.last_cell() + 2);
    double t0 = 0.0, t1 = 1.0;
    if (pieces > most && !clip(a, d, t0, t1)) return false;
    const auto begin = static_cast<std::int64_t>(std::floor(t0 * pieces));
    const auto end = static_cast<std::int64_t>(std::ceil(t1 * pieces));
    bool hit = false;
    for (std::int64_t i = begin; i < end && !hit; ++i)
      hit = in_cell(model_.grid.cell_of(a + (static_cast<double>(i) / pieces) * d));
    if (count_missed_) count_missed(a, b, pieces);
    return hit;
  }

  /// The part [t0, t1] of a + t d inside the grid's cells.
  bool clip(const Vec3& a, const Vec3& d, double& t0, double& t1) const noexcept {
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

  /// Cells crossed that hold points and that the printed sampling never looked into.
  void count_missed(const Vec3& a, const Vec3& b, double pieces) noexcept {
    visit_cells(model_.grid, a, b, Vec3::Zero(), [&](const Cell& cell) {
      if (model_.grid.find(cell).empty()) return true;
      bool seen = false;
      for (double i = 0; i < pieces && !seen; ++i) {
        const Cell at = model_.grid.cell_of(a + (i / pieces) * (b - a));
        seen = at.x == cell.x && at.y == cell.y && at.z == cell.z;
      }
      counters_.missed_cells += !seen;
      return true;
    });
  }

  bool resting(const Vec3& a, const Vec3& b) const noexcept {
    return ((b - a).cwiseAbs().array() < kRestShare * model_.largest_half_box_mm.array()).all();
  }

  /// Some crossed vertex, or kNone.
  std::uint32_t crosses(const Vec3& a, Vec3 b) noexcept {
    if (resting(a, b)) b = a;
    const geometry::SegmentProbe probe(a, b);
    std::uint32_t found = kNone;
    any_in_cells(a, b, [&](std::uint32_t place) {
      ++counters_.box_tests;
      if (!geometry::segment_touches_box(probe, model_.points[place].at(), model_.half_box(place)))
        return false;
      found = place;
      return true;
    });
    return found;
  }

  /// The crossed vertex nearest to the old HIP; ties go to the first in grid order.
  std::uint32_t nearest_crossed(const Vec3& h, const Vec3& before) noexcept {
    const Vec3 b = resting(before, h) ? before : h;
    const geometry::SegmentProbe probe(before, b);
    std::uint32_t found = kNone;
    double nearest = 0.0;
    any_in_cells(before, b, [&](std::uint32_t place) {
      ++counters_.box_tests;
      const StoredPoint& p = model_.points[place];
      if (!geometry::segment_touches_box(probe, p.at(), model_.half_box(place))) return false;
      const double d = distance_sq(p, before);
      if (found == kNone || d < nearest || (d == nearest && place < found)) {
        found = place;
        nearest = d;
      }
      return false;
    });
    return found;
  }

  Options options_;
  PointModel model_;
  CellRule cells_ = CellRule::kSampled;
  Shading shading_ = Shading::kNone;
  bool text_form_ = false;
  bool count_missed_ = false;
  double force_limit_n_ = 0.0;
  Vec3 previous_ = Vec3::Zero();
  Vec3 last_direction_ = Vec3::UnitZ();
  std::uint32_t god_ = 0;
  bool collided_ = false;
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
