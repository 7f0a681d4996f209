// State of the points while the mesh is built. Internal to local_delaunay.
#pragma once

#include <palpate/vec.h>
#include <Eigen/Geometry>  // cross products
#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <mutex>
#include <span>
#include <tuple>
#include <vector>

#include "toolkit/core/hardware.h"
#include "toolkit/core/parallel.h"
#include "toolkit/local_delaunay/local_delaunay_mesh.h"
#include "toolkit/local_delaunay/planar_voronoi_cell.h"
#include "toolkit/local_delaunay/spatial_sort.h"

#if defined(__SSE2__)
#include <emmintrin.h>
#endif

namespace palpate::local_delaunay {

/// Nearest points from which a star is made. One random star in a thousand reaches its twelfth neighbour;
/// sixteen leave room for those that the layout rejects.
inline constexpr std::size_t kNearest = 16;
using NearestPoints = std::array<std::uint32_t, kNearest>;
/// Stands for "no point".
inline constexpr std::uint32_t kNoPoint = 0xFFFFFFFFu;

/// A star, as Shewchuk names it ("Star splaying", SCG 2005): the triangles around a point, by its ring of
/// neighbours, counter-clockwise about its normal. Sector k lies between ring points k and k + 1. Ring points
/// are distinct. Most reads touch one cache line.
struct alignas(64) Star {
  std::uint32_t size = 0;
  std::uint32_t open = 0;    ///< bit k: sector k has no triangle
  std::uint32_t agreed = 0;  ///< bit k: the stars of both other corners have the triangle too
  std::array<std::uint32_t, kMaxCorners> ring{};

  [[nodiscard]] std::uint32_t next(std::uint32_t k) const noexcept { return k + 1 == size ? 0 : k + 1; }
  [[nodiscard]] std::uint32_t previous(std::uint32_t k) const noexcept { return k == 0 ? size - 1 : k - 1; }
  [[nodiscard]] bool has_sector(std::uint32_t k) const noexcept { return (open >> k & 1u) == 0; }
  [[nodiscard]] bool is_agreed(std::uint32_t k) const noexcept { return (agreed >> k & 1u) != 0; }
  [[nodiscard]] bool has_sectors() const noexcept { return open != (1u << size) - 1u; }
  [[nodiscard]] bool has_agreed_all() const noexcept { return agreed == (1u << size) - 1u; }
  [[nodiscard]] std::uint32_t sectors() const noexcept { return size - bits_of(open); }
  [[nodiscard]] std::uint32_t agreements() const noexcept { return bits_of(agreed); }
  /// The point's index in the ring, or size.
  [[nodiscard]] std::uint32_t find(std::uint32_t b) const noexcept {
    for (std::uint32_t first = 0; first < size; first += kFound) {
      const unsigned same = same_in(first, b);
      if (same == 0) continue;
      const std::uint32_t k = first + static_cast<std::uint32_t>(__builtin_ctz(same));
      return k < size ? k : size;
    }
    return size;
  }
  /// True if the star has the triangle with ring point k and c, on either side of k. False for k = size.
  [[nodiscard]] bool holds(std::uint32_t k, std::uint32_t c) const noexcept {
    if (k == size) return false;
    if (ring[next(k)] == c && has_sector(k)) return true;
    const std::uint32_t before = previous(k);
    return ring[before] == c && has_sector(before);
  }
  [[nodiscard]] bool closed_and_agreed() const noexcept { return size >= 3 && has_agreed_all(); }

 private:
  static constexpr std::uint32_t kFound = 8;  ///< ring points compared at once
  static_assert(kMaxCorners % kFound == 0 && kMaxCorners < 32);
  /// Bit k: ring point first + k (or memory past the ring's end) is b.
  [[nodiscard]] unsigned same_in(std::uint32_t first, std::uint32_t b) const noexcept {
#if defined(__SSE2__)
    const __m128i wanted = _mm_set1_epi32(static_cast<int>(b));
    const auto four = [&](std::uint32_t at) {
      const __m128i these = _mm_loadu_si128(reinterpret_cast<const __m128i*>(&ring[at]));
      return _mm_cmpeq_epi32(these, wanted);
    };
    const __m128i eight = _mm_packs_epi32(four(first), four(first + kFound / 2));
    return static_cast<unsigned>(_mm_movemask_epi8(_mm_packs_epi16(eight, _mm_setzero_si128())));
#else
    unsigned same = 0;
    for (std::uint32_t k = 0; k < kFound; ++k) same |= static_cast<unsigned>(ring[first + k] == b) << k;
    return same;
#endif
  }
  [[nodiscard]] static std::uint32_t bits_of(std::uint32_t x) noexcept {
    return static_cast<std::uint32_t>(std::popcount(x));
  }
};

/// Rows that do not fit beside the others. Several threads may add some, and read what was there before or is
/// their own: nothing moves.
template <class Row>
class RowsApart {
 public:
  std::uint32_t add(const Row& row) {
    const std::lock_guard lock(gate_);
    UninitializedVector<Row>& block = blocks_[block_of(size_)];
    if (block.empty()) block.resize(kFirst << block_of(size_));
    block[size_ - first_of(block_of(size_))] = row;
    return size_++;
  }
  [[nodiscard]] Row& operator[](std::uint32_t i) noexcept {
    return blocks_[block_of(i)][i - first_of(block_of(i))];
  }
  [[nodiscard]] const Row& operator[](std::uint32_t i) const noexcept {
    return blocks_[block_of(i)][i - first_of(block_of(i))];
  }
  void release() noexcept {
    for (UninitializedVector<Row>& block : blocks_) release_memory(block);
    size_ = 0;
  }

 private:
  /// Rows of the first block; each is twice as large as the one before.
  static constexpr std::size_t kFirst = 1024;
  [[nodiscard]] static std::size_t block_of(std::uint32_t i) noexcept {
    return static_cast<std::size_t>(std::bit_width(i / kFirst + 1)) - 1;
  }
  [[nodiscard]] static std::size_t first_of(std::size_t block) noexcept {
    return ((std::size_t{1} << block) - 1) * kFirst;
  }
  std::array<UninitializedVector<Row>, 23> blocks_;
  std::uint32_t size_ = 0;
  std::mutex gate_;  ///< of adding
};

/// A difference of places where it fits beside others: at most kMaxPlaceOffset.
[[nodiscard]] inline bool is_near_along(std::uint32_t place, std::uint32_t other) noexcept {
  const auto off = static_cast<std::int32_t>(other - place);
  return std::abs(off) <= static_cast<std::int32_t>(kMaxPlaceOffset);
}
[[nodiscard]] inline std::int16_t offset_along(std::uint32_t place, std::uint32_t other) noexcept {
  return static_cast<std::int16_t>(static_cast<std::int32_t>(other - place));
}
[[nodiscard]] inline std::uint32_t place_along(std::uint32_t place, std::int16_t offset) noexcept {
  return place + static_cast<std::uint32_t>(static_cast<std::int32_t>(offset));
}
/// A number as two offsets, for the place of a row apart.
[[nodiscard]] inline std::uint32_t number_of(std::int16_t low, std::int16_t high) noexcept {
  return static_cast<std::uint32_t>(static_cast<std::uint16_t>(low)) |
         static_cast<std::uint32_t>(static_cast<std::uint16_t>(high)) << 16;
}

/// The stars of all points, as differences of places in half a cache line each, as in the stored mesh. Apart
/// are those of a longer ring, some five of a million random points, and those that reach farther along the
/// curve, one in fifty of some million points. Several threads may write different stars, and read
/// others while only their `agreed` is written.
class StarTable {
 public:
  struct alignas(32) Line {
    std::uint16_t size;  ///< kApart: see `off`
    std::uint16_t open, agreed;
    std::array<std::int16_t, 13> off;  ///< of the ring's places, or the number of the star apart
  };
  static_assert(sizeof(Line) == 32);

  void resize(std::size_t points) { lines_.resize(points); }
  [[nodiscard]] Star operator[](std::size_t i) const noexcept { return star_of(i, lines_[i]); }
  void put(std::size_t i, const Star& star) { lines_[i] = line_of(i, star); }
  /// A star as point i would hold it.
  [[nodiscard]] Line line_of(std::size_t i, const Star& star) {
    const auto place = static_cast<std::uint32_t>(i);
    Line line;
    bool fits = star.size <= line.off.size();
    for (std::uint32_t k = 0; k < line.off.size(); ++k) {
      fits = fits && (k >= star.size || is_near_along(place, star.ring[k]));
      line.off[k] = offset_along(place, star.ring[k]);
    }
    line.size = fits ? static_cast<std::uint16_t>(star.size) : kApart;
    line.open = static_cast<std::uint16_t>(star.open);
    line.agreed = static_cast<std::uint16_t>(star.agreed);
    if (fits) [[likely]]
      return line;
    const std::uint32_t number = apart_.add(star);
    line.off[0] = static_cast<std::int16_t>(number & 0xFFFFu);
    line.off[1] = static_cast<std::int16_t>(number >> 16);
    return line;
  }
  void set_agreed(std::size_t i, std::uint32_t agreed) noexcept {
    Line& line = lines_[i];
    if (line.size == kApart)
      apart_[number_of(line.off[0], line.off[1])].agreed = agreed;
    else
      line.agreed = static_cast<std::uint16_t>(agreed);
  }
  /// A star as it is held, which may be put back: stars apart stay.
  [[nodiscard]] const Line& line(std::size_t i) const noexcept { return lines_[i]; }
  void put_back(std::size_t i, const Line& line) noexcept { lines_[i] = line; }
  [[nodiscard]] Star star_of(std::size_t i, const Line& line) const noexcept {
    if (line.size == kApart) [[unlikely]]
      return apart(line);
    Star star;
    star.size = line.size;
    star.open = line.open;
    star.agreed = line.agreed;
    for (std::uint32_t k = 0; k < line.off.size(); ++k)
      star.ring[k] = place_along(static_cast<std::uint32_t>(i), line.off[k]);
    return star;
  }
  [[nodiscard]] std::uint32_t size(std::size_t i) const noexcept {
    const Line& line = lines_[i];
    return line.size == kApart ? apart(line).size : line.size;
  }
  /// As Star::find() and Star::holds(); `agreed` is not read.
  [[nodiscard]] std::uint32_t find(std::uint32_t i, std::uint32_t b) const noexcept {
    const Line& line = lines_[i];
    if (line.size == kApart) [[unlikely]]
      return apart(line).find(b);
    const std::uint32_t found = is_near_along(i, b) ? same_in(line, offset_along(i, b)) : 0u;
    return found != 0 ? static_cast<std::uint32_t>(std::countr_zero(found)) : line.size;
  }
  [[nodiscard]] bool holds(std::uint32_t i, std::uint32_t k, std::uint32_t c) const noexcept {
    const Line& line = lines_[i];
    if (line.size == kApart) [[unlikely]]
      return apart(line).holds(k, c);
    if (k == line.size || !is_near_along(i, c)) return false;
    const std::int16_t off = offset_along(i, c);
    const std::uint32_t next = k + 1 == line.size ? 0 : k + 1, before = (k == 0 ? line.size : k) - 1u;
    return (line.off[next] == off && (line.open >> k & 1) == 0) ||
           (line.off[before] == off && (line.open >> before & 1) == 0);
  }

 private:
  static constexpr std::uint16_t kApart = 0xFFFF;
  [[nodiscard]] const Star& apart(const Line& line) const noexcept {
    return apart_[number_of(line.off[0], line.off[1])];
  }
  /// Bit k: ring point k is at that offset.
  [[nodiscard]] static std::uint32_t same_in(const Line& line, std::int16_t off) noexcept {
    std::uint32_t same = 0;
#if defined(__SSE2__)
    const __m128i wanted = _mm_set1_epi16(off);
    const auto eight = [&](std::size_t at) {
      const __m128i these = _mm_loadu_si128(reinterpret_cast<const __m128i*>(&line.off[at]));  // NOLINT
      return _mm_cmpeq_epi16(these, wanted);
    };
    // The second eight are the last, of which the first three are among the first.
    constexpr std::size_t kLast = std::tuple_size_v<decltype(Line::off)> - 8;
    const auto both = static_cast<unsigned>(_mm_movemask_epi8(_mm_packs_epi16(eight(0), eight(kLast))));
    same = (both & 0xFFu) | (both >> 8) << kLast;
#else
    for (std::uint32_t k = 0; k < line.off.size(); ++k)
      same |= static_cast<std::uint32_t>(line.off[k] == off) << k;
#endif
    return same & ((1u << line.size) - 1u);
  }

  UninitializedVector<Line> lines_;
  RowsApart<Star> apart_;
};

/// The nearest of all points, as differences of places too. Several threads may write different rows.
class NearTable {
 public:
  void resize(std::size_t points) { lines_.resize(points); }
  [[nodiscard]] NearestPoints operator[](std::uint32_t i) const noexcept {
    const Line& line = lines_[i];
    if (line[0] == kApart) [[unlikely]]
      return apart_[number_of(line[1], line[2])];
    NearestPoints near;
    for (std::size_t k = 0; k < kNearest; ++k) near[k] = place_along(i, line[k]);
    return near;
  }
  void put(std::uint32_t i, const NearestPoints& near) {
    Line& line = lines_[i];
    bool fits = true;
    for (std::size_t k = 0; k < kNearest; ++k) {
      fits = fits && is_near_along(i, near[k]);
      line[k] = offset_along(i, near[k]);
    }
    if (fits) [[likely]]
      return;
    const std::uint32_t number = apart_.add(near);
    line[0] = kApart;
    line[1] = static_cast<std::int16_t>(number & 0xFFFFu);
    line[2] = static_cast<std::int16_t>(number >> 16);
  }
  void release() noexcept {
    release_memory(lines_);
    apart_.release();
  }

 private:
  using Line = std::array<std::int16_t, kNearest>;
  /// In place of a difference, beyond kMaxPlaceOffset: the next two are the number of the row apart.
  static constexpr std::int16_t kApart = -0x8000;
  UninitializedVector<Line> lines_;
  RowsApart<NearestPoints> apart_;
};

struct CandidateTriangulation {
  int threads = 0;
  bool both_sides = false;  ///< see BuildOptions
  /// The weights break ties on lattices (find_nearest.cpp).
  UninitializedVector<SortedPoint> point;
  NearTable near;                               ///< nearest first; unused entries hold the point's own index
  UninitializedVector<std::uint32_t> farthest;  ///< the last of `near`, which is empty where this is not
  std::vector<Vec3f> normal;                    ///< unit, either sign; zero if none
  std::vector<std::uint8_t> welded;             ///< 1: (nearly) coincides with another point and has no star
  std::vector<std::uint8_t> sparse;    ///< 1: `near` holds the nearest in each direction, others lie between
  std::vector<std::uint8_t> rough;     ///< 1: its star is flat, see PlanarLayout
  std::vector<std::uint8_t> crossed;   ///< 1: another sheet crosses here
  std::vector<std::uint8_t> doubtful;  ///< 1: its star's triangles disagreed, see fill_holes()
  StarTable star;

  [[nodiscard]] std::size_t size() const noexcept { return point.size(); }
  [[nodiscard]] Vec3 at(std::uint32_t i) const noexcept { return point[i].at(); }
};

/// Finds the nearest points, normals and weights; welds points that coincide, exactly (`doubled`) or nearly.
/// Parallel.
void find_nearest(CandidateTriangulation& candidate, const std::vector<std::uint8_t>& duplicate);
/// Makes a star for every point and marks agreed sectors. Parallel.
void make_stars(CandidateTriangulation& candidate);
/// The same with some stars known: nearest_from_stars() takes the known rings as nearest points and sets all
/// weights; find_nearest_of() searches for those in `wanted`; make_stars_of() makes the wanted stars and
/// checks agreement for `asked`. Empty means all. Parallel.
void nearest_from_stars(CandidateTriangulation& candidate);
void find_nearest_of(CandidateTriangulation& candidate, const std::vector<std::uint8_t>& duplicate,
                     std::span<const std::uint8_t> wanted);
void make_stars_of(CandidateTriangulation& candidate, std::span<const std::uint8_t> wanted,
                   std::span<const std::uint8_t> asked);
/// Remakes stars that neighbours do not confirm, laid out in the plane of the confirmed part. Parallel.
void repair_stars(CandidateTriangulation& candidate);

/// The last of a point's nearest.
[[nodiscard]] inline std::uint32_t farthest_of(const CandidateTriangulation& candidate,
                                               std::uint32_t point) noexcept {
  if (!candidate.farthest.empty()) return candidate.farthest[point];
  const NearestPoints near = candidate.near[point];
  std::size_t last = kNearest - 1;
  while (last > 0 && near[last] == point) --last;
  return near[last];
}
/// Squared radius of the ball that holds a point's nearest.
[[nodiscard]] inline double ball_sq(const CandidateTriangulation& candidate, std::uint32_t point) noexcept {
  return (candidate.at(farthest_of(candidate, point)) - candidate.at(point)).squaredNorm();
}
/// Of the nearest points keeps the last, of which no step after repair_stars() asks for more. Parallel.
void keep_farthest(CandidateTriangulation& candidate);
/// Largest circle of a triangle, relative to that ball. For random points one circle in a million has a
/// radius of 2.4 mean spacings; the ball's is 2.3.
inline constexpr double kReachPerBall = 1.5;

/// Projection of a point's surroundings to a plane.
struct PlanarLayout {
  Vec3 normal = Vec3::Zero();
  double steepest = 1.0;  ///< leaves out neighbours that rise by more than this share of their distance
  bool apart = false;     ///< leaves out neighbours on a sheet that crosses this one
  /// Places neighbours at their orthogonal projection, not at their distance in space. Distances in space
  /// agree between two points on a surface, but not in noise.
  bool flat = false;
};
/// Makes a star of the nearest points and `more`. Sets `crossed`, if given, to 1 when a neighbour on a
/// crossing sheet was left out.
[[nodiscard]] Star star_in_plane(const CandidateTriangulation& candidate, std::uint32_t point,
                                 const PlanarLayout& layout, std::span<const std::uint32_t> more = {},
                                 std::uint8_t* crossed = nullptr);
/// The neighbours' variance across the point's plane as a share of all; 0 on a plane.
[[nodiscard]] double share_across(const CandidateTriangulation& candidate, std::uint32_t point);
/// Bits of the star's sectors that their other corners' stars have too.
[[nodiscard]] std::uint32_t agreed_sectors(const CandidateTriangulation& candidate, std::uint32_t point,
                                           const Star& star);

}  // namespace palpate::local_delaunay

// Resolves disagreeing stars triangle by triangle, so that every edge has at most two triangles and every
// point has separate fans. Internal to local_delaunay.
namespace palpate::local_delaunay {

/// Longest loop that counts as a hole: some twenty points surround one as wide as the widest allowed circle,
/// 3.4 mean spacings.
inline constexpr std::size_t kMaxLoop = 20;

struct HoleFillReport {
  std::size_t voted = 0;   ///< triangles that one or two of their three stars had
  std::size_t filled = 0;  ///< triangles put into small loops
};

/// Afterwards each sector is agreed or open. Agreed stars stay. Independent of the number of threads. O(n),
/// and O(m log m) in the m doubtful triangles.
HoleFillReport fill_holes(CandidateTriangulation& candidate);

/// For stars that fully agree: removes the triangles of `points`, fills the loops that remain, and returns
/// their number.
std::size_t refill_without(CandidateTriangulation& candidate, const std::vector<std::uint32_t>& points);

}  // namespace palpate::local_delaunay

// Orients each piece consistently. Internal to local_delaunay.
namespace palpate::local_delaunay {

/// Whether a piece encloses a volume and is felt from one side.
enum class VolumeEnclosure : std::uint8_t { kOpen, kWithHoles, kWhole };

/// Points per part in the far-field approximation: large enough to make a million points fast, small enough
/// that small pieces have the 16 parts their test needs.
inline constexpr int kPointsPerPart = 16;

struct OrientedComponents {
  UninitializedVector<std::uint32_t> of;  ///< by point; kNoPoint without triangles
  std::vector<VolumeEnclosure> closed;    ///< by piece
  double min_enclosed = 1.0;  ///< 1 - the widest geometry::opening_fraction() of pieces with holes
  /// Corners of triangles dropped because their sides could not agree.
  std::vector<std::array<std::uint32_t, 3>> unorientable;
};

/// Turns the stars so that neighbours have the same orientation, counter-clockwise from outside on pieces
/// that enclose a volume (holes allowed). Every sector must be agreed. O(n), parallel except across chunks
/// and in doubtful places; independent of the number of threads.
OrientedComponents orient_stars(CandidateTriangulation& candidate);

/// Reverses the orientation.
void reverse(Star& star) noexcept;

/// In noise, for oriented stars: triangles that face away from the surrounding planes. They would trap a
/// moving probe, and no smooth surface has them.
[[nodiscard]] std::vector<std::array<std::uint32_t, 3>> overhanging(const CandidateTriangulation& candidate);

/// Builds a mesh's storage from any source of stars.
class LocalDelaunayMeshStorage {
 public:
  /// Stores points, rings and their counts; `mesh` already has origin, order and other counts.
  /// star_of(place): its Star, ring by place, asked once. closed_of(place): its closed piece, or kNoPlace.
  /// is_crossed(place): see LocalDelaunayMesh. All are called from many threads.
  template <class StarOf, class ClosedOf, class IsCrossed>
  static void fill(LocalDelaunayMesh& mesh, const UninitializedVector<SortedPoint>& points, StarOf&& star_of,
                   ClosedOf&& closed_of, IsCrossed&& is_crossed, int threads) {
    const std::size_t n = points.size();
    struct Long {
      std::uint32_t place;
      Star star;
    };
    struct Chunk {
      MeshStatistics counts;
      std::vector<Long> apart;
    };
    MeshStatistics& counts = mesh.counts_;
    mesh.places_.resize(n);
    if (counts.closed_components > 1) mesh.closed_component_of_.assign(n, 0);
    const auto store = [&](std::size_t i, Chunk& chunk) {
      const auto place = static_cast<std::uint32_t>(i);
      const Star& star = star_of(place);
      chunk.counts.triangles += star.sectors();
      chunk.counts.unused += static_cast<std::uint64_t>(star.sectors() == 0);
      chunk.counts.open_points += static_cast<std::uint64_t>(star.sectors() > 0 && star.open != 0);
      const std::uint32_t closed = closed_of(place);
      PackedVertex& at = mesh.places_[i];
      at = {points[i].x_mm, points[i].y_mm, points[i].z_mm, 0, {}};
      if (closed != kNoPlace) at.info |= LocalDelaunayMesh::kClosed;
      if (is_crossed(place)) at.info |= LocalDelaunayMesh::kCrossed;
      if (fits_beside(star, place)) {
        at.info |= star.size | (star.open << LocalDelaunayMesh::kOpenShift);
        for (std::uint32_t k = 0; k < star.size; ++k)
          at.near[k] = static_cast<std::int16_t>(static_cast<std::int32_t>(star.ring[k] - place));
      } else {
        at.info |= LocalDelaunayMesh::kLong | LocalDelaunayMesh::kRingStoredApart;
        chunk.apart.push_back({place, star});
      }
      if (closed != kNoPlace && !mesh.closed_component_of_.empty()) mesh.closed_component_of_[i] = closed;
    };
    counts.triangles = counts.unused = counts.open_points = 0;
    for (const auto& chunk : parallel_parts<Chunk>(n, kPointsPerChunk, threads, store)) {
      counts.triangles += chunk.counts.triangles;
      counts.unused += chunk.counts.unused;
      counts.open_points += chunk.counts.open_points;
      for (const Long& one : chunk.apart) {
        mesh.places_[one.place].set_apart(static_cast<std::uint32_t>(mesh.long_rings_.size()));
        mesh.long_rings_.insert(mesh.long_rings_.end(), {one.star.size, one.star.open});
        mesh.long_rings_.insert(mesh.long_rings_.end(), one.star.ring.begin(),
                                one.star.ring.begin() + one.star.size);
      }
    }
    counts.triangles /= 3;
    mesh.long_rings_.shrink_to_fit();
  }

 private:
  [[nodiscard]] static bool fits_beside(const Star& star, std::uint32_t place) noexcept {
    if (star.size > kInlineRing) return false;
    for (std::uint32_t k = 0; k < star.size; ++k)
      if (std::max(star.ring[k], place) - std::min(star.ring[k], place) > kMaxPlaceOffset) return false;
    return true;
  }
};

}  // namespace palpate::local_delaunay
