// `palpate compare --against RESULT`: what became better or worse since an earlier run, beyond what both
// runs know of their numbers.
#pragma once

#include <string>
#include <vector>

#include "experiments/report/tables.h"
#include "toolkit/core/result.h"
#include "toolkit/metrics/result_json.h"

namespace palpate::experiments {

inline constexpr const char* kAgainstFile = "against.json";
inline constexpr const char* kAgainstSchema = "palpate-against/1";

enum class ChangeVerdict { kBetter, kWorse, kSame };

/// One number of one renderer, before and after.
struct Change {
  std::string label;   ///< of the renderer
  std::string number;  ///< its key in result.json, "frame_all.mean_us"
  double before = 0.0, after = 0.0;
  ChangeVerdict verdict = ChangeVerdict::kSame;
  bool is_time = false;
};

struct Changes {
  std::vector<Change> all;
  std::vector<std::string> notes;  ///< what was not compared, and why: whole sentences
  /// Something other than a time became worse: times differ from run to run for reasons of the machine's.
  [[nodiscard]] bool worse_for_sure() const;
};

/// Reads RESULT: a result.json, or the folder of a study.
[[nodiscard]] Result<metrics::ResultDocument> read_earlier(const std::string& result);

/// Renderers are told apart by their labels. Times are compared where both ran on machines of one kind (CPU,
/// cores, kernel), and beyond both intervals; a preparation, which is made once, beyond kOncePrepared. Memory
/// and counted frames are exact. An Error where the two are not of one model, path and truth.
[[nodiscard]] Result<Changes> changes_between(const metrics::ResultDocument& before,
                                              const metrics::ResultDocument& after);

[[nodiscard]] Table changes_table(const Changes& changes);
[[nodiscard]] std::string to_json(const Changes& changes, const metrics::ResultDocument& before,
                                  const metrics::ResultDocument& after);

}  // namespace palpate::experiments
