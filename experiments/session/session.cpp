#include "experiments/session/session.h"

#include <fmt/format.h>

#include <palpate/baselines.h>
#include <palpate/registry.h>
#include "baselines/versions.h"
#include "experiments/run/stage.h"
#include "experiments/session/version.h"
#include "toolkit/core/input_file.h"
#include "toolkit/core/messages.h"
#include "toolkit/core/parallel.h"
#include "toolkit/voronoi/voronoi.h"

namespace palpate::experiments {

render::Registry all_renderers() {
  voronoi::register_voronoi();  // first: renderers list the builders of neighbours as they are registered
  render::Registry registry;
  render::register_toolkit_renderers(registry);
  baselines::register_baseline_renderers(registry);
  return registry;
}

io::Readers all_readers() {
  io::Readers readers;
  io::add_standard_readers(readers);
  add_library_formats(readers);
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
  if (!arguments.no_data.empty()) {
    const Result<double> number = read_number(arguments.no_data, NumberRange{});
    if (!number)
      return Error{
          fmt::format("--no-data: {}", number.error().what), "give the file's number, as in -9999", {}, 0};
    options.no_data = *number;
  }
  options.cleaning = &all_cleaning();
  options.threads = arguments.threads;
  if (!arguments.non_finite.empty())
    options.non_finite =
        arguments.non_finite == "refuse" ? cloud::NonFinite::kRefuse : cloud::NonFinite::kDrop;
  if (arguments.memory_limit_gb > 0.0)
    options.max_bytes = static_cast<std::uint64_t>(arguments.memory_limit_gb * kBytesPerGb);
  return options;
}

Status begin_run(const OutputFolder& folder, const std::string& key, Context& context) {
  const Result<OutputFolder::Begun> begun = folder.begin(key);
  if (!begun) return begun.error();
  if (*begun == OutputFolder::Begun::kAnew) return Done{};
  context.progress.clear();
  tell("palpate: {}: {}\n", folder.path().string(),
       *begun == OutputFolder::Begun::kGoesOn
           ? "going on from an interrupted run"
           : "an interrupted run was of something else (scene, path, options or program): begun anew");
  return Done{};
}

metrics::DocumentHead new_head(const std::string& command_line) {
  return {version_text(), kCommit, build_text(), metrics::machine_info(), metrics::utc_now(), command_line};
}

void add_program(metrics::MeasurementConditions& conditions) {
  conditions.compiler_flags = flags_text();
  conditions.libraries = baselines::library_versions();
  conditions.libraries.push_back(parallel_library());
}

metrics::ResultDocument new_document(const std::string& command_line) {
  metrics::ResultDocument document;
  static_cast<metrics::DocumentHead&>(document) = new_head(command_line);
  return document;
}

int fail(const Error& error, int status, ProgressBar* progress) {
  if (progress != nullptr) progress->clear();
  tell("palpate: error: {}\n", error.message());
  return status;
}

int exit_status(const Result<int>& status, Context& context) {
  if (status) return *status;
  return fail(status.error(), context.working ? kExitFellShort : kExitBadInput, &context.progress);
}

}  // namespace palpate::experiments
