// A prepared set: points, path, and truth.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include <palpate/progress.h>
#include <palpate/reference.h>
#include <palpate/renderer.h>
#include <palpate/result.h>
#include <palpate/trace.h>
#include "experiments/benchmarks/felt_surface/sets.h"

namespace palpate::felt {

inline constexpr double kStiffness = 0.5;  ///< N/mm
inline constexpr double kStepS = 1e-3;     ///< 1 kHz
inline constexpr double kSpeedMmS = 40.0;
inline constexpr double kDepthMm = 1.8;
inline constexpr double kClearanceMm = 0.4;

struct Ground {
  render::SceneInput scene;                                  ///< one model: points without mesh or formula
  std::shared_ptr<const geometry::AnalyticSurface> surface;  ///< the formula, or null
  std::shared_ptr<const geometry::TriangleMesh> mesh;        ///< a scan's truth
  double spacing_mm = 0.0;
  trace::ProbePath path;
  trace::ReferenceTrace reference;
  std::unique_ptr<metrics::TruthSurface> truth;
  /// By frame: true contact where another part of the surface is nearer to the HIP than its god object, so it
  /// is held from behind. Tiny differences decide where it is caught.
  std::vector<std::uint8_t> caught;
  [[nodiscard]] const cloud::Cloud& points() const { return *scene.models.front().cloud; }
};

/// Error with gave_up: the data are absent and the set is skipped.
[[nodiscard]] Result<Ground> make_ground(const DataSet& set, bool quick, std::size_t frames,
                                         Progress& progress);

/// Closed loops of the probe, each from and to the same free place. Empty for scans and strokes.
[[nodiscard]] std::vector<trace::ProbePath> closed_loops(const Ground& ground, std::size_t count);

}  // namespace palpate::felt
