// The parts of `palpate reproduce`.
#pragma once

#include <map>
#include <memory>

#include "experiments/command/session.h"
#include "experiments/report/page.h"
#include "experiments/run/run.h"
#include "experiments/tables/manifest.h"
#include "toolkit/core/clock.h"

namespace palpate::experiments {

/// What the parts share.
struct Reproduction {
  const ReproduceArguments& arguments;
  Context& context;
  const OutputFolder& folder;
  render::Registry registry;
  io::Readers readers;
  Page page;
  std::vector<Table> tables;           ///< in the order they are printed at the end
  std::vector<std::string> missing;    ///< what could not be done, and why
  std::vector<std::string> stand_ins;  ///< models that ran as stand-ins, and why
  bool fell_short = false;             ///< something that was asked for failed
  Stopwatch watch;
};

/// The scene of a manifest's model: generated, or a scan found or fetched.
[[nodiscard]] Result<scene::SceneFile> scene_of(const ManifestModel& model, Reproduction& r);

/// How long one reconstruction may take, s; 0: no limit.
[[nodiscard]] double mesh_limit_s(const Reproduction& r);

/// Says what is missing. It is a failure only where it was asked for by name.
void give_up(Reproduction& r, const std::string& what, const Error& error);

/// Table 6: the modified kNN as the thesis timed it, and every builder beside it.
void reproduce_neighbours(const Manifest& manifest, Reproduction& r);
/// Table 3: every reconstruction on every model, beside the printed times.
void reproduce_meshes(const Manifest& manifest, Reproduction& r);
/// Tables 7 and 9, each with its comparison.
void reproduce_frames(const Manifest& manifest, Reproduction& r);
/// Table 11: every method at the sizes at which they were published.
void reproduce_methods(const Manifest& manifest, Reproduction& r);
/// Mean frame and preparation from ten thousand to ten million points.
void measure_growth(Reproduction& r);

/// The thesis's column beside ours. A pure function of manifest and results.
[[nodiscard]] Table frames_table(const Manifest& manifest, const metrics::ResultDocument& document);

}  // namespace palpate::experiments
