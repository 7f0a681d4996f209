#include "toolkit/surface/oriented_points.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "toolkit/cloud/statistics.h"
#include "toolkit/core/disjoint_sets.h"
#include "toolkit/core/parallel.h"
#include "toolkit/surface/smallest_eigenvector.h"

namespace palpate::surface {

NormalCode encode_normal(const Vec3& unit) noexcept {
  const double sum = std::abs(unit.x()) + std::abs(unit.y()) + std::abs(unit.z());
  double x = unit.x() / sum, y = unit.y() / sum;
  if (unit.z() < 0.0) {
    const double folded_x = std::copysign(1.0 - std::abs(y), x);
    y = std::copysign(1.0 - std::abs(x), y);
    x = folded_x;
  }
  const auto quantised = [](double v, double steps) {
    return static_cast<std::uint32_t>(std::clamp(std::floor((v + 1.0) * (0.5 * steps) + 0.5), 0.0, steps));
  };
  return quantised(x, kNormalStepsX) | quantised(y, kNormalStepsY) << 16;
}

NormalCode opposite(NormalCode code) noexcept {
  if (code == kNoNormal) return code;
  return encode_normal(-decode_normal(code)) | (code & kOneSided);
}

namespace {

/// False if the point and its neighbours determine no plane.
bool plane_normal(std::span<const OrientedPoint> points, const search::Neighbours& around, std::size_t i,
                  Vec3& normal) noexcept {
  const Vec3 point = points[i].at();
  // Sums relative to the point, which is fitted too.
  double count = 1.0;
  Vec3 sum = Vec3::Zero();
  SymmetricMatrix3 squares;
  for (const std::uint32_t other : around) {
    if (other == i) continue;
    const Vec3 d = points[other].at() - point;
    sum += d;
    squares.add(d);
    count += 1.0;
  }
  return smallest_eigenvector(squares.without(sum, 1.0 / count), normal);
}

}  // namespace

std::vector<OrientedPoint> surface_points(const cloud::Cloud& cloud) {
  std::vector<OrientedPoint> points(cloud.size());
  for (std::size_t i = 0; i < points.size(); ++i)
    points[i] = {cloud.x_mm[i], cloud.y_mm[i], cloud.z_mm[i], kNoNormal};
  return points;
}

std::vector<Vec3> normals_of(std::span<const OrientedPoint> points) {
  std::vector<Vec3> normals(points.size(), Vec3::Zero());
  for (std::size_t i = 0; i < points.size(); ++i)
    if (points[i].normal != kNoNormal) normals[i] = decode_normal(points[i].normal);
  return normals;
}

void fit_planes(std::span<OrientedPoint> points, std::span<const search::Neighbours> neighbours,
                int threads) {
  parallel_each(points.size(), kPointsPerChunk, threads, [&](std::size_t i) {
    Vec3 normal;
    points[i].normal = plane_normal(points, neighbours[i], i, normal) ? encode_normal(normal) : kNoNormal;
  });
}

namespace {

/// Points per chunk of the first round. Chunk borders determine the joining order, so the size is fixed.
constexpr std::size_t kFirstRoundPoints = std::size_t{1} << 16;
/// Confidence is 1 on a flat surface and 0 where the link or the reflected normal is perpendicular to its
/// expected direction. Five classes.
constexpr int kClasses = 5;
/// The area vectors of a closed surface cancel (divergence theorem). Areas estimated from spacings are good
/// to about 10 % on scans; a smaller open cap counts as a hole.
constexpr double kClosedShare = 0.1;

using search::Neighbours;

struct Link {
  std::uint32_t from, to;
};

/// Confidence of a link, 0 to 1, and whether its two normals have opposite sides.
struct Judgement {
  float confidence;
  std::uint32_t flipped;
};

Judgement judge(const Vec3f& p, const Vec3f& q, const Vec3f& np, const Vec3f& nq) noexcept {
  const Vec3f d = q - p;
  const float size = d.squaredNorm();
  const float along_p = d.dot(np), along_q = d.dot(nq);
  // Coincident points have no direction between them; their normals are compared directly.
  const float reflected = size > 0.0f ? np.dot(nq) - 2.0f * along_p * along_q / size : np.dot(nq);
  const float steep = size > 0.0f ? std::sqrt(std::max(along_p * along_p, along_q * along_q) / size) : 0.0f;
  return {std::abs(reflected) * (1.0f - std::min(steep, 1.0f)), reflected < 0.0f ? 1u : 0u};
}
int class_of(float confidence) noexcept {
  // NaN (overflow far away) goes to the last class too.
  const float place = (1.0f - confidence) * static_cast<float>(kClasses);
  return place >= 0.0f && place < static_cast<float>(kClasses) ? static_cast<int>(place) : kClasses - 1;
}

/// Sums over a piece's points, weighted by area, that tell whether it is closed.
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
  /// Three times the enclosed volume, from the piece's centre.
  [[nodiscard]] double inside() const noexcept { return volume - moment.dot(vector_area) / area; }
};

/// Squared distance to the last neighbour. A point's area is about 1/2 of it on a square lattice and pi / 9
/// at random.
double reach_sq(std::span<const OrientedPoint> points, const Neighbours& around, std::size_t i) noexcept {
  std::size_t last = search::kNeighbours;
  while (last > 1 && around[last - 1] == i) --last;
  return (points[around[last - 1]].at() - points[i].at()).squaredNorm();
}
constexpr double kAreaShare = 0.42;  // between those two values

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

std::vector<Vec3f> decode_all(std::span<const OrientedPoint> points, int threads) {
  std::vector<Vec3f> normals(points.size());
  parallel_each(points.size(), kFirstRoundPoints, threads, [&](std::size_t i) {
    normals[i] = points[i].normal == kNoNormal ? Vec3f(Vec3f::Zero())
                                               : Vec3f(decode_normal(points[i].normal).cast<float>());
  });
  return normals;
}

/// Joins linked points by descending confidence. Links of the best class within a chunk are joined in
/// parallel per chunk, the rest sequentially.
OrientedDisjointSets join_pieces(std::span<const OrientedPoint> points,
                                 std::span<const Neighbours> neighbours, int threads) {
  const std::size_t n = points.size();
  const std::vector<Vec3f> normals = decode_all(points, threads);
  const auto place = [&](std::uint32_t i) { return Vec3f(points[i].x_mm, points[i].y_mm, points[i].z_mm); };
  OrientedDisjointSets pieces(n, threads);
  std::vector<std::array<std::vector<Link>, kClasses>> later((n + kFirstRoundPoints - 1) / kFirstRoundPoints);
  parallel_chunks(n, kFirstRoundPoints, threads, [&](std::size_t begin, std::size_t end) {
    auto& mine = later[begin / kFirstRoundPoints];
    for (std::size_t at = begin; at < end; ++at) {
      const auto i = static_cast<std::uint32_t>(at);
      if (points[i].normal == kNoNormal) continue;
      for (const std::uint32_t j : neighbours[i]) {
        if (j == i || points[j].normal == kNoNormal) continue;
        const bool here = j >= begin && j < end;
        if (here && pieces.find(i).set == pieces.find(j).set) continue;
        const Judgement judged = judge(place(i), place(j), normals[i], normals[j]);
        const int which = class_of(judged.confidence);
        if (here && which == 0)
          pieces.join(i, j, judged.flipped);
        else
          mine[static_cast<std::size_t>(which)].push_back({i, j});
      }
    }
  });
  for (std::size_t which = 0; which < kClasses; ++which)
    for (const auto& chunk : later)
      for (const Link& link : chunk[which]) {
        if (pieces.find(link.from).set == pieces.find(link.to).set) continue;
        pieces.join(link.from, link.to,
                    judge(place(link.from), place(link.to), normals[link.from], normals[link.to]).flipped);
      }
  return pieces;
}

}  // namespace

OrientReport orient_planes(std::span<OrientedPoint> points, std::span<const Neighbours> neighbours,
                           int threads) {
  const std::size_t n = points.size();
  const OrientedDisjointSets pieces = join_pieces(points, neighbours, threads);

  // Turns normals and sums per piece: first runs of one piece within a chunk, then all runs in order.
  std::vector<std::vector<PieceSums>> runs((n + kFirstRoundPoints - 1) / kFirstRoundPoints);
  parallel_chunks(n, kFirstRoundPoints, threads, [&](std::size_t begin, std::size_t end) {
    auto& mine = runs[begin / kFirstRoundPoints];
    for (std::size_t i = begin; i < end; ++i) {
      if (points[i].normal == kNoNormal) continue;
      const auto [root, flipped] = pieces.root_of(static_cast<std::uint32_t>(i));
      if (flipped != 0) points[i].normal = opposite(points[i].normal);
      sums_of(mine, root)
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

  // Orients closed pieces outward.
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
  report.closed_components = closed_roots.size();
  if (report.closed_components > 1) report.closed_component_of.resize(n);
  std::vector<std::size_t> one_sided(runs.size(), 0);
  parallel_chunks(n, kFirstRoundPoints, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      if (points[i].normal == kNoNormal) continue;
      const std::uint32_t root = pieces.root_of(static_cast<std::uint32_t>(i)).set;
      const std::uint8_t how = kind[root];
      if ((how & kClosed) == 0) continue;
      if (!report.closed_component_of.empty())
        report.closed_component_of[i] = static_cast<std::uint32_t>(
            std::lower_bound(closed_roots.begin(), closed_roots.end(), root) - closed_roots.begin());
      if ((how & kInward) != 0) points[i].normal = opposite(points[i].normal);
      points[i].normal |= kOneSided;
      ++one_sided[begin / kFirstRoundPoints];
    }
  });
  for (const std::size_t count : one_sided) report.one_sided_points += count;
  return report;
}

void point_sides(std::span<const OrientedPoint> points, std::span<const Neighbours> neighbours,
                 std::span<const std::uint32_t> closed_component_of, const Vec3& local_mm,
                 std::span<double> sides) noexcept {
  std::fill(sides.begin(), sides.end(), 0.0);  // solid angles until the next step
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (!is_one_sided(points[i].normal)) continue;
    const Vec3 d = points[i].at() - local_mm;
    const double square = d.squaredNorm();
    if (!(square > 0.0)) continue;
    const double share = kAreaShare * reach_sq(points, neighbours[i], i) / square;
    sides[closed_component_of.empty() ? 0 : closed_component_of[i]] +=
        share * decode_normal(points[i].normal).dot(d) / std::sqrt(square);
  }
  // The solid angle is 4 pi inside and 0 outside.
  for (double& side : sides) side = side > 2.0 * std::numbers::pi ? -1.0 : 1.0;
}

}  // namespace palpate::surface
