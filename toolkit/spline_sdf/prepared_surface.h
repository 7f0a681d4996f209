// Prepared surfaces: made from a cloud, and felt.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>

#include "toolkit/spline_sdf/morton_points.h"
#include "toolkit/spline_sdf/paged_surface.h"
#include "toolkit/spline_sdf/spline_sdf_contact.h"
#include "toolkit/spline_sdf/surface_writer.h"

namespace palpate::spline_sdf {

/// Contact with a surface of tiles. Only those near the hand are in memory. Where one is not here yet, a
/// coarser surface that is whole in memory answers; what a hand would feel as a step is spread as a
/// correction is. Belongs to one thread.
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
  [[nodiscard]] bool update(const Vec3& h_mm, render::FrameCounters& counters) noexcept;

  /// The contact that answered last.
  [[nodiscard]] const SplineSdfContact& active() const noexcept { return coarse_on_ ? coarse_ : fine_; }
  [[nodiscard]] const PagedSurface& surface() const noexcept { return *surface_; }

 private:
  [[nodiscard]] bool here(const Vec3& at_mm) const noexcept;
  [[nodiscard]] bool go_fine(const Vec3& h_mm, bool contact, render::FrameCounters& counters) noexcept;
  void go_coarse() noexcept;
  template <class Act>
  [[nodiscard]] bool without_missing(const Vec3& h_mm, const HeldBrick* held, Act&& act) noexcept;

  std::unique_ptr<PagedSurface> surface_;
  std::shared_ptr<const SplineSdf> coarse_surface_;
  SplineSdfContact fine_, coarse_;
  bool waits_;
  bool coarse_on_ = false;
  bool restart_again_ = false;  ///< the finest surface was not here when a replay began
  Vec3 last_h_mm_ = Vec3::Zero();
  Vec3 free_from_mm_ = Vec3::Zero();  ///< the last place that the finest surface left free
};

/// Makes the surface and coarser ones, each of a sixteenth of the points, until one is small, and writes them
/// to `path`. Properties of points are not kept. O(n), parallel.
Status prepare_surface_file(const std::shared_ptr<const cloud::Cloud>& cloud, const SplineSdfOptions& build,
                            const render::PrepareContext& context, render::PrepareReport& report,
                            const std::string& path);

/// A coarser surface has a sixteenth of the points: four times the spacing.
inline constexpr std::size_t kCoarserShare = 16;
/// Points of the sample, at most: paths, boxes and a mesh for comparison need no more.
inline constexpr std::size_t kSamplePoints = 200'000;

/// Every so-many-th point along the Morton curve, some `count`: as even as the points are.
[[nodiscard]] std::shared_ptr<const cloud::Cloud> thinned(const MortonPoints& points,
                                                          const cloud::Cloud& cloud, std::size_t count);
/// Adds surfaces of `count` of the points and of fewer, until one is small.
[[nodiscard]] Status add_coarser_surfaces(const cloud::Cloud& cloud, const MortonPoints& points,
                                          std::size_t count, const SplineSdfOptions& build,
                                          const render::PrepareContext& context, SurfaceFileWriter& writer);
/// The Error where no surface is found.
[[nodiscard]] Error no_surface();

struct PagedOptions {
  std::size_t level = 0;           ///< which of the file's surfaces
  std::size_t resident_bytes = 0;  ///< of its bricks and nodes in memory
  bool paced = false;              ///< frames must not wait
  int most_steps = kMaxNewtonSteps;
};

/// The decision with which the file was prepared. Errors as open_prepared_body().
[[nodiscard]] Result<SplineSdfDecision> decide_prepared(const render::ModelInput& input, std::size_t level);

/// `paged` receives the contact. Errors: values by point, a level that the file does not have, no stiffness.
[[nodiscard]] Result<SplineSdfBody> open_prepared_body(const render::ModelInput& input,
                                                       const PagedOptions& options,
                                                       render::PrepareReport& report,
                                                       std::unique_ptr<PagedContact>& paged);

}  // namespace palpate::spline_sdf
