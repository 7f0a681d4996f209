// What several commands share: registries filled with everything there is, arguments turned into options.
#pragma once

#include "experiments/command/commands.h"
#include "toolkit/io/read_model.h"
#include "toolkit/metrics/result_json.h"
#include "toolkit/render/registry.h"
#include "toolkit/scene/scene.h"

namespace palpate::experiments {

[[nodiscard]] render::Registry all_renderers();
[[nodiscard]] io::Readers all_readers();
[[nodiscard]] Result<scene::LoadOptions> load_options(const ModelArguments& arguments);

/// A document with everything about program, machine and time filled in.
[[nodiscard]] metrics::ResultDocument new_document(const std::string& command_line);

}  // namespace palpate::experiments
