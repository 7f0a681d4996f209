#include "baselines/points/rivals.h"

#include <fmt/format.h>

#include <cmath>
#include <optional>
#include <utility>

#include <palpate/result.h>
#include "baselines/points/implicit_field.h"
#include "baselines/points/rival.h"
#include "toolkit/render/prepare_phases.h"

namespace palpate::baselines {
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
