// A field of vectors to the surface on a voxel grid, kept in bricks near the surface.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>

#include "toolkit/core/large_pages.h"
#include "toolkit/core/result.h"
#include "toolkit/core/vec.h"
#include "toolkit/geometry/aabb.h"

namespace palpate::baselines {

/// A brick is so many voxels wide, and holds the samples of both its ends: a look-up reads one brick.
inline constexpr int kBrickVoxels = 8;
inline constexpr int kBrickSamples = kBrickVoxels + 1;

/// What is known at a place: the vector to the surface, and the distance, negative inside.
struct FieldSample {
  float x, y, z, distance;
};

struct VoxelFieldOptions {
  double voxel_mm = 1.0;
  double depth_mm = 8.0;  ///< inside, the field reaches so deep
  std::size_t most_bytes = std::size_t{1} << 30;
};

/// Immutable after building; safe to read from many threads. Local coordinates, mm.
class VoxelField {
 public:
  static constexpr std::size_t kSamplesPerBrick = std::size_t{kBrickSamples} * kBrickSamples * kBrickSamples;
  /// sample(place, most_mm, hint): the truth at a place; where the surface is further than most_mm away any
  /// positive distance will do. `hint` is the sampler's own, kept from place to place of one brick and
  /// 0xFFFFFFFF at its start. Called from several threads.
  using Sampler = std::function<FieldSample(const Vec3& place, double most_mm, std::uint32_t& hint)>;

  /// Samples all bricks that are within the depth of `points` and hold something inside. An Error where they
  /// or their directory need more than most_bytes; the remedy names what to change. The same for any number
  /// of threads.
  [[nodiscard]] static Result<VoxelField> build(const std::function<Vec3(std::size_t)>& point,
                                                std::size_t points, const geometry::Aabb& box,
                                                const VoxelFieldOptions& options, const Sampler& sample,
                                                int threads);

  struct Value {
    bool known = false;
    Vec3 to_surface = Vec3::Zero();
    double distance = 0.0;
  };
  /// Trilinear between the eight samples around. Allocates nothing, O(1).
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
  LargeVector<std::uint32_t> directory_;
  LargeVector<FieldSample> samples_;
};

}  // namespace palpate::baselines
