#include "baselines/rivals.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include <palpate/result.h>
#include "baselines/points/point_grid.h"
#include "baselines/points/rival.h"
#include "toolkit/core/tolerances.h"
#include "toolkit/render/prepare.h"
#include "toolkit/surface/smallest_eigenvector.h"

namespace palpate::baselines {
namespace {

/// Weights below exp(-kCutoff^2) = 1e-4 are left out.
constexpr double kCutoff = 3.0;
/// The points of a projection are fetched once, with room for it to move by so many widths.
constexpr double kRoom = 1.0;
/// Most points that are fetched at once; some 120 are usual. Each sum looks them up if there are more.
constexpr std::size_t kMaxFetched = 1024;
/// Least width of a kernel in gaps.
constexpr double kKernelGap = 2.0 / 3.0;
/// The projection has converged when it moves by less than this share of the kernel's width.
constexpr double kConvergedShare = 1e-3;

/// e^x for x <= 0, bit-identical everywhere: C libraries choose by processor among versions that differ in
/// the last place, which would change trace hashes. It has a relative error below 1e-15; 0 below -700 (under
/// 1e-304). Only sums and products of doubles, each rounded once. noexcept, allocates nothing.
double repeatable_exp(double x) noexcept {
  constexpr double kLeast = -700.0;
  if (!(x > kLeast)) return 0.0;
  // x = n ln 2 + r with |r| <= ln 2 / 2. The high part of ln 2 ends in zeros, so n times it is exact.
  constexpr double kPerLn2 = 1.4426950408889634, kLn2High = 6.93147180369123816490e-01,
                   kLn2Low = 1.90821492927058770002e-10;
  const double n = std::nearbyint(x * kPerLn2);
  const double r = (x - n * kLn2High) - n * kLn2Low;
  // Taylor series; the first omitted term is r^14 / 14!, 4e-18.
  constexpr int kTerms = 13;
  double sum = 1.0;
  for (int k = kTerms; k > 0; --k) sum = 1.0 + sum * r / k;
  return std::ldexp(sum, static_cast<int>(n));
}

/// Weighted sums over points around a place.
struct WeightedSum {
  Vec3 at;
  double per_width_sq;
  bool covariance;
  double weights = 0.0;
  Vec3 mean = Vec3::Zero(), normals = Vec3::Zero();
  surface::SymmetricMatrix3 square{};

  void add(const Vec3& point, const Vec3& normal, double sq) noexcept {
    const double weight = repeatable_exp(-sq * per_width_sq);
    const Vec3 d = point - at;
    weights += weight;
    mean += weight * d;
    if (!covariance) {
      normals += weight * normal;
      return;
    }
    square.add(d, weight);
  }
};

class MlsPenalty : public RivalModel {
 public:
  static constexpr RivalText kText{
      "mls-penalty", "a push out of a surface fitted to near points each frame",
      "Lee and Kim 2007 ([52]) by the thesis's section 2.2.3; projection of Alexa and Adamson 2004", 15.0,
      2'300.0};
  static constexpr bool kGodObject = false;
  static std::vector<OptionSpec> specs() {
    return {
        option::in_spacings("width", "1", "of the Gaussian kernel, in mean spacings: larger is smoother", 0.1,
                            16.0),
        option::in_mm("width"),
        option::in_spacings("reach", "32", "the surface is looked for so far from the HIP, in mean spacings",
                            0.1, 1e6),
        option::in_mm("reach"),
        option::integer("iterations", "8", "of the projection, at most", 1, 64),
        option::choice("normals", "weighted",
                       "of the surface: mean of the points' normals, or the plane of least squares",
                       {"weighted", "covariance"}),
    };
  }
  Status decide(const RivalInput& given, render::ModelDecisions& out) {
    const auto& [input, options, context, report] = given;
    const Gaps gaps = measured_gaps(*input.cloud, context, report, &out);
    // A kernel of two thirds of a gap still sees the points around its middle with a tenth of their weight.
    const double spacing = std::max(gaps.spacing_mm, kKernelGap * gaps.closing_mm());
    width_mm_ = option::length_mm(options, "width", spacing);
    reach_mm_ = option::length_mm(options, "reach", spacing);
    iterations_ = static_cast<int>(options.integer("iterations"));
    covariance_ = options.text("normals") == "covariance";
    neighbours_ = gaps.neighbours();
    report_normals(*input.cloud, neighbours_, out);
    out.decisions.push_back(
        {"kernel", fmt::format("{:.4g} mm wide", width_mm_),
         fmt::format("at most {} projections by {}", iterations_,
                     covariance_ ? "the plane of least squares" : "the mean of the points' normals")});
    out.decisions.push_back({"partition", "tree of spheres",
                             fmt::format("{} points a leaf; the surface is looked for within {:.4g} mm",
                                         kPointsPerSphere, reach_mm_)});
    out.bytes += out.points * sizeof(surface::OrientedPoint) + SphereTree::bytes_for(out.points);
    return Done{};
  }
  Status prepare(const RivalInput& given) {
    const auto& [input, options, context, report] = given;
    render::PreparePhases phases(report, context);
    PALPATE_ASSIGN(OrientedGrid built,
                   build_oriented_grid(input, kCutoff * width_mm_, neighbours_, false, context, report));
    points_ = std::move(built.points.points);
    phases.begin("sphere tree");
    tree_.build(points_, context.threads);
    phases.end();
    report.bytes += points_.capacity() * sizeof(surface::OrientedPoint) + tree_.bytes();
    report.notes.push_back(
        fmt::format("kernel {:.4g} mm wide, surface looked for within {:.4g} mm, {} levels of spheres",
                    width_mm_, reach_mm_, tree_.levels()));
    return Done{};
  }
  [[nodiscard]] std::string work_bound() const {
    return fmt::format(
        "unbounded: at most {} sums over all points within {:.0f} kernel widths, and one search through a "
        "tree of {} levels; both grow with the points in reach",
        iterations_, kCutoff, tree_.levels());
  }

  void release_contact(const Vec3&) noexcept {
    side_.release();
    last_ = kNoPlace;
  }
  [[nodiscard]] RivalAnswer update(const Vec3& h, render::FrameCounters& counters) noexcept {
    double most = reach_mm_;
    if (last_ != kNoPlace) most = std::min(most, stable_norm(points_[last_].at() - h) * (1.0 + gamma(8)));
    const std::uint32_t near = last_ = tree_.nearest(h, most);
    if (near == kNoPlace) {
      side_.release();
      return {};
    }
    // The projection starts at the point nearest to the HIP, which is on the surface but for noise.
    const surface::OrientedPoint& start = points_[near];
    side_.choose(start.normal, h - start.at());
    const Vec3 like = side_.normal(start.normal);
    if (like == Vec3::Zero()) return {};
    Vec3 at = start.at();
    fetch(at);
    Fit here;
    for (int i = 0; i < iterations_; ++i) {
      ++counters.walk_steps;
      const Fit next = fit(at, like);
      if (!next.usable) break;
      here = next;
      // The step is almost orthogonal: it takes the HIP's projection on the plane of this place.
      const Vec3 closest = h - here.normal * here.normal.dot(h - here.mean);
      const double moved_sq = (closest - at).squaredNorm();
      at = closest;
      if (moved_sq <= kConvergedShare * kConvergedShare * width_mm_ * width_mm_) break;
    }
    if (!here.usable) return {};
    const double depth = here.normal.dot(here.mean - h);
    if (!(depth > 0.0)) return {};
    return {true, false, depth * here.normal, surface.stiffness_n_per_mm * depth * here.normal};
  }

 private:
  struct Fit {
    bool usable = false;
    Vec3 mean = Vec3::Zero();
    Vec3 normal = Vec3::Zero();
  };
  struct Fetched {
    Vec3 at, normal;  ///< the normal outward, or zero
  };
  void fetch(const Vec3& at) noexcept {
    fetched_count_ = 0;
    fetched_at_ = at;
    fetched_all_ = true;
    tree_.within(at, (kCutoff + kRoom) * width_mm_, [&](std::uint32_t i, double) {
      if (fetched_count_ == kMaxFetched)
        fetched_all_ = false;
      else
        fetched_[fetched_count_++] = {points_[i].at(), side_.normal(points_[i].normal)};
    });
  }
  /// The weighted mean of the points around `at`, and the normal there, on the side of `like`.
  [[nodiscard]] Fit fit(const Vec3& at, const Vec3& like) noexcept {
    WeightedSum sum{at, 1.0 / (width_mm_ * width_mm_), covariance_};
    const double cutoff = kCutoff * width_mm_, room = kRoom * width_mm_;
    if ((at - fetched_at_).squaredNorm() > room * room) fetch(at);
    if (fetched_all_) {
      for (std::size_t i = 0; i < fetched_count_; ++i) {
        const double sq = (fetched_[i].at - at).squaredNorm();
        if (sq <= cutoff * cutoff) sum.add(fetched_[i].at, fetched_[i].normal, sq);
      }
    } else {
      tree_.within(at, cutoff, [&](std::uint32_t i, double sq) {
        sum.add(points_[i].at(), side_.normal(points_[i].normal), sq);
      });
    }
    const double weights = sum.weights;
    Fit found;
    if (!(weights > 0.0)) return found;
    const Vec3 mean = sum.mean / weights;
    found.mean = at + mean;
    if (covariance_) {
      const surface::SymmetricMatrix3 spread{
          sum.square.xx / weights - mean.x() * mean.x(), sum.square.xy / weights - mean.x() * mean.y(),
          sum.square.xz / weights - mean.x() * mean.z(), sum.square.yy / weights - mean.y() * mean.y(),
          sum.square.yz / weights - mean.y() * mean.z(), sum.square.zz / weights - mean.z() * mean.z()};
      if (!surface::smallest_eigenvector(spread, found.normal)) return found;
      if (found.normal.dot(like) < 0.0) found.normal = -found.normal;
      found.usable = true;
      return found;
    }
    const double size = sum.normals.norm();
    if (!(size > 0.0)) return found;
    found.normal = sum.normals / size;
    found.usable = true;
    return found;
  }

  LargePageVector<surface::OrientedPoint> points_;
  SphereTree tree_;
  double width_mm_ = 0.0, reach_mm_ = 0.0;
  int iterations_ = 1;
  bool covariance_ = false;
  std::string neighbours_;  ///< for preparation
  OutwardSide side_;
  std::uint32_t last_ = kNoPlace;  ///< nearest in the last frame: this frame's is no further
  std::array<Fetched, kMaxFetched> fetched_;
  std::size_t fetched_count_ = 0;
  Vec3 fetched_at_ = Vec3::Zero();
  bool fetched_all_ = false;
};

}  // namespace

render::RendererInfo mls_penalty_info() {
  return rival_info<MlsPenalty>();
}

}  // namespace palpate::baselines
