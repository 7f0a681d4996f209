// Prepared surfaces: made from a cloud, and felt.
#pragma once

#include <cstddef>
#include <memory>
#include <string>

#include "toolkit/spline_sdf/morton_points.h"
#include "toolkit/spline_sdf/paged_contact.h"
#include "toolkit/spline_sdf/surface_writer.h"

namespace palpate::render {

/// Makes the surface and coarser ones, each of a sixteenth of the points, until one is small, and writes them
/// to `path`. Properties of points are not kept. O(n), parallel.
Status prepare_surface_file(const std::shared_ptr<const cloud::Cloud>& cloud, const SplineSdfOptions& build,
                            const PrepareContext& context, PrepareReport& report, const std::string& path);

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
                                          const PrepareContext& context, SurfaceFileWriter& writer);
/// The Error where no surface is found.
[[nodiscard]] Error no_surface();

struct PagedOptions {
  std::size_t level = 0;           ///< which of the file's surfaces
  std::size_t resident_bytes = 0;  ///< of its bricks and nodes in memory
  bool paced = false;              ///< frames must not wait
  int most_steps = kMaxNewtonSteps;
};

/// The decision with which the file was prepared. Errors as open_prepared_body().
[[nodiscard]] Result<SplineSdfDecision> decide_prepared(const ModelInput& input, std::size_t level);

/// `paged` receives the contact. Errors: values by point, a level that the file does not have, no stiffness.
[[nodiscard]] Result<SplineSdfBody> open_prepared_body(const ModelInput& input, const PagedOptions& options,
                                                       PrepareReport& report,
                                                       std::unique_ptr<PagedContact>& paged);

}  // namespace palpate::render
