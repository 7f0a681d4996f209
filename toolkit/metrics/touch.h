// What touch notices of a vibration through a stylus.
#pragma once

namespace palpate::metrics {

/// Amplitude that is just noticed at `hz` above 0, in um: the Pacinian channel is most sensitive from 160 to
/// 300 Hz at about 0.2 um (Israr, Choi and Tan 2006; the number from memory of the literature), 12 dB an
/// octave less on either side.
[[nodiscard]] inline double noticed_um(double hz) noexcept {
  constexpr double kKeenestUm = 0.2, kKeenFromHz = 160.0, kKeenToHz = 300.0;
  const double off = hz < kKeenFromHz ? kKeenFromHz / hz : hz > kKeenToHz ? hz / kKeenToHz : 1.0;
  return kKeenestUm * off * off;
}

}  // namespace palpate::metrics
