// Posts of a height field that have no point: which of them are gaps in the surface, to be bridged by the
// points around, and which are voids, where there is none. What `info`, the plan and the renderers say of a
// height field comes from here.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "toolkit/cloud/height_field.h"

namespace palpate::cloud {

enum class PostKind : std::uint8_t {
  kPoint,    ///< a point stands there
  kGap,      ///< none, but points all around: the surface goes on
  kVoid,     ///< none, inside the data
  kOutside,  ///< none, and a way over such posts and voids leads to the border of the lattice
};

/// A post without a point is a gap unless it lies in a square of so many such posts a side (what is beside
/// the lattice counts as such). So each of the four quarters around a gap has a point within 7 posts: it is
/// bridged, never guessed beyond an edge.
inline constexpr std::uint32_t kGapPosts = 8;
/// Where many posts are missing such squares come about by chance: a void inside the data is one only from
/// the side W on at which (1 - share of posts around it that have a point)^(W^2) falls below this, one in ten
/// thousand among a million posts. 9 posts at 30 %, 12 at 15 %.
inline constexpr double kChance = 1e-10;
/// What that gives at a point to kMostPostsPerPoint posts.
inline constexpr std::uint32_t kMostGapPosts = 19;

struct Holes {
  std::vector<PostKind> of_post;  ///< empty where every post has its point
  std::size_t missing = 0;        ///< gaps + voids + outside
  std::size_t gaps = 0, voids = 0, outside = 0;
  std::uint32_t widest = 0;  ///< side of the largest square of gaps and voids, posts
};

/// Of a field as height_field_of() gives it. O(posts); O(1) where every post has its point.
[[nodiscard]] Holes find_holes(const HeightField& field);

/// "a lattice of 201 x 201 posts, 2030 of them without a point (5.02 %), the widest hole 2 posts: all are
/// filled from the points around". With `filled` false they stay as they are.
[[nodiscard]] std::string describe(const HeightField& field, const Holes& holes, bool filled = true);

/// Gives the gaps of `holes` the heights of the surface around: each that of a quadric fitted to the points
/// around it by weighted least squares (weights 1 / distance^4 in posts, out to two posts beyond the first
/// points in all four quarters, kMostGapPosts at most). What is a plane stays one but for rounding. With
/// `point_of_post`, as height_field_of() gives it, each gap takes the nearest point as its own, the first of
/// equally near ones. The same for any number of threads. O(posts).
void fill_gaps(HeightField& field, const Holes& holes, std::vector<std::uint32_t>* point_of_post,
               int threads);

/// The share of the area that belongs to points in whose 19 x 19 posts there is less than a point to
/// kMostPostsPerPoint posts. They stand more than four posts apart: the lattice is what their coordinates
/// were rounded to, not what the surface was sampled on. A point's area is the posts that there are around it
/// to a point. O(posts).
[[nodiscard]] double thin_share(const HeightField& field);
/// More than this share of the area is thin: no height field. A renderer that knows distances between points,
/// `cloud`, is at home there. A few points beside the rest pass.
inline constexpr double kMostThin = 0.01;

/// What a cloud is to the height-field renderers.
struct HeightFieldFacts {
  bool is = false;    ///< they take it
  std::string words;  ///< describe(), or why they do not
  std::uint32_t columns = 0, rows = 0;
  Holes holes;  ///< counts alone
  [[nodiscard]] std::size_t posts() const noexcept { return std::size_t{columns} * rows; }
};
[[nodiscard]] HeightFieldFacts height_field_facts(const Cloud& cloud, bool filled = true);

}  // namespace palpate::cloud
