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
#include "toolkit/metrics/conditions.h"
#include "toolkit/metrics/machine_info.h"
#include "toolkit/render/capabilities.h"
#include "toolkit/render/renderer.h"
#include "toolkit/trace/replay.h"

namespace palpate::metrics {

/// The document's format; goes up when a key changes its meaning or goes away.
/// /2: frames, accuracy and bounds are over the truth's contact frames and episodes; in /1, which is still
/// read, over those of each renderer.
inline constexpr const char* kResultSchema = "palpate-result/2";
inline constexpr const char* kFormerResultSchema = "palpate-result/1";

enum class RunStatus { kOk, kDidNotFinish, kFailed };

/// The model a renderer was prepared for.
struct ResultModel {
  std::uint64_t points = 0;
  double resolution_mm = 0.0;
};

/// Who made a document, where and when: the head of every document.
struct DocumentHead {
  std::string version;  ///< of Palpate
  std::string commit;
  std::string build;  ///< build type and compiler, in words
  MachineInfo machine;
  std::string started_utc;  ///< ISO 8601, "2026-01-31T12:00:00Z"
  std::string command;      ///< the command line that repeats it; may be empty
};
/// The head as a JSON object, to be the beginning of another document.
[[nodiscard]] std::string head_json(const DocumentHead& head);

/// A model of the scene.
struct StudyModel {
  std::string name;    ///< file or generator, as in the scene
  std::string source;  ///< the file, or the generator with every option
  std::string hash;    ///< of its coordinates in mm: trace_hash_name, sixteen hexadecimal digits
  std::uint64_t points = 0;
  std::string sample;  ///< a file of the study with some of its points, for pictures; may be empty
};

/// The truth along the path.
struct StudyTruth {
  std::string name, exactness;  ///< as in trace::ReferenceTrace
  std::string file;             ///< of the study
  std::string hash;             ///< trace_hash of its frames; empty in earlier documents
};

/// What scores need beside traces and truth.
struct ScoreBasis {
  double stiffness_n_per_mm = 0.0;
  double device_resolution_mm = 0.0;
  double stored_rounding_mm = 0.0;
  std::vector<double> felt_stiffness_n_per_mm;  ///< by model, for energy
  bool forces_comparable = true;                ///< false: the truth lacks what the scene asks of a surface
  double static_friction = 0.0, dynamic_friction = 0.0;  ///< uniform ones; 0: none
};

/// What preparation took, measured around it: what a renderer says of itself is its phases.
struct PrepareClock {
  double wall_ms = 0.0;
  double cpu_ms = 0.0;  ///< of all threads and of the programs that it ran
  /// A part came from a cache: prepare.total_ms is then what the phases say of the day it was made, wall_ms
  /// what it took now, and neither may stand in a headline.
  bool from_cache = false;
};

/// How the frames were timed.
struct TimingOf {
  std::string contact_of;           ///< whose contact frames: "truth", "majority" (of the renderers), "own"
  bool own_process = false;         ///< prepared and timed in a process of its own
  std::uint64_t in_turns_with = 0;  ///< renderers whose passes came in turns with these
  std::optional<std::uint64_t> pinned_cpu;
};

/// One entry of `renderers`. What was not run or has no reference is nothing here and null in the document.
struct RendererResult {
  std::string label;
  std::string name;
  std::vector<std::pair<std::string, std::string>> options;  ///< as resolved, values as text
  render::Role role = render::Role::kRival;
  render::Geometry works_on = render::Geometry::kPoints;
  std::vector<std::string> missing;  ///< what the scene asks for and it leaves out
  RunStatus status = RunStatus::kOk;
  std::string reason;  ///< why it did not finish or failed
  using Model = ResultModel;
  std::optional<Model> model;
  std::optional<render::PrepareReport>
      prepare;      ///< prepare.*; its bytes become memory.bytes and memory.bytes_per_point
  int threads = 0;  ///< of preparation
  std::optional<PrepareClock> prepare_clock;  ///< prepare.wall_ms, cpu_ms, from_cache
  std::optional<TimingOf> timing;
  std::optional<trace::FrameStatistics> frame;          ///< contact frames
  std::optional<trace::FrameStatistics> frame_free;     ///< the others
  std::optional<trace::FrameStatistics> frame_all;      ///< all frames
  std::optional<trace::PacedStatistics> paced;          ///< frame_paced.plain
  std::optional<trace::PacedStatistics> paced_evicted;  ///< frame_paced.evicted
  std::optional<Accuracy> accuracy;
  std::optional<Energy> energy;
  std::string trace_hash;               ///< trace::trace_hash(); empty = null
  std::string trace_file, scores_file;  ///< of the study; empty = null
};

struct ResultDocument : DocumentHead {
  std::string schema = kResultSchema;
  std::string title;                       ///< of the study, for a person; may be empty
  std::string about;                       ///< what it is about, a sentence or two; may be empty
  std::string scene;                       ///< the scene file, or the model as given
  std::string path;                        ///< the path's name
  std::string path_hash{};                 ///< of its times and positions; empty in earlier documents
  std::optional<Conditions> conditions{};  ///< nothing: nothing was timed yet
  std::vector<StudyModel> models{};        ///< of the scene
  std::optional<StudyTruth> truth{};       ///< nothing: there is none
  std::optional<ScoreBasis> scoring{};     ///< nothing: what is measured here is no study
  std::vector<std::string> warnings{};  ///< of scene and path, for all renderers: what makes results doubtful
  std::vector<std::string> notes{};     ///< of scene and path: what a reader should know
  bool complete = true;                 ///< false: the run goes on, or was interrupted
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
