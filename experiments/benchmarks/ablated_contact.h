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
  kEdges = 2048,     ///< beyond two edges it crosses the farther; a foot on the edge crossed is found
  kAheadOfStep = 4096,  ///< the cube of a look lies ahead of the HIP
  kReady = 8192,        ///< what the god object needs where it lets go is looked up before
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
        if (weights.hold()) return rest_at(h, frame_.pull(weights), stars::Feature::kInside);
        if (has(kCrossing) && cross(h, weights)) return true;
      }
    } else if (has(kClearance) && (h - clear_at_).squaredNorm() < clear_sq_) {
      from_ = h;
      return false;
    }
    return update_slowly(h);
  }

 private:
  /// Always true.
  bool rest_at(const Vec3& h, const Vec3& pull, stars::Feature feature) noexcept {
    pull_ = pull;
    stand_.foot = {h + pull, pull.squaredNorm(), feature};
    return true;
  }
  void read_ahead(std::uint32_t place) const noexcept {
    if (!has(kReadAhead)) return;
    mesh_.prefetch_ring(place);
  }
  bool cross(const Vec3& h, stars::FacetFrame::Weights weights) noexcept {
    stars::Facet facet = stand_.facet;
    Vec3 pull = Vec3::Zero(), normal = frame_.normal();
    stars::Feature feature = stars::Feature::kInside;
    bool found = false, straight = true;
    for (int crossed = 0; crossed < stars::kMaxCrossed && !found; ++crossed) {
      std::uint32_t corner = weights.beyond();
      const bool one = corner < 3;
      if (!one && has(kEdges)) corner = weights.farther_beyond();
      if (corner == 3) break;
      straight = straight && one;
      const std::uint32_t k = stars::corner_after(corner);
      const stars::Facet next = stars::across(mesh_, facet, k);
      if (next.place[0] == stars::kNoPlace) break;
      const stars::FacetFrame of_next(next, 1.0);
      weights = of_next.at(h);
      if (!(weights.height < 0.0)) break;
      if (weights.corner[1] < 0.0) {
        feature = stars::edge_number(k);
        found = has(kEdges) && one && weights.corner[0] >= 0.0 && weights.corner[2] >= 0.0 &&
                stars::rests_on_edge(h, next.corner[0], next.corner[2], normal + of_next.normal(), pull);
        break;
      }
      facet = next;
      frame_ = of_next;
      normal = of_next.normal();
      read_ahead(next.place[1]);
      found = weights.hold();
      if (found) pull = of_next.pull(weights);
    }
    if (!straight && !(found && pull.squaredNorm() <= (h - stand_.foot.point).squaredNorm())) {
      frame_ = stars::FacetFrame(stand_.facet, 1.0);
      return false;
    }
    stand_.facet = facet;
    if (!found) return false;
    const bool rises = pull.squaredNorm() < stand_.foot.distance_sq;
    return rest_at(h, pull, feature) && get_ready(h, rises);
  }
  /// Always true.
  bool get_ready(const Vec3& h, bool rises) noexcept {
    if (!has(kReady) || !has(kRemembered)) return true;
    const std::uint32_t block = stand_.facet.place[0] / stars::kBlockPlaces, node = block / stars::kFanOut;
    if (node != node_read_) {
      node_read_ = node;
      tree_.prefetch_above(block);
    } else if (rises && pull_.cwiseAbs().maxCoeff() < stars::kShallowShare * near_reach_) {
      if (!covers(h, h + pull_))
        find_blocks(h + pull_, near_reach_, stars::kMaxFartherNodes);
      else if (has(kPacked))
        (void)packed(block);
    }
    return true;
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
      if (!has(kReady)) near_reach_ = clear_sq_ = -1.0;
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
      const stars::PackedBlock* at = &packed(block);
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
  const stars::PackedBlock& packed(std::uint32_t block) noexcept {
    auto at = std::find_if(packed_.begin(), packed_.end(), [&](const auto& p) { return p.block == block; });
    if (at == packed_.end()) {
      at = packed_.begin() + static_cast<std::ptrdiff_t>(next_packed_++ % packed_.size());
      at->pack(mesh_, block);
    }
    return *at;
  }
  [[nodiscard]] bool covers(const Vec3& a, const Vec3& b) const noexcept {
    return std::max((a - near_at_).cwiseAbs().maxCoeff(), (b - near_at_).cwiseAbs().maxCoeff()) <=
           near_reach_;
  }
  void first_entry(const Vec3& to, const stars::Stand* left, stars::Hit& hit) noexcept {
    const geometry::Aabb around{from_.cwiseMin(to), from_.cwiseMax(to)};
    const stars::Way way{from_, to, stars::FloatBox::around(around)};
    bool met = false, looked = false;
    bool near = covers(from_, to);
    if (has(kRemembered) && !near)
      near = looked = look_around(to, to - from_);
    else if (has(kReady) && near && near_read_ < near_count_)
      tree_.prefetch(mesh_, near_block_[near_read_++]);
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
  bool look_around(const Vec3& at, const Vec3& step) noexcept {
    const double reach = stars::kStepsAhead * step.cwiseAbs().maxCoeff();
    const double before = has(kAheadOfStep) ? stars::kStepsBefore : 0.0;
    if (!find_blocks(at + before * step, reach, stars::kMaxNodes)) return false;
    for (int farther = 0; has(kClearance) && farther < stars::kFartherLooks && near_count_ == 0; ++farther) {
      const double known = near_reach_;
      const Vec3 known_at = near_at_;
      if (find_blocks(at, stars::kFarther * known, stars::kMaxFartherNodes)) continue;
      near_count_ = 0;
      near_at_ = known_at;
      near_reach_ = known;
      break;
    }
    return true;
  }
  bool find_blocks(const Vec3& at, double reach, std::uint32_t most) noexcept {
    near_count_ = near_read_ = 0;
    near_reach_ = clear_sq_ = -1.0;
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
  std::uint32_t near_count_ = 0, near_read_ = 0, node_read_ = stars::kNoPlace, next_packed_ = 0;
  std::array<stars::PackedBlock, stars::kPackedBlocks> packed_;
};

}  // namespace palpate::benchmarks
