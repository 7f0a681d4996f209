// One renderer on one set: prepared, replayed, timed, scored.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <palpate/accuracy.h>
#include <palpate/options.h>
#include <palpate/registry.h>
#include <palpate/result.h>
#include "experiments/benchmarks/felt_surface/ground.h"

namespace palpate::felt {

/// A renderer in the palpate command's syntax.
struct Tried {
  std::string label;  ///< row label: label=NAME among the options, else the name
  NamedOptions spec;
};
/// Duplicate labels become the whole text.
[[nodiscard]] Result<std::vector<Tried>> read_tried(const std::string& list);

/// A run of frames, with or without contact, with wrong force.
struct Mistake {
  std::size_t begin = 0, end = 0;                               ///< frames
  double share = 0.0;                                           ///< of all frames' summed squared errors
  Vec3 hip_mm = Vec3::Zero();                                   ///< at its worst frame
  Vec3 true_god_mm = Vec3::Zero(), felt_god_mm = Vec3::Zero();  ///< god objects there
  bool true_contact = false, felt_contact = false;
};

struct Row {
  std::string set, renderer;
  std::string failed;  ///< reason; empty: it ran
  std::size_t points = 0;
  double spacing_mm = 0.0;
  metrics::Accuracy accuracy;
  std::optional<double> median_error_n;        ///< of the frames that accuracy counts
  std::optional<double> uncaught_rms_percent;  ///< of uncaught true contact
  std::size_t caught_frames = 0;
  std::optional<double> caught_error_percent;  ///< caught frames' share of the squared error of true contact
  std::optional<double> energy_percent;        ///< generated along the path, over the largest stored
  std::optional<double> loop_energy_percent;   ///< generated on closed loops, over their work
  std::optional<double> worst_loop_percent;
  double free_force_n = 0.0;  ///< largest where the truth is free by more than the local resolution; on
                              ///< `border` anywhere
  double held_share = 0.0;    ///< percent of those free frames that have a force
  /// Means over the truth's contact frames and over all, ns: the fastest of three passes.
  double contact_ns = 0.0, all_ns = 0.0;
  std::optional<double> p999_us;
  double prepare_ms = 0.0, bytes_per_point = 0.0;
  double prepare_cpu_ms = 0.0;  ///< processor time of all threads, independent of other load
  std::uint64_t bound_hits = 0;
  std::string trace_hash;
  std::vector<std::string> warnings;
  std::vector<Mistake> mistakes;  ///< the worst first
};

struct TrialOptions {
  std::size_t loops = 100;
  /// The fastest pass is the least disturbed on a shared machine.
  int timed_passes = 3;
  int threads = 0;
  double prepare_limit_s = 0.0;  ///< 0: none
  std::size_t mistakes = 0;      ///< largest number listed
};

[[nodiscard]] Row run_trial(const DataSet& set, const Ground& ground, const Tried& tried,
                            const std::vector<trace::ProbePath>& loops, const render::Registry& registry,
                            const TrialOptions& options);

// Draws a slice of the rendered surface: points, truth, and each renderer's god objects along a row of
// touches.

/// `name`: edge, hole, thin or noise. Writes an SVG file.
[[nodiscard]] Status draw_slice(const std::string& name, const std::vector<Tried>& renderers,
                                const render::Registry& registry, const std::string& file);

}  // namespace palpate::felt
