// Goals of the thesis's section 1.4, with measurements. All of them are a command.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "experiments/report/page.h"
#include "experiments/session/session.h"

namespace palpate::experiments {

inline constexpr const char* kGoalsSchema = "palpate-goals/1";
inline constexpr const char* kGoalsFile = "goals.json";

/// A deciding number. Unmeasured numbers have no value and are never kept.
struct Finding {
  std::string about;  ///< "force error of cloud, RMS"
  std::optional<double> value;
  std::string unit;
  double limit = 0.0;
  bool at_most = true;               ///< else at least
  std::string limit_from;            ///< reason for the limit, a few words
  std::optional<double> baseline{};  ///< the mesh's number; empty: none
};
[[nodiscard]] bool kept(const Finding& finding);

enum class Verdict : std::uint8_t {
  kReached,      ///< all findings kept
  kInPart,       ///< some kept
  kMissed,       ///< none kept
  kNotMeasured,  ///< no findings, or one without a value
};
[[nodiscard]] const char* name_of(Verdict verdict);

struct Goal {
  std::string id;                     ///< "fidelity": its page is goal-ID.html
  std::string title;                  ///< the thesis's title
  std::string words;                  ///< the requirement in our words
  std::vector<std::string> method{};  ///< paragraphs: measurements and methods
  std::vector<Finding> findings{};
  std::vector<Table> tables{};
  std::vector<Figure> figures{};
  std::vector<std::string> short_of{};  ///< shortcomings besides missed findings
  std::vector<std::string> notes{};
  std::string picture{};  ///< HTML beside the figures; may be empty
};
/// Decided by the findings only.
[[nodiscard]] Verdict verdict_of(const Goal& goal);
[[nodiscard]] std::string text_of(const Finding& finding);

struct GoalsDocument {
  metrics::DocumentHead head;
  bool quick = false;
  std::vector<Goal> goals;
  std::vector<std::string> warnings, notes;
};
[[nodiscard]] std::string to_json(const GoalsDocument& document);
[[nodiscard]] Table goals_table(const GoalsDocument& document);

/// A 1 kHz servo loop's.
inline constexpr double kTickS = 1e-3, kTickUs = 1e3;
/// Just noticeable change of force in percent: Weber's fraction of the thesis.
inline constexpr double kHandTellsPercent = 7.0;

struct GoalsArguments {
  std::string out;
  bool quick = false;  ///< small models and short paths
  int threads = 0;     ///< of preparation; 0: all
  bool json = false;
};

/// Measures, writes goals.json and pages, and prints the table. Exit status kExitFellShort: a goal could not
/// be measured. A missed goal is a result.
[[nodiscard]] Result<int> run_goals(const GoalsArguments& arguments, Context& context);

}  // namespace palpate::experiments
