// What a touch tells: the cues of a trace of force and position, on scales whose unit is a just noticeable
// difference.
//
// A cue of size x with a Weber fraction w and a floor f, the absolute threshold, has the scale
//
//   s(x) = x / f                                    up to x = f / w, where both thresholds are the same
//   s(x) = 1 / w + ln(w x / f) / ln(1 + w)          above: a share w more is one step, wherever it begins
//
// (Weber's law with an absolute threshold; its integral is Fechner's). Cues: the stiffness that is felt, the
// force, its direction, and vibration. Each threshold names its source in docs/psychophysics.md. Pure
// functions, thread-safe.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "toolkit/core/vec.h"

namespace palpate::experiments::psychophysics {

/// A tick of what reached the hand; device frame.
struct FeltSample {
  double t_s = 0.0;
  std::uint32_t interval = 0;  ///< of the trial, from 1; 0: between two
  Vec3 at_mm = Vec3::Zero();
  Vec3 force_n = Vec3::Zero();  ///< as it was sent
  bool contact = false;
};

struct Thresholds {
  double stiffness = 0.08;       ///< Weber fraction: the lower end of 8 to 23 %
  double force = 0.07;           ///< Weber fraction (Pang, Tan and Durlach 1991)
  double direction_deg = 25.6;   ///< (Barbagli et al. 2006)
  double vibration = 0.2;        ///< Weber fraction of an amplitude above its threshold; assumed
  double vibration_floor = 1.0;  ///< in the amplitude that is just noticed (metrics::noticed_um)
  double moved_kg = 0.2;         ///< what a vibrating force moves: a stylus device and the hand around it
};

/// What one interval tells.
struct Cues {
  bool touched = false;
  double stiffness_n_per_mm = 0.0;  ///< force by depth while it goes in or out more than along
  double force_n = 0.0;             ///< mean size in contact
  double vibration = 0.0;           ///< 20 to 500 Hz, in amplitudes that are just noticed
  Vec3 direction = Vec3::Zero();    ///< of the mean force; zero without contact
};
/// Of the samples of one interval, evenly spaced in time. O(samples x frequencies).
[[nodiscard]] Cues cues_of(std::span<const FeltSample> samples, const Thresholds& thresholds);

/// s(x) above.
[[nodiscard]] double sensation(double x, double floor, double weber) noexcept;

inline constexpr std::size_t kCues = 4;
/// For reports: "stiffness", "force", "vibration", "direction".
inline constexpr std::array<const char*, kCues> kCueNames = {"stiffness", "force", "vibration", "direction"};
using CueScales = std::array<double, kCues>;
/// Each cue on its scale, in just noticeable differences. That of the direction counts from `from` towards
/// `to`; 0 where those are one.
[[nodiscard]] CueScales scales_of(const Cues& cues, const Thresholds& thresholds, const Vec3& from,
                                  const Vec3& to) noexcept;

}  // namespace palpate::experiments::psychophysics
