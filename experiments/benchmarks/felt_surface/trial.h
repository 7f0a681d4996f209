// One renderer on one set: prepared, replayed, timed, scored.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "experiments/benchmarks/felt_surface/ground.h"
#include "toolkit/core/options.h"
#include "toolkit/metrics/accuracy.h"
#include "toolkit/render/registry.h"

namespace palpate::felt {

/// A renderer to try, as the palpate command takes it.
struct Tried {
  std::string label;  ///< of its rows: label=NAME among the options, else the name
  NamedOptions spec;
};
/// Labels that are twice become the whole text.
[[nodiscard]] Result<std::vector<Tried>> read_tried(const std::string& list);

/// A run of frames, with or without contact, in which the force is off.
struct Mistake {
  std::size_t begin = 0, end = 0;  ///< frames
  double share = 0.0;              ///< of the sum of the squared errors of all frames
  Vec3 hip_mm = Vec3::Zero();      ///< where it is worst, ..
  Vec3 true_god_mm = Vec3::Zero(), felt_god_mm = Vec3::Zero();  ///< .. and the god objects there
  bool true_contact = false, felt_contact = false;
};

struct Row {
  std::string set, renderer;
  std::string failed;  ///< why there is nothing more; empty: it ran
  std::size_t points = 0;
  double spacing_mm = 0.0;
  metrics::Accuracy accuracy;
  std::optional<double> median_error_n;        ///< of the frames that accuracy counts
  std::optional<double> uncaught_rms_percent;  ///< of true contact that is not caught
  std::size_t caught_frames = 0;
  std::optional<double> caught_error_percent;  ///< of the squared error of true contact: in caught frames
  std::optional<double> energy_percent;        ///< generated along the path, of the largest stored
  std::optional<double> loop_energy_percent;   ///< generated on closed loops, of their work
  std::optional<double> worst_loop_percent;
  double free_force_n = 0.0;  ///< largest where the truth is free by more than the local resolution; on
                              ///< `border` anywhere
  double held_share = 0.0;    ///< of the truth's free frames so far outside: percent with a force
  /// Mean over the truth's contact frames and over all, ns: the fastest of three passes.
  double contact_ns = 0.0, all_ns = 0.0;
  std::optional<double> p999_us;
  double prepare_ms = 0.0, bytes_per_point = 0.0;
  double prepare_cpu_ms = 0.0;  ///< processor time of all threads, which other load leaves alone
  std::uint64_t bound_hits = 0;
  std::string trace_hash;
  std::vector<std::string> warnings;
  std::vector<Mistake> mistakes;  ///< the worst first
};

struct TrialOptions {
  std::size_t loops = 100;
  /// The machine is shared: the fastest pass is that which was least disturbed.
  int timed_passes = 3;
  int threads = 0;
  double prepare_limit_s = 0.0;  ///< 0 = none
  std::size_t mistakes = 0;      ///< to be told of, at most
};

[[nodiscard]] Row run_trial(const DataSet& set, const Ground& ground, const Tried& tried,
                            const std::vector<trace::ProbePath>& loops, const render::Registry& registry,
                            const TrialOptions& options);

}  // namespace palpate::felt
