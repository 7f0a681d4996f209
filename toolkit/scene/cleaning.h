// Cleaning of raw scans: steps by name, run one after the other before any renderer sees the points. The
// steps come from whoever links a library for them (baselines/cleaning has CGAL's); here stands what all of
// them share: options, order, times, and the bookkeeping of which point was which.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "toolkit/cloud/cloud.h"
#include "toolkit/core/options.h"
#include "toolkit/core/progress.h"
#include "toolkit/core/result.h"
#include "toolkit/render/renderer.h"

namespace palpate::scene {

struct StepInput {
  const cloud::Cloud& cloud;  ///< not empty
  const Options& options;     ///< complete and validated
  double spacing_mm;          ///< root of the occupied area per point, above 0: the unit of all lengths
  int threads;                ///< 0 = all
  Progress& progress;
};

/// Stands for "the nearest point of the input" in StepOutput::from.
inline constexpr std::uint32_t kFromNearest = 0xFFFFFFFFu;

/// What a step leaves: first points that stand where they stood, then points that moved or are new.
struct StepOutput {
  /// For every point the index of the input point that it is, was, or takes its properties from.
  std::vector<std::uint32_t> from;
  /// Places of the last placed_mm.size() points, relative to the input's origin.
  std::vector<Vec3> placed_mm;
  std::string note;  ///< what else a person should know, or empty
};

struct CleaningStep {
  std::string name;
  std::string summary;  ///< one line
  std::string source;   ///< paper and library
  std::vector<OptionSpec> options;
  /// May fail; must not throw. The same result for any number of threads.
  std::function<Result<StepOutput>(const StepInput& input)> run;
};

struct CleanedCloud {
  cloud::Cloud cloud;
  std::vector<std::uint32_t> from;           ///< index in the given cloud, as in StepOutput
  std::vector<render::PreparePhase> phases;  ///< "cleaning: outliers", one a step
  std::vector<std::string> notes;            ///< "outliers: 12 of 4,000 points removed"
};

/// The steps there are. Add before use; the rest is const and thread-safe.
class Cleaning {
 public:
  /// A second step of the same name is a programming error (asserted).
  void add(CleaningStep step);
  [[nodiscard]] const std::vector<CleaningStep>& all() const noexcept { return steps_; }
  [[nodiscard]] const CleaningStep* find(std::string_view name) const noexcept;

  /// `step` with its options complete. An unknown name or option is an Error that says what there is.
  [[nodiscard]] Result<NamedOptions> check(const NamedOptions& step) const;
  /// "outliers/distance=3+smooth": steps joined by +, each with its options after slashes; checked.
  [[nodiscard]] Result<std::vector<NamedOptions>> parse(std::string_view text) const;

  /// Runs checked steps in order. Points keep their properties, moved and new ones have those of the point
  /// they come from; a raster is kept where every point is still in its place in it. Errors: of a step, or
  /// where no point would be left.
  [[nodiscard]] Result<CleanedCloud> run(const cloud::Cloud& cloud, std::span<const NamedOptions> steps,
                                         int threads, Progress& progress) const;

 private:
  std::vector<CleaningStep> steps_;
};

}  // namespace palpate::scene
