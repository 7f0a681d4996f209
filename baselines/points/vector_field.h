// Vectors to the surface, on a voxel grid. The grid has bricks near the surface.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>

#include <palpate/geometry.h>
#include <palpate/result.h>
#include <palpate/vec.h>
#include "toolkit/core/hardware.h"

namespace palpate::baselines {

/// Voxels per side of a brick, which stores the samples of both ends: a look-up reads one brick.
inline constexpr int kBrickVoxels = 8;
inline constexpr int kBrickSamples = kBrickVoxels + 1;

/// A sample: the vector to the surface, and the distance, negative inside.
struct FieldSample {
  float x, y, z, distance;
};

struct VoxelFieldOptions {
  double voxel_mm = 1.0;
  double depth_mm = 8.0;  ///< depth of the field inside
  std::size_t most_bytes = std::size_t{1} << 30;
};

/// Immutable after building; thread-safe to read. Local coordinates, mm.
class VoxelField {
 public:
  static constexpr std::size_t kSamplesPerBrick = std::size_t{kBrickSamples} * kBrickSamples * kBrickSamples;
  /// sample(place, most_mm, hint): the truth at a place; beyond most_mm any positive distance. `hint` belongs
  /// to the sampler, is kept within a brick and starts as 0xFFFFFFFF. Called from several threads.
  using Sampler = std::function<FieldSample(const Vec3& place, double most_mm, std::uint32_t& hint)>;

  /// Samples all bricks within the depth of `points` that have something inside. An Error if bricks or
  /// directory need over most_bytes, with the remedy. Independent of the number of threads.
  [[nodiscard]] static Result<VoxelField> build(const std::function<Vec3(std::size_t)>& point,
                                                std::size_t points, const geometry::Aabb& box,
                                                const VoxelFieldOptions& options, const Sampler& sample,
                                                int threads);

  struct Value {
    bool known = false;
    Vec3 to_surface = Vec3::Zero();
    double distance = 0.0;
  };
  /// Trilinear between eight samples. Allocates nothing, O(1).
  [[nodiscard]] Value at(const Vec3& place) const noexcept;

  [[nodiscard]] std::size_t bricks() const noexcept { return samples_.size() / kSamplesPerBrick; }
  [[nodiscard]] double voxel_mm() const noexcept { return voxel_; }
  [[nodiscard]] std::size_t bytes() const noexcept {
    return samples_.capacity() * sizeof(FieldSample) + directory_.capacity() * sizeof(std::uint32_t);
  }

 private:
  static constexpr std::uint32_t kNoBrick = 0xFFFFFFFFu;
  [[nodiscard]] Vec3 corner_of(std::size_t directory_index) const noexcept;

  Vec3 low_ = Vec3::Zero();
  double voxel_ = 1.0, per_voxel_ = 1.0;
  std::array<std::size_t, 3> size_{};  ///< bricks per axis
  LargePageVector<std::uint32_t> directory_;
  LargePageVector<FieldSample> samples_;
};

}  // namespace palpate::baselines
