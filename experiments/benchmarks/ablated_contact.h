// The frame of `cloud` on one closed sheet, with any of its ideas left out: what each saves. Forces are those
// of StarContact to the last bit, whatever is left out, but with the god object looked for anew.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "toolkit/core/lanes.h"
#include "toolkit/stars/star_contact.h"

#if defined(__x86_64__)
#include <immintrin.h>
#endif

namespace palpate::benchmarks {

enum Idea : unsigned {
  kLinear = 1,          ///< four linear numbers tell whether the god object stays on its facet
  kCrossing = 2,        ///< over one edge straight on, by the next facet's four numbers
  kWarmStart = 4,       ///< it goes on from where it stood; else the nearest facet is looked for
  kRemembered = 8,      ///< blocks near a free HIP are looked up for eight steps
  kLanes = 16,          ///< boxes of these blocks and their triangles in floats, four side by side
  kLayers = 32,         ///< a block's triangles lie in a layer
  kTriangleBoxes = 64,  ///< a triangle whose box the step misses is not tested
  kPacked = 128,     ///< the triangles of blocks gone through lately are kept with their boxes side by side
  kClearance = 256,  ///< within the distance of the nearest box nothing is looked at
  kWide = 1024,      ///< not left out but tried: boxes eight at a time, where the processor has AVX2
  kReadAhead = 512,  ///< what lies around the next facet is read before it is needed
};

#if defined(__x86_64__)
PALPATE_AVX2 inline unsigned meets_wide(const stars::BoxNode& node, const stars::FloatBox& box) noexcept {
  __m256 all = _mm256_castsi256_ps(_mm256_set1_epi32(-1));
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const __m256 low = _mm256_load_ps(node.low[axis].data()), high = _mm256_load_ps(node.high[axis].data());
    all = _mm256_and_ps(all, _mm256_cmp_ps(low, _mm256_set1_ps(box.high[axis]), _CMP_LE_OQ));
    all = _mm256_and_ps(all, _mm256_cmp_ps(high, _mm256_set1_ps(box.low[axis]), _CMP_GE_OQ));
  }
  return static_cast<unsigned>(_mm256_movemask_ps(all));
}
#endif

/// Starts free. Only for a closed sheet that nothing crosses, touched from outside.
template <unsigned kWithout>
class AblatedContact {
  static constexpr bool has(unsigned idea) { return (kWithout & idea) == 0; }

 public:
  AblatedContact(const stars::StarMesh& mesh, const stars::StarTree& tree, const Vec3& h)
      : mesh_(mesh), tree_(tree), from_(h) {}

  [[nodiscard]] const Vec3& pull() const noexcept { return pull_; }
  [[nodiscard]] bool update(const Vec3& h) noexcept {
    if (contact_) {
      if (has(kLinear)) {
        const auto weights = frame_.at(h);
        if (weights.hold()) return rest_inside(h, weights.height);
        if (has(kCrossing) && cross(h, weights)) return true;
      }
    } else if (has(kClearance) && (h - clear_at_).squaredNorm() < clear_sq_) {
      from_ = h;
      return false;
    }
    return update_slowly(h);
  }

 private:
  bool rest_inside(const Vec3& h, double height) noexcept {
    pull_ = frame_.normal() * -height;
    stand_.foot = {h + pull_, height * height, stars::Feature::kInside};
    return true;
  }
  void read_ahead(std::uint32_t place) const noexcept {
    if (!has(kReadAhead)) return;
    mesh_.prefetch_ring(place);
  }
  bool cross(const Vec3& h, stars::FacetFrame::Weights weights) noexcept {
    for (int crossed = 0; crossed < stars::kMaxCrossed; ++crossed) {
      const std::uint32_t corner = weights.beyond();
      if (corner == 3) return false;
      const stars::Facet next = stars::across(mesh_, stand_.facet, stars::corner_after(corner));
      if (next.place[0] == stars::kNoPlace) return false;
      const stars::FacetFrame frame(next, 1.0);
      weights = frame.at(h);
      if (weights.corner[1] < 0.0 || !(weights.height < 0.0)) return false;
      stand_.facet = next;
      frame_ = frame;
      read_ahead(next.place[1]);
      if (weights.hold()) return rest_inside(h, weights.height);
    }
    return false;
  }
  bool update_slowly(const Vec3& h) noexcept {
    const stars::Stand* left = nullptr;
    for (int flight = 0; flight < stars::kMaxFlights; ++flight) {
      if (!contact_) {
        stars::Hit hit;
        first_entry(h, left, hit);
        if (hit.place[0] == stars::kNoPlace) {
          from_ = h;
          return false;
        }
        contact_ = true;
        stand_.facet = stars::Facet(mesh_, hit.place[0], hit.place[1], hit.place[2]);
        framed_ = false;
      }
      if (follow(h)) return true;
      contact_ = false;
      from_ = stand_.foot.point;
      left = &stand_;
      near_reach_ = clear_sq_ = -1.0;
    }
    return false;
  }
  bool follow(const Vec3& h) noexcept {
    const auto before = stand_.facet.place;
    if (!has(kWarmStart) && framed_) find_nearest(h);
    int moves = stars::kMaxFacetMoves;
    (void)stars::descend(mesh_, h, stand_, moves);
    if (stand_.facet.place != before || !framed_) {
      frame_ = stars::FacetFrame(stand_.facet, 1.0);
      framed_ = true;
      for (const std::uint32_t place : stand_.facet.place) read_ahead(place);
    }
    pull_ = stand_.foot.point - h;
    if (stand_.foot.feature == stars::Feature::kInside) return !(frame_.at(h).height > 0.0);
    return !(stars::side_of(mesh_, stand_, h).height > 0.0);
  }
  /// Of all facets within the distance of the last god object.
  void find_nearest(const Vec3& h) noexcept {
    const Vec3 half = Vec3::Constant((h - stand_.foot.point).norm());
    stars::Stand nearest;
    (void)tree_.for_blocks({h - half, h + half}, stars::kMaxNodes,
                           [&](std::uint32_t block, const auto&, auto) noexcept {
                             for_triangles(block, [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
                               const stars::Facet facet(mesh_, a, b, c);
                               const stars::Foot foot = stars::foot_on(facet, h);
                               if (foot.distance_sq < nearest.foot.distance_sq) nearest = {facet, foot};
                             });
                             return true;
                           });
    if (nearest.facet.place[0] != stars::kNoPlace) stand_ = nearest;
  }
  template <class Visit>
  void for_triangles(std::uint32_t block, Visit&& visit) const noexcept {
    const std::uint32_t first = block * stars::kBlockPlaces;
    const std::uint32_t last = std::min(first + stars::kBlockPlaces, mesh_.size());
    for (std::uint32_t place = first; place < last; ++place) mesh_.for_triangles_of(place, visit);
  }
  [[nodiscard]] static unsigned meets(const stars::BoxNode& node, const stars::FloatBox& box) noexcept {
#if defined(__x86_64__)
    if constexpr (!has(kWide))
      if (__builtin_cpu_supports("avx2")) return meets_wide(node, box);
#endif
    if constexpr (has(kLanes)) return node.meets(box);
    unsigned mask = 0;
    for (std::uint32_t k = 0; k < stars::kFanOut; ++k) {
      bool in = true;
      for (std::size_t axis = 0; axis < 3 && in; ++axis)
        in = static_cast<double>(node.low[axis][k]) <= static_cast<double>(box.high[axis]) &&
             static_cast<double>(node.high[axis][k]) >= static_cast<double>(box.low[axis]);
      mask |= static_cast<unsigned>(in) << k;
    }
    return mask;
  }
  void look(std::uint32_t block, const stars::Way& way, const stars::Stand* left, stars::Hit& hit) noexcept {
    if (has(kLayers) && tree_.layer(block).misses(way.from, way.to)) return;
    const auto takes = [&](std::uint32_t a, std::uint32_t b, std::uint32_t c, double side) noexcept {
      return side > 0.0 && !(left != nullptr && left->facet.place == std::array{a, b, c});
    };
    if (has(kPacked)) {
      auto at = std::find_if(packed_.begin(), packed_.end(), [&](const auto& p) { return p.block == block; });
      if (at == packed_.end()) {
        at = packed_.begin() + static_cast<std::ptrdiff_t>(next_packed_++ % packed_.size());
        at->pack(mesh_, block);
      }
      for (std::uint32_t first = 0; first < std::min(at->size, at->kMost); first += stars::kFanOut) {
        const unsigned filled = (1u << std::min(at->size - first, stars::kFanOut)) - 1u;
        for (unsigned mask = meets(at->box[first / stars::kFanOut], way.box) & filled; mask != 0;
             mask &= mask - 1) {
          const auto& [a, b, c] = at->corner[first + static_cast<std::uint32_t>(__builtin_ctz(mask))];
          stars::pierce_triangle(mesh_, a, b, c, way, hit, takes);
        }
      }
      return;
    }
    for_triangles(block, [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
      if (has(kTriangleBoxes) && mesh_.triangle_misses(a, b, c, way.box)) return;
      stars::pierce_triangle(mesh_, a, b, c, way, hit, takes);
    });
  }
  void first_entry(const Vec3& to, const stars::Stand* left, stars::Hit& hit) noexcept {
    const geometry::Aabb around{from_.cwiseMin(to), from_.cwiseMax(to)};
    const stars::Way way{from_, to, stars::FloatBox::around(around)};
    bool met = false, looked = false;
    clear_sq_ = -1.0;
    const auto covered = [&](const Vec3& p) { return (p - near_at_).cwiseAbs().maxCoeff() <= near_reach_; };
    bool near = covered(to) && covered(from_);
    if (has(kRemembered) && !near)
      near = looked = look_around(to, stars::kStepsAhead * (to - from_).cwiseAbs().maxCoeff());
    if (near) {
      for (std::uint32_t node = 0; node * stars::kFanOut < near_count_; ++node)
        for (unsigned mask = meets(near_box_[node], way.box); mask != 0; mask &= mask - 1) {
          met = true;
          look(near_block_[node * stars::kFanOut + static_cast<std::uint32_t>(__builtin_ctz(mask))], way,
               left, hit);
        }
      if (has(kClearance) && looked && !met) note_clear(to);
      return;
    }
    (void)tree_.for_blocks(around, stars::kMaxNodes, [&](std::uint32_t block, const auto&, auto) noexcept {
      look(block, way, left, hit);
      return true;
    });
  }
  bool look_around(const Vec3& at, double reach) noexcept {
    if (!find_blocks(at, reach, stars::kMaxNodes)) return false;
    for (int farther = 0; has(kClearance) && farther < stars::kFartherLooks && near_count_ == 0; ++farther) {
      const double known = near_reach_;
      if (find_blocks(at, stars::kFarther * known, stars::kMaxFartherNodes)) continue;
      near_count_ = 0;
      near_reach_ = known;
      break;
    }
    return true;
  }
  bool find_blocks(const Vec3& at, double reach, std::uint32_t most) noexcept {
    near_count_ = 0;
    near_reach_ = -1.0;
    near_box_.fill(stars::BoxNode::empty());
    const Vec3 half = Vec3::Constant(reach);
    const bool all = tree_.for_blocks(
        {at - half, at + half}, most,
        [&](std::uint32_t block, const stars::BoxNode& node, std::uint32_t child) noexcept {
          if (near_count_ == stars::kMaxBlocksNear) return false;
          for (std::size_t axis = 0; axis < 3; ++axis) {
            near_box_[near_count_ / stars::kFanOut].low[axis][near_count_ % stars::kFanOut] =
                node.low[axis][child];
            near_box_[near_count_ / stars::kFanOut].high[axis][near_count_ % stars::kFanOut] =
                node.high[axis][child];
          }
          near_block_[near_count_++] = block;
          return true;
        });
    near_at_ = at;
    if (all) near_reach_ = reach;
    return all;
  }
  void note_clear(const Vec3& h) noexcept {
    const double cube = std::max(near_reach_ - (h - near_at_).cwiseAbs().maxCoeff(), 0.0);
    const stars::FloatBox at = stars::FloatBox::around({h, h});
    auto nearest_sq = static_cast<float>(cube * cube);
    for (std::uint32_t first = 0; first < near_count_; first += stars::kFanOut)
      for (const float box_sq : near_box_[first / stars::kFanOut].distance_sq(at))
        nearest_sq = std::min(nearest_sq, box_sq);
    const double clear = stars::kClearShare * std::sqrt(static_cast<double>(nearest_sq)) -
                         stars::kClearSlack * h.cwiseAbs().maxCoeff();
    clear_at_ = h;
    clear_sq_ = clear > 0.0 ? clear * clear : -1.0;
  }

  const stars::StarMesh& mesh_;
  const stars::StarTree& tree_;
  bool contact_ = false, framed_ = false;
  stars::Stand stand_;
  stars::FacetFrame frame_;
  Vec3 pull_ = Vec3::Zero(), from_, near_at_ = Vec3::Zero(), clear_at_ = Vec3::Zero();
  double near_reach_ = -1.0, clear_sq_ = -1.0;
  std::array<stars::BoxNode, stars::kMaxBlocksNear / stars::kFanOut> near_box_;
  std::array<std::uint32_t, stars::kMaxBlocksNear> near_block_{};
  std::uint32_t near_count_ = 0, next_packed_ = 0;
  std::array<stars::PackedBlock, stars::kPackedBlocks> packed_;
};

}  // namespace palpate::benchmarks
