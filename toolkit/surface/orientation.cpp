#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "toolkit/cloud/limits.h"
#include "toolkit/core/parallel.h"
#include "toolkit/surface/planes.h"

namespace palpate::surface {
namespace {

/// Points a chunk of the first round: its borders decide the order of joining, so it is fixed.
constexpr std::size_t kFirstRoundPoints = std::size_t{1} << 16;
/// Confidence is 1 on a flat surface, 0 where the link or the reflected normal stands square to what it
/// should be along; five classes.
constexpr int kClasses = 5;
/// A closed surface's areas cancel as vectors (divergence theorem). Areas are estimated from spacings, good
/// to some 10 % on scans; an open cap smaller than this share of all is taken for a hole.
constexpr double kClosedShare = 0.1;

using neighbourhood::Neighbours;

/// Disjoint sets whose members know whether their side agrees with their parent's: parent * 2 + (1 = turned),
/// which cloud::kMaxCloudPoints leaves room for. What is counted or summed is in 64 bits.
class Pieces {
 public:
  explicit Pieces(std::size_t n) : link_(n) {
    for (std::size_t i = 0; i < n; ++i) link_[i] = static_cast<std::uint32_t>(i) << 1;
  }
  /// Root * 2 + (1 = turned against the root). Shortens the way.
  std::uint32_t find(std::uint32_t i) noexcept {
    std::uint32_t at = i << 1;
    while (true) {
      const std::uint32_t up = link_[at >> 1];
      if ((up >> 1) == (at >> 1)) return at;
      const std::uint32_t above = link_[up >> 1] ^ (up & 1u);
      link_[at >> 1] = above;
      at = above ^ (at & 1u);
    }
  }
  /// The same without writing.
  [[nodiscard]] std::uint32_t look(std::uint32_t i) const noexcept {
    std::uint32_t at = i << 1;
    while ((link_[at >> 1] >> 1) != (at >> 1)) at = link_[at >> 1] ^ (at & 1u);
    return at;
  }
  /// Joins two roots; the lower index stays root, so that the result does not depend on who came first.
  void join(std::uint32_t a, std::uint32_t b, std::uint32_t turned) noexcept {
    const std::uint32_t flip = (a & 1u) ^ (b & 1u) ^ turned;
    const std::uint32_t low = std::min(a >> 1, b >> 1), high = std::max(a >> 1, b >> 1);
    link_[high] = low << 1 | flip;
  }

 private:
  std::vector<std::uint32_t> link_;
};

struct Link {
  std::uint32_t from, to;
};

/// How much a link can be trusted, 0 to 1, and whether the two normals point to different sides.
struct Judgement {
  float confidence;
  std::uint32_t turned;
};

Judgement judge(const Vec3f& p, const Vec3f& q, const Vec3f& np, const Vec3f& nq) noexcept {
  const Vec3f d = q - p;
  const float size = d.squaredNorm();
  const float along_p = d.dot(np), along_q = d.dot(nq);
  // Points at one place have no direction between them: their normals are compared as they are.
  const float reflected = size > 0.0f ? np.dot(nq) - 2.0f * along_p * along_q / size : np.dot(nq);
  const float steep = size > 0.0f ? std::sqrt(std::max(along_p * along_p, along_q * along_q) / size) : 0.0f;
  return {std::abs(reflected) * (1.0f - std::min(steep, 1.0f)), reflected < 0.0f ? 1u : 0u};
}
int class_of(float confidence) noexcept {
  // NaN (far overflow) goes to the last class as well.
  const float place = (1.0f - confidence) * static_cast<float>(kClasses);
  return place >= 0.0f && place < static_cast<float>(kClasses) ? static_cast<int>(place) : kClasses - 1;
}

/// What tells a closed piece: sums over its points, each with the area it stands for.
struct Sums {
  double area = 0.0, volume = 0.0;
  Vec3 vector_area = Vec3::Zero(), moment = Vec3::Zero();
  void add(const Sums& o) noexcept {
    area += o.area;
    volume += o.volume;
    vector_area += o.vector_area;
    moment += o.moment;
  }
  [[nodiscard]] bool closed() const noexcept { return vector_area.norm() <= kClosedShare * area; }
  /// Three times the enclosed volume, from the piece's own middle.
  [[nodiscard]] double inside() const noexcept { return volume - moment.dot(vector_area) / area; }
};

/// Squared distance to the last neighbour: of it the area a point stands for is a half on a square lattice,
/// some pi / 9 where points lie at random.
double reach_sq(std::span<const SurfacePoint> points, const Neighbours& around, std::size_t i) noexcept {
  std::size_t last = neighbourhood::kNeighbours;
  while (last > 1 && around[last - 1] == i) --last;
  return (points[around[last - 1]].at() - points[i].at()).squaredNorm();
}
constexpr double kAreaShare = 0.42;  // between the two

Sums point_sums(const Vec3& p, double area, const Vec3& normal) noexcept {
  Sums s;
  s.area = area;
  s.vector_area = s.area * normal;
  s.volume = s.vector_area.dot(p);
  s.moment = s.area * p;
  return s;
}

struct PieceSums {
  std::uint32_t root;
  Sums sums;
};
Sums& sums_of(std::vector<PieceSums>& pieces, std::uint32_t root) {
  if (pieces.empty() || pieces.back().root != root) pieces.push_back({root, {}});
  return pieces.back().sums;
}

}  // namespace

namespace {

std::vector<Vec3f> decode_all(std::span<const SurfacePoint> points, int threads) {
  std::vector<Vec3f> normals(points.size());
  parallel_chunks(points.size(), kFirstRoundPoints, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i)
      normals[i] = points[i].normal == kNoNormal ? Vec3f(Vec3f::Zero())
                                                 : Vec3f(decode_normal(points[i].normal).cast<float>());
  });
  return normals;
}

/// Joins linked points, the most trusted links first. Links within a chunk that are trusted most are joined
/// by the chunks in parallel, each over its own points; the rest one by one.
Pieces join_pieces(std::span<const SurfacePoint> points, std::span<const Neighbours> neighbours,
                   int threads) {
  const std::size_t n = points.size();
  const std::vector<Vec3f> normals = decode_all(points, threads);
  const auto place = [&](std::uint32_t i) { return Vec3f(points[i].x_mm, points[i].y_mm, points[i].z_mm); };
  Pieces pieces(n);
  std::vector<std::array<std::vector<Link>, kClasses>> later((n + kFirstRoundPoints - 1) / kFirstRoundPoints);
  parallel_chunks(n, kFirstRoundPoints, threads, [&](std::size_t begin, std::size_t end) {
    auto& mine = later[begin / kFirstRoundPoints];
    for (std::size_t at = begin; at < end; ++at) {
      const auto i = static_cast<std::uint32_t>(at);
      if (points[i].normal == kNoNormal) continue;
      for (const std::uint32_t j : neighbours[i]) {
        if (j == i || points[j].normal == kNoNormal) continue;
        const bool here = j >= begin && j < end;
        std::uint32_t a = 0, b = 0;
        if (here) {
          a = pieces.find(i);
          b = pieces.find(j);
          if ((a >> 1) == (b >> 1)) continue;
        }
        const Judgement judged = judge(place(i), place(j), normals[i], normals[j]);
        const int which = class_of(judged.confidence);
        if (here && which == 0)
          pieces.join(a, b, judged.turned);
        else
          mine[static_cast<std::size_t>(which)].push_back({i, j});
      }
    }
  });
  for (std::size_t which = 0; which < kClasses; ++which)
    for (const auto& chunk : later)
      for (const Link& link : chunk[which]) {
        const std::uint32_t a = pieces.find(link.from), b = pieces.find(link.to);
        if ((a >> 1) == (b >> 1)) continue;
        pieces.join(a, b,
                    judge(place(link.from), place(link.to), normals[link.from], normals[link.to]).turned);
      }
  return pieces;
}

}  // namespace

OrientReport orient_planes(std::span<SurfacePoint> points, std::span<const Neighbours> neighbours,
                           int threads) {
  const std::size_t n = points.size();
  const Pieces pieces = join_pieces(points, neighbours, threads);

  // Turn, and sum up by piece: runs of one piece within a chunk, then all runs in order.
  std::vector<std::vector<PieceSums>> runs((n + kFirstRoundPoints - 1) / kFirstRoundPoints);
  parallel_chunks(n, kFirstRoundPoints, threads, [&](std::size_t begin, std::size_t end) {
    auto& mine = runs[begin / kFirstRoundPoints];
    for (std::size_t i = begin; i < end; ++i) {
      if (points[i].normal == kNoNormal) continue;
      const std::uint32_t at = pieces.look(static_cast<std::uint32_t>(i));
      if ((at & 1u) != 0) points[i].normal = opposite(points[i].normal);
      sums_of(mine, at >> 1)
          .add(point_sums(points[i].at(), reach_sq(points, neighbours[i], i),
                          decode_normal(points[i].normal)));
    }
  });
  std::vector<PieceSums> all;
  for (const auto& chunk : runs) all.insert(all.end(), chunk.begin(), chunk.end());
  std::stable_sort(all.begin(), all.end(),
                   [](const PieceSums& a, const PieceSums& b) { return a.root < b.root; });
  std::vector<PieceSums> whole;
  for (const PieceSums& run : all) sums_of(whole, run.root).add(run.sums);

  // Closed pieces: outward.
  OrientReport report;
  report.pieces = whole.size();
  constexpr std::uint8_t kClosed = 1, kInward = 2;
  std::vector<std::uint8_t> kind(n, 0);  // by root
  std::vector<std::uint32_t> closed_roots;
  for (const PieceSums& piece : whole) {
    if (!(piece.sums.area > 0.0) || !piece.sums.closed()) continue;
    closed_roots.push_back(piece.root);
    kind[piece.root] = static_cast<std::uint8_t>(kClosed | (piece.sums.inside() < 0.0 ? kInward : 0));
  }
  if (closed_roots.empty()) return report;
  report.closed_pieces = closed_roots.size();
  if (report.closed_pieces > 1) report.closed_piece_of.resize(n);
  std::vector<std::size_t> one_sided(runs.size(), 0);
  parallel_chunks(n, kFirstRoundPoints, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      if (points[i].normal == kNoNormal) continue;
      const std::uint32_t root = pieces.look(static_cast<std::uint32_t>(i)) >> 1;
      const std::uint8_t how = kind[root];
      if ((how & kClosed) == 0) continue;
      if (!report.closed_piece_of.empty())
        report.closed_piece_of[i] = static_cast<std::uint32_t>(
            std::lower_bound(closed_roots.begin(), closed_roots.end(), root) - closed_roots.begin());
      if ((how & kInward) != 0) points[i].normal = opposite(points[i].normal);
      points[i].normal |= kOneSided;
      ++one_sided[begin / kFirstRoundPoints];
    }
  });
  for (const std::size_t count : one_sided) report.one_sided_points += count;
  return report;
}

void find_sides(std::span<const SurfacePoint> points, std::span<const Neighbours> neighbours,
                std::span<const std::uint32_t> closed_piece_of, const Vec3& local_mm,
                std::span<double> sides) noexcept {
  std::fill(sides.begin(), sides.end(), 0.0);  // solid angles first
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (!is_one_sided(points[i].normal)) continue;
    const Vec3 d = points[i].at() - local_mm;
    const double square = d.squaredNorm();
    if (!(square > 0.0)) continue;
    const double share = kAreaShare * reach_sq(points, neighbours[i], i) / square;
    sides[closed_piece_of.empty() ? 0 : closed_piece_of[i]] +=
        share * decode_normal(points[i].normal).dot(d) / std::sqrt(square);
  }
  // All around is 4 pi, outside 0.
  for (double& side : sides) side = side > 2.0 * std::numbers::pi ? -1.0 : 1.0;
}

}  // namespace palpate::surface
