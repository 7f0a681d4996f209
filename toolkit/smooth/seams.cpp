#include "toolkit/smooth/seams.h"

#include <Eigen/Cholesky>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>
#include <span>

#include "toolkit/core/parallel.h"
#include "toolkit/smooth/patch_cells.h"

namespace palpate::render {
namespace {

/// Points are clean, and a patch is small, up to so many spacings.
constexpr double kCleanNoise = 0.02, kSmallPatch = 4.0;
/// Points looked at for nine numbers, within so many spacings: some 30.
constexpr double kSeamRadius = 3.1;
constexpr std::size_t kFewestSeamPoints = 16;
/// What a quadric leaves of the points, in radii, that is worth a seam.
constexpr double kLeastMisfit = 6e-4;
/// Lines tried first: directions over half a turn, and how far off the middle, in radii.
constexpr int kDirections = 6;
constexpr std::array<double, 3> kOffsets{0.0, -0.4, 0.4};
/// A bend of which a quadric follows all but this share of the square is told apart from it by rounding
/// alone.
constexpr double kFollowed = 1e-6;
/// The best of them explains this share of the misfit's square; one step on all but so much is.
constexpr double kFirstGain = 0.5, kSecondLeft = 0.15;
/// Steps of Gauss and Newton, and how far one may move the line or turn it, in radii.
constexpr int kSeamRounds = 5;
constexpr double kLongestMove = 0.3, kFarthestOff = 1.5;
/// With the line the points are this share off of what they are without, and no more than so many spacings.
constexpr double kBetter = 0.25, kSeamOff = 0.004;
/// Its bend makes so much of a slope over the radius, at least, and this share of what either side bends: the
/// next order of a round surface looks like a small one.
constexpr double kLeastSeamBend = 0.02, kOwnShare = 0.3;
/// Of the points on either side.
constexpr double kEitherSide = 0.25;
/// The line passes the patch's middle by no more, in spacings.
constexpr double kSeamPasses = 2.8;
constexpr double kSeamSupport = 0.9;
constexpr double kSameWay = 0.978, kOffLine = 0.3;
/// A patch that a line passes nearer than at this share of its support is of neither side.
constexpr double kOwnSide = 0.6;
/// Every so many patches are asked first, of which this share has a seam where the rest is asked as well.
constexpr std::size_t kSeamStride = 8;
constexpr double kLeastSeams = 0.01;
constexpr std::size_t kSeamGrain = 64;

using Vec6 = Eigen::Matrix<double, 6, 1>;
using Vec8 = Eigen::Matrix<double, 8, 1>;
using Vec9 = Eigen::Matrix<double, 9, 1>;
using Mat6 = Eigen::Matrix<double, 6, 6>;
using Mat9 = Eigen::Matrix<double, 9, 9>;

/// In radii along a frame; beyond the radius there are none.
struct SeamPoint {
  double a, b, w, weight;
};
/// The places with x a + y b > c are beyond it.
struct SeamLine {
  double x = 1.0, y = 0.0, c = 0.0;
  [[nodiscard]] double past(const SeamPoint& p) const { return std::max(p.a * x + p.b * y - c, 0.0); }
};
Vec6 height_terms(const SeamPoint& p) {
  Vec6 t;
  t << 1.0, p.a, p.b, p.a * p.a, p.a * p.b, p.b * p.b;
  return t;
}

struct FoundSeam {
  Quadric before, beyond;
  Vec3 across;
  int points;
};

/// Belongs to one thread.
class SeamFinder {
 public:
  explicit SeamFinder(const SmoothPoints& points) : points_(points) {}

  std::optional<FoundSeam> under(const Patch& p) {
    radius_ = kSeamRadius * p.spacing;
    Quadric q = p.quadric;
    if (!take(q) || !fit_plain() || plain_sq_ < kLeastMisfit * kLeastMisfit * weights_) return std::nullopt;
    SeamLine line;
    if (!first_line(line) || !settle(q, line)) return std::nullopt;
    return judged(p, q, line);
  }

 private:
  bool take(const Quadric& q) {
    seen_.clear();
    const double per = 1.0 / radius_;
    weights_ = 0.0;
    points_.in_ball(q.at, radius_, [&](std::uint32_t, const Vec3& d, double sq) {
      seen_.push_back({d.dot(q.u) * per, d.dot(q.v) * per, d.dot(q.n) * per, 1.0 - sq * per * per});
      weights_ += seen_.back().weight;
    });
    return seen_.size() >= kFewestSeamPoints;
  }
  /// The points' heights, and what a line adds, are told apart from what a quadric follows: of each point the
  /// six terms, orthonormal over all points, and what is left of its height; all times the root of its
  /// weight.
  bool fit_plain() {
    Mat6 sums = Mat6::Zero();
    Vec6 right = Vec6::Zero();
    for (const SeamPoint& p : seen_) {
      const Vec6 t = height_terms(p), weighed = p.weight * t;
      sums += weighed * t.transpose();
      right += weighed * p.w;
    }
    const Eigen::LLT<Mat6> solver(sums);
    if (solver.info() != Eigen::Success) return false;
    const Vec6 c = solver.solve(right);
    const Mat6 inverse = solver.matrixL().solve(Mat6::Identity());
    plain_sq_ = 0.0;
    apart_.clear();
    for (const SeamPoint& p : seen_) {
      const Vec6 t = height_terms(p);
      const double root = std::sqrt(std::max(p.weight, 0.0)), left = root * (p.w - t.dot(c));
      Vec8 one;
      one << root * (inverse * t), left, root;
      apart_.push_back(one);
      plain_sq_ += left * left;
    }
    return true;
  }
  bool first_line(SeamLine& best) {
    double most = 0.0;
    for (int i = 0; i < kDirections; ++i) {
      const double angle = std::numbers::pi * i / kDirections;
      for (const double offset : kOffsets) {
        const SeamLine line{std::cos(angle), std::sin(angle), offset};
        Vec8 sums = Vec8::Zero();
        double own = 0.0;
        for (std::size_t k = 0; k < seen_.size(); ++k) {
          const double past = line.past(seen_[k]), s = apart_[k][7] * past * past;
          sums += s * apart_[k];
          own += s * s;
        }
        const double left = own - sums.head<6>().squaredNorm(), with = sums[6];
        const double gain = left > kFollowed * own ? with * with / left : 0.0;
        if (!(gain > most)) continue;
        most = gain;
        best = line;
        bend_ = with / left;
      }
    }
    return most > kFirstGain * plain_sq_;
  }
  /// The six numbers of the height before the line, its bend, and the line. About a place of the line, and
  /// along the plane that touches both sides there.
  bool settle(Quadric& q, SeamLine& line) {
    for (int round = 0; round < kSeamRounds; ++round) {
      Vec9 c;
      double left = 0.0;
      if (!step(line, c, left)) return false;
      if (round == 1 && left > kSecondLeft * plain_sq_) return false;
      if (!(std::abs(line.c) < kFarthestOff)) return false;
      const double a = line.x * line.c, b = line.y * line.c;
      const Vec3 across = q.u * line.x + q.v * line.y;
      q.at += radius_ *
              (q.u * a + q.v * b + q.n * (c[0] + a * (c[1] + c[3] * a + c[4] * b) + b * (c[2] + c[5] * b)));
      turn_to(q, (q.n - q.u * (c[1] + 2.0 * c[3] * a + c[4] * b) - q.v * (c[2] + 2.0 * c[5] * b + c[4] * a))
                     .normalized());
      q.uu = c[3] / radius_;
      q.uv = c[4] / radius_;
      q.vv = c[5] / radius_;
      line = {across.dot(q.u), across.dot(q.v), 0.0};
      const double per = 1.0 / std::hypot(line.x, line.y);
      line.x *= per;
      line.y *= per;
      if (!take(q)) return false;
    }
    return true;
  }
  bool step(SeamLine& line, Vec9& c, double& left) {
    Mat9 sums = Mat9::Zero();
    Vec9 right = Vec9::Zero();
    double all = 0.0;
    for (const SeamPoint& p : seen_) {
      const double past = line.past(p);
      Vec9 t;
      t << height_terms(p), past * past, -2.0 * bend_ * past,
          2.0 * bend_ * past * (line.x * p.b - line.y * p.a);
      const Vec9 weighed = p.weight * t;
      sums += weighed * t.transpose();
      right += weighed * p.w;
      all += p.weight * p.w * p.w;
    }
    const Eigen::LDLT<Mat9> solver(sums);
    if (solver.info() != Eigen::Success) return false;
    c = solver.solve(right);
    if (!c.allFinite()) return false;
    left = all - c.dot(right);
    bend_ = c[6];
    line.c += std::clamp(c[7], -kLongestMove, kLongestMove);
    const double turn = std::clamp(c[8], -kLongestMove, kLongestMove);
    const double x = line.x - turn * line.y, y = line.y + turn * line.x, per = 1.0 / std::hypot(x, y);
    line.x = x * per;
    line.y = y * per;
    return true;
  }
  std::optional<FoundSeam> judged(const Patch& p, const Quadric& q, const SeamLine& line) {
    if ((q.at - p.quadric.at).squaredNorm() > kSeamPasses * kSeamPasses * p.spacing * p.spacing ||
        !fit_plain())
      return std::nullopt;
    const double uu = q.uu * radius_, uv = q.uv * radius_, vv = q.vv * radius_;
    const double most = std::max({std::abs(uu), std::abs(vv), std::abs(uu + bend_), std::abs(vv + bend_)});
    if (std::abs(2.0 * bend_) < kLeastSeamBend || std::abs(bend_) < kOwnShare * most) return std::nullopt;
    double bent_sq = 0.0;
    std::size_t beyond = 0;
    for (const SeamPoint& s : seen_) {
      const double past = line.past(s);
      const double left = s.w - (uu * s.a * s.a + uv * s.a * s.b + vv * s.b * s.b + bend_ * past * past);
      bent_sq += s.weight * left * left;
      beyond += past > 0.0 ? 1 : 0;
    }
    const double off = kSeamOff / kSeamRadius, all = static_cast<double>(seen_.size());
    if (!(bent_sq < kBetter * kBetter * plain_sq_) || bent_sq > off * off * weights_) return std::nullopt;
    if (static_cast<double>(std::min(beyond, seen_.size() - beyond)) < kEitherSide * all) return std::nullopt;
    FoundSeam found;
    found.before = found.beyond = q;
    const double bend = bend_ / radius_;
    found.beyond.uu += bend * line.x * line.x;
    found.beyond.uv += 2.0 * bend * line.x * line.y;
    found.beyond.vv += bend * line.y * line.y;
    found.across = q.u * line.x + q.v * line.y;
    found.points = static_cast<int>(seen_.size());
    return found;
  }

  const SmoothPoints& points_;
  double radius_ = 1.0, weights_ = 0.0, plain_sq_ = 0.0;
  double bend_ = 0.0;  ///< the height beyond is that before and this times the distance's square, in radii
  std::vector<SeamPoint> seen_;
  std::vector<Vec8> apart_;
};

/// A patch of one side, with the normal of that under which it was found.
Patch side_of(const Patch& under, Quadric q, int points) {
  if (q.n.dot(under.quadric.n) < 0.0) {
    q.n = -q.n;
    q.uu = -q.uu;
    q.uv = -q.uv;
    q.vv = -q.vv;
  }
  Patch out = under;
  out.quadric = q;
  out.support = out.reached = kSeamSupport * kSeamRadius * under.spacing;
  out.points = points;
  out.filled = Filled();
  return out;
}

void find_crossed(const std::vector<Patch>& patches, Seams& seams) {
  const PatchCells cells(std::span<const Patch>(patches).first(seams.plain));
  for (const Seam& seam : seams.all) {
    const Patch& side = patches[seam.before];
    for (int s = cells.scale_of(side.support); s < kPatchScales; ++s) {
      if (!cells.any(s)) continue;
      cells.near(seam.at, s, [&](std::uint32_t i) {
        const Patch& p = patches[i];
        const Seam* const own = seams.of[i] != Seams::kNone ? &seams.all[seams.of[i]] : nullptr;
        if (own != nullptr && along_line(seam, *own, p.spacing)) return;
        const Vec3 away = (own != nullptr ? own->at : p.quadric.at) - seam.at;
        const double reach = p.support + side.support;
        if (away.squaredNorm() <= reach * reach && std::abs(away.dot(seam.across)) <= kOwnSide * p.support)
          seams.crossed[i] = 1;
      });
    }
  }
}

}  // namespace

bool along_line(const Seam& line, const Seam& seam, double spacing) {
  return std::abs(seam.across.dot(line.across)) > kSameWay &&
         std::abs(line.across.dot(seam.at - line.at)) < kOffLine * spacing;
}

Seams find_seams(const SmoothPoints& points, std::vector<Patch>& patches, bool none, int threads) {
  Seams out;
  out.plain = patches.size();
  out.of.assign(out.plain, Seams::kNone);
  out.crossed.assign(out.plain, 0);
  if (none) return out;
  std::vector<std::uint32_t> asked;
  for (std::uint32_t i = 0; i < out.plain; ++i) {
    const Patch& p = patches[i];
    if (p.sure && p.noise <= kCleanNoise * p.spacing && p.reached <= kSmallPatch * p.spacing)
      asked.push_back(i);
  }
  std::vector<std::optional<FoundSeam>> found(out.plain);
  const auto look = [&](std::size_t first, std::size_t stride) {
    const std::size_t count = first < asked.size() ? (asked.size() - first + stride - 1) / stride : 0;
    parallel_chunks(count, kSeamGrain, threads, [&](std::size_t begin, std::size_t end) {
      SeamFinder finder(points);
      for (std::size_t k = begin; k < end; ++k) {
        const std::uint32_t i = asked[first + k * stride];
        found[i] = finder.under(patches[i]);
      }
    });
    return count;
  };
  // Where some of the patches show hardly any, there are none: most clouds have no edges made to a radius.
  const std::size_t tried = look(0, kSeamStride);
  const auto seen = std::count_if(found.begin(), found.end(), [](const auto& f) { return f.has_value(); });
  if (static_cast<double>(seen) < kLeastSeams * static_cast<double>(tried)) return out;
  for (std::size_t first = 1; first < kSeamStride; ++first) static_cast<void>(look(first, kSeamStride));
  for (std::size_t i = 0; i < out.plain; ++i) {
    if (!found[i]) continue;
    out.of[i] = static_cast<std::uint32_t>(out.all.size());
    const auto before = static_cast<std::uint32_t>(patches.size());
    out.all.push_back({before, before + 1, found[i]->before.at, found[i]->across});
    const Patch under = patches[i];
    patches.push_back(side_of(under, found[i]->before, found[i]->points));
    patches.push_back(side_of(under, found[i]->beyond, found[i]->points));
  }
  if (!out.all.empty()) find_crossed(patches, out);
  return out;
}

}  // namespace palpate::render
