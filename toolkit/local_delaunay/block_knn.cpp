#include "toolkit/local_delaunay/block_knn.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "toolkit/core/hardware.h"
#include "toolkit/core/simd.h"

#if defined(__x86_64__)
#include <immintrin.h>
#endif

namespace palpate::local_delaunay {
namespace {

constexpr float kNowhere = std::numeric_limits<float>::infinity();
/// First radius: the previous block's, slightly enlarged. Most blocks succeed at once, with few extra points.
constexpr float kRadiusRoom = 1.06F;
constexpr float kBoxRoom = 1.0F + 16.0F * std::numeric_limits<float>::epsilon();
/// Growth of the radius after a failure.
constexpr float kWider = 1.5F;
/// A block of eight surface points is 2 to 4 spacings long, and the ball of sixteen neighbours 2.3 wide, so a
/// radius over two blocks was inherited from a sparser place.
constexpr float kMaxPerBlock = 2.0F;
/// With more than kToSpare extra candidates, only those within a radius expected to hold kThinned more than
/// wanted are ranked, if they suffice. Surface points grow with the squared radius.
constexpr std::size_t kToSpare = 6, kThinned = 10;
/// Up to this many candidates are ranked by branch-free pairwise counting; a radius leaves about thirty.
constexpr std::size_t kMostRanked = 64;

/// Squared distances in float. Differences of close coordinates are exact or within half a unit of their last
/// place, so a square is good to a few units.
struct Search {
  const float *x, *y, *z;
  float px, py, pz, limit;
  std::span<const std::uint32_t> blocks;
};

/// Without `rank` and `thin`, candidates are sorted: the same neighbours.
struct SearchKernels {
  /// Appends the places within the limit, in ascending order, with their squares.
  std::size_t (*sieve)(const Search& search, float* key, std::uint32_t* place);
  /// For each of `count` keys, the number of smaller ones. Arrays are read in whole lanes; infinities follow
  /// the count.
  void (*rank)(const float* key, std::size_t count, std::uint32_t* rank);
  /// Keeps those within the limit, in order, if they are more than `most`; returns the number kept.
  std::size_t (*thin)(float* key, std::uint32_t* place, std::size_t count, float limit, std::size_t most);
};

namespace portable {

std::size_t sieve(const Search& s, float* key, std::uint32_t* place) {
  std::size_t count = 0;
  for (const std::uint32_t block : s.blocks)
    for (std::uint32_t i = block * kBlockPlaces; i < (block + 1) * kBlockPlaces; ++i) {
      const float dx = s.x[i] - s.px, dy = s.y[i] - s.py, dz = s.z[i] - s.pz;
      const float square = dx * dx + dy * dy + dz * dz;
      key[count] = square;
      place[count] = i;
      count += static_cast<std::size_t>(square <= s.limit);
    }
  return count;
}

constexpr SearchKernels kKernels = {sieve, nullptr, nullptr};

}  // namespace portable

#if defined(__x86_64__)
namespace avx2 {

PALPATE_AVX2 std::size_t sieve(const Search& s, float* key, std::uint32_t* place) {
  const __m256 px = _mm256_set1_ps(s.px), py = _mm256_set1_ps(s.py), pz = _mm256_set1_ps(s.pz);
  const __m256 limit = _mm256_set1_ps(s.limit);
  std::size_t count = 0;
  for (const std::uint32_t block : s.blocks) {
    const std::size_t i = std::size_t{block} * kBlockPlaces;
    const __m256 dx = _mm256_sub_ps(_mm256_loadu_ps(s.x + i), px);
    const __m256 dy = _mm256_sub_ps(_mm256_loadu_ps(s.y + i), py);
    const __m256 dz = _mm256_sub_ps(_mm256_loadu_ps(s.z + i), pz);
    const __m256 square =
        _mm256_add_ps(_mm256_add_ps(_mm256_mul_ps(dx, dx), _mm256_mul_ps(dy, dy)), _mm256_mul_ps(dz, dz));
    const auto mask = static_cast<unsigned>(_mm256_movemask_ps(_mm256_cmp_ps(square, limit, _CMP_LE_OQ)));
    const __m128i bytes = _mm_cvtsi64_si128(static_cast<long long>(kLanePositions[mask]));
    const __m256i at = _mm256_cvtepu8_epi32(bytes);
    _mm256_storeu_ps(key + count, _mm256_permutevar8x32_ps(square, at));
    _mm256_storeu_si256(reinterpret_cast<__m256i*>(place + count),
                        _mm256_add_epi32(at, _mm256_set1_epi32(static_cast<int>(i))));
    count += static_cast<std::size_t>(__builtin_popcount(mask));
  }
  return count;
}

PALPATE_AVX2 void rank(const float* key, std::size_t count, std::uint32_t* rank) {
  const __m256i lane = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
  for (std::size_t g = 0; g < count; g += kLanes) {
    const __m256 mine = _mm256_loadu_ps(key + g);
    __m256i before = _mm256_setzero_si256();
    for (std::size_t j = 0; j < g; ++j)
      before = _mm256_sub_epi32(
          before, _mm256_castps_si256(_mm256_cmp_ps(_mm256_broadcast_ss(key + j), mine, _CMP_LE_OQ)));
    for (std::size_t m = 0; m < kLanes; ++m) {
      // Equal keys rank before those in later lanes.
      const __m256 other = _mm256_broadcast_ss(key + g + m);
      const __m256 after =
          _mm256_castsi256_ps(_mm256_cmpgt_epi32(lane, _mm256_set1_epi32(static_cast<int>(m))));
      const __m256 less = _mm256_or_ps(_mm256_cmp_ps(other, mine, _CMP_LT_OQ),
                                       _mm256_and_ps(after, _mm256_cmp_ps(other, mine, _CMP_EQ_OQ)));
      before = _mm256_sub_epi32(before, _mm256_castps_si256(less));
    }
    for (std::size_t j = g + kLanes; j < count; ++j)
      before = _mm256_sub_epi32(
          before, _mm256_castps_si256(_mm256_cmp_ps(_mm256_broadcast_ss(key + j), mine, _CMP_LT_OQ)));
    _mm256_storeu_si256(reinterpret_cast<__m256i*>(rank + g), before);
  }
}

PALPATE_AVX2 std::size_t thin(float* key, std::uint32_t* place, std::size_t count, float limit,
                              std::size_t most) {
  const __m256 bound = _mm256_set1_ps(limit);
  const auto mask_at = [&](std::size_t k) PALPATE_AVX2 {
    const __m256 these = _mm256_loadu_ps(key + k);
    const auto mask = static_cast<unsigned>(_mm256_movemask_ps(_mm256_cmp_ps(these, bound, _CMP_LE_OQ)));
    return count - k < kLanes ? mask & ((1u << (count - k)) - 1u) : mask;
  };
  std::size_t within = 0;
  for (std::size_t k = 0; k < count; k += kLanes)
    within += static_cast<std::size_t>(__builtin_popcount(mask_at(k)));
  if (within <= most) return count;
  std::size_t kept = 0;
  for (std::size_t k = 0; k < count; k += kLanes) {
    const unsigned mask = mask_at(k);
    const __m256i at = _mm256_cvtepu8_epi32(_mm_cvtsi64_si128(static_cast<long long>(kLanePositions[mask])));
    const __m256i places = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(place + k));
    _mm256_storeu_ps(key + kept, _mm256_permutevar8x32_ps(_mm256_loadu_ps(key + k), at));
    _mm256_storeu_si256(reinterpret_cast<__m256i*>(place + kept), _mm256_permutevar8x32_epi32(places, at));
    kept += static_cast<std::size_t>(__builtin_popcount(mask));
  }
  return kept;
}

constexpr SearchKernels kKernels = {sieve, rank, thin};

}  // namespace avx2
#endif

const SearchKernels& search_kernels() noexcept {
#if defined(__x86_64__)
  if (has_avx2()) return avx2::kKernels;
#endif
  return portable::kKernels;
}

/// The `most` nearest within `limit` of the sieve's result, without `self`.
void choose(std::uint32_t self, std::size_t count, std::size_t most, float limit, KnnScratch& scratch,
            KnnResult& out) {
  out.size = 0;
  const auto take = [&](float square, std::uint32_t place) {
    if (place == self || out.size == most) return;
    out.square[out.size] = square;
    out.place[out.size++] = place;
  };
  const SearchKernels& kernels = search_kernels();
  if (kernels.thin != nullptr && count > most + kThinned && limit < kNowhere) {
    const float share = static_cast<float>(most + kToSpare) / static_cast<float>(count);
    count = kernels.thin(scratch.key.data(), scratch.place.data(), count, limit * share, most);
  }
  if (kernels.rank != nullptr && count <= kMostRanked) {
    std::fill_n(scratch.key.begin() + static_cast<std::ptrdiff_t>(count), kLanes, kNowhere);
    kernels.rank(scratch.key.data(), count, scratch.rank.data());
    std::array<float, kMostRanked> square;
    std::array<std::uint32_t, kMostRanked> place;
    for (std::size_t k = 0; k < count; ++k) {
      square[scratch.rank[k]] = scratch.key[k];
      place[scratch.rank[k]] = scratch.place[k];
    }
    if (count > most && place[0] == self) {
      std::copy_n(square.begin() + 1, most, out.square.begin());
      std::copy_n(place.begin() + 1, most, out.place.begin());
      out.size = most;
      return;
    }
    for (std::size_t k = 0; k < std::min(count, most + 1); ++k) take(square[k], place[k]);
    return;
  }
  // Non-negative floats order like their bits.
  scratch.pairs.clear();
  for (std::size_t k = 0; k < count; ++k)
    scratch.pairs.push_back(std::uint64_t{std::bit_cast<std::uint32_t>(scratch.key[k])} << 32 |
                            scratch.place[k]);
  const auto last = scratch.pairs.begin() + static_cast<std::ptrdiff_t>(std::min(count, most + 1));
  if (last != scratch.pairs.end()) std::nth_element(scratch.pairs.begin(), last, scratch.pairs.end());
  std::sort(scratch.pairs.begin(), last);
  for (auto pair = scratch.pairs.begin(); pair != last; ++pair)
    take(std::bit_cast<float>(static_cast<std::uint32_t>(*pair >> 32)), static_cast<std::uint32_t>(*pair));
}

}  // namespace

BlockKnn::BlockKnn(const UninitializedVector<SortedPoint>& point, const std::vector<std::uint8_t>& skipped,
                   int threads)
    : count_(point.size()), blocks_((count_ + kBlockPlaces - 1) / kBlockPlaces) {
  constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
  for (auto* axis : {&x_, &y_, &z_}) axis->resize(blocks_ * kBlockPlaces);
  std::size_t nodes = (blocks_ + kBvhWidth - 1) / kBvhWidth;
  levels_.emplace_back(nodes, BvhNode::empty());
  parallel_chunks(nodes, kBlocksPerChunk, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin * kBvhWidth * kBlockPlaces;
         i < std::min(end * kBvhWidth, blocks_) * kBlockPlaces; ++i) {
      const bool none = i >= count_ || skipped[i] != 0;
      x_[i] = none ? kNone : point[i].x_mm;
      y_[i] = none ? kNone : point[i].y_mm;
      z_[i] = none ? kNone : point[i].z_mm;
      if (none) continue;
      const std::size_t block = i / kBlockPlaces, child = block % kBvhWidth;
      BvhNode& node = levels_[0][block / kBvhWidth];
      const std::array<float, 3> at = {x_[i], y_[i], z_[i]};
      for (std::size_t axis = 0; axis < 3; ++axis) {
        node.low[axis][child] = std::min(node.low[axis][child], at[axis]);
        node.high[axis][child] = std::max(node.high[axis][child], at[axis]);
      }
    }
  });
  while (nodes > 1) {
    const std::vector<BvhNode>& below = levels_.back();
    const std::size_t above = (nodes + kBvhWidth - 1) / kBvhWidth;
    std::vector<BvhNode> level(above, BvhNode::empty());
    for (std::size_t i = 0; i < nodes; ++i)
      for (std::size_t axis = 0; axis < 3; ++axis) {
        BvhNode& node = level[i / kBvhWidth];
        node.low[axis][i % kBvhWidth] =
            *std::min_element(below[i].low[axis].begin(), below[i].low[axis].end());
        node.high[axis][i % kBvhWidth] =
            *std::max_element(below[i].high[axis].begin(), below[i].high[axis].end());
      }
    levels_.push_back(std::move(level));
    nodes = above;
  }
  const BvhNode& root = levels_.back()[0];
  for (std::size_t axis = 0; axis < 3; ++axis)
    first_radius_ =
        std::max(first_radius_, *std::max_element(root.high[axis].begin(), root.high[axis].end()) -
                                    *std::min_element(root.low[axis].begin(), root.low[axis].end()));
  first_radius_ /= std::sqrt(static_cast<float>(count_));
}

unsigned BlockKnn::wanted_in(std::size_t block, std::span<const std::uint8_t> wanted) const noexcept {
  unsigned places = 0;
  for (std::size_t k = 0; k < kBlockPlaces; ++k) {
    const std::size_t i = block * kBlockPlaces + k;
    const bool there = !std::isnan(x_[i]) && (wanted.empty() || wanted[i] != 0);
    places |= static_cast<unsigned>(there) << k;
  }
  return places;
}

bool BlockKnn::gather(const FloatBox& box, std::vector<std::uint32_t>& blocks) const {
  blocks.clear();
  const std::size_t top = levels_.size() - 1;
  const BvhNode& root = levels_[top][0];
  bool within = true;
  for (std::size_t axis = 0; axis < 3; ++axis)
    within = within && *std::min_element(root.low[axis].begin(), root.low[axis].end()) >= box.low[axis] &&
             *std::max_element(root.high[axis].begin(), root.high[axis].end()) <= box.high[axis];
  // Depth first; per level the remaining children.
  std::array<unsigned, 32> left{};
  std::array<std::uint32_t, 32> node{};
  std::size_t level = top;
  left[level] = root.meets(box);
  for (;;) {
    if (left[level] == 0) {
      if (level++ == top) return !within;
      continue;
    }
    const auto child = static_cast<std::uint32_t>(std::countr_zero(left[level]));
    left[level] &= left[level] - 1;
    const std::uint32_t index = node[level] * kBvhWidth + child;
    if (level == 0) {
      blocks.push_back(index);
      continue;
    }
    --level;
    node[level] = index;
    left[level] = levels_[level][index].meets(box);
  }
}

float BlockKnn::search(std::size_t block, unsigned places, std::size_t most, float guess, KnnScratch& scratch,
                       std::array<KnnResult, kBlockPlaces>& found) const {
  const BvhNode& node = levels_[0][block / kBvhWidth];
  FloatBox own;
  float longest = 0.0F;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    own.low[axis] = node.low[axis][block % kBvhWidth];
    own.high[axis] = node.high[axis][block % kBvhWidth];
    longest = std::max(longest, own.high[axis] - own.low[axis]);
  }
  const float most_of_block = kMaxPerBlock * longest;
  float radius = guess > 0.0F && (guess < most_of_block || longest == 0.0F) ? guess : most_of_block;
  if (!(radius > 0.0F)) radius = first_radius_;
  float served = 0.0F;
  for (bool more = true; more; radius *= kWider) {
    FloatBox box = own;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      // Covers the distances' rounding and one step for its own.
      const float far = radius * kBoxRoom;
      box.low[axis] = std::nextafter(box.low[axis] - far, -kNowhere);
      box.high[axis] = std::nextafter(box.high[axis] + far, kNowhere);
    }
    more = gather(box, scratch.blocks);
    const std::size_t room = scratch.blocks.size() * kBlockPlaces + 2 * kLanes;
    if (scratch.key.size() < room) {
      scratch.key.resize(room);
      scratch.place.resize(room);
      scratch.rank.resize(std::max(room, kMostRanked + kLanes));
    }
    for (unsigned left = places; left != 0; left &= left - 1) {
      const auto k = static_cast<std::size_t>(std::countr_zero(left));
      const std::size_t i = block * kBlockPlaces + k;
      const Search search = {
          x_.data(),     y_.data(), z_.data(), x_[i], y_[i], z_[i], more ? radius * radius : kNowhere,
          scratch.blocks};
      const std::size_t count = search_kernels().sieve(search, scratch.key.data(), scratch.place.data());
      // The point itself is one of them.
      if (more && count <= most) continue;
      KnnResult& nearby = found[k];
      nearby.place.resize(most);
      nearby.square.resize(most);
      choose(static_cast<std::uint32_t>(i), count, most, search.limit, scratch, nearby);
      if (nearby.size > 0) served = std::max(served, nearby.square[nearby.size - 1]);
      places &= ~(1u << k);
    }
    more = more && places != 0;
  }
  return std::sqrt(served) * kRadiusRoom;
}

}  // namespace palpate::local_delaunay
