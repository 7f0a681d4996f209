#include "toolkit/spline_sdf/surface_chunk.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "toolkit/core/disjoint_sets.h"
#include "toolkit/spline_sdf/orient_patches.h"

namespace palpate::spline_sdf {
namespace {

/// Numbers of groups and pieces over all chunks. A piece that visibility has oriented is a group of its own:
/// a part of an open sheet may be seen from the other side than the part beside it.
class ChunkNumbers {
 public:
  explicit ChunkNumbers(const std::vector<SurfaceChunk>& chunks) {
    for (const SurfaceChunk& chunk : chunks) {
      first_piece_.push_back(static_cast<std::uint32_t>(group_.size()));
      std::uint32_t groups = 0;
      for (const std::uint32_t group : chunk.groups)
        if (group != OrientedPieces::kOutward) groups = std::max(groups, group + 1);
      const std::uint32_t first = groups_;
      groups_ += groups;
      for (const std::uint32_t group : chunk.groups) {
        const bool outward = group == OrientedPieces::kOutward;
        group_.push_back(outward ? groups_++ : first + group);
        outward_.push_back(outward);
      }
    }
  }
  [[nodiscard]] std::uint32_t piece(std::size_t chunk, std::uint32_t piece) const {
    return first_piece_[chunk] + piece;
  }
  [[nodiscard]] std::uint32_t group(std::size_t chunk, std::uint32_t of) const {
    return group_[piece(chunk, of)];
  }
  [[nodiscard]] bool is_outward(std::size_t chunk, std::uint32_t of) const {
    return outward_[piece(chunk, of)];
  }
  [[nodiscard]] std::uint32_t groups() const { return groups_; }
  [[nodiscard]] std::uint32_t pieces() const { return static_cast<std::uint32_t>(group_.size()); }

 private:
  std::vector<std::uint32_t> first_piece_, group_;  ///< by chunk; by piece
  std::vector<bool> outward_;                       ///< by piece
  std::uint32_t groups_ = 0;
};

/// The chunk that has a brick, and the brick in it; null where none has.
const ChunkBrick* find_owner(const std::vector<SurfaceChunk>& chunks, const ChunkBrick& brick,
                             std::size_t& chunk) {
  const std::uint64_t at = brick.code >> (3 * brick.level);
  const auto after =
      std::upper_bound(chunks.begin(), chunks.end(), at,
                       [](std::uint64_t code, const SurfaceChunk& c) { return code < c.first_code; });
  if (after == chunks.begin()) return nullptr;
  chunk = static_cast<std::size_t>(after - chunks.begin()) - 1;
  const auto key = [](const ChunkBrick& one) { return std::pair(one.level, one.code); };
  const std::vector<ChunkBrick>& rim = chunks[chunk].rim;
  const auto found =
      std::lower_bound(rim.begin(), rim.end(), brick,
                       [&](const ChunkBrick& a, const ChunkBrick& b) { return key(a) < key(b); });
  return found != rim.end() && key(*found) == key(brick) ? &*found : nullptr;
}

/// Visits what two parts made of one brick: the part beside it, and the one that it is in.
template <class Visit>
void each_seam(const std::vector<SurfaceChunk>& chunks, Visit&& visit) {
  for (std::size_t c = 0; c < chunks.size(); ++c)
    for (const ChunkBrick& brick : chunks[c].seam) {
      std::size_t owner = 0;
      const ChunkBrick* other = find_owner(chunks, brick, owner);
      if (other != nullptr && !other->summary.smaller) visit(c, brick.summary, owner, other->summary);
    }
}

/// Visits all own bricks, level after level by code.
template <class Visit>
Status each_own(const StoredChunks& stored, int levels, Visit&& visit) {
  std::vector<std::size_t> next(stored.chunks().size(), 0);
  std::vector<ChunkBrick> own;
  for (int level = 0; level < levels; ++level)
    for (std::size_t c = 0; c < next.size(); ++c) {
      const std::size_t count = stored.counts(c)[static_cast<std::size_t>(level)];
      PALPATE_TRY(stored.read_own(c, next[c], count, own));
      next[c] += count;
      for (const ChunkBrick& brick : own) visit(c, brick);
    }
  return Done{};
}

/// Agreement of the areas that two chunks give one brick.
double agreement_of(const BrickSummary& a, const BrickSummary& b) {
  const Vec3 x = a.part.area.cast<double>(), y = b.part.area.cast<double>();
  const double most = std::max(x.norm(), y.norm());
  return most > 0.0 ? x.dot(y) / most : 0.0;
}

struct SeamVote {
  std::uint32_t a = 0, b = 0;
  double sum = 0.0;
};

}  // namespace

void JoinedPiece::put(Brick& brick) const noexcept {
  if (flipped)
    for (std::int16_t& distance : brick.distance) distance = static_cast<std::int16_t>(-distance);
  felt.put(brick);
}

Result<JoinedChunks> join_chunks(const StoredChunks& stored, BrickGrid& grid, bool both_sides, int threads) {
  const std::vector<SurfaceChunk>& chunks = stored.chunks();
  const ChunkNumbers number(chunks);
  OrientedDisjointSets groups(number.groups()), pieces(number.pieces());
  std::map<std::pair<std::uint32_t, std::uint32_t>, double> sums;
  grid.levels = 1;
  for (std::size_t c = 0; c < chunks.size(); ++c)
    for (int level = 0; level < BrickGrid::kMaxLevels; ++level)
      if (stored.counts(c)[static_cast<std::size_t>(level)] > 0)
        grid.levels = std::max(grid.levels, level + 1);
  each_seam(chunks, [&](std::size_t c, const BrickSummary& a, std::size_t owner, const BrickSummary& b) {
    pieces.join(number.piece(c, a.piece), number.piece(owner, b.piece));
    sums[std::minmax(number.group(c, a.piece), number.group(owner, b.piece))] += agreement_of(a, b);
  });
  std::vector<SeamVote> votes;
  for (const auto& [pair, sum] : sums) votes.push_back({pair.first, pair.second, sum});
  std::stable_sort(votes.begin(), votes.end(),
                   [](const SeamVote& x, const SeamVote& y) { return std::abs(x.sum) > std::abs(y.sum); });
  for (const SeamVote& vote : votes) groups.join(vote.a, vote.b, vote.sum < 0.0 ? 1 : 0);
  // By root: the area, and how much of it visibility has oriented one way or the other.
  std::vector<Vec3> areas(number.groups(), Vec3::Zero());
  std::vector<double> outward(number.groups(), 0.0);
  constexpr std::uint32_t kUnmet = 0xffffffffu;
  std::vector<std::uint32_t> dense(number.pieces(), kUnmet);
  std::uint32_t count = 0;
  const auto note = [&](std::size_t c, const ChunkBrick& brick) {
    std::uint32_t& met = dense[pieces.find(number.piece(c, brick.summary.piece)).set];
    if (met == kUnmet) met = count++;
    const auto in = groups.find(number.group(c, brick.summary.piece));
    if (brick.summary.smaller) return;
    const double way = in.flipped != 0 ? -1.0 : 1.0;
    const Vec3 area = brick.summary.part.area.cast<double>();
    areas[in.set] += way * area;
    if (number.is_outward(c, brick.summary.piece)) outward[in.set] += way * area.norm();
  };
  PALPATE_TRY(each_own(stored, grid.levels, note));
  const auto is_flipped = [&](std::size_t c, std::uint32_t piece, bool closed) {
    const auto in = groups.find(number.group(c, piece));
    const double seen = closed ? outward[in.set] : 0.0;
    return (in.flipped != 0) != (seen != 0.0 ? seen < 0.0 : looks_down(areas[in.set]));
  };
  Status read = Done{};
  const std::vector<PieceClass> classes = find_closed_components(
      grid, count,
      [&](const VisitSummary& visit) {
        read = each_own(stored, grid.levels, [&](std::size_t c, const ChunkBrick& brick) {
          BrickSummary one = brick.summary;
          if (is_flipped(c, one.piece, true)) one.part.area = -one.part.area;
          one.piece = dense[pieces.find(number.piece(c, one.piece)).set];
          visit(one, brick.level);
        });
      },
      both_sides, threads);
  PALPATE_TRY(std::move(read));
  JoinedChunks out;
  for (std::size_t c = 0; c < chunks.size(); ++c) {
    std::vector<JoinedPiece>& of = out.pieces.emplace_back(chunks[c].groups.size());
    for (std::uint32_t p = 0; p < of.size(); ++p) {
      const std::uint32_t met = dense[pieces.find(number.piece(c, p)).set];
      if (met != kUnmet) of[p].felt = classes[met];
      of[p].flipped = is_flipped(c, p, of[p].felt.number != 0);
    }
  }
  double all = 0.0, against = 0.0;
  each_seam(chunks, [&](std::size_t c, const BrickSummary& a, std::size_t owner, const BrickSummary& b) {
    const JoinedPiece &one = out.pieces[c][a.piece], &other = out.pieces[owner][b.piece];
    const double agreement = agreement_of(a, b);
    all += std::abs(agreement);
    if ((one.flipped != other.flipped) != (agreement < 0.0)) against += std::abs(agreement);
  });
  out.contradicted = all > 0.0 ? against / all : 0.0;
  return out;
}

}  // namespace palpate::spline_sdf
