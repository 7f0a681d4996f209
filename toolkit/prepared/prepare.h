// Makes prepared files in bounded memory: cells of points, surfaces.
//
// prepare_cells() counts a stream of points in a grid, scatters them to regions that fit in memory, sorts and
// cuts these, and gives each cell its halo. prepare_surface() makes the surface of one region of a cell file
// after another, from the points in and around it, and joins them at the end.
#pragma once

#include <cstdint>
#include <string>

#include <palpate/progress.h>
#include <palpate/result.h>
#include "toolkit/io/point_stream.h"
#include "toolkit/prepared/cell_file.h"
#include "toolkit/spline_sdf/spline_sdf_model.h"

namespace palpate::prepared {

/// Points sorted at once: 320 MB; more would not be faster.
inline constexpr std::uint64_t kMostChunkPoints = 5'000'000;
/// Four neighbours deep: a plane or a quadric fitted at a cell's border sees what it sees inside.
inline constexpr double kHaloSpacings = 4.0;
/// Steps have no other bound than the spacing.
inline constexpr double kAnyQuantumMm = 1e12;
inline constexpr std::uint64_t kPrepareMemoryBytes = std::uint64_t{1} << 31;

struct PrepareCellsOptions {
  double mm_per_unit = 1.0;  ///< of the stream's numbers
  std::uint64_t memory_bytes = kPrepareMemoryBytes;
  int threads = 0;             ///< 0: all
  std::string scratch_folder;  ///< empty: beside the file
  /// Step of stored coordinates, at most; never above a tenth of a cell's spacing. Cells that are too large
  /// for it are divided.
  double quantum_mm = kAnyQuantumMm;
  double halo_spacings = kHaloSpacings;
  /// The file behind the stream, or the folder. If it is given, a run that was stopped is gone on with, as
  /// long as the files have the same sizes and times and the options are the same.
  std::string input_path;
  std::uint64_t most_chunk_points = kMostChunkPoints;  ///< for tests; the result does not depend on it
};

struct PrepareCellsReport {
  CellFileInfo info;
  std::uint64_t chunks = 0;
  std::uint64_t scratch_bytes = 0;
  std::uint64_t file_bytes = 0;
  int passes = 0;        ///< over the stream
  bool resumed = false;  ///< parts were there from an earlier run
};

/// Writes `path`, whole or not at all. Points that are not finite, or farther than a million kilometres from
/// the origin, are dropped and counted. The bytes depend on the points, the unit, the quantum and the halo
/// only: not on threads, memory, chunks, or the points' order. Scratch: 24 bytes a point at most, and 64 KB.
/// Memory: within the option, of which the table of cells takes a quarter of a byte a point, more where the
/// quantum makes small cells. Time is linear; the stream is read two or three times, more often where most
/// points lie in a tiny part of the whole.
[[nodiscard]] Result<PrepareCellsReport> prepare_cells(io::PointStream& stream,
                                                       const PrepareCellsOptions& options,
                                                       const std::string& path,
                                                       Progress& progress = no_progress());

/// Bytes that building a surface in memory takes a point of an even scan; of merged views four times as much.
inline constexpr std::uint64_t kSurfaceBytesPerPoint = 160;

struct PrepareSurfaceOptions {
  spline_sdf::SplineSdfOptions build;
  std::uint64_t memory_bytes = kPrepareMemoryBytes;
  int threads = 0;                               ///< 0: all
  std::uint64_t most_chunk_points = UINT64_MAX;  ///< of a region and around it; for tests
};

struct PrepareSurfaceReport {
  std::uint64_t chunks = 0;
  std::uint64_t resumed = 0;  ///< chunks that were there from an earlier run
  std::uint64_t patches = 0, bricks = 0;
  double spacing_mm = 0.0, noise_mm = 0.0;
  double contradicted = 0.0;  ///< spline_sdf::JoinedChunks::contradicted
};

/// Writes `path`, whole or not at all; the same bytes for any number of threads, and for any memory that
/// holds a sixteenth of the points (with less the coarser surfaces are made by regions too) where each region
/// finds the sides that the whole finds. What a face meets and which of its sides is open is what the region
/// has of it: on a noisy open sheet a stray in a hundred may be turned, and in a thin hollow statue of
/// fifteen merged views, in 29 regions, 2 % of the patches were (PrepareSurfaceReport::contradicted: .15). A
/// run that was stopped is gone on with. Scratch: 120 bytes a brick, 5 a point of terrain. Errors: the memory
/// does not hold a region or the join; points too far apart for single precision; no surface.
[[nodiscard]] Result<PrepareSurfaceReport> prepare_surface(const CellFile& cells,
                                                           const PrepareSurfaceOptions& options,
                                                           const std::string& path,
                                                           Progress& progress = no_progress());

}  // namespace palpate::prepared
