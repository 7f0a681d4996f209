#include "baselines/points/stream_proxy.h"

#include <fmt/format.h>

#include <cmath>
#include <memory>
#include <utility>
#include <vector>

#include "baselines/points/gaps.h"
#include "baselines/points/near_points.h"
#include "baselines/points/rival.h"
#include "toolkit/partition/dynamic_grid.h"
#include "toolkit/render/prepare_phases.h"

namespace palpate::baselines {
namespace {

/// Steps of the proxy in a frame, at most; the rest is done in the next frame. In contact a frame takes 1 to
/// 4.
constexpr int kMaxSteps = 32;
/// A step along the surface is at most this share of r1: what is at least r1 away stays on its side.
constexpr double kStepShare = 0.5;
/// At rest where the pull along the surface is below this share of the pull: a twentieth of a degree.
constexpr double kRestShare = 1e-3;
/// Flights into a ball at less than this cosine graze it (ball_walk.cpp derives the size).
constexpr double kGraze = 5e-6;

/// Of a grid that follows points, bytes a point more: two links and a bit, and its cells' lists.
constexpr double kFollowBytes = 9.0;

class StreamProxy : public RivalModel {
 public:
  static constexpr RivalText kText{
      "stream-proxy", "a proxy steered by the points within three shells around it, no preparation",
      "Ryden and Chizeck 2013, from public descriptions; flights by segment, tapered weights, offset: ours",
      1.7, 496.0};
  static constexpr bool kGodObject = true;
  static constexpr bool kFollowsPoints = true;
  static std::vector<OptionSpec> specs();
  static Status decide(StreamProxy& model, const render::ModelInput& input, const Options& options,
                       const render::PrepareContext& context, render::PrepareReport& report,
                       render::ModelDecisions& out);
  static Status prepare(StreamProxy& model, const render::ModelInput& input, const Options& options,
                        const render::PrepareContext& context, render::PrepareReport& report);
  [[nodiscard]] std::string work_bound() const;

  void restart(const Vec3& h) noexcept;
  void let_go(const Vec3& h) noexcept;
  [[nodiscard]] RivalAnswer update(const Vec3& h, render::FrameCounters& counters) noexcept;

 private:
  using Grid = partition::DynamicGrid;
  /// What the points around a place say.
  struct Around {
    Vec3 normal = Vec3::Zero();  ///< away from the points, unit; zero without points within r3
    double height = 0.0;         ///< over the points' weighted mean, along the normal
    double nearest = 0.0;        ///< distance; infinite without points
  };
  [[nodiscard]] Around look(const Vec3& at) const noexcept;
  bool walk(const Vec3& h, render::FrameCounters& counters) noexcept;
  void take_moves() noexcept;
  [[nodiscard]] double kept_off() const noexcept { return 0.5 * (r1_ + r2_); }

  PointsIn<Grid> points_;
  std::unique_ptr<NearPoints<Grid>> near_;
  double r1_ = 0.0, r2_ = 0.0, r3_ = 0.0;
  bool tapered_ = true, felt_offset_ = false;
  Vec3 at_ = Vec3::Zero();
  Around around_;
  bool touching_ = false;
  // Of clouds that move.
  std::shared_ptr<render::MoveReader> moves_;
  std::shared_ptr<const cloud::Cloud> original_;
  std::vector<std::uint32_t> place_of_;
  bool moved_ = false;
};

std::vector<OptionSpec> StreamProxy::specs() {
  using enum OptionKind;
  return {
      {"r1",
       kNumber,
       "1.5",
       "nearer points push the proxy out (entrenched), in mean spacings",
       {},
       0.1,
       32.0},
      {"r2", kNumber, "2", "nearer points are touched, in mean spacings; above r1", {}, 0.1, 32.0},
      {"r3", kNumber, "3", "nearer points give the normal, in mean spacings; at least r2", {}, 0.1, 32.0},
      {"spacing_mm", kNumber, "0", "what stands for the mean spacing, in mm; 0: measured", {}, 0.0, 1e12},
      {"weights",
       kChoice,
       "tapered",
       "of the points within r3: equal, as in the source, or falling to 0 at r3",
       {"tapered", "equal"}},
      {"offset",
       kChoice,
       "removed",
       "the distance that the proxy stays off the points: removed (the HIP is a point) or kept, as in the "
       "source (the tool is a sphere)",
       {"removed", "kept"}},
  };
}

Status StreamProxy::decide(StreamProxy& model, const render::ModelInput& input, const Options& options,
                           const render::PrepareContext& context, render::PrepareReport& report,
                           render::ModelDecisions& out) {
  double spacing = options.number("spacing_mm");
  if (spacing > 0.0) {
    say_spacing(spacing, out);
  } else {
    const Gaps gaps = measured_gaps(*input.cloud, context, report);
    say_gaps(gaps, out);
    spacing = gaps.closing_mm();
  }
  model.r1_ = options.number("r1") * spacing;
  model.r2_ = options.number("r2") * spacing;
  model.r3_ = options.number("r3") * spacing;
  if (!(model.r1_ < model.r2_ && model.r2_ <= model.r3_))
    return Error{fmt::format("stream-proxy needs r1 < r2 <= r3, not {} {} {}", options.text("r1"),
                             options.text("r2"), options.text("r3")),
                 "choose for example r1=1:r2=2:r3=3",
                 {},
                 0};
  model.tapered_ = options.text("weights") == "tapered";
  model.felt_offset_ = options.text("offset") == "kept";
  out.decisions.push_back(
      {"shells", fmt::format("{:.4g}, {:.4g} and {:.4g} mm", model.r1_, model.r2_, model.r3_),
       "nearer than the first pushes out, than the second is touched, than the third gives the normal"});
  out.decisions.push_back(model.tapered_
                              ? render::Decision{"weights", "tapered", "points fade in and out"}
                              : render::Decision{"weights", "equal", "as given: the source's", true});
  out.decisions.push_back(
      model.felt_offset_ ? render::Decision{"offset", "kept", "as given: the tool has the proxy's size", true}
                         : render::Decision{"offset", "removed", "the HIP is a point"});
  say_grid(*input.cloud, spacing, model.r3_, out);
  // The grid follows points that move; only where some do, their places are kept.
  out.decisions.push_back(input.moves != nullptr
                              ? render::Decision{"points that move", "followed", "the scene moves them", true}
                              : render::Decision{"points that move", "none", "the scene moves none"});
  out.bytes += static_cast<std::uint64_t>(kFollowBytes * static_cast<double>(out.points)) +
               (input.moves != nullptr ? sizeof(std::uint32_t) * out.points : 0) + NearPoints<Grid>::bytes();
  return Done{};
}

Status StreamProxy::prepare(StreamProxy& model, const render::ModelInput& input, const Options& /*options*/,
                            const render::PrepareContext& context, render::PrepareReport& report) {
  render::PreparePhases phases(report, context);
  phases.begin("grid");
  partition::PartitionOptions grid;
  grid.cell_mm = model.r3_;
  model.points_ = build_points_in<Grid>(*input.cloud, grid, context.threads);
  model.near_ = std::make_unique<NearPoints<Grid>>(model.points_, model.r3_, kStepShare * model.r1_);
  if (input.moves != nullptr) {
    model.moves_ = input.moves->subscribe();
    model.original_ = input.cloud;
    model.place_of_.resize(input.cloud->size());
    const auto order = model.points_.grid.order();
    for (std::uint32_t place = 0; place < order.size(); ++place) model.place_of_[order[place]] = place;
  }
  model.points_.grid.drop_order();
  phases.end();
  report.bytes +=
      model.points_.bytes() + NearPoints<Grid>::bytes() + model.place_of_.capacity() * sizeof(std::uint32_t);
  report.notes.push_back(fmt::format("r1 {:.4g} mm, r2 {:.4g} mm, r3 {:.4g} mm, at most {} points a cell",
                                     model.r1_, model.r2_, model.r3_,
                                     model.points_.grid.statistics().max_points));
  return Done{};
}

std::string StreamProxy::work_bound() const {
  return fmt::format(
      "at most {} steps over at most {} points at hand, found in at most 64 cells each time the proxy is "
      "half "
      "r1 further; flights of at most {} pieces of {:.0f} cells",
      kMaxSteps, kMaxNear, kMaxPieces, kPieceCells);
}

void StreamProxy::restart(const Vec3& h) noexcept {
  if (moved_) {
    // O(n): every point back to where it was prepared.
    for (std::uint32_t i = 0; i < place_of_.size(); ++i) {
      surface::SurfacePoint& point = points_.points[place_of_[i]];
      const Vec3f to(original_->x_mm[i], original_->y_mm[i], original_->z_mm[i]);
      if (points_.grid.move(place_of_[i], to, [&](std::uint32_t) {
            return Vec3f(point.x_mm, point.y_mm, point.z_mm);
          }) == partition::MoveStatus::kFull)
        continue;  // cannot be: it was there before
      point = {to.x(), to.y(), to.z(), surface::kNoNormal};
    }
    moved_ = false;
  }
  let_go(h);
}

void StreamProxy::let_go(const Vec3& h) noexcept {
  at_ = h;
  near_->forget();
  around_ = {};
  touching_ = false;
  state.release();
}

/// A batch of points that moved since the last frame.
void StreamProxy::take_moves() noexcept {
  if (moves_ == nullptr) return;
  const render::MoveBatch* batch = moves_->take();
  if (batch == nullptr) return;
  for (std::uint32_t k = 0; k < batch->count; ++k) {
    const std::uint32_t i = batch->point[k];
    if (i >= place_of_.size()) continue;
    surface::SurfacePoint& point = points_.points[place_of_[i]];
    const Vec3f to = batch->to_mm[k];
    const auto status = points_.grid.move(
        place_of_[i], to, [&](std::uint32_t) { return Vec3f(point.x_mm, point.y_mm, point.z_mm); });
    if (status == partition::MoveStatus::kFull || !to.allFinite()) continue;
    point = {to.x(), to.y(), to.z(), surface::kNoNormal};
    moved_ = true;
  }
  near_->forget();
}

StreamProxy::Around StreamProxy::look(const Vec3& at) const noexcept {
  const double r3_sq = r3_ * r3_;
  double nearest_sq = std::numeric_limits<double>::infinity(), weights = 0.0;
  Vec3 directions = Vec3::Zero(), away = Vec3::Zero();
  for (const Vec3& point : near_->all()) {
    const Vec3 d = at - point;
    const double sq = d.squaredNorm();
    if (sq > r3_sq) continue;
    nearest_sq = std::min(nearest_sq, sq);
    if (!(sq > 0.0)) continue;
    const double fall = 1.0 - sq / r3_sq;
    const double weight = tapered_ ? fall * fall : 1.0;
    directions += d * (weight / std::sqrt(sq));
    away += weight * d;
    weights += weight;
  }
  Around found;
  found.nearest = std::sqrt(nearest_sq);
  const double size = directions.norm();
  if (size > 0.0) {
    found.normal = directions / size;
    found.height = found.normal.dot(away) / weights;
  }
  return found;
}

/// Steps until the proxy is free at the HIP or rests on the points. Returns false where a bound was hit.
bool StreamProxy::walk(const Vec3& h, render::FrameCounters& counters) noexcept {
  const double stride = kStepShare * r1_;
  for (int step = 0; step < kMaxSteps; ++step) {
    ++counters.walk_steps;
    if (!near_->fetch(at_)) return false;
    around_ = look(at_);
    const Vec3 pull = h - at_;
    const double inwards = around_.normal.dot(pull);
    if (around_.nearest < r1_) {
      // Entrenched: out along the normal. A normal of nothing (amid points) has no way out.
      touching_ = true;
      if (around_.normal == Vec3::Zero()) return true;
      at_ += around_.normal * std::min(kept_off() - around_.nearest, stride);
      continue;
    }
    if (around_.nearest > r2_ || inwards >= 0.0) {
      // Free, or leaving. Where nothing is in the way the HIP is reached.
      const Flight flight = fly(points_, kept_off(), kGraze, at_, h);
      const bool moved = flight.at != at_;
      at_ = flight.at;
      touching_ = flight.met;
      if (!flight.met) return flight.finished;
      if (moved) continue;
      if (!near_->fetch(at_)) return false;
    }
    touching_ = true;
    Vec3 along = pull - around_.normal * inwards;
    const double size = along.norm();
    if (!(size > kRestShare * pull.norm())) return true;
    if (size > stride) along *= stride / size;
    at_ += along;
  }
  return false;
}

RivalAnswer StreamProxy::update(const Vec3& h, render::FrameCounters& counters) noexcept {
  take_moves();
  const bool finished = walk(h, counters);
  RivalAnswer answer;
  Vec3 pull = at_ - h;
  if (touching_ && !felt_offset_) pull -= around_.normal * around_.height;
  if (touching_ && around_.normal.dot(pull) > 0.0) answer = {true, false, pull, Vec3::Zero()};
  answer.bound_hit = !finished;
  return answer;
}

}  // namespace

render::RendererInfo stream_proxy_info() {
  return rival_info<StreamProxy>();
}

}  // namespace palpate::baselines
