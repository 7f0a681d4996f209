#include "toolkit/smooth/folds.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include "toolkit/core/parallel.h"
#include "toolkit/smooth/patch_cells.h"

namespace palpate::render {
namespace {

/// A face follows more points than what lies over its crease, and reaches as far.
constexpr double kMorePoints = 1.4;
/// It reaches the middle of the patch, or a fifth of its support farther: the points say that it goes on
/// there.
constexpr double kReachesSq = 1.44;
/// Faces looked at: those that count most at the place.
constexpr std::size_t kMostFaces = 6;
/// Normals that differ by less (58 degrees) over a patch may be a rounded edge's: two faces further round it
/// explain a part of it better than a quadric does, and are no crease.
constexpr double kFoldSine = 0.85;
/// What is left of a clean surface over a large patch, in spacings.
constexpr double kFoldSpacings = 0.02;
/// A point farther off than three standard deviations is off, and it does not matter how far.
constexpr double kMostCost = 9.0;
/// The fold explains the points better than the patch by so much, which follows them with six numbers of its
/// own and would gain as much from noise alone: with even odds a rounded edge is taken for a crease.
constexpr double kBetterBy = 10.0;
/// Of the points so many are on the fold, and this share on either face.
constexpr double kOnFold = 0.75, kOnEither = 0.15;
constexpr std::size_t kFoldGrain = 128;
constexpr int kPieceFootSteps = 2;
constexpr std::uint32_t kNoFace = 0xffffffffu;

/// From a patch's middle, along its tangent plane.
double lateral_sq(const Patch& p, const Vec3& at) {
  const Vec3 d = at - p.quadric.at;
  const double along = d.dot(p.quadric.n);
  return d.squaredNorm() - along * along;
}

struct Fold {
  std::uint32_t a = kNoFace, b = kNoFace;
  int points_a = 0, points_b = 0;
  Vec3 middle_a = Vec3::Zero(), middle_b = Vec3::Zero();  ///< of the points of either
};

/// A face around the middle of the points that it has of another patch, as far as that one went.
Patch piece_of(const Patch& face, const Patch& over, int points, const Vec3& middle) {
  Patch out = face;
  Quadric& q = out.quadric;
  q.at = middle;
  for (int i = 0; i < kPieceFootSteps; ++i)
    q.at -= normal_at(face.quadric, q.at) * face.quadric.residual(q.at);
  turn_to(q, normal_at(face.quadric, q.at));
  out.support = out.reached = over.support;
  out.spacing = over.spacing;
  out.points = points;
  out.filled = Filled();
  return out;
}

struct FaceOf {
  double weight;
  std::uint32_t patch;
};

class FoldFinder {
 public:
  FoldFinder(const SmoothPoints& points, const std::vector<Patch>& patches, const PatchCells& cells)
      : points_(points), patches_(patches), cells_(cells) {}

  /// The two patches whose fold a patch's points follow, or none.
  Fold of(std::uint32_t index) {
    const Patch& p = patches_[index];
    find_faces(p);
    if (!any_crease()) return {};
    ball_.gather(points_, p.quadric.at, p.support);
    const double sigma = std::max(p.noise, kFoldSpacings * p.spacing);
    const double own = cost_of(p, 1.0 / sigma), most = own - kBetterBy;
    for (std::size_t k = 0; k < faces_.size(); ++k) fill(patches_[faces_[k].patch], 1.0 / sigma, off_[k]);
    double least = most;
    Fold best;
    for (std::size_t i = 0; i < faces_.size(); ++i)
      for (std::size_t j = 0; j < i; ++j) {
        if (!creased(faces_[i].patch, faces_[j].patch)) continue;
        Fold fold{faces_[i].patch, faces_[j].patch};
        const double cost = fold_cost(off_[i], off_[j], fold);
        if (!(cost < least)) continue;
        least = cost;
        best = fold;
      }
    if (best.a != kNoFace) find_middles(best);
    return best;
  }

 private:
  /// The middles of the points nearer to the one face, and to the other.
  void find_middles(Fold& fold) const {
    const Patch &a = patches_[fold.a], &b = patches_[fold.b];
    Vec3 sum_a = Vec3::Zero(), sum_b = Vec3::Zero();
    int count_a = 0, count_b = 0;
    for (const Vec3& away : ball_.away) {
      const Vec3 at = ball_.centre + away;
      const bool is_a = std::abs(a.quadric.residual(at)) < std::abs(b.quadric.residual(at));
      (is_a ? sum_a : sum_b) += away;
      ++(is_a ? count_a : count_b);
    }
    fold.middle_a = ball_.centre + sum_a / std::max(count_a, 1);
    fold.middle_b = ball_.centre + sum_b / std::max(count_b, 1);
  }
  void find_faces(const Patch& p) {
    faces_.clear();
    for (int s = cells_.scale_of(p.support); s < kPatchScales; ++s) {
      if (!cells_.any(s)) continue;
      cells_.near(p.quadric.at, s, [&](std::uint32_t j) {
        const Patch& face = patches_[j];
        if (face.support < p.support || face.points < kMorePoints * p.points) return;
        const double share = lateral_sq(face, p.quadric.at) / (face.support * face.support);
        if (share < kReachesSq && std::abs(face.quadric.n.dot(p.quadric.at - face.quadric.at)) < face.support)
          faces_.push_back({face.trust * patch_weight(share / kReachesSq), j});
      });
    }
    std::sort(faces_.begin(), faces_.end(), [](const FaceOf& x, const FaceOf& y) {
      return x.weight != y.weight ? x.weight > y.weight : x.patch < y.patch;
    });
    if (faces_.size() > kMostFaces) faces_.resize(kMostFaces);
  }
  [[nodiscard]] bool creased(std::uint32_t a, std::uint32_t b) const {
    const double cosine = patches_[a].quadric.n.dot(patches_[b].quadric.n);
    return 1.0 - cosine * cosine > kFoldSine * kFoldSine;
  }
  [[nodiscard]] bool any_crease() const {
    for (std::size_t i = 0; i < faces_.size(); ++i)
      for (std::size_t j = 0; j < i; ++j)
        if (creased(faces_[i].patch, faces_[j].patch)) return true;
    return false;
  }
  void fill(const Patch& face, double per, std::vector<double>& off) const {
    off.clear();
    for (const Vec3& away : ball_.away) off.push_back(per * face.quadric.residual(ball_.centre + away));
  }
  double cost_of(const Patch& p, double per) {
    fill(p, per, own_);
    double cost = 0.0;
    for (const double r : own_) cost += std::min(r * r, kMostCost);
    return cost;
  }
  /// The least of the four folds that two surfaces make; infinite where it is no crease of these points.
  [[nodiscard]] static double fold_cost(const std::vector<double>& a, const std::vector<double>& b,
                                        Fold& fold) {
    double least = std::numeric_limits<double>::infinity();
    const std::size_t count = a.size();
    for (const double side : {1.0, -1.0})
      for (const bool greater : {true, false}) {
        double cost = 0.0, on = 0.0, on_a = 0.0;
        for (std::size_t i = 0; i < count; ++i) {
          const double x = a[i], y = side * b[i];
          const bool is_a = (x > y) == greater;
          const double r = is_a ? x : y, sq = r * r;
          cost += std::min(sq, kMostCost);
          on += sq < kMostCost ? 1.0 : 0.0;
          on_a += sq < kMostCost && is_a ? 1.0 : 0.0;
        }
        const double n = static_cast<double>(count);
        if (on < kOnFold * n || std::min(on_a, on - on_a) < kOnEither * n) continue;
        if (!(cost < least)) continue;
        least = cost;
        fold.points_a = static_cast<int>(on_a);
        fold.points_b = static_cast<int>(on - on_a);
      }
    return least;
  }

  const SmoothPoints& points_;
  const std::vector<Patch>& patches_;
  const PatchCells& cells_;
  Ball ball_;
  std::vector<FaceOf> faces_;
  std::array<std::vector<double>, kMostFaces> off_;
  std::vector<double> own_;
};

}  // namespace

void part_folded(const SmoothPoints& points, std::vector<Patch>& patches, int threads) {
  if (patches.empty()) return;
  std::vector<Fold> folds(patches.size());
  const PatchCells cells(patches);
  parallel_chunks(patches.size(), kFoldGrain, threads, [&](std::size_t begin, std::size_t end) {
    FoldFinder finder(points, patches, cells);
    for (std::size_t i = begin; i < end; ++i) folds[i] = finder.of(static_cast<std::uint32_t>(i));
  });
  // A face must itself stay: it follows more points, and its fate is known.
  std::vector<std::uint32_t> order(patches.size());
  std::iota(order.begin(), order.end(), 0u);
  std::sort(order.begin(), order.end(), [&](std::uint32_t x, std::uint32_t y) {
    return patches[x].points != patches[y].points ? patches[x].points > patches[y].points : x < y;
  });
  std::vector<std::uint8_t> parted(patches.size(), 0);
  for (const std::uint32_t i : order)
    parted[i] = folds[i].a != kNoFace && parted[folds[i].a] == 0 && parted[folds[i].b] == 0;
  std::vector<Patch> out;
  out.reserve(patches.size());
  for (std::size_t i = 0; i < patches.size(); ++i) {
    if (parted[i] == 0) {
      out.push_back(patches[i]);
      continue;
    }
    const Fold& fold = folds[i];
    out.push_back(piece_of(patches[fold.a], patches[i], fold.points_a, fold.middle_a));
    out.push_back(piece_of(patches[fold.b], patches[i], fold.points_b, fold.middle_b));
  }
  patches = std::move(out);
}

}  // namespace palpate::render
