#include "experiments/command/session.h"

#include <fmt/format.h>

#ifdef PALPATE_WITH_BASELINES
#include "baselines/register.h"
#endif
#include "experiments/command/version.h"
#include "experiments/run/cleaning.h"
#ifdef PALPATE_WITH_DEM
#include "toolkit/dem/dem_reader.h"
#endif
#ifdef PALPATE_WITH_PCD
#include "toolkit/pcd/pcd_reader.h"
#endif
#ifdef PALPATE_WITH_VORONOI
#include "toolkit/voronoi/voronoi.h"
#endif

namespace palpate::experiments {

render::Registry all_renderers() {
#ifdef PALPATE_WITH_VORONOI
  voronoi::register_voronoi();  // first: renderers list the builders of neighbours as they are registered
#endif
  render::Registry registry;
  render::register_toolkit_renderers(registry);
#ifdef PALPATE_WITH_BASELINES
  baselines::register_baseline_renderers(registry);
#endif
  return registry;
}

io::Readers all_readers() {
  io::Readers readers;
  io::add_standard_readers(readers);
#ifdef PALPATE_WITH_PCD
  pcd::add_pcd_reader(readers);
#endif
#ifdef PALPATE_WITH_DEM
  dem::add_dem_readers(readers);
#endif
  return readers;
}

Result<scene::LoadOptions> load_options(const ModelArguments& arguments) {
  scene::LoadOptions options;
  if (!arguments.unit.empty()) {
    const Result<io::Unit> unit = io::parse_unit(arguments.unit);
    if (!unit) return unit.error();
    options.unit = *unit;
  }
  if (arguments.scale > 0.0) options.scale = arguments.scale;
  options.post_mm = arguments.post_mm;
  options.vertical_mm = arguments.vertical_mm;
  options.cleaning = &all_cleaning();
  options.threads = arguments.threads;
  options.non_finite = arguments.non_finite == "refuse" ? cloud::NonFinite::kRefuse : cloud::NonFinite::kDrop;
  return options;
}

metrics::ResultDocument new_document(const std::string& command_line) {
  metrics::ResultDocument document;
  document.version = version_text();
  document.commit = kCommit;
  document.build = build_text();
  document.machine = metrics::machine_info();
  document.started_utc = metrics::utc_now();
  document.command = command_line;
  return document;
}

int fail(const Error& error, int status, ProgressBar* progress) {
  if (progress != nullptr) progress->clear();
  fmt::print(stderr, "palpate: error: {}\n", error.message());
  return status;
}

}  // namespace palpate::experiments
