// What `palpate ablate` says: ablate.json, the table and the page. Made of rows and of nothing that runs.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "experiments/report/page.h"

namespace palpate::experiments {

inline constexpr const char* kAblateFile = "ablate.json";
/// Goes up when a key changes its meaning or goes away.
inline constexpr const char* kAblateSchema = "palpate-ablate/1";

/// A scene without one of its stages, measured; the first row of a document is the whole scene.
struct AblateRow {
  std::string stage, instead;                        ///< as in Variant; the whole scene's stage is empty
  std::string reason;                                ///< why it could not be run; empty: it was
  std::optional<double> instructions, frame_cpu_us;  ///< of a frame, over all frames
  std::optional<std::uint64_t> bytes;
  std::optional<double> prepare_ms;
  std::optional<double> error_percent;  ///< of the whole scene's force: root mean square of the change
  std::optional<double>
      truth_percent;  ///< force_rms_percent against the ground truth, where it knows the scene
  std::string trace_hash;
};

struct AblateDocument {
  metrics::DocumentHead head;
  std::string scene, path, renderer;
  std::string truth;              ///< name of the ground truth; empty: none that knows the scene
  std::string counted;            ///< how instructions were counted, or why not, a sentence
  std::vector<AblateRow> rows{};  ///< at least the whole scene
  std::vector<std::string> warnings, notes;
};

[[nodiscard]] std::string to_json(const AblateDocument& document);
[[nodiscard]] Table ablate_table(const AblateDocument& document);
/// ablate.json and report.html.
[[nodiscard]] Status write_ablate(const AblateDocument& document, const OutputFolder& folder);

}  // namespace palpate::experiments
