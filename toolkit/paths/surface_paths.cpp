#include "toolkit/paths/path_shapes.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <optional>
#include <vector>

#include <palpate/result.h>
#include "toolkit/core/random.h"
#include "toolkit/paths/visible_surface.h"

namespace palpate::paths {
namespace {

// Samples per smallest detail; at least one in two steps of the HIP.
constexpr double kSamplesPerDetail = 4.0, kSamplesPerStep = 0.5;
// Slope limit of the HIP towards an end of the surface: 45 degrees.
constexpr double kRise = 1.0;
// Samples before giving up: finds a surface that fills a hundred-thousandth of the box.
constexpr std::size_t kMaxSamples = 200'000;
// Side of the search lattice of nearest_visible().
constexpr int kLattice = 64;

/// A place that the HIP passes.
struct Station {
  Vec3 point = Vec3::Zero();   ///< of the surface, or of the HIP itself
  Vec3 normal = Vec3::Zero();  ///< zero: crossing where there is no surface
  double room_mm = 0.0;        ///< along the surface to its nearer end
};

Vec3 hip_at(const Station& station, double offset_mm, double clearance_mm) {
  if (station.normal.isZero()) return station.point;
  return station.point + std::max(offset_mm, clearance_mm - kRise * station.room_mm) * station.normal;
}

/// A sample along the line of sight at one place of the curve.
struct Sample {
  Vec3 plan = Vec3::Zero();
  std::optional<geometry::SurfacePoint> surface;
};

/// The stations along a curve, computed on demand.
class Track {
 public:
  Track(const VisibleSurface& seen, const Curve& curve, const PathTiming& timing)
      : seen_(seen),
        curve_(curve),
        clearance_mm_(timing.clearance_mm),
        stride_mm_(std::max(seen.detail_mm() / kSamplesPerDetail, timing.step_mm() / kSamplesPerStep)) {}

  /// Stations for this length.
  [[nodiscard]] Result<std::vector<Station>> over(double path_length_mm) {
    double guess = kFirstGuess;
    for (std::size_t samples = 0; length_mm_ < path_length_mm; ++samples) {
      if (stations_.empty() && piece_.empty() && samples > kMaxSamples) return nothing_to_follow();
      take(sample());
      const double next = advance([&](double t) { return in_plan(t); }, tau_, stride_mm_, guess);
      if (!(next > tau_)) return step_does_not_fit();
      guess = 0.25 * (next - tau_);  // never beyond a nearby turn of the curve
      tau_ = next;
    }
    finish_piece();
    if (stations_.empty()) return nothing_to_follow();
    cross(std::nullopt);
    return std::move(stations_);
  }

 private:
  static Error nothing_to_follow() {
    return {"the path meets no surface seen from there",
            "look from another side: from=x, -x, y, -y, z or -z",
            {},
            0};
  }
  [[nodiscard]] Vec3 in_plan(double tau) const {
    const SurfaceParameters at = curve_(tau);
    return seen_.view().in_plan(at.u, at.v);
  }
  [[nodiscard]] Sample sample() const {
    const SurfaceParameters at = curve_(tau_);
    return {seen_.view().in_plan(at.u, at.v), seen_.at(at.u, at.v)};
  }
  [[nodiscard]] bool goes_on(const Sample& next) const {
    if (!next.surface || piece_.empty()) return false;
    const double rise = seen_.view().height(next.surface->point_mm - piece_.back().surface->point_mm);
    return std::abs(rise) <= kSteepest * (next.plan - piece_.back().plan).norm();
  }

  void take(Sample sample) {
    if (!piece_.empty() && !goes_on(sample)) finish_piece();
    if (sample.surface) {
      if (!piece_.empty()) piece_mm_ += (sample.surface->point_mm - piece_.back().surface->point_mm).norm();
      piece_.push_back(std::move(sample));
    } else {
      gap_.push_back(sample);
    }
    const double crossed_mm = stations_.empty() ? 0.0 : stride_mm_ * static_cast<double>(gap_.size());
    length_mm_ = written_mm_ + crossed_mm + piece_mm_;
  }

  /// Turns the piece into stations, preceded by a crossing; pieces shorter than the surface's detail are
  /// crossed.
  void finish_piece() {
    if (piece_.empty()) return;
    if (piece_mm_ < seen_.detail_mm()) {
      gap_.insert(gap_.end(), piece_.begin(), piece_.end());
    } else {
      if (!stations_.empty()) cross(piece_.front().surface);
      double done = 0.0;
      for (std::size_t i = 0; i < piece_.size(); ++i) {
        const geometry::SurfacePoint& at = *piece_[i].surface;
        if (i > 0) done += (at.point_mm - piece_[i - 1].surface->point_mm).norm();
        write({at.point_mm, at.normal, std::min(done, piece_mm_ - done)});
      }
      gap_.clear();
    }
    piece_.clear();
    piece_mm_ = 0.0;
  }

  /// Crosses from the last station, above everything seen, to where the surface continues, if it does.
  void cross(const std::optional<geometry::SurfacePoint>& goal) {
    const ViewFrame& view = seen_.view();
    const Vec3 from = hip_at(stations_.back(), clearance_mm_, clearance_mm_);
    const Vec3 to = goal ? Vec3(goal->point_mm + clearance_mm_ * goal->normal) : from;
    double top = std::max(view.height(from), view.height(to));
    for (const Sample& sample : gap_)
      if (sample.surface) top = std::max(top, view.height(sample.surface->point_mm) + clearance_mm_);
    const auto raised = [&](const Vec3& p) { return Vec3(p + (top - view.height(p)) * view.towards_eye); };
    write({raised(from), Vec3::Zero(), 0.0});
    for (const Sample& sample : gap_) write({raised(sample.plan), Vec3::Zero(), 0.0});
    if (goal) write({raised(to), Vec3::Zero(), 0.0});
  }

  void write(const Station& station) {
    if (!stations_.empty()) written_mm_ += (station.point - stations_.back().point).norm();
    stations_.push_back(station);
  }

  const VisibleSurface& seen_;
  const Curve& curve_;
  double clearance_mm_, stride_mm_;
  double tau_ = 0.0;
  std::vector<Sample> piece_,
      gap_;  ///< seen since the last station: no surface yet, nothing before it
  double piece_mm_ = 0.0, written_mm_ = 0.0, length_mm_ = 0.0;
  std::vector<Station> stations_;
};

}  // namespace

Result<std::vector<Vec3>> follow(const VisibleSurface& seen, const Curve& curve, const PathTiming& timing) {
  PALPATE_ASSIGN(std::vector<Station> stations,
                 Track(seen, curve, timing)
                     .over(timing.path_length_mm() + (timing.depth_mm + timing.clearance_mm) / kRise));
  std::vector<Vec3> path;
  path.reserve(timing.frames);
  std::size_t at = 0;
  double done = 0.0;  // beyond the station
  for (std::size_t k = 0; k < timing.frames; ++k) {
    const auto length = [&] { return (stations[at + 1].point - stations[at].point).norm(); };
    while (at + 1 < stations.size() && done >= length()) {
      done -= length();
      ++at;
    }
    Vec3 hip = hip_at(stations[at], timing.offset_mm(k), timing.clearance_mm);
    if (at + 1 < stations.size() && done > 0.0)
      hip += (done / length()) * (hip_at(stations[at + 1], timing.offset_mm(k), timing.clearance_mm) - hip);
    path.push_back(k == 0 ? hip : limit_step(path.back(), hip, timing.farthest_mm()));
    done += timing.step_mm(k);
  }
  return path;
}

Result<VisiblePoint> nearest_visible(const VisibleSurface& seen, double u, double v) {
  if (const std::optional<geometry::SurfacePoint> here = seen.at(u, v)) return VisiblePoint{*here, u, v};
  std::optional<VisiblePoint> best;
  double best_sq = std::numeric_limits<double>::infinity();
  for (int row = 0; row <= kLattice; ++row)
    for (int column = 0; column <= kLattice; ++column) {
      const double du = static_cast<double>(column) / kLattice - u,
                   dv = static_cast<double>(row) / kLattice - v;
      if (du * du + dv * dv >= best_sq) continue;
      const std::optional<geometry::SurfacePoint> there = seen.at(u + du, v + dv);
      if (!there) continue;
      best = VisiblePoint{*there, u + du, v + dv};
      best_sq = du * du + dv * dv;
    }
  if (best) return *best;
  return Error{"no surface shows from there", "look from another side: from=x, -x, y, -y, z or -z"};
}

Result<std::vector<Vec3>> slide_over(const VisibleSurface& seen, const VisiblePoint& start,
                                     const PathTiming& timing) {
  const ViewFrame& view = seen.view();
  if (!(view.extent_u_mm > 0.0))
    return Error{"the model has no width to slide over", "look from another side"};
  const double stride = std::max(seen.detail_mm() / kSamplesPerDetail, timing.step_mm() / kSamplesPerStep);
  const double du = std::min(stride / view.extent_u_mm, kSlideOvershoot);
  std::vector<Vec3> lower, upper;
  geometry::SurfacePoint last = start.surface;
  const auto write = [&](const geometry::SurfacePoint& at) {
    lower.push_back(at.point_mm - timing.depth_mm * at.normal);
    upper.push_back(at.point_mm + timing.clearance_mm * at.normal);
  };
  write(last);
  double u = start.u + du;
  for (; u <= 1.0 + du; u += du) {
    const std::optional<geometry::SurfacePoint> next = seen.at(u, start.v);
    if (!next || std::abs(view.height(next->point_mm - last.point_mm)) > kSteepest * du * view.extent_u_mm)
      break;
    last = *next;
    write(last);
  }
  // Past the end: straight on in the view direction, until something is as high as the HIP.
  const double lowest = view.height(lower.back());
  double free_mm = 0.0;
  for (const double end = u + kSlideOvershoot; u <= end; u += du) {
    const std::optional<geometry::SurfacePoint> next = seen.at(u, start.v);
    if (next && view.height(next->point_mm) + timing.clearance_mm > lowest) break;
    free_mm += du * view.extent_u_mm;
  }
  if (lower.size() == 1 && !(free_mm > 0.0))
    return Error{"the surface ends where the slide begins", "give it another place: u and v, 0 to 1"};
  if (free_mm > 0.0) {
    lower.push_back(lower.back() + free_mm * view.across_u);
    upper.push_back(upper.back() + free_mm * view.across_u);
  }
  return slide(lower, upper, timing);
}

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
/// point may be an outlier or on a ragged rim without a way on. The HIP beyond it is clear of all points.
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
                              const PathTiming& timing, double slowest_mm_s, double fastest_mm_s,
                              Random& random) {
  const double dt_s = 1.0 / timing.rate_hz, farthest = fastest_mm_s * dt_s;
  // Three unrelated slow phases: of the speed and two bends.
  double phases[3];
  for (double& phase : phases) phase = 2.0 * std::numbers::pi * random.uniform();
  const double middle = 0.5 * (fastest_mm_s + slowest_mm_s);
  const double swing = 0.5 * (fastest_mm_s - slowest_mm_s);
  std::vector<Vec3> path;
  path.reserve(timing.frames);
  for (std::size_t k = 0; k < timing.frames; ++k) {
    path.push_back(hip);
    const double turn = 2.0 * std::numbers::pi * static_cast<double>(k) / timing.period_frames;
    // Wobbles that never repeat together: golden section and root of two.
    const double length = dt_s * (middle + swing * std::sin(turn / std::numbers::phi + phases[0]));
    const double bend = 0.5 *
                        (std::sin(0.5 * turn / std::numbers::sqrt2 + phases[1]) +
                         std::sin(0.5 * turn / std::numbers::phi + phases[2])) /
                        tightest_turn_mm;
    take_step(walk, fitting, length, bend * length, random);
    const double offset = timing.offset_mm(k);
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
               "clean the scan first (`palpate clean`), or give a path file"};
}

Result<std::vector<Vec3>> explore(const PathTarget& target, const PathTiming& timing, double slowest_mm_s,
                                  double fastest_mm_s) {
  const cloud::Cloud& cloud = *target.cloud;
  if (cloud.size() < kMinInBall) return Error{"the cloud has too few points to explore", "give at least 16"};
  const geometry::Aabb box = cloud.box_mm();
  PALPATE_ASSIGN(FitSearch fitting, choose_fit_radius(cloud, box));
  Random random(timing.seed);
  PALPATE_ASSIGN(const PathStart start, find_start_outside(target, fitting, timing.clearance_mm, random));
  const Walk walk{start.on_surface, start.normal,
                  any_tangent(start.normal, 2.0 * std::numbers::pi * random.uniform())};
  std::vector<Vec3> path = follow_walk(walk, start.hip, fitting, kTightestTurnPerBox * box.extent_mm().norm(),
                                       timing, slowest_mm_s, fastest_mm_s, random);
  for (Vec3& p : path) p += cloud.origin_mm;
  return path;
}

}  // namespace palpate::paths
