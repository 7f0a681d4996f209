#include "toolkit/search/knn.h"

#include <Eigen/Eigenvalues>

#include <array>
#include <cmath>
#include <numbers>
#include <optional>
#include <span>

#include "toolkit/search/knn_engine.h"

namespace palpate::search {
namespace {

/// tan(22.5 degrees), the border between a main direction and the next diagonal.
constexpr double kTanBorder = std::numbers::sqrt2 - 1.0;
/// Points are collinear if the second eigenvalue is below this share of the first: a millionth of the length,
/// the rounding of stored floats.
constexpr double kInLine = 1e-12;

/// Two directions in the plane, and the normal.
struct Frame {
  Vec3 east = Vec3::UnitX(), north = Vec3::UnitY(), normal = Vec3::UnitZ();
  bool plane = true;
};

/// East is the x axis projected to the plane, or y if x is nearly the normal.
Frame frame_around(const Vec3& normal) {
  Frame frame;
  int longest = 0;
  normal.cwiseAbs().maxCoeff(&longest);
  frame.normal = normal[longest] < 0.0 ? Vec3(-normal) : normal;
  const Vec3 axis = longest == 0 ? Vec3::UnitY() : Vec3::UnitX();
  frame.east = (axis - axis.dot(frame.normal) * frame.normal).normalized();
  frame.north = frame.normal.cross(frame.east);
  return frame;
}

/// The best-fitting plane of the point (at 0) and the offsets, all at most `size` long.
Frame fitted(std::span<const Vec3> offsets, double size) {
  Vec3 sum = Vec3::Zero();
  Eigen::Matrix3d products = Eigen::Matrix3d::Zero();
  for (const Vec3& offset : offsets) {
    const Vec3 d = offset / size;  // squares of tiny and huge lengths would under- or overflow
    sum += d;
    products += d * d.transpose();
  }
  const Eigen::Matrix3d scatter = products - sum * sum.transpose() / static_cast<double>(offsets.size() + 1);
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver;
  solver.computeDirect(scatter);
  const Vec3 values = solver.eigenvalues();
  if (values[1] > kInLine * values[2]) return frame_around(solver.eigenvectors().col(0));
  // Every plane through a line fits: takes the flattest.
  const Vec3 line = solver.eigenvectors().col(2);
  int shortest = 0;
  line.cwiseAbs().minCoeff(&shortest);
  const Vec3 axis = line.head<2>().norm() > kTanBorder ? Vec3::UnitZ() : Vec3::Unit(shortest);
  Frame frame = frame_around((axis - axis.dot(line) * line).normalized());
  frame.plane = false;
  return frame;
}

/// 0 is east, 1 north-east, counter-clockwise; none above, below and at the same place.
std::optional<std::size_t> direction_of(const Frame& frame, const Vec3& offset, double tan_sq) noexcept {
  const double e = offset.dot(frame.east), n = offset.dot(frame.north), up = offset.dot(frame.normal);
  const double flat_sq = e * e + n * n;
  if (!(flat_sq > 0.0) || up * up > tan_sq * flat_sq) return std::nullopt;
  const double along = std::abs(e), across = std::abs(n);
  if (across <= kTanBorder * along) return e > 0.0 ? 0 : 4;
  if (along <= kTanBorder * across) return n > 0.0 ? 2 : 6;
  if (n > 0.0) return e > 0.0 ? 1 : 3;
  return e > 0.0 ? 7 : 5;
}

/// The best of each direction so far.
struct Directions {
  std::array<double, kNeighbours> square;
  std::array<std::uint32_t, kNeighbours> index{};
  std::size_t filled = 0;
  Directions() { square.fill(kNoLimit); }

  /// Whether it was the best so far, and every direction has one.
  bool offer(std::size_t at, double sq, std::uint32_t i) noexcept {
    if (!(sq < square[at] || (sq == square[at] && i < index[at]))) return false;
    filled += static_cast<std::size_t>(square[at] == kNoLimit);
    square[at] = sq;
    index[at] = i;
    return filled == kNeighbours;
  }
  /// Infinite while a direction is empty.
  [[nodiscard]] double worst() const noexcept {
    double far = 0.0;
    for (const double sq : square) far = std::max(far, sq);
    return far;
  }
  void store(std::uint32_t self, Neighbours& out) const noexcept {
    NearestEight sorted;
    for (std::size_t k = 0; k < kNeighbours; ++k)
      if (square[k] != kNoLimit) sorted.offer(square[k], index[k]);
    sorted.store(self, out);
  }
};

/// Places in KnnScratch::sums.
enum DirectionalSum : std::size_t { kAllEight, kEmpty, kNoPlane };

class Chooser {
 public:
  Chooser(const cloud::Cloud& cloud, const DirectionalKnnOptions& options)
      : cloud_(cloud), options_(options), reach_sq_(options.reach * options.reach) {
    const double tan = std::tan(options.steepest_deg * std::numbers::pi / 180.0);
    tan_sq_ = options.steepest_deg < 90.0 ? tan * tan : kNoLimit;
  }

  bool operator()(std::uint32_t self, const Vec3& p, const Candidates& c, double radius_mm, Neighbours& out,
                  KnnScratch& scratch) const {
    const double covered = radius_mm * radius_mm;
    bool again = false;
    for (double guess = scratch.guess;;) {
      const bool all = !(guess < covered);
      const bool whole = all && radius_mm == kNoLimit;
      kernels().keep_ball(c, p, all ? kNoLimit : guess, scratch);
      const double known = all ? covered : guess;  // complete up to here
      const Nearest near = nearest_elsewhere(self, p, scratch);
      if (!whole && !(near.worst < known)) {
        if (all) return false;
        guess = larger_guess(guess);
        continue;
      }
      const double limit = near.count == kNeighbours ? reach_sq_ * near.worst : kNoLimit;
      const Frame frame = frame_at(near);
      const Directions found = search(frame, p, self, limit, c, scratch);
      if (!(found.worst() < known || limit < known || whole)) {
        if (all) return false;
        // An empty direction may stay empty, so growing in steps is wasteful.
        guess = std::max(larger_guess(guess), again ? kGuessMarginSq * limit : 0.0);
        again = true;
        continue;
      }
      scratch.guess = kGuessMarginSq * std::min(found.worst(), limit);
      scratch.sums[kAllEight] += found.filled == kNeighbours;
      scratch.sums[kEmpty] += kNeighbours - found.filled;
      scratch.sums[kNoPlane] += !frame.plane;
      found.store(self, out);
      return true;
    }
  }

 private:
  /// The eight nearest points that do not coincide.
  struct Nearest {
    std::array<Vec3, kNeighbours> offset;
    std::size_t count = 0;
    double worst = kNoLimit;  ///< squared distance of the eighth
  };
  Nearest nearest_elsewhere(std::uint32_t self, const Vec3& p, const KnnScratch& scratch) const {
    Neighbours around;
    Nearest near;
    near.worst = kernels().choose_eight(self, scratch, around);
    if (around[0] == self || (cloud_.local_mm(around[0]) - p).squaredNorm() > 0.0) {
      for (; near.count < kNeighbours && around[near.count] != self; ++near.count)
        near.offset[near.count] = cloud_.local_mm(around[near.count]) - p;
      return near;
    }
    NearestEight elsewhere;
    for (std::size_t k = 0; k < scratch.count; ++k)
      if (scratch.square[k] > 0.0 && scratch.index[k] != self)
        elsewhere.offer(scratch.square[k], scratch.index[k]);
    elsewhere.store(self, around);
    near.worst = elsewhere.worst();
    for (; near.count < elsewhere.count(); ++near.count)
      near.offset[near.count] = cloud_.local_mm(around[near.count]) - p;
    return near;
  }

  Frame frame_at(const Nearest& near) const {
    if (options_.frame == DirectionalKnnOptions::Frame::kPlan) return {};
    const auto offsets = std::span(near.offset).first(near.count);
    double size = 0.0;
    for (const Vec3& offset : offsets) size = std::max(size, offset.cwiseAbs().maxCoeff());
    if (near.count > 0) return fitted(offsets, size);
    Frame none;
    none.plane = false;
    return none;
  }

  Directions search(const Frame& frame, const Vec3& p, std::uint32_t self, double limit, const Candidates& c,
                    const KnnScratch& scratch) const {
    Directions found;
    double far = limit;  // nothing farther can be the best of its direction
    for (std::size_t k = 0; k < scratch.count; ++k) {
      if (scratch.square[k] > far || !(scratch.square[k] > 0.0) || scratch.index[k] == self) continue;
      const std::size_t at = scratch.kept[k];
      const Vec3 other(static_cast<double>(c.x[at]), static_cast<double>(c.y[at]),
                       static_cast<double>(c.z[at]));
      const auto direction = direction_of(frame, other - p, tan_sq_);
      if (direction && found.offer(*direction, scratch.square[k], scratch.index[k]))
        far = std::min(limit, found.worst());
    }
    return found;
  }

  const cloud::Cloud& cloud_;
  const DirectionalKnnOptions& options_;
  double reach_sq_;
  double tan_sq_ = 1.0;
};

}  // namespace

NeighbourTable directional_knn(const cloud::Cloud& cloud, const DirectionalKnnOptions& options, int threads,
                               DirectionalKnnReport* report) {
  const KnnEngine engine(cloud, threads);
  NeighbourTable table;
  const auto sums = engine.run(Chooser(cloud, options), table);
  if (report != nullptr) *report = {sums[kAllEight], sums[kEmpty], sums[kNoPlane]};
  return table;
}

}  // namespace palpate::search
