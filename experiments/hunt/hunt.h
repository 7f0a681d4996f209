// Adversarial random search over models, edits, options and paths for a renderer's worst behaviour.
#pragma once

#include <cstdint>
#include <string>

#include "experiments/session/session.h"

namespace palpate::experiments {

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
