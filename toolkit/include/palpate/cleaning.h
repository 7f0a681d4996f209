// Cleaning of raw scans: named steps that run one after the other before preparation. Libraries supply the
// steps (baselines/cleaning has CGAL's); this file handles options, order, times and point correspondence.
//
// First:
//   palpate::scene::Cleaning cleaning;
//   palpate::baselines::register_cleaning(cleaning);
//   auto steps = cleaning.parse("outliers/distance=3+smooth");
//   auto clean = cleaning.run(cloud, *steps, 0, palpate::no_progress());
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <palpate/cloud.h>
#include <palpate/options.h>
#include <palpate/progress.h>
#include <palpate/renderer.h>
#include <palpate/result.h>

namespace palpate::scene {

struct CleaningStepInput {
  const cloud::Cloud& cloud;  ///< not empty
  const Options& options;     ///< complete and validated
  double spacing_mm;          ///< square root of the occupied area per point, above 0; the unit of all
                              ///< lengths
  int threads;                ///< 0 = all
  Progress& progress;
};

/// "The nearest point of the input", in CleaningStepOutput::from.
inline constexpr std::uint32_t kNearestInputPoint = 0xFFFFFFFFu;

/// A step's output: first the points that stayed in place, then the moved or new points.
struct CleaningStepOutput {
  /// Per point: the index of the input point that it is, or takes its properties from.
  std::vector<std::uint32_t> from;
  /// Positions of the last new_points_mm.size() points, relative to the input's origin.
  std::vector<Vec3> new_points_mm;
  std::string note;  ///< a further finding for the user, or empty
};

struct CleaningStep {
  std::string name;
  std::string summary;  ///< one line
  std::string source;   ///< paper and library
  std::vector<OptionSpec> options;
  /// May fail; must not throw. The result does not depend on the number of threads.
  std::function<Result<CleaningStepOutput>(const CleaningStepInput& input)> run;
};

struct CleanedCloud {
  cloud::Cloud cloud;
  std::vector<std::uint32_t> from;           ///< index in the given cloud, as in CleaningStepOutput
  std::vector<render::PreparePhase> phases;  ///< one per step: "cleaning: outliers"
  std::vector<std::string> notes;            ///< "outliers: 12 of 4,000 points removed"
};

/// The available steps. Add them before use; the const members are thread-safe.
class Cleaning {
 public:
  /// A repeated name is a programming error (asserted).
  void add(CleaningStep step);
  [[nodiscard]] const std::vector<CleaningStep>& all() const noexcept { return steps_; }
  [[nodiscard]] const CleaningStep* find(std::string_view name) const noexcept;

  /// `step` with its options complete. An Error lists the known names or options.
  [[nodiscard]] Result<NamedOptions> check(const NamedOptions& step) const;
  /// Parses and checks "outliers/distance=3+smooth": steps joined by +, options after slashes.
  [[nodiscard]] Result<std::vector<NamedOptions>> parse(std::string_view text) const;

  /// Runs checked steps in order. Points keep their properties; moved and new points take those of their
  /// source point. The raster is kept if every point keeps its place in it. Errors: those of a step, and an
  /// empty result.
  [[nodiscard]] Result<CleanedCloud> run(const cloud::Cloud& cloud, std::span<const NamedOptions> steps,
                                         int threads, Progress& progress) const;

 private:
  std::vector<CleaningStep> steps_;
};

}  // namespace palpate::scene
