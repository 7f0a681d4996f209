#include "baselines/points/sphere_proxy.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>

#include "baselines/points/near_points.h"
#include "baselines/points/rival.h"
#include "baselines/rivals.h"
#include "toolkit/render/prepare.h"

namespace palpate::baselines {
namespace {

/// A ball nearer than this share of a radius beyond its surface is touched: far above the rounding of places
/// computed in closed form (1e-15 of the coordinates, which are within some thousand radii), far below a bump
/// that is felt.
constexpr double kTouchShare = 1e-7;
/// The proxy rests if the balls leave less than this share of the pull, a thousandth of a degree.
constexpr double kRestShare = 2e-5;
/// Moves end after this share of a radius, and the balls at hand reach so far beyond the proxy.
constexpr double kStrideShare = 0.5;
/// Rounding of a push between balls, as a share of the pull: 1e-16 times the square of the flattest angle
/// that the half spaces are solved at (1 / 128), and a hundred times that again.
constexpr double kSlackShare = 1e-10;
/// A touched ball that a unit step goes into by more than this stops it: the slack over the rest's share.
constexpr double kIntoShare = kSlackShare / kRestShare;
/// Two touched balls whose centres differ by less than this share of a radius are one.
constexpr double kAgreementShare = 1e-6;

/// The angle, as cosine and sine, at which A cos t + B sin t first rises to C after t = 0; false if it does
/// not within a quarter turn.
struct Turn {
  double cosine = 1.0, sine = 0.0;
};
bool first_rise(double a, double b, double c, Turn& turn) noexcept {
  const double size_sq = a * a + b * b;
  if (!(size_sq > c * c)) return false;
  const double root = std::sqrt(size_sq - c * c);
  turn.cosine = (a * c + b * root) / size_sq;
  turn.sine = (b * c - a * root) / size_sq;
  return turn.cosine >= 0.0 && turn.sine >= 0.0;
}

}  // namespace

BallWalk::BallWalk(const PointGrid& points, double radius_mm)
    : points_(&points),
      radius_(radius_mm),
      near_(points, radius_mm * (1.0 + kTouchShare), kStrideShare * radius_mm) {}

void BallWalk::reset(const Vec3& at) noexcept {
  at_ = at;
  escape();
  near_.forget();
  carried_by_ = 0;
  moves_ = 0;
}

/// A start within balls (nearer to the surface than a radius) is moved away from the nearest point, out of
/// one ball after the other.
void BallWalk::escape() noexcept {
  constexpr int kMaxBalls = 256;  // a straight way out of a layer two radii thick meets far fewer
  Vec3 centre = Vec3::Zero();
  const auto nearest = [&] {
    double best = radius_ * radius_ * (1.0 - kTouchShare);
    bool inside = false;
    points_->within(at_, radius_, [&](std::uint32_t place, double sq) {
      if (sq >= best) return;
      best = sq;
      centre = points_->points[place].at();
      inside = true;
    });
    return inside;
  };
  if (!nearest()) return;
  Vec3 away = at_ - centre;
  away = away.norm() > 0.0 ? Vec3(away.normalized()) : Vec3(Vec3::UnitZ());
  for (int i = 0; i < kMaxBalls; ++i) {
    const Vec3 from = at_ - centre;
    const double along = from.dot(away);
    at_ += away * (std::sqrt(std::max(0.0, along * along + radius_ * radius_ - from.squaredNorm())) - along);
    if (!nearest()) return;
  }
}

/// The pull, less what the touched balls push against: the projection on the cone of free directions.
BallWalk::Hold BallWalk::hold(const Vec3& pull) const noexcept {
  const double touch = radius_ * (1.0 + kTouchShare), same = radius_ * kAgreementShare;
  std::array<geometry::HalfSpace, geometry::kMaxEnumeratedHalfSpaces> planes;
  std::array<Vec3, geometry::kMaxEnumeratedHalfSpaces> centre;
  std::size_t count = 0;
  for (const Vec3& ball : near_.all()) {
    if (count == planes.size()) break;
    const Vec3 out = at_ - ball;
    const double sq = out.squaredNorm();
    if (sq > touch * touch || !(sq > 0.0)) continue;
    bool known = false;
    for (std::size_t k = 0; k < count; ++k) known = known || (centre[k] - ball).squaredNorm() <= same * same;
    if (known) continue;
    planes[count] = {out / std::sqrt(sq), 0.0};
    centre[count++] = ball;
  }
  Hold found;
  const geometry::NearestFeasible free =
      geometry::nearest_feasible({planes.data(), count}, pull, kSlackShare * pull.norm());
  found.way = free.point;
  for (std::size_t k = 0; k < free.active; ++k)
    if (free.push[k] > 0.0) found.centre[static_cast<std::size_t>(found.count++)] = centre[free.plane[k]];
  if (!free.feasible) found.way = Vec3::Zero();
  return found;
}

/// Moves along a circle about `centre` through the proxy (`out` towards it, `along` the way, both unit), up
/// to the place nearest to the goal, a stride, or the first ball met. On a ball of radius `radius` the circle
/// is a great one; between two balls it is where they meet.
void BallWalk::slide(const Vec3& centre, double radius, Vec3 out, Vec3 along, const Vec3& goal,
                     const Hold& hold) noexcept {
  const Vec3 g = goal - centre;
  const double a = out.dot(g), b = along.dot(g);
  const double size = std::sqrt(a * a + b * b);
  const double half = 0.5 * kStrideShare * radius_ / radius;  // sine of half the angle of a stride
  Turn end;
  end.cosine = half * half < 0.5 ? 1.0 - 2.0 * half * half : 0.0;
  end.sine = std::sqrt(1.0 - end.cosine * end.cosine);
  const auto earlier = [&](const Turn& turn) {
    if (turn.cosine >= 0.0 && turn.sine >= 0.0 && turn.sine < end.sine) end = turn;
  };
  if (size > 0.0) earlier({a / size, b / size});
  if (Turn leave; hold.count == 1 && size > radius) {
    // The goal is outside of this ball: it lets go where its tangent plane contains the goal.
    if (first_rise(a, b, radius, leave)) earlier(leave);
  }
  for (const Vec3& ball : near_.all()) {
    const Vec3 to = ball - centre;
    bool held = false;
    for (int k = 0; k < hold.count; ++k) held = held || ball == hold.centre[static_cast<std::size_t>(k)];
    if (held) continue;
    Turn meet;
    const double limit = (radius * radius + to.squaredNorm() - radius_ * radius_) / (2.0 * radius);
    const double a_ball = out.dot(to), b_ball = along.dot(to);
    if (a_ball >= limit) {
      if (b_ball > kIntoShare * radius_) return;  // touched already
    } else if (first_rise(a_ball, b_ball, limit, meet)) {
      earlier(meet);
    }
  }
  at_ = centre + radius * (end.cosine * out + end.sine * along);
}

bool BallWalk::go(const Vec3& goal) noexcept {
  for (int move = 0; move < kMaxBallMoves; ++move) {
    if (!near_.fetch(at_)) return false;
    const Vec3 pull = goal - at_;
    const double pull_sq = pull.squaredNorm();
    if (!(pull_sq > 0.0)) {
      carried_by_ = 0;
      return true;
    }
    const Hold held = hold(pull);
    carried_by_ = held.count;
    if (held.way.squaredNorm() <= kRestShare * kRestShare * pull_sq) return true;
    ++moves_;
    if (held.count == 0) {
      const Flight flight = fly(*points_, radius_, kIntoShare, at_, goal);
      at_ = flight.at;
      if (!flight.met) return flight.finished;
      continue;
    }
    const Vec3 before = at_;
    if (held.count == 1) {
      const Vec3 out = (at_ - held.centre[0]).normalized();
      slide(held.centre[0], radius_, out, (held.way - out * out.dot(held.way)).normalized(), goal, held);
    } else if (held.count == 2) {
      const Vec3 middle = 0.5 * (held.centre[0] + held.centre[1]);
      const Vec3 axis = (held.centre[1] - held.centre[0]).normalized();
      Vec3 out = at_ - middle;
      out -= axis * axis.dot(out);
      const double radius = out.norm();
      if (!(radius > kTouchShare * radius_)) return true;  // the balls touch in one point
      out /= radius;
      Vec3 along = axis.cross(out);
      if (along.dot(pull) < 0.0) along = -along;
      slide(middle, radius, out, along, goal, held);
    } else {
      return true;
    }
    // A move that comes no nearer to its goal is rounding: the proxy rests.
    if (!((goal - at_).squaredNorm() < pull_sq)) {
      at_ = before;
      return true;
    }
  }
  return false;
}

namespace {

/// Edge of the cells in radii; the balls at hand are then found in 27 cells.
constexpr double kCellRadii = 2.0;

class SphereProxy : public RivalModel {
 public:
  static constexpr RivalText kText{
      "sphere-proxy", "every point a ball, among which a ball slides and rests",
      "CHAI3D 3.3's point clouds (cMultiPoint with its finger proxy); Ruspini et al. 1997; exact, ours", 0.97,
      437.0};
  static constexpr bool kGodObject = true;
  static std::vector<OptionSpec> specs() {
    return {
        option::in_spacings("radius", "4", "of the proxy, in mean spacings: larger is smoother, and rounder",
                            0.1, 16.0),
        option::in_mm("radius"),
        offset_spec(),
    };
  }
  Status decide(const RivalInput& given, render::ModelDecisions& out) {
    const auto& [input, options, context, report] = given;
    const double given_mm = options.number("radius_mm");
    double spacing = 0.0;
    if (!(given_mm > 0.0)) spacing = measured_gaps(*input.cloud, context, report, &out).closing_mm();
    radius_mm_ = option::length_mm(options, "radius", spacing);
    felt_offset_ = is_offset_kept(options);
    out.decisions.push_back(
        {"proxy", fmt::format("ball of {:.4g} mm", radius_mm_),
         given_mm > 0.0 ? "as given" : fmt::format("{:.3g} spacings", options.number("radius")),
         given_mm > 0.0});
    out.decisions.push_back(offset_decision(felt_offset_));
    report_grid(*input.cloud, spacing, kCellRadii * radius_mm_, out);
    out.bytes += NearPoints<search::UniformGrid>::bytes_for(false);
    return Done{};
  }
  Status prepare(const RivalInput& given) {
    const auto& [input, options, context, report] = given;
    render::PreparePhases phases(report, context);
    phases.begin("grid");
    points_ = build_point_grid(*input.cloud, kCellRadii * radius_mm_, context.threads);
    walk_ = std::make_unique<BallWalk>(points_, radius_mm_);
    const auto& grid = points_.grid;
    if (may_be_too_many(grid.max_points_per_cell(), grid.cell_mm(), walk_->reach_mm())) {
      const Thinned thin = thinned_to_reach(input.cloud, radius_mm_, walk_->reach_mm(), report);
      if (thin.cell_mm > 0.0)
        points_ = build_point_grid(*thin.cloud, kCellRadii * radius_mm_, context.threads);
    }
    phases.end();
    report.bytes += points_.bytes() + NearPoints<search::UniformGrid>::bytes_for(false);
    report.notes.push_back(fmt::format("radius {:.4g} mm, cell {:.4g} mm, at most {} points a cell",
                                       radius_mm_, points_.grid.cell_mm(),
                                       points_.grid.max_points_per_cell()));
    return Done{};
  }
  [[nodiscard]] std::string work_bound() const {
    return fmt::format(
        "at most {} moves among at most {} balls at hand, found in at most 64 cells each time the proxy is "
        "half a radius further; flights of at most {} pieces of {:.0f} cells (the fullest cell holds {} "
        "points)",
        kMaxBallMoves, kMaxNear, kMaxPieces, kPieceCells,
        points_.points.empty() ? 0 : points_.grid.max_points_per_cell());
  }

  void release_contact(const Vec3& h) noexcept {
    walk_->reset(h);
    state.release();
  }
  [[nodiscard]] RivalAnswer update(const Vec3& h, render::FrameCounters& counters) noexcept {
    const std::uint64_t moves = walk_->moves();
    const bool finished = walk_->go(h);
    counters.walk_steps += walk_->moves() - moves;
    Vec3 pull = walk_->proxy() - h;
    const double length = stable_norm(pull);
    const double felt = felt_offset_ ? length : length - radius_mm_;
    RivalAnswer answer;
    if (felt > 0.0 && walk_->carried_by() > 0) answer = {true, false, pull * (felt / length), Vec3::Zero()};
    answer.bound_hit = !finished;
    return answer;
  }

 private:
  PointGrid points_;
  std::unique_ptr<BallWalk> walk_;
  double radius_mm_ = 0.0;
  bool felt_offset_ = false;
};

}  // namespace

render::RendererInfo sphere_proxy_info() {
  return rival_info<SphereProxy>();
}

}  // namespace palpate::baselines
