// A goal of section 1.4 of the thesis, and what was measured of it.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "experiments/report/page.h"

namespace palpate::experiments {

inline constexpr const char* kGoalsSchema = "palpate-goals/1";
inline constexpr const char* kGoalsFile = "goals.json";

/// One number that decides. What could not be measured has no value, and is never kept.
struct Finding {
  std::string about;  ///< "force error of cloud, RMS"
  std::optional<double> value;
  std::string unit;
  double limit = 0.0;
  bool at_most = true;               ///< else at least
  std::string limit_from;            ///< why that much is asked, a few words
  std::optional<double> baseline{};  ///< the same of the mesh; nothing: it has none
};
[[nodiscard]] bool kept(const Finding& finding);

enum class Verdict : std::uint8_t {
  kReached,      ///< every finding is kept
  kInPart,       ///< some are
  kMissed,       ///< none is
  kNotMeasured,  ///< a finding has no value, or there is none
};
[[nodiscard]] const char* name_of(Verdict verdict);

struct Goal {
  std::string id;                     ///< "fidelity": of its page, goal-ID.html
  std::string title;                  ///< as the thesis has it
  std::string words;                  ///< what it asks for, in our own words
  std::vector<std::string> method{};  ///< what was measured and how, paragraphs
  std::vector<Finding> findings{};
  std::vector<Table> tables{};
  std::vector<Figure> figures{};
  std::vector<std::string> short_of{};  ///< what falls short beside the findings that are not kept
  std::vector<std::string> notes{};
  std::string picture{};  ///< HTML beside the figures; may be empty
};
/// Decided by the findings alone.
[[nodiscard]] Verdict verdict_of(const Goal& goal);
/// "0.233 % (asked: at most 7 %, ..; mesh 0.233 %)".
[[nodiscard]] std::string text_of(const Finding& finding);

struct GoalsDocument {
  metrics::DocumentHead head;
  bool quick = false;
  std::vector<Goal> goals;
  std::vector<std::string> warnings, notes;
};
[[nodiscard]] std::string to_json(const GoalsDocument& document);
[[nodiscard]] Table goals_table(const GoalsDocument& document);
/// goals.json, a page for each goal, and report.html, which leads to them.
[[nodiscard]] Status write_goals(const GoalsDocument& document, const OutputFolder& folder);

}  // namespace palpate::experiments
