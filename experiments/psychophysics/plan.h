// The plan of a blinded study: everything that is decided before anybody is asked, as a TOML file.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "experiments/psychophysics/distributions.h"
#include "experiments/psychophysics/power.h"
#include "experiments/psychophysics/procedures.h"
#include "toolkit/core/result.h"
#include "toolkit/render/registry.h"

namespace palpate::experiments::psychophysics {

enum class ProcedureKind : std::uint8_t { kFixed, kUpDown, kPsi };
/// "fixed", "up-down", "psi".
[[nodiscard]] const char* name_of(ProcedureKind kind) noexcept;

/// A touch and a little more: a press or a short stroke, and up again.
inline constexpr double kUsualIntervalS = 1.5;
/// A plan is a page: what is larger is something else.
inline constexpr std::uint64_t kMostPlanBytes = std::uint64_t{1} << 20;

/// What is compared where an option is turned: differences are standard - level or standard + level.
struct OptionUnderTest {
  std::string renderer;  ///< NAME[:option=value...]
  std::string key;       ///< a numeric option of it, or stiffness, spacing, noise, rate
  std::string unit;      ///< of standard and levels; "1" where there is none
  double standard = 0.0;
  bool upwards = true;
  /// The value that is felt at a difference.
  [[nodiscard]] double value_at(double level) const noexcept {
    return upwards ? standard + level : standard - level;
  }
};

/// Registered beforehand: what makes a trial, or a participant, count for nothing.
struct Exclusions {
  std::uint64_t missed_deadlines = 0;  ///< more in a trial exclude it
  std::uint64_t clipped_frames = 0;
  double fastest_s = 0.0, slowest_s = 1e9;  ///< answers outside are no answers
  double catch_share = 0.0;                 ///< fewer right in catch trials exclude the participant
};

struct PowerWish {
  double wanted = kUsualPower, alpha = kUsualAlpha;
  double detect = 0.65;       ///< share of right answers that is to be found
  double equivalence = 0.65;  ///< "told apart in under this share" is what a missed difference shall show
};

struct Plan {
  std::string name, text;  ///< of the file, and all of it
  std::string title, scene, participant = "P01";
  std::uint64_t seed = 1;
  Task task = Task::kAbx;
  std::string a, b;  ///< renderers; both empty where an option is turned
  std::optional<OptionUnderTest> option;
  ProcedureKind procedure = ProcedureKind::kFixed;
  std::uint64_t count = 0;     ///< trials that count: in all, or at each level
  std::vector<double> levels;  ///< of kFixed: differences, rising
  std::uint64_t practice = 0, catch_every = 0, break_every = 0;
  double catch_level = 0.0;  ///< of an option: a difference nobody misses
  double switch_delay_s = 0.5;
  double interval_s = kUsualIntervalS;  ///< of every interval, where renderers are felt
  UpDownOptions up_down;
  PsiOptions psi;
  Shape shape = Shape::kDprime;
  std::optional<double> slope;  ///< nothing: fitted (of kFixed), or kUsualSlope
  double lapse = 0.0;
  PowerWish power;
  Exclusions exclusions;

  [[nodiscard]] bool compares() const noexcept { return !option.has_value(); }
  /// Orders of a trial that are shown equally often: 4 of abx and same-different, 2 of the others.
  [[nodiscard]] std::size_t cells() const noexcept {
    return task == Task::kAbx || task == Task::kSameDifferent ? 4 : 2;
  }
  /// Where procedures adapt, the slope that is assumed.
  [[nodiscard]] std::optional<double> fitted_slope() const noexcept {
    if (slope || procedure == ProcedureKind::kFixed) return slope;
    return kUsualSlope;
  }
  [[nodiscard]] Psychometric like() const noexcept { return {task, shape, 1.0, kUsualSlope, lapse}; }
};

/// Errors name file, line and column, and what to write. Renderers and options are checked against
/// `registry`.
[[nodiscard]] Result<Plan> parse_plan(std::string_view text, const std::string& name,
                                      const render::Registry& registry);
/// A participant's code: at most 32 letters, digits, - and _.
[[nodiscard]] bool is_participant_code(std::string_view code) noexcept;
/// The text of a file, or of an example by its name. Errors list the examples.
struct PlanText {
  std::string name, text;
};
[[nodiscard]] Result<PlanText> read_plan(const std::string& file_or_example);

/// Plans to begin with, in the order of the page.
[[nodiscard]] const std::vector<PlanText>& example_plans();

}  // namespace palpate::experiments::psychophysics
