// `palpate compare ablate`: leaves out each stage of a scene in turn (surface effects, motion, control,
// cleaning, or renderer options) and measures savings and losses: ablate.json, table and page.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <palpate/decision.h>
#include <palpate/registry.h>
#include <palpate/scene.h>
#include "experiments/driver/json_document.h"
#include "experiments/driver/study_run.h"
#include "experiments/report/page.h"
#include "experiments/run/arguments.h"

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

PALPATE_JSON_MEMBERS(AblateRow, stage, instead, reason, instructions, frame_cpu_us, bytes, prepare_ms,
                     error_percent, truth_percent, trace_hash)

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

struct Variant {
  std::string stage;    ///< the missing stage: "friction", "model 2, bunny"; empty: none
  std::string instead;  ///< its replacement, a few words
  scene::LoadedScene scene;
  RendererRequest request;
};

/// Scenes of more models only keep the first: leaving each out would tell little more.
inline constexpr std::size_t kMostModelsInTurn = 8;

/// The whole scene, then a variant for each stage of the scene or the renderer. `decided`: the renderer's
/// decisions for the scene. `uncleaned`: the scene without cleaning steps; null if it has none.
/// Deterministic, so another process can recreate the list.
[[nodiscard]] std::vector<Variant> variants_of(const scene::LoadedScene& scene,
                                               const RendererRequest& request,
                                               const render::Registry& registry,
                                               const render::Decisions& decided,
                                               const scene::LoadedScene* uncleaned);

/// Default path length as in sweeps: some thousand contact frames.
inline constexpr int kAblateFrames = 6'000;
/// Preparing and stepping a million points under valgrind takes some 30 s a stage.
inline constexpr double kCountBudgetS = 300.0;
inline constexpr std::uint64_t kAblatePasses = 5;

struct AblateArguments {
  RunArguments run;  ///< scene, one renderer, path, truth, folder, surface, model, json
  double budget_s = kCountBudgetS;
  bool marked = false;  ///< only steps the frames between callgrind's marks
};

/// Returns the exit status.
[[nodiscard]] Result<int> run_ablate(const AblateArguments& arguments, Context& context);

}  // namespace palpate::experiments
