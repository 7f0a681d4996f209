// A triangle mesh from local Delaunay stars. Each point projects its neighbours to its own plane and takes
// its Delaunay star there; a triangle exists where all three corners have it. This is no global
// reconstruction: where the points allow no triangle, the mesh stays open and counts it.
//
// Points are sorted along a curve and then into blocks of close ones; the sorted index is called a place. A
// frame reads a point and its ring together.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <functional>
#include <string_view>
#include <vector>

#if defined(__SSE2__)
#include <emmintrin.h>
#endif

#include <palpate/cloud.h>
#include <palpate/geometry.h>
#include <palpate/result.h>
#include <palpate/vec.h>
#include "toolkit/core/hardware.h"
#include "toolkit/local_delaunay/bvh_node.h"

namespace palpate::local_delaunay {

/// Ring points stored beside the point; one random point in thirty has more, stored apart.
inline constexpr std::uint32_t kInlineRing = 8;
inline constexpr std::uint32_t kNoPlace = 0xFFFFFFFFu;
/// Consecutive places per block, a leaf of the tree.
inline constexpr std::uint32_t kBlockPlaces = 8;
/// Cache line size; a wrong value only costs time.
inline constexpr std::size_t kLineBytes = 64;

/// A place with its ring in half a cache line, so that crossing to it takes one read. Ring points are
/// differences of places, which are small along the curve; a ring longer than kInlineRing or with a far place
/// is stored apart. Arrays start on a page, so no vertex spans two lines.
struct alignas(32) PackedVertex {
  float x_mm = 0.0F, y_mm = 0.0F, z_mm = 0.0F;
  std::uint32_t info = 0;  ///< see LocalDelaunayMesh
  std::array<std::int16_t, kInlineRing> near{};

  [[nodiscard]] Vec3 at() const noexcept {
    return {static_cast<double>(x_mm), static_cast<double>(y_mm), static_cast<double>(z_mm)};
  }
  /// For an inline ring: the index of the place at difference `off`, or kInlineRing. Branch-free in the
  /// content.
  [[nodiscard]] std::uint32_t find(std::uint32_t off) const noexcept {
    const auto sought = static_cast<std::int16_t>(off & 0xFFFFu);
    std::uint32_t found = 0;
#if defined(__SSE2__)
    const __m128i ring =
        _mm_load_si128(reinterpret_cast<const __m128i*>(near.data()));  // NOLINT: eight of 16 bits
    found = static_cast<std::uint32_t>(_mm_movemask_epi8(_mm_cmpeq_epi16(ring, _mm_set1_epi16(sought))));
#else
    for (std::uint32_t k = 0; k < kInlineRing; ++k) found |= (near[k] == sought ? 3u : 0u) << 2 * k;
#endif
    const bool fits = off == static_cast<std::uint32_t>(static_cast<std::int32_t>(sought));
    return fits && found != 0 ? static_cast<std::uint32_t>(__builtin_ctz(found)) / 2 : kInlineRing;
  }
  /// For an inline ring: bit k is set if this place, as the lowest of its three, visits the triangle of ring
  /// points k and k + 1. Branch-free in the content.
  [[nodiscard]] std::uint32_t lowest_of(std::uint32_t size, std::uint32_t open) const noexcept {
    std::uint32_t later = 0;
#if defined(__SSE2__)
    const __m128i ring =
        _mm_load_si128(reinterpret_cast<const __m128i*>(near.data()));  // NOLINT: eight of 16 bits
    const __m128i above = _mm_cmpgt_epi16(ring, _mm_setzero_si128());
    later = static_cast<std::uint32_t>(_mm_movemask_epi8(_mm_packs_epi16(above, _mm_setzero_si128())));
#else
    for (std::uint32_t k = 0; k < kInlineRing; ++k) later |= (near[k] > 0 ? 1u : 0u) << k;
#endif
    later &= (1u << size) - 1u;
    const std::uint32_t next_later = later >> 1 | (later & 1u) << size >> 1;
    return later & next_later & ~open;
  }
  /// For an inline ring.
  [[nodiscard]] std::uint32_t ring_point(std::uint32_t place, std::uint32_t k) const noexcept {
    return place + static_cast<std::uint32_t>(static_cast<std::int32_t>(near[k]));
  }
  /// The position of a ring stored apart.
  [[nodiscard]] std::uint32_t apart() const noexcept {
    return static_cast<std::uint32_t>(static_cast<std::uint16_t>(near[0])) |
           static_cast<std::uint32_t>(static_cast<std::uint16_t>(near[1])) << 16;
  }
  void set_apart(std::uint32_t at) noexcept {
    near.fill(0);
    near[0] = static_cast<std::int16_t>(at & 0xFFFFu);
    near[1] = static_cast<std::int16_t>(at >> 16);
  }
};
static_assert(sizeof(PackedVertex) == 32);
/// Largest difference of places in an inline ring.
inline constexpr std::uint32_t kMaxPlaceOffset = 0x7FFF;

/// The ring of a place, counter-clockwise from outside: sector k is the triangle of the place and ring points
/// k and k + 1, unless open. A decoded ring owns its points, so it cannot be copied or moved, and `of` must
/// not outlive it.
class Ring {
  std::array<std::uint32_t, kInlineRing> own_;  // unused if the points are stored elsewhere

 public:
  const std::uint32_t* of;
  std::uint32_t size;
  std::uint32_t open;  ///< bit k: sector k has no triangle

  Ring(const std::uint32_t* ring, std::uint32_t count, std::uint32_t open_sectors) noexcept
      : of(ring), size(count), open(open_sectors) {}
  Ring(std::uint32_t place, const std::array<std::int16_t, kInlineRing>& near, std::uint32_t count,
       std::uint32_t open_sectors) noexcept
      : size(count), open(open_sectors) {
    for (std::uint32_t k = 0; k < kInlineRing; ++k)
      own_[k] = place + static_cast<std::uint32_t>(static_cast<std::int32_t>(near[k]));
    of = own_.data();
  }
  Ring(const Ring&) = delete;
  Ring& operator=(const Ring&) = delete;

  [[nodiscard]] std::uint32_t next(std::uint32_t k) const noexcept { return k + 1 == size ? 0 : k + 1; }
  [[nodiscard]] std::uint32_t previous(std::uint32_t k) const noexcept { return k == 0 ? size - 1 : k - 1; }
  [[nodiscard]] bool has_sector(std::uint32_t k) const noexcept { return (open >> k & 1u) == 0; }
  /// The index of `place` in the ring, or size.
  [[nodiscard]] std::uint32_t find(std::uint32_t place) const noexcept {
    std::uint32_t k = 0;
    while (k < size && of[k] != place) ++k;
    return k;
  }
};

/// Numbers of the mesh's parts and gaps.
struct MeshStatistics {
  std::uint64_t triangles = 0;
  std::uint64_t agreed_points = 0;  ///< points whose stars the neighbours confirmed, at once or after repair
  std::uint64_t raster_points = 0;  ///< points whose stars come from a raster's rows and columns
  std::uint64_t voted = 0;          ///< triangles that one or two of three stars had
  std::uint64_t filled = 0;         ///< triangles put into small loops
  std::uint64_t unorientable = 0;   ///< triangles dropped where sides disagree
  std::uint64_t welded = 0;         ///< points that coincide with another
  std::uint64_t unused = 0;         ///< other points without a triangle
  std::uint64_t open_points = 0;    ///< at borders and holes
  std::uint64_t pieces = 0;
  std::uint64_t closed_components = 0;      ///< pieces that enclose a volume and are felt from one side
  std::uint64_t components_with_holes = 0;  ///< of these, pieces with borders
  double min_enclosed = 1.0;                ///< 1 - the widest geometry::opening_fraction() of these
};

/// Called with each build step's name before it begins.
using OnStep = std::function<void(std::string_view)>;

/// User options of a build.
struct BuildOptions {
  bool both_sides = false;  ///< pieces with holes are felt from both sides
  bool raster = true;       ///< read stars from a raster's rows and columns
};

/// Immutable after build, unless its points move (DeformableMesh). Local coordinates, mm.
class LocalDelaunayMesh {
 public:
  /// Builds in parallel. Independent of the number of threads and, for points in no raster, of their order.
  /// Takes stars from a raster, except near holes, jumps and folds. O(n) for clouds of bounded density
  /// variation.
  static LocalDelaunayMesh build(const cloud::Cloud& cloud, int threads, const OnStep& on_step = {},
                                 const BuildOptions& asked = {});

  [[nodiscard]] std::uint32_t size() const noexcept { return static_cast<std::uint32_t>(places_.size()); }
  [[nodiscard]] const Vec3& origin_mm() const noexcept { return origin_mm_; }
  [[nodiscard]] Vec3 at(std::uint32_t place) const noexcept { return places_[place].at(); }
  [[nodiscard]] const PackedVertex& place(std::uint32_t place) const noexcept { return places_[place]; }
  [[nodiscard]] Ring ring(std::uint32_t place) const noexcept {
    const PackedVertex& at = places_[place];
    const std::uint32_t size = at.info & kSizeMask, open = at.info >> kOpenShift & kOpenMask;
    if ((at.info & kRingStoredApart) == 0) [[likely]]
      return {place, at.near, size, open};
    if (size != kLong) return {wide_[place].data(), size, open};
    const std::uint32_t* row = long_rings_.data() + at.apart();
    return {row + kLongHead, row[0], row[1]};
  }
  /// True on a piece that encloses a volume, with holes or not.
  [[nodiscard]] bool is_closed(std::uint32_t place) const noexcept {
    return (places_[place].info & kClosed) != 0;
  }
  /// True if another sheet crosses, or may cross, near the place.
  [[nodiscard]] bool is_crossed(std::uint32_t place) const noexcept {
    return (places_[place].info & kCrossed) != 0;
  }
  /// The closed piece of a place that is on one: below counts().closed_components.
  [[nodiscard]] std::uint32_t closed_component(std::uint32_t place) const noexcept {
    return closed_component_of_.empty() ? 0 : closed_component_of_[place];
  }
  /// True if a closed piece has borders; it may have flipped facets.
  [[nodiscard]] bool has_holes(std::uint32_t piece) const noexcept { return has_holes_[piece] != 0; }
  /// True if the triangle's box misses this box.
  [[nodiscard]] bool triangle_misses(std::uint32_t a, std::uint32_t b, std::uint32_t c,
                                     const FloatBox& box) const noexcept {
    const PackedVertex &p = places_[a], &q = places_[b], &r = places_[c];
    const auto apart = [](float x, float y, float z, float low, float high) {
      return (x < low && y < low && z < low) || (x > high && y > high && z > high);
    };
    return apart(p.x_mm, q.x_mm, r.x_mm, box.low[0], box.high[0]) ||
           apart(p.y_mm, q.y_mm, r.y_mm, box.low[1], box.high[1]) ||
           apart(p.z_mm, q.z_mm, r.z_mm, box.low[2], box.high[2]);
  }
  [[nodiscard]] FloatBox triangle_box(std::uint32_t a, std::uint32_t b, std::uint32_t c) const noexcept {
    const PackedVertex &p = places_[a], &q = places_[b], &r = places_[c];
    const auto low = [](float x, float y, float z) { return std::min(std::min(x, y), z); };
    const auto high = [](float x, float y, float z) { return std::max(std::max(x, y), z); };
    return {{low(p.x_mm, q.x_mm, r.x_mm), low(p.y_mm, q.y_mm, r.y_mm), low(p.z_mm, q.z_mm, r.z_mm)},
            {high(p.x_mm, q.x_mm, r.x_mm), high(p.y_mm, q.y_mm, r.y_mm), high(p.z_mm, q.z_mm, r.z_mm)}};
  }
  /// The ring point of `a` before `b` if they have a triangle, else kNoPlace.
  [[nodiscard]] std::uint32_t before(std::uint32_t a, std::uint32_t b) const noexcept {
    const PackedVertex& at = places_[a];
    if ((at.info & kRingStoredApart) == 0) [[likely]] {
      const std::uint32_t k = at.find(b - a), size = at.info & kSizeMask;
      if (k >= size) return kNoPlace;
      const std::uint32_t sector = k == 0 ? size - 1 : k - 1;
      if ((at.info >> kOpenShift >> sector & 1u) != 0) return kNoPlace;
      return at.ring_point(a, sector);
    }
    const Ring ring = this->ring(a);
    const std::uint32_t k = ring.find(b);
    if (k == ring.size) return kNoPlace;
    const std::uint32_t sector = ring.previous(k);
    return ring.has_sector(sector) ? ring.of[sector] : kNoPlace;
  }
  /// Prefetches the ring's places.
  void prefetch_ring(std::uint32_t place) const noexcept {
    const PackedVertex& at = places_[place];
    if ((at.info & kRingStoredApart) == 0) [[likely]] {
      // Always all entries (the place itself in shorter rings), which avoids a branch on the length.
      for (const std::int16_t off : at.near) __builtin_prefetch(&at + off);
      return;
    }
    const Ring ring = this->ring(place);
    for (std::uint32_t k = 0; k < ring.size; ++k) __builtin_prefetch(&places_[ring.of[k]]);
  }
  /// Prefetches a block's places.
  void prefetch_block(std::uint32_t block) const noexcept {
    const PackedVertex* first = &places_[block * kBlockPlaces];
    for (std::uint32_t k = 0; k < kBlockPlaces; k += kLineBytes / sizeof(PackedVertex))
      __builtin_prefetch(first + k);
  }
  /// The cloud index of each place.
  [[nodiscard]] const std::vector<std::uint32_t>& order() const noexcept { return order_; }
  void drop_order() noexcept { order_ = std::vector<std::uint32_t>(); }
  [[nodiscard]] const MeshStatistics& counts() const noexcept { return counts_; }
  [[nodiscard]] std::size_t bytes() const noexcept;
  /// Calls visit(a, b, c) for every triangle, from its lowest place, counter-clockwise from outside.
  template <class Visit>
  void for_triangles_of(std::uint32_t a, Visit&& visit) const noexcept {
    const PackedVertex& at = places_[a];
    if ((at.info & kRingStoredApart) == 0) [[likely]] {
      const std::uint32_t size = at.info & kSizeMask;
      for (std::uint32_t left = at.lowest_of(size, at.info >> kOpenShift & kOpenMask); left != 0;
           left &= left - 1) {
        const auto k = static_cast<std::uint32_t>(__builtin_ctz(left));
        visit(a, at.ring_point(a, k), at.ring_point(a, k + 1 == size ? 0 : k + 1));
      }
      return;
    }
    const Ring r = ring(a);
    for (std::uint32_t k = 0; k < r.size; ++k) {
      const std::uint32_t b = r.of[k], c = r.of[r.next(k)];
      if (r.has_sector(k) && a < b && a < c) visit(a, b, c);
    }
  }
  /// for_triangles_of() for each place of a block.
  template <class Visit>
  void for_triangles_of_block(std::uint32_t block, Visit&& visit) const noexcept {
    const std::uint32_t first = block * kBlockPlaces, last = std::min(first + kBlockPlaces, size());
    for (std::uint32_t place = first; place < last; ++place) for_triangles_of(place, visit);
  }
  /// A plain mesh over the cloud's points, in their order.
  [[nodiscard]] geometry::TriangleMesh as_mesh() const;

 private:
  friend class LocalDelaunayMeshBuilder;
  friend class DeformableMesh;
  friend class LocalDelaunayMeshStorage;
  friend class MeshRefiner;
  static constexpr std::uint32_t kSizeMask = 0xF, kLong = 0xF, kClosed = 0x10, kCrossed = 0x20;
  static constexpr std::uint32_t kRingStoredApart = 0x40;          ///< the ring is stored apart or in wide_
  static constexpr std::uint32_t kPlaceBits = kClosed | kCrossed;  ///< bits that do not depend on the ring
  static constexpr std::uint32_t kOpenShift = 8, kOpenMask = 0xFF;
  static constexpr std::uint32_t kLongHead = 2;  ///< header of a long ring: size and open sectors

  Vec3 origin_mm_ = Vec3::Zero();
  LargePageUninitializedVector<PackedVertex> places_;
  LargePageVector<std::array<std::uint32_t, kInlineRing>>
      wide_;  ///< uncompressed short rings, of moving points
  std::vector<std::uint32_t> long_rings_;
  LargePageVector<std::uint32_t> closed_component_of_;
  std::vector<std::uint8_t> has_holes_;  ///< by closed piece
  std::vector<std::uint32_t> order_;
  MeshStatistics counts_;
};

}  // namespace palpate::local_delaunay

// A refined mesh through the same points.
namespace palpate::local_delaunay {

/// Most useful levels: each takes four times the memory of the last and halves the remaining error.
inline constexpr int kMaxRefinement = 3;

/// Splits every triangle into four, `levels` times. An edge's new point is the middle of a cubic Hermite
/// segment that leaves both ends along their planes, so it is nearer to a smooth surface by an order than the
/// edge. Creases stay: an edge between facets beyond the crease angle is halved straight, and each side of a
/// crease has its own normals. The old points stay. A new place has the order() of one of its ends. Parallel,
/// independent of the number of threads, O(4^levels n).
[[nodiscard]] LocalDelaunayMesh refined(LocalDelaunayMesh mesh, int levels, int threads);

}  // namespace palpate::local_delaunay
