// The stress matrix: command, table, picture, document and page. Its hashes are compared with another
// stress.json's: other compilers, processors, libraries and thread counts must give identical bits.
#pragma once

#include <map>
#include <string>
#include <utility>
#include <vector>

#include "experiments/report/page.h"
#include "experiments/session/session.h"
#include "experiments/stress/cell.h"

namespace palpate::experiments {

inline constexpr const char* kStressSchema = "palpate-stress/1";
inline constexpr const char* kStressFile = "stress.json";

struct StressMatrix {
  metrics::DocumentHead head;
  std::vector<StressCase> cases;
  std::vector<RendererRequest> renderers;
  std::vector<render::Role> roles;             ///< by renderer
  std::vector<std::vector<StressCell>> cells;  ///< by renderer, then case
};

/// Known reason for a renderer's failure in a case, as a sentence; else empty.
[[nodiscard]] std::string known_reason(const RendererRequest& request, const StressCase& one,
                                       const StressCell& cell);
/// The renderer's command-line text without its label: "cloud:refine=1".
[[nodiscard]] std::string spelled(const RendererRequest& request);

/// Number of failed cells of this role.
[[nodiscard]] std::size_t failures(const StressMatrix& matrix, render::Role role);

/// Cases as rows, renderers as columns.
[[nodiscard]] Table stress_table(const StressMatrix& matrix);
/// Counts of each renderer's cells by status.
[[nodiscard]] Table stress_summary(const StressMatrix& matrix);
/// A square per cell, as SVG.
[[nodiscard]] std::string stress_picture(const StressMatrix& matrix);
[[nodiscard]] std::string stress_json(const StressMatrix& matrix);
[[nodiscard]] Page stress_page(const StressMatrix& matrix);

/// What a stress.json shows: no numbers of its cells and no hashes. Error: the file cannot
/// be read or is no stress.json.
[[nodiscard]] Result<StressMatrix> read_stress(const std::string& file);

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

struct StressArguments {
  std::string renderers;  ///< empty: all
  std::string cases;      ///< names and groups; empty: all
  std::string out;
  std::string against;    ///< another run's stress.json with the expected hashes; empty: none
  double budget_s = 0.0;  ///< 0: unlimited
  double cell_s = 60.0;   ///< per cell
  bool full = false;
  bool quick = false;
  bool json = false;
};

/// Returns the exit status: kExitFellShort if a cell of ours failed.
[[nodiscard]] Result<int> run_stress(const StressArguments& arguments, Context& context);

}  // namespace palpate::experiments
