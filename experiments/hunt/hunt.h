// Random search for a renderer's worst behaviour. It varies models, edits, options and paths; its results are
// replayable cases and a document.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "experiments/hunt/trial.h"
#include "experiments/run/arguments.h"
#include "experiments/session/session.h"
#include "experiments/study/study.h"

namespace palpate::experiments {

/// One renderer's worst case for one goal.
struct Found {
  double score = 0.0;
  std::uint64_t trial = 0;  ///< trial number, which with the hunt's seed reproduces the trial_input
  std::size_t frame = 0;
  TrialInput trial_input;
};
struct Fault {
  std::string what;
  std::uint64_t trial = 0;
  TrialInput trial_input;
};
struct Quest {
  RendererRequest renderer;
  std::array<std::optional<Found>, kGoals> worst;
  std::vector<Fault> faults;  ///< the first kMostFaults
  std::uint64_t trials = 0, refused = 0, bound_hits = 0, faulty = 0;
  double spent_s = 0.0;
};
inline constexpr std::size_t kMostFaults = 5;

/// The renderer with the trial_input's options.
[[nodiscard]] NamedOptions renderer_of(const Quest& quest, const TrialInput& trial_input);

/// Writes NAME.csv, NAME.toml and, for points of no generator, NAME.ply. `palpate compare NAME.toml
/// --renderers auto
/// --path NAME.csv` renders the case and counts a hand's artefacts.
[[nodiscard]] Status write_case(const OutputFolder& folder, const std::string& name,
                                const TrialInput& trial_input, const NamedOptions& renderer);
/// Command that replays a case.
[[nodiscard]] std::string command_of(const OutputFolder& folder, const std::string& name);

/// Writes all cases. The text of the document that names them.
[[nodiscard]] Result<std::string> write_found(const OutputFolder& folder, const std::vector<Quest>& quests,
                                              std::uint64_t seed, const metrics::DocumentHead& head);

inline constexpr double kUsualHuntMinutes = 10.0;

struct HuntArguments {
  std::string renderers;  ///< empty: ours
  double minutes = kUsualHuntMinutes;
  std::uint64_t trials = 0;  ///< 0: as many as the minutes allow
  std::uint64_t seed = 1;
  std::string out;
  bool as_given = false;  ///< keeps options as given
  bool json = false;
};

/// Hunts, resuming an interrupted hunt in the folder; writes hunt.json and the worst cases. Exit status
/// kExitFellShort: a broken promise.
[[nodiscard]] Result<int> hunt(const HuntArguments& arguments, Context& context);

}  // namespace palpate::experiments
