#include "toolkit/spline_sdf/prepared_surface.h"

#include <utility>

namespace palpate::spline_sdf {

using namespace render;

namespace {

/// The finest surface answers again when all within this many bricks of the HIP's is here, which is what a
/// frame of a hand looks at. A frame that finds too little is undone.
constexpr double kReachBricks = 1.5;
/// Rounds of missing tiles in one frame: each names up to kNamedMissing, and a frame looks at no more cubes
/// than so many rounds name.
constexpr int kMostRounds = 32;
/// A segment from the last place that was certainly free is tested if it is no longer than this, in spacings
/// of the coarser surface; a longer one may pass through what the hand went around.
constexpr double kLongestWay = 2.0;

}  // namespace

PagedContact::PagedContact(std::unique_ptr<PagedSurface> fine, std::shared_ptr<const SplineSdf> coarse,
                           bool waits, int most_steps)
    : surface_(std::move(fine)), coarse_surface_(std::move(coarse)), waits_(waits) {
  fine_.attach(surface_->grid(), surface_->spacing_mm());
  fine_.bound_steps(most_steps);
  coarse_.attach(coarse_surface_->grid, coarse_surface_->spacing_mm);
  coarse_.bound_steps(most_steps);
}

bool PagedContact::here(const Vec3& at_mm) const noexcept {
  const BrickGrid& grid = surface_->grid();
  const Vec3 at = grid.in_voxels(at_mm);
  const double edge = kBrickCells / grid.per_voxel_of(grid.find(at).level);
  return surface_->covers(at, kReachBricks * edge);
}

/// Acts until no look-up misses a tile. False if one still does: at once without `waits_`.
template <class Act>
bool PagedContact::without_missing(const Vec3& h_mm, const HeldBrick* held, Act&& act) noexcept {
  for (int round = 0; round < kMostRounds; ++round) {
    act(round);
    if (!surface_->take_missed()) return true;
    if (!waits_ || !surface_->wait_for_missed(surface_->grid().in_voxels(h_mm), held)) return false;
  }
  return false;
}

void PagedContact::restart(const Vec3& h_mm) noexcept {
  coarse_on_ = false;
  last_h_mm_ = free_from_mm_ = h_mm;
  coarse_.restart(h_mm);
  surface_->begin_frame(surface_->grid().in_voxels(h_mm), nullptr);
  coarse_on_ = !without_missing(h_mm, nullptr, [&](int) { fine_.restart(h_mm); });
  // Of a place that it did not know of the loader has nothing yet.
  if (!waits_) coarse_on_ = coarse_on_ || !here(h_mm);
  restart_again_ = coarse_on_;
}

void PagedContact::start_from(const Vec3& h_mm) noexcept {
  last_h_mm_ = free_from_mm_ = h_mm;
  coarse_on_ = !waits_ && !here(h_mm);
  if (coarse_on_)
    coarse_.start_from(h_mm);
  else
    fine_.start_from(h_mm);
}

void PagedContact::go_coarse() noexcept {
  coarse_on_ = true;
  coarse_.start_from(last_h_mm_);
  free_from_mm_ = last_h_mm_;
  if (fine_.contact()) coarse_.hold_near(fine_.god_object_mm(), fine_.outward());
}

/// Brings the finest surface to where the coarser one is. False, and nothing changed, while it cannot.
bool PagedContact::go_fine(const Vec3& h_mm, bool contact, FrameCounters& counters) noexcept {
  if (!here(h_mm) || (contact && !here(coarse_.god_object_mm()))) return false;
  const double spacing_mm = coarse_surface_->spacing_mm;
  if (contact) {
    fine_.start_from(h_mm);
    if (!fine_.hold_near(coarse_.god_object_mm(), coarse_.outward()))
      fine_.hold_if_inside(h_mm, kLongestWay * spacing_mm);
    // A coarser surface reaches where the finest has none: the hand keeps what it has.
    if (!fine_.contact()) return static_cast<void>(surface_->take_missed()), false;
  } else if (restart_again_) {
    // The first start saw no surface; a HIP that nothing holds is outside.
    fine_.restart(h_mm);
  } else if ((h_mm - free_from_mm_).norm() <= kLongestWay * spacing_mm) {
    fine_.start_from(free_from_mm_);
    static_cast<void>(fine_.update(h_mm, counters));
  } else {
    fine_.start_from(h_mm);
    fine_.hold_if_inside(h_mm, kLongestWay * spacing_mm);
  }
  if (surface_->take_missed()) return false;
  coarse_on_ = restart_again_ = false;
  return true;
}

bool PagedContact::update(const Vec3& h_mm, FrameCounters& counters) noexcept {
  HeldBrick brick;
  const HeldBrick* held = nullptr;
  if (active().contact()) {
    brick.god_object = surface_->grid().in_voxels(active().god_object_mm());
    if (!coarse_on_) brick.place = fine_.brick_ref();
    held = &brick;
  }
  surface_->begin_frame(surface_->grid().in_voxels(h_mm), held);
  counters.damaged_tiles = surface_->window().damaged();
  counters.damaged_tile = surface_->window().first_damaged();
  if (!coarse_on_) {
    const SplineSdfContactState before = fine_.state();
    const FrameCounters counted = counters;
    bool contact = false;
    const bool whole = without_missing(h_mm, held, [&](int round) {
      if (round > 0) {
        fine_.restore(before);
        counters = counted;
      }
      contact = fine_.update(h_mm, counters);
    });
    if (whole) {
      last_h_mm_ = h_mm;
      return contact;
    }
    ++counters.late_frames;
    fine_.restore(before);
    go_coarse();
  }
  ++counters.coarse_frames;
  const bool contact = coarse_.update(h_mm, counters);
  last_h_mm_ = h_mm;
  return go_fine(h_mm, contact, counters) ? fine_.contact() : contact;
}

}  // namespace palpate::spline_sdf
