// Helpers of preparation for all renderers. They give its phases in the report, whether single-precision
// coordinates suffice, a warning about wide openings, the models' box and parts of them.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <palpate/clock.h>
#include <palpate/cloud.h>
#include <palpate/decision.h>
#include <palpate/geometry.h>
#include <palpate/progress.h>
#include <palpate/renderer.h>

namespace palpate::render {

/// begin(name), the work, end() make one phase; a failing phase omits end(). Belongs to one thread; the
/// report and context must outlive it.
class PreparePhases {
 public:
  PreparePhases(PrepareReport& report, const PrepareContext& context) noexcept
      : report_(report), progress_(context.progress != nullptr ? *context.progress : no_progress()) {}
  void begin(std::string name) {
    name_ = std::move(name);
    progress_.report(name_, -1.0);
    watch_.restart();
  }
  void end() { add({name_, watch_.ms()}); }
  /// Adds a phase timed elsewhere.
  void add(PreparePhase phase) {
    report_.total_ms += phase.ms;
    report_.phases.push_back(std::move(phase));
  }
  void note(std::string text) { report_.notes.push_back(std::move(text)); }
  void warn(std::string text) { report_.warnings.push_back(std::move(text)); }
  [[nodiscard]] Progress& progress() noexcept { return progress_; }

 private:
  PrepareReport& report_;
  Progress& progress_;
  std::string name_;
  Stopwatch watch_;
};

/// Float coordinates round to 2^-25 of the extent. Rounding within a hundredth of the spacing keeps the order
/// of points and turns no normal by more than half a degree.
inline constexpr double kMaxRoundingShare = 0.01;

/// Rounding of a stored coordinate.
[[nodiscard]] double coordinate_rounding_mm(const cloud::Cloud& cloud);
/// The decision in words with its numbers. `spacing_mm` is the neighbour distance; 0 = unknown.
[[nodiscard]] Decision coordinates_decision(const cloud::Cloud& cloud, double spacing_mm);
/// True if float coordinates are precise enough.
[[nodiscard]] bool float_precision_suffices(const cloud::Cloud& cloud, double spacing_mm);

/// Warns if a one-sided piece has holes so wide that a probe may be meant to enter through them
/// (geometry::kWideOpeningFraction). `min_enclosed` is 1 - geometry::opening_fraction() of the worst such
/// piece; 1 if none.
[[nodiscard]] std::optional<std::string> wide_mouth_warning(double min_enclosed);

/// The box around all models at their start poses; world, mm.
[[nodiscard]] geometry::Aabb box_of(const std::vector<ModelInput>& models);

/// The model reduced to some of its points with their surface properties. Drops the faces, which use all
/// points. `raster` describes the subset.
[[nodiscard]] ModelInput subset_of(const ModelInput& model, std::span<const std::uint32_t> of,
                                   const std::optional<cloud::ScanRaster>& raster = std::nullopt);

}  // namespace palpate::render
