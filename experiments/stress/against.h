// Compares a matrix's hashes with another stress.json's. Other compilers, processors, libraries and thread
// counts must give identical bits.
#pragma once

#include <map>
#include <string>
#include <utility>
#include <vector>

#include "experiments/stress/matrix.h"

namespace palpate::experiments {

/// Another run's answers.
struct OtherHashes {
  std::string file, built_by;  ///< built_by: compiler and processor
  /// By renderer label and case; empty for a refusal or crash. Cells not run are absent.
  std::map<std::pair<std::string, std::string>, std::string> of_cell;
};

/// Error: the file cannot be read or is no stress.json.
[[nodiscard]] Result<OtherHashes> read_hashes(const std::string& file);

/// One renderer in the cells common to both runs.
struct HashRow {
  std::string renderer;
  render::Role role = render::Role::kOurs;
  std::size_t same = 0;
  std::vector<std::string> different;  ///< cases
};
[[nodiscard]] std::vector<HashRow> compare_hashes(const StressMatrix& matrix, const OtherHashes& other);

[[nodiscard]] Table hash_table(const std::vector<HashRow>& rows, const OtherHashes& other);
/// Adds the member "against" to the text of stress.json.
[[nodiscard]] std::string with_hashes(const std::string& stress_json, const std::vector<HashRow>& rows,
                                      const OtherHashes& other);

}  // namespace palpate::experiments
