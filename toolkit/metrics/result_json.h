// The result document (result.json); schema: docs/schemas/result.schema.json. It is the only source of tables
// and figures.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <palpate/accuracy.h>
#include <palpate/registry.h>
#include <palpate/renderer.h>
#include <palpate/replay.h>
#include <palpate/result.h>
#include "toolkit/metrics/machine_info.h"
#include "toolkit/metrics/scores.h"

namespace palpate::metrics {

/// Format version; rises when a key changes its meaning or is removed. /2: frames, accuracy and bounds are
/// over the truth's contact frames and episodes; in /1, still readable, over each renderer's.
inline constexpr const char* kResultSchema = "palpate-result/2";
inline constexpr const char* kFormerResultSchema = "palpate-result/1";

enum class RunStatus { kOk, kDidNotFinish, kFailed };

/// Origin of a document: the head of every document.
struct DocumentHead {
  std::string version;  ///< of Palpate
  std::string commit;
  std::string build;  ///< build type and compiler, in words
  MachineInfo machine;
  std::string started_utc;  ///< ISO 8601, "2026-01-31T12:00:00Z"
  std::string command;      ///< the command that reproduces it; may be empty
};
/// The head as a JSON object, to begin another document.
[[nodiscard]] std::string head_json(const DocumentHead& head);

/// A model of the scene.
struct StudyModel {
  std::string name;    ///< file or generator, as in the scene
  std::string source;  ///< the file, or the generator with every option
  std::string hash;    ///< of its coordinates in mm: trace_hash_name, sixteen hexadecimal digits
  std::uint64_t points = 0;
  std::string sample;  ///< file with some of its points, for pictures; may be empty
};

/// The truth along the path.
struct StudyTruth {
  std::string name, exactness;  ///< as in trace::ReferenceTrace
  std::string file;             ///< of the study
  std::string hash;             ///< trace_hash of its frames; empty in earlier documents
};

/// Input of scores besides traces and truth.
struct ScoreBasis {
  double stiffness_n_per_mm = 0.0;
  double device_resolution_mm = 0.0;
  double stored_rounding_mm = 0.0;
  std::vector<double> felt_stiffness_n_per_mm;  ///< per model, for energy
  bool forces_comparable = true;                ///< false: the truth lacks surface properties of the scene
  double static_friction = 0.0, dynamic_friction = 0.0;  ///< if uniform; 0 = none
};

/// Preparation measured from outside; the renderer reports its phases itself.
struct PrepareTimes {
  double wall_ms = 0.0;
  double cpu_ms = 0.0;  ///< of all threads and child processes
  /// A part came from a cache: prepare.total_ms is then the original time and wall_ms the present one;
  /// neither may be a headline.
  bool from_cache = false;
};

/// Conditions of the frames' timing.
struct TimingConditions {
  std::string contact_of;           ///< contact frames by "truth", "majority" (of renderers) or "own"
  bool own_process = false;         ///< prepared and timed in its own process
  std::uint64_t in_turns_with = 0;  ///< renderers whose passes alternated with these
  std::optional<std::uint64_t> pinned_cpu;
  /// Of pages, by frames of the passes that time stretches: met for the first time, and read from disk.
  std::optional<std::uint64_t> minor_faults, major_faults;
};

/// The model a renderer was prepared for. Outside of RendererResult: clang 14 makes no optional of a nested
/// type whose members have initial values.
struct ResultModel {
  std::uint64_t points = 0;
  double resolution_mm = 0.0;
};

/// One entry of `renderers`. Fields not run or without a reference are empty, null in the document.
struct RendererResult {
  std::string label;
  std::string name;
  std::vector<std::pair<std::string, std::string>> options;  ///< as resolved, values as text
  render::Role role = render::Role::kRival;
  render::Geometry works_on = render::Geometry::kPoints;
  std::vector<std::string> missing;  ///< features of the scene that it leaves out
  RunStatus status = RunStatus::kOk;
  std::string reason;  ///< why it did not finish, or failed
  using Model = ResultModel;
  std::optional<Model> model;
  std::optional<render::PrepareReport>
      prepare;      ///< prepare.*; its bytes become memory.bytes and memory.bytes_per_point
  int threads = 0;  ///< of preparation
  std::optional<PrepareTimes> prepare_clock;  ///< prepare.wall_ms, cpu_ms, from_cache
  std::optional<TimingConditions> timing;
  std::optional<trace::FrameStatistics> frame;          ///< contact frames
  std::optional<trace::FrameStatistics> frame_free;     ///< free frames
  std::optional<trace::FrameStatistics> frame_all;      ///< all frames
  std::optional<trace::PacedStatistics> paced;          ///< frame_paced.plain
  std::optional<trace::PacedStatistics> paced_evicted;  ///< frame_paced.evicted
  std::optional<Accuracy> accuracy;
  std::optional<Energy> energy;
  std::optional<StreamScores> stream;   ///< of depth images that replaced the surface
  std::string trace_hash;               ///< trace::trace_hash(); empty = null
  std::string trace_file, scores_file;  ///< of the study; empty = null
};

struct ResultDocument : DocumentHead {
  std::string schema = kResultSchema;
  std::string title;        ///< of the study, for a person; may be empty
  std::string about;        ///< a sentence or two about it; may be empty
  std::string scene;        ///< the scene file, or the model as given
  std::string path;         ///< the path's name
  std::string path_hash{};  ///< of its times and positions; empty in earlier documents
  std::optional<MeasurementConditions> conditions{};  ///< empty: nothing is timed yet
  std::vector<StudyModel> models{};                   ///< of the scene
  std::optional<StudyTruth> truth{};                  ///< empty: none
  std::optional<ScoreBasis> scoring{};                ///< empty: not a study
  std::vector<std::string> warnings{};  ///< on scene and path, for all renderers: reasons to doubt
  std::vector<std::string> notes{};     ///< on scene and path: findings
  bool complete = true;                 ///< false: running or interrupted
  std::vector<RendererResult> renderers;
};

/// Indented JSON with fixed key order and the fewest digits that read back to the same bits. Non-finite
/// numbers become null.
[[nodiscard]] std::string to_json(const ResultDocument& document);

/// Reads to_json's output and ignores unknown keys. Errors name the key: invalid JSON, another schema, a
/// wrong type. `source`: file name for messages.
[[nodiscard]] Result<ResultDocument> parse_result(std::string_view json,
                                                  std::string_view source = "result.json");

}  // namespace palpate::metrics
