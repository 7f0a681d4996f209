// A regular grid of heights (chapter 4): a point cloud that does not overlap itself seen from above. Its
// posts without a point are gaps, bridged by the points around, and voids; `info`, the plan and the renderers
// use this classification.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include <palpate/cloud.h>
#include <palpate/result.h>
#include "toolkit/core/hardware.h"

namespace palpate::cloud {

// Numbered surface points of box lattices and sphere rings. They sample spheres and slabs without tables.

/// The lattice points on the surface of nx x ny x nz cells (each at least 1), numbered layer by layer in z:
/// the lowest layer row by row, then each ring between (front row, both sides row by row, back row), then the
/// highest layer.
class BoxLattice {
 public:
  BoxLattice(std::uint32_t nx, std::uint32_t ny, std::uint32_t nz) : n_{nx, ny, nz} {}

  [[nodiscard]] std::size_t size() const noexcept { return 2 * full() + (n_[2] - 1) * ring(); }
  /// Lattice coordinates of a point, O(1).
  [[nodiscard]] std::array<std::uint32_t, 3> coordinates(std::size_t index) const noexcept;
  /// Number of a surface point, O(1).
  [[nodiscard]] std::uint32_t index(std::uint32_t i, std::uint32_t j, std::uint32_t k) const noexcept;
  /// Two triangles per cell of the six faces, counter-clockwise from outside.
  [[nodiscard]] std::vector<std::array<std::uint32_t, 3>> triangles() const;

 private:
  [[nodiscard]] std::size_t full() const noexcept {
    return (std::size_t{n_[0]} + 1) * (std::size_t{n_[1]} + 1);
  }
  [[nodiscard]] std::size_t ring() const noexcept { return 2 * (std::size_t{n_[0]} + std::size_t{n_[1]}); }
  std::array<std::uint32_t, 3> n_;
};

/// Rings on a sphere, numbered in order: ring 0 is the lowest point, ring k has as many spokes as fit its
/// circumference.
class SphereRings {
 public:
  /// `rim`: angle of the last ring from the lowest point, radians. O(rings).
  SphereRings(double radius_mm, double rim, double spacing_mm);

  struct Place {
    std::uint32_t ring = 0, spoke = 0, spokes = 1;
  };
  [[nodiscard]] std::size_t size() const noexcept { return first_.back(); }
  /// Number of the last ring.
  [[nodiscard]] std::uint32_t rings() const noexcept { return static_cast<std::uint32_t>(first_.size() - 2); }
  /// O(log rings).
  [[nodiscard]] Place place(std::size_t index) const noexcept;
  /// Between adjacent rings, counter-clockwise from inside the sphere.
  [[nodiscard]] std::vector<std::array<std::uint32_t, 3>> triangles() const;

 private:
  std::vector<std::size_t> first_;  ///< first point of each ring, then the number of points
};

/// Posts on a plan lattice in rows of increasing y, x increasing in a row: post (column, row) is at origin_mm
/// + (column * step_x_mm, row * step_y_mm, height), model frame. A NaN height is a hole. 4 bytes a post and
/// 1/64 byte for block maxima. Owns its arrays; not changed after building, thread-safe to read.
struct HeightField {
  /// Cells along each side of a block with one maximum.
  static constexpr std::uint32_t kBlock = 16;

  Vec3 origin_mm = Vec3::Zero();
  std::uint32_t columns = 0, rows = 0;  ///< at least two each
  double step_x_mm = 0.0, step_y_mm = 0.0;
  LargePageVector<float> height_mm;  ///< columns * rows, relative to origin_mm.z()
  std::vector<float> block_max_mm;   ///< per block of cells, row by row: its highest post; -infinity in holes
  float low_mm = 0.0f, high_mm = 0.0f;  ///< over all posts but holes
  std::size_t holes = 0;                ///< posts without data

  [[nodiscard]] std::size_t posts() const noexcept { return height_mm.size(); }
  [[nodiscard]] std::size_t at(std::uint32_t column, std::uint32_t row) const noexcept {
    return static_cast<std::size_t>(row) * columns + column;
  }
  [[nodiscard]] std::uint32_t block_columns() const noexcept { return (columns - 2) / kBlock + 1; }
  /// Number of blocks of a lattice.
  [[nodiscard]] static std::size_t blocks_of(std::uint32_t columns, std::uint32_t rows) noexcept {
    return (std::size_t{columns - 2} / kBlock + 1) * (std::size_t{rows - 2} / kBlock + 1);
  }
  /// Section 4.2.1: the largest distance between adjacent posts seen from above (the diagonal).
  [[nodiscard]] double plan_resolution_mm() const noexcept { return std::hypot(step_x_mm, step_y_mm); }
  [[nodiscard]] std::size_t bytes() const noexcept {
    return height_mm.capacity() * sizeof(float) + block_max_mm.capacity() * sizeof(float);
  }
};

/// Finds the plan lattice of a cloud, in any point order. Posts without a point are holes, at most
/// kMaxPostsPerPoint posts a point.
/// Errors: fewer than two rows or columns, a point farther from its post than kLatticeShare of a step, two
/// points at one post. O(n) with a raster, else O(n log n). `point_of_post`, if given, receives the point
/// index per post, kNoPoint in holes.
[[nodiscard]] Result<HeightField> height_field_of(const Cloud& cloud,
                                                  std::vector<std::uint32_t>* point_of_post = nullptr);
inline constexpr std::uint32_t kNoPoint = 0xFFFFFFFFu;

/// Largest offset of a point from its post, as a share of a step: allows single precision and files with few
/// digits, not scattered points. On a slope of 1 the height error is as large.
inline constexpr double kLatticeShare = 1.0 / 64.0;
/// An emptier lattice, as a whole or in parts (sparse_fraction), is no height field but points that happen to
/// be in rows.
inline constexpr std::size_t kMaxPostsPerPoint = 16;

/// Computes block maxima, lowest, highest and hole count from the heights. O(posts).
void update_block_maxima(HeightField& field);

enum class PostKind : std::uint8_t {
  kPoint,    ///< has a point
  kGap,      ///< no point, but points all around: the surface continues
  kVoid,     ///< no point, inside the data
  kOutside,  ///< no point; connected over such posts to the lattice's border
};

/// A post without a point is a gap unless it lies in an empty square of this side (posts beside the lattice
/// count as empty). Each quarter around a gap has a point within 7 posts: gaps are interpolated, never
/// extrapolated.
inline constexpr std::uint32_t kGapPosts = 8;
/// Where many posts are missing such squares occur by chance. An inner void counts only from the side W at
/// which (1 - local share of posts with points)^(W^2) is below this: one in ten thousand per million posts. W
/// is 9 at 30 %, 12 at 15 %.
inline constexpr double kFalseVoidProbability = 1e-10;
/// That side at one point to kMaxPostsPerPoint posts.
inline constexpr std::uint32_t kMaxGapPosts = 19;

struct Holes {
  std::vector<PostKind> of_post;  ///< empty if every post has a point
  std::size_t missing = 0;        ///< gaps + voids + outside
  std::size_t gaps = 0, voids = 0, outside = 0;
  std::uint32_t widest = 0;  ///< side of the largest square of gaps and voids, posts
};

/// Classifies a field from height_field_of(). O(posts); O(1) without missing posts.
[[nodiscard]] Holes find_holes(const HeightField& field);

/// "a lattice of 201 x 201 posts, 2030 of them without a point (5.02 %), the widest hole 2 posts: all are
/// filled from the points around". With `filled` false they stay open.
[[nodiscard]] std::string describe(const HeightField& field, const Holes& holes, bool filled = true);

/// Gives the gaps of `holes` heights from quadrics fitted to the points around by weighted least squares
/// (weights 1 / distance^4 in posts, out to two posts beyond the first reach with points in all quarters, at
/// most kMaxGapPosts). Planes stay planes up to rounding. With `point_of_post` (from height_field_of()) each
/// gap takes its nearest point, the first of ties. Independent of the number of threads. O(posts).
void fill_gaps(HeightField& field, const Holes& holes, std::vector<std::uint32_t>* point_of_post,
               int threads);

/// The share of area of points with fewer than one point per kMaxPostsPerPoint posts in the 19 x 19 posts
/// around. They are over four posts apart: the lattice is their rounding, not the sampling. A point's area is
/// its local posts per point. O(posts).
[[nodiscard]] double sparse_fraction(const HeightField& field);
/// With a larger sparse share of the area the cloud is no height field; `cloud` handles it. A few separate
/// points pass.
inline constexpr double kMaxSparseFraction = 0.01;

/// A cloud as the height-field renderers see it.
struct HeightFieldSummary {
  bool is = false;    ///< the renderers accept it
  std::string words;  ///< describe(), or the reason
  std::uint32_t columns = 0, rows = 0;
  Holes holes;  ///< counts only
  [[nodiscard]] std::size_t posts() const noexcept { return std::size_t{columns} * rows; }
};
[[nodiscard]] HeightFieldSummary summarise_height_field(const Cloud& cloud, bool filled = true);

}  // namespace palpate::cloud
