#include "toolkit/stars/turn.h"

#include <Eigen/Geometry>  // cross products
#include <algorithm>
#include <utility>

#include "toolkit/cloud/limits.h"
#include "toolkit/core/parallel.h"
#include "toolkit/geometry/enclosure.h"
#include "toolkit/geometry/mouth.h"

namespace palpate::stars {
namespace {

/// The newest parts, in which a point's piece is looked for: more sheets are seldom in one place.
constexpr std::size_t kPartsOpen = 4;
/// Parts of a piece that all threads judge together: it takes some tenth of a millisecond.
constexpr std::size_t kLargePiece = 1024, kPiecesPerChunk = 16;

/// Sets of points with, for each, whether it runs the other way around than its set's first.
class Sides {
 public:
  Sides(std::size_t n, int threads) : up_(n) {
    parallel_chunks(n, kPointsPerChunk, threads, [this](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) up_[i] = static_cast<std::uint32_t>(i << 1);
    });
  }
  struct Root {
    std::uint32_t set;
    std::uint32_t turned;
  };
  Root find(std::uint32_t i) noexcept {
    std::uint32_t turned = 0;
    for (;;) {
      const std::uint32_t link = up_[i], parent = link >> 1;
      if (parent == i) return {i, turned};
      const std::uint32_t above = up_[parent];
      // Each point on the way is hung one higher.
      up_[i] = (above & ~1u) | ((link ^ above) & 1u);
      if (above >> 1 == parent) return {parent, turned ^ (link & 1u)};
      turned ^= up_[i] & 1u;
      i = above >> 1;
    }
  }
  /// False where they are of one set already and disagree.
  bool join(std::uint32_t a, std::uint32_t b, std::uint32_t turned) noexcept {
    const Root ra = find(a), rb = find(b);
    const std::uint32_t between = ra.turned ^ rb.turned ^ turned;
    if (ra.set == rb.set) return between == 0;
    // The lower one stays on top: the same for every order of joining.
    if (ra.set < rb.set)
      up_[rb.set] = ra.set << 1 | between;
    else
      up_[ra.set] = rb.set << 1 | between;
    return true;
  }
  /// Root and turn of each point of a chunk. Reads other chunks and writes none: chunks may be settled at the
  /// same time.
  void settle(std::size_t begin, std::size_t end) noexcept {
    for (std::size_t i = begin; i < end; ++i) {
      std::uint32_t at = static_cast<std::uint32_t>(i), turned = 0;
      for (;;) {
        const std::uint32_t link = up_[at], parent = link >> 1;
        if (parent == at) break;
        turned ^= link & 1u;
        at = parent;  // lower than i
        if (at < begin) continue;
        turned ^= root_[at] & 1u;
        at = root_[at] >> 1;
        break;
      }
      root_[i] = at << 1 | turned;
    }
  }
  void begin_settling() { root_.resize(up_.size()); }
  /// Once it is settled.
  [[nodiscard]] Root settled(std::uint32_t i) const noexcept { return {root_[i] >> 1, root_[i] & 1u}; }

 private:
  UnsetVector<std::uint32_t> up_;    ///< parent << 1 | turned against it; see cloud::kMaxCloudPoints
  UnsetVector<std::uint32_t> root_;  ///< the same of the set's first, once settled
};

/// Whether the star has the sector b -> c (0) or c -> b (1).
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

/// visit(i, b, c) for each triangle of a point that is its lowest.
template <class Visit>
void for_triangles(const Draft& draft, std::uint32_t i, Visit&& visit) {
  const Star& star = draft.star[i];
  for (std::uint32_t k = 0; k < star.size; ++k) {
    const std::uint32_t b = star.ring[k], c = star.ring[star.next(k)];
    if (star.has_sector(k) && i < b && i < c) visit(i, b, c);
  }
}

class Turner {
 public:
  explicit Turner(Draft& draft) : draft_(draft), sides_(draft.size(), draft.threads), state_(draft.size()) {}

  Pieces run() {
    join_all();
    number_pieces();
    inward_.assign(pieces_.closed.size(), 0);
    if (!draft_.both_sides) find_enclosing();
    turn_outward();
    return std::move(pieces_);
  }

 private:
  using Triple = std::array<std::uint32_t, 3>;

  /// use(chunk, point) for the points of each chunk in their order.
  template <class Use>
  void chunks(Use&& use) {
    parallel_chunks(draft_.size(), kPointsPerChunk, draft_.threads, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) use(begin / kPointsPerChunk, static_cast<std::uint32_t>(i));
    });
  }
  [[nodiscard]] std::size_t chunk_count() const noexcept {
    return (draft_.size() + kPointsPerChunk - 1) / kPointsPerChunk;
  }

  void join(const Triple& t, std::vector<Triple>& torn) {
    const auto [a, b, c] = t;
    const bool one = sides_.join(a, b, way(draft_.star[b], c, a));
    const bool two = sides_.join(a, c, way(draft_.star[c], a, b));
    if (!one || !two) torn.push_back(t);
  }
  /// A point beside another one that is looked at from both sides, one after the other.
  struct Beside {
    std::uint32_t other = kNoPoint;
    std::uint32_t at = 0;      ///< where the point stands in the other's ring
    std::uint32_t turned = 2;  ///< how they were joined; 2: not yet
    bool agrees = true;
  };
  /// As join() does it of one edge: a triangle of `i` and `other` whose third corner the other's star has
  /// before or behind `i` if it runs the same way around.
  bool join_beside(std::uint32_t i, std::uint32_t other, std::uint32_t third, bool is_before, Beside& last) {
    const Star& theirs = draft_.star[other];
    if (last.other != other) last = {other, theirs.find(i), 2, true};
    const std::uint32_t k = last.at;
    bool same = false;
    if (k < theirs.size) {
      const std::uint32_t previous = theirs.previous(k);
      same = is_before ? theirs.has_sector(previous) && theirs.ring[previous] == third
                       : theirs.has_sector(k) && theirs.ring[theirs.next(k)] == third;
    }
    const std::uint32_t turned = same ? 0 : 1;
    if (turned != last.turned) {
      last.turned = turned;
      last.agrees = sides_.join(i, other, turned);
    }
    return last.agrees;
  }
  static std::uint8_t state_of(const Star& star) noexcept {
    return static_cast<std::uint8_t>((star.has_sectors() ? kHasSectors : 0) |
                                     (star.open != 0 ? kHasBorder : 0));
  }
  /// What all three stars agreed on goes first: it is seldom wrong. Of that, what lies within a chunk, whose
  /// points are joined to one another alone: chunks do not meet.
  void join_all() {
    struct Chunk {
      std::vector<Triple> torn, across, unsure;
    };
    std::vector<Chunk> parts(chunk_count());
    chunks([&](std::size_t chunk, std::uint32_t i) {
      Chunk& part = parts[chunk];
      const std::size_t end = (chunk + 1) * kPointsPerChunk;
      state_[i] = state_of(draft_.star[i]);
      Beside last;
      for_triangles(draft_, i, [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
        const bool sure = (draft_.doubtful[a] | draft_.doubtful[b] | draft_.doubtful[c]) == 0;
        if (!sure)
          part.unsure.push_back({a, b, c});
        else if (b >= end || c >= end)
          part.across.push_back({a, b, c});
        else {
          const bool one = join_beside(a, b, c, true, last), two = join_beside(a, c, b, false, last);
          if (!one || !two) part.torn.push_back({a, b, c});
        }
      });
    });
    std::vector<Triple> torn;
    for (const Chunk& part : parts) torn.insert(torn.end(), part.torn.begin(), part.torn.end());
    for (const Chunk& part : parts)
      for (const Triple& t : part.across) join(t, torn);
    for (const Chunk& part : parts)
      for (const Triple& t : part.unsure) join(t, torn);
    for (const Triple& t : torn)
      for (std::size_t k = 0; k < 3; ++k) {
        open_sector(draft_.star[t[k]], t[(k + 1) % 3], t[(k + 2) % 3]);
        state_[t[k]] = state_of(draft_.star[t[k]]);
      }
    pieces_.torn = std::move(torn);
  }

  /// Pieces are numbered by their first points.
  void number_pieces() {
    struct Seen {
      std::uint32_t root;
      bool has_border;
    };
    const std::size_t n = draft_.size();
    UnsetVector<std::uint32_t> piece_of_root(n);  // of those that are roots
    std::vector<std::vector<Seen>> parts(chunk_count());
    sides_.begin_settling();
    parallel_chunks(n, kPointsPerChunk, draft_.threads, [&](std::size_t begin, std::size_t end) {
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
          pieces_.closed.push_back(Enclosure::kWhole);
        }
        if (one.has_border) pieces_.closed[piece] = Enclosure::kOpen;
      }
    pieces_.of.resize(n);
    chunks([&](std::size_t, std::uint32_t i) {
      const bool has_sectors = (state_[i] & kHasSectors) != 0;
      pieces_.of[i] = has_sectors ? piece_of_root[sides_.settled(i).set] : kNoPoint;
      if (has_sectors && sides_.settled(i).turned != 0) reverse(draft_.star[i]);
    });
  }

  /// What is seen from afar of the open pieces, for each piece some points at a time. Points that follow each
  /// other are near to each other.
  [[nodiscard]] std::vector<std::vector<geometry::SurfacePart>> open_parts() {
    struct Part {
      std::uint32_t piece;
      int points;
      Vec3 area, sum;
    };
    std::vector<std::vector<Part>> found(chunk_count());
    chunks([&](std::size_t chunk, std::uint32_t i) {
      const std::uint32_t piece = pieces_.of[i];
      if (piece == kNoPoint || pieces_.closed[piece] == Enclosure::kWhole) return;
      const Vec3 p = draft_.at(i);
      Vec3 area = Vec3::Zero();
      for_triangles(draft_, i, [&](std::uint32_t, std::uint32_t b, std::uint32_t c) {
        area += 0.5 * (draft_.at(b) - p).cross(draft_.at(c) - p);
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
    std::vector<std::vector<geometry::SurfacePart>> of_piece(pieces_.closed.size());
    for (const std::vector<Part>& parts : found)
      for (const Part& part : parts)
        of_piece[part.piece].push_back({(part.sum / part.points).cast<float>(), part.area.cast<float>()});
    return of_piece;
  }

  /// A scan is seldom without holes. What encloses a volume all the same is felt from outside: a probe that
  /// got through a hole, or was let go by a wall, must not be held by the backs of other walls when it comes
  /// out.
  void find_enclosing() {
    const std::vector<std::vector<geometry::SurfacePart>> parts = open_parts();
    std::vector<double> mouth(parts.size(), 0.0);
    const auto judge = [&](std::size_t piece, int threads) {
      const float side = geometry::outer_side(parts[piece], threads);
      if (side == 0.0f) return;
      pieces_.closed[piece] = Enclosure::kWithHoles;
      inward_[piece] = side < 0.0f ? 1 : 0;
      mouth[piece] = geometry::mouth_share(parts[piece]);
    };
    // Small pieces at the same time, a large one by all threads.
    parallel_chunks(parts.size(), kPiecesPerChunk, draft_.threads, [&](std::size_t begin, std::size_t end) {
      for (std::size_t piece = begin; piece < end; ++piece)
        if (parts[piece].size() < kLargePiece) judge(piece, 1);
    });
    for (std::size_t piece = 0; piece < parts.size(); ++piece)
      if (parts[piece].size() >= kLargePiece) judge(piece, draft_.threads);
    for (const double wide : mouth) pieces_.least_enclosed = std::min(pieces_.least_enclosed, 1.0 - wide);
  }

  void turn_outward() {
    struct Share {
      std::uint32_t piece;
      double volume;
    };
    std::vector<std::vector<Share>> parts(chunk_count());
    chunks([&](std::size_t chunk, std::uint32_t i) {
      const std::uint32_t piece = pieces_.of[i];
      if (piece == kNoPoint || pieces_.closed[piece] != Enclosure::kWhole) return;
      auto& shares = parts[chunk];
      if (shares.empty() || shares.back().piece != piece) shares.push_back({piece, 0.0});
      for_triangles(draft_, i, [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
        shares.back().volume += draft_.at(a).dot(draft_.at(b).cross(draft_.at(c)));
      });
    });
    std::vector<double> volume(pieces_.closed.size(), 0.0);
    for (const auto& shares : parts)
      for (const Share& share : shares) volume[share.piece] += share.volume;
    for (std::size_t piece = 0; piece < volume.size(); ++piece)
      if (volume[piece] < 0.0) inward_[piece] = 1;
    if (std::find(inward_.begin(), inward_.end(), 1) == inward_.end()) return;
    chunks([&](std::size_t, std::uint32_t i) {
      if (pieces_.of[i] != kNoPoint && inward_[pieces_.of[i]] != 0) reverse(draft_.star[i]);
    });
  }

  static constexpr std::uint8_t kHasSectors = 1, kHasBorder = 2;

  Draft& draft_;
  Sides sides_;
  UnsetVector<std::uint8_t> state_;  ///< by point
  Pieces pieces_;
  std::vector<std::uint8_t> inward_;  ///< by piece: its stars are to be turned
};

}  // namespace

void reverse(Star& star) noexcept {
  const std::uint32_t n = star.size;
  std::reverse(star.ring.begin(), star.ring.begin() + n);
  std::uint32_t open = 0;
  // Sector k, between k and k + 1, is now between n - 2 - k and n - 1 - k.
  for (std::uint32_t k = 0; k < n; ++k)
    if (!star.has_sector(k)) open |= 1u << (k + 1 == n ? n - 1 : n - 2 - k);
  star.open = open;
  star.agreed = ~open & (n == 32 ? ~0u : (1u << n) - 1u);
}

Pieces turn_stars(Draft& draft) {
  return Turner(draft).run();
}

std::vector<std::array<std::uint32_t, 3>> overhanging(const Draft& draft) {
  const std::size_t n = draft.size();
  // Planes, to the side that the triangles there face.
  std::vector<Vec3f> plane(n, Vec3f::Zero());
  const auto rough = [&](std::size_t begin, std::size_t end, auto&& use) {
    for (std::size_t i = begin; i < end; ++i)
      if (draft.rough[i] != 0) use(static_cast<std::uint32_t>(i));
  };
  parallel_chunks(n, kPointsPerChunk, draft.threads, [&](std::size_t begin, std::size_t end) {
    rough(begin, end, [&](std::uint32_t i) {
      const Star& star = draft.star[i];
      const Vec3 p = draft.at(i);
      Vec3 area = Vec3::Zero();
      for (std::uint32_t k = 0; k < star.size; ++k)
        if (star.has_sector(k))
          area += (draft.at(star.ring[k]) - p).cross(draft.at(star.ring[star.next(k)]) - p);
      plane[i] = area.dot(draft.normal[i].cast<double>()) < 0.0 ? Vec3f(-draft.normal[i]) : draft.normal[i];
    });
  });
  std::vector<std::vector<std::array<std::uint32_t, 3>>> parts((n + kPointsPerChunk - 1) / kPointsPerChunk);
  parallel_chunks(n, kPointsPerChunk, draft.threads, [&](std::size_t begin, std::size_t end) {
    rough(begin, end, [&](std::uint32_t i) {
      for_triangles(draft, i, [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
        if (draft.rough[b] == 0 || draft.rough[c] == 0) return;
        const Vec3 p = draft.at(a);
        const Vec3 area = (draft.at(b) - p).cross(draft.at(c) - p);
        if (area.dot((plane[a] + plane[b] + plane[c]).cast<double>()) < 0.0)
          parts[begin / kPointsPerChunk].push_back({a, b, c});
      });
    });
  });
  std::vector<std::array<std::uint32_t, 3>> found;
  for (const auto& part : parts) found.insert(found.end(), part.begin(), part.end());
  return found;
}

}  // namespace palpate::stars
