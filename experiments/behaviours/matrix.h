// The suite run with several renderers: a matrix, and a picture for each behaviour.
#pragma once

#include <string>
#include <vector>

#include "experiments/behaviours/behaviour.h"
#include "experiments/report/page.h"

namespace palpate::experiments {

struct BehaviourMatrix {
  std::vector<Behaviour> behaviours;
  std::vector<RendererRequest> renderers;
  std::vector<std::vector<BehaviourOutcome>> outcomes;  ///< by renderer, then behaviour
};

/// Every renderer that is one of the methods: all of the registry but the truth and the oracle of tests.
[[nodiscard]] std::vector<RendererRequest> methods_of(const render::Registry& registry);

/// Runs everything; stops early where `progress` is cancelled, with what there is.
[[nodiscard]] BehaviourMatrix run_behaviours(std::vector<Behaviour> behaviours,
                                             std::vector<RendererRequest> renderers,
                                             const render::Registry& registry, int threads,
                                             Progress& progress);

/// One row a renderer, one column a behaviour: "wrong of all".
[[nodiscard]] Table matrix_table(const BehaviourMatrix& matrix);
[[nodiscard]] std::string matrix_json(const BehaviourMatrix& matrix);
/// One section with the matrix and the pictures, drawn into `folder`/figures.
void add_behaviours(Page& page, const BehaviourMatrix& matrix, const OutputFolder& folder);

}  // namespace palpate::experiments
