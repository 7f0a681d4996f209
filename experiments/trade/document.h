// What a sweep says: sweep.json, and the page with its fronts. Both are made of rows and of nothing that
// runs.
#pragma once

#include <string>
#include <vector>

#include "experiments/report/page.h"
#include "experiments/trade/dominance.h"
#include "experiments/trade/row.h"

namespace palpate::experiments {

inline constexpr const char* kSweepFile = "sweep.json";
/// Goes up when a key changes its meaning or goes away.
inline constexpr const char* kSweepSchema = "palpate-sweep/1";

struct SweepDocument {
  metrics::DocumentHead head;
  std::string scene, path, truth;  ///< as in result.json; the truth's name and exactness
  std::string experiment;          ///< Row::experiment
  std::vector<std::string> axes;
  bool full = false;
  double budget_s = 0.0;  ///< 0: none
  std::string shard;      ///< "2/8"; empty: all of it
  std::vector<Row> rows;
  std::vector<std::string> not_measured;  ///< settings for which there was no time
  std::vector<std::string> warnings, notes;
};

[[nodiscard]] std::string to_json(const SweepDocument& document);
/// The head of an earlier one; its rows are those of rows.jsonl beside it. Errors name file and key.
[[nodiscard]] Result<SweepDocument> read_sweep(const std::string& folder);

/// Rows that are dominated by nobody, the most accurate first: of one machine each, as a table.
[[nodiscard]] std::vector<Table> front_tables(const SweepDocument& document);

/// sweep.json, rows.jsonl, report.html with its figures.
[[nodiscard]] Status write_sweep(const SweepDocument& document, const OutputFolder& folder);

}  // namespace palpate::experiments
