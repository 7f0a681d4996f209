// The loop that the thesis asks for, and what a hand can tell: what several goals are judged by.
#pragma once

namespace palpate::experiments {

/// Of a servo loop at 1 kHz.
inline constexpr double kTickS = 1e-3, kTickUs = 1e3;
/// A change of a force that a hand can just tell, in percent of it: Weber's fraction as the thesis takes it.
inline constexpr double kHandTellsPercent = 7.0;

}  // namespace palpate::experiments
