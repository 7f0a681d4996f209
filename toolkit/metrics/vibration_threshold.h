// The touch threshold for vibrations through a stylus.
#pragma once

namespace palpate::metrics {

/// Just noticeable amplitude at `hz` > 0, um: about 0.2 um from 160 to 300 Hz, the Pacinian channel's best
/// range (Israr, Choi and Tan 2006; the number from memory of the literature), 12 dB an octave less sensitive
/// on either side.
[[nodiscard]] inline double detection_threshold_um(double hz) noexcept {
  constexpr double kKeenestUm = 0.2, kKeenFromHz = 160.0, kKeenToHz = 300.0;
  const double off = hz < kKeenFromHz ? kKeenFromHz / hz : hz > kKeenToHz ? hz / kKeenToHz : 1.0;
  return kKeenestUm * off * off;
}

}  // namespace palpate::metrics
