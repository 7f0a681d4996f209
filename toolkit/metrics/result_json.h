// The result document (result.json): tables and figures are a pure function of it. docs/result.schema.json
// describes it.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "toolkit/core/result.h"
#include "toolkit/metrics/accuracy.h"
#include "toolkit/metrics/machine_info.h"
#include "toolkit/render/renderer.h"
#include "toolkit/trace/replay.h"

namespace palpate::metrics {

/// The document's format; goes up when a key changes its meaning or goes away.
inline constexpr const char* kResultSchema = "palpate-result/1";

enum class RunStatus { kOk, kDidNotFinish, kFailed };

/// The model a renderer was prepared for.
struct ResultModel {
  std::uint64_t points = 0;
  double resolution_mm = 0.0;
};

/// One entry of `renderers`. What was not run or has no reference is nothing here and null in the document.
struct RendererResult {
  std::string label;
  std::string name;
  std::vector<std::pair<std::string, std::string>> options;  ///< as resolved, values as text
  RunStatus status = RunStatus::kOk;
  std::string reason;  ///< why it did not finish or failed
  using Model = ResultModel;
  std::optional<Model> model;
  std::optional<render::PrepareReport>
      prepare;      ///< prepare.*; its bytes become memory.bytes and memory.bytes_per_point
  int threads = 0;  ///< of preparation
  std::optional<trace::FrameStatistics> frame;          ///< contact frames
  std::optional<trace::FrameStatistics> frame_all;      ///< all frames
  std::optional<trace::PacedStatistics> paced;          ///< frame_paced.plain
  std::optional<trace::PacedStatistics> paced_evicted;  ///< frame_paced.evicted
  std::optional<Accuracy> accuracy;
  std::optional<Energy> energy;
  std::string trace_hash;  ///< trace::trace_hash(); empty = null

  /// Takes over what a replay measured.
  void take(const trace::ReplayReport& report);
};

struct ResultDocument {
  std::string schema = kResultSchema;
  std::string version;  ///< of Palpate
  std::string commit;
  std::string build;  ///< build type and compiler, in words
  MachineInfo machine;
  std::string scene;        ///< the scene file, or the model as given
  std::string path;         ///< the path's name
  std::string started_utc;  ///< ISO 8601, "2026-01-31T12:00:00Z"
  std::string command;      ///< the command line that repeats it; may be empty
  std::vector<RendererResult> renderers;
};

/// Indented JSON, keys in a fixed order, numbers with the fewest digits that read back to the same bits. A
/// number that is not finite becomes null.
[[nodiscard]] std::string to_json(const ResultDocument& document);

/// Reads what to_json wrote, and tolerates keys it does not know. A text that is no JSON, another schema, or
/// a key of the wrong type is an Error that names the key. `source` is the file's name for messages.
[[nodiscard]] Result<ResultDocument> parse_result(std::string_view json,
                                                  std::string_view source = "result.json");

}  // namespace palpate::metrics
