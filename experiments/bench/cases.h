// The cases of the bench: which models are touched, how they were scanned, and along which hand's path. One
// seed gives them all, so that hidden cases are made by the same generators as the public ones.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <palpate/geometry.h>
#include <palpate/progress.h>
#include <palpate/result.h>
#include "experiments/run/stage.h"
#include "experiments/study/study.h"
#include "toolkit/core/random.h"

namespace palpate::experiments {

// Parts of the bench: closed triangle meshes from formulas, whose dimensions may be drawn at random. Each is
// brought to one size, so that a hand explores all alike.

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

// The cases.

/// Rises when any case, score or rule changes: results of two versions are not compared.
inline constexpr int kBenchVersion = 1;

/// Seed from which the cases are drawn. Its text is never written anywhere; its hash is.
struct BenchSeed {
  std::string name;      ///< "public", "nominal" or "secret"
  std::string sha256;    ///< of version and text
  std::uint64_t number;  ///< for random numbers
};
/// Empty or "public": the published seed. "nominal": the parts' nominal dimensions. Other texts are secret
/// and have at least sixteen characters, so that nobody finds them from the hash by trying.
[[nodiscard]] Result<BenchSeed> read_seed(const std::string& text);

struct BenchCase {
  std::string name;       ///< SHAPE-SCANNER, a folder's name
  std::string shape;      ///< cases of one shape are not independent
  const BenchPart* part;  ///< null: a shape with a formula
  Dimensions drawn;       ///< of the part
  std::string points;     ///< how a part is sampled, or the generator
  std::string path;       ///< a generator's
};
/// All cases of this version, in order. `quick`: the same shapes with few points and frames.
[[nodiscard]] std::vector<BenchCase> bench_cases(const BenchSeed& seed, bool quick);

/// Points, hand's path and truth, ready for renderers. A part's exact mesh is put into `folder`, as
/// truth/NAME.ply.
[[nodiscard]] Result<Stage> bench_stage(const BenchCase& one, const OutputFolder& folder, int threads,
                                        Progress& progress);

/// Identity of a case, for others to check: hashes of its points, its path and the truth along it.
struct CaseInputs {
  std::string name, shape;
  std::uint64_t points = 0, frames = 0;
  std::string points_hash, path_hash, truth_hash;
};
[[nodiscard]] CaseInputs inputs_of(const BenchCase& one, const Stage& stage);

}  // namespace palpate::experiments
