#include "baselines/points/gaps.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <vector>

#include <palpate/result.h>
#include "toolkit/core/statistics.h"
#include "toolkit/render/prepare.h"
#include "toolkit/search/knn.h"
#include "toolkit/surface/smallest_eigenvector.h"

namespace palpate::baselines {
namespace {

/// Number of sampled points. It bounds the rank of the gap that 1 % exceed to 20 of 2048, a twentieth of its
/// length at random.
constexpr std::size_t kGapSamples = 2048;
constexpr double kGapPercentile = 99.0;
/// Edge in spacings of the cells that the samples are taken from, one each. A cell has a few points, so
/// samples are even by area, and sparse parts count as dense ones do.
constexpr double kGapCellSpacings = 2.0;
/// Points are gathered within so many spacings, and twice as far as long as the gap is open to some side: up
/// to gaps of twelve spacings. Wider gaps are holes or borders.
constexpr double kFirstReach = 3.0, kLastReach = 24.0;
/// Points are in one line if they spread across it by less than a quarter of what they do along it.
constexpr double kLineSpread = 1.0 / 16.0;  // of squares
constexpr std::size_t kLineNeighbours = 8;
/// Squared tangent of the steepest way to a point of the same sheet, 60 degrees: both sides of a right-angled
/// edge, whose plane is at 45 degrees to them, belong to it.
constexpr double kSteepSq = 3.0;
/// Samples a chunk: some 50 us of work.
constexpr std::size_t kSamplesPerChunk = 16;

using Vec2 = Eigen::Vector2d;

constexpr unsigned kAllSides = 0xFFu;
constexpr double kHalfRoot = 0.7071067811865476;  // of the diagonal directions
const std::array<Vec2, 8> kSides = {
    Vec2(1, 0),  Vec2(kHalfRoot, kHalfRoot),   Vec2(0, 1),  Vec2(-kHalfRoot, kHalfRoot),
    Vec2(-1, 0), Vec2(-kHalfRoot, -kHalfRoot), Vec2(0, -1), Vec2(kHalfRoot, -kHalfRoot)};

/// A convex polygon around the origin, cut by bisectors: the Voronoi cell of a point among others.
class GapCell {
 public:
  explicit GapCell(double half) : corners_{{-half, -half}, {half, -half}, {half, half}, {-half, half}} {}
  /// Cuts away what is nearer to `other`.
  void cut(const Vec2& other) {
    const double middle = 0.5 * other.squaredNorm();
    kept_.clear();
    for (std::size_t i = 0; i < corners_.size(); ++i) {
      const Vec2 &a = corners_[i], &b = corners_[(i + 1) % corners_.size()];
      const double past_a = a.dot(other) - middle, past_b = b.dot(other) - middle;
      if (past_a <= 0.0) kept_.push_back(a);
      if ((past_a <= 0.0) != (past_b <= 0.0)) kept_.push_back(a + (b - a) * (past_a / (past_a - past_b)));
    }
    corners_.swap(kept_);
  }
  [[nodiscard]] double farthest_sq() const {
    double most = 0.0;
    for (const Vec2& corner : corners_) most = std::max(most, corner.squaredNorm());
    return most;
  }
  [[nodiscard]] std::span<const Vec2> corners() const { return corners_; }

 private:
  std::vector<Vec2> corners_, kept_;
};

struct GapSample {
  double gap_mm = 0.0;  ///< 0: the point is not surrounded
  bool in_line = false;
};

/// The points around one, in the plane that fits them best, nearest first.
struct Surroundings {
  std::vector<Vec3> offset;
  std::vector<Vec2> flat;

  bool lay_out(const PointGrid& points, const Vec3& at, double reach) {
    offset.clear();
    points.within(at, reach, [&](std::uint32_t place, double sq) {
      if (sq > 0.0) offset.push_back(points.points[place].at() - at);
    });
    surface::SymmetricMatrix3 spread;
    Vec3 mean = Vec3::Zero();
    for (const Vec3& d : offset) mean += d;
    mean /= static_cast<double>(std::max<std::size_t>(1, offset.size()));
    for (const Vec3& d : offset) spread.add(d - mean);
    Vec3 normal = Vec3::UnitZ();
    if (!surface::smallest_eigenvector(spread, normal)) return false;
    const Vec3 u = normal.unitOrthogonal(), v = normal.cross(u);
    flat.clear();
    for (const Vec3& d : offset) {
      const double height = normal.dot(d);
      const Vec2 beside(u.dot(d), v.dot(d));
      const double beside_sq = beside.squaredNorm();
      // Points keep their distances in space, so that nothing is foreshortened where the surface bends. A
      // steeper point is on another sheet.
      if (beside_sq > 0.0 && height * height <= kSteepSq * beside_sq)
        flat.push_back(beside * std::sqrt(d.squaredNorm() / beside_sq));
    }
    std::sort(flat.begin(), flat.end(), [](const Vec2& a, const Vec2& b) {
      const double sq_a = a.squaredNorm(), sq_b = b.squaredNorm();
      return sq_a != sq_b ? sq_a < sq_b : (a.x() != b.x() ? a.x() < b.x() : a.y() < b.y());
    });
    return flat.size() >= 3;
  }
  [[nodiscard]] bool nearest_in_line() const {
    if (flat.size() < kLineNeighbours) return false;
    double xx = 0.0, xy = 0.0, yy = 0.0;
    for (std::size_t i = 0; i < kLineNeighbours; ++i) {
      xx += flat[i].x() * flat[i].x();
      xy += flat[i].x() * flat[i].y();
      yy += flat[i].y() * flat[i].y();
    }
    // Eigenvalues: half the trace, plus and minus the root.
    const double half = 0.5 * (xx + yy), root = std::sqrt(0.25 * (xx - yy) * (xx - yy) + xy * xy);
    return half - root < kLineSpread * (half + root);
  }
  /// Points lie on every side of a corner of the cell: the empty circle around it is between points, and not
  /// outside of a border. On each side means within 60 degrees of each of eight directions, and no farther
  /// than twice the circle's radius.
  [[nodiscard]] bool surround(const Vec2& corner) const {
    const double size_sq = corner.squaredNorm();
    unsigned open = kAllSides;
    const auto close = [&](const Vec2& way) {
      const double way_sq = way.squaredNorm();
      if (way_sq > 4.0 * size_sq) return;
      for (std::size_t k = 0; k < kSides.size(); ++k) {
        const double along = way.dot(kSides[k]);
        if (along > 0.0 && 4.0 * along * along >= way_sq) open &= ~(1u << k);
      }
    };
    close(-corner);  // the point itself
    for (const Vec2& point : flat) {
      close(point - corner);
      if (open == 0) return true;
    }
    return false;
  }
};

GapSample gap_at(const PointGrid& points, const Vec3& at, double spacing) {
  GapSample found;
  Surroundings around;
  for (double reach = kFirstReach * spacing; reach <= kLastReach * spacing; reach *= 2.0) {
    if (!around.lay_out(points, at, reach)) continue;
    found.in_line = around.nearest_in_line();
    // Corners within half the reach are known: all points that could cut them away were looked at.
    const double known_sq = 0.25 * reach * reach;
    GapCell cell(reach);
    for (const Vec2& point : around.flat) {
      if (point.squaredNorm() > 4.0 * cell.farthest_sq()) break;
      cell.cut(point);
    }
    bool open = false;
    found.gap_mm = 0.0;
    for (const Vec2& corner : cell.corners()) {
      if (corner.squaredNorm() > known_sq)
        open = true;
      else if (around.surround(corner))
        found.gap_mm = std::max(found.gap_mm, corner.norm());
    }
    if (!open) break;
  }
  return found;
}

/// One point of each of the queried cells, whatever the order of the points.
std::vector<Vec3> gap_samples(const PointGrid& points) {
  const std::size_t stride = points.grid.occupied_cells() / kGapSamples + 1;
  std::vector<Vec3> samples;
  std::size_t occupied = 0;
  for (std::size_t slot = 0; slot < points.grid.slots(); ++slot) {
    const search::IndexRange range = points.grid.places_of(slot);
    if (range.begin == range.end || occupied++ % stride != 0) continue;
    Vec3 least = points.points[range.begin].at();
    for (std::uint32_t place = range.begin + 1; place < range.end; ++place) {
      const Vec3 at = points.points[place].at();
      if (std::lexicographical_compare(at.begin(), at.end(), least.begin(), least.end())) least = at;
    }
    samples.push_back(least);
  }
  return samples;
}

}  // namespace

Gaps measure_gaps(const cloud::Cloud& cloud, int threads) {
  Gaps gaps;
  gaps.spacing_mm = natural_spacing_mm(cloud, threads);
  const PointGrid points = build_point_grid(cloud, kGapCellSpacings * gaps.spacing_mm, threads);
  const std::vector<Vec3> samples = gap_samples(points);
  std::vector<GapSample> found(samples.size());
  parallel_each(samples.size(), kSamplesPerChunk, threads,
                [&](std::size_t i) { found[i] = gap_at(points, samples[i], gaps.spacing_mm); });
  std::vector<double> known;
  std::size_t in_line = 0;
  for (const GapSample& sample : found) {
    if (sample.gap_mm > 0.0) known.push_back(sample.gap_mm);
    in_line += sample.in_line;
  }
  std::sort(known.begin(), known.end());
  if (!known.empty()) gaps.gap_mm = nearest_rank(known, kGapPercentile);
  gaps.lines = 2 * in_line > found.size();
  return gaps;
}

Gaps measured_gaps(const cloud::Cloud& cloud, const render::PrepareContext& context,
                   render::PrepareReport& report, render::ModelDecisions* out) {
  render::PreparePhases phases(report, context);
  phases.begin("gaps");
  const Gaps gaps = measure_gaps(cloud, context.threads);
  phases.end();
  if (out == nullptr) return gaps;
  report_spacing(gaps.spacing_mm, *out);
  const double times = gaps.closing_mm() / gaps.spacing_mm;
  out->decisions.push_back(
      {"gaps", fmt::format("{:.4g} mm", gaps.gap_mm),
       times > 1.0
           ? fmt::format("1 % of the empty circles between points are larger: {:.3g} spacings, which stand "
                         "for one where nothing may fall through{}",
                         times, gaps.lines ? "; the points stand in lines" : "")
           : std::string("1 % of the empty circles between points are larger: the mean spacing will do")});
  return gaps;
}

namespace {

/// Distance of the eighth neighbour on a square lattice in spacings, which turns distances into spacings.
constexpr double kEighthSpacings = 1.4142135623730951;  // sqrt 2
/// The largest local spacing, in units of what closes 99 % of the gaps: with radii of 1.5 it closes gaps
/// nearly twice as wide; what is lonelier is an outlier, or stands at a border.
constexpr double kMaxClosing = 1.25;
/// A radius of 1.5 spacings closes even gaps (4/3 spacings) down to this share of it: means may take as much.
constexpr double kStillCloses = kEvenGap / 1.5;
/// Means over neighbours: local spacings then differ from one point to the next by some percent.
constexpr int kSmoothings = 3;

/// The last dense points before a step of the density have dense neighbours alone; only the sparse ones
/// beyond the gap know of it. A point therefore also takes the largest spacing of those whose neighbour it
/// is.
std::vector<float> smoothed_spacings(const cloud::Cloud& cloud, const search::NeighbourTable& table,
                                     double spacing_mm, const SpacingRange& range, int threads) {
  const std::size_t n = cloud.size();
  std::vector<float> own(n), mean(n);
  const auto each = [&](std::vector<float>& out, const auto& value) {
    parallel_each(n, kPointsPerChunk, threads, [&](std::size_t i) { out[i] = static_cast<float>(value(i)); });
  };
  each(own, [&](std::size_t i) {
    double most_sq = 0.0;
    for (const std::uint32_t other : table.of[i])
      most_sq = std::max(most_sq, (cloud.local_mm(other) - cloud.local_mm(i)).squaredNorm());
    const double scale = std::sqrt(most_sq) / (kEighthSpacings * spacing_mm);
    return std::clamp(scale > 0.0 ? scale : 1.0, range.least, range.most);  // alone, or in a pile: the mean
  });
  std::vector<float> largest = own;
  for (std::size_t i = 0; i < n; ++i)
    for (const std::uint32_t other : table.of[i]) largest[other] = std::max(largest[other], own[i]);
  std::vector<float> smooth = largest;
  for (int round = 0; round < kSmoothings; ++round) {
    each(mean, [&](std::size_t i) {
      double sum = static_cast<double>(smooth[i]);
      for (const std::uint32_t other : table.of[i]) sum += static_cast<double>(smooth[other]);
      return std::max(kStillCloses * static_cast<double>(largest[i]),
                      sum / static_cast<double>(table.of[i].size() + 1));
    });
    smooth.swap(mean);
  }
  return smooth;
}

}  // namespace

SpacingRange spacing_range(const Gaps& gaps, double ratio) noexcept {
  const double closing = gaps.closing_mm() / gaps.spacing_mm, most = kMaxClosing * closing;
  return {gaps.lines ? closing : most / ratio, most};
}

Result<std::vector<float>> local_spacings(const cloud::Cloud& cloud, const Gaps& gaps,
                                          const SpacingRange& range, const render::PrepareContext& context,
                                          render::PrepareReport& report) {
  render::PreparePhases phases(report, context);
  phases.begin("neighbours");
  PALPATE_ASSIGN(const auto built, search::build_neighbours(gaps.lines ? "directional-knn" : "exact-knn",
                                                            cloud, context.threads));
  phases.end();
  phases.begin("radii");
  std::vector<float> scale = smoothed_spacings(cloud, built.table, gaps.spacing_mm, range, context.threads);
  phases.end();
  return scale;
}

PlacedScales placed_scales(std::span<const float> scale, std::span<const std::uint32_t> order) {
  PlacedScales placed;
  if (scale.empty()) return placed;
  placed.by_place.resize(scale.size());
  for (std::size_t place = 0; place < order.size(); ++place) placed.by_place[place] = scale[order[place]];
  const auto [least, most] = std::minmax_element(scale.begin(), scale.end());
  placed.least = static_cast<double>(*least);
  placed.most = static_cast<double>(*most);
  return placed;
}

}  // namespace palpate::baselines
