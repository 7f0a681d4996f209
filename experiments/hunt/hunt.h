// The adversary: random search over small models, edits, options and ways for what a renderer does worst.
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
  bool as_given = false;  ///< options are not turned
  bool json = false;
};

/// Hunts, goes on from an interrupted hunt in the same folder, writes hunt.json and the worst cases. The exit
/// status: kExitFellShort where a promise was broken.
int hunt(const HuntArguments& arguments, Context& context);

}  // namespace palpate::experiments
