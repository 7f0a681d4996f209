// A sweep's document and page, made from rows only. The document is sweep.json; the page has the fronts.
#pragma once

#include <string>
#include <vector>

#include "experiments/report/page.h"
#include "experiments/trade/row.h"

namespace palpate::experiments {

inline constexpr const char* kSweepFile = "sweep.json";
/// Increases when a key is redefined or removed.
inline constexpr const char* kSweepSchema = "palpate-sweep/2";

struct SweepDocument {
  metrics::DocumentHead head;
  std::string scene, path, truth;  ///< as in result.json; the truth's name and exactness
  std::string experiment;          ///< Row::experiment
  std::vector<std::string> axes;
  bool full = false;
  double budget_s = 0.0;  ///< 0: none
  std::vector<Row> rows;
  std::vector<std::string> not_measured;  ///< settings left for lack of time
  std::vector<std::string> warnings, notes;
};

[[nodiscard]] std::string to_json(const SweepDocument& document);
/// Reads a sweep's head; its rows are in rows.jsonl beside it. Errors name the file.
[[nodiscard]] Result<SweepDocument> read_sweep(const std::string& folder);

/// Tables of undominated rows, most accurate first, one per machine.
[[nodiscard]] std::vector<Table> front_tables(const SweepDocument& document);

/// Draws the figures into the folder.
[[nodiscard]] Page sweep_page(const SweepDocument& document, const OutputFolder& folder);

}  // namespace palpate::experiments
