// Contact with a surface of which only the tiles near the hand are in memory. Where one is not here yet, a
// coarser surface that is whole in memory answers; what a hand would feel as a step is spread as a
// correction is.
#pragma once

#include <cstdint>
#include <memory>

#include "toolkit/spline_sdf/paged_surface.h"
#include "toolkit/spline_sdf/spline_sdf_contact.h"

namespace palpate::render {

/// Belongs to one thread.
class PagedContact {
 public:
  /// `waits`: a frame waits for its tiles, so that a replay is the same every time and as in memory; else it
  /// never does. Allocates.
  PagedContact(std::unique_ptr<PagedSurface> fine, std::shared_ptr<const SplineSdf> coarse, bool waits,
               int most_steps);

  void restart(const Vec3& h_mm) noexcept;
  void start_from(const Vec3& h_mm) noexcept;
  /// As SplineSdfContact::update. Without `waits` bounded and wait-free: the work of two such and of
  /// TileWindow's calls.
  [[nodiscard]] bool update(const Vec3& h_mm, FrameCounters& counters) noexcept;

  /// The contact that answered last.
  [[nodiscard]] const SplineSdfContact& active() const noexcept { return coarse_on_ ? coarse_ : fine_; }
  [[nodiscard]] const PagedSurface& surface() const noexcept { return *surface_; }

 private:
  [[nodiscard]] bool here(const Vec3& at_mm) const noexcept;
  [[nodiscard]] bool go_fine(const Vec3& h_mm, bool contact, FrameCounters& counters) noexcept;
  void go_coarse(const SplineSdfContact& from) noexcept;
  template <class Act>
  [[nodiscard]] bool without_missing(const Vec3& h_mm, const HeldBrick* held, Act&& act) noexcept;

  std::unique_ptr<PagedSurface> surface_;
  std::shared_ptr<const SplineSdf> coarse_surface_;
  SplineSdfContact fine_, before_, coarse_;
  bool waits_;
  bool coarse_on_ = false;
  bool restart_again_ = false;  ///< the finest surface was not here when a replay began
  Vec3 last_h_mm_ = Vec3::Zero();
  Vec3 free_from_mm_ = Vec3::Zero();  ///< the last place that the finest surface left free
};

}  // namespace palpate::render
