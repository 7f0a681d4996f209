#include "toolkit/local_delaunay/candidate_triangulation.h"

#include <Eigen/Geometry>  // cross products
#include <algorithm>
#include <utility>

#include "toolkit/cloud/statistics.h"
#include "toolkit/core/disjoint_sets.h"
#include "toolkit/core/parallel.h"
#include "toolkit/geometry/winding_number.h"

namespace palpate::local_delaunay {
namespace {

/// Open parts searched for a point's piece; more sheets rarely share a place.
constexpr std::size_t kPartsOpen = 4;
/// Size from which all threads judge one piece together, about a tenth of a millisecond of work.
constexpr std::size_t kLargePiece = 1024, kPiecesPerChunk = 16;

/// Points with their orientation relative to the first of their set.
class Sides : public OrientedDisjointSets {
 public:
  using OrientedDisjointSets::OrientedDisjointSets;
  /// Computes root and turn of a chunk's points. Reads other chunks and writes none, so chunks can run in
  /// parallel.
  void settle(std::size_t begin, std::size_t end) noexcept {
    for (std::size_t i = begin; i < end; ++i) {
      std::uint32_t at = static_cast<std::uint32_t>(i), flipped = 0;
      for (;;) {
        const std::uint32_t link = link_[at], parent = link >> 1;
        if (parent == at) break;
        flipped ^= link & 1u;
        at = parent;  // lower than i
        if (at < begin) continue;
        flipped ^= root_[at] & 1u;
        at = root_[at] >> 1;
        break;
      }
      root_[i] = at << 1 | flipped;
    }
  }
  void begin_settling() { root_.resize(link_.size()); }
  /// Valid after settle().
  [[nodiscard]] Root settled(std::uint32_t i) const noexcept { return {root_[i] >> 1, root_[i] & 1u}; }

 private:
  UninitializedVector<std::uint32_t> root_;  ///< the same relative to the set's first, after settle()
};

/// 0 if the star has the sector b -> c, 1 for c -> b.
std::uint32_t way(const Star& star, std::uint32_t b, std::uint32_t c) noexcept {
  const std::uint32_t k = star.find(b);
  return k < star.size && star.has_sector(k) && star.ring[star.next(k)] == c ? 0 : 1;
}

void open_sector(Star& star, std::uint32_t b, std::uint32_t c) noexcept {
  for (std::uint32_t k = 0; k < star.size; ++k) {
    const std::uint32_t x = star.ring[k], y = star.ring[star.next(k)];
    if (!star.has_sector(k) || !((x == b && y == c) || (x == c && y == b))) continue;
    star.open |= 1u << k;
    star.agreed &= ~(1u << k);
    return;
  }
}

/// Calls visit(i, b, c) for each triangle whose lowest point is i.
template <class Visit>
void for_triangles(const CandidateTriangulation& candidate, std::uint32_t i, Visit&& visit) {
  const Star& star = candidate.star[i];
  for (std::uint32_t k = 0; k < star.size; ++k) {
    const std::uint32_t b = star.ring[k], c = star.ring[star.next(k)];
    if (star.has_sector(k) && i < b && i < c) visit(i, b, c);
  }
}

class StarOrienter {
 public:
  explicit StarOrienter(CandidateTriangulation& candidate)
      : candidate_(candidate), sides_(candidate.size(), candidate.threads), state_(candidate.size()) {}

  OrientedComponents run() {
    join_all();
    number_components();
    inward_.assign(pieces_.closed.size(), 0);
    if (!candidate_.both_sides) find_enclosing();
    orient_outward();
    return std::move(pieces_);
  }

 private:
  using Triple = std::array<std::uint32_t, 3>;

  /// Calls use(chunk, point) for each chunk's points in order.
  template <class Use>
  void chunks(Use&& use) {
    parallel_chunks(candidate_.size(), kPointsPerChunk, candidate_.threads,
                    [&](std::size_t begin, std::size_t end) {
                      for (std::size_t i = begin; i < end; ++i)
                        use(begin / kPointsPerChunk, static_cast<std::uint32_t>(i));
                    });
  }
  [[nodiscard]] std::size_t chunk_count() const noexcept {
    return (candidate_.size() + kPointsPerChunk - 1) / kPointsPerChunk;
  }

  void join(const Triple& t, std::vector<Triple>& unorientable) {
    const auto [a, b, c] = t;
    const bool one = agree(a, b, way(candidate_.star[b], c, a));
    const bool two = agree(a, c, way(candidate_.star[c], a, b));
    if (!one || !two) unorientable.push_back(t);
  }
  /// False if both are in one set already and disagree.
  bool agree(std::uint32_t a, std::uint32_t b, std::uint32_t flipped) noexcept {
    return sides_.join(a, b, flipped) != Sides::Joined::kBeforeOtherwise;
  }
  /// A neighbouring point, examined from both sides in turn.
  struct Beside {
    std::uint32_t other = kNoPoint;
    std::uint32_t at = 0;       ///< index of the point in the other's ring
    std::uint32_t flipped = 2;  ///< how they were joined; 2: not yet
    bool agrees = true;
  };
  /// Joins over one edge like join(): uses a triangle of `i` and `other`, whose third corner comes before or
  /// after `i` in the other's star depending on orientation.
  bool join_beside(std::uint32_t i, std::uint32_t other, std::uint32_t third, bool is_before, Beside& last) {
    const Star& theirs = candidate_.star[other];
    if (last.other != other) last = {other, theirs.find(i), 2, true};
    const std::uint32_t k = last.at;
    bool same = false;
    if (k < theirs.size) {
      const std::uint32_t previous = theirs.previous(k);
      same = is_before ? theirs.has_sector(previous) && theirs.ring[previous] == third
                       : theirs.has_sector(k) && theirs.ring[theirs.next(k)] == third;
    }
    const std::uint32_t flipped = same ? 0 : 1;
    if (flipped != last.flipped) {
      last.flipped = flipped;
      last.agrees = agree(i, other, flipped);
    }
    return last.agrees;
  }
  void turn(std::uint32_t i) {
    Star star = candidate_.star[i];
    reverse(star);
    candidate_.star.put(i, star);
  }
  static std::uint8_t state_of(const Star& star) noexcept {
    return static_cast<std::uint8_t>((star.has_sectors() ? kHasSectors : 0) |
                                     (star.open != 0 ? kHasBorder : 0));
  }
  /// Joins fully agreed triangles first, which are seldom wrong; of these, first those within a chunk, in
  /// parallel.
  void join_all() {
    struct Chunk {
      std::vector<Triple> unorientable, across, unsure;
    };
    std::vector<Chunk> parts(chunk_count());
    chunks([&](std::size_t chunk, std::uint32_t i) {
      Chunk& part = parts[chunk];
      const std::size_t end = (chunk + 1) * kPointsPerChunk;
      state_[i] = state_of(candidate_.star[i]);
      Beside last;
      for_triangles(candidate_, i, [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
        const bool sure = (candidate_.doubtful[a] | candidate_.doubtful[b] | candidate_.doubtful[c]) == 0;
        if (!sure)
          part.unsure.push_back({a, b, c});
        else if (b >= end || c >= end)
          part.across.push_back({a, b, c});
        else {
          const bool one = join_beside(a, b, c, true, last), two = join_beside(a, c, b, false, last);
          if (!one || !two) part.unorientable.push_back({a, b, c});
        }
      });
    });
    std::vector<Triple> unorientable;
    for (const Chunk& part : parts)
      unorientable.insert(unorientable.end(), part.unorientable.begin(), part.unorientable.end());
    for (const Chunk& part : parts)
      for (const Triple& t : part.across) join(t, unorientable);
    for (const Chunk& part : parts)
      for (const Triple& t : part.unsure) join(t, unorientable);
    for (const Triple& t : unorientable)
      for (std::size_t k = 0; k < 3; ++k) {
        Star star = candidate_.star[t[k]];
        open_sector(star, t[(k + 1) % 3], t[(k + 2) % 3]);
        candidate_.star.put(t[k], star);
        state_[t[k]] = state_of(star);
      }
    pieces_.unorientable = std::move(unorientable);
  }

  /// Numbers the pieces by their first points.
  void number_components() {
    struct Seen {
      std::uint32_t root;
      bool has_border;
    };
    const std::size_t n = candidate_.size();
    UninitializedVector<std::uint32_t> piece_of_root(n);  // valid at roots
    std::vector<std::vector<Seen>> parts(chunk_count());
    sides_.begin_settling();
    parallel_chunks(n, kPointsPerChunk, candidate_.threads, [&](std::size_t begin, std::size_t end) {
      sides_.settle(begin, end);
      std::vector<Seen>& seen = parts[begin / kPointsPerChunk];
      for (std::size_t k = begin; k < end; ++k) {
        const std::uint32_t root = sides_.settled(static_cast<std::uint32_t>(k)).set;
        if (root == k) piece_of_root[k] = kNoPoint;
        if ((state_[k] & kHasSectors) == 0) continue;
        if (seen.empty() || seen.back().root != root) seen.push_back({root, false});
        seen.back().has_border = seen.back().has_border || (state_[k] & kHasBorder) != 0;
      }
    });
    for (const std::vector<Seen>& part : parts)
      for (const Seen& one : part) {
        std::uint32_t& piece = piece_of_root[one.root];
        if (piece == kNoPoint) {
          piece = static_cast<std::uint32_t>(pieces_.closed.size());
          pieces_.closed.push_back(VolumeEnclosure::kWhole);
        }
        if (one.has_border) pieces_.closed[piece] = VolumeEnclosure::kOpen;
      }
    pieces_.of.resize(n);
    chunks([&](std::size_t, std::uint32_t i) {
      const bool has_sectors = (state_[i] & kHasSectors) != 0;
      pieces_.of[i] = has_sectors ? piece_of_root[sides_.settled(i).set] : kNoPoint;
      if (has_sectors && sides_.settled(i).flipped != 0) turn(i);
    });
  }

  /// The far-field parts of the open pieces. Consecutive points are near each other.
  [[nodiscard]] std::vector<std::vector<geometry::AreaElement>> open_parts() {
    struct Part {
      std::uint32_t piece;
      int points;
      Vec3 area, sum;
    };
    std::vector<std::vector<Part>> found(chunk_count());
    chunks([&](std::size_t chunk, std::uint32_t i) {
      const std::uint32_t piece = pieces_.of[i];
      if (piece == kNoPoint || pieces_.closed[piece] == VolumeEnclosure::kWhole) return;
      const Vec3 p = candidate_.at(i);
      Vec3 area = Vec3::Zero();
      for_triangles(candidate_, i, [&](std::uint32_t, std::uint32_t b, std::uint32_t c) {
        area += 0.5 * (candidate_.at(b) - p).cross(candidate_.at(c) - p);
      });
      std::vector<Part>& parts = found[chunk];
      const std::size_t looked = std::min(parts.size(), kPartsOpen);
      const auto part =
          std::find_if(parts.end() - static_cast<std::ptrdiff_t>(looked), parts.end(),
                       [&](const Part& one) { return one.piece == piece && one.points < kPointsPerPart; });
      if (part == parts.end())
        parts.push_back({piece, 1, area, p});
      else
        *part = {piece, part->points + 1, part->area + area, part->sum + p};
    });
    std::vector<std::vector<geometry::AreaElement>> of_piece(pieces_.closed.size());
    for (const std::vector<Part>& parts : found)
      for (const Part& part : parts)
        of_piece[part.piece].push_back({(part.sum / part.points).cast<float>(), part.area.cast<float>()});
    return of_piece;
  }

  /// Finds open pieces that enclose a volume (scans usually have holes). They are felt from outside: a probe
  /// that passed a hole or was released by a wall must not be held by other walls' backs.
  void find_enclosing() {
    const std::vector<std::vector<geometry::AreaElement>> parts = open_parts();
    std::vector<double> mouth(parts.size(), 0.0);
    const auto judge = [&](std::size_t piece, int threads) {
      const float side = geometry::normal_orientation(parts[piece], threads);
      if (side == 0.0f) return;
      pieces_.closed[piece] = VolumeEnclosure::kWithHoles;
      inward_[piece] = side < 0.0f ? 1 : 0;
      mouth[piece] = geometry::opening_fraction(parts[piece]);
    };
    // Small pieces in parallel; a large one by all threads.
    parallel_each(parts.size(), kPiecesPerChunk, candidate_.threads, [&](std::size_t piece) {
      if (parts[piece].size() < kLargePiece) judge(piece, 1);
    });
    for (std::size_t piece = 0; piece < parts.size(); ++piece)
      if (parts[piece].size() >= kLargePiece) judge(piece, candidate_.threads);
    for (const double wide : mouth) pieces_.min_enclosed = std::min(pieces_.min_enclosed, 1.0 - wide);
  }

  void orient_outward() {
    struct Share {
      std::uint32_t piece;
      double volume;
    };
    std::vector<std::vector<Share>> parts(chunk_count());
    chunks([&](std::size_t chunk, std::uint32_t i) {
      const std::uint32_t piece = pieces_.of[i];
      if (piece == kNoPoint || pieces_.closed[piece] != VolumeEnclosure::kWhole) return;
      auto& shares = parts[chunk];
      if (shares.empty() || shares.back().piece != piece) shares.push_back({piece, 0.0});
      for_triangles(candidate_, i, [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
        shares.back().volume += candidate_.at(a).dot(candidate_.at(b).cross(candidate_.at(c)));
      });
    });
    std::vector<double> volume(pieces_.closed.size(), 0.0);
    for (const auto& shares : parts)
      for (const Share& share : shares) volume[share.piece] += share.volume;
    for (std::size_t piece = 0; piece < volume.size(); ++piece)
      if (volume[piece] < 0.0) inward_[piece] = 1;
    if (std::find(inward_.begin(), inward_.end(), 1) == inward_.end()) return;
    chunks([&](std::size_t, std::uint32_t i) {
      if (pieces_.of[i] != kNoPoint && inward_[pieces_.of[i]] != 0) turn(i);
    });
  }

  static constexpr std::uint8_t kHasSectors = 1, kHasBorder = 2;

  CandidateTriangulation& candidate_;
  Sides sides_;
  UninitializedVector<std::uint8_t> state_;  ///< by point
  OrientedComponents pieces_;
  std::vector<std::uint8_t> inward_;  ///< by piece: its stars must be turned
};

}  // namespace

void reverse(Star& star) noexcept {
  const std::uint32_t n = star.size;
  std::reverse(star.ring.begin(), star.ring.begin() + n);
  std::uint32_t open = 0;
  // Sector k, between k and k + 1, becomes the one between n - 2 - k and n - 1 - k.
  for (std::uint32_t k = 0; k < n; ++k)
    if (!star.has_sector(k)) open |= 1u << (k + 1 == n ? n - 1 : n - 2 - k);
  star.open = open;
  star.agreed = ~open & (n == 32 ? ~0u : (1u << n) - 1u);
}

OrientedComponents orient_stars(CandidateTriangulation& candidate) {
  return StarOrienter(candidate).run();
}

std::vector<std::array<std::uint32_t, 3>> overhanging(const CandidateTriangulation& candidate) {
  const std::size_t n = candidate.size();
  // Planes, oriented like the triangles there.
  std::vector<Vec3f> plane(n, Vec3f::Zero());
  parallel_each<std::uint32_t>(n, kPointsPerChunk, candidate.threads, [&](std::uint32_t i) {
    if (candidate.rough[i] == 0) return;
    const Star& star = candidate.star[i];
    const Vec3 p = candidate.at(i);
    Vec3 area = Vec3::Zero();
    for (std::uint32_t k = 0; k < star.size; ++k)
      if (star.has_sector(k))
        area += (candidate.at(star.ring[k]) - p).cross(candidate.at(star.ring[star.next(k)]) - p);
    plane[i] = area.dot(candidate.normal[i].cast<double>()) < 0.0 ? Vec3f(-candidate.normal[i])
                                                                  : candidate.normal[i];
  });
  using Triangle = std::array<std::uint32_t, 3>;
  return parallel_list<Triangle>(
      n, kPointsPerChunk, candidate.threads, [&](std::size_t i, std::vector<Triangle>& found) {
        if (candidate.rough[i] == 0) return;
        for_triangles(candidate, static_cast<std::uint32_t>(i),
                      [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
                        if (candidate.rough[b] == 0 || candidate.rough[c] == 0) return;
                        const Vec3 p = candidate.at(a);
                        const Vec3 area = (candidate.at(b) - p).cross(candidate.at(c) - p);
                        if (area.dot((plane[a] + plane[b] + plane[c]).cast<double>()) < 0.0)
                          found.push_back({a, b, c});
                      });
      });
}

}  // namespace palpate::local_delaunay
