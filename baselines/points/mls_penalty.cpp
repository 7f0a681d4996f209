#include "baselines/points/mls_penalty.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "baselines/points/gaps.h"
#include "baselines/points/outward.h"
#include "baselines/points/repeatable_exp.h"
#include "baselines/points/rival.h"
#include "baselines/points/sphere_tree.h"
#include "toolkit/core/tolerances.h"
#include "toolkit/render/prepare_phases.h"
#include "toolkit/surface/least_direction.h"

namespace palpate::baselines {
namespace {

/// Weights below exp(-kCutoff^2) = 1e-4 are left out.
constexpr double kCutoff = 3.0;
/// The points of a projection are fetched once, with room for it to move by so many widths.
constexpr double kRoom = 1.0;
/// Points that are fetched at once, at most: some 120 are usual; where there are more, each sum looks them
/// up.
constexpr std::size_t kMaxFetched = 1024;
/// A kernel is at least so many gaps wide.
constexpr double kKernelGap = 2.0 / 3.0;
/// The projection has converged when it moves by less than this share of the kernel's width.
constexpr double kConvergedShare = 1e-3;

class MlsPenalty : public RivalModel {
 public:
  static constexpr RivalText kText{
      "mls-penalty", "moving-least-squares surface built in the frame, penalty force",
      "Lee and Kim 2007 ([52]) by the thesis's section 2.2.3; projection of Alexa and Adamson 2004", 15.0,
      2'300.0};
  static constexpr bool kGodObject = false;
  static std::vector<OptionSpec> specs();
  static Status decide(MlsPenalty& model, const render::ModelInput& input, const Options& options,
                       const render::PrepareContext& context, render::PrepareReport& report,
                       render::ModelDecisions& out);
  static Status prepare(MlsPenalty& model, const render::ModelInput& input, const Options& options,
                        const render::PrepareContext& context, render::PrepareReport& report);
  [[nodiscard]] std::string work_bound() const;

  void let_go(const Vec3&) noexcept {
    side_.release();
    last_ = kNoPlace;
  }
  [[nodiscard]] RivalAnswer update(const Vec3& h, render::FrameCounters& counters) noexcept;

 private:
  struct Fit {
    bool usable = false;
    Vec3 mean = Vec3::Zero();
    Vec3 normal = Vec3::Zero();
  };
  struct Fetched {
    Vec3 at, normal;  ///< the normal outward, or zero
  };
  struct Sum;
  void fetch(const Vec3& at) noexcept;
  [[nodiscard]] Fit fit(const Vec3& at, const Vec3& like) noexcept;

  LargeVector<surface::SurfacePoint> points_;
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

std::vector<OptionSpec> MlsPenalty::specs() {
  using enum OptionKind;
  return {
      {"width",
       kNumber,
       "1",
       "of the Gaussian kernel, in mean spacings: larger is smoother",
       {},
       0.1,
       16.0,
       {{"width_mm", {"0"}}}},
      {"width_mm", kNumber, "0", "the same in mm; 0: by width", {}, 0.0, 1e12},
      {"reach",
       kNumber,
       "32",
       "the surface is looked for so far from the HIP, in mean spacings",
       {},
       0.1,
       1e6,
       {{"reach_mm", {"0"}}}},
      {"reach_mm", kNumber, "0", "the same in mm; 0: by reach", {}, 0.0, 1e12},
      {"iterations", kInteger, "8", "of the projection, at most", {}, 1, 64},
      {"normals",
       kChoice,
       "weighted",
       "of the surface: mean of the points' normals, or the plane of least squares",
       {"weighted", "covariance"}},
  };
}

Status MlsPenalty::decide(MlsPenalty& model, const render::ModelInput& input, const Options& options,
                          const render::PrepareContext& context, render::PrepareReport& report,
                          render::ModelDecisions& out) {
  const Gaps gaps = measured_gaps(*input.cloud, context, report);
  // At two thirds of a gap a kernel still sees the points around its middle with a tenth of their weight.
  const double spacing = std::max(gaps.spacing_mm, kKernelGap * gaps.closing_mm());
  const auto length = [&](const char* in_mm, const char* in_spacings) {
    return options.number(in_mm) > 0.0 ? options.number(in_mm) : options.number(in_spacings) * spacing;
  };
  model.width_mm_ = length("width_mm", "width");
  model.reach_mm_ = length("reach_mm", "reach");
  model.iterations_ = static_cast<int>(options.integer("iterations"));
  model.covariance_ = options.text("normals") == "covariance";
  model.neighbours_ = gaps.neighbours();
  say_gaps(gaps, out);
  say_normals(*input.cloud, model.neighbours_, out);
  out.decisions.push_back(
      {"kernel", fmt::format("{:.4g} mm wide", model.width_mm_),
       fmt::format("at most {} projections by {}", model.iterations_,
                   model.covariance_ ? "the plane of least squares" : "the mean of the points' normals")});
  out.decisions.push_back({"partition", "tree of spheres",
                           fmt::format("{} points a leaf; the surface is looked for within {:.4g} mm",
                                       kPointsPerSphere, model.reach_mm_)});
  out.bytes += out.points * sizeof(surface::SurfacePoint) + SphereTree::bytes_for(out.points);
  return Done{};
}

Status MlsPenalty::prepare(MlsPenalty& model, const render::ModelInput& input, const Options& /*options*/,
                           const render::PrepareContext& context, render::PrepareReport& report) {
  render::PreparePhases phases(report, context);
  Result<OrientedGrid> built =
      build_oriented_grid(input, kCutoff * model.width_mm_, model.neighbours_, false, context, report);
  if (!built) return std::move(built).error();
  model.points_ = std::move(built->points.points);
  phases.begin("sphere tree");
  model.tree_.build(model.points_, context.threads);
  phases.end();
  report.bytes += model.points_.capacity() * sizeof(surface::SurfacePoint) + model.tree_.bytes();
  report.notes.push_back(
      fmt::format("kernel {:.4g} mm wide, surface looked for within {:.4g} mm, {} levels of spheres",
                  model.width_mm_, model.reach_mm_, model.tree_.levels()));
  return Done{};
}

std::string MlsPenalty::work_bound() const {
  return fmt::format(
      "unbounded: at most {} sums over all points within {:.0f} kernel widths, and one search through a tree "
      "of {} "
      "levels; both grow with the points in reach",
      iterations_, kCutoff, tree_.levels());
}

/// Weighted sums over points around a place.
struct MlsPenalty::Sum {
  Vec3 at;
  double per_width_sq;
  bool covariance;
  double weights = 0.0;
  Vec3 mean = Vec3::Zero(), normals = Vec3::Zero();
  surface::Symmetric square{};

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

void MlsPenalty::fetch(const Vec3& at) noexcept {
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
MlsPenalty::Fit MlsPenalty::fit(const Vec3& at, const Vec3& like) noexcept {
  Sum sum{at, 1.0 / (width_mm_ * width_mm_), covariance_};
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
  const Vec3& normals = sum.normals;
  const surface::Symmetric& square = sum.square;
  Vec3 mean = sum.mean;
  Fit found;
  if (!(weights > 0.0)) return found;
  mean /= weights;
  found.mean = at + mean;
  if (covariance_) {
    const surface::Symmetric spread{
        square.xx / weights - mean.x() * mean.x(), square.xy / weights - mean.x() * mean.y(),
        square.xz / weights - mean.x() * mean.z(), square.yy / weights - mean.y() * mean.y(),
        square.yz / weights - mean.y() * mean.z(), square.zz / weights - mean.z() * mean.z()};
    if (!surface::least_direction(spread, found.normal)) return found;
    if (found.normal.dot(like) < 0.0) found.normal = -found.normal;
    found.usable = true;
    return found;
  }
  const double size = normals.norm();
  if (!(size > 0.0)) return found;
  found.normal = normals / size;
  found.usable = true;
  return found;
}

RivalAnswer MlsPenalty::update(const Vec3& h, render::FrameCounters& counters) noexcept {
  double most = reach_mm_;
  if (last_ != kNoPlace) most = std::min(most, safe_length(points_[last_].at() - h) * (1.0 + gamma(8)));
  const std::uint32_t near = last_ = tree_.nearest(h, most);
  if (near == kNoPlace) {
    side_.release();
    return {};
  }
  // The projection starts at the point nearest to the HIP, which is on the surface but for noise.
  const surface::SurfacePoint& start = points_[near];
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
    // Almost orthogonal: the HIP on to the plane of this place.
    const Vec3 foot = h - here.normal * here.normal.dot(h - here.mean);
    const double moved_sq = (foot - at).squaredNorm();
    at = foot;
    if (moved_sq <= kConvergedShare * kConvergedShare * width_mm_ * width_mm_) break;
  }
  if (!here.usable) return {};
  const double depth = here.normal.dot(here.mean - h);
  if (!(depth > 0.0)) return {};
  return {true, false, depth * here.normal, surface.stiffness_n_per_mm * depth * here.normal};
}

}  // namespace

render::RendererInfo mls_penalty_info() {
  return rival_info<MlsPenalty>();
}

}  // namespace palpate::baselines
