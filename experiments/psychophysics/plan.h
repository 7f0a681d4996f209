// A blinded study's plan: everything decided beforehand, as a TOML file.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <palpate/registry.h>
#include <palpate/result.h>
#include "experiments/psychophysics/procedures.h"
#include "experiments/psychophysics/psychometric.h"

namespace palpate::experiments::psychophysics {

enum class ProcedureKind : std::uint8_t { kFixed, kUpDown, kPsi };
/// "fixed", "up-down", "psi".
[[nodiscard]] const char* name_of(ProcedureKind kind) noexcept;

/// Long enough for a press or short stroke and lifting off.
inline constexpr double kUsualIntervalS = 1.5;
/// Largest accepted plan file.
inline constexpr std::uint64_t kMostPlanBytes = std::uint64_t{1} << 20;

/// A varied option: the values compared are standard - level or standard + level.
struct OptionUnderTest {
  std::string renderer;  ///< NAME[:option=value...]
  std::string key;       ///< numeric option of the renderer, or stiffness, spacing, noise, rate
  std::string unit;      ///< of standard and levels; "1": none
  double standard = 0.0;
  bool upwards = true;
  /// The option's value at a difference.
  [[nodiscard]] double value_at(double level) const noexcept {
    return upwards ? standard + level : standard - level;
  }
};

/// Preregistered exclusion rules for trials and participants.
struct Exclusions {
  std::uint64_t missed_deadlines = 0;  ///< more in a trial exclude it
  std::uint64_t clipped_frames = 0;
  double fastest_s = 0.0, slowest_s = 1e9;  ///< answers outside are excluded
  double catch_share = 0.0;                 ///< a lower share right in catch trials excludes the participant
};

struct PowerWish {
  double wanted = kUsualPower, alpha = kUsualAlpha;
  double detect = 0.65;       ///< share of right answers to be detected
  double equivalence = 0.65;  ///< bound on the share that a null result shall support
};

struct Plan {
  std::string name, text;  ///< the file's name and full text
  std::string title, scene, participant = "P01";
  std::uint64_t seed = 1;
  Task task = Task::kAbx;
  std::string a, b;  ///< renderers; empty where an option is varied
  std::optional<OptionUnderTest> option;
  ProcedureKind procedure = ProcedureKind::kFixed;
  std::uint64_t count = 0;     ///< counted trials: in all, or at each level
  std::vector<double> levels;  ///< kFixed: differences, rising
  std::uint64_t practice = 0, catch_every = 0, break_every = 0;
  double catch_level = 0.0;  ///< an option's unmissable difference
  double switch_delay_s = 0.5;
  double interval_s = kUsualIntervalS;  ///< each interval's length, where renderers are felt
  UpDownOptions up_down;
  PsiOptions psi;
  Shape shape = Shape::kDprime;
  std::optional<double> slope;  ///< empty: fitted (kFixed), or kUsualSlope
  double lapse = 0.0;
  PowerWish power;
  Exclusions exclusions;

  [[nodiscard]] bool compares() const noexcept { return !option.has_value(); }
  /// Equally frequent orders of a trial: 4 of abx and same-different, else 2.
  [[nodiscard]] std::size_t cells() const noexcept {
    return task == Task::kAbx || task == Task::kSameDifferent ? 4 : 2;
  }
  /// Adaptive procedures assume a slope.
  [[nodiscard]] std::optional<double> fitted_slope() const noexcept {
    if (slope || procedure == ProcedureKind::kFixed) return slope;
    return kUsualSlope;
  }
  [[nodiscard]] Psychometric like() const noexcept { return {task, shape, 1.0, kUsualSlope, lapse}; }
};

/// Checks renderers and options against `registry`. Errors name file, line, column and remedy.
[[nodiscard]] Result<Plan> parse_plan(std::string_view text, const std::string& name,
                                      const render::Registry& registry);
/// A participant's code: at most 32 letters, digits, - and _.
[[nodiscard]] bool is_participant_code(std::string_view code) noexcept;
/// The text of a file or a named example. Errors list the examples.
struct PlanText {
  std::string name, text;
};
[[nodiscard]] Result<PlanText> read_plan(const std::string& file_or_example);

/// Example plans, in the page's order.
[[nodiscard]] const std::vector<PlanText>& example_plans();

}  // namespace palpate::experiments::psychophysics
