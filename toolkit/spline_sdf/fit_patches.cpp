#include "toolkit/spline_sdf/fit_patches.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <span>

#include "toolkit/core/hardware.h"
#include "toolkit/core/parallel.h"
#include "toolkit/spline_sdf/point_noise.h"

namespace palpate::spline_sdf {
namespace {

/// The area doubles each step, seven sizes: up to 17.6 spacings, 970 points.
constexpr std::size_t kSizes = 7;
constexpr double kGrowth = std::numbers::sqrt2;
/// From this size on (6.2 spacings, 120 points) a good enough patch stops growing.
constexpr std::size_t kEnough = 3;
/// Good enough on clean points, in spacings and as a slope: 0.0005 spacings are 0.1 um at 0.2 mm spacing.
constexpr double kValueTolerance = 5e-4, kSlopeTolerance = 1e-3;
/// Largest ratio of a larger patch's deviation to the noise.
constexpr double kMisfit = 1.25;
/// Residuals that are shape grow with the cube of the radius, 2.8 times per size; for a sigma from few,
/// partly noisy points only this growth is assumed.
constexpr double kNextSigma = 2.0;
/// Usable share of a fit's radius: points near the rim are few.
constexpr double kSupportShare = 0.9;
/// Least support in spacings; smaller ones leave gaps.
constexpr double kMinSupport = 1.3;
/// A point is on a patch within this many standard deviations or spacings; a clean quadric's third-order
/// error reaches this at its rim.
constexpr double kOnSigmas = 3.5, kOnSpacings = 0.05;
/// Points that gradually leave a patch start within this many spacings.
constexpr double kLeavingSpacings = 2.0;
/// A wider ball only uses points this near to the last fit, which excludes other sheets.
constexpr double kGateSigmas = 6.0;
/// The same beside another sheet, and its limit.
constexpr double kMixedGate = 0.3, kMixedMost = 0.45;
/// Rings of a patch, and the share of leaving points at which it ends.
constexpr int kRings = 8;
constexpr double kLeavingShare = 0.2;
/// A first fit with this many times the noise is retried from the plane of the points within this share of
/// the radius.
constexpr double kUnexplained = 2.0, kCoreShare = 0.65;
/// A residual of this many spacings beyond noise means several sheets.
constexpr double kMixedSpacings = 0.15;
/// Covered from this sum of weights on.
constexpr double kCoveredWeight = 0.1;
/// Patches known better than this, in spacings, count equally.
constexpr double kTrusted = 0.01;
/// Limit on a first fit's noise relative to the known noise; farther points are ignored, however many. From
/// 15 points a standard deviation is known to a quarter, and this is two of those.
constexpr double kMaxNoise = 1.5;
/// The seed is on its own patch if the robust cost leaves it this weight (two scales off).
constexpr double kOwnWeight = 0.04;
/// An uncovered point belongs to a surface if this share of the points within kLeftRadius is uncovered too,
/// as on a strip between walls; outliers have fewer.
constexpr double kLeftTogether = 0.15, kLeftRadius = 1.8;
/// With noise, a patch that has grown this often is reliable.
constexpr std::size_t kReliableSize = 2;
/// Distance from any plane over the ball's radius: 0.45 for scattered points, far less on a surface.
constexpr double kScattered = 0.2;

enum State : std::uint8_t { kUncovered, kDeferred, kCoveredState };

class BlockPatchFitter {
 public:
  BlockPatchFitter(const MortonPoints& points, const PatchFitOptions& rule, std::size_t begin,
                   std::size_t end)
      : points_(points),
        rule_(rule),
        begin_(begin),
        weight_(end - begin, 0.0f),
        state_(end - begin, kUncovered) {}

  /// Makes reliable patches first, then covers leftovers that are more than outliers.
  void run(std::vector<QuadricPatch>& out, std::size_t& isolated_points) {
    for (std::size_t i = 0; i < state_.size(); ++i)
      if (state_[i] == kUncovered && !seed(i, true, out)) state_[i] = kDeferred;
    for (std::size_t i = 0; i < state_.size(); ++i) {
      if (state_[i] != kDeferred) continue;
      if (neighbours_left_too(i) && (seed(i, false, out) || fit_leftover(i, out))) continue;
      ++isolated_points;
    }
  }

 private:
  /// The first ball about a point; false if it stands alone.
  bool seed_ball(std::size_t i, double& radius) {
    mixed_ = false;
    noise_ = rule_.noise.at(begin_ + i);
    if (!gather_seed_ball(points_, begin_ + i, ball_)) return false;
    radius = ball_.radius;
    return true;
  }

  /// Fits growing balls about a point while they agree; returns their number.
  std::size_t grow(const Vec3& at, double spacing, std::array<QuadricFit, kSizes>& fits) {
    const FitOptions fit_rule{noise_};
    FitOptions first_rule = fit_rule;
    if (noise_ > kOnSpacings * spacing) first_rule.most = kMaxNoise;
    double radius = ball_.radius;
    whole_ = ball_;
    for (std::size_t k = 0; k < kSizes; ++k) {
      if (k == 1)
        if (const std::size_t leapt = leap(spacing, fit_rule, fits); leapt > 0) return leapt + 1;
      if (k > 0) {
        radius *= kGrowth;
        std::swap(before_, whole_);
        whole_.gather(points_, at, radius);
        ball_ = whole_;
        ball_.keep_near(fits[k - 1].quadric, gate(fits[k - 1], spacing));
        fits[k] = fits[k - 1];
      }
      const bool fitted = k > 0 ? fit_quadric(ball_, fit_rule, &fits[k - 1].quadric, fits[k])
                                : fit_quadric(ball_, first_rule, nullptr, fits[k]);
      if (!fitted && k > 0) return k;
      if (k == 0) {
        if (!fitted) fits[0].sigma = std::numeric_limits<double>::infinity();
        if (!fitted || unexplained(fits[0], kOnSpacings * spacing))
          mixed_ = separate_sheets(ball_, spacing, noise_, fits[0]);
        if (!fitted && !mixed_) return 0;
        if (!mixed_) refit_core(fits[0], spacing);
        if (fits[0].seed_weight < kOwnWeight || unexplained(fits[0], kMixedSpacings * spacing)) return 0;
      } else if (!agrees(std::span(fits).first(k), fits[k], spacing)) {
        leaps_ = k > 1;
        return k;
      }
      if (k >= kEnough && good_enough(fits[k], spacing)) {
        leaps_ = true;
        return k + 1;
      }
    }
    return kSizes;
  }

  /// Jumps to the size of the last patch, and up or down from there, if the first fit is good enough: the
  /// sizes between would hardly constrain more. Returns the largest valid size, with ball_ as fitted; 0, with
  /// whole_ unchanged, if all sizes must be tried.
  std::size_t leap(double spacing, const FitOptions& rule, std::array<QuadricFit, kSizes>& fits) {
    if (!leaps_ || mixed_ || !good_enough(fits[0], spacing)) return 0;
    leaps_ = false;
    std::array<double, kEnough + 1> radius{ball_.radius};
    for (std::size_t k = 1; k <= kEnough; ++k) radius[k] = kGrowth * radius[k - 1];
    wide_.gather(points_, ball_.centre, radius[kEnough]);
    wide_.keep_near(fits[0].quadric, gate(fits[0], spacing));
    const double allowed = allowed_sigma(fits[0].sigma, spacing);
    const auto holds = [&](std::size_t k) {
      fits[k] = fits[0];
      fits[k].sigma = allowed / kNextSigma;  // weighted as if the next smaller fit had just passed
      ball_.take_inner(wide_, radius[k]);
      return fit_quadric(ball_, rule, &fits[0].quadric, fits[k]) &&
             agrees(std::span(fits).first(1), fits[k], spacing) &&
             (k < kEnough || good_enough(fits[k], spacing));
    };
    std::size_t size = leap_;
    if (holds(size)) {
      while (size < kEnough && kNextSigma * fits[size].sigma <= allowed) {
        std::swap(before_, ball_);
        if (!holds(size + 1)) {
          std::swap(before_, ball_);
          break;
        }
        ++size;
      }
    } else {
      do {
        if (--size == 0) return 0;
      } while (!holds(size));
    }
    leaps_ = true;
    return leap_ = size;
  }

  /// Makes the largest robust patch about a point. False, with nothing changed, if there is none, or if
  /// `reliable` is required and it is not.
  bool seed(std::size_t i, bool reliable, std::vector<QuadricPatch>& out) {
    const Vec3 at = points_[begin_ + i];
    double radius = 0.0;
    if (!seed_ball(i, radius)) return false;
    const double spacing = radius / kSeedRadiusSpacings;
    std::array<QuadricFit, kSizes> fits;
    const std::size_t sizes = grow(at, spacing, fits);
    if (sizes == 0) return false;
    const QuadricFit& best = fits[sizes - 1];
    const bool noisy = std::max(best.sigma, noise_) > kOnSpacings * spacing;
    const bool doubtful = sizes <= kReliableSize && noisy;
    if (reliable && doubtful) return false;
    for (std::size_t k = 1; k < sizes; ++k) radius *= kGrowth;
    if (best.sigma > kScattered * radius) return false;
    if (ball_.radius != radius) std::swap(ball_, before_);  // one size was too much
    add(best, spacing, !doubtful, out);
    state_[i] = kCoveredState;
    return true;
  }
  /// Points of a wider ball farther than this from the last fit are ignored.
  [[nodiscard]] double gate(const QuadricFit& fit, double spacing) const {
    const double noise = kGateSigmas * std::max(fit.sigma, noise_);
    return mixed_ ? std::min(std::max(kMixedGate * spacing, noise), kMixedMost * spacing)
                  : std::max(kLeavingSpacings * spacing, noise);
  }
  [[nodiscard]] bool unexplained(const QuadricFit& fit, double allowed) const {
    return fit.sigma > std::max(kUnexplained * noise_, allowed);
  }
  /// If the points are on two sheets or faces, refits to those near the seed.
  void refit_core(QuadricFit& first, double spacing) {
    if (!unexplained(first, kOnSpacings * spacing)) return;
    QuadricFit other;
    if (fit_quadric(ball_, {noise_, true, kCoreShare}, nullptr, other) && other.sigma < first.sigma &&
        other.seed_weight >= kOwnWeight)
      first = other;
  }

  [[nodiscard]] bool agrees(std::span<const QuadricFit> smaller, const QuadricFit& now,
                            double spacing) const {
    double least_sigma = smaller.front().sigma;
    for (const QuadricFit& before : smaller) {
      least_sigma = std::min(least_sigma, before.sigma);
      // Where the later surface's normal meets the earlier tangent plane.
      const double value = now.quadric.residual(before.quadric.at);
      if (std::abs(value) > rule_.detail * before.value_error + kValueTolerance * spacing) return false;
      const double slope = (now.quadric.n - before.quadric.n).norm();
      if (slope > rule_.detail * before.slope_error + kSlopeTolerance) return false;
    }
    return now.sigma <= allowed_sigma(least_sigma, spacing);
  }
  [[nodiscard]] double allowed_sigma(double least_sigma, double spacing) const {
    return kMisfit * std::max(least_sigma, noise_) + kValueTolerance * spacing;
  }
  [[nodiscard]] static bool good_enough(const QuadricFit& fit, double spacing) {
    return fit.value_error <= kValueTolerance * spacing && fit.slope_error <= kSlopeTolerance;
  }

  /// Ends the patch where points leave it, and marks its points as covered.
  void add(const QuadricFit& fit, double spacing, bool reliable, std::vector<QuadricPatch>& out) {
    const Quadric& q = fit.quadric;
    const double off = std::max(kOnSigmas * std::max(fit.sigma, noise_), kOnSpacings * spacing);
    const double limit = mixed_ ? kMixedMost * spacing : kLeavingSpacings * spacing;
    std::array<int, kRings> all{}, leaving{};
    const double rings_sq = kRings / (ball_.radius * ball_.radius);
    place(q);
    for (const PointOverPatch& over : over_) {
      if (over.off > std::max(limit, off)) continue;
      const int ring = std::min(static_cast<int>(over.lateral_sq * rings_sq), kRings - 1);
      ++all[static_cast<std::size_t>(ring)];
      leaving[static_cast<std::size_t>(ring)] += over.off > off;
    }
    int rings = kRings;
    while (rings > 1 && all[static_cast<std::size_t>(rings - 1)] == 0) --rings;
    double support = ball_.radius * std::min(kSupportShare, std::sqrt(static_cast<double>(rings) / kRings));
    for (int ring = 0; ring < kRings; ++ring) {
      const auto r = static_cast<std::size_t>(ring);
      if (leaving[r] > 1 && leaving[r] > kLeavingShare * all[r]) {
        support = std::min(support, ball_.radius * std::sqrt((ring + 0.5) / kRings));
        break;
      }
    }
    support = std::max(support, kMinSupport * spacing);
    QuadricPatch& patch = out.emplace_back();
    patch.quadric = q;
    patch.support = patch.extent = support;
    patch.spacing = spacing;
    patch.sigma = fit.sigma;
    patch.noise = noise_;
    patch.slope_error = fit.slope_error;
    patch.points = fit.points;
    const double error = kTrusted * spacing / std::max(fit.value_error, kTrusted * spacing);
    patch.trust = error * error;
    patch.reliable = reliable;
    patch.occupancy = DiscOccupancy(ball_.away.size());
    fill(patch, off);
    cover(out.back(), off);
  }

  /// Places the ball's points over a quadric.
  void place(const Quadric& q) {
    over_.resize(ball_.away.size());
    const Vec3 centre = ball_.centre - q.at;
    for (std::size_t k = 0; k < over_.size(); ++k) {
      const Vec3 d = centre + ball_.away[k];
      const double a = d.dot(q.u), b = d.dot(q.v), along = d.dot(q.n);
      over_[k] = {a, b, std::abs(along - (q.uu * a * a + q.uv * a * b + q.vv * b * b)),
                  d.squaredNorm() - along * along};
    }
  }

  void fill(QuadricPatch& patch, double off) const {
    const double per = 1.0 / patch.extent;
    for (const PointOverPatch& over : over_)
      if (over.off <= off) patch.occupancy.add(over.a * per, over.b * per);
  }

  void cover(const QuadricPatch& patch, double off) {
    const double per_sq = 1.0 / (patch.support * patch.support);
    for (std::size_t k = 0; k < over_.size(); ++k) {
      const std::size_t i = ball_.place[k] - begin_;  // wraps around below
      if (i >= state_.size() || state_[i] == kCoveredState || over_[k].off > off) continue;
      weight_[i] += static_cast<float>(patch_weight(over_[k].lateral_sq * per_sq));
      if (static_cast<double>(weight_[i]) >= kCoveredWeight) state_[i] = kCoveredState;
    }
  }

  /// True if the points around a leftover one are uncovered too.
  bool neighbours_left_too(std::size_t i) {
    double radius = 0.0;
    if (!seed_ball(i, radius)) return false;
    ball_.gather(points_, points_[begin_ + i], kLeftRadius / kSeedRadiusSpacings * radius);
    int together = 0, own = 0;
    for (const std::uint32_t place : ball_.place) {
      const std::size_t other = place - begin_;  // wraps around
      if (other >= state_.size()) continue;
      ++own;
      together += state_[other] == kDeferred;
    }
    return together > 1 && together >= kLeftTogether * own;
  }

  /// Fits a non-robust patch, for pieces too small for robust ones, or creases.
  bool fit_leftover(std::size_t i, std::vector<QuadricPatch>& out) {
    const Vec3 at = points_[begin_ + i];
    double radius = 0.0;
    QuadricFit fit;
    if (!seed_ball(i, radius)) return false;
    const double spacing = radius / kSeedRadiusSpacings;
    ball_.gather(points_, at, kLeftRadius * spacing);
    if (!fit_quadric(ball_, {noise_, false}, nullptr, fit) || fit.sigma > kScattered * ball_.radius)
      return false;
    if (unexplained(fit, kOnSpacings * spacing)) mixed_ = separate_sheets(ball_, spacing, noise_, fit);
    add(fit, spacing, false, out);
    state_[i] = kCoveredState;
    return true;
  }

  /// A point relative to a patch: along the tangent plane, off the surface, and the squared tangential
  /// distance from its centre.
  struct PointOverPatch {
    double a, b, off, lateral_sq;
  };
  const MortonPoints& points_;
  const PatchFitOptions& rule_;
  std::size_t begin_;
  std::vector<float> weight_;
  std::vector<std::uint8_t> state_;
  Ball ball_;
  Ball whole_, before_;               ///< with all points: this size and the one before
  std::vector<PointOverPatch> over_;  ///< points of ball_ over the patch being added
  double noise_ = 0.0;                ///< around the seed
  bool mixed_ = false;                ///< another sheet is near and its points are excluded
  Ball wide_;                         ///< a leap's largest ball
  bool leaps_ = true;                 ///< the last patch allowed a leap
  std::size_t leap_ = kEnough;        ///< size to leap to
};

}  // namespace

FittedPatches fit_patches(const MortonPoints& points, const PatchFitOptions& rule, int threads,
                          const geometry::Aabb* where) {
  const std::span<const std::uint32_t> blocks = points.blocks();
  const std::size_t count = blocks.size() - 1;
  std::vector<std::vector<QuadricPatch>> found(count);
  std::vector<std::size_t> left(count, 0);
  const auto is_wanted = [&](std::size_t b) {
    if (where == nullptr) return true;
    for (std::uint32_t i = blocks[b]; i < blocks[b + 1]; ++i)
      if (where->contains(points[i])) return true;
    return false;
  };
  parallel_each(count, 1, threads, [&](std::size_t b) {
    if (is_wanted(b)) BlockPatchFitter(points, rule, blocks[b], blocks[b + 1]).run(found[b], left[b]);
  });
  FittedPatches out;
  std::size_t patches = 0;
  for (const std::vector<QuadricPatch>& of : found) patches += of.size();
  out.patches.reserve(patches);
  for (std::size_t b = 0; b < count; ++b) {
    out.patches.insert(out.patches.end(), found[b].begin(), found[b].end());
    release_memory(found[b]);
    out.isolated_points += left[b];
  }
  return out;
}

}  // namespace palpate::spline_sdf
