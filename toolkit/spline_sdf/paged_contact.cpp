#include "toolkit/spline_sdf/paged_contact.h"

#include <utility>

namespace palpate::render {
namespace {

/// The finest surface answers again when all within this many of its largest bricks is here, which is what a
/// frame of a hand looks at.
constexpr double kReachBricks = 1.0;

}  // namespace

PagedContact::PagedContact(std::unique_ptr<PagedSurface> fine, std::shared_ptr<const SplineSdf> coarse,
                           bool waits, int most_steps)
    : surface_(std::move(fine)), coarse_surface_(std::move(coarse)), waits_(waits) {
  fine_.attach(surface_->grid(), surface_->spacing_mm());
  fine_.bound_steps(most_steps);
  coarse_.attach(coarse_surface_->grid, coarse_surface_->spacing_mm);
  coarse_.bound_steps(most_steps);
  before_ = fine_;
}

bool PagedContact::here(const Vec3& h_mm) const noexcept {
  const BrickGrid& grid = surface_->grid();
  return surface_->covers(grid.in_voxels(h_mm), kReachBricks * grid.cube_edge());
}

/// Acts until no look-up misses a tile. False if one still does: always soon without `waits_`.
template <class Act>
bool PagedContact::without_missing(const Vec3& h_mm, const HeldBrick* held, Act&& act) noexcept {
  for (;;) {
    act();
    if (!surface_->take_missed()) return true;
    if (!waits_ || !surface_->wait_for_missed(surface_->grid().in_voxels(h_mm), held)) return false;
  }
}

void PagedContact::restart(const Vec3& h_mm) noexcept {
  coarse_on_ = corrected_ = false;
  last_h_mm_ = h_mm;
  coarse_.restart(h_mm);
  surface_->begin_frame(surface_->grid().in_voxels(h_mm), nullptr);
  coarse_on_ = !without_missing(h_mm, nullptr, [&] { fine_.restart(h_mm); });
}

void PagedContact::start_from(const Vec3& h_mm) noexcept {
  coarse_on_ = corrected_ = false;
  last_h_mm_ = h_mm;
  fine_.start_from(h_mm);
}

void PagedContact::go_coarse(const SplineSdfContact& from, const Vec3& h_mm) noexcept {
  coarse_on_ = true;
  coarse_.start_from(last_h_mm_);
  note_step(Vec3::Zero());
  if (!from.contact()) return;
  note_step(from.god_object_mm() - h_mm);
  coarse_.hold_near(from.god_object_mm(), from.outward());
}

bool PagedContact::update(const Vec3& h_mm, FrameCounters& counters) noexcept {
  HeldBrick brick;
  const HeldBrick* held = nullptr;
  if (!coarse_on_ && fine_.contact()) {
    brick = {fine_.god_object_voxels(), fine_.brick_ref()};
    held = &brick;
  }
  if (surface_->begin_frame(surface_->grid().in_voxels(h_mm), held)) fine_.forget_clear();
  corrected_ = false;
  if (!coarse_on_) {
    before_ = fine_;
    const FrameCounters counted = counters;
    bool contact = false;
    const bool whole = without_missing(h_mm, held, [&] {
      fine_ = before_;
      counters = counted;
      contact = fine_.update(h_mm, counters);
    });
    if (whole) {
      last_h_mm_ = h_mm;
      return contact;
    }
    ++counters.late_frames;
    go_coarse(before_, h_mm);
  }
  ++counters.coarse_frames;
  bool contact = coarse_.update(h_mm, counters);
  last_h_mm_ = h_mm;
  if (!here(h_mm) || (contact && !here(coarse_.god_object_mm()))) return contact;
  fine_.start_from(h_mm);
  if (!contact || !fine_.hold_near(coarse_.god_object_mm(), coarse_.outward())) fine_.hold_if_inside(h_mm);
  if (surface_->take_missed()) return contact;
  note_step(contact ? Vec3(coarse_.god_object_mm() - h_mm) : Vec3(Vec3::Zero()));
  coarse_on_ = false;
  return fine_.contact();
}

}  // namespace palpate::render
