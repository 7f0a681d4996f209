#include "toolkit/smooth/cover.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <span>

#include "toolkit/core/parallel.h"
#include "toolkit/smooth/first_ball.h"

namespace palpate::render {
namespace {

/// Points that are covered together, each chunk for itself: some 64 spacings square, several of the largest
/// patches.
constexpr std::size_t kChunk = 4096;
/// Growth of the area by 2 a step, seven sizes: up to 17.6 spacings, 970 points.
constexpr std::size_t kSizes = 7;
constexpr double kGrowth = std::numbers::sqrt2;
/// From this size on a patch that is good enough grows no more: 6.2 spacings, 120 points.
constexpr std::size_t kEnough = 3;
/// What is good enough on clean points, in spacings and as a slope: an error of 0.0005 spacings is 0.1 um
/// where points stand 0.2 mm apart.
constexpr double kValueTolerance = 5e-4, kSlopeTolerance = 1e-3;
/// The deviation of points that no larger patch may add to what noise explains.
constexpr double kMisfit = 1.25;
/// From one size to the next residuals that are shape grow with the third power of the radius, 2.8 times; of
/// a sigma from few points that are partly noise no more than this is relied on.
constexpr double kNextSigma = 2.0;
/// Of a fit's radius: beyond it no point was looked at, and few near it.
constexpr double kSupportShare = 0.9;
/// The least support, in spacings: smaller ones leave gaps between points.
constexpr double kLeastSupport = 1.3;
/// A point is on a patch within so many standard deviations, or spacings: what the tangent of a clean
/// quadric's next order makes at its rim.
constexpr double kOnSigmas = 3.5, kOnSpacings = 0.05;
/// Points that leave a patch step by step lie within this many spacings of it at first.
constexpr double kLeavingSpacings = 2.0;
/// A wider ball is looked at this near to the last fit: another sheet has no say in it.
constexpr double kGateSigmas = 6.0;
/// The same beside another sheet, and at most.
constexpr double kMixedGate = 0.3, kMixedMost = 0.45;
/// Rings of a patch, and the share of leaving points in one where the patch ends.
constexpr int kRings = 8;
constexpr double kLeavingShare = 0.2;
/// A first fit with so many times the noise is tried again, from the plane of the points within this share of
/// the radius.
constexpr double kUnexplained = 2.0, kCoreShare = 0.65;
/// So many spacings that noise does not explain are no shape of one sheet.
constexpr double kMixedSpacings = 0.15;
/// Covered from this sum of weights on.
constexpr double kCovered = 0.1;
/// Patches known better than this, in spacings, count alike.
constexpr double kTrusted = 0.01;
/// Where the noise is known a first fit may take so many times as much for noise: what is off by more has no
/// say, however many points it pulls with it. Of 15 points a standard deviation is known to a quarter, and
/// this is two of those.
constexpr double kMostNoise = 1.5;
/// The seed is on its own patch where the robust cost leaves it this weight: two scales off.
constexpr double kOwnWeight = 0.04;
/// A leftover point is one of a piece of surface where this share of those within the first radius were left
/// over too, as on a strip between two walls; stray points are fewer.
constexpr double kLeftTogether = 0.15, kLeftRadius = 1.8;
/// Where points are noisy, a patch that has grown this often is beyond doubt.
constexpr std::size_t kSureSize = 2;
/// Points that are scattered in a ball lie 0.45 of its radius about any plane, those of a surface a small
/// part of it.
constexpr double kScattered = 0.2;

enum State : std::uint8_t { kOpen, kDeferred, kDone };

class ChunkCover {
 public:
  ChunkCover(const SmoothPoints& points, const CoverRule& rule, std::size_t begin, std::size_t end)
      : points_(points), rule_(rule), begin_(begin), weight_(end - begin, 0.0f), state_(end - begin, kOpen) {}

  /// Patches that are beyond doubt first; then what they leave, where it is more than stray points.
  void run(std::vector<Patch>& out, std::size_t& left_out) {
    for (std::size_t i = 0; i < state_.size(); ++i)
      if (state_[i] == kOpen && !seed(i, true, out)) state_[i] = kDeferred;
    for (std::size_t i = 0; i < state_.size(); ++i) {
      if (state_[i] != kDeferred) continue;
      if (left_together(i) && (seed(i, false, out) || finish(i, out))) continue;
      ++left_out;
    }
  }

 private:
  /// The first ball about a point: false where it stands alone.
  bool first_ball(std::size_t i, double& radius) {
    mixed_ = false;
    noise_ = rule_.noise.at(begin_ + i);
    if (!gather_first(points_, begin_ + i, ball_)) return false;
    radius = ball_.radius;
    return true;
  }

  /// The fits of growing radius about a point, as long as they agree: how many.
  std::size_t grow(const Vec3& at, double spacing, std::array<QuadricFit, kSizes>& fits) {
    const FitRule fit_rule{noise_};
    FitRule first_rule = fit_rule;
    if (noise_ > kOnSpacings * spacing) first_rule.most = kMostNoise;
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
        if (!mixed_) try_core(fits[0], spacing);
        if (fits[0].centre_weight < kOwnWeight || unexplained(fits[0], kMixedSpacings * spacing)) return 0;
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

  /// At once to the size of the last patch, and on or back from there, where the first fit is good enough
  /// already: those between would allow hardly less than it does. The largest size that holds, with ball_ as
  /// it was fitted to; 0, with whole_ as it was, where sizes have to be gone through one by one.
  std::size_t leap(double spacing, const FitRule& rule, std::array<QuadricFit, kSizes>& fits) {
    if (!leaps_ || mixed_ || !good_enough(fits[0], spacing)) return 0;
    leaps_ = false;
    std::array<double, kEnough + 1> radius{ball_.radius};
    for (std::size_t k = 1; k <= kEnough; ++k) radius[k] = kGrowth * radius[k - 1];
    wide_.gather(points_, ball_.centre, radius[kEnough]);
    wide_.keep_near(fits[0].quadric, gate(fits[0], spacing));
    const double allowed = allowed_sigma(fits[0].sigma, spacing);
    const auto holds = [&](std::size_t k) {
      fits[k] = fits[0];
      fits[k].sigma = allowed / kNextSigma;  // points weigh as if the next smaller fit had just held
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

  /// A robust patch about a point, as large as it may be. False, with nothing changed, where there is none,
  /// or `sure` is asked for and it is not.
  bool seed(std::size_t i, bool sure, std::vector<Patch>& out) {
    const Vec3 at = points_[begin_ + i];
    double radius = 0.0;
    if (!first_ball(i, radius)) return false;
    const double spacing = radius / kFirstRadius;
    std::array<QuadricFit, kSizes> fits;
    const std::size_t sizes = grow(at, spacing, fits);
    if (sizes == 0) return false;
    const QuadricFit& best = fits[sizes - 1];
    const bool noisy = std::max(best.sigma, noise_) > kOnSpacings * spacing;
    const bool doubtful = sizes <= kSureSize && noisy;
    if (sure && doubtful) return false;
    for (std::size_t k = 1; k < sizes; ++k) radius *= kGrowth;
    if (best.sigma > kScattered * radius) return false;
    if (ball_.radius != radius) std::swap(ball_, before_);  // one size was too much
    add(best, spacing, !doubtful, out);
    state_[i] = kDone;
    return true;
  }
  /// A wider ball's points so far off the last fit have no say.
  [[nodiscard]] double gate(const QuadricFit& fit, double spacing) const {
    const double noise = kGateSigmas * std::max(fit.sigma, noise_);
    return mixed_ ? std::min(std::max(kMixedGate * spacing, noise), kMixedMost * spacing)
                  : std::max(kLeavingSpacings * spacing, noise);
  }
  [[nodiscard]] bool unexplained(const QuadricFit& fit, double allowed) const {
    return fit.sigma > std::max(kUnexplained * noise_, allowed);
  }
  /// Where the points are on two sheets, or faces, those next to the seed are on one.
  void try_core(QuadricFit& first, double spacing) {
    if (!unexplained(first, kOnSpacings * spacing)) return;
    QuadricFit other;
    if (fit_quadric(ball_, {noise_, true, kCoreShare}, nullptr, other) && other.sigma < first.sigma &&
        other.centre_weight >= kOwnWeight)
      first = other;
  }

  [[nodiscard]] bool agrees(std::span<const QuadricFit> smaller, const QuadricFit& now,
                            double spacing) const {
    double least_sigma = smaller.front().sigma;
    for (const QuadricFit& before : smaller) {
      least_sigma = std::min(least_sigma, before.sigma);
      // Where the earlier tangent plane is met by the later surface's normal.
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

  /// Ends where points begin to lie off it; tells its points that they are covered.
  void add(const QuadricFit& fit, double spacing, bool sure, std::vector<Patch>& out) {
    const Quadric& q = fit.quadric;
    const double off = std::max(kOnSigmas * std::max(fit.sigma, noise_), kOnSpacings * spacing);
    const double limit = mixed_ ? kMixedMost * spacing : kLeavingSpacings * spacing;
    std::array<int, kRings> all{}, leaving{};
    const double rings_sq = kRings / (ball_.radius * ball_.radius);
    place(q);
    for (const Over& over : over_) {
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
    support = std::max(support, kLeastSupport * spacing);
    Patch& patch = out.emplace_back();
    patch.quadric = q;
    patch.support = patch.reached = support;
    patch.spacing = spacing;
    patch.sigma = fit.sigma;
    patch.noise = noise_;
    patch.slope_error = fit.slope_error;
    patch.points = fit.points;
    const double error = kTrusted * spacing / std::max(fit.value_error, kTrusted * spacing);
    patch.trust = error * error;
    patch.sure = sure;
    patch.filled = Filled(ball_.away.size());
    fill(patch, off);
    cover(out.back(), off);
  }

  /// Where the ball's points are over a quadric.
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

  void fill(Patch& patch, double off) const {
    const double per = 1.0 / patch.reached;
    for (const Over& over : over_)
      if (over.off <= off) patch.filled.add(over.a * per, over.b * per);
  }

  void cover(const Patch& patch, double off) {
    const double per_sq = 1.0 / (patch.support * patch.support);
    for (std::size_t k = 0; k < over_.size(); ++k) {
      const std::size_t i = ball_.place[k] - begin_;  // wraps around below
      if (i >= state_.size() || state_[i] == kDone || over_[k].off > off) continue;
      weight_[i] += static_cast<float>(patch_weight(over_[k].lateral_sq * per_sq));
      if (static_cast<double>(weight_[i]) >= kCovered) state_[i] = kDone;
    }
  }

  /// Whether the points around one that was left were left as well.
  bool left_together(std::size_t i) {
    double radius = 0.0;
    if (!first_ball(i, radius)) return false;
    ball_.gather(points_, points_[begin_ + i], kLeftRadius / kFirstRadius * radius);
    int together = 0, own = 0;
    for (const std::uint32_t place : ball_.place) {
      const std::size_t other = place - begin_;  // wraps around
      if (other >= state_.size()) continue;
      ++own;
      together += state_[other] == kDeferred;
    }
    return together > 1 && together >= kLeftTogether * own;
  }

  /// A patch that no robust one is: of a piece too small for them, or a crease.
  bool finish(std::size_t i, std::vector<Patch>& out) {
    const Vec3 at = points_[begin_ + i];
    double radius = 0.0;
    QuadricFit fit;
    if (!first_ball(i, radius)) return false;
    const double spacing = radius / kFirstRadius;
    ball_.gather(points_, at, kLeftRadius * spacing);
    if (!fit_quadric(ball_, {noise_, false}, nullptr, fit) || fit.sigma > kScattered * ball_.radius)
      return false;
    if (unexplained(fit, kOnSpacings * spacing)) mixed_ = separate_sheets(ball_, spacing, noise_, fit);
    add(fit, spacing, false, out);
    state_[i] = kDone;
    return true;
  }

  /// A point over a quadric: along its tangent plane, off its surface, and the square of how far from its
  /// middle along the plane.
  struct Over {
    double a, b, off, lateral_sq;
  };
  const SmoothPoints& points_;
  const CoverRule& rule_;
  std::size_t begin_;
  std::vector<float> weight_;
  std::vector<std::uint8_t> state_;
  Ball ball_;
  Ball whole_, before_;         ///< its size with all points, and that before it
  std::vector<Over> over_;      ///< of the points of ball_ over the patch that is added
  double noise_ = 0.0;          ///< around the seed
  bool mixed_ = false;          ///< another sheet is near: its points are left out
  Ball wide_;                   ///< of a leap, at its largest
  bool leaps_ = true;           ///< the last patch could have leapt
  std::size_t leap_ = kEnough;  ///< to this size
};

}  // namespace

Cover cover_points(const SmoothPoints& points, const CoverRule& rule, int threads) {
  const std::size_t chunks = (points.size() + kChunk - 1) / kChunk;
  std::vector<std::vector<Patch>> found(chunks);
  std::vector<std::size_t> left(chunks, 0);
  parallel_chunks(points.size(), kChunk, threads, [&](std::size_t begin, std::size_t end) {
    ChunkCover cover(points, rule, begin, end);
    cover.run(found[begin / kChunk], left[begin / kChunk]);
  });
  Cover out;
  for (std::size_t c = 0; c < chunks; ++c) {
    out.patches.insert(out.patches.end(), found[c].begin(), found[c].end());
    out.left_out += left[c];
  }
  return out;
}

}  // namespace palpate::render
