// A surface of triangles that the points themselves agree on: every point lays its neighbours out in its own
// plane and takes the Delaunay star there; a triangle stands where all three corners have it. No surface is
// reconstructed: what the points allow no triangle for stays open and is counted.
//
// Points are sorted along a curve and then in blocks of near ones, called places here; a point and the ring
// around it are read together in a frame.
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

#include "toolkit/cloud/cloud.h"
#include "toolkit/core/large_pages.h"
#include "toolkit/core/result.h"
#include "toolkit/core/unset_vector.h"
#include "toolkit/core/vec.h"
#include "toolkit/geometry/triangle_mesh.h"
#include "toolkit/stars/float_box.h"

namespace palpate::stars {

/// Ring points that fit beside the point; of random points one in thirty has more, kept apart.
inline constexpr std::uint32_t kShortRing = 8;
inline constexpr std::uint32_t kNoPlace = 0xFFFFFFFFu;
/// Consecutive places that lie together: what a leaf of the tree over a mesh holds.
inline constexpr std::uint32_t kBlockPlaces = 8;
/// What a processor reads at once; where it reads less or more only time is lost.
inline constexpr std::size_t kLineBytes = 64;

/// A place with its ring, half a line of cache: what a frame crosses to is read at once. Ring points are kept
/// as differences of places, which are near along the curve; a ring that is longer than kShortRing, or goes
/// to a place too far off, lies apart. Large arrays begin on a page, so that none is on two lines.
struct alignas(32) StarPlace {
  float x_mm = 0.0F, y_mm = 0.0F, z_mm = 0.0F;
  std::uint32_t info = 0;  ///< see StarMesh
  std::array<std::int16_t, kShortRing> near{};

  [[nodiscard]] Vec3 at() const noexcept {
    return {static_cast<double>(x_mm), static_cast<double>(y_mm), static_cast<double>(z_mm)};
  }
  /// Of a ring that is kept here: where the place stands that is so far off, or kShortRing. Without a branch
  /// on what is found.
  [[nodiscard]] std::uint32_t find(std::uint32_t off) const noexcept {
    const auto sought = static_cast<std::int16_t>(off & 0xFFFFu);
    std::uint32_t found = 0;
#if defined(__SSE2__)
    const __m128i ring =
        _mm_load_si128(reinterpret_cast<const __m128i*>(near.data()));  // NOLINT: eight of 16 bits
    found = static_cast<std::uint32_t>(_mm_movemask_epi8(_mm_cmpeq_epi16(ring, _mm_set1_epi16(sought))));
#else
    for (std::uint32_t k = 0; k < kShortRing; ++k) found |= (near[k] == sought ? 3u : 0u) << 2 * k;
#endif
    const bool fits = off == static_cast<std::uint32_t>(static_cast<std::int32_t>(sought));
    return fits && found != 0 ? static_cast<std::uint32_t>(__builtin_ctz(found)) / 2 : kShortRing;
  }
  /// Of a ring that is kept here: bit k is set where the triangle of ring points k and k + 1 is this place's
  /// to visit, the lowest of its three. Without a branch on what is found.
  [[nodiscard]] std::uint32_t lowest_of(std::uint32_t size, std::uint32_t open) const noexcept {
    std::uint32_t later = 0;
#if defined(__SSE2__)
    const __m128i ring =
        _mm_load_si128(reinterpret_cast<const __m128i*>(near.data()));  // NOLINT: eight of 16 bits
    const __m128i above = _mm_cmpgt_epi16(ring, _mm_setzero_si128());
    later = static_cast<std::uint32_t>(_mm_movemask_epi8(_mm_packs_epi16(above, _mm_setzero_si128())));
#else
    for (std::uint32_t k = 0; k < kShortRing; ++k) later |= (near[k] > 0 ? 1u : 0u) << k;
#endif
    later &= (1u << size) - 1u;
    const std::uint32_t next_later = later >> 1 | (later & 1u) << size >> 1;
    return later & next_later & ~open;
  }
  /// Of a ring that is kept here.
  [[nodiscard]] std::uint32_t ring_point(std::uint32_t place, std::uint32_t k) const noexcept {
    return place + static_cast<std::uint32_t>(static_cast<std::int32_t>(near[k]));
  }
  /// Of a ring that lies apart: where.
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
static_assert(sizeof(StarPlace) == 32);
/// The greatest difference of places that is kept beside a place.
inline constexpr std::uint32_t kMostNear = 0x7FFF;

/// The ring of a place, counter-clockwise seen from outside: sector k is the triangle of the place and ring
/// points k and k + 1, unless it is open. It holds its points itself where they were kept as differences, so
/// it is neither copied nor moved, and `of` lives no longer than it does.
class Ring {
  std::array<std::uint32_t, kShortRing> own_;  // unset where the points lie elsewhere

 public:
  const std::uint32_t* of;
  std::uint32_t size;
  std::uint32_t open;  ///< bit k: sector k has no triangle

  Ring(const std::uint32_t* ring, std::uint32_t count, std::uint32_t open_sectors) noexcept
      : of(ring), size(count), open(open_sectors) {}
  Ring(std::uint32_t place, const std::array<std::int16_t, kShortRing>& near, std::uint32_t count,
       std::uint32_t open_sectors) noexcept
      : size(count), open(open_sectors) {
    for (std::uint32_t k = 0; k < kShortRing; ++k)
      own_[k] = place + static_cast<std::uint32_t>(static_cast<std::int32_t>(near[k]));
    of = own_.data();
  }
  Ring(const Ring&) = delete;
  Ring& operator=(const Ring&) = delete;

  [[nodiscard]] std::uint32_t next(std::uint32_t k) const noexcept { return k + 1 == size ? 0 : k + 1; }
  [[nodiscard]] std::uint32_t previous(std::uint32_t k) const noexcept { return k == 0 ? size - 1 : k - 1; }
  [[nodiscard]] bool has_sector(std::uint32_t k) const noexcept { return (open >> k & 1u) == 0; }
  /// Where `place` stands in the ring, or size.
  [[nodiscard]] std::uint32_t find(std::uint32_t place) const noexcept {
    std::uint32_t k = 0;
    while (k < size && of[k] != place) ++k;
    return k;
  }
};

/// What the surface is made of, and what it lacks.
struct StarCounts {
  std::uint64_t triangles = 0;
  std::uint64_t agreed_points = 0;  ///< whose whole star the neighbours had at once, or after another look
  std::uint64_t raster_points = 0;  ///< whose stars were read from a raster's rows and columns
  std::uint64_t voted = 0;          ///< triangles that one or two of three stars had
  std::uint64_t filled = 0;         ///< triangles put into small loops
  std::uint64_t torn = 0;           ///< triangles left out where sides would not agree
  std::uint64_t welded = 0;         ///< points that stand where another does
  std::uint64_t unused = 0;         ///< other points without a triangle
  std::uint64_t open_points = 0;    ///< at borders and holes
  std::uint64_t pieces = 0;
  std::uint64_t closed_pieces = 0;      ///< that enclose a volume, and are felt from one side
  std::uint64_t pieces_with_holes = 0;  ///< those of them that have borders
  double least_enclosed = 1.0;          ///< 1 less the widest geometry::mouth_share() of these
};

/// Called with the name of each step of a build before it begins.
using OnStep = std::function<void(std::string_view)>;

/// What a user may ask of a build.
struct StarBuild {
  bool both_sides = false;  ///< pieces with holes are felt from both sides, whatever they enclose
  bool raster = true;       ///< stars are read from the rows and columns of a scan that has them
};

/// Immutable after build, but where its points move (MovingStars). Local coordinates, mm.
class StarMesh {
 public:
  /// Parallel; the same for any number of threads and any order of the points, where these stand in no
  /// raster. From a raster without holes, jumps and folds the stars are read; with such, most of them. O(n)
  /// for clouds of bounded density variation.
  static StarMesh build(const cloud::Cloud& cloud, int threads, const OnStep& on_step = {},
                        const StarBuild& asked = {});

  [[nodiscard]] std::uint32_t size() const noexcept { return static_cast<std::uint32_t>(places_.size()); }
  [[nodiscard]] const Vec3& origin_mm() const noexcept { return origin_mm_; }
  [[nodiscard]] Vec3 at(std::uint32_t place) const noexcept { return places_[place].at(); }
  [[nodiscard]] const StarPlace& place(std::uint32_t place) const noexcept { return places_[place]; }
  [[nodiscard]] Ring ring(std::uint32_t place) const noexcept {
    const StarPlace& at = places_[place];
    const std::uint32_t size = at.info & kSizeMask, open = at.info >> kOpenShift & kOpenMask;
    if ((at.info & kElsewhere) == 0) [[likely]]
      return {place, at.near, size, open};
    if (size != kLong) return {wide_[place].data(), size, open};
    const std::uint32_t* row = long_rings_.data() + at.apart();
    return {row + kLongHead, row[0], row[1]};
  }
  /// On a piece that encloses a volume, if need be but for holes.
  [[nodiscard]] bool is_closed(std::uint32_t place) const noexcept {
    return (places_[place].info & kClosed) != 0;
  }
  /// Another sheet goes through this one beside the place, or may.
  [[nodiscard]] bool is_crossed(std::uint32_t place) const noexcept {
    return (places_[place].info & kCrossed) != 0;
  }
  /// The closed piece of a place that is on one: below counts().closed_pieces.
  [[nodiscard]] std::uint32_t closed_piece(std::uint32_t place) const noexcept {
    return closed_piece_of_.empty() ? 0 : closed_piece_of_[place];
  }
  /// Of a closed piece: it has borders, and maybe facets that are turned over.
  [[nodiscard]] bool has_holes(std::uint32_t piece) const noexcept { return has_holes_[piece] != 0; }
  /// Whether the triangle's box does not meet this one.
  [[nodiscard]] bool triangle_misses(std::uint32_t a, std::uint32_t b, std::uint32_t c,
                                     const FloatBox& box) const noexcept {
    const StarPlace &p = places_[a], &q = places_[b], &r = places_[c];
    const auto apart = [](float x, float y, float z, float low, float high) {
      return (x < low && y < low && z < low) || (x > high && y > high && z > high);
    };
    return apart(p.x_mm, q.x_mm, r.x_mm, box.low[0], box.high[0]) ||
           apart(p.y_mm, q.y_mm, r.y_mm, box.low[1], box.high[1]) ||
           apart(p.z_mm, q.z_mm, r.z_mm, box.low[2], box.high[2]);
  }
  [[nodiscard]] FloatBox triangle_box(std::uint32_t a, std::uint32_t b, std::uint32_t c) const noexcept {
    const StarPlace &p = places_[a], &q = places_[b], &r = places_[c];
    const auto low = [](float x, float y, float z) { return std::min(std::min(x, y), z); };
    const auto high = [](float x, float y, float z) { return std::max(std::max(x, y), z); };
    return {{low(p.x_mm, q.x_mm, r.x_mm), low(p.y_mm, q.y_mm, r.y_mm), low(p.z_mm, q.z_mm, r.z_mm)},
            {high(p.x_mm, q.x_mm, r.x_mm), high(p.y_mm, q.y_mm, r.y_mm), high(p.z_mm, q.z_mm, r.z_mm)}};
  }
  /// What the ring of `a` has before `b`, where a triangle is between the two; else kNoPlace.
  [[nodiscard]] std::uint32_t before(std::uint32_t a, std::uint32_t b) const noexcept {
    const StarPlace& at = places_[a];
    if ((at.info & kElsewhere) == 0) [[likely]] {
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
  /// Asks for what lies around a place.
  void prefetch_ring(std::uint32_t place) const noexcept {
    const StarPlace& at = places_[place];
    if ((at.info & kElsewhere) == 0) [[likely]] {
      // All of them, the place itself where the ring is shorter: without a branch on its length.
      for (const std::int16_t off : at.near) __builtin_prefetch(&at + off);
      return;
    }
    const Ring ring = this->ring(place);
    for (std::uint32_t k = 0; k < ring.size; ++k) __builtin_prefetch(&places_[ring.of[k]]);
  }
  /// Asks for the places of a block.
  void prefetch_block(std::uint32_t block) const noexcept {
    const StarPlace* first = &places_[block * kBlockPlaces];
    for (std::uint32_t k = 0; k < kBlockPlaces; k += kLineBytes / sizeof(StarPlace))
      __builtin_prefetch(first + k);
  }
  /// Of each place its index in the cloud.
  [[nodiscard]] const std::vector<std::uint32_t>& order() const noexcept { return order_; }
  void drop_order() noexcept { order_ = std::vector<std::uint32_t>(); }
  [[nodiscard]] const StarCounts& counts() const noexcept { return counts_; }
  [[nodiscard]] std::size_t bytes() const noexcept;
  /// visit(a, b, c) for every triangle, from its lowest place, counter-clockwise seen from outside.
  template <class Visit>
  void for_triangles_of(std::uint32_t a, Visit&& visit) const noexcept {
    const StarPlace& at = places_[a];
    if ((at.info & kElsewhere) == 0) [[likely]] {
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
  /// for_triangles_of() each place of a block.
  template <class Visit>
  void for_triangles_of_block(std::uint32_t block, Visit&& visit) const noexcept {
    const std::uint32_t first = block * kBlockPlaces, last = std::min(first + kBlockPlaces, size());
    for (std::uint32_t place = first; place < last; ++place) for_triangles_of(place, visit);
  }
  /// As a mesh of the cloud's points, in its order: what reconstructions make.
  [[nodiscard]] geometry::TriangleMesh as_mesh() const;

 private:
  friend class StarMeshBuilder;
  friend class MovingStars;
  friend class StarMeshStore;
  friend class StarRefiner;
  static constexpr std::uint32_t kSizeMask = 0xF, kLong = 0xF, kClosed = 0x10, kCrossed = 0x20;
  static constexpr std::uint32_t kElsewhere = 0x40;              ///< the ring is long, or in wide_
  static constexpr std::uint32_t kOfPlace = kClosed | kCrossed;  ///< what does not change with the ring
  static constexpr std::uint32_t kOpenShift = 8, kOpenMask = 0xFF;
  static constexpr std::uint32_t kLongHead = 2;  ///< before a long ring: its size and open sectors

  Vec3 origin_mm_ = Vec3::Zero();
  LargeUnsetVector<StarPlace> places_;
  LargeVector<std::array<std::uint32_t, kShortRing>> wide_;  ///< short rings of points that move, in full
  std::vector<std::uint32_t> long_rings_;
  LargeVector<std::uint32_t> closed_piece_of_;
  std::vector<std::uint8_t> has_holes_;  ///< by closed piece
  std::vector<std::uint32_t> order_;
  StarCounts counts_;
};

}  // namespace palpate::stars
