// Posts of a height field without a point: gaps, bridged by the points around, and voids. `info`, the plan
// and the renderers use this classification.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "toolkit/cloud/height_field.h"

namespace palpate::cloud {

enum class PostKind : std::uint8_t {
  kPoint,    ///< has a point
  kGap,      ///< no point, but points all around: the surface continues
  kVoid,     ///< no point, inside the data
  kOutside,  ///< no point; connected over such posts to the lattice's border
};

/// A post without a point is a gap unless it lies in an empty square of this side (posts beside the lattice
/// count as empty). So each quarter around a gap has a point within 7 posts: gaps are interpolated, never
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
