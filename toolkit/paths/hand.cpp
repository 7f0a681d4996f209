#include "toolkit/paths/hand.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <utility>
#include <vector>

#include <palpate/result.h>
#include "toolkit/core/random.h"
#include "toolkit/paths/path_shapes.h"
#include "toolkit/paths/visible_surface.h"

namespace palpate::paths {
namespace {

// Step of the simulation: a haptic frame, and at most a tenth of the damper's time constant.
constexpr double kStepS = 1e-3, kStepsPerTimeConstant = 10.0;
// A hand averages directions over some hundredths of a second.
constexpr double kFeelS = 0.02;
// The press force swings by 0.45 around 0.55 of the hardest, once in 1.3 s.
constexpr double kMeanPress = 0.55, kPressSwing = 0.45, kPressS = 1.3;
// Shares of the hardest press: down to an unfelt surface, up in contact, up above it.
constexpr double kDown = 0.4, kUp = 0.65, kAbove = 0.15;
// Height of a lift, in depths of the hardest press.
constexpr double kLiftDepths = 1.7;
// Times between lifts (mean), of a lift, between changes of speed, between checks for being stuck.
constexpr double kBetweenLiftsS = 1.8, kShortestLiftS = 0.12, kLongestLiftS = 0.32, kPaceS = 0.7,
                 kStuckS = 0.4;
// Share of lifts that are taps: short touches at one place.
constexpr double kTapShare = 1.0 / 3.0, kTapS = 0.15;
constexpr int kMinTaps = 2, kMaxTaps = 4;
// Random change of heading per millisecond, turn into the surface, least tangential part.
constexpr double kWander = 0.03, kTurnIn = 0.02, kMinTangent = 0.05;
// A way shorter than this share of the intended one means stuck, in a corner or at a wall.
constexpr double kStuckShare = 0.3;
// Limits: speed in fastest strokes, and depth behind the points in press depths, beyond which the felt
// surface has lost the hand.
constexpr double kFastest = 2.5, kTooDeep = 3.0;
// A point within this many fit radii of a rim corner is at the border.
constexpr double kRimRadii = 1.5;
// Inward distance, in distances to the middle of the surrounding points.
constexpr double kInwards = 2.0;
// A HIP less than 60 degrees off the normal is above a point, not beside it.
constexpr double kAboveShare = 0.5;
// Free for longer than this, it returns to the last contact.
constexpr double kLostS = 0.5;
constexpr double kRoundedUp = 1e-9;  // of a ratio of two rounded times

Vec3 any_direction(Random& random) {
  return Vec3(random.normal(), random.normal(), random.normal()).normalized();
}

/// The border corners of a mesh, at holes or unseen parts of a scan.
std::optional<cloud::Cloud> rim_of(const geometry::TriangleMesh* mesh) {
  if (mesh == nullptr) return std::nullopt;
  std::vector<std::pair<std::uint32_t, std::uint32_t>> edges;
  for (const auto& t : mesh->triangles)
    for (std::size_t k = 0; k < 3; ++k) edges.push_back(std::minmax(t[k], t[(k + 1) % 3]));
  std::sort(edges.begin(), edges.end());
  std::vector<Vec3> corners;
  for (std::size_t i = 0; i < edges.size();) {
    std::size_t end = i + 1;
    while (end < edges.size() && edges[end] == edges[i]) ++end;
    if (end == i + 1) corners.push_back(mesh->vertices_mm[edges[i].first]);
    i = end;
  }
  if (corners.empty()) return std::nullopt;
  Result<cloud::Cloud> rim = cloud::build_cloud(corners, cloud::NonFinite::kDrop);
  return rim ? std::optional(*std::move(rim)) : std::nullopt;
}

}  // namespace

struct Hand::State {
  State(const PathTarget& target, const HandOptions& options, FitSearch fitting, bool open,
        const PathStart& at)
      : origin_mm_(target.cloud->origin_mm),
        options_(options),
        fitting_(std::move(fitting)),
        open_(open),
        rim_(rim_of(target.mesh)),
        random_(options.seed),
        damping_(target.stiffness_n_per_mm / (2.0 * std::numbers::pi * options.bandwidth_hz)),
        depth_mm_(options.force_n / target.stiffness_n_per_mm),
        phase_(2.0 * std::numbers::pi * random_.uniform()),
        h_(at.hip),
        normal_(at.outward),
        back_(at.hip),
        touched_(at.on_surface),
        touched_normal_(at.normal) {
    if (rim_) rim_points_.emplace(*rim_);
    heading_ = any_direction(random_);
    speed_ = random_.uniform(options.slowest_mm_s, options.fastest_mm_s);
  }

  State(const State&) = delete;
  State& operator=(const State&) = delete;

  Vec3 step(const HandInput& felt, double t, double dt) noexcept {
    h_ = felt.hip_mm;
    const double size = felt.force_n.norm();
    const bool contact = size > 0.0;
    look(contact, contact ? Vec3(felt.force_n / size) : Vec3::Zero(), dt);
    plan(t, dt, contact);
    const Vec3 hand = own_force(t, contact);
    Vec3 tangent = heading_ - heading_.dot(normal_) * normal_;
    if (tangent.norm() < kMinTangent) {
      heading_ = any_direction(random_);
      tangent = heading_ - heading_.dot(normal_) * normal_;
    }
    tangent.normalize();
    heading_ = ((1.0 - kTurnIn) * heading_ + kTurnIn * tangent).normalized();
    const bool drags = taps_ == 0 && (contact || !going_back_);
    Vec3 velocity = (hand + felt.handle_force_n) / damping_ + (drags ? speed_ : 0.0) * tangent;
    const double most = kFastest * options_.fastest_mm_s, fast = velocity.norm();
    if (fast > most) velocity *= most / fast;
    return velocity;
  }

  /// Updates the outward direction from contact, else from the visible points.
  void look(bool contact, const Vec3& felt, double dt) {
    behind_ = false;
    Vec3 outward = normal_;
    if (contact) {
      outward = felt;
      touched_ = h_;
      touched_normal_ = normal_;
      free_s_ = 0.0;
      going_back_ = false;
      // Hands avoid holes of a scan: turns before the rim.
      if (const std::optional<Vec3> rim = rim_near(h_); rim && h_ != *rim)
        heading_ = (h_ - *rim).normalized();
    } else if (going_back_) {
      outward = touched_normal_;
      if ((above_touched() - h_).norm() <= depth_mm_) {
        going_back_ = false;
        free_s_ = 0.0;
        heading_ = any_direction(random_);
      }
    } else {
      free_s_ += dt;
      const PlaneFit fit = fit_plane(*fitting_.points, h_, fitting_.radius_mm, normal_);
      behind_ = fit.good && fit.height > kTooDeep * depth_mm_;
      const std::optional<Vec3> seen = fit.good ? std::nullopt : nearest();
      const Vec3 from_seen = seen ? Vec3(h_ - *seen) : touched_normal_;
      // Beside the nearest border point, not above it: the surface ends.
      const bool beside = (open_ || (seen && rim_near(*seen))) &&
                          from_seen.dot(touched_normal_) < kAboveShare * from_seen.norm();
      if (free_s_ > kLostS || beside) {
        going_back_ = true;
        // Goes inward from a border; going back would come off again.
        if (const std::optional<Vec3> middle = beside ? middle_near() : std::nullopt)
          touched_ = *middle + kInwards * (*middle - h_);
      } else if (fit.good) {
        outward = fit.normal;
      } else if (from_seen.norm() > 0.0) {
        outward = open_ ? touched_normal_ : Vec3(from_seen.normalized());
      }
    }
    const Vec3 turned = normal_ + std::min(dt / kFeelS, 1.0) * (outward - normal_);
    if (turned.norm() > 0.0) normal_ = turned.normalized();
  }

  /// Above the last contact.
  [[nodiscard]] Vec3 above_touched() const { return touched_ + kLiftDepths * depth_mm_ * touched_normal_; }
  /// The nearest rim corner, if near.
  [[nodiscard]] std::optional<Vec3> rim_near(const Vec3& local) const {
    if (!rim_points_) return std::nullopt;
    const Vec3 at = local + origin_mm_;
    const Vec3 rim = rim_->point_mm(rim_points_->nearest(at));
    if ((rim - at).norm() > kRimRadii * fitting_.radius_mm + depth_mm_) return std::nullopt;
    return Vec3(rim - origin_mm_);
  }
  [[nodiscard]] std::optional<Vec3> nearest() const {
    std::optional<Vec3> found;
    double best = std::numeric_limits<double>::infinity();
    fitting_.points->around(h_, kMaxFitted, [&](const Vec3& q) {
      const double sq = (q - h_).squaredNorm();
      if (sq >= best) return;
      best = sq;
      found = q;
    });
    return found;
  }

  /// Of the points around the HIP.
  [[nodiscard]] std::optional<Vec3> middle_near() const {
    Vec3 sum = Vec3::Zero();
    std::size_t count = 0;
    fitting_.points->around(h_, kMaxFitted, [&](const Vec3& q) {
      sum += q;
      ++count;
    });
    if (count == 0) return std::nullopt;
    return Vec3(sum / static_cast<double>(count));
  }

  /// Plans pace, lifts and taps, and a new heading when stuck.
  void plan(double t, double dt, bool contact) {
    heading_ = (heading_ +
                kWander * std::sqrt(dt / kStepS) * Vec3(random_.normal(), random_.normal(), random_.normal()))
                   .normalized();
    if (t >= next_pace_s_) {
      speed_ = random_.uniform(options_.slowest_mm_s, options_.fastest_mm_s);
      next_pace_s_ = t + kPaceS;
    }
    if (t >= next_look_s_) {
      if ((h_ - back_).norm() < kStuckShare * speed_ * kStuckS) heading_ = any_direction(random_);
      back_ = h_;
      next_look_s_ = t + kStuckS;
    }
    lift_s_ -= dt;
    if (lift_s_ > 0.0) return;
    if (taps_ > 0) {
      // Touches for kTapS, then rises.
      if (contact) touch_s_ += dt;
      if (touch_s_ < kTapS) return;
      touch_s_ = 0.0;
      if (--taps_ > 0) lift_s_ = kShortestLiftS;
    } else if (contact && random_.uniform() < dt / kBetweenLiftsS) {
      lift_s_ = random_.uniform(kShortestLiftS, kLongestLiftS);
      if (random_.uniform() < kTapShare)
        taps_ = kMinTaps + static_cast<int>(random_.below(kMaxTaps - kMinTaps + 1));
    }
  }

  [[nodiscard]] Vec3 own_force(double t, bool contact) const {
    const double f = options_.force_n;
    if (going_back_) {
      // Up first: the straight way may cross the sheet from below.
      if ((h_ - touched_).dot(touched_normal_) < 0.5 * kLiftDepths * depth_mm_) return f * touched_normal_;
      const Vec3 way = above_touched() - h_;
      return way * (f / std::max(way.norm(), depth_mm_));
    }
    if (behind_) return f * normal_;
    if (lift_s_ > 0.0) {
      const bool high = (h_ - touched_).dot(normal_) > kLiftDepths * depth_mm_;
      return (contact ? kUp : high ? 0.0 : kAbove) * f * normal_;
    }
    const double press =
        f * (kMeanPress + kPressSwing * std::sin(phase_ + 2.0 * std::numbers::pi * t / kPressS));
    return -(contact ? press : std::min(press, kDown * f)) * normal_;
  }

  Vec3 origin_mm_;
  HandOptions options_;
  FitSearch fitting_;
  bool open_;
  std::optional<cloud::Cloud> rim_;
  std::optional<search::PointSearch> rim_points_;
  Random random_;
  double damping_, depth_mm_, phase_;
  Vec3 h_;        ///< the HIP; all positions are relative to the cloud's origin
  Vec3 normal_;   ///< its estimate of outward
  Vec3 heading_;  ///< direction of dragging
  double speed_;
  Vec3 back_;                      ///< position at the last check for being stuck
  Vec3 touched_, touched_normal_;  ///< last contact
  double free_s_ = 0.0, lift_s_ = 0.0, touch_s_ = 0.0;
  double next_pace_s_ = kPaceS, next_look_s_ = kStuckS;
  int taps_ = 0;
  bool going_back_ = false, behind_ = false;
};

Hand::Hand(std::unique_ptr<State> state) : state_(std::move(state)) {}
Hand::Hand(Hand&&) noexcept = default;
Hand& Hand::operator=(Hand&&) noexcept = default;
Hand::~Hand() = default;

Result<Hand> Hand::create(const PathTarget& target, const HandOptions& options) {
  const cloud::Cloud& cloud = *target.cloud;
  if (cloud.size() < kMinInBall)
    return Error{"the cloud has too few points for a hand to go by", "give at least 16"};
  PALPATE_ASSIGN(FitSearch fitting, choose_fit_radius(cloud, cloud.box_mm()));
  Random random(options.seed);
  const double clearance_mm = kLiftDepths * options.force_n / target.stiffness_n_per_mm;
  PALPATE_ASSIGN(const PathStart at, find_start_outside(target, fitting, clearance_mm, random));
  return Hand(
      std::make_unique<State>(target, options, std::move(fitting), open_side(target).has_value(), at));
}

const Vec3& Hand::start_mm() const noexcept {
  return state_->h_;
}

Vec3 Hand::step(const HandInput& felt, double t_s, double dt_s) noexcept {
  return state_->step(felt, t_s, dt_s);
}

Result<HandOptions> read_hand_options(const Options& o) {
  const HandOptions options{static_cast<std::size_t>(o.integer("frames")),
                            o.number("rate_hz"),
                            o.number("force_n"),
                            o.number("slowest_mm_s"),
                            o.number("fastest_mm_s"),
                            o.number("bandwidth_hz"),
                            static_cast<std::uint64_t>(o.integer("seed"))};
  if (options.slowest_mm_s > options.fastest_mm_s)
    return Error{"hand: slowest_mm_s is more than fastest_mm_s", "exchange them"};
  return options;
}

Result<HandOptions> parse_hand(const std::string& text) {
  PALPATE_ASSIGN(const NamedOptions named, parse_named_options(text));
  const PathGenerator* hand = find_path_generator("hand");
  if (named.name != hand->name) return Error{named.name + " is no hand", "give hand:seed=2"};
  PALPATE_ASSIGN(const Options complete, validate(named.options, hand->options, named.name));
  return read_hand_options(complete);
}

Result<std::vector<Vec3>> hand_path(const PathTarget& target, const HandOptions& options) {
  PALPATE_ASSIGN(const ForceFunction felt, target.felt());
  PALPATE_ASSIGN(Hand hand, Hand::create(target, options));
  const double sample_s = 1.0 / options.rate_hz,
               longest_s = std::min(
                   kStepS, 1.0 / (2.0 * std::numbers::pi * options.bandwidth_hz * kStepsPerTimeConstant));
  const auto steps = static_cast<int>(std::ceil(sample_s / longest_s * (1.0 - kRoundedUp)));
  const double dt = sample_s / steps;
  const Vec3 origin = target.cloud->origin_mm;
  Vec3 h = hand.start_mm();
  std::vector<Vec3> path;
  path.reserve(options.frames);
  double t = 0.0;
  for (std::size_t k = 0; k < options.frames; ++k) {
    path.push_back(h + origin);
    for (int s = 0; s < steps; ++s, t += dt) {
      const Vec3 force =
          target.world_from_model.rotation.inverse() * felt(target.world_from_model * Vec3(h + origin));
      h += dt * hand.step({h, force, force}, t, dt);
    }
  }
  return path;
}

}  // namespace palpate::paths
