#include "toolkit/render/cloud_renderer.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "toolkit/core/tolerances.h"
#include "toolkit/render/box_scan.h"
#include "toolkit/render/shading.h"
#include "toolkit/render/sheet.h"

namespace palpate::render {
namespace {

/// Sheets watched while free: two faces that meet and one more that comes near.
constexpr std::size_t kMaxSheets = 3;
/// A watched sheet is let go beyond this many half diagonals of the largest box: a HIP inside any of its
/// boxes is within one.
constexpr double kLeaveHalfDiagonals = 1.5;
/// Crossed boxes within this many half diagonals of a watched god object, with a plane within 60 degrees of
/// its own, belong to that sheet.
constexpr double kSameSheetHalfDiagonals = 2.0;
constexpr double kSameSheetCosine = 0.5;
/// A neighbour within some 75 degrees of a direction continues the sheet that way.
constexpr double kRimCosine = 0.25;

class Cloud final : public HapticRenderer {
 public:
  explicit Cloud(const Options& options) : options_(options) {}

  Result<PrepareReport> prepare(const SceneInput& scene, const PrepareContext& context) override {
    PrepareReport report;
    Result<PointModel> built = build_point_model(scene, point_model_options(options_), context, report);
    if (!built) return std::move(built).error();
    model_ = std::move(*built);
    force_limit_n_ = scene.force_limit_n;
    const std::string& shading = options_.text("shading");
    if (shading == "auto") {
      // Each change of point moves the force by stiffness x spacing; where no spacing is large enough,
      // nothing is shaded and the frame is built without it.
      const double largest = model_.stiffness_n_per_mm * model_.max_spacing_mm;
      by_spacing_ = largest > kFeltForceStepN;
      shading_ = by_spacing_ ? Shading::kFacet : Shading::kNone;
      report.notes.push_back(
          fmt::format("shading: {}, stiffness x spacing is at most {:.3g} N ({} N is felt)",
                      by_spacing_ ? "facet where spacing asks for it" : "none", largest, kFeltForceStepN));
      const double felt_mm = kFeltForceStepN / model_.stiffness_n_per_mm;
      felt_spacing_sq_mm2_ = felt_mm * felt_mm;
    } else {
      shading_ = parse_shading(shading);
      by_spacing_ = false;
    }
    const double half_diagonal = model_.largest_half_box_mm.norm();
    leave_sq_mm2_ = (kLeaveHalfDiagonals * half_diagonal) * (kLeaveHalfDiagonals * half_diagonal);
    same_sheet_sq_mm2_ =
        (kSameSheetHalfDiagonals * half_diagonal) * (kSameSheetHalfDiagonals * half_diagonal);
    clear(Vec3::Zero());
    return report;
  }

  void reset(const Vec3& hip_mm) noexcept override {
    clear(model_.to_local(hip_mm));
    // The free side of a closed surface is where the HIP is now: outside, or inside a cavity.
    if (model_.closed)
      closed_side_ = surface::is_enclosed(model_.points, model_.neighbours, tested_to_) ? -1.0 : 1.0;
  }

  Frame step(const Vec3& hip_mm, double) noexcept override {
    ++counters_.frames;
    Frame frame;
    if (!is_finite(hip_mm)) {
      frame.status = FrameStatus::kNonFinite;
      return frame;
    }
    frame.god_object_mm = hip_mm;
    const Vec3 h = model_.to_local(hip_mm);
    steps_ = kMaxWalkSteps;
    if (contact_) {
      stay(h, frame);
    } else {
      look(h, frame);
    }
    previous_ = h;
    if (steps_ == 0 || scan_.running) frame.status = FrameStatus::kBoundHit;
    counters_.bound_hits += frame.status == FrameStatus::kBoundHit;
    return frame;
  }

  FrameCounters counters() const noexcept override { return counters_; }

  Description describe() const override {
    return {
        "cloud", "chapter 3 made right", "El-Far, chapter 3; side and bounds ours",
        fmt::format(
            "{} moves of the god object, {} wider looks of 64 points, {} box tests, segments of {} cells a "
            "frame; what is left is done in the next",
            kMaxWalkSteps, kMaxRescues, kMaxBoxTests, kMaxSegmentCells),
        options_};
  }

 private:
  void clear(const Vec3& h) noexcept {
    tested_to_ = h;
    previous_ = h;
    sheets_ = 0;
    contact_ = false;
    scan_.running = false;
    counters_ = {};
  }

  /// In contact: the god object follows; the HIP is out when it is above the plane there.
  void stay(const Vec3& h, Frame& frame) noexcept {
    Sheet& sheet = near_[0];
    const double before = height_mm_;  // of the last frame's HIP over the last frame's plane
    const WalkEnd end = follow(model_, sheet, h, steps_, counters_);
    const double height = height_mm_ = height_mm(model_, sheet, h);
    if (sheet.walk_cut || (height < 0.0 && !beyond_rim(sheet, h))) {
      answer(h, end, frame);
      return;
    }
    contact_ = false;
    sheets_ = 1;
    // The way out crossed the plane somewhere; from there on the HIP was free, and may have met something
    // else.
    const double out = before < 0.0 && height > 0.0 ? before / (before - height) : 1.0;
    tested_to_ = previous_ + out * (h - previous_);
    look(h, frame);
  }

  /// Free: the watched sheets are followed, and boxes crossed since the last frame may add one.
  void look(const Vec3& h, Frame& frame) noexcept {
    if (!scan_.running) {
      const Vec3 d = h - tested_to_;
      const double most = kMaxSegmentCells * model_.grid.cell_mm();
      const double length = d.norm();
      scan_.start(tested_to_, length > most ? Vec3(tested_to_ + (most / length) * d) : h);
    }
    if (scan_.advance(model_, counters_, [&](std::uint32_t place) { return is_watched(place); })) {
      for (std::size_t i = 0; i < scan_.count; ++i) watch(scan_.crossed[i], scan_.from_mm);
      tested_to_ = scan_.to_mm;
      // A segment cut at the bound goes on in the next frame.
      if (tested_to_ != h) scan_.running = false;
    }
    follow_sheets();
    const std::size_t touched = touched_sheet();
    if (touched < sheets_) {
      near_[0] = near_[touched];
      sheets_ = 1;
      contact_ = true;
      scan_.running = false;
      const WalkEnd end = follow(model_, near_[0], h, steps_, counters_);
      height_mm_ = height_mm(model_, near_[0], h);
      answer(h, end, frame);
      return;
    }
    if (tested_to_ != h) frame.status = FrameStatus::kBoundHit;
  }

  /// Brings the watched sheets to where the path has been tested, and lets go of those left behind.
  void follow_sheets() noexcept {
    for (std::size_t i = 0; i < sheets_;) {
      (void)follow(model_, near_[i], tested_to_, steps_, counters_);
      if (is_duplicate(i) || (near_[i].distance_sq_mm2 > leave_sq_mm2_ && !under(near_[i], tested_to_)))
        near_[i] = near_[--sheets_];
      else
        ++i;
    }
  }

  /// The nearest sheet that the HIP is under; sheets_ where there is none. Under a closed surface's sheet it
  /// is inside only if no nearer sheet has it above: that other one stands between, and the plane of the
  /// first reaches out beyond a fold.
  std::size_t touched_sheet() const noexcept {
    std::size_t found = sheets_;
    double above_sq = std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < sheets_; ++i) {
      if (!under(near_[i], tested_to_))
        above_sq = std::min(above_sq, near_[i].distance_sq_mm2);
      else if (found == sheets_ || near_[i].distance_sq_mm2 < near_[found].distance_sq_mm2)
        found = i;
    }
    if (found < sheets_ && surface::is_one_sided(model_.points[near_[found].place].normal) &&
        above_sq < near_[found].distance_sq_mm2)
      return sheets_;
    return found;
  }

  /// Below the plane of the sheet, and below the sheet itself rather than beside its rim.
  bool under(const Sheet& sheet, const Vec3& h) const noexcept {
    return height_mm(model_, sheet, h) < 0.0 && sideways_sq(model_, sheet, h) <= reach_sq(sheet.place);
  }
  /// How far to the side a point still carries: its local resolution, and its box where it has no neighbours.
  double reach_sq(std::uint32_t place) const noexcept {
    return std::max(local_resolution_sq(model_, place), model_.half_box(place).squaredNorm());
  }
  /// The HIP lies to the side of the god object where the sheet has no more points: it has left past the rim.
  /// In a concave crease, where the HIP may lie to the side too, there are neighbours on that side.
  bool beyond_rim(const Sheet& sheet, const Vec3& h) const noexcept {
    if (surface::is_one_sided(model_.points[sheet.place].normal)) return false;  // a closed surface has none
    if (sideways_sq(model_, sheet, h) <= reach_sq(sheet.place)) return false;
    const Vec3 g = model_.points[sheet.place].at();
    const Vec3 r = h - g;
    const Vec3 aside = (r - sheet.outward.dot(r) * sheet.outward).normalized();
    for (const std::uint32_t other : model_.neighbours[sheet.place]) {
      const Vec3 step = model_.points[other].at() - g;
      if (step.dot(aside) > kRimCosine * step.norm()) return false;
    }
    return true;
  }

  bool is_duplicate(std::size_t i) const noexcept {
    for (std::size_t j = 0; j < i; ++j)
      if (near_[j].place == near_[i].place) return true;
    return false;
  }

  /// A crossed box of a sheet that is watched already.
  bool is_watched(std::uint32_t place) const noexcept {
    const Vec3 p = model_.points[place].at();
    const surface::NormalCode code = model_.points[place].normal;
    for (std::size_t i = 0; i < sheets_; ++i) {
      if (!(distance_sq(model_.points[near_[i].place], p) <= same_sheet_sq_mm2_)) continue;
      if (code == surface::kNoNormal) return true;
      if (std::abs(surface::decode_normal(code).dot(near_[i].outward)) > kSameSheetCosine) return true;
    }
    return false;
  }

  /// Watches the sheet of a crossed box. A closed surface is touched from its free side. Any other's side is
  /// where the HIP came from, judged at the sheet's point nearest to there: that point lies straight below
  /// it, so the sign is not a matter of a tilted plane further on.
  void watch(std::uint32_t place, const Vec3& from) noexcept {
    Sheet sheet;
    sheet.place = place;
    sheet.outward = (from - model_.points[place].at()).normalized();
    if (surface::is_one_sided(model_.points[place].normal)) sheet.side = closed_side_;
    sheet.set_outward(model_);
    (void)follow(model_, sheet, from, steps_, counters_);
    for (std::size_t i = 0; i < sheets_; ++i)
      if (near_[i].place == sheet.place) return;
    const bool below = sheet.outward.dot(from - model_.points[sheet.place].at()) < 0.0;
    if (below && surface::is_one_sided(model_.points[sheet.place].normal)) {
      // Inside the surface, unless a nearer sheet stands between: then this is the far side of a thin part.
      for (std::size_t i = 0; i < sheets_; ++i)
        if (distance_sq(model_.points[near_[i].place], from) <= sheet.distance_sq_mm2) return;
    } else if (below) {
      sheet.side = -sheet.side;
      sheet.outward = -sheet.outward;
    }
    if (sheets_ < kMaxSheets) {
      near_[sheets_++] = sheet;
      return;
    }
    std::size_t farthest = 0;
    for (std::size_t i = 1; i < sheets_; ++i)
      if (near_[i].distance_sq_mm2 > near_[farthest].distance_sq_mm2) farthest = i;
    if (sheet.distance_sq_mm2 < near_[farthest].distance_sq_mm2) near_[farthest] = sheet;
  }

  void answer(const Vec3& h, const WalkEnd& end, Frame& frame) noexcept {
    const Vec3 g = model_.points[end.place].at();
    Vec3 pull = g - h;
    if (shading_ != Shading::kNone) {
      const NearestTwo two = shading_ == Shading::kFacet ? enclosing_two(model_, end, near_[0].outward, h)
                                                         : nearest_two(model_, end);
      __builtin_prefetch(&model_.neighbours[two.first]);  // where the god object most likely goes next
      const Vec3 b = model_.points[two.first].at();
      if (!by_spacing_ || (b - g).squaredNorm() > felt_spacing_sq_mm2_)
        pull = shaded_vector(shading_, h, g, b, model_.points[two.second].at());
    }
    frame.contact = true;
    frame.model = 0;
    frame.god_object_mm = model_.to_world(g);
    frame.force_n = limited(model_.direction_to_world(model_.stiffness_n_per_mm * pull), force_limit_n_);
  }

  Options options_;
  PointModel model_;
  Shading shading_ = Shading::kNone;
  bool by_spacing_ = false;
  double felt_spacing_sq_mm2_ = 0.0;
  double force_limit_n_ = 0.0;
  double leave_sq_mm2_ = 0.0;
  double same_sheet_sq_mm2_ = 0.0;

  Vec3 tested_to_ = Vec3::Zero();  ///< the path has been tested up to here (local)
  Vec3 previous_ = Vec3::Zero();   ///< the HIP of the last frame
  BoxScan scan_;
  std::array<Sheet, kMaxSheets> near_;  ///< in contact: the first alone
  std::size_t sheets_ = 0;
  double height_mm_ = 0.0;    ///< in contact: the last frame's HIP over its sheet's plane
  double closed_side_ = 1.0;  ///< of closed surfaces: 1 when the HIP's place is outside, -1 inside
  bool contact_ = false;
  int steps_ = 0;
  FrameCounters counters_;
};

}  // namespace

RendererInfo cloud_info() {
  RendererInfo info;
  info.name = "cloud";
  info.summary = "chapter 3 made right: a contact state with a side, shading by stiffness and spacing";
  info.source = "El-Far, chapter 3; contact side and bounds are ours";
  info.options = point_model_specs();
  info.options.push_back(shading_spec("force shading; auto: facet where stiffness x local spacing is felt"));
  info.make = [](const Options& options) { return std::make_unique<Cloud>(options); };
  return info;
}

}  // namespace palpate::render
