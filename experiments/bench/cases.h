// The cases of the bench: which models are touched, how they were scanned, and along which hand's path. One
// seed gives them all, so that hidden cases are made by the same generators as the public ones.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <palpate/progress.h>
#include <palpate/result.h>
#include "experiments/bench/parts.h"
#include "experiments/run/stage.h"
#include "experiments/study/output_folder.h"

namespace palpate::experiments {

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
