#include "baselines/points/mls_proxy.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <utility>

#include <palpate/result.h>
#include "baselines/points/rival.h"
#include "baselines/rivals.h"
#include "toolkit/render/prepare.h"

namespace palpate::baselines {
namespace {

constexpr std::size_t kPointsPerChunk = 8192;

/// A weight and its slope, of q = distance / radius in [0, 1).
struct Weight {
  double value, slope;
};
Weight weight_at(ImplicitWeight kind, double q) noexcept {
  if (kind == ImplicitWeight::kWyvill) {
    const double s = q * q;
    return {1.0 + s * (-22.0 / 9.0 + s * (17.0 / 9.0 - s * (4.0 / 9.0))),
            q * (-44.0 / 9.0 + s * (68.0 / 9.0 - s * (24.0 / 9.0)))};
  }
  const double left = 1.0 - q, cubed = left * left * left;
  return {cubed * left * (4.0 * q + 1.0), -20.0 * q * cubed};
}

/// The mean distance of a point to its nearest neighbours elsewhere; 0 where it has none.
double mean_nearest(std::span<const surface::OrientedPoint> points, const search::Neighbours& around,
                    std::size_t self) {
  std::array<double, kRadiusNeighbours> least;  // ascending
  least.fill(std::numeric_limits<double>::infinity());
  for (const std::uint32_t other : around) {
    double d = (points[other].at() - points[self].at()).norm();
    if (!(d > 0.0)) continue;
    for (double& kept : least)
      if (d < kept) std::swap(d, kept);
  }
  double sum = 0.0, count = 0.0;
  for (const double d : least) {
    if (!std::isfinite(d)) continue;
    sum += d;
    count += 1.0;
  }
  return count > 0.0 ? sum / count : 0.0;
}

double farthest(std::span<const surface::OrientedPoint> points, const search::Neighbours& around,
                std::size_t self) {
  double most_sq = 0.0;
  for (const std::uint32_t other : around)
    most_sq = std::max(most_sq, (points[other].at() - points[self].at()).squaredNorm());
  return std::sqrt(most_sq);
}

}  // namespace

void ImplicitField::build(PointGrid points, std::span<const search::Neighbours> neighbours,
                          const ImplicitOptions& options, int threads) {
  points_ = std::move(points);
  options_ = options;
  const std::size_t n = points_.points.size();
  radius_.resize(n);
  std::vector<double> sum((n + kPointsPerChunk - 1) / kPointsPerChunk, 0.0), most(sum.size(), 0.0);
  parallel_chunks(n, kPointsPerChunk, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      double radius = kRadiusSpacings * mean_nearest(points_.points, neighbours[i], i);
      if (options_.across)
        radius = std::max(radius, kAcrossShare * farthest(points_.points, neighbours[i], i));
      if (!(radius > 0.0)) radius = points_.cell_mm() / kActiveRadii;  // a point alone
      radius_[i] = static_cast<float>(radius);
      sum[begin / kPointsPerChunk] += radius;
      most[begin / kPointsPerChunk] = std::max(most[begin / kPointsPerChunk], radius);
    }
  });
  double total = 0.0;
  for (std::size_t chunk = 0; chunk < sum.size(); ++chunk) {
    total += sum[chunk];
    largest_ = std::max(largest_, most[chunk]);
  }
  active_ = kActiveRadii * total / static_cast<double>(n);
  reach_ = std::min(active_, largest_);
}

ImplicitValue ImplicitField::at(const Vec3& place, const OutwardSide& side) const noexcept {
  double weights = 0.0;
  Vec3 mean = Vec3::Zero(), normals = Vec3::Zero(), slope = Vec3::Zero();
  points_.within(place, reach_, [&](std::uint32_t i, double sq) {
    const double radius = static_cast<double>(radius_[i]);
    if (!(sq < radius * radius)) return;
    const surface::OrientedPoint& point = points_.points[i];
    const Vec3 d = point.at() - place;
    const double distance = std::sqrt(sq);
    const Weight w = weight_at(options_.weight, distance / radius);
    weights += w.value;
    if (options_.surface == ImplicitSurface::kMetaball) {
      if (distance > 0.0) slope += d * (w.slope / (radius * distance));
      return;
    }
    mean += w.value * d;
    normals += w.value * side.normal(point.normal);
  });
  ImplicitValue found;
  if (!(weights > 0.0)) return found;
  if (options_.surface == ImplicitSurface::kMetaball) {
    found.f = options_.level - weights;
    found.gradient = slope;
  } else {
    const Vec3 normal = normals / weights;
    const double size = normal.norm();
    if (!(size > 0.0)) return found;
    // The mean normal is not made a unit vector again in f, as in the source.
    found.f = -normal.dot(mean / weights);
    found.gradient = normal / size;
  }
  found.defined = found.gradient.squaredNorm() > 0.0;
  return found;
}

std::uint32_t ImplicitField::nearest(const Vec3& place) const noexcept {
  std::uint32_t best = kNoPlace;
  double best_sq = std::numeric_limits<double>::infinity();
  points_.within(place, active_, [&](std::uint32_t i, double sq) {
    if (sq >= best_sq) return;
    best_sq = sq;
    best = i;
  });
  return best;
}

namespace {

/// The source's constants. Its convergence limit is an absolute 1e-5; here a share of the active radius, or
/// of a metaball's unit weight.
constexpr double kConverged = 1e-5;
constexpr double kNewShare = 0.4, kOldShare = 0.6;  ///< of the normal, each tick
constexpr double kStepShare = 0.5;                  ///< of the active radius: the longest step of a tick
constexpr int kHalvings = 8;                        ///< towards the place of entry
/// Newton steps of a projection; more is a failure. Five reach the limit from half an active radius.
constexpr int kMaxNewton = 16;

class MlsProxy : public RivalModel {
 public:
  static constexpr RivalText kText{
      "mls-proxy", "a proxy kept on an implicit surface through the points",
      "Leeper, Chan and Salisbury 2012; constants of their public program; Salisbury and Tarr 1997", 18.0,
      1'630.0};
  static constexpr bool kGodObject = true;
  static std::vector<OptionSpec> specs() {
    return {
        option::choice("surface", "surfel",
                       "the implicit function: oriented points by moving least squares, or metaballs",
                       {"surfel", "metaball"}),
        option::choice("weight", "wyvill", "of a point by its distance", {"wyvill", "wendland"}),
        option::number("level", "0.5", "of metaballs: the sum of weights on the surface", 1e-3, 1e3,
                       {{"surface", {"metaball"}}}),
        option::integer("ticks", "5", "of the proxy a frame: the source's loop sleeps 200 us", 1, 100),
    };
  }
  Status decide(const RivalInput& given, render::ModelDecisions& out) {
    const auto& [input, options, context, report] = given;
    const Gaps gaps = measured_gaps(*input.cloud, context, report, &out);
    spacing_mm_ = gaps.spacing_mm;
    neighbours_ = gaps.neighbours();
    across_ = gaps.lines;
    surface_ = options.text("surface") == "metaball" ? ImplicitSurface::kMetaball : ImplicitSurface::kSurfel;
    weight_ = options.text("weight") == "wyvill" ? ImplicitWeight::kWyvill : ImplicitWeight::kWendland;
    ticks_ = static_cast<int>(options.integer("ticks"));
    report_normals(*input.cloud, neighbours_, out);
    out.decisions.push_back(
        surface_ == ImplicitSurface::kMetaball
            ? render::Decision{"surface", "metaball", "as given: a skin around the points", true}
            : render::Decision{"surface", "surfel", "moving least squares over oriented points"});
    out.decisions.push_back(
        {"radii", fmt::format("{:.3g} mean distances to the {} nearest", kRadiusSpacings, kRadiusNeighbours),
         across_
             ? "and at least to the next scan line, 1.5 times; points are looked for within three mean radii"
             : "each point has its own; points are looked for within three mean radii"});
    out.decisions.push_back({"ticks", fmt::format("{} a frame", ticks_), "of the proxy"});
    report_grid(*input.cloud, spacing_mm_, kRadiusSpacings * spacing_mm_, out);
    out.bytes += out.points * sizeof(float);
    return Done{};
  }
  Status prepare(const RivalInput& given) {
    const auto& [input, options, context, report] = given;
    render::PreparePhases phases(report, context);
    PALPATE_ASSIGN(OrientedGrid built, build_oriented_grid(input, kRadiusSpacings * spacing_mm_, neighbours_,
                                                           true, context, report));
    phases.begin("radii");
    field_.build(std::move(built.points), built.neighbours,
                 {surface_, weight_, options.number("level"), across_}, context.threads);
    phases.end();
    converged_ = kConverged * (surface_ == ImplicitSurface::kMetaball ? 1.0 : field_.active_mm());
    report.bytes += field_.bytes();
    report.notes.push_back(fmt::format("active radius {:.4g} mm, points' radii up to {:.4g} mm",
                                       field_.active_mm(), field_.largest_radius_mm()));
    return Done{};
  }
  [[nodiscard]] std::string work_bound() const {
    return fmt::format(
        "unbounded: at most {} sums over all points within the active radius, whatever their number (the "
        "fullest cell of the first model holds {})",
        ticks_ * (kMaxNewton + 2) + kHalvings,
        field_.points().points.empty() ? 0 : field_.points().grid.max_points_per_cell());
  }

  void release_contact(const Vec3& h) noexcept {
    previous_ = h;
    touching_ = false;
    side_.release();
    state.release();
  }
  [[nodiscard]] RivalAnswer update(const Vec3& h, render::FrameCounters& counters) noexcept {
    if (!touching_) look_for_contact(h);
    for (int tick = 0; tick < ticks_ && touching_; ++tick) {
      ++counters.walk_steps;
      track(h);
    }
    previous_ = h;
    if (!touching_) return {};
    return {true, false, proxy_.at - h, Vec3::Zero()};
  }

 private:
  /// A place on the surface and the unit normal there.
  struct OnSurface {
    Vec3 at, normal;
  };
  /// Newton's steps to f = 0. Nothing if the function is undefined or the steps do not converge.
  [[nodiscard]] std::optional<OnSurface> project(Vec3 at) const noexcept {
    for (int i = 0; i < kMaxNewton; ++i) {
      const ImplicitValue value = field_.at(at, side_);
      if (!value.defined) return std::nullopt;
      const double slope_sq = value.gradient.squaredNorm();
      if (std::abs(value.f) <= converged_) return OnSurface{at, value.gradient / std::sqrt(slope_sq)};
      at -= value.gradient * (value.f / slope_sq);
    }
    return std::nullopt;
  }
  void look_for_contact(const Vec3& h) noexcept {
    if (!side_.chosen()) {
      const std::uint32_t near = field_.nearest(h);
      if (near == kNoPlace) return;
      side_.choose(field_.points().points[near].normal, h - field_.points().points[near].at());
    }
    const ImplicitValue here = field_.at(h, side_);
    if (!here.defined) {
      side_.release();
      return;
    }
    if (!(here.f < 0.0)) return;
    // The place of entry lies between outside (also where no point reaches) and inside.
    Vec3 outside = previous_, inside = h;
    for (int i = 0; i < kHalvings; ++i) {
      const Vec3 middle = 0.5 * (outside + inside);
      const ImplicitValue value = field_.at(middle, side_);
      (value.defined && value.f < 0.0 ? inside : outside) = middle;
    }
    const std::optional<OnSurface> entry = project(inside);
    if (!entry) return;
    proxy_ = *entry;
    touching_ = true;
  }
  /// One tick in contact.
  void track(const Vec3& h) noexcept {
    const Vec3 to = h - proxy_.at;
    const double height = proxy_.normal.dot(to);
    if (height > 0.0) {
      touching_ = false;
      return;
    }
    Vec3 along = to - proxy_.normal * height;
    const double most = kStepShare * field_.active_mm(), size = along.norm();
    if (size > most) along *= most / size;
    Vec3 next = proxy_.at + along;
    const ImplicitValue value = field_.at(next, side_);
    if (!value.defined)
      next = proxy_.at;  // no neighbour there: only the place before has one
    else if (value.f < 0.0)
      next = proxy_.at + 0.5 * along;  // a concavity: averaged with the place before
    const std::optional<OnSurface> on = project(next);
    if (!on) {
      touching_ = false;  // the source drops the contact: a pop-through where the HIP is still inside
      return;
    }
    const Vec3 normal = kNewShare * on->normal + kOldShare * proxy_.normal;
    const double length = normal.norm();
    proxy_ = {on->at, length > 0.0 ? Vec3(normal / length) : on->normal};
  }

  ImplicitField field_;
  double converged_ = 0.0;
  int ticks_ = 1;
  double spacing_mm_ = 0.0;  ///< this and what follows: for preparation
  std::string neighbours_;
  bool across_ = false;
  ImplicitSurface surface_ = ImplicitSurface::kSurfel;
  ImplicitWeight weight_ = ImplicitWeight::kWyvill;
  OutwardSide side_;
  Vec3 previous_ = Vec3::Zero();  ///< HIP of the last frame
  bool touching_ = false;
  OnSurface proxy_{Vec3::Zero(), Vec3::UnitZ()};
};

}  // namespace

render::RendererInfo mls_proxy_info() {
  return rival_info<MlsProxy>();
}

}  // namespace palpate::baselines
