// What several commands share: registries filled with everything there is, arguments turned into options.
#pragma once

#include "experiments/command/commands.h"
#include "experiments/study/output_folder.h"
#include "toolkit/io/read_model.h"
#include "toolkit/metrics/result_json.h"
#include "toolkit/render/registry.h"
#include "toolkit/scene/scene.h"

namespace palpate::experiments {

[[nodiscard]] render::Registry all_renderers();
[[nodiscard]] io::Readers all_readers();
[[nodiscard]] Result<scene::LoadOptions> load_options(const ModelArguments& arguments);

/// Begins a run in `folder`, and says where it goes on from an interrupted one, or drops one.
[[nodiscard]] Status begin_run(const OutputFolder& folder, const std::string& key, Context& context);

/// Everything about program, machine and time.
[[nodiscard]] metrics::DocumentHead new_head(const std::string& command_line);
/// A document with this head.
[[nodiscard]] metrics::ResultDocument new_document(const std::string& command_line);

}  // namespace palpate::experiments
