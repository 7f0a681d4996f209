// Writes a file of surfaces, one after the other. Only the present one is in memory.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include <palpate/cloud.h>
#include <palpate/result.h>
#include "toolkit/core/files.h"
#include "toolkit/spline_sdf/brick_tiles.h"
#include "toolkit/spline_sdf/build_bricks.h"
#include "toolkit/spline_sdf/spline_sdf_model.h"

namespace palpate::spline_sdf {

/// Distances of points from a surface, in whole numbers: the sum of a part after a part is that of all.
struct SampleDistances {
  std::uint64_t squares = 0, count = 0;
  [[nodiscard]] double rms_voxels() const noexcept;
};
/// Values of the field at the points, where it has one; `region`: null, or only points in it.
void add_distances(const BrickGrid& grid, const cloud::Cloud& points, const BrickRegion* region,
                   SampleDistances& into);

/// Collects the index, which grows.
class IndexBytes {
 public:
  template <class Write>
  void put(std::size_t bytes, Write&& write) {
    const std::size_t at = bytes_.size();
    bytes_.resize(at + bytes);
    ByteWriter to(std::span<std::byte>(bytes_).subspan(at));
    write(to);
  }
  [[nodiscard]] std::span<const std::byte> bytes() const noexcept { return bytes_; }

 private:
  std::vector<std::byte> bytes_;
};

/// Replaces the file when all is written, and only then. Movable, not thread-safe.
class SurfaceFileWriter {
 public:
  /// `points`: number of the finest surface's points; `sample`: some of them, in the surfaces' origin.
  [[nodiscard]] static Result<SurfaceFileWriter> create(const std::string& path, std::uint64_t points,
                                                        std::shared_ptr<const cloud::Cloud> sample);
  /// Adds a surface, the finest first. O(bricks). The same for any number of threads.
  [[nodiscard]] Status add(const SplineSdf& surface, int threads);
  /// Gives the bricks of a surface to a sink, cut into tiles.
  using CutBricks = std::function<Status(const TileSink& sink)>;
  /// The same for a surface whose bricks are not in memory; `bricks` gives those that `cut` names.
  [[nodiscard]] Status add(const SplineSdf& surface, const CutBricks& cut, const BrickSource& bricks,
                           const SampleDistances& distances, int threads);
  /// At least one surface must have been added.
  [[nodiscard]] Status finish();
  [[nodiscard]] const std::shared_ptr<const cloud::Cloud>& sample() const noexcept { return sample_; }

 private:
  SurfaceFileWriter(AtomicFile file, std::uint64_t points, std::shared_ptr<const cloud::Cloud> sample)
      : file_(std::move(file)), points_(points), sample_(std::move(sample)) {}

  AtomicFile file_;
  std::uint64_t points_;
  std::shared_ptr<const cloud::Cloud> sample_;
  std::uint64_t at_ = 0;  ///< end of what is written
  std::uint32_t surfaces_ = 0;
  IndexBytes index_;  ///< of the surfaces
};

}  // namespace palpate::spline_sdf
