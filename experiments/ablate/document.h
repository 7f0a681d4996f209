// Output of `palpate compare ablate` from its rows: ablate.json, table and page.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "experiments/report/page.h"

namespace palpate::experiments {

inline constexpr const char* kAblateFile = "ablate.json";
/// Increases when a key is redefined or removed.
inline constexpr const char* kAblateSchema = "palpate-ablate/1";

/// A scene without one stage, measured; a document's first row is the whole scene.
struct AblateRow {
  std::string stage, instead;                        ///< as in Variant; empty stage: the whole scene
  std::string reason;                                ///< why it did not run; empty: it ran
  std::optional<double> instructions, frame_cpu_us;  ///< per frame, over all frames
  std::optional<std::uint64_t> bytes;
  std::optional<double> prepare_ms;
  std::optional<double> error_percent;  ///< RMS change of force, relative to the whole scene's
  std::optional<double>
      truth_percent;  ///< force_rms_percent against the ground truth, if it covers the scene
  std::string trace_hash;
};

[[nodiscard]] std::string to_text(const AblateRow& row);
[[nodiscard]] bool from_text(const std::string& text, AblateRow& row);

struct AblateDocument {
  metrics::DocumentHead head;
  std::string scene, path, renderer;
  std::string truth;              ///< the ground truth's name; empty: none covers the scene
  std::string counted;            ///< how instructions were counted, or why not
  std::vector<AblateRow> rows{};  ///< at least the whole scene
  std::vector<std::string> warnings, notes;
};

[[nodiscard]] std::string to_json(const AblateDocument& document);
[[nodiscard]] Table ablate_table(const AblateDocument& document);
[[nodiscard]] Page ablate_page(const AblateDocument& document);

}  // namespace palpate::experiments
