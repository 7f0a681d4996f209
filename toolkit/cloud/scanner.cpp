#include "toolkit/cloud/scanner.h"

#include <fmt/format.h>

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <numbers>

#include <palpate/result.h>
#include "toolkit/cloud/sampling.h"
#include "toolkit/core/option_specs.h"
#include "toolkit/core/parallel.h"
#include "toolkit/core/random.h"

namespace palpate::cloud {
namespace {

/// The scanner's distance from the model's middle, in model radii.
constexpr double kStandOff = 3.0;
/// Cosine of 80 degrees; flatter rays return nothing.
constexpr double kGrazing = 0.17364817766693041;
/// Cosine at which the bias is specified.
constexpr double kBiasAt = 0.5;
/// Rays per side of the first raster, which estimates a view's coverage.
constexpr std::size_t kTrialSide = 64;
/// Range difference of adjacent rays, in spacings, that marks an edge with air behind.
constexpr double kEdge = 4.0;
/// Distance in front, in spacings, of flying points for which no edge is left.
constexpr double kNearestFlying = 2.0, kFarthestFlying = 10.0;
/// Lowest views from above, as a share of a hemisphere's height: 30 degrees over the plane.
constexpr double kLowestAbove = 0.5;

/// One scanner position: rays go from `eye` through a raster on the plane through the model's middle.
struct ScanView {
  Vec3 eye, right, up, middle;
  double half = 0.0;  ///< half the raster's side
  [[nodiscard]] Vec3 end(double x, double y) const {
    const Vec3 on_plane = middle + x * half * right + y * half * up;
    return eye + 2.0 * (on_plane - eye);
  }
};

std::vector<ScanView> views_of(const geometry::Aabb& box, bool from_above, int count) {
  const double radius = 0.5 * box.extent_mm().norm();
  std::vector<ScanView> views;
  for (int i = 0; i < count; ++i) {
    // Even over sphere or cap: equal heights, turned by the golden angle (Vogel 1979).
    const double lowest = from_above ? kLowestAbove : -1.0;
    const double z = count == 1 ? 1.0 : 1.0 - (1.0 - lowest) * (i + 0.5) / count;
    const double turn = 2.0 * std::numbers::pi * i / std::numbers::phi, flat = std::sqrt(1.0 - z * z);
    const Vec3 towards(flat * std::cos(turn), flat * std::sin(turn), z);
    const Vec3 side = std::abs(towards.z()) < 0.9 ? Vec3(Vec3::UnitZ()) : Vec3(Vec3::UnitX());
    ScanView view;
    view.middle = box.centre_mm();
    view.eye = view.middle + kStandOff * radius * towards;
    view.right = side.cross(towards).normalized();
    view.up = towards.cross(view.right);
    // Where a ray tangent to the model's ball meets the middle plane.
    view.half = radius * kStandOff / std::sqrt(kStandOff * kStandOff - 1.0);
    views.push_back(view);
  }
  return views;
}

struct Return {
  Vec3 point = Vec3::Zero(), ray = Vec3::Zero();  ///< ray: unit, away from the scanner
  double range = 0.0;                             ///< negative: no return
  double cosine = 0.0;
};

/// One view's exact returns, row by row.
std::vector<Return> cast_rays(const FirstHit& first_hit, const ScanView& view, std::size_t side) {
  std::vector<Return> returns(side * side);
  parallel_each(side, 1, 0, [&](std::size_t row) {
    for (std::size_t column = 0; column < side; ++column) {
      const auto at = [side](std::size_t i) {
        return 2.0 * (static_cast<double>(i) + 0.5) / static_cast<double>(side) - 1.0;
      };
      Return& r = returns[row * side + column];
      r.range = -1.0;
      const std::optional<geometry::SurfacePoint> hit = first_hit(view.eye, view.end(at(column), at(row)));
      if (!hit) continue;
      r.point = hit->point_mm;
      r.ray = (r.point - view.eye).normalized();
      r.cosine = -r.ray.dot(hit->normal);
      if (r.cosine >= kGrazing) r.range = (r.point - view.eye).norm();
    }
  });
  return returns;
}

std::size_t count_returns(const std::vector<Return>& returns) {
  return static_cast<std::size_t>(
      std::count_if(returns.begin(), returns.end(), [](const Return& r) { return r.range >= 0.0; }));
}

/// The range at `index` of a neighbour behind an edge; 0 if none.
double behind_edge(const std::vector<Return>& returns, std::size_t side, std::size_t index, double spacing) {
  const std::size_t column = index % side;
  for (const std::size_t other : {column + 1 < side ? index + 1 : index, index + side})
    if (other < returns.size() && returns[other].range > returns[index].range + kEdge * spacing)
      return returns[other].range;
  return 0.0;
}

/// Adds one view's errors: each return's own, then the view's.
void measure(const std::vector<Return>& returns, std::size_t side, const ScanView& view, std::uint32_t number,
             double spacing, const ScannerOptions& o, Scanned& scanned) {
  Random whole = random_for(RandomUse::kView, o.seed, number);
  const double reach = 0.5 * view.half;  // turning by registration / reach moves the rim by about that much
  const auto normal3 = [&whole] { return Vec3(whole.normal(), whole.normal(), whole.normal()); };
  const Vec3 shift = o.registration * spacing * normal3() / std::sqrt(3.0);
  const Vec3 turn = o.registration * spacing / reach * normal3() / std::sqrt(3.0);
  const double angle = turn.norm();
  const Eigen::AngleAxisd turned(angle, angle > 0.0 ? Vec3(turn / angle) : Vec3(Vec3::UnitZ()));
  // Edges have more flying points; in total they are at most the requested share.
  std::size_t edges = 0;
  for (std::size_t i = 0; i < returns.size(); ++i)
    edges += returns[i].range >= 0.0 && behind_edge(returns, side, i, spacing) > 0.0 ? 1u : 0u;
  const double all = static_cast<double>(count_returns(returns)), wanted = o.flying * all;
  const double at_edge = edges > 0 ? std::min(1.0, wanted / static_cast<double>(edges)) : 0.0;
  const double elsewhere =
      all > static_cast<double>(edges)
          ? std::max(0.0, wanted - static_cast<double>(edges)) / (all - static_cast<double>(edges))
          : 0.0;
  for (std::size_t i = 0; i < returns.size(); ++i) {
    const Return& r = returns[i];
    if (r.range < 0.0) continue;
    Random random = random_for(RandomUse::kRay, o.seed, number * returns.size() + i);
    if (random.uniform() < o.dropout) continue;
    double range = r.range + spacing * (o.noise * random.normal() +
                                        o.bias * (1.0 / r.cosine - 1.0) / (1.0 / kBiasAt - 1.0));
    const double behind = behind_edge(returns, side, i, spacing);
    if (random.uniform() < (behind > 0.0 ? at_edge : elsewhere))
      range = behind > 0.0 ? random.uniform(r.range, behind)
                           : r.range - spacing * random.uniform(kNearestFlying, kFarthestFlying);
    const Vec3 p = view.eye + range * r.ray;
    scanned.points_mm.push_back(view.middle + turned * (p - view.middle) + shift);
    scanned.view.push_back(number);
  }
}

}  // namespace

std::vector<OptionSpec> scanner_specs(const std::vector<OptionCondition>& only_with) {
  return {
      option::integer("views", "1", "places of the scanner, around the model", 1, 100, only_with),
      option::number("bias", "0", "ranges read longer by so many spacings at 60 degrees of incidence", -100,
                     100, only_with),
      option::number("dropout", "0", "share of the rays that return nothing", 0, 0.9, only_with),
      option::number("flying", "0", "share of the points that hang in the air, behind edges first", 0, 0.9,
                     only_with),
      option::number("registration", "0",
                     "error of each view's place and turn: standard deviation in spacings", 0, 100,
                     only_with),
  };
}

ScannerOptions read_scanner(const Options& options) {
  ScannerOptions o;
  o.views = static_cast<int>(options.integer("views"));
  o.noise = options.number("noise");
  o.bias = options.number("bias");
  o.dropout = options.number("dropout");
  o.flying = options.number("flying");
  o.registration = options.number("registration");
  return o;
}

Result<Scanned> scan(const FirstHit& first_hit, const geometry::Aabb& box, bool from_above,
                     const ScannerOptions& o) {
  const std::vector<ScanView> views = views_of(box, from_above, o.views);
  double seen_mm2 = 0.0;
  std::vector<bool> sees;
  for (const ScanView& view : views) {
    const double seen = static_cast<double>(count_returns(cast_rays(first_hit, view, kTrialSide)));
    const double side = 2.0 * view.half / static_cast<double>(kTrialSide);
    sees.push_back(seen > 0.0);
    seen_mm2 += seen * side * side;
  }
  if (!(seen_mm2 > 0.0))
    return Error{"the simulated scanner sees nothing of the model", "give it more views"};
  Scanned scanned;
  scanned.spacing_mm = std::sqrt(seen_mm2 / o.points);
  for (std::uint32_t i = 0; i < views.size(); ++i) {
    if (!sees[i]) continue;
    const double wanted = std::ceil(2.0 * views[i].half / scanned.spacing_mm);
    if (!(wanted * wanted * static_cast<double>(views.size()) <= kMaxGeneratedPoints))
      return Error{fmt::format("a scan by {} views needs {:.3g} rays each", views.size(), wanted * wanted),
                   fmt::format("at most {} rays a model", kMaxGeneratedPoints)};
    const auto side = static_cast<std::size_t>(std::max(2.0, wanted));
    measure(cast_rays(first_hit, views[i], side), side, views[i], i, scanned.spacing_mm, o, scanned);
  }
  if (scanned.points_mm.empty())
    return Error{"no point of the simulated scan is left", "ask for more points, or less dropout"};
  return scanned;
}

}  // namespace palpate::cloud
