// Haptic cues of a force trace, in just noticeable differences.
//
// A cue of size x with Weber fraction w and absolute threshold f has the scale
//
//   s(x) = x / f                                    up to x = f / w, where both thresholds are equal
//   s(x) = 1 / w + ln(w x / f) / ln(1 + w)          above: each step is a share w
//
// (Weber's law with an absolute threshold, integrated after Fechner). Cues: stiffness, force, direction and
// vibration. Sources of the thresholds: docs/tutorials/a-study.md. Pure functions, thread-safe.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include <palpate/vec.h>

namespace palpate::experiments::psychophysics {

/// A tick's position and sent force; device frame.
struct FeltSample {
  double t_s = 0.0;
  std::uint32_t interval = 0;  ///< of the trial, from 1; 0: between two
  Vec3 at_mm = Vec3::Zero();
  Vec3 force_n = Vec3::Zero();  ///< as sent
  bool contact = false;
};

struct Thresholds {
  double stiffness = 0.08;       ///< Weber fraction: lower end of 8 to 23 %
  double force = 0.07;           ///< Weber fraction (Pang, Tan and Durlach 1991)
  double direction_deg = 25.6;   ///< (Barbagli et al. 2006)
  double vibration = 0.2;        ///< Weber fraction of amplitudes above the threshold; assumed
  double vibration_floor = 1.0;  ///< in just noticeable amplitudes (metrics::detection_threshold_um)
  double moved_kg = 0.2;         ///< mass moved by a vibrating force: stylus and hand
};

/// The cues of one interval.
struct Cues {
  bool touched = false;
  double stiffness_n_per_mm = 0.0;  ///< force by depth while moving in or out more than along
  double force_n = 0.0;             ///< mean magnitude in contact
  double vibration = 0.0;           ///< 20 to 500 Hz, in just noticeable amplitudes
  Vec3 direction = Vec3::Zero();    ///< of the mean force; zero without contact
};
/// Takes one interval's samples, evenly spaced in time. O(samples x frequencies).
[[nodiscard]] Cues cues_of(std::span<const FeltSample> samples, const Thresholds& thresholds);

/// s(x) above.
[[nodiscard]] double sensation(double x, double floor, double weber) noexcept;

inline constexpr std::size_t kCues = 4;
/// For reports.
inline constexpr std::array<const char*, kCues> kCueNames = {"stiffness", "force", "vibration", "direction"};
using CueScales = std::array<double, kCues>;
/// Cues on their scales, in just noticeable differences. Direction counts from `from` towards `to`; 0 if
/// those coincide.
[[nodiscard]] CueScales scales_of(const Cues& cues, const Thresholds& thresholds, const Vec3& from,
                                  const Vec3& to) noexcept;

}  // namespace palpate::experiments::psychophysics
