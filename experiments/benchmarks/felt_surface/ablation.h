// `cloud` and `cloud-smooth` with one step of what makes their surface left out.
#pragma once

#include <string>
#include <vector>

#include "toolkit/render/registry.h"

namespace palpate::felt {

/// Adds NAME-without-STEP for every step of either, cloud-plain with the rules of its frame, and
/// cloud-smooth-without-memory. `cloud` and `cloud-smooth` are there already.
void add_ablations(render::Registry& registry);

/// Whom --ablate tries: what is whole beside what lacks a step.
[[nodiscard]] std::string ablated_renderers();

/// The sets that --ablate takes.
[[nodiscard]] std::vector<std::string> ablation_sets();

}  // namespace palpate::felt
