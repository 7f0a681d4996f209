// A set made ready: its points, one path, and the truth along it.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "experiments/benchmarks/felt_surface/sets.h"
#include "toolkit/core/progress.h"
#include "toolkit/core/result.h"
#include "toolkit/metrics/truth.h"
#include "toolkit/render/renderer.h"
#include "toolkit/trace/trace.h"

namespace palpate::felt {

inline constexpr double kStiffness = 0.5;  ///< N/mm
inline constexpr double kStepS = 1e-3;     ///< 1 kHz
inline constexpr double kSpeedMmS = 40.0;
inline constexpr double kDepthMm = 1.8;
inline constexpr double kClearanceMm = 0.4;

struct Ground {
  render::SceneInput scene;  ///< one model: points alone, no mesh and no formula
  std::shared_ptr<const geometry::AnalyticSurface> surface;  ///< the formula, or null
  std::shared_ptr<const geometry::TriangleMesh> mesh;        ///< of scans: the truth
  double spacing_mm = 0.0;
  trace::ProbePath path;
  trace::ReferenceTrace reference;
  std::unique_ptr<metrics::TruthSurface> truth;
  /// By frame: in true contact, and another part of the surface is nearer to the HIP than its god object, so
  /// that it is held from behind. Where it gets caught a hair's breadth decides.
  std::vector<std::uint8_t> caught;
  [[nodiscard]] const cloud::Cloud& points() const { return *scene.models.front().cloud; }
};

/// An Error with gave_up set: the data are not there, and the set is skipped.
[[nodiscard]] Result<Ground> make_ground(const DataSet& set, bool quick, std::size_t frames,
                                         Progress& progress);

/// Closed loops of the probe: each begins and ends at the same free place. Empty on scans and strokes.
[[nodiscard]] std::vector<trace::ProbePath> closed_loops(const Ground& ground, std::size_t count);

}  // namespace palpate::felt
