// The hashes of another stress.json beside those of a matrix: another compiler, processor, library or number
// of threads must answer the same bits.
#pragma once

#include <map>
#include <string>
#include <utility>
#include <vector>

#include "experiments/stress/matrix.h"

namespace palpate::experiments {

/// What another run answered.
struct OtherHashes {
  std::string file, built_by;  ///< built_by: compiler and processor, as it says
  /// By renderer's label and case; empty where the renderer refused or crashed. Cells that it did not run are
  /// not there.
  std::map<std::pair<std::string, std::string>, std::string> of_cell;
};

/// An Error where the file cannot be read or is no stress.json.
[[nodiscard]] Result<OtherHashes> read_hashes(const std::string& file);

/// One renderer, in the cells that both ran.
struct HashRow {
  std::string renderer;
  render::Role role = render::Role::kOurs;
  std::size_t same = 0;
  std::vector<std::string> different;  ///< cases
};
[[nodiscard]] std::vector<HashRow> compare_hashes(const StressMatrix& matrix, const OtherHashes& other);

[[nodiscard]] Table hash_table(const std::vector<HashRow>& rows, const OtherHashes& other);
/// The member "against" of stress.json, added to its text.
[[nodiscard]] std::string with_hashes(const std::string& stress_json, const std::vector<HashRow>& rows,
                                      const OtherHashes& other);

}  // namespace palpate::experiments
