#include "baselines/points/point_contact.h"

#include <cmath>
#include <limits>
#include <utility>

namespace palpate::baselines::vertices {
namespace {

/// A watched sheet is let go beyond this many half diagonals of the largest box: a HIP inside any of its
/// boxes is within one.
constexpr double kLeaveHalfDiagonals = 1.5;
/// Crossed boxes within this many half diagonals of a watched god object, with a plane within 60 degrees of
/// its own, belong to that sheet.
constexpr double kSameSheetHalfDiagonals = 2.0;
constexpr double kSameSheetCosine = 0.5;
/// A neighbour within some 75 degrees of a direction continues the sheet that way.
constexpr double kRimCosine = 0.25;

}  // namespace

void PointContact::attach(const points::PointModel& model) {
  model_ = &model;
  sides_.attach(model);
  const double half_diagonal_sq = model.largest_half_box_mm.squaredNorm();
  leave_sq_mm2_ = kLeaveHalfDiagonals * kLeaveHalfDiagonals * half_diagonal_sq;
  same_sheet_sq_mm2_ = kSameSheetHalfDiagonals * kSameSheetHalfDiagonals * half_diagonal_sq;
}

void PointContact::start_from(const Vec3& h) noexcept {
  tested_to_ = h;
  previous_ = h;
  sheets_ = 0;
  contact_ = false;
  scan_.running = false;
}

void PointContact::reset(const Vec3& h) noexcept {
  start_from(h);
  sides_.find(*model_, h);
}

/// Free: the watched sheets are followed, and boxes crossed since the last frame may add one.
bool PointContact::update_free(const Vec3& h, points::WalkResult& end, FrameCounters& counters) noexcept {
  if (!scan_.running) {
    const Vec3 d = h - tested_to_;
    const double most = kMaxSegmentCells * model_->decision.cell_mm;
    const double length = d.norm();
    scan_.start(tested_to_, length > most ? Vec3(tested_to_ + (most / length) * d) : h);
  }
  if (scan_.advance(*model_, counters, [&](std::uint32_t place) { return is_watched(place); })) {
    for (std::size_t i = 0; i < scan_.count; ++i) add_sheet(scan_.crossed[i], scan_.from_mm, counters);
    tested_to_ = scan_.to_mm;
    // A segment cut at the bound goes on in the next frame.
    if (tested_to_ != h) scan_.running = false;
  }
  follow_sheets(counters);
  const std::size_t touched = touched_sheet();
  if (touched < sheets_) {
    near_[0] = near_[touched];
    sheets_ = 1;
    contact_ = true;
    scan_.running = false;
    end = follow(*model_, near_[0], h, steps_, counters);
    near_[0].turned_from = kNoPlace;  // it comes from outside, not over an edge
    height_mm_ = height_mm(*model_, near_[0], h);
    return true;
  }
  behind_ = tested_to_ != h;
  return false;
}

/// The walk went around an edge to the points nearest to the HIP. At a convex one the god object stays on the
/// face that it came from, as on a mesh, until its place there lies beyond the next one.
void PointContact::stay_on_facet(const Vec3& h, points::WalkResult& end, FrameCounters& counters) noexcept {
  Sheet& sheet = near_[0];
  Sheet face = sheet;
  face.place = std::exchange(sheet.turned_from, kNoPlace);
  face.turned_from = kNoPlace;
  face.set_outward(*model_);
  const Vec3 from = model_->points[face.place].at();
  if (!(height_mm(*model_, sheet, from) < 0.0)) return;  // a groove
  const Vec3 closest = h - height_mm(*model_, face, h) * face.outward;
  if (!(height_mm(*model_, sheet, closest) < 0.0)) return;
  if ((closest - from).squaredNorm() > local_resolution_sq(*model_, face.place)) return;
  // The god object moves on along the edge, from point to point of its face.
  double least = (closest - from).squaredNorm();
  for (int move = 0; move < kMaxFaceMoves; ++move) {
    const std::uint32_t before = face.place;
    for (const std::uint32_t other : model_->neighbours[before]) {
      const points::StoredPoint& p = model_->points[other];
      const double square = points::distance_sq(p, closest);
      if (!(square < least) || p.normal == surface::kNoNormal ||
          !(face.side * surface::decode_normal(p.normal).dot(face.outward) >= kEdgeCosine))
        continue;
      least = square;
      face.place = other;
    }
    if (face.place == before) break;
    ++counters.walk_steps;
  }
  face.set_outward(*model_);
  end.place = face.place;
  end.distance_sq_mm2 = face.distance_sq_mm2 = points::distance_sq(model_->points[face.place], h);
  end.load_neighbours(*model_, h);
  face.walk_truncated = false;
  sheet = face;
}

/// Brings the watched sheets to where the path has been tested, and lets go of those left behind.
void PointContact::follow_sheets(FrameCounters& counters) noexcept {
  for (std::size_t i = 0; i < sheets_;) {
    (void)follow(*model_, near_[i], tested_to_, steps_, counters);
    if (is_duplicate(i) || (near_[i].distance_sq_mm2 > leave_sq_mm2_ && !under(near_[i], tested_to_)))
      near_[i] = near_[--sheets_];
    else
      ++i;
  }
}

/// The nearest sheet that the HIP is under; sheets_ where there is none. Under a closed surface's sheet it
/// is inside only if no nearer sheet has it above: that other one stands between, and the plane of the
/// first reaches out beyond a fold.
std::size_t PointContact::touched_sheet() const noexcept {
  std::size_t found = sheets_;
  double above_sq = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < sheets_; ++i) {
    if (!under(near_[i], tested_to_))
      above_sq = std::min(above_sq, near_[i].distance_sq_mm2);
    else if (found == sheets_ || near_[i].distance_sq_mm2 < near_[found].distance_sq_mm2)
      found = i;
  }
  if (found < sheets_ && surface::is_one_sided(model_->points[near_[found].place].normal) &&
      above_sq < near_[found].distance_sq_mm2)
    return sheets_;
  return found;
}

/// True below the plane of the sheet, if `h` is below the sheet itself rather than beside its rim.
bool PointContact::under(const Sheet& sheet, const Vec3& h) const noexcept {
  return height_mm(*model_, sheet, h) < 0.0 && sideways_sq(*model_, sheet, h) <= reach_sq(sheet.place);
}
/// The HIP lies to the side of the god object where the sheet has no more points: it has left past the rim.
/// In a concave crease, where the HIP may lie to the side too, there are neighbours on that side.
bool PointContact::no_point_aside(const Sheet& sheet, const Vec3& h) const noexcept {
  const Vec3 g = model_->points[sheet.place].at();
  const Vec3 r = h - g;
  const Vec3 aside = (r - sheet.outward.dot(r) * sheet.outward).normalized();
  for (const std::uint32_t other : model_->neighbours[sheet.place]) {
    const Vec3 step = model_->points[other].at() - g;
    if (step.dot(aside) > kRimCosine * step.norm()) return false;
  }
  return true;
}

bool PointContact::is_duplicate(std::size_t i) const noexcept {
  for (std::size_t j = 0; j < i; ++j)
    if (near_[j].place == near_[i].place) return true;
  return false;
}

/// True for a crossed box of a sheet that is watched already.
bool PointContact::is_watched(std::uint32_t place) const noexcept {
  const Vec3 p = model_->points[place].at();
  const surface::NormalCode code = model_->points[place].normal;
  for (std::size_t i = 0; i < sheets_; ++i) {
    if (!(points::distance_sq(model_->points[near_[i].place], p) <= same_sheet_sq_mm2_)) continue;
    if (code == surface::kNoNormal) return true;
    if (std::abs(surface::decode_normal(code).dot(near_[i].outward)) > kSameSheetCosine) return true;
  }
  return false;
}

/// Watches the sheet of a crossed box. A closed surface is touched from its free side. Any other's side is
/// where the HIP came from, judged at the sheet's point nearest to there: that point lies straight below
/// it, so the sign is not a matter of a tilted plane further on.
void PointContact::add_sheet(std::uint32_t place, const Vec3& from, FrameCounters& counters) noexcept {
  Sheet sheet;
  sheet.place = place;
  sheet.outward = (from - model_->points[place].at()).normalized();
  if (surface::is_one_sided(model_->points[place].normal)) sheet.side = sides_.at(*model_, place);
  sheet.set_outward(*model_);
  (void)follow(*model_, sheet, from, steps_, counters);
  for (std::size_t i = 0; i < sheets_; ++i)
    if (near_[i].place == sheet.place) return;
  const bool below = sheet.outward.dot(from - model_->points[sheet.place].at()) < 0.0;
  if (below && surface::is_one_sided(model_->points[sheet.place].normal)) {
    // Inside the surface, unless a nearer sheet stands between: then this is the far side of a thin part.
    for (std::size_t i = 0; i < sheets_; ++i)
      if (points::distance_sq(model_->points[near_[i].place], from) <= sheet.distance_sq_mm2) return;
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

}  // namespace palpate::baselines::vertices
