// Makes a file of surfaces from a file of cells, in bounded memory: the surface of one region after another,
// from the points in and around it, joined at the end.
#pragma once

#include <cstdint>
#include <string>

#include <palpate/progress.h>
#include <palpate/result.h>
#include "toolkit/prepared/prepare_cells.h"
#include "toolkit/spline_sdf/spline_sdf_model.h"

namespace palpate::prepared {

/// Bytes that building a surface needs a point, at most, all told.
inline constexpr std::uint64_t kSurfaceBytesPerPoint = 256;

struct PrepareSurfaceOptions {
  render::SplineSdfOptions build;
  std::uint64_t memory_bytes = kPrepareMemoryBytes;
  int threads = 0;                               ///< 0: all
  std::uint64_t most_chunk_points = UINT64_MAX;  ///< of a region and around it; for tests
};

struct PrepareSurfaceReport {
  std::uint64_t chunks = 0;
  std::uint64_t resumed = 0;  ///< chunks that were there from an earlier run
  std::uint64_t patches = 0, bricks = 0;
  double spacing_mm = 0.0, noise_mm = 0.0;
  double contradicted = 0.0;  ///< render::JoinedChunks::contradicted
};

/// Writes `path`, whole or not at all; the same bytes for any number of threads, and for any memory that
/// holds a sixteenth of the points: with less the coarser surfaces are of fewer. A run that was stopped is
/// gone on with. Scratch: 35 bytes a point. Errors: the memory does not hold a region, or 8 bytes a point;
/// points too far apart for single precision; no surface.
[[nodiscard]] Result<PrepareSurfaceReport> prepare_surface(const CellFile& cells,
                                                           const PrepareSurfaceOptions& options,
                                                           const std::string& path,
                                                           Progress& progress = no_progress());

}  // namespace palpate::prepared
