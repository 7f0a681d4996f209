#include "toolkit/trace/exploration.h"

#include <Eigen/Eigenvalues>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <optional>
#include <vector>

#include "toolkit/cloud/statistics.h"
#include "toolkit/core/random.h"

namespace palpate::trace {
namespace {

// A plane fit wants points all around: the radius is chosen so that the median ball holds between these many.
constexpr std::size_t kFewestInBall = 16, kMostInBall = 64;
constexpr int kRadiusTrials = 24;
constexpr double kRadiusFactor = 1.3;
constexpr std::size_t kSampledBalls = 129;
// A fit reads at most this many points, so that a clump of duplicates cannot make a frame slow.
constexpr std::size_t kMostFitted = 4096;
// Fewer than this many points, or a centroid farther off than this part of the radius (a straight border seen
// from the border itself has it at 0.37), and the surface ends here.
constexpr std::size_t kFewestFitted = 6;
constexpr double kBorderOffset = 0.5;
// An open sheet's area vector keeps a good part of its area, a closed surface's vanishes.
constexpr double kOpenShare = 0.1;
// The point below a HIP at some depth is about as far away as it is deep; one nearer than this share of the
// depth lies on another part of the surface. Tried from the full depth down in steps of a fifth.
constexpr double kClearOfOthers = 0.75, kGiveWayStep = 0.8;
constexpr int kGiveWayTrials = 12;
// A ball of points that slides by a length over a surface as sharp as a right-angled edge turns its plane by
// about that length over the radius, and lifts it by less than the length; three times that is a jump.
constexpr double kSharpestBend = 3.0;
// Where every way is a jump, as on the tip of a spike, one is taken after so many.
constexpr int kRefusals = 32;
// Radius of the tightest bend of the heading, in diagonals of the box.
constexpr double kTightestTurnPerBox = 0.1;
// Bits of a cell coordinate in a 64-bit key of three.
constexpr std::uint64_t kCellBits = 21;

/// Points sorted by the cell of a cubic grid.
class PointGrid {
 public:
  PointGrid(const cloud::Cloud& cloud, const geometry::Aabb& box, double cell_mm)
      : cloud_(cloud), low_(box.low_mm - cloud.origin_mm), cell_mm_(cell_mm) {
    items_.resize(cloud.size());
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      const auto c = cell_of(cloud.local_mm(i));
      items_[i] = {key(c[0], c[1], c[2]), static_cast<std::uint32_t>(i)};
    }
    std::sort(items_.begin(), items_.end());
  }

  /// Calls visit(local point) for at most kMostFitted points of the 27 cells around `p` (relative to the
  /// origin).
  template <class Visit>
  void around(const Vec3& p, const Visit& visit) const {
    const auto c = cell_of(p);
    std::size_t left = kMostFitted;
    for (std::int64_t k = c[2] - 1; k <= c[2] + 1; ++k)
      for (std::int64_t j = c[1] - 1; j <= c[1] + 1; ++j) {
        if (k < 0 || j < 0) continue;
        // Three cells in a row have keys in a row.
        const std::uint64_t first = key(std::max<std::int64_t>(c[0] - 1, 0), j, k),
                            last = key(c[0] + 1, j, k);
        auto it = std::lower_bound(items_.begin(), items_.end(), std::pair(first, std::uint32_t{0}));
        for (; it != items_.end() && it->first <= last && left > 0; ++it, --left)
          visit(cloud_.local_mm(it->second));
      }
  }

 private:
  [[nodiscard]] std::array<std::int64_t, 3> cell_of(const Vec3& p) const {
    constexpr double kLast = static_cast<double>((1u << kCellBits) - 2);
    std::array<std::int64_t, 3> c{};
    for (int axis = 0; axis < 3; ++axis)
      c[static_cast<std::size_t>(axis)] =
          static_cast<std::int64_t>(std::clamp((p[axis] - low_[axis]) / cell_mm_, 0.0, kLast));
    return c;
  }
  static std::uint64_t key(std::int64_t i, std::int64_t j, std::int64_t k) {
    return (static_cast<std::uint64_t>(k) << (2 * kCellBits)) | (static_cast<std::uint64_t>(j) << kCellBits) |
           static_cast<std::uint64_t>(i);
  }
  const cloud::Cloud& cloud_;
  Vec3 low_;
  double cell_mm_;
  std::vector<std::pair<std::uint64_t, std::uint32_t>> items_;
};

std::size_t median_in_ball(const cloud::Cloud& cloud, const PointGrid& grid, double radius) {
  std::vector<std::size_t> counts;
  for (std::size_t s = 0; s < kSampledBalls; ++s) {
    const Vec3 p = cloud.local_mm(s * (cloud.size() - 1) / (kSampledBalls - 1));
    std::size_t count = 0;
    grid.around(p, [&](const Vec3& q) { count += (q - p).squaredNorm() < radius * radius; });
    counts.push_back(count);
  }
  std::nth_element(counts.begin(), counts.begin() + kSampledBalls / 2, counts.end());
  return counts[kSampledBalls / 2];
}

/// A plane fitted around a point.
struct Fit {
  bool good = false;
  Vec3 normal = Vec3::UnitZ();
  double height = 0.0;  ///< of the plane above the point, along the normal
};

Fit fit_plane(const PointGrid& grid, const Vec3& p, double radius, const Vec3& side) {
  double weights = 0.0;
  std::size_t count = 0;
  Vec3 sum = Vec3::Zero();
  Mat3 products = Mat3::Zero();
  grid.around(p, [&](const Vec3& q) {
    const Vec3 offset = (q - p) / radius;
    const double rest = 1.0 - offset.squaredNorm();
    if (rest <= 0.0) return;
    const double w = rest * rest;
    weights += w;
    sum += w * offset;
    products += w * offset * offset.transpose();
    ++count;
  });
  Fit fit;
  if (count < kFewestFitted || !(weights > 0.0)) return fit;
  const Vec3 mean = sum / weights;
  Eigen::SelfAdjointEigenSolver<Mat3> solver;
  solver.computeDirect(products / weights - mean * mean.transpose());
  fit.normal = solver.eigenvectors().col(0).normalized();
  if (!is_finite(fit.normal)) return fit;
  if (fit.normal.dot(side) < 0.0) fit.normal = -fit.normal;
  fit.height = radius * mean.dot(fit.normal);
  fit.good = (mean - mean.dot(fit.normal) * fit.normal).norm() < kBorderOffset &&
             std::abs(mean.dot(fit.normal)) < kBorderOffset;
  return fit;
}

Vec3 outward_direction(const PathTarget& target, Random& random) {
  if (target.mesh != nullptr && !target.mesh->empty()) {
    Vec3 total = Vec3::Zero();
    double area = 0.0;
    for (const auto& t : target.mesh->triangles) {
      const Vec3& a = target.mesh->vertices_mm[t[0]];
      const Vec3 n = (target.mesh->vertices_mm[t[1]] - a).cross(target.mesh->vertices_mm[t[2]] - a);
      if (!is_finite(n)) continue;
      total += n;
      area += n.norm();
    }
    if (total.norm() > kOpenShare * area) return total.normalized();
  } else if (cloud::is_height_field(*target.cloud)) {
    return Vec3::UnitZ();
  }
  const double z = random.uniform(-1.0, 1.0), angle = 2.0 * std::numbers::pi * random.uniform();
  const double ring = std::sqrt(1.0 - z * z);
  return {ring * std::cos(angle), ring * std::sin(angle), z};
}

Vec3 rotated(const Vec3& v, const Vec3& axis, double angle) {
  return Eigen::AngleAxisd(angle, axis) * v;
}

Vec3 any_tangent(const Vec3& normal, double angle) {
  const Vec3 helper = std::abs(normal.x()) < 0.5 ? Vec3(Vec3::UnitX()) : Vec3(Vec3::UnitY());
  return rotated(normal.cross(helper).normalized(), normal, angle);
}

/// Radius of the fits, with the grid of that cell size.
struct Fitting {
  double radius_mm = 0.0;
  std::unique_ptr<PointGrid> grid;
};

Result<Fitting> choose_radius(const cloud::Cloud& cloud, const geometry::Aabb& box) {
  const Vec3 e = box.extent_mm();
  // First guess: the points spread over the box's faces.
  const double faces = e.x() * e.y() + e.y() * e.z() + e.z() * e.x();
  Fitting fitting;
  fitting.radius_mm = std::sqrt(static_cast<double>(kMostInBall) * faces /
                                (std::numbers::pi * static_cast<double>(cloud.size())));
  if (!(fitting.radius_mm > 0.0))
    return Error{
        "the points of the cloud stand in one line or place", "an exploration needs a surface", {}, 0};
  for (int trial = 0; trial < kRadiusTrials; ++trial) {
    fitting.grid = std::make_unique<PointGrid>(cloud, box, fitting.radius_mm);
    const std::size_t median = median_in_ball(cloud, *fitting.grid, fitting.radius_mm);
    if (median >= kFewestInBall && median <= kMostInBall) return fitting;
    fitting.radius_mm *= median < kFewestInBall ? kRadiusFactor : 1.0 / kRadiusFactor;
  }
  fitting.grid =
      std::make_unique<PointGrid>(cloud, box, fitting.radius_mm);  // uneven clouds: as good as it gets
  return fitting;
}

/// Where the walk is, relative to the cloud's origin.
struct Walk {
  Vec3 on_surface, normal, heading;
  int refused = 0;  ///< steps turned back in a row
};

/// One step of `length` along the heading, which then turns by `turn`; where points end only the heading
/// turns.
void take_step(Walk& walk, const Fitting& fitting, double length, double turn, Random& random) {
  const Vec3 next = walk.on_surface + length * walk.heading;
  const Fit fit = fit_plane(*fitting.grid, next, fitting.radius_mm, walk.normal);
  // A fold: the fitted plane jumps to another sheet. The walk turns back as at a border.
  const double most = kSharpestBend * length / fitting.radius_mm;
  const bool jumps =
      std::abs(fit.height) > kSharpestBend * length || (fit.normal - walk.normal).norm() > most;
  if (fit.good && (!jumps || walk.refused >= kRefusals)) {
    walk.refused = 0;
    walk.on_surface = next + fit.height * fit.normal;
    walk.normal = fit.normal;
    const Vec3 tangent = walk.heading - walk.heading.dot(fit.normal) * fit.normal;
    walk.heading = rotated(tangent, fit.normal, turn);
  } else {
    ++walk.refused;
    // Somewhere back: a quarter to three quarters of a turn.
    walk.heading = rotated(walk.heading, walk.normal, random.uniform(0.5, 1.5) * std::numbers::pi);
  }
  const double size = walk.heading.norm();
  walk.heading = size > 0.0 ? Vec3(walk.heading / size) : any_tangent(walk.normal, 0.0);
}

/// `depth_mm`, or less where another part of the surface comes nearer to the HIP than the one it went
/// through: no hand pushes through a thin part against the force that a renderer would give.
double give_way(const Walk& walk, const Fitting& fitting, double depth_mm) {
  for (int trial = 0; trial < kGiveWayTrials; ++trial, depth_mm *= kGiveWayStep) {
    const Vec3 hip = walk.on_surface - depth_mm * walk.normal;
    const double near = kClearOfOthers * depth_mm;
    bool clear = true;
    fitting.grid->around(hip,
                         [&](const Vec3& q) { clear = clear && (q - hip).squaredNorm() >= near * near; });
    if (clear) return depth_mm;
  }
  return 0.0;
}

/// Where the walk begins: the outermost point, seen along `outward`, around which the points make a surface.
/// A scan's outermost point may be a stray one, or the tip of a ragged rim from which no step leads on. The
/// HIP beyond it is clear of every point.
std::optional<Walk> outermost(const cloud::Cloud& cloud, const Fitting& fitting, const Vec3& outward,
                              double clearance_mm) {
  std::vector<std::pair<double, std::uint32_t>> order;
  order.reserve(cloud.size());
  for (std::size_t i = 0; i < cloud.size(); ++i)
    order.emplace_back(-cloud.local_mm(i).dot(outward), static_cast<std::uint32_t>(i));
  // Mostly the first will do.
  std::make_heap(order.begin(), order.end(), std::greater<>());
  for (auto end = order.end(); end != order.begin(); --end) {
    std::pop_heap(order.begin(), end, std::greater<>());
    const Vec3 at = cloud.local_mm(std::prev(end)->second);
    const Fit fit = fit_plane(*fitting.grid, at, fitting.radius_mm, outward);
    if (!fit.good) continue;
    const Vec3 hip = at + clearance_mm * outward;
    const double near = kClearOfOthers * clearance_mm;
    bool clear = true;
    fitting.grid->around(hip,
                         [&](const Vec3& q) { clear = clear && (q - hip).squaredNorm() >= near * near; });
    if (clear) return Walk{at, fit.normal, Vec3::Zero()};
  }
  return std::nullopt;
}

/// The walk and the HIP above it, relative to the cloud's origin. `hip` is where the HIP starts.
std::vector<Vec3> follow_walk(Walk walk, Vec3 hip, const Fitting& fitting, double tightest_turn_mm,
                              const ExplorationOptions& options, Random& random) {
  const double dt_s = 1.0 / options.rate_hz, farthest = options.fastest_mm_s * dt_s;
  // Three slow, unrelated phases: of the speed and of two bends.
  double phases[3];
  for (double& phase : phases) phase = 2.0 * std::numbers::pi * random.uniform();
  const double middle = 0.5 * (options.fastest_mm_s + options.slowest_mm_s);
  const double swing = 0.5 * (options.fastest_mm_s - options.slowest_mm_s);
  std::vector<Vec3> path;
  path.reserve(options.frames);
  for (std::size_t k = 0; k < options.frames; ++k) {
    path.push_back(hip);
    const double turn = 2.0 * std::numbers::pi * static_cast<double>(k) / options.period_frames;
    // Wobbles that never repeat together: golden section and root of two.
    const double length = dt_s * (middle + swing * std::sin(turn / std::numbers::phi + phases[0]));
    const double bend = 0.5 *
                        (std::sin(0.5 * turn / std::numbers::sqrt2 + phases[1]) +
                         std::sin(0.5 * turn / std::numbers::phi + phases[2])) /
                        tightest_turn_mm;
    take_step(walk, fitting, length, bend * length, random);
    const double offset = 0.5 * (options.depth_mm + options.clearance_mm) * std::cos(turn) -
                          0.5 * (options.depth_mm - options.clearance_mm);
    const double height = offset < 0.0 ? -give_way(walk, fitting, -offset) : offset;
    const Vec3 wish = walk.on_surface + height * walk.normal - hip;
    hip += wish.norm() > farthest ? Vec3(wish * (farthest / wish.norm())) : wish;
  }
  return path;
}

}  // namespace

Result<std::vector<Vec3>> explore(const PathTarget& target, const ExplorationOptions& options) {
  const cloud::Cloud& cloud = *target.cloud;
  if (cloud.size() < kFewestInBall)
    return Error{"the cloud has too few points to explore", "give at least 16", {}, 0};
  const geometry::Aabb box = cloud.box_mm();
  Result<Fitting> fitting = choose_radius(cloud, box);
  if (!fitting) return std::move(fitting).error();
  Random random(options.seed);
  const Vec3 outward = outward_direction(target, random);
  std::optional<Walk> start = outermost(cloud, *fitting, outward, options.clearance_mm);
  if (!start)
    return Error{"nowhere do the points make a surface that can be explored",
                 "clean the scan first (`palpate clean`), or give a path file",
                 {},
                 0};
  Walk walk = *start;
  walk.heading = any_tangent(walk.normal, 2.0 * std::numbers::pi * random.uniform());
  const Vec3 hip = walk.on_surface + options.clearance_mm * outward;
  std::vector<Vec3> path =
      follow_walk(walk, hip, *fitting, kTightestTurnPerBox * box.extent_mm().norm(), options, random);
  for (Vec3& p : path) p += cloud.origin_mm;
  return path;
}

}  // namespace palpate::trace
