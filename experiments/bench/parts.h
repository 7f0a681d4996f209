// Parts of the bench: closed triangle meshes from formulas, whose dimensions may be drawn at random. Each is
// brought to one size, so that a hand explores all alike.
#pragma once

#include <optional>
#include <span>
#include <string>

#include <palpate/geometry.h>
#include "toolkit/core/random.h"

namespace palpate::experiments {

/// Longest side of every part's box: what a hand explores without moving the arm.
inline constexpr double kPartExtentMm = 150.0;

/// Where a part's dimensions come from: nominal ones, or drawn around them.
class Dimensions {
 public:
  Dimensions() = default;
  explicit Dimensions(Random random) : random_(random) {}
  /// Within kSpread of the nominal one.
  [[nodiscard]] double length(double nominal) {
    return random_ ? nominal * random_->uniform(1.0 - kSpread, 1.0 + kSpread) : nominal;
  }
  /// From `low` to `high`, both included.
  [[nodiscard]] int count(int nominal, int low, int high) {
    return random_ ? low + static_cast<int>(random_->below(static_cast<std::uint64_t>(high - low) + 1))
                   : nominal;
  }

 private:
  /// Keeps walls, gaps and grooves within a sixth of what makes a part hard.
  static constexpr double kSpread = 0.15;
  std::optional<Random> random_;
};

struct BenchPart {
  const char* name;
  const char* what;  ///< with its nominal dimensions
  geometry::TriangleMesh (*shape)(Dimensions& dimensions);
};
[[nodiscard]] std::span<const BenchPart> bench_parts();

/// The part, seen from outside, kPartExtentMm long. Coordinates are rounded to nine digits: below them the
/// sines of two machines differ, and a hand's path with them.
[[nodiscard]] geometry::TriangleMesh make_part(const BenchPart& part, Dimensions dimensions);

/// The reason why triangles are no closed surface seen from outside ("2 edges without a twin"); empty where
/// every edge is passed once each way, every face has area and the volume is positive.
[[nodiscard]] std::string faults_of(const geometry::TriangleMesh& mesh);

}  // namespace palpate::experiments
