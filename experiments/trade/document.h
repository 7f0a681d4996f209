// A sweep's document and page, made from rows only. The document is sweep.json; the page has the fronts.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include <palpate/result.h>
#include "experiments/report/page.h"
#include "experiments/report/tables.h"
#include "experiments/trade/row.h"
#include "toolkit/metrics/result_json.h"

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

// `palpate compare --against RESULT`: improvements and regressions beyond both runs' uncertainty.

inline constexpr const char* kAgainstFile = "against.json";
inline constexpr const char* kAgainstSchema = "palpate-against/1";

enum class ChangeVerdict { kBetter, kWorse, kSame };

/// One number of one renderer, before and after.
struct Change {
  std::string label;   ///< the renderer's
  std::string number;  ///< key in result.json, "frame_all.mean_us"
  double before = 0.0, after = 0.0;
  ChangeVerdict verdict = ChangeVerdict::kSame;
  bool is_time = false;
};

struct Changes {
  std::vector<Change> all;
  std::vector<std::string> notes;  ///< uncompared numbers with reasons, whole sentences
  /// True if a number other than a time became worse; times also vary with the machine.
  [[nodiscard]] bool worse_for_sure() const;
};

/// Reads RESULT: a result.json or a study's folder.
[[nodiscard]] Result<metrics::ResultDocument> read_earlier(const std::string& result);

/// Matches renderers by label. Compares times between machines of one kind (CPU, cores, kernel) beyond both
/// intervals, and single preparations beyond kOncePrepared; memory and counted frames exactly. Error:
/// different model, path or truth.
[[nodiscard]] Result<Changes> changes_between(const metrics::ResultDocument& before,
                                              const metrics::ResultDocument& after);

[[nodiscard]] Table changes_table(const Changes& changes);
/// Counts of numbers that became worse or better, stayed the same or are explained by a note; and the first
/// of the changes, numbers that are no times before the others. Two lines of so many columns hold it.
[[nodiscard]] std::string changes_text(const Changes& changes, std::size_t columns);
[[nodiscard]] std::string to_json(const Changes& changes, const metrics::ResultDocument& before,
                                  const metrics::ResultDocument& after);

}  // namespace palpate::experiments
