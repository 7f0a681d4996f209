#include "toolkit/paths/exploration.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <optional>
#include <vector>

#include <palpate/result.h>
#include "toolkit/core/random.h"
#include "toolkit/paths/plane_fits.h"
#include "toolkit/paths/visible_surface.h"

namespace palpate::paths {
namespace {

// A point at less than this share of a HIP's depth lies on another part of the surface. Depths are tried from
// full down in steps of a fifth.
constexpr double kClearOfOthers = 0.75, kRetreatStep = 0.8;
constexpr int kRetreatTrials = 12;
// Sliding a fitting ball by a length over a right-angled edge turns its plane by about length over radius and
// lifts it by less than the length; three times that is a jump.
constexpr double kSharpestBend = 3.0;
// On a spike's tip, where every step is a jump, one is accepted after this many.
constexpr int kRefusals = 32;
// Radius of the tightest bend of the heading, in box diagonals.
constexpr double kTightestTurnPerBox = 0.1;

Vec3 outward_direction(const PathTarget& target, Random& random) {
  if (const std::optional<Vec3> side = open_side(target)) return *side;
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

/// State of the walk, relative to the cloud's origin.
struct Walk {
  Vec3 on_surface, normal, heading;
  int refused = 0;  ///< steps rejected in a row
};

/// One step of `length` along the heading, which then turns by `turn`; where points end only the heading
/// turns.
void take_step(Walk& walk, const FitSearch& fitting, double length, double turn, Random& random) {
  const Vec3 next = walk.on_surface + length * walk.heading;
  const PlaneFit fit = fit_plane(*fitting.points, next, fitting.radius_mm, walk.normal);
  // A fold: the plane jumps to another sheet, so the walk turns back as at a border.
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
    // Back: a quarter to three quarters of a turn.
    walk.heading = rotated(walk.heading, walk.normal, random.uniform(0.5, 1.5) * std::numbers::pi);
  }
  const double size = walk.heading.norm();
  walk.heading = size > 0.0 ? Vec3(walk.heading / size) : any_tangent(walk.normal, 0.0);
}

/// `depth_mm`, reduced where another part of the surface is nearer to the HIP than its own; no hand pushes
/// through a thin part against the rendered force.
double retreat_from_surface(const Walk& walk, const FitSearch& fitting, double depth_mm) {
  for (int trial = 0; trial < kRetreatTrials; ++trial, depth_mm *= kRetreatStep) {
    const Vec3 hip = walk.on_surface - depth_mm * walk.normal;
    const double near = kClearOfOthers * depth_mm;
    bool clear = true;
    fitting.points->around(hip, kMaxFitted,
                           [&](const Vec3& q) { clear = clear && (q - hip).squaredNorm() >= near * near; });
    if (clear) return depth_mm;
  }
  return 0.0;
}

/// The start: the outermost point along `outward` around which the points form a surface. A scan's outermost
/// point may be stray or on a ragged rim without a way on. The HIP beyond it is clear of all points.
std::optional<PathStart> outermost(const cloud::Cloud& cloud, const FitSearch& fitting, const Vec3& outward,
                                   double clearance_mm) {
  std::vector<std::pair<double, std::uint32_t>> order;
  order.reserve(cloud.size());
  for (std::size_t i = 0; i < cloud.size(); ++i)
    order.emplace_back(-cloud.local_mm(i).dot(outward), static_cast<std::uint32_t>(i));
  // The first usually suffices.
  std::make_heap(order.begin(), order.end(), std::greater<>());
  for (auto end = order.end(); end != order.begin(); --end) {
    std::pop_heap(order.begin(), end, std::greater<>());
    const Vec3 at = cloud.local_mm(std::prev(end)->second);
    const PlaneFit fit = fit_plane(*fitting.points, at, fitting.radius_mm, outward);
    if (!fit.good) continue;
    const Vec3 hip = at + clearance_mm * outward;
    const double near = kClearOfOthers * clearance_mm;
    bool clear = true;
    fitting.points->around(hip, kMaxFitted,
                           [&](const Vec3& q) { clear = clear && (q - hip).squaredNorm() >= near * near; });
    if (clear) return PathStart{at, fit.normal, outward, hip};
  }
  return std::nullopt;
}

/// The walk and the HIP above it, relative to the cloud's origin, starting at `hip`.
std::vector<Vec3> follow_walk(Walk walk, Vec3 hip, const FitSearch& fitting, double tightest_turn_mm,
                              const ExplorationOptions& options, Random& random) {
  const double dt_s = 1.0 / options.rate_hz, farthest = options.fastest_mm_s * dt_s;
  // Three unrelated slow phases: of the speed and two bends.
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
    const double height = offset < 0.0 ? -retreat_from_surface(walk, fitting, -offset) : offset;
    const Vec3 wish = walk.on_surface + height * walk.normal - hip;
    hip += wish.norm() > farthest ? Vec3(wish * (farthest / wish.norm())) : wish;
  }
  return path;
}

}  // namespace

Result<PathStart> find_start_outside(const PathTarget& target, const FitSearch& fitting, double clearance_mm,
                                     Random& random) {
  const std::optional<PathStart> start =
      outermost(*target.cloud, fitting, outward_direction(target, random), clearance_mm);
  if (start) return *start;
  return Error{"nowhere do the points make a surface that can be explored",
               "clean the scan first (`palpate clean`), or give a path file",
               {},
               0};
}

Result<std::vector<Vec3>> explore(const PathTarget& target, const ExplorationOptions& options) {
  const cloud::Cloud& cloud = *target.cloud;
  if (cloud.size() < kMinInBall)
    return Error{"the cloud has too few points to explore", "give at least 16", {}, 0};
  const geometry::Aabb box = cloud.box_mm();
  PALPATE_ASSIGN(FitSearch fitting, choose_fit_radius(cloud, box));
  Random random(options.seed);
  PALPATE_ASSIGN(const PathStart start, find_start_outside(target, fitting, options.clearance_mm, random));
  const Walk walk{start.on_surface, start.normal,
                  any_tangent(start.normal, 2.0 * std::numbers::pi * random.uniform())};
  std::vector<Vec3> path =
      follow_walk(walk, start.hip, fitting, kTightestTurnPerBox * box.extent_mm().norm(), options, random);
  for (Vec3& p : path) p += cloud.origin_mm;
  return path;
}

}  // namespace palpate::paths
