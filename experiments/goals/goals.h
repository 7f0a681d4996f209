// Goals of the thesis's section 1.4, with measurements. All of them are a command.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include <palpate/trace.h>
#include "experiments/driver/suite.h"
#include "experiments/report/page.h"
#include "experiments/run/run.h"
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

// Measurements for the goals' pages; some serve several goals.

/// Inputs common to all measurements, held by reference.
struct GoalBench {
  const render::Registry& registry;
  const Suite& suite;
  const OutputFolder& figures;
  bool quick = false;  ///< small models and short paths: tests the program, measures nothing
  int threads = 0;     ///< of preparation; 0: all
};

/// Several renderers on one stage; the mesh is the last.
struct GoalRuns {
  std::string name;  ///< the model's display name
  std::uint64_t points = 0;
  std::vector<metrics::RendererResult> results;
  std::vector<trace::ForceTrace> traces{};  ///< per result; empty if failed
};

/// Our judged renderers, and the mesh for comparison.
inline constexpr const char* kJudged[] = {"cloud", "cloud-smooth"};
inline constexpr const char* kMeshLabel = "mesh";

/// A scene as for `palpate compare`, ready to run.
[[nodiscard]] Result<Stage> goal_stage(const GoalBench& bench, const std::string& scene,
                                       const std::string& path, ReferenceChoice reference);
/// `renderers`: command-line syntax.
[[nodiscard]] Result<GoalRuns> goal_runs(const GoalBench& bench, const Stage& stage, const std::string& name,
                                         const std::string& renderers);
/// The label's result; null if it did not finish.
[[nodiscard]] const metrics::RendererResult* ran(const GoalRuns& runs, const std::string& label);

/// Models of every kind of points, with truth; each is kept by the suite, without traces, as are the next.
[[nodiscard]] Result<std::vector<GoalRuns>> run_on_shapes(const GoalBench& bench);
/// One surface and path at several numbers of points.
[[nodiscard]] Result<std::vector<GoalRuns>> run_by_size(const GoalBench& bench);

// Each returns a goal with id and words.
[[nodiscard]] Goal fidelity_goal(const GoalBench& bench, const std::vector<GoalRuns>& shapes);
[[nodiscard]] Goal no_mesh_goal(const GoalBench& bench, const std::vector<GoalRuns>& shapes);
[[nodiscard]] Goal one_machine_goal(const GoalBench& bench);
[[nodiscard]] Goal worst_case_goal(const GoalBench& bench, const std::vector<GoalRuns>& shapes,
                                   const std::vector<GoalRuns>& sizes);
[[nodiscard]] Goal size_goal(const GoalBench& bench, const std::vector<GoalRuns>& sizes);
[[nodiscard]] Goal stability_goal(const GoalBench& bench);
[[nodiscard]] Goal many_models_goal(const GoalBench& bench);

/// A dash where there is none.
[[nodiscard]] std::string number_or_dash(const std::optional<double>& value);

/// Lines of a chart without points, one look for each label.
[[nodiscard]] std::vector<Series> lines_of(const std::vector<std::string>& labels);

/// Horizontal bars, one per label.
struct Bar {
  std::string label;
  double value = 0.0;
};
[[nodiscard]] Chart bar_chart(const std::string& name, const std::string& title, const std::string& x_label,
                              const std::string& caption, const std::vector<Bar>& bars);

/// An empty log-log chart of the mean frame against a count.
[[nodiscard]] Chart growth_chart(const std::string& name, const std::string& counted,
                                 const std::string& caption);

}  // namespace palpate::experiments
